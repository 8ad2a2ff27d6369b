//! Tool to bone: a sparse list of the tool's voxels into one dense buffer (Faieghi et al.).
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the tool's layers before the cast"
)]

use super::dense::{Dense, Voxels, centres};
use super::place::{overlap, region};
use super::{Baseline, VoxelTool};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;

/// A list of tool voxels that is gone through against a dense bone.
#[derive(Debug, Clone)]
pub struct Reza<'a> {
    name: &'static str,
    tool: &'a VoxelTool,
    bone: Dense<'a>,
    points: Vec<[f32; 3]>,
    // where each layer of the tool's grid begins in the list
    layers: Vec<usize>,
}

impl<'a> Reza<'a> {
    /// The list of surface voxels, as published: `reza`.
    pub fn surface(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self::new("reza", tool.surface(), bone, tool)
    }

    /// The list of all solid voxels, which is not theirs: `reza-solid`.
    pub fn solid(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self::new("reza-solid", tool.solid(), bone, tool)
    }

    fn new(name: &'static str, list: &[[u16; 3]], bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        let layers = (0..=tool.dims()[2])
            .map(|layer| list.partition_point(|c| usize::from(c[2]) < layer))
            .collect();
        Self {
            name,
            tool,
            bone: Dense::new(bone),
            points: centres(list),
            layers,
        }
    }

    // the tool's layers that the overlap box can touch
    fn layers_within(&self, [lo, hi]: [DVec3; 2], bone_from_tool: &Pose) -> [usize; 2] {
        let tool_from_bone = bone_from_tool.inverse();
        let spacing = self.bone.bone.grid().spacing_mm;
        let (mut first, mut last) = (f64::MAX, f64::MIN);
        for corner in 0..8u8 {
            let pick = |bit: u8, a: usize| if corner & bit == 0 { lo[a] } else { hi[a] };
            let p = DVec3::new(pick(1, 0), pick(2, 1), pick(4, 2));
            let in_tool = tool_from_bone.point((p - 0.5) * spacing) - self.tool.grid_box().lo;
            let layer = in_tool.z / self.tool.size_mm();
            first = first.min(layer);
            last = last.max(layer);
        }
        let top = self.tool.dims()[2];
        [
            (first - 1.0).clamp(0.0, top as f64) as usize,
            (last + 2.0).clamp(0.0, top as f64) as usize,
        ]
    }
}

impl Baseline for Reza<'_> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn theirs(&self) -> &'static str {
        "Faieghi, Tutunea-Fatan, Eagleson 2020 (abstract and highlights) and the thesis's account of [114]: \
         voxmap and point shell; the bone is one contiguous array with an invertible 3D to 1D mapping, \
         the tool a sparse list of points; each point is taken into the bone's voxels, the voxel there \
         is removed; a quick estimate of the overlap culls points early. By the thesis the list holds \
         the tool's surface only"
    }

    fn inferred(&self) -> &'static str {
        "The points are centres of the surface voxels of Alg. 2.1 (six-neighbour rule), taken to the nearest \
         voxel; the estimate is the thesis's overlap box, and it culls whole layers of the tool; one CPU \
         core. The form `reza-solid` (all solid voxels) is not theirs. Either leaves a comb of voxels \
         that no point falls into; the surface list also leaves the inside of a tool that stands still"
    }

    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let grid = *self.bone.bone.grid();
        let Some(overlap) = overlap(&grid, self.tool, bone_from_tool) else {
            return 0;
        };
        self.bone.touch(region(&grid, overlap));
        let [first, last] = self.layers_within(overlap, bone_from_tool);
        let points = &self.points[self.layers[first]..self.layers[last]];
        let voxels = Voxels::new(&grid, self.tool, bone_from_tool);
        self.bone.clear(points, &voxels)
    }

    fn restore(&mut self) {
        self.bone.restore();
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        self.bone.is_removed(voxel)
    }

    fn bytes(&self) -> usize {
        self.bone.bytes() + size_of_val(self.points.as_slice())
    }
}
