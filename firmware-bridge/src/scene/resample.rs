//! The bone on another lattice, with the error that this costs.
//!
//! CT numbers and the distance field go through a separable Catmull-Rom cubic (third order for
//! smooth fields, passes through the samples), labels through their nearest voxel. No low-pass is
//! applied: on a coarser lattice features thinner than two voxels are lost, and the error says so.

use super::SceneError;
use super::dense::Lattice;
use glam::DVec3;
use osteon_sim_core::grid::Grid;
use rayon::prelude::*;
use serde::Serialize;

/// Most voxels of a resampled lattice.
pub const MAX_VOXELS: usize = 1 << 28;

/// What resampling costs, measured on the bone at hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ResampleError {
    /// RMS distance of the new surface at the source's own surface points, mm.
    pub surface_rms_mm: f64,
    /// 99th percentile of such distances, mm.
    pub surface_p99_mm: f64,
    /// Largest such distance, mm (saturated at the band): where a speck or a sliver thinner than a
    /// new voxel was lost.
    pub surface_max_mm: f64,
    /// Surface points compared: where the source's surface crosses its lattice edges.
    pub surface_points: usize,
    /// RMS difference of the CT numbers read back at the source's solid voxels, HU; absent where
    /// the source has none (the phantom is evaluated, not resampled).
    pub hu_rms: Option<f64>,
}

/// The lattice of cubes of `voxel_mm` over the same box and origin.
pub fn resampled_grid(grid: &Grid, voxel_mm: f64) -> Result<Grid, SceneError> {
    let refuse = || SceneError::VoxelSize { voxel_mm };
    if !(0.05..=10.0).contains(&voxel_mm) {
        return Err(refuse());
    }
    let last = DVec3::from_array(grid.dims.map(|n| (n - 1) as f64)) * grid.spacing_mm;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive; Grid::new refuses what is too long"
    )]
    // a millionth of a voxel: an edge of whole voxels stays whole
    let dims = (last / voxel_mm + 1e-6).to_array().map(|n| n as usize + 1);
    let grid = Grid::new(dims, DVec3::splat(voxel_mm)).map_err(|_edge| refuse())?;
    if grid.len() > MAX_VOXELS {
        return Err(refuse());
    }
    Ok(grid)
}

/// Weights of four neighbouring samples for one new sample.
struct Taps {
    at: [usize; 4],
    weight: [f32; 4],
}

fn taps(count: usize, ratio: f64, length: usize) -> Vec<Taps> {
    (0..count)
        .map(|n| {
            let x = (n as f64 * ratio).min((length - 1) as f64);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "in 0..length"
            )]
            let base = x as usize;
            let t = x - base as f64;
            let (t2, t3) = (t * t, t * t * t);
            let weight = [
                -0.5 * t + t2 - 0.5 * t3,
                1.0 - 2.5 * t2 + 1.5 * t3,
                0.5 * t + 2.0 * t2 - 1.5 * t3,
                0.5 * (t3 - t2),
            ];
            // beyond the lattice its outermost samples go on
            let at = [0, 1, 2, 3].map(|m| (base + m).saturating_sub(1).min(length - 1));
            #[expect(clippy::cast_possible_truncation, reason = "weights within ±2")]
            let weight = weight.map(|w| w as f32);
            Taps { at, weight }
        })
        .collect()
}

/// `values` on `from`, read by a Catmull-Rom cubic at the voxels of `to` (same origin and axes).
pub fn cubic(from: &Grid, values: &[f32], to: &Grid) -> Vec<f32> {
    let mut dims = from.dims;
    let mut out = values.to_vec();
    for axis in 0..3 {
        let ratio = to.spacing_mm[axis] / from.spacing_mm[axis];
        let taps = taps(to.dims[axis], ratio, dims[axis]);
        out = pass(&out, dims, axis, &taps);
        dims[axis] = to.dims[axis];
    }
    out
}

