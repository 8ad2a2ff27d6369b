//! What every method does first: box against box, the box of their overlap, the bone's voxels in
//! tool cells.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the lattice before the cast; f64 becomes f32 inside a tool"
)]

use super::VoxelTool;
use glam::{DMat3, DVec3, Vec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::broad::Obb;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;

/// CT number from which a voxel is active in the thesis, HU (Alg. 2.6).
pub const THRESHOLD_HU: i16 = 120;

/// Density that the thesis would hold for a voxel: 0 where it is not active.
///
/// Active is what the product calls solid, so that all methods cut the same bone; such a voxel below
/// the thesis's threshold counts as of the threshold's density.
pub(super) fn density(bone: &Bone, voxel: [usize; 3]) -> i16 {
    bone.locate(voxel).map_or(0, |(chunk, at)| {
        let data = bone.chunk(chunk);
        if data.solid[at] > 0 {
            data.density_hu[at].max(THRESHOLD_HU)
        } else {
            0
        }
    })
}

/// Whether a voxel belongs to the bone in its first state; false outside the lattice.
pub(super) fn active(bone: &Bone, voxel: [usize; 3]) -> bool {
    let dims = bone.grid().dims;
    (0..3).all(|a| voxel[a] < dims[a])
        && bone
            .locate(voxel)
            .is_some_and(|(chunk, at)| bone.chunk(chunk).solid[at] > 0)
}

/// Voxels from `lo` up to, not with, `hi`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Region {
    /// First voxel.
    pub(super) lo: [usize; 3],
    /// One past the last.
    pub(super) hi: [usize; 3],
}

impl Region {
    /// No voxel.
    pub(super) const NONE: Self = Self {
        lo: [usize::MAX; 3],
        hi: [0; 3],
    };

    /// The smallest region with both.
    pub(super) fn with(self, other: Self) -> Self {
        Self {
            lo: core::array::from_fn(|a| self.lo[a].min(other.lo[a])),
            hi: core::array::from_fn(|a| self.hi[a].max(other.hi[a])),
        }
    }

    /// Voxels along x, y, z.
    pub(super) fn dims(self) -> [usize; 3] {
        core::array::from_fn(|a| self.hi[a].saturating_sub(self.lo[a]))
    }

    /// All its voxels, x fastest.
    pub(super) fn voxels(self) -> impl Iterator<Item = [usize; 3]> {
        let Self { lo, hi } = self;
        (lo[2]..hi[2]).flat_map(move |k| {
            (lo[1]..hi[1]).flat_map(move |j| (lo[0]..hi[0]).map(move |i| [i, j, k]))
        })
    }
}

/// The box of the overlap of bone and tool (Alg. 2.7, 2.8), in units of voxels from the bone's lowest
/// corner: voxel i fills \[i, i + 1). `None` where the boxes are apart.
pub(super) fn overlap(grid: &Grid, tool: &VoxelTool, bone_from_tool: &Pose) -> Option<[DVec3; 2]> {
    if !bone_from_tool.is_valid() {
        return None;
    }
    let dims = DVec3::from_array(grid.dims.map(|n| n as f64));
    let half = 0.5 * grid.spacing_mm;
    let bone_box = Obb::aligned(-half, dims * grid.spacing_mm - half);
    let tool_box = Obb::of_tool(&tool.grid_box(), bone_from_tool, 0.0);
    bone_box.overlaps(&tool_box).then(|| {
        // each corner taken to the nearest point of the bone's box, and their box: along the bone's
        // own axes that is the corners' box, clamped
        let (lo, hi) = tool_box.aabb();
        [lo, hi].map(|p| (p / grid.spacing_mm + 0.5).clamp(DVec3::ZERO, dims))
    })
}

/// The voxels whose centres can lie in the overlap, one more on every side.
pub(super) fn region(grid: &Grid, [lo, hi]: [DVec3; 2]) -> Region {
    let (lo, hi) = (lo.to_array(), hi.to_array());
    Region {
        lo: lo.map(|c| (c as usize).saturating_sub(1)),
        hi: core::array::from_fn(|a| (hi[a] as usize + 2).min(grid.dims[a])),
    }
}

