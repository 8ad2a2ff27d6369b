//! What a method missed and what it took in excess, against the exact tool.

use super::place::{Exact, Region, active, overlap, region};
use super::{Baseline, VoxelTool};
use glam::Vec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;

/// Edge of the blocks that are settled by their middle, voxels.
const BLOCK: usize = 8;

/// The voxels that the exact tool removes along a set of poses: those of the bone whose centre lies
/// inside it (signed distance below 0) at one of them at least.
#[derive(Debug, Clone)]
pub struct Truth<'a> {
    bone: &'a Bone,
    region: Region,
    // one bit a voxel of the region, x fastest
    bits: Vec<u64>,
    count: u64,
}

/// Voxels of one run of a method, counted against the [`Truth`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Errors {
    /// Removed by the exact tool.
    pub truly: u64,
    /// Removed by the method.
    pub removed: u64,
    /// Removed by the exact tool only.
    pub missed: u64,
    /// Removed by the method only.
    pub excess: u64,
}

impl Errors {
    /// `missed` as a fraction of `truly`; 0 where nothing was to be removed.
    pub fn missed_fraction(&self) -> f64 {
        self.fraction(self.missed)
    }

    /// `excess` as a fraction of `truly`; 0 where nothing was to be removed.
    pub fn excess_fraction(&self) -> f64 {
        self.fraction(self.excess)
    }

    fn fraction(&self, part: u64) -> f64 {
        if self.truly == 0 {
            0.0
        } else {
            part as f64 / self.truly as f64
        }
    }
}

impl<'a> Truth<'a> {
    /// What the exact tool of `tool` removes at `poses` (`bone_from_tool`).
    pub fn new(bone: &'a Bone, tool: &VoxelTool, poses: &[Pose]) -> Self {
        let reach = |pose| overlap(bone.grid(), tool, pose).map(|o| region(bone.grid(), o));
        let region = poses
            .iter()
            .filter_map(reach)
            .fold(Region::NONE, Region::with);
        let [dx, dy, dz] = region.dims();
        let mut truth = Self {
            bone,
            region,
            bits: vec![0u64; (dx * dy * dz).div_ceil(64)],
            count: 0,
        };
        for pose in poses {
            let exact = Exact::new(bone.grid(), pose);
            for block in reach(pose).into_iter().flat_map(blocks) {
                truth.take(block, &exact, tool);
            }
        }
        truth
    }

    // the voxels of a block that lie inside; none is looked at where its middle is far from the surface
    fn take(&mut self, block: Region, exact: &Exact, tool: &VoxelTool) {
        let middle: [f64; 3] =
            core::array::from_fn(|a| 0.5 * (block.lo[a] + block.hi[a] - 1) as f64);
        let reach = 0.5 * (BLOCK as f64 - 1.0) * self.bone.grid().band_mm() + 1e-3;
        let distance = f64::from(tool.distance(exact.point(middle)));
        if distance > reach {
            return;
        }
        let [dx, dy, _] = self.region.dims();
        for voxel in block.voxels() {
            let [i, j, k]: [usize; 3] = core::array::from_fn(|a| voxel[a] - self.region.lo[a]);
            let at = (k * dy + j) * dx + i;
            let known = self.bits[at / 64] >> (at % 64) & 1 != 0;
            let inside = || distance < -reach || tool.distance(exact.centre(voxel)) < 0.0;
            if !known && inside() && active(self.bone, voxel) {
                self.bits[at / 64] |= 1 << (at % 64);
                self.count += 1;
            }
        }
    }

    /// Voxels that the exact tool removes.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Counts a method's errors after it has had an event at each of the poses, from the bone's first
    /// state on. Looks only where the tool's grid was, a voxel around it included.
    pub fn errors(&self, method: &dyn Baseline) -> Errors {
        let mut errors = Errors {
            truly: self.count,
            removed: 0,
            missed: 0,
            excess: 0,
        };
        for (at, voxel) in self.region.voxels().enumerate() {
            let truly = self.bits[at / 64] >> (at % 64) & 1 != 0;
            if !truly && !active(self.bone, voxel) {
                continue;
            }
            let removed = method.is_removed(voxel);
            errors.removed += u64::from(removed);
            errors.missed += u64::from(truly && !removed);
            errors.excess += u64::from(removed && !truly);
        }
        errors
    }
}

/// The blocks of at most 8³ voxels that a region is made of.
fn blocks(region: Region) -> impl Iterator<Item = Region> {
    let counts = region.dims().map(|n| n.div_ceil(BLOCK));
    let all = Region {
        lo: [0; 3],
        hi: counts,
    };
    all.voxels().map(move |c| {
        let lo: [usize; 3] = core::array::from_fn(|a| region.lo[a] + c[a] * BLOCK);
        Region {
            lo,
            hi: core::array::from_fn(|a| (lo[a] + BLOCK).min(region.hi[a])),
        }
    })
}

/// How far a method's surface lies from the exact tool's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceError {
    /// Root of the mean square, mm.
    pub rms_mm: f64,
    /// Largest, mm.
    pub max_mm: f64,
    /// Faces counted.
    pub faces: u64,
}

/// The surface that a method left after a single event at `bone_from_tool`: the faces between a
/// removed voxel and one of the bone that is left, each by its centre, measured by the exact signed
/// distance. `counts` says by a face's centre in the tool frame (mm) whether it counts, so that the
/// tool's creases can be left out. Without any face all is 0.
pub fn surface_error(
    bone: &Bone,
    tool: &VoxelTool,
    bone_from_tool: &Pose,
    method: &dyn Baseline,
    counts: &dyn Fn(Vec3) -> bool,
) -> SurfaceError {
    let exact = Exact::new(bone.grid(), bone_from_tool);
    let reached =
        overlap(bone.grid(), tool, bone_from_tool).map_or(Region::NONE, |o| region(bone.grid(), o));
    let (mut squares, mut max, mut faces) = (0.0, 0.0f64, 0u64);
    for voxel in reached.voxels() {
        if !method.is_removed(voxel) {
            continue;
        }
        for side in 0..6 {
            let (axis, up) = (side / 2, side % 2 == 1);
            let mut beside = voxel;
            // below 0 it wraps far outside of every lattice
            beside[axis] = if up {
                voxel[axis] + 1
            } else {
                voxel[axis].wrapping_sub(1)
            };
            if !active(bone, beside) || method.is_removed(beside) {
                continue;
            }
            let mut face = voxel.map(|v| v as f64);
            face[axis] += if up { 0.5 } else { -0.5 };
            let p = exact.point(face);
            if counts(p) {
                let distance = f64::from(tool.distance(p)).abs();
                squares += distance * distance;
                max = max.max(distance);
                faces += 1;
            }
        }
    }
    SurfaceError {
        rms_mm: (squares / faces.max(1) as f64).sqrt(),
        max_mm: max,
        faces,
    }
}
