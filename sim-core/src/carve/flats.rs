//! A brick's voxels, a layer of 4×4 at a time: what the layers of a brick have in common is computed
//! once for each of the four places that a line has in a layer.
//!
//! Most bricks see one face or two, so these have code without loops over faces, and all bricks of a chunk
//! that see the same go through one loop ([`super::batch`]); the values are the same bits as those of the
//! general code.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::node::{Frame, Node, NodeFace, Points, Square, root};
use super::placed::MAX_FLAT;
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
    pub(super) fn at(&self, line: usize) -> (usize, [f32; 2]) {
        let z = 2 * (line >> 2);
        (line & 3, [self.rise * z as f32, self.rise * (z + 1) as f32])
    }
}

/// Two of a kind: one for each face of a [`Two`].
pub(super) type Pair<T> = [T; 2];

/// What a face's voxels in one brick have in common.
#[derive(Clone, Copy)]
pub(super) struct Plate<F> {
    // at each place of a line: of a square, and of z
    flat: [F; 4],
    heights: [F; 4],
    // what each layer adds to these
    steps: [f32; 16],
    rises: [f32; 16],
}

impl<F: Copy> Plate<F> {
    /// Room.
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L) -> Self {
        Self {
            flat: [l.splat(0.0); 4],
            heights: [l.splat(0.0); 4],
            steps: [0.0; 16],
            rises: [0.0; 16],
        }
    }

    #[inline(always)]
    fn lay_square<L: Lanes<F = F>>(&mut self, l: L, square: Square, voxels: &Voxels<F>) {
        self.steps = square.steps(l, &voxels.heights);
        for (flat, layer) in self.flat.iter_mut().zip(&voxels.layers) {
            *flat = square.flat(l, layer);
        }
    }

    #[inline(always)]
    fn lay_heights<L: Lanes<F = F>>(&mut self, l: L, frame: &Frame, voxels: &Voxels<F>) {
        self.rises = l.store(l.mul(l.splat(frame.axis[2]), voxels.heights[0]));
        for (heights, layer) in self.heights.iter_mut().zip(&voxels.layers) {
            *heights = frame.heights(l, layer);
        }
    }

    /// The square's value on a layer at a place.
    #[inline(always)]
    fn square<L: Lanes<F = F>>(&self, l: L, place: usize, layer: usize) -> F {
        l.add(self.flat[place & 3], l.splat(self.steps[layer & 15]))
    }

    /// z on a layer at a place.
    #[inline(always)]
    fn z<L: Lanes<F = F>>(&self, l: L, place: usize, layer: usize) -> F {
        l.add(self.heights[place & 3], l.splat(self.rises[layer & 15]))
    }
}

/// The distance to the faces that a set of bricks sees. All of it must be inlined into the job.
pub(super) trait Field<L: Lanes> {
    /// Lays out the brick whose first voxel lies at `o` in a chunk's node.
    fn lay(
        &self,
        l: L,
        plates: &mut Pair<Plate<L::F>>,
        chunk: &Node,
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    );
    /// Signed distances on the two layers of line `line` of a brick.
    fn pair(&self, l: L, plates: &Pair<Plate<L::F>>, line: usize) -> [L::F; 2];
}

/// A face of a chunk's node: what all bricks of the chunk have in common.
pub(super) trait Sheet<L: Lanes> {
    /// Of face `face`.
    fn new(l: L, face: &NodeFace) -> Self;
    /// Lays out a brick.
    fn lay(
        l: L,
        plate: &mut Plate<L::F>,
        chunk: (&Node, &NodeFace),
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    );
    /// Signed distance on layer `layer` of a brick at a place.
    fn at(&self, l: L, plate: &Plate<L::F>, place: usize, layer: usize) -> L::F;
}

/// One face alone, and its number.
pub(super) struct One<A>(A, usize);

/// The larger distance of two faces, and their numbers.
pub(super) struct Two<A, B>(A, B, [usize; 2]);

