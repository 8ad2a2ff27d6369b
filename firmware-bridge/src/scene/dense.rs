//! A bone in dense arrays on its way to chunks, and steps on its lattice.

use super::SceneError;
use glam::DVec3;
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::solid::{REACH_BANDS, signed_distance_layers};
use osteon_sim_core::tissue::Tissue;
use rayon::prelude::*;

// z layers that one thread takes at a time; the result does not depend on it
const LAYERS: usize = 16;

/// Steps to the 26 neighbours: faces, then edges, then corners.
pub const NEIGHBOURS: [[i32; 3]; 26] = neighbours();

const fn neighbours() -> [[i32; 3]; 26] {
    let mut all = [[0; 3]; 26];
    let mut count = 0;
    let mut order = 1;
    while order <= 3 {
        let mut n = 0;
        while n < 27 {
            let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            if step[0] * step[0] + step[1] * step[1] + step[2] * step[2] == order {
                all[count] = step;
                count += 1;
            }
            n += 1;
        }
        order += 1;
    }
    all
}

/// Dense indices (x fastest) and the steps between them.
#[derive(Debug, Clone, Copy)]
pub struct Lattice {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
}

impl Lattice {
    /// The lattice of a grid.
    pub fn of(grid: &Grid) -> Self {
        Self { dims: grid.dims }
    }

    /// Voxel coordinates of a dense index.
    pub fn coord(self, at: usize) -> [usize; 3] {
        let [nx, ny, _] = self.dims;
        [at % nx, at / nx % ny, at / (nx * ny)]
    }

    /// Dense index of voxel (i, j, k).
    pub fn index(self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    /// The voxel `step` away; `None` outside the lattice.
    pub fn step(self, at: usize, step: [i32; 3]) -> Option<usize> {
        let from = self.coord(at);
        let mut to = [0; 3];
        for a in 0..3 {
            to[a] = from[a]
                .checked_add_signed(step[a] as isize)
                .filter(|&v| v < self.dims[a])?;
        }
        Some(self.index(to))
    }

    /// The six face neighbours inside the lattice.
    pub fn faces(self, at: usize) -> impl Iterator<Item = usize> {
        NEIGHBOURS[..6]
            .iter()
            .filter_map(move |&step| self.step(at, step))
    }

    /// All voxels on the lattice's six sides.
    pub fn border(self) -> impl Iterator<Item = usize> {
        let [nx, ny, nz] = self.dims;
        (0..nz).flat_map(move |k| {
            (0..ny).flat_map(move |j| {
                let inner = k > 0 && k + 1 < nz && j > 0 && j + 1 < ny && nx > 1;
                let step = if inner { nx - 1 } else { 1 };
                (0..nx).step_by(step).map(move |i| self.index([i, j, k]))
            })
        })
    }
}

/// A box of voxels: lowest voxel and one past the highest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelBox {
    /// Lowest voxel.
    pub lo: [usize; 3],
    /// One past the highest voxel.
    pub hi: [usize; 3],
}

impl VoxelBox {
    /// The box of all voxels that satisfy `wanted`, grown by `margin` voxels inside the lattice;
    /// `None` where there are none.
    pub fn around(
        lattice: Lattice,
        margin: usize,
        wanted: impl Fn(usize) -> bool + Sync,
    ) -> Option<Self> {
        let [nx, ny, nz] = lattice.dims;
        let join = |a: Option<Self>, b: Option<Self>| match (a, b) {
            (Some(a), Some(b)) => Some(Self {
                lo: core::array::from_fn(|n| a.lo[n].min(b.lo[n])),
                hi: core::array::from_fn(|n| a.hi[n].max(b.hi[n])),
            }),
            (a, b) => a.or(b),
        };
        let row_box = |row: usize| {
            let (j, k) = (row % ny, row / ny);
            let first = (0..nx).find(|&i| wanted(row * nx + i))?;
            let last = (0..nx).rfind(|&i| wanted(row * nx + i))?;
            Some(Self {
                lo: [first, j, k],
                hi: [last + 1, j + 1, k + 1],
            })
        };
        let tight = (0..ny * nz)
            .into_par_iter()
            .map(row_box)
            .reduce(|| None, join)?;
        Some(tight.grown(lattice, [margin; 3]))
    }

    /// Grown by `margin` voxels along each axis, inside the lattice.
    #[must_use]
    pub fn grown(self, lattice: Lattice, margin: [usize; 3]) -> Self {
        Self {
            lo: core::array::from_fn(|a| self.lo[a].saturating_sub(margin[a])),
            hi: core::array::from_fn(|a| (self.hi[a] + margin[a]).min(lattice.dims[a])),
        }
    }

    /// Voxels along each axis.
    pub fn dims(self) -> [usize; 3] {
        core::array::from_fn(|a| self.hi[a].saturating_sub(self.lo[a]))
    }

    /// The values inside the box, x fastest.
    pub fn crop<T: Copy>(self, lattice: Lattice, values: &[T]) -> Vec<T> {
        let mut out = Vec::with_capacity(self.dims().iter().product());
        for k in self.lo[2]..self.hi[2] {
            for j in self.lo[1]..self.hi[1] {
                let row = lattice.index([0, j, k]);
                out.extend_from_slice(&values[row + self.lo[0]..row + self.hi[0]]);
            }
        }
        out
    }
}

