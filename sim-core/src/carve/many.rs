//! A brick under any faces: each goes over all lines, one after the other.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::flats::Voxels;
use super::node::{Node, NodeFace};
use super::placed::MAX_FLAT;
use crate::grid::LINES_PER_BRICK;
use crate::lanes::Lanes;

/// Any faces, one after the other over all lines.
pub(super) struct Many<'a, L: Lanes> {
    node: &'a Node,
    room: &'a mut Room<L::F>,
}

/// Distances of a brick's lines, on their two layers.
type Pairs<F> = [[F; 2]; LINES_PER_BRICK];

/// Room for a brick's distances: of the part under way, and of the tool.
pub(super) struct Room<F> {
    part: Pairs<F>,
    tool: Pairs<F>,
}

impl<F: Copy> Room<F> {
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L) -> Self {
        let none = [[l.splat(0.0); 2]; LINES_PER_BRICK];
        Self {
            part: none,
            tool: none,
        }
    }
}

impl<'a, L: Lanes> Many<'a, L> {
    /// The faces of `node`.
    #[inline(always)]
    pub(super) fn new(node: &'a Node, room: &'a mut Room<L::F>) -> Self {
        Self { node, room }
    }

    /// Takes a face into the part's distances, which have none yet if it is the `first`.
    #[inline(always)]
    fn face(&mut self, l: L, voxels: &Voxels<L::F>, n: usize, (mut lines, first): (u16, bool)) {
        let face = &self.node.faces[n % MAX_FLAT];
        while lines != 0 {
            let line = lines.trailing_zeros() as usize % LINES_PER_BRICK;
            lines &= lines - 1;
            let d = of_face(l, (self.node, face), voxels, line);
            let part = &mut self.room.part[line];
            *part = if first {
                d
            } else {
                [l.max(part[0], d[0]), l.max(part[1], d[1])]
            };
        }
    }

    /// Takes the part's distances into the tool's, which have none yet if it is the `first`.
    #[inline(always)]
    fn part(&mut self, l: L, mut lines: u16, first: bool) {
        while lines != 0 {
            let line = lines.trailing_zeros() as usize % LINES_PER_BRICK;
            lines &= lines - 1;
            let d = self.room.part[line];
            let tool = &mut self.room.tool[line];
            *tool = if first {
                d
            } else {
                [l.min(tool[0], d[0]), l.min(tool[1], d[1])]
            };
        }
    }
}

/// Signed distances to a face on the two layers of a line.
#[inline(always)]
fn of_face<L: Lanes>(
    l: L,
    (node, face): (&Node, &NodeFace),
    voxels: &Voxels<L::F>,
    line: usize,
) -> [L::F; 2] {
    let (place, heights) = voxels.at(line);
    let points = &voxels.layers[place];
    let flat = node.flat(l, points);
    let (rz0, rz1) = (
        node.rise(l, flat, heights[0]),
        node.rise(l, flat, heights[1]),
    );
    let (mut q0, mut q1) = (rz0.1, rz1.1);
    if face.kind.has_square() {
        let flat = face.square.flat(l, points);
        q0 = l.add(flat, l.splat(face.square.rise(heights[0])));
        q1 = l.add(flat, l.splat(face.square.rise(heights[1])));
    }
    [face.distance(l, rz0, q0), face.distance(l, rz1, q1)]
}

impl<L: Lanes> Many<'_, L> {
    /// Computes the lines in `near`.
    #[inline(always)]
    pub(super) fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, near: u16) {
        let (mut begins_part, mut begins_tool) = (true, true);
        for n in 0..self.node.count.min(MAX_FLAT) {
            self.face(l, voxels, n, (near, begins_part));
            begins_part = false;
            if self.node.ends_part(n) {
                self.part(l, near, begins_tool);
                begins_tool = false;
                begins_part = true;
            }
        }
    }

    /// Signed distances on the two layers of a line.
    #[inline(always)]
    pub(super) fn pair(&self, line: usize) -> [L::F; 2] {
        self.room.tool[line % LINES_PER_BRICK]
    }
}
