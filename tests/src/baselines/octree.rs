//! The thesis's removal on an octree instead of chunks: the alternative of its ch. 3.2.5.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the tool's grid before the cast; fewer than 2^32 nodes and voxels"
)]

use super::place::{Cells, active, density, overlap};
use super::{Baseline, VoxelTool};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::CHUNK;
use osteon_sim_core::pose::Pose;

/// No voxel of the bone in there.
const EMPTY: u32 = u32::MAX;
/// Edge of a leaf, voxels.
const LEAF: usize = 2;
/// Room for rounding when a node is taken to tool cells, cells.
const SLACK: f32 = 0.01;

/// One of eight children: where it lies and how many active voxels it has.
#[derive(Debug, Clone, Copy)]
struct Child {
    // index of a group of eight, or of a leaf
    link: u32,
    count: u32,
}

/// The bone in an octree of densities with leaves of 2³, cut by a voxelised tool.
#[derive(Debug, Clone)]
pub struct Octree<'a> {
    bone: &'a Bone,
    tool: &'a VoxelTool,
    edge: usize,
    root: Child,
    groups: Vec<[Child; 8]>,
    leaves: Vec<[i16; 8]>,
    first: (Child, Vec<[Child; 8]>, Vec<[i16; 8]>),
    // solid cells below and before each corner of the tool's grid
    sums: Vec<u32>,
}

/// Lowest voxel of child `n` of a node of twice the edge.
fn child_origin(origin: [usize; 3], edge: usize, n: usize) -> [usize; 3] {
    core::array::from_fn(|a| origin[a] + (n >> a & 1) * edge)
}

/// Edge of the smallest octree over the lattice, voxels.
pub(super) fn root_edge(bone: &Bone) -> usize {
    let longest = bone.grid().dims.into_iter().max().unwrap_or(CHUNK);
    longest.next_power_of_two().max(CHUNK)
}

impl<'a> Octree<'a> {
    /// Builds the tree and the tool's table of sums.
    pub fn new(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        let none = Child {
            link: EMPTY,
            count: 0,
        };
        let mut tree = Self {
            bone,
            tool,
            edge: root_edge(bone),
            root: none,
            groups: Vec::new(),
            leaves: Vec::new(),
            first: (none, Vec::new(), Vec::new()),
            sums: sums(tool),
        };
        tree.root = tree.build([0; 3], tree.edge);
        tree.first = (tree.root, tree.groups.clone(), tree.leaves.clone());
        tree
    }

    fn build(&mut self, origin: [usize; 3], edge: usize) -> Child {
        let none = Child {
            link: EMPTY,
            count: 0,
        };
        if edge == CHUNK && self.bone.chunk_at(origin.map(|v| v / CHUNK)).is_none() {
            return none;
        }
        let dims = self.bone.grid().dims;
        if edge == LEAF {
            let leaf: [i16; 8] = core::array::from_fn(|n| {
                let voxel = child_origin(origin, 1, n);
                let there = (0..3).all(|a| voxel[a] < dims[a]);
                if there { density(self.bone, voxel) } else { 0 }
            });
            let count = leaf.iter().map(|&d| u32::from(d != 0)).sum();
            if count == 0 {
                return none;
            }
            self.leaves.push(leaf);
            let link = self.leaves.len() as u32 - 1;
            return Child { link, count };
        }
        let half = edge / 2;
        let children = core::array::from_fn(|n| self.build(child_origin(origin, half, n), half));
        let count = children.iter().map(|c: &Child| c.count).sum();
        if count == 0 {
            return none;
        }
        self.groups.push(children);
        let link = self.groups.len() as u32 - 1;
        Child { link, count }
    }

    // the node's active voxels that are cut; it is not wholly in or out
    fn descend(&mut self, link: u32, origin: [usize; 3], edge: usize, cells: &Cells) -> u32 {
        if edge == LEAF {
            return self.leaf(link as usize, origin, cells);
        }
        let half = edge / 2;
        let mut removed = 0;
        for n in 0..8 {
            let child = self.groups[link as usize][n];
            if child.link == EMPTY {
                continue;
            }
            let origin = child_origin(origin, half, n);
            let cut = match self.side(origin, half, cells) {
                Side::Outside => continue,
                Side::Inside => child.count,
                Side::Both => self.descend(child.link, origin, half, cells),
            };
            removed += cut;
            let child = &mut self.groups[link as usize][n];
            child.count -= cut;
            if child.count == 0 {
                child.link = EMPTY;
            }
        }
        removed
    }

    fn leaf(&mut self, leaf: usize, origin: [usize; 3], cells: &Cells) -> u32 {
        let mut removed = 0;
        for (n, value) in self.leaves[leaf].iter_mut().enumerate() {
            if *value == 0 {
                continue;
            }
            let [x, y, z] = child_origin(origin, 1, n);
            let (row, along) = (cells.row(y, z), cells.along(x));
            let cell = cells.index(core::array::from_fn(|a| row[a] + along[a]));
            if cell.is_some_and(|cell| self.tool.cells()[cell] != 0) {
                *value = 0;
                removed += 1;
            }
        }
        removed
    }

