//! The built-in bone: a procedural right scapula with a layered, concave glenoid.
//!
//! Phantom frame: origin at the middle of the joint face, x anterior, y superior, z lateral (out of
//! the face), mm; right-handed. The lattice is aligned with it. In the patient the scapular plane
//! stands 35° in front of the coronal one and the face's middle at LPS (-160, 20, -120).
//!
//! Sizes are a typical adult's: about 90 × 145 × 125 mm, face 28 × 36 mm with a radius of 34 mm.
//! Layers under the face: cartilage 1.8 mm (0.10 g/cm³), subchondral plate 2 mm (1.9 g/cm³),
//! cancellous bone (0.45 g/cm³ with band-limited noise); elsewhere a cortical shell of 1.5 mm.

pub mod shape;

use super::dense::{Dense, Lattice, distance, near_bone};
use super::resample::{MAX_VOXELS, ResampleError};
use super::{Scene, SceneArgs, SceneError, SceneSummary, plan};
use glam::{DMat3, DQuat, DVec3};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::{Tissue, hu_of_density};
use rayon::prelude::*;
use shape::Scapula;
use std::sync::Arc;

/// Voxel edge without `--voxel-mm`, mm.
pub const VOXEL_MM: f64 = 0.8;
/// The scapula's label.
pub const LABEL: u8 = 1;
/// Thickness of the cartilage, mm.
pub const CARTILAGE_MM: f64 = 1.8;
/// Thickness of the subchondral plate, mm.
pub const PLATE_MM: f64 = 2.0;
/// Thickness of the cortical shell, mm.
pub const SHELL_MM: f64 = 1.5;
/// Lowest and highest corner of the lattice's box, phantom frame, mm.
pub const BOX: (DVec3, DVec3) = (
    DVec3::new(-44.0, -106.0, -108.0),
    DVec3::new(46.0, 52.0, 30.0),
);

/// Medial end of the scapular spine, phantom frame, mm.
pub const TRIGONUM_SPINAE: DVec3 = DVec3::new(-3.0, 10.0, -96.0);
/// Lowest point of the blade, phantom frame, mm.
pub const INFERIOR_ANGLE: DVec3 = DVec3::new(-3.0, -94.0, -75.0);

// apparent densities, g/cm³
const CARTILAGE: f64 = 0.10;
const PLATE: f64 = 1.9;
const CORTEX: f64 = 1.8;
const SPONGIOSA: f64 = 0.45;
const SPONGIOSA_SPREAD: f64 = 0.14;
/// Layers of voxels that one job evaluates, and the edge of its culling blocks.
const BLOCK: usize = 4;

/// The phantom as a scene. A plan, if given, is read in its LPS frame.
pub(super) fn load(
    args: &SceneArgs,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Scene, SceneError> {
    progress("shaping the phantom", 0.0);
    let voxel_mm = args.voxel_mm.unwrap_or(VOXEL_MM);
    let grid = grid(voxel_mm)?;
    let wrong = args.recipe.phantom.unwrap_or_default();
    let shape = Scapula::eroded(wrong.erosion_deg, wrong.erosion_mm);
    let phi = field(&grid, &shape);
    progress("finding the surface", 0.4);
    let solid_mm = distance(&grid, &phi)?;
    let error = lattice_error(&grid, &shape, &phi, &solid_mm);
    progress("filling in tissue", 0.6);
    let dense = tissues(grid, (&shape, wrong.density), solid_mm, args.seed);
    let bone_from_plan = match (&args.pose, &args.recipe.lps_from_plan) {
        (_, Some(lps_from_plan)) => dense.lps_from_bone.inverse().then(lps_from_plan),
        (Some(path), None) => {
            let pose = dense.lps_from_bone.inverse().then(&plan::read(path)?);
            plan::check_near(path, &grid, &pose)?;
            pose
        }
        // the lattice's axes are the phantom's
        (None, None) => Pose::new(DQuat::IDENTITY, -BOX.0),
    };
    let bone = dense.into_bone()?;
    progress("bone ready", 1.0);
    let mut summary = SceneSummary::of(&bone);
    summary.resample_error = Some(error);
    Ok(Scene {
        bone: Arc::new(bone),
        bone_from_plan,
        source: match args.recipe.phantom {
            None => format!("phantom (seed {})", args.seed),
            Some(p) => format!(
                "phantom (seed {}, erosion {}° {} mm, density {})",
                p.seed, p.erosion_deg, p.erosion_mm, p.density
            ),
        },
        summary,
        kept_labels: vec![LABEL],
        protected_labels: Vec::new(),
    })
}

fn grid(voxel_mm: f64) -> Result<Grid, SceneError> {
    let refuse = || SceneError::VoxelSize { voxel_mm };
    if !(0.05..=10.0).contains(&voxel_mm) {
        return Err(refuse());
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most 3160 voxels an axis"
    )]
    let dims = ((BOX.1 - BOX.0) / voxel_mm)
        .ceil()
        .to_array()
        .map(|n| n as usize + 1);
    let grid = Grid::new(dims, DVec3::splat(voxel_mm)).map_err(|_edge| refuse())?;
    if grid.len() > MAX_VOXELS {
        return Err(refuse());
    }
    Ok(grid)
}

