//! A brick's voxels, a layer of 4×4 at a time: what the layers of a brick have in common is computed
//! once for each of the four places that a line has in a layer.
//!
//! Most bricks see one face or two, so these have code without loops over faces; the values are the same
//! bits as those of the general code.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::node::{Node, NodeFace, Points, Square, root};
use super::placed::MAX_FLAT;
use crate::grid::LINES_PER_BRICK;
use crate::lanes::Lanes;

/// What the voxels of a brick have in common on a vector unit.
pub(super) struct Voxels<F> {
    /// A layer of 4×4 voxels at each of the four places of a line, from the brick's first voxel.
    pub layers: [Points<F>; 4],
    /// Spacing along z, units.
    pub rise: f32,
    /// Heights of the 8 layers above the brick's first voxel, and their squares; the rest is 0.
    pub heights: [F; 2],
}

impl<F> Voxels<F> {
    /// Place of a line in its layers, and the heights of its two layers above the brick's first voxel.
    #[inline(always)]
    fn at(&self, line: usize) -> (usize, [f32; 2]) {
        let z = 2 * (line >> 2);
        (line & 3, [self.rise * z as f32, self.rise * (z + 1) as f32])
    }
}

/// What each layer of a brick adds.
type Rises = [f32; 16];

/// The tool's distance in one brick. All of it must be inlined into the job.
pub(super) trait Field<L: Lanes> {
    /// Gets ready for the lines in `near`.
    fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, near: u16);
    /// Signed distances on the two layers of line `line`.
    fn pair(&self, l: L, voxels: &Voxels<L::F>, line: usize) -> [L::F; 2];
}

/// A face in one brick: what its layers have in common is made once for each place of a line.
pub(super) trait Sheet<L: Lanes> {
    /// Face `face` of a chunk's node in the brick whose first voxel lies at `o` there.
    fn new(l: L, chunk: &Node, face: usize, o: [f32; 3], voxels: &Voxels<L::F>) -> Self;
    /// Signed distance on layer `layer` at a place.
    fn at(&self, l: L, place: usize, layer: usize) -> L::F;
}

/// One face alone.
pub(super) struct One<A>(pub A);

/// The larger distance of two faces.
pub(super) struct Two<A, B>(pub A, pub B);

impl<L: Lanes, A: Sheet<L>> Field<L> for One<A> {
    #[inline(always)]
    fn prepare(&mut self, _: L, _: &Voxels<L::F>, _: u16) {}

    #[inline(always)]
    fn pair(&self, l: L, _: &Voxels<L::F>, line: usize) -> [L::F; 2] {
        let (place, low, high) = (line & 3, line >> 1 & 6, line >> 1 & 6 | 1);
        [self.0.at(l, place, low), self.0.at(l, place, high)]
    }
}

impl<L: Lanes, A: Sheet<L>, B: Sheet<L>> Field<L> for Two<A, B> {
    #[inline(always)]
    fn prepare(&mut self, _: L, _: &Voxels<L::F>, _: u16) {}

    #[inline(always)]
    fn pair(&self, l: L, _: &Voxels<L::F>, line: usize) -> [L::F; 2] {
        let (place, low, high) = (line & 3, line >> 1 & 6, line >> 1 & 6 | 1);
        [
            l.max(self.0.at(l, place, low), self.1.at(l, place, low)),
            l.max(self.0.at(l, place, high), self.1.at(l, place, high)),
        ]
    }
}

/// A plane.
pub(super) struct OnePlane<F> {
    face: NodeFace,
    rises: Rises,
    heights: [F; 4],
}

impl<L: Lanes> Sheet<L> for OnePlane<L::F> {
    #[inline(always)]
    fn new(l: L, chunk: &Node, face: usize, o: [f32; 3], voxels: &Voxels<L::F>) -> Self {
        let frame = chunk.frame.moved(o);
        Self {
            face: chunk.faces[face % MAX_FLAT],
            rises: l.store(l.mul(l.splat(frame.axis[2]), voxels.heights[0])),
            heights: [
                frame.heights(l, &voxels.layers[0]),
                frame.heights(l, &voxels.layers[1]),
                frame.heights(l, &voxels.layers[2]),
                frame.heights(l, &voxels.layers[3]),
            ],
        }
    }

    #[inline(always)]
    fn at(&self, l: L, place: usize, layer: usize) -> L::F {
        let z = l.add(self.heights[place], l.splat(self.rises[layer]));
        l.sub(l.mul(l.splat(self.face.a), z), l.splat(self.face.c))
    }
}

