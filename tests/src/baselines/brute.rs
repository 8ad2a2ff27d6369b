//! The best that a binary method can do: each voxel's centre against the exact tool.

use super::dense::Dense;
use super::place::{Exact, overlap, region};
use super::{Baseline, VoxelTool};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;

/// Every voxel of the overlap box by the exact signed distance: a reference, not a rival.
#[derive(Debug, Clone)]
pub struct Brute<'a> {
    tool: &'a VoxelTool,
    bone: Dense<'a>,
}

impl<'a> Brute<'a> {
    /// The bone in one buffer, the tool by its signed distance.
    pub fn new(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self {
            tool,
            bone: Dense::new(bone),
        }
    }
}

impl Baseline for Brute<'_> {
    fn name(&self) -> &'static str {
        "brute"
    }

    fn theirs(&self) -> &'static str {
        "Nobody's: the reference"
    }

    fn inferred(&self) -> &'static str {
        "Nothing: a voxel is removed where its centre lies inside the exact tool"
    }

    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let grid = *self.bone.bone.grid();
        let Some(overlap) = overlap(&grid, self.tool, bone_from_tool) else {
            return 0;
        };
        let region = region(&grid, overlap);
        self.bone.touch(region);
        let exact = Exact::new(&grid, bone_from_tool);
        let mut removed = 0;
        for voxel in region.voxels() {
            let [i, j, k] = voxel;
            let value = &mut self.bone.values[grid.dense_index(i, j, k)];
            if *value != 0 && self.tool.distance(exact.centre(voxel)) < 0.0 {
                *value = 0;
                removed += 1;
            }
        }
        removed
    }

    fn restore(&mut self) {
        self.bone.restore();
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        self.bone.is_removed(voxel)
    }

    fn bytes(&self) -> usize {
        self.bone.bytes()
    }
}