/// One axis of the separable filter.
fn pass(values: &[f32], dims: [usize; 3], axis: usize, taps: &[Taps]) -> Vec<f32> {
    let inner: usize = dims[..axis].iter().product();
    let outer: usize = dims[axis + 1..].iter().product();
    let length = dims[axis];
    let mut out = vec![0.0; inner * taps.len() * outer];
    out.par_chunks_mut(inner * taps.len())
        .enumerate()
        .for_each(|(o, slab)| {
            let source = &values[o * length * inner..(o + 1) * length * inner];
            for (tap, line) in taps.iter().zip(slab.chunks_exact_mut(inner)) {
                let lines = tap.at.map(|at| &source[at * inner..(at + 1) * inner]);
                for (n, v) in line.iter_mut().enumerate() {
                    *v = tap.weight[0] * lines[0][n]
                        + tap.weight[1] * lines[1][n]
                        + tap.weight[2] * lines[2][n]
                        + tap.weight[3] * lines[3][n];
                }
            }
        });
    out
}

/// The label of the voxel of `from` nearest to each voxel of `to`.
pub fn nearest(from: &Grid, labels: &[u8], to: &Grid) -> Vec<u8> {
    let source = Lattice::of(from);
    let ratio = to.spacing_mm / from.spacing_mm;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and clamped to the lattice"
    )]
    let column = |axis: usize| -> Vec<usize> {
        (0..to.dims[axis])
            .map(|n| ((n as f64 * ratio[axis]).round() as usize).min(from.dims[axis] - 1))
            .collect()
    };
    let [xs, ys, zs] = [column(0), column(1), column(2)];
    let mut out = vec![0; to.len()];
    out.par_chunks_mut(to.dims[0])
        .enumerate()
        .for_each(|(row, line)| {
            let (j, k) = (ys[row % to.dims[1]], zs[row / to.dims[1]]);
            for (l, &i) in line.iter_mut().zip(&xs) {
                *l = labels[source.index([i, j, k])];
            }
        });
    out
}

/// Trilinear reading at `p` (bone frame, mm); the outermost samples go on beyond the lattice.
pub fn trilinear(grid: &Grid, values: &[f32], p: DVec3) -> f32 {
    let lattice = Lattice::of(grid);
    let mut base = [0; 3];
    let mut t = [0.0; 3];
    for a in 0..3 {
        let last = (grid.dims[a] - 1) as f64;
        let x = (p[a] / grid.spacing_mm[a]).clamp(0.0, last);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the lattice"
        )]
        let low = (x as usize).min(grid.dims[a].saturating_sub(2));
        base[a] = low;
        t[a] = x - low as f64;
    }
    let mut sum = 0.0;
    for corner in 0..8 {
        let bit = |a: usize| (corner >> a) & 1;
        let weight: f64 = (0..3)
            .map(|a| if bit(a) == 1 { t[a] } else { 1.0 - t[a] })
            .product();
        let at = core::array::from_fn(|a| (base[a] + bit(a)).min(grid.dims[a] - 1));
        sum += weight * f64::from(values[lattice.index(at)]);
    }
    #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 values")]
    let sum = sum as f32;
    sum
}

/// Where the surface crosses the lattice edges, bone frame, mm.
pub fn surface_points(grid: &Grid, solid_mm: &[f32]) -> Vec<DVec3> {
    let lattice = Lattice::of(grid);
    (0..solid_mm.len())
        .into_par_iter()
        .flat_map_iter(|at| {
            let [i, j, k] = lattice.coord(at);
            let p = grid.centre(i, j, k);
            (0..3).filter_map(move |a| {
                let mut step = [0; 3];
                step[a] = 1;
                let next = lattice.step(at, step)?;
                let (d0, d1) = (f64::from(solid_mm[at]), f64::from(solid_mm[next]));
                if (d0 > 0.0) == (d1 > 0.0) {
                    return None;
                }
                let mut q = p;
                q[a] += grid.spacing_mm[a] * d0 / (d0 - d1);
                Some(q)
            })
        })
        .collect()
}

impl ResampleError {
    /// The error that the field shows at `points` of the true surface (bone frame, mm).
    pub fn at(grid: &Grid, solid_mm: &[f32], points: &[DVec3]) -> Self {
        let mut distances: Vec<f64> = points
            .par_iter()
            .map(|&p| f64::from(trilinear(grid, solid_mm, p)).abs())
            .collect();
        distances.par_sort_unstable_by(f64::total_cmp);
        let squares: f64 = distances.iter().map(|d| d * d).sum();
        let count = distances.len();
        Self {
            surface_rms_mm: (squares / count.max(1) as f64).sqrt(),
            surface_p99_mm: distances.get(count * 99 / 100).copied().unwrap_or(0.0),
            surface_max_mm: distances.last().copied().unwrap_or(0.0),
            surface_points: count,
            hu_rms: None,
        }
    }
}

