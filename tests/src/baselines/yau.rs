//! Adaptive octree against an implicit tool (Yau et al. 2005).
#![expect(
    clippy::cast_possible_truncation,
    reason = "fewer than 2^32 nodes; f64 becomes f32 inside a tool"
)]

use super::octree::root_edge;
use super::place::{Exact, active, overlap};
use super::{Baseline, VoxelTool};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::CHUNK;
use osteon_sim_core::pose::Pose;

/// A node without any voxel of the bone.
const EMPTY: u32 = u32::MAX;
/// A node that is bone throughout.
const FULL: u32 = u32::MAX - 1;
/// Edge of the smallest node, voxels: its link is a mask of eight voxels.
const LEAF: usize = 2;

/// The bone in an octree whose uniform nodes are not divided, cut by the tool's signed distance.
#[derive(Debug, Clone)]
pub struct Yau<'a> {
    bone: &'a Bone,
    tool: &'a VoxelTool,
    edge: usize,
    root: u32,
    groups: Vec<[u32; 8]>,
    first: (u32, Vec<[u32; 8]>),
}

/// One event's way from voxels to the tool.
struct Walk {
    exact: Exact,
    // half a voxel's diagonal, mm
    half_diagonal: f32,
}

impl<'a> Yau<'a> {
    /// Builds the tree, with room for every node that an event can divide.
    pub fn new(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        let mut tree = Self {
            bone,
            tool,
            edge: root_edge(bone),
            root: EMPTY,
            groups: Vec::new(),
            first: (EMPTY, Vec::new()),
        };
        let mut most = 0;
        tree.root = tree.build([0; 3], tree.edge, &mut most);
        tree.first = (tree.root, tree.groups.clone());
        tree.groups
            .reserve_exact(most.max(tree.groups.len()) - tree.groups.len());
        tree
    }

    // `most` counts the groups of a tree that is divided wherever there is bone
    fn build(&mut self, origin: [usize; 3], edge: usize, most: &mut usize) -> u32 {
        if edge == CHUNK && self.bone.chunk_at(origin.map(|v| v / CHUNK)).is_none() {
            return EMPTY;
        }
        if edge == LEAF {
            let mask = (0..8)
                .map(|n| u32::from(active(self.bone, child_origin(origin, 1, n))) << n)
                .sum();
            return if mask == 0 { EMPTY } else { mask };
        }
        let half = edge / 2;
        let children: [u32; 8] =
            core::array::from_fn(|n| self.build(child_origin(origin, half, n), half, most));
        if children == [EMPTY; 8] {
            return EMPTY;
        }
        *most += 1;
        if children == [full(half); 8] {
            return FULL;
        }
        self.groups.push(children);
        self.groups.len() as u32 - 1
    }

    // the node's new link, the voxels removed
    fn visit(&mut self, link: u32, origin: [usize; 3], edge: usize, walk: &Walk) -> (u32, u64) {
        let middle = self.middle(origin, edge, walk);
        if middle > walk.half_diagonal * edge as f32 {
            return (link, 0);
        }
        // a convex tool that holds all vertices holds the middle
        if middle < 0.0 && self.holds_vertices(origin, edge, walk) {
            return (EMPTY, self.count(link, edge));
        }
        let half = edge / 2;
        let group = if link == FULL {
            self.groups.push([full(half); 8]);
            self.groups.len() - 1
        } else {
            link as usize
        };
        let removed = if half == LEAF {
            self.leaves(group, origin, walk)
        } else {
            self.children(group, origin, half, walk)
        };
        if self.groups[group] == [EMPTY; 8] {
            (EMPTY, removed)
        } else {
            (group as u32, removed)
        }
    }

    fn children(&mut self, group: usize, origin: [usize; 3], half: usize, walk: &Walk) -> u64 {
        let mut removed = 0;
        for n in 0..8 {
            let child = self.groups[group][n];
            if child != EMPTY {
                let (link, cut) = self.visit(child, child_origin(origin, half, n), half, walk);
                self.groups[group][n] = link;
                removed += cut;
            }
        }
        removed
    }

    fn holds_vertices(&self, origin: [usize; 3], edge: usize, walk: &Walk) -> bool {
        (0..8).all(|n| {
            let p = child_origin(origin, edge, n).map(|v| v as f64 - 0.5);
            self.tool.distance(walk.exact.point(p)) < 0.0
        })
    }

    // the tool's distance at a node's middle, mm
    fn middle(&self, origin: [usize; 3], edge: usize, walk: &Walk) -> f32 {
        let p = origin.map(|v| v as f64 + 0.5 * (edge as f64 - 1.0));
        self.tool.distance(walk.exact.point(p))
    }