/// Phantom frame in the patient: x anterior, y superior, z to the patient's right, turned by 35°
/// about the superior axis so that the face looks forward as well.
fn lps_from_phantom() -> Pose {
    let (sin, cos) = (35.0_f64.to_radians().sin(), 35.0_f64.to_radians().cos());
    let lateral = DVec3::new(-cos, -sin, 0.0);
    let superior = DVec3::Z;
    let anterior = superior.cross(lateral);
    let rotation = DQuat::from_mat3(&DMat3::from_cols(anterior, superior, lateral));
    Pose::new(rotation, DVec3::new(-160.0, 20.0, -120.0))
}

/// The implicit surface at every voxel, positive inside. Blocks whose middle is farther from the
/// surface than their corners can be are filled with the middle's value.
fn field(grid: &Grid, shape: &Scapula) -> Vec<f32> {
    let [nx, ny, _] = grid.dims;
    let lattice = Lattice::of(grid);
    let mut phi = vec![0.0; grid.len()];
    let half = 0.5 * (BLOCK - 1) as f64 * grid.spacing_mm;
    // every cell on the surface must have true values at all of its corners
    let safe = shape::LIPSCHITZ * (half.length() + grid.band_mm());
    phi.par_chunks_mut(BLOCK * nx * ny)
        .enumerate()
        .for_each(|(slab, values)| {
            let k0 = slab * BLOCK;
            let k1 = k0 + values.len() / (nx * ny);
            for (j0, i0) in blocks(ny).flat_map(|j| blocks(nx).map(move |i| (j, i))) {
                let middle = shape.value(BOX.0 + grid.centre(i0, j0, k0) + half);
                for k in k0..k1 {
                    for j in j0..(j0 + BLOCK).min(ny) {
                        for i in i0..(i0 + BLOCK).min(nx) {
                            let v = if middle.abs() > safe {
                                middle
                            } else {
                                shape.value(BOX.0 + grid.centre(i, j, k))
                            };
                            values[lattice.index([i, j, k - k0])] = narrow(v);
                        }
                    }
                }
            }
        });
    phi
}

fn blocks(length: usize) -> impl Iterator<Item = usize> + Clone {
    (0..length).step_by(BLOCK)
}

#[expect(clippy::cast_possible_truncation, reason = "lengths of some 100 mm")]
fn narrow(v: f64) -> f32 {
    v as f32
}

