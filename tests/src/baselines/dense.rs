//! The whole lattice in one dense buffer, as the single-buffer methods keep the bone, and the way
//! from a tool's voxels into it.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checked against the lattice before the cast; f64 becomes f32 inside a tool"
)]

use super::VoxelTool;
use super::place::{Region, active, density, inside};
use glam::{DMat3, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;

/// Densities of a whole lattice, x fastest; 0 = inactive or removed.
#[derive(Debug, Clone)]
pub(super) struct Dense<'a> {
    pub(super) bone: &'a Bone,
    pub(super) values: Vec<i16>,
    // what events since the last restore may have changed
    touched: Region,
}

impl<'a> Dense<'a> {
    pub(super) fn new(bone: &'a Bone) -> Self {
        let whole = Region {
            lo: [0; 3],
            hi: bone.grid().dims,
        };
        Self {
            bone,
            values: whole.voxels().map(|v| density(bone, v)).collect(),
            touched: Region::NONE,
        }
    }

    /// Says that the voxels of `region` may change.
    pub(super) fn touch(&mut self, region: Region) {
        self.touched = self.touched.with(region);
    }

    pub(super) fn restore(&mut self) {
        for voxel in core::mem::replace(&mut self.touched, Region::NONE).voxels() {
            let [i, j, k] = voxel;
            self.values[self.bone.grid().dense_index(i, j, k)] = density(self.bone, voxel);
        }
    }

    pub(super) fn is_removed(&self, voxel: [usize; 3]) -> bool {
        let [i, j, k] = voxel;
        active(self.bone, voxel) && self.values[self.bone.grid().dense_index(i, j, k)] == 0
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }

    /// Takes each tool voxel to the voxel that it lies in and clears that where it is active.
    /// Returns how many were.
    pub(super) fn clear(&mut self, points: &[[f32; 3]], voxels: &Voxels) -> u64 {
        let [nx, ny, nz] = self.bone.grid().dims;
        let limit = [nx, ny, nz].map(|n| n as f32);
        let mut removed = 0;
        for point in points {
            let [x, y, z] = voxels.of(*point);
            if inside([x, y, z], limit) {
                let at = (z as i32 as usize * ny + y as i32 as usize) * nx + x as i32 as usize;
                let value = &mut self.values[at];
                removed += u64::from(*value != 0);
                *value = 0;
            }
        }
        removed
    }
}

/// Tool cells (whole numbers are cells' corners) as voxels of the bone, half a voxel on, so that the
/// whole part is the voxel whose centre is nearest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Voxels {
    origin: [f32; 3],
    step: [[f32; 3]; 3],
}

impl Voxels {
    pub(super) fn new(grid: &Grid, tool: &VoxelTool, bone_from_tool: &Pose) -> Self {
        let axes = DMat3::from_quat(bone_from_tool.rotation);
        let voxels = |v: DVec3| (v / grid.spacing_mm).as_vec3().to_array();
        let lo = bone_from_tool.point(tool.grid_box().lo) + 0.5 * grid.spacing_mm;
        Self {
            origin: voxels(lo),
            step: [axes.x_axis, axes.y_axis, axes.z_axis].map(|a| voxels(a * tool.size_mm())),
        }
    }

    #[inline]
    fn of(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        core::array::from_fn(|a| {
            self.origin[a] + x * self.step[0][a] + y * self.step[1][a] + z * self.step[2][a]
        })
    }
}

/// Centres of a list of tool cells, in cells.
pub(super) fn centres(cells: &[[u16; 3]]) -> Vec<[f32; 3]> {
    cells
        .iter()
        .map(|c| c.map(|n| f32::from(n) + 0.5))
        .collect()
}