    fn leaves(&mut self, group: usize, origin: [usize; 3], walk: &Walk) -> u64 {
        let reach = walk.half_diagonal * LEAF as f32;
        let mut removed = 0;
        for n in 0..8 {
            let mask = self.groups[group][n];
            if mask == EMPTY {
                continue;
            }
            let origin = child_origin(origin, LEAF, n);
            let middle = self.middle(origin, LEAF, walk);
            if middle > reach {
                continue;
            }
            let left = if middle < -reach {
                0
            } else {
                self.leaf(mask, origin, walk)
            };
            self.groups[group][n] = if left == 0 { EMPTY } else { left };
            removed += u64::from((mask ^ left).count_ones());
        }
        removed
    }

    // the voxels of a leaf that are left
    fn leaf(&self, mask: u32, origin: [usize; 3], walk: &Walk) -> u32 {
        let mut left = mask;
        for n in 0..8 {
            let centre = || walk.exact.centre(child_origin(origin, 1, n));
            if mask >> n & 1 != 0 && self.tool.distance(centre()) < 0.0 {
                left &= !(1 << n);
            }
        }
        left
    }

    fn count(&self, link: u32, edge: usize) -> u64 {
        match link {
            EMPTY => 0,
            FULL => (edge * edge * edge) as u64,
            mask if edge == LEAF => mask.count_ones().into(),
            group => self.groups[group as usize]
                .iter()
                .map(|&child| self.count(child, edge / 2))
                .sum(),
        }
    }

    fn is_bone(&self, voxel: [usize; 3]) -> bool {
        let (mut link, mut edge) = (self.root, self.edge);
        while link != EMPTY && link != FULL {
            edge /= 2;
            let n: usize = (0..3).map(|a| usize::from(voxel[a] & edge != 0) << a).sum();
            if edge == 1 {
                return link >> n & 1 != 0;
            }
            link = self.groups[link as usize][n];
        }
        link == FULL
    }
}

/// Link of a node of this edge that is bone throughout.
fn full(edge: usize) -> u32 {
    if edge == LEAF { 0xff } else { FULL }
}

fn child_origin(origin: [usize; 3], edge: usize, n: usize) -> [usize; 3] {
    core::array::from_fn(|a| origin[a] + (n >> a & 1) * edge)
}

impl Baseline for Yau<'_> {
    fn name(&self) -> &'static str {
        "yau"
    }

    fn theirs(&self) -> &'static str {
        "Yau, Tsou, Tong 2005, by published excerpts of it and of its sequel (2009): the workpiece is an \
         octree, divided where it is needed; the cutter is an implicit function, and the signs at a \
         node's vertices say whether it is inside (removed), outside (kept) or cut (divided)"
    }

    fn inferred(&self) -> &'static str {
        "The thesis counts it among the single-buffer methods; built by its own text instead. At the finest \
         level (one voxel) the centre decides; `outside` needs a middle farther from the tool than half the \
         node's diagonal, or thin tips are lost between the vertices; `inside` by the vertices is right \
         for a convex tool; occupancy only, one density for all; nodes are not merged again but where \
         they are emptied; one pose an event, where theirs may sweep"
    }

    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let grid = *self.bone.grid();
        let apart = overlap(&grid, self.tool, bone_from_tool).is_none();
        if apart || self.root == EMPTY {
            return 0;
        }
        let walk = Walk {
            exact: Exact::new(&grid, bone_from_tool),
            half_diagonal: (0.5 * grid.band_mm()) as f32 + 1e-4,
        };
        let (root, removed) = self.visit(self.root, [0; 3], self.edge, &walk);
        self.root = root;
        removed
    }

    fn restore(&mut self) {
        let (root, groups) = &self.first;
        self.root = *root;
        self.groups.truncate(groups.len());
        self.groups.copy_from_slice(groups);
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        active(self.bone, voxel) && !self.is_bone(voxel)
    }

    fn bytes(&self) -> usize {
        size_of_val(self.groups.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use osteon_sim_core::bone::DenseBone;
    use osteon_sim_core::grid::Grid;
    use osteon_sim_core::tool::Tool;

    #[test]
    fn dividing_nodes_needs_no_more_room_than_was_made() {
        let grid = Grid::new([96; 3], DVec3::splat(0.5)).expect("a grid");
        let n = grid.len();
        let dense = DenseBone {
            density_hu: &vec![300; n],
            solid_mm: &vec![1.0; n],
            class: &vec![0; n],
            label: &vec![0; n],
        };
        let bone = Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone");
        let shape = Tool::peg_drill().shape;
        let tool = VoxelTool::of_shape(0.5, shape).expect("a tool");
        let mut yau = Yau::new(&bone, &tool);
        let (room, small) = (yau.groups.capacity(), yau.bytes());
        for step in 0..120u8 {
            let t = f64::from(step);
            let at = DVec3::new(0.7 * t % 48.0, 1.9 * t % 48.0, 48.0 - 1.1 * t % 48.0);
            yau.event(&Pose::new(DQuat::from_rotation_x(0.1 * t), at));
        }
        assert!(yau.bytes() > 10 * small, "{} of {small}", yau.bytes());
        assert_eq!(yau.groups.capacity(), room);
    }
}