/// A whole bone in dense arrays, x fastest.
#[derive(Debug, Clone)]
pub struct Dense {
    /// The lattice.
    pub grid: Grid,
    /// Bone frame to DICOM LPS, mm.
    pub lps_from_bone: Pose,
    /// CT number, HU.
    pub density_hu: Vec<i16>,
    /// Signed distance, mm, positive inside.
    pub solid_mm: Vec<f32>,
    /// [`Tissue`] as a byte.
    pub class: Vec<u8>,
    /// Structure label; 0 = none.
    pub label: Vec<u8>,
}

impl Dense {
    /// The chunked bone, made on all cores: the same bits as [`Bone::from_dense`].
    pub fn into_bone(self) -> Result<Bone, SceneError> {
        let arrays = DenseBone {
            density_hu: &self.density_hu,
            solid_mm: &self.solid_mm,
            class: &self.class,
            label: &self.label,
        };
        Bone::from_dense_by(self.grid, self.lps_from_bone, &arrays, |coords, chunk| {
            coords.par_iter().map(|&coord| chunk(coord)).collect()
        })
        .map_err(SceneError::Bone)
    }
}

/// [`osteon_sim_core::solid::signed_distance`] on all cores, the same bits.
pub fn distance(grid: &Grid, phi: &[f32]) -> Result<Vec<f32>, SceneError> {
    distance_within(grid, phi, REACH_BANDS * grid.band_mm())
}

/// The same, saturated at ± `reach_mm`.
pub fn distance_within(grid: &Grid, phi: &[f32], reach_mm: f64) -> Result<Vec<f32>, SceneError> {
    let layer = grid.dims[0] * grid.dims[1];
    let mut out = vec![0.0; grid.len()];
    out.par_chunks_mut(LAYERS * layer)
        .enumerate()
        .try_for_each(|(n, slab)| {
            let first = n * LAYERS;
            let layers = first..first + slab.len() / layer;
            signed_distance_layers(grid, phi, layers, reach_mm, slab)
        })
        .map_err(SceneError::Bone)?;
    Ok(out)
}

/// True where a voxel at distance `solid_mm` can count as bone in any reading: its own occupancy,
/// or the voxel nearest to a point on the surface.
pub fn near_bone(grid: &Grid, solid_mm: f32) -> bool {
    f64::from(solid_mm) > -grid.band_mm()
}

/// Marks as [`Tissue::Subchondral`] what lies within 3 mm of the surface under the joint face:
/// within 18 mm of the plan's axis, within 10 mm of its face along it, and of at least 400 HU.
pub fn mark_subchondral(dense: &mut Dense, bone_from_plan: &Pose) -> Result<(), SceneError> {
    const DEPTH_MM: f64 = 3.0;
    const RADIUS_MM: f64 = 18.0;
    const ALONG_MM: f64 = 10.0;
    const LEAST_HU: i16 = 400;
    let lattice = Lattice::of(&dense.grid);
    let plan_from_bone = bone_from_plan.inverse();
    let under_face = |at: usize| {
        let [i, j, k] = lattice.coord(at);
        let p = plan_from_bone.point(dense.grid.centre(i, j, k));
        p.z.abs() <= ALONG_MM && p.x.hypot(p.y) <= RADIUS_MM
    };
    let Some(tight) = VoxelBox::around(lattice, 0, under_face) else {
        return Ok(());
    };
    let reach_mm = DEPTH_MM + 0.1;
    // the surface just outside the region counts too
    let margin = (DVec3::splat(reach_mm) / dense.grid.spacing_mm).ceil();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at most 311 voxels, for spacings are 0.01 mm or more"
    )]
    let region = tight.grown(lattice, margin.to_array().map(|m| m as usize + 1));
    let part = Lattice {
        dims: region.dims(),
    };
    let grid = Grid {
        dims: part.dims,
        ..dense.grid
    };
    let depth = distance_within(&grid, &region.crop(lattice, &dense.solid_mm), reach_mm)?;
    for (at, &depth) in depth.iter().enumerate() {
        let c = part.coord(at);
        let whole = lattice.index(core::array::from_fn(|a| c[a] + region.lo[a]));
        let bony = dense.class[whole] != Tissue::Air as u8 && dense.density_hu[whole] >= LEAST_HU;
        if bony && f64::from(depth) <= DEPTH_MM && under_face(whole) {
            dense.class[whole] = Tissue::Subchondral as u8;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_border_is_every_voxel_with_a_missing_face_neighbour() {
        for dims in [[5, 4, 3], [1, 3, 3], [2, 2, 2], [6, 1, 1]] {
            let lattice = Lattice { dims };
            let mut found: Vec<usize> = lattice.border().collect();
            found.sort_unstable();
            let expected: Vec<usize> = (0..dims.iter().product())
                .filter(|&at| lattice.faces(at).count() < 6)
                .collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn neighbours_are_all_different_and_nearest_first() {
        let length = |s: [i32; 3]| s.iter().map(|v| v * v).sum::<i32>();
        assert!(NEIGHBOURS.is_sorted_by_key(|&s| length(s)));
        let mut unique = NEIGHBOURS.to_vec();
        unique.sort_unstable();
        unique.dedup();
        assert_eq!(unique.len(), 26);
        assert!(!unique.contains(&[0, 0, 0]));
    }
}
