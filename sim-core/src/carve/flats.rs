//! A brick's voxels, a layer of 4×4 at a time: what the layers of a brick have in common is computed
//! once for each of the four places that a line has in a layer.
//!
//! Most bricks see one face, so a ball alone and a cone alone have code without loops over faces; the
//! values are the same bits as those of the general code.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::bounds::{Deciding, Extent, of_ball};
use super::node::{Node, NodeFace, Points, Square, root};
use super::placed::{Kind, MAX_FLAT};
use crate::grid::LINES_PER_BRICK;
use crate::lanes::Lanes;

/// What the voxels of a brick have in common on a vector unit.
pub(super) struct Voxels<F> {
    /// A layer of 4×4 voxels at each of the four places of a line, from the brick's first voxel.
    pub layers: [Points<F>; 4],
    /// Spacing along z, units.
    pub rise: f32,
}

impl<F> Voxels<F> {
    /// Place of a line in its layers, and the heights of its two layers above the brick's first voxel.
    #[inline(always)]
    fn at(&self, line: usize) -> (usize, [f32; 2]) {
        let z = 2 * (line >> 2);
        (line & 3, [self.rise * z as f32, self.rise * (z + 1) as f32])
    }
}

/// The tool's distance in one brick. All of it must be inlined into the job.
pub(super) trait Field<L: Lanes> {
    /// Gets ready for the lines in `near`.
    fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, near: u16);
    /// Signed distances on the two layers of line `line`.
    fn pair(&self, l: L, voxels: &Voxels<L::F>, line: usize) -> [L::F; 2];
}

/// A ball alone.
pub(super) struct OneBall<F> {
    square: Square,
    radius: f32,
    flat: [F; 4],
}

impl<F: Copy> OneBall<F> {
    /// Bounds over the brick's 16 lines about the points `p`.
    #[inline(always)]
    pub(super) fn bounds<L: Lanes<F = F>>(&self, l: L, p: &Points<F>, extent: &Extent) -> [F; 2] {
        of_ball(l, (&self.square, self.radius), p, extent)
    }

    /// The ball `face` of a chunk's node in the brick whose first voxel lies at `o` there.
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L, face: &NodeFace, o: [f32; 3]) -> Self {
        Self {
            square: face.square.moved(o),
            radius: face.c,
            flat: [l.splat(0.0); 4],
        }
    }
}

impl<L: Lanes> Field<L> for OneBall<L::F> {
    #[inline(always)]
    fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, _: u16) {
        for place in 0..4 {
            self.flat[place] = self.square.flat(l, &voxels.layers[place]);
        }
    }

    #[inline(always)]
    fn pair(&self, l: L, voxels: &Voxels<L::F>, line: usize) -> [L::F; 2] {
        let (place, heights) = voxels.at(line);
        let flat = self.flat[place];
        let q0 = l.add(flat, l.splat(self.square.rise(heights[0])));
        let q1 = l.add(flat, l.splat(self.square.rise(heights[1])));
        let radius = l.splat(self.radius);
        [l.sub(root(l, q0), radius), l.sub(root(l, q1), radius)]
    }
}

/// A cone or cylinder alone.
pub(super) struct OneCone<'a, F> {
    node: &'a Node,
    flat: [[F; 2]; 4],
}

impl<'a, F: Copy> OneCone<'a, F> {
    /// The only face of `node`.
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L, node: &'a Node) -> Self {
        Self {
            node,
            flat: [[l.splat(0.0); 2]; 4],
        }
    }
}

impl<L: Lanes> Field<L> for OneCone<'_, L::F> {
    #[inline(always)]
    fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, _: u16) {
        for place in 0..4 {
            self.flat[place] = self.node.flat(l, &voxels.layers[place]);
        }
    }

    #[inline(always)]
    fn pair(&self, l: L, voxels: &Voxels<L::F>, line: usize) -> [L::F; 2] {
        let (place, heights) = voxels.at(line);
        let face = &self.node.faces[0];
        let rz0 = self.node.rise(l, self.flat[place], heights[0]);
        let rz1 = self.node.rise(l, self.flat[place], heights[1]);
        [face.cone(l, rz0), face.cone(l, rz1)]
    }
}

/// Any faces, one after the other over all lines that they can decide.
pub(super) struct Many<'a, L: Lanes> {
    node: &'a Node,
    faces: u32,
    deciding: &'a Deciding,
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
    /// The faces of `node`, which are `faces` of the tool, and the lines that each of these can decide.
    #[inline(always)]
    pub(super) fn new(
        node: &'a Node,
        faces: u32,
        deciding: &'a Deciding,
        room: &'a mut Room<L::F>,
    ) -> Self {
        Self {
            node,
            faces,
            deciding,
            room,
        }
    }

    /// Takes a face into the part's distances; lines not yet `seen` have none.
    #[inline(always)]
    fn face(&mut self, l: L, voxels: &Voxels<L::F>, n: usize, (lines, seen): (u16, u16)) {
        let face = &self.node.faces[n % MAX_FLAT];
        let mut fresh = lines & !seen;
        while fresh != 0 {
            let line = fresh.trailing_zeros() as usize % LINES_PER_BRICK;
            fresh &= fresh - 1;
            self.room.part[line] = of_face(l, (self.node, face), voxels, line);
        }
        let mut again = lines & seen;
        while again != 0 {
            let line = again.trailing_zeros() as usize % LINES_PER_BRICK;
            again &= again - 1;
            let d = of_face(l, (self.node, face), voxels, line);
            let part = &mut self.room.part[line];
            *part = [l.max(part[0], d[0]), l.max(part[1], d[1])];
        }
    }

    /// Takes the part's distances into the tool's; lines not yet `seen` have none.
    #[inline(always)]
    fn part(&mut self, l: L, mut lines: u16, seen: u16) {
        while lines != 0 {
            let line = lines.trailing_zeros() as usize % LINES_PER_BRICK;
            lines &= lines - 1;
            let d = self.room.part[line];
            let tool = &mut self.room.tool[line];
            *tool = if seen >> line & 1 == 0 {
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
    if face.kind == Kind::Ball {
        let flat = face.square.flat(l, points);
        let q0 = l.add(flat, l.splat(face.square.rise(heights[0])));
        let q1 = l.add(flat, l.splat(face.square.rise(heights[1])));
        let radius = l.splat(face.c);
        return [l.sub(root(l, q0), radius), l.sub(root(l, q1), radius)];
    }
    let flat = node.flat(l, points);
    let (rz0, rz1) = (
        node.rise(l, flat, heights[0]),
        node.rise(l, flat, heights[1]),
    );
    [face.distance(l, rz0, rz0.1), face.distance(l, rz1, rz1.1)]
}

impl<L: Lanes> Field<L> for Many<'_, L> {
    #[inline(always)]
    fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, near: u16) {
        let (mut of_part, mut of_tool) = (0, 0);
        let mut faces = self.faces;
        for n in 0..self.node.count.min(MAX_FLAT) {
            let lines = near & self.deciding[faces.trailing_zeros() as usize % MAX_FLAT];
            faces &= faces.wrapping_sub(1);
            self.face(l, voxels, n, (lines, of_part));
            of_part |= lines;
            if self.node.ends_part(n) {
                self.part(l, of_part, of_tool);
                of_tool |= of_part;
                of_part = 0;
            }
        }
    }

    #[inline(always)]
    fn pair(&self, _: L, _: &Voxels<L::F>, line: usize) -> [L::F; 2] {
        self.room.tool[line % LINES_PER_BRICK]
    }
}