    // where a node's voxels lie, by the number of solid cells in the box around them
    fn side(&self, origin: [usize; 3], edge: usize, cells: &Cells) -> Side {
        if edge == LEAF {
            // eight look-ups decide it just as fast
            return Side::Both;
        }
        let reach = 0.5 * (edge as f32 - 1.0);
        let (mut lo, mut hi) = ([0; 3], [0; 3]);
        for a in 0..3 {
            let step = [cells.step[0][a], cells.step[1][a], cells.step[2][a]];
            let middle = cells.origin[a]
                + step[0] * (origin[0] as f32 + reach)
                + step[1] * (origin[1] as f32 + reach)
                + step[2] * (origin[2] as f32 + reach);
            let half = reach * (step[0].abs() + step[1].abs() + step[2].abs()) + SLACK;
            let (from, to, top) = (middle - half, middle + half, cells.dims[a] as f32);
            if !(to >= 0.0 && from < top) {
                return Side::Outside;
            }
            lo[a] = from.max(0.0) as usize;
            hi[a] = to.min(top - 1.0) as usize + 1;
        }
        let solid = self.solid_cells(lo, hi);
        let all = (hi[0] - lo[0]) * (hi[1] - lo[1]) * (hi[2] - lo[2]);
        if solid == 0 {
            Side::Outside
        } else if solid as usize == all {
            // it does not reach beyond the grid: the border's cells are empty
            Side::Inside
        } else {
            Side::Both
        }
    }

    fn solid_cells(&self, lo: [usize; 3], hi: [usize; 3]) -> u32 {
        let [dx, dy, _] = self.tool.dims();
        let at = |x, y, z| self.sums[(z * (dy + 1) + y) * (dx + 1) + x];
        let layer = |z| {
            at(hi[0], hi[1], z) + at(lo[0], lo[1], z) - at(lo[0], hi[1], z) - at(hi[0], lo[1], z)
        };
        layer(hi[2]) - layer(lo[2])
    }

    fn value(&self, voxel: [usize; 3]) -> i16 {
        let (mut child, mut edge) = (self.root, self.edge);
        while child.link != EMPTY {
            edge /= 2;
            let n = (0..3)
                .map(|a| usize::from(voxel[a] & edge != 0) << a)
                .sum::<usize>();
            if edge == 1 {
                return self.leaves[child.link as usize][n];
            }
            child = self.groups[child.link as usize][n];
        }
        0
    }
}

enum Side {
    Inside,
    Outside,
    Both,
}

/// Solid cells with all coordinates below (x, y, z), for every corner of the tool's grid.
fn sums(tool: &VoxelTool) -> Vec<u32> {
    let [dx, dy, dz] = tool.dims();
    let at = |x, y, z| (z * (dy + 1) + y) * (dx + 1) + x;
    let mut sums = vec![0u32; (dx + 1) * (dy + 1) * (dz + 1)];
    for z in 0..dz {
        for y in 0..dy {
            let mut row = 0;
            for x in 0..dx {
                row += u32::from(tool.cells()[(z * dy + y) * dx + x] != 0);
                sums[at(x + 1, y + 1, z + 1)] =
                    row + sums[at(x + 1, y, z + 1)] + sums[at(x + 1, y + 1, z)]
                        - sums[at(x + 1, y, z)];
            }
        }
    }
    sums
}

impl Baseline for Octree<'_> {
    fn name(&self) -> &'static str {
        "octree"
    }

    fn theirs(&self) -> &'static str {
        "The thesis, ch. 3.2.5, names the octree as the chunks' alternative and does not build it: nodes with \
         eight children or none, nodes that a collision empties are refreshed so that later events stop \
         earlier"
    }

    fn inferred(&self) -> &'static str {
        "All of the building: leaves of 2³ densities; from bone to tool, a node's box in tool cells against \
         a table of sums of the tool's solid cells, so a node wholly in or out is settled by eight reads; \
         the voxels of the others by the thesis's own look-up. Removes exactly what the chunks do"
    }

    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let apart = overlap(self.bone.grid(), self.tool, bone_from_tool).is_none();
        if apart || self.root.link == EMPTY {
            return 0;
        }
        let cells = Cells::new(self.bone.grid(), self.tool, bone_from_tool);
        let removed = self.descend(self.root.link, [0; 3], self.edge, &cells);
        self.root.count -= removed;
        if self.root.count == 0 {
            self.root.link = EMPTY;
        }
        removed.into()
    }

    fn restore(&mut self) {
        let (root, groups, leaves) = &self.first;
        self.root = *root;
        self.groups.copy_from_slice(groups);
        self.leaves.copy_from_slice(leaves);
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        active(self.bone, voxel) && self.value(voxel) == 0
    }

    fn bytes(&self) -> usize {
        size_of_val(self.groups.as_slice())
            + size_of_val(self.leaves.as_slice())
            + size_of_val(self.sums.as_slice())
            + size_of_val(self.tool.cells())
    }
}