impl<A> One<A> {
    /// Face `a` of a chunk's node.
    #[inline(always)]
    pub(super) fn new<L: Lanes>(l: L, chunk: &Node, a: usize) -> Self
    where
        A: Sheet<L>,
    {
        Self(A::new(l, &chunk.faces[a % MAX_FLAT]), a % MAX_FLAT)
    }
}

impl<A, B> Two<A, B> {
    /// Faces `a` and `b` of a chunk's node.
    #[inline(always)]
    pub(super) fn new<L: Lanes>(l: L, chunk: &Node, a: usize, b: usize) -> Self
    where
        A: Sheet<L>,
        B: Sheet<L>,
    {
        let (a, b) = (a % MAX_FLAT, b % MAX_FLAT);
        Self(
            A::new(l, &chunk.faces[a]),
            B::new(l, &chunk.faces[b]),
            [a, b],
        )
    }
}

impl<L: Lanes, A: Sheet<L>> Field<L> for One<A> {
    #[inline(always)]
    fn lay(
        &self,
        l: L,
        plates: &mut Pair<Plate<L::F>>,
        chunk: &Node,
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        A::lay(l, &mut plates[0], (chunk, &chunk.faces[self.1]), o, voxels);
    }

    #[inline(always)]
    fn pair(&self, l: L, plates: &Pair<Plate<L::F>>, line: usize) -> [L::F; 2] {
        let (place, low, high) = (line & 3, line >> 1 & 6, line >> 1 & 6 | 1);
        let plate = &plates[0];
        [
            self.0.at(l, plate, place, low),
            self.0.at(l, plate, place, high),
        ]
    }
}

impl<L: Lanes, A: Sheet<L>, B: Sheet<L>> Field<L> for Two<A, B> {
    #[inline(always)]
    fn lay(
        &self,
        l: L,
        plates: &mut Pair<Plate<L::F>>,
        chunk: &Node,
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        let [first, second] = plates;
        let [a, b] = self.2;
        A::lay(l, first, (chunk, &chunk.faces[a]), o, voxels);
        B::lay(l, second, (chunk, &chunk.faces[b]), o, voxels);
    }

    #[inline(always)]
    fn pair(&self, l: L, [a, b]: &Pair<Plate<L::F>>, line: usize) -> [L::F; 2] {
        let (place, low, high) = (line & 3, line >> 1 & 6, line >> 1 & 6 | 1);
        [
            l.max(self.0.at(l, a, place, low), self.1.at(l, b, place, low)),
            l.max(self.0.at(l, a, place, high), self.1.at(l, b, place, high)),
        ]
    }
}

/// A plane.
pub(super) struct OnePlane<F> {
    sign: F,
    offset: F,
}

impl<L: Lanes> Sheet<L> for OnePlane<L::F> {
    #[inline(always)]
    fn new(l: L, face: &NodeFace) -> Self {
        Self {
            sign: l.splat(face.a),
            offset: l.splat(face.c),
        }
    }

    #[inline(always)]
    fn lay(
        l: L,
        plate: &mut Plate<L::F>,
        (chunk, _): (&Node, &NodeFace),
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        plate.lay_heights(l, &chunk.frame.moved(o), voxels);
    }

    #[inline(always)]
    fn at(&self, l: L, plate: &Plate<L::F>, place: usize, layer: usize) -> L::F {
        l.sub(l.mul(self.sign, plate.z(l, place, layer)), self.offset)
    }
}

/// A ball that is not wide.
pub(super) struct OneBall<F> {
    radius: F,
}

impl<L: Lanes> Sheet<L> for OneBall<L::F> {
    #[inline(always)]
    fn new(l: L, face: &NodeFace) -> Self {
        Self {
            radius: l.splat(face.c),
        }
    }

    #[inline(always)]
    fn lay(
        l: L,
        plate: &mut Plate<L::F>,
        (_, face): (&Node, &NodeFace),
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        plate.lay_square(l, face.square.moved(o), voxels);
    }