/// Whether a position is in a grid of so many cells; false for a NaN.
#[inline]
#[expect(
    clippy::needless_bitwise_bool,
    reason = "six comparisons and one branch are faster here than six branches"
)]
pub(super) fn inside([x, y, z]: [f32; 3], limit: [f32; 3]) -> bool {
    (x >= 0.0) & (y >= 0.0) & (z >= 0.0) & (x < limit[0]) & (y < limit[1]) & (z < limit[2])
}

/// The bone's voxels as tool cells: the centre of voxel (i, j, k) lies in the cell whose coordinates
/// are the whole part of `origin + k·step[2] + j·step[1] + i·step[0]`, summed from the left.
///
/// Every method uses this order and no fused operation, so that all of them take the same cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cells {
    /// Voxel (0, 0, 0), cells from the grid's lowest corner.
    pub(super) origin: [f32; 3],
    /// From voxel to voxel along x, y, z, cells.
    pub(super) step: [[f32; 3]; 3],
    /// The grid's dimensions, cells.
    pub(super) dims: [usize; 3],
}

impl Cells {
    pub(super) fn new(grid: &Grid, tool: &VoxelTool, bone_from_tool: &Pose) -> Self {
        let tool_from_bone = bone_from_tool.inverse();
        let axes = DMat3::from_quat(tool_from_bone.rotation);
        let cells = |v: DVec3| (v / tool.size_mm()).as_vec3().to_array();
        let h = grid.spacing_mm;
        Self {
            origin: cells(tool_from_bone.translation - tool.grid_box().lo),
            step: [
                cells(axes.x_axis * h.x),
                cells(axes.y_axis * h.y),
                cells(axes.z_axis * h.z),
            ],
            dims: tool.dims(),
        }
    }

    /// The part of the sum that a row of voxels along x has in common.
    #[inline]
    pub(super) fn row(&self, y: usize, z: usize) -> [f32; 3] {
        let (y, z) = (y as f32, z as f32);
        core::array::from_fn(|a| self.origin[a] + z * self.step[2][a] + y * self.step[1][a])
    }

    /// The row's own part for voxel `x`.
    #[inline]
    pub(super) fn along(&self, x: usize) -> [f32; 3] {
        let x = x as f32;
        self.step[0].map(|s| x * s)
    }

    /// Index of the cell at a position in cells; `None` outside the grid.
    #[inline]
    pub(super) fn index(&self, [x, y, z]: [f32; 3]) -> Option<usize> {
        let [dx, dy, dz] = self.dims;
        let inside = inside([x, y, z], [dx as f32, dy as f32, dz as f32]);
        // not negative and below 2^24 here: the cast cuts the fraction off
        inside.then(|| (z as i32 as usize * dy + y as i32 as usize) * dx + x as i32 as usize)
    }
}

/// The bone's voxels in the tool frame, for the exact signed distance: f64 up to the last step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exact {
    origin: DVec3,
    step: [DVec3; 3],
}

impl Exact {
    pub(super) fn new(grid: &Grid, bone_from_tool: &Pose) -> Self {
        let tool_from_bone = bone_from_tool.inverse();
        let axes = DMat3::from_quat(tool_from_bone.rotation);
        let h = grid.spacing_mm;
        Self {
            origin: tool_from_bone.translation,
            step: [axes.x_axis * h.x, axes.y_axis * h.y, axes.z_axis * h.z],
        }
    }

    /// Tool-frame position, mm, of a point given in voxels (whole numbers are centres).
    #[inline]
    pub(super) fn point(&self, [x, y, z]: [f64; 3]) -> Vec3 {
        (self.origin + z * self.step[2] + y * self.step[1] + x * self.step[0]).as_vec3()
    }

    /// The same for a voxel's centre.
    #[inline]
    pub(super) fn centre(&self, voxel: [usize; 3]) -> Vec3 {
        self.point(voxel.map(|v| v as f64))
    }
}