/// Distance of the lattice's surface to the implicit one, at the latter's crossings of the cells'
/// diagonals (found by bisection).
fn lattice_error(grid: &Grid, shape: &Scapula, phi: &[f32], solid_mm: &[f32]) -> ResampleError {
    let lattice = Lattice::of(grid);
    let crossing = |at: usize| {
        let end = lattice.step(at, [1, 1, 1])?;
        if (phi[at] > 0.0) == (phi[end] > 0.0) {
            return None;
        }
        let [i, j, k] = lattice.coord(at);
        let (mut inside, mut outside) = (grid.centre(i, j, k), grid.centre(i + 1, j + 1, k + 1));
        if phi[at] <= 0.0 {
            core::mem::swap(&mut inside, &mut outside);
        }
        // a thousandth of a voxel
        for _ in 0..11 {
            let middle = inside.midpoint(outside);
            if shape.value(BOX.0 + middle) > 0.0 {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        Some(inside)
    };
    let points: Vec<DVec3> = (0..grid.len())
        .into_par_iter()
        .filter_map(crossing)
        .collect();
    ResampleError::at(grid, solid_mm, &points)
}

/// Density, class and label of every voxel near or in the bone. Voxels just outside take the
/// density of the tissue next to them, so that interpolation does not soften the surface.
fn tissues(grid: Grid, (shape, scale): (&Scapula, f64), solid_mm: Vec<f32>, seed: u64) -> Dense {
    let lattice = Lattice::of(&grid);
    let of_voxel = |(at, &solid): (usize, &f32)| {
        if !near_bone(&grid, solid) {
            return (-1000, Tissue::Air as u8, 0);
        }
        let [i, j, k] = lattice.coord(at);
        let (tissue, density) = tissue_at(shape, BOX.0 + grid.centre(i, j, k), seed);
        let soft = matches!(tissue, Tissue::Subchondral | Tissue::Cancellous);
        let density = if soft { density * scale } else { density };
        #[expect(clippy::cast_possible_truncation, reason = "densities below 2 g/cm³")]
        let hu = hu_of_density(density).round() as i16;
        (hu, tissue as u8, LABEL)
    };
    let ((density_hu, class), label) = solid_mm
        .par_iter()
        .enumerate()
        .map(of_voxel)
        .map(|(hu, class, label)| ((hu, class), label))
        .unzip();
    let corner = lps_from_phantom().point(BOX.0);
    Dense {
        grid,
        lps_from_bone: Pose::new(lps_from_phantom().rotation, corner),
        density_hu,
        solid_mm,
        class,
        label,
    }
}

/// Tissue and apparent density, g/cm³, at a point (phantom frame, mm) of the bone.
fn tissue_at(shape: &Scapula, p: DVec3, seed: u64) -> (Tissue, f64) {
    if let Some(depth) = shape.depth_under_face(p) {
        if depth < CARTILAGE_MM {
            return (Tissue::Cartilage, CARTILAGE);
        }
        if depth < CARTILAGE_MM + PLATE_MM {
            return (Tissue::Subchondral, PLATE);
        }
    }
    // the shell, by the first-order distance to the surface; a ridge inside a thin plate, where the
    // gradient vanishes, is shell
    let value = shape.value(p);
    let near = value < SHELL_MM * shape::LIPSCHITZ;
    if near && value < SHELL_MM * shape.gradient(p).length().max(0.8) {
        return (Tissue::Cortical, CORTEX);
    }
    let texture = 0.6 * noise(p / 3.0, seed) + 0.4 * noise(p / 1.6, seed ^ 0x5bd1_e995);
    (Tissue::Cancellous, SPONGIOSA + SPONGIOSA_SPREAD * texture)
}

/// Value noise in [-1, 1]: pseudo-random numbers at whole coordinates, blended smoothly between
/// them, so that no wavelength is much shorter than two units.
fn noise(p: DVec3, seed: u64) -> f64 {
    let base = p.floor();
    let t = p - base;
    let t = t * t * (DVec3::splat(3.0) - 2.0 * t);
    let mut sum = 0.0;
    for corner in 0..8_u32 {
        let bit = DVec3::new(
            f64::from(corner & 1),
            f64::from((corner >> 1) & 1),
            f64::from(corner >> 2),
        );
        let weight = (t * bit + (1.0 - t) * (1.0 - bit)).to_array();
        sum += weight.iter().product::<f64>() * random((base + bit).to_array(), seed);
    }
    sum
}

/// A number in [-1, 1) of three whole coordinates and a seed (splitmix64's finaliser).
fn random(at: [f64; 3], seed: u64) -> f64 {
    let mut x = seed;
    for v in at {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole and small; wrapped on purpose"
        )]
        let word = v as i64 as u64;
        x = (x ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^= x >> 31;
    }
    (x >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests;