/// RMS difference of `hu` on `to`, read back trilinearly, from the source's own values at its solid
/// voxels, HU.
pub fn hu_error(from: &Grid, source: (&[f32], &[f32]), to: &Grid, hu: &[f32]) -> f64 {
    let (source_hu, source_solid) = source;
    let lattice = Lattice::of(from);
    let squares: Vec<f64> = (0..source_hu.len())
        .into_par_iter()
        .filter(|&at| source_solid[at] > 0.0)
        .map(|at| {
            let [i, j, k] = lattice.coord(at);
            let back = trilinear(to, hu, from.centre(i, j, k));
            f64::from(back - source_hu[at]).powi(2)
        })
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(dims: [usize; 3], spacing: DVec3) -> Grid {
        Grid::new(dims, spacing).expect("valid")
    }

    fn sample(grid: &Grid, f: impl Fn(DVec3) -> f64) -> Vec<f32> {
        let lattice = Lattice::of(grid);
        (0..grid.len())
            .map(|at| {
                let [i, j, k] = lattice.coord(at);
                #[expect(clippy::cast_possible_truncation, reason = "test values")]
                let v = f(grid.centre(i, j, k)) as f32;
                v
            })
            .collect()
    }

    #[test]
    fn cubic_reproduces_quadratics_and_trilinear_reproduces_planes() {
        let from = grid([18, 16, 14], DVec3::new(0.8, 0.7, 1.0));
        let to = resampled_grid(&from, 0.33).expect("valid");
        let quadratic = |p: DVec3| 3.0 + p.x - 2.0 * p.y + 0.3 * p.x * p.x + 0.2 * p.z * p.z;
        let out = cubic(&from, &sample(&from, quadratic), &to);
        let lattice = Lattice::of(&to);
        let far = DVec3::from_array(from.dims.map(|n| n as f64 - 2.0)) * from.spacing_mm;
        let mut compared = 0;
        for (at, v) in out.iter().enumerate() {
            let [i, j, k] = lattice.coord(at);
            let p = to.centre(i, j, k);
            // away from the border, where samples are repeated
            if p.cmpge(from.spacing_mm).all() && p.cmple(far).all() {
                assert!((f64::from(*v) - quadratic(p)).abs() < 1e-3, "{p}");
                compared += 1;
            }
        }
        assert!(compared > 10_000);
        let plane = |p: DVec3| 5.0 - p.x + 0.5 * p.y + 2.0 * p.z;
        let p = DVec3::new(3.21, 4.56, 7.89);
        let read = trilinear(&from, &sample(&from, plane), p);
        assert!((f64::from(read) - plane(p)).abs() < 1e-4);
    }

    #[test]
    fn surface_points_and_their_error_are_those_of_a_moved_plane() {
        let from = grid([12, 12, 12], DVec3::splat(1.0));
        let to = grid([23, 23, 23], DVec3::splat(0.5));
        let plane = |offset: f64| move |p: DVec3| (p.x * 0.6 + p.y * 0.8) - 7.0 - offset;
        let points = surface_points(&from, &sample(&from, plane(0.0)));
        assert!(points.len() > 100);
        let error = ResampleError::at(&to, &sample(&to, plane(0.125)), &points);
        for e in [
            error.surface_rms_mm,
            error.surface_p99_mm,
            error.surface_max_mm,
        ] {
            assert!((e - 0.125).abs() < 1e-5, "{e}");
        }
        assert_eq!(error.surface_points, points.len());
    }

    #[test]
    fn labels_go_to_the_nearest_voxel() {
        let from = grid([4, 1, 1], DVec3::ONE);
        let to = resampled_grid(&from, 0.25).expect("valid");
        let out = nearest(&from, &[1, 2, 3, 4], &to);
        assert_eq!(out, [1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4]);
    }

    #[test]
    fn absurd_voxels_are_refused() {
        let from = grid([100, 100, 100], DVec3::ONE);
        for voxel_mm in [0.0, -1.0, f64::NAN, f64::INFINITY, 0.051, 1e-9, 11.0] {
            assert!(resampled_grid(&from, voxel_mm).is_err(), "{voxel_mm}");
        }
    }
}