/// A ball that is not wide.
pub(super) struct OneBall<F> {
    radius: f32,
    steps: Rises,
    flat: [F; 4],
}

impl<L: Lanes> Sheet<L> for OneBall<L::F> {
    #[inline(always)]
    fn new(l: L, chunk: &Node, face: usize, o: [f32; 3], voxels: &Voxels<L::F>) -> Self {
        let face = &chunk.faces[face % MAX_FLAT];
        let square = face.square.moved(o);
        Self {
            radius: face.c,
            steps: square.steps(l, &voxels.heights),
            flat: flats(l, square, voxels),
        }
    }

    #[inline(always)]
    fn at(&self, l: L, place: usize, layer: usize) -> L::F {
        let q = l.add(self.flat[place], l.splat(self.steps[layer]));
        l.sub(root(l, q), l.splat(self.radius))
    }
}

/// A wide ball.
pub(super) struct OneWideBall<F> {
    face: NodeFace,
    steps: Rises,
    flat: [F; 4],
}

impl<L: Lanes> Sheet<L> for OneWideBall<L::F> {
    #[inline(always)]
    fn new(l: L, chunk: &Node, face: usize, o: [f32; 3], voxels: &Voxels<L::F>) -> Self {
        let face = chunk.faces[face % MAX_FLAT];
        let square = face.square.moved(o);
        Self {
            face,
            steps: square.steps(l, &voxels.heights),
            flat: flats(l, square, voxels),
        }
    }

    #[inline(always)]
    fn at(&self, l: L, place: usize, layer: usize) -> L::F {
        let e = l.add(self.flat[place], l.splat(self.steps[layer]));
        self.face.wide(l, e)
    }
}

/// A wide cylinder.
pub(super) struct OneWideCylinder<F> {
    face: NodeFace,
    rises: Rises,
    steps: Rises,
    flat: [F; 4],
    heights: [F; 4],
}

impl<L: Lanes> Sheet<L> for OneWideCylinder<L::F> {
    #[inline(always)]
    fn new(l: L, chunk: &Node, face: usize, o: [f32; 3], voxels: &Voxels<L::F>) -> Self {
        let plane = OnePlane::new(l, chunk, face, o, voxels);
        let square = plane.face.square.moved(o);
        Self {
            face: plane.face,
            rises: plane.rises,
            steps: square.steps(l, &voxels.heights),
            flat: flats(l, square, voxels),
            heights: plane.heights,
        }
    }

    #[inline(always)]
    fn at(&self, l: L, place: usize, layer: usize) -> L::F {
        let foot = l.add(self.flat[place], l.splat(self.steps[layer]));
        let z = l.add(self.heights[place], l.splat(self.rises[layer]));
        self.face.tube(l, foot, z)
    }
}

/// A cone or cylinder that is not wide.
pub(super) struct OneCone<F> {
    face: NodeFace,
    rises: Rises,
    steps: Rises,
    flat: [F; 4],
    heights: [F; 4],
}

impl<L: Lanes> Sheet<L> for OneCone<L::F> {
    #[inline(always)]
    fn new(l: L, chunk: &Node, face: usize, o: [f32; 3], voxels: &Voxels<L::F>) -> Self {
        let plane = OnePlane::new(l, chunk, face, o, voxels);
        let square = chunk.frame.square.moved(o);
        Self {
            face: plane.face,
            rises: plane.rises,
            steps: square.steps(l, &voxels.heights),
            flat: flats(l, square, voxels),
            heights: plane.heights,
        }
    }

    #[inline(always)]
    fn at(&self, l: L, place: usize, layer: usize) -> L::F {
        let z = l.add(self.heights[place], l.splat(self.rises[layer]));
        let q = l.add(self.flat[place], l.splat(self.steps[layer]));
        self.face.cone(l, (root(l, l.sub(q, l.mul(z, z))), z))
    }
}

/// The part of a square that the layers of a place have in common.
#[inline(always)]
fn flats<L: Lanes>(l: L, square: Square, voxels: &Voxels<L::F>) -> [L::F; 4] {
    [
        square.flat(l, &voxels.layers[0]),
        square.flat(l, &voxels.layers[1]),
        square.flat(l, &voxels.layers[2]),
        square.flat(l, &voxels.layers[3]),
    ]
}

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

impl<L: Lanes> Field<L> for Many<'_, L> {
    #[inline(always)]
    fn prepare(&mut self, l: L, voxels: &Voxels<L::F>, near: u16) {
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

    #[inline(always)]
    fn pair(&self, _: L, _: &Voxels<L::F>, line: usize) -> [L::F; 2] {
        self.room.tool[line % LINES_PER_BRICK]
    }
}