    #[inline(always)]
    fn at(&self, l: L, plate: &Plate<L::F>, place: usize, layer: usize) -> L::F {
        l.sub(root(l, plate.square(l, place, layer)), self.radius)
    }
}

/// What bends e of a wide face into its distance ([`NodeFace::wide`]).
struct Bend<F> {
    a: F,
    b: F,
    one: F,
}

impl<F: Copy> Bend<F> {
    #[inline(always)]
    fn new<L: Lanes<F = F>>(l: L, face: &NodeFace) -> Self {
        Self {
            a: l.splat(face.a),
            b: l.splat(face.b),
            one: l.splat(1.0),
        }
    }

    #[inline(always)]
    fn of<L: Lanes<F = F>>(&self, l: L, e: F) -> F {
        let bend = l.sub(self.a, l.mul(self.b, e));
        l.mul(e, l.sub(self.one, l.mul(e, bend)))
    }
}

/// A wide ball.
pub(super) struct OneWideBall<F> {
    bend: Bend<F>,
}

impl<L: Lanes> Sheet<L> for OneWideBall<L::F> {
    #[inline(always)]
    fn new(l: L, face: &NodeFace) -> Self {
        Self {
            bend: Bend::new(l, face),
        }
    }

    #[inline(always)]
    fn lay(
        l: L,
        plate: &mut Plate<L::F>,
        (_, face): (&Node, &NodeFace),
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        plate.lay_square(l, face.square.moved(o), voxels);
    }

    #[inline(always)]
    fn at(&self, l: L, plate: &Plate<L::F>, place: usize, layer: usize) -> L::F {
        self.bend.of(l, plate.square(l, place, layer))
    }
}

/// A wide cylinder.
pub(super) struct OneWideCylinder<F> {
    bend: Bend<F>,
    share: F,
}

impl<L: Lanes> Sheet<L> for OneWideCylinder<L::F> {
    #[inline(always)]
    fn new(l: L, face: &NodeFace) -> Self {
        Self {
            bend: Bend::new(l, face),
            share: l.splat(face.square.share),
        }
    }

    #[inline(always)]
    fn lay(
        l: L,
        plate: &mut Plate<L::F>,
        (chunk, face): (&Node, &NodeFace),
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        plate.lay_heights(l, &chunk.frame.moved(o), voxels);
        plate.lay_square(l, face.square.moved(o), voxels);
    }

    #[inline(always)]
    fn at(&self, l: L, plate: &Plate<L::F>, place: usize, layer: usize) -> L::F {
        let foot = plate.square(l, place, layer);
        let z = plate.z(l, place, layer);
        self.bend.of(l, l.sub(foot, l.mul(l.mul(self.share, z), z)))
    }
}

/// A cone or cylinder that is not wide.
pub(super) struct OneCone<F> {
    // nᵣ, n₂, offset
    out: F,
    up: F,
    offset: F,
}

impl<L: Lanes> Sheet<L> for OneCone<L::F> {
    #[inline(always)]
    fn new(l: L, face: &NodeFace) -> Self {
        Self {
            out: l.splat(face.a),
            up: l.splat(face.b),
            offset: l.splat(face.c),
        }
    }

    #[inline(always)]
    fn lay(
        l: L,
        plate: &mut Plate<L::F>,
        (chunk, _): (&Node, &NodeFace),
        o: [f32; 3],
        voxels: &Voxels<L::F>,
    ) {
        plate.lay_heights(l, &chunk.frame.moved(o), voxels);
        plate.lay_square(l, chunk.frame.square.moved(o), voxels);
    }

    #[inline(always)]
    fn at(&self, l: L, plate: &Plate<L::F>, place: usize, layer: usize) -> L::F {
        let z = plate.z(l, place, layer);
        let q = plate.square(l, place, layer);
        let r = root(l, l.sub(q, l.mul(z, z)));
        l.sub(l.add(l.mul(self.out, r), l.mul(self.up, z)), self.offset)
    }
}
