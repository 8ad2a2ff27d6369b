//! Tool to bone without culling (Zheng et al. 2012, as far as is known).

use super::dense::{Dense, Voxels, centres};
use super::place::{overlap, region};
use super::{Baseline, VoxelTool};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;

/// Every voxel of the tool's surface against a dense bone, in each event.
#[derive(Debug, Clone)]
pub struct Zheng<'a> {
    tool: &'a VoxelTool,
    bone: Dense<'a>,
    points: Vec<[f32; 3]>,
}

impl<'a> Zheng<'a> {
    /// The bone in one buffer, the tool's surface voxels in another.
    pub fn new(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self {
            tool,
            bone: Dense::new(bone),
            points: centres(tool.surface()),
        }
    }
}

impl Baseline for Zheng<'_> {
    fn name(&self) -> &'static str {
        "zheng"
    }

    fn theirs(&self) -> &'static str {
        "The thesis's account of [75]: the tool's voxels in one sparse buffer, of its surface only, gone \
         through one by one; the bone in a single buffer over its bounds. Zheng et al. 2012 (abstract): \
         voxels of inhomogeneous tissue from patient data, an analytical force of drilling, all of it \
         parallel on a GPU"
    }

    fn inferred(&self) -> &'static str {
        "Nearly all: how their voxels are removed is not in the text at hand. Built as the thesis puts it: \
         all surface voxels of Alg. 2.1 each time, nearest voxel, no culling within the tool; one CPU \
         core, no force. So it removes the same voxels as `reza` and differs in time alone"
    }

    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let grid = *self.bone.bone.grid();
        let Some(overlap) = overlap(&grid, self.tool, bone_from_tool) else {
            return 0;
        };
        self.bone.touch(region(&grid, overlap));
        let voxels = Voxels::new(&grid, self.tool, bone_from_tool);
        self.bone.clear(&self.points, &voxels)
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
