//! Bounds of the signed distance over 16 boxes at a time, and which faces can decide it there.
//!
//! About a box's middle c, with half edges b and a face's gradient **g** there, a convex distance is at
//! least d(c) − Σ bₖ |gₖ|. It is at most d(c) + Σ bₖ |gₖ| + |b|²/2ρ, ρ = the distance to a ball's
//! centre or to the axis: |v + δ| ≤ |v| + v·δ/|v| + |δ|²/2|v|. A ring takes d(c) ± |b|. A wide face's e is
//! bounded the same way, and the distance rises with it.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::node::{Frame, Node, NodeFace, Points, Square, root};
use super::placed::{Kind, MAX_FLAT};
use crate::lanes::Lanes;
use crate::tool::revolved::MAX_PARTS;

/// For each face of a node, one bit a box where it can decide.
pub(super) type Deciding = [u16; MAX_FLAT];

/// One size of box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    half: [f32; 3],
    radius: f32,
    half_square: f32,
    slack: f32,
}

impl Extent {
    /// From half edges (units) and what the bounds must leave for rounding.
    pub(super) fn new(half: [f32; 3], slack: f32) -> Self {
        let square = half[0] * half[0] + half[1] * half[1] + half[2] * half[2];
        Self {
            half,
            radius: square.sqrt(),
            half_square: 0.5 * square,
            slack,
        }
    }

    /// From the middle to a corner, units.
    pub(super) fn radius(&self) -> f32 {
        self.radius
    }

    /// Its square.
    pub(super) fn square(&self) -> f32 {
        2.0 * self.half_square
    }

    /// Σ bₖ |gₖ|.
    pub(super) fn reach(&self, g: [f32; 3]) -> f32 {
        self.half[0] * g[0].abs() + self.half[1] * g[1].abs() + self.half[2] * g[2].abs()
    }

    /// The same for 16 gradients.
    #[inline(always)]
    pub(super) fn along<L: Lanes>(&self, l: L, g: [L::F; 3]) -> L::F {
        let x = l.mul(l.splat(self.half[0]), l.abs(g[0]));
        let y = l.mul(l.splat(self.half[1]), l.abs(g[1]));
        let z = l.mul(l.splat(self.half[2]), l.abs(g[2]));
        l.add(l.add(x, y), z)
    }

    /// Lowest and highest distance where it is `d` in the middle.
    #[inline(always)]
    fn around<L: Lanes>(&self, l: L, d: L::F, reach: L::F, bend: L::F) -> [L::F; 2] {
        let reach = l.add(reach, l.splat(self.slack));
        [l.sub(d, reach), l.add(l.add(d, reach), bend)]
    }
}

/// Lowest and highest signed distance over 16 boxes: of the tool, its parts, and a node's faces.
pub(super) struct Bounds<F> {
    pub low: F,
    pub high: F,
    part_low: [F; MAX_PARTS],
    face_high: [F; MAX_FLAT],
}

impl<F: Copy> Bounds<F> {
    /// Room, to be filled by [`Self::enter`].
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L) -> Self {
        let none = l.splat(0.0);
        Self {
            low: none,
            high: none,
            part_low: [none; MAX_PARTS],
            face_high: [none; MAX_FLAT],
        }
    }

    /// Bounds over boxes about the points `p` of a node.
    #[inline(always)]
    pub(super) fn enter<L: Lanes<F = F>>(
        &mut self,
        l: L,
        node: &Node,
        p: &Points<F>,
        extent: &Extent,
    ) {
        let polar = node.polar(l, p);
        let none = l.splat(f32::NEG_INFINITY);
        let (mut low, mut high) = (l.splat(f32::INFINITY), l.splat(f32::INFINITY));
        let (mut part_low, mut part_high) = (none, none);
        for n in 0..node.count.min(MAX_FLAT) {
            let face = &node.faces[n];
            let own = (face, &face.square);
            let [face_low, face_high] = of_face(l, &node.frame, own, p, polar, extent);
            part_low = l.max(part_low, face_low);
            part_high = l.max(part_high, face_high);
            self.face_high[n] = face_high;
            self.part_low[usize::from(face.part) % MAX_PARTS] = part_low;
            if node.ends_part(n) {
                low = l.min(low, part_low);
                high = l.min(high, part_high);
                part_low = none;
                part_high = none;
            }
        }
        self.low = low;
        self.high = high;
    }

    /// Where each face of the node can decide the distance, or comes within `room` of it: where it can be
    /// the largest of a part that can be the smallest.
    #[inline(always)]
    pub(super) fn deciding<L: Lanes<F = F>>(&self, l: L, node: &Node, room: F) -> Deciding {
        let mut bits = [0; MAX_FLAT];
        for (n, bits) in bits.iter_mut().enumerate().take(node.count) {
            *bits = self.decides(l, node, n, room);
        }
        bits
    }

    #[inline(always)]
    fn decides<L: Lanes<F = F>>(&self, l: L, node: &Node, n: usize, room: F) -> u16 {
        let part = self.part_low[usize::from(node.faces[n % MAX_FLAT].part) % MAX_PARTS];
        let part = l.sub(part, room);
        l.le(part, self.face_high[n % MAX_FLAT]) & l.le(part, self.high)
    }
}

/// The faces that can decide at box `lane`, one bit each.
#[inline(always)]
pub(super) fn active(deciding: &Deciding, count: usize, lane: usize) -> u16 {
    let mut bits = 0;
    for (n, deciding) in deciding.iter().enumerate().take(count) {
        bits |= (deciding >> lane & 1) << n;
    }
    bits
}

/// Bounds over 16 boxes of a brick, of some of the tool's faces.
pub(super) struct Sides<F> {
    pub low: F,
    pub high: F,
    part_low: [F; MAX_PARTS],
    face_high: [F; MAX_FLAT],
}

impl<F: Copy> Sides<F> {
    /// Room, to be filled by [`Self::enter`].
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L) -> Self {
        let none = l.splat(0.0);
        Self {
            low: none,
            high: none,
            part_low: [none; MAX_PARTS],
            face_high: [none; MAX_FLAT],
        }
    }

    /// Of `faces` of a chunk's node, in the brick whose first voxel lies at `o` there, over boxes about
    /// the points `p` from there.
    #[inline(always)]
    pub(super) fn enter<L: Lanes<F = F>>(
        &mut self,
        l: L,
        (chunk, faces, o): (&Node, u16, [f32; 3]),
        p: &Points<F>,
        extent: &Extent,
    ) {
        let none = l.splat(f32::NEG_INFINITY);
        let (mut low, mut high) = (l.splat(f32::INFINITY), l.splat(f32::INFINITY));
        let (mut part_low, mut part_high) = (none, none);
        let mut rest = faces;
        while rest != 0 {
            let n = rest.trailing_zeros() as usize % MAX_FLAT;
            rest &= rest - 1;
            let [face_low, face_high] = in_brick(l, (chunk, n, o), p, extent);
            part_low = l.max(part_low, face_low);
            part_high = l.max(part_high, face_high);
            self.face_high[n] = face_high;
            let next = rest.trailing_zeros() as usize % MAX_FLAT;
            let part = chunk.faces[n].part;
            if rest == 0 || chunk.faces[next].part != part {
                self.part_low[usize::from(part) % MAX_PARTS] = part_low;
                low = l.min(low, part_low);
                high = l.min(high, part_high);
                part_low = none;
                part_high = none;
            }
        }
        self.low = low;
        self.high = high;
    }

    /// Which of `faces` are needed on the lines in `near`, or come within `room` of it: of every part that can
    /// be the smallest on one of them, all that can be its largest on any.
    #[inline(always)]
    pub(super) fn deciding<L: Lanes<F = F>>(
        &self,
        l: L,
        chunk: &Node,
        faces: u16,
        (near, room): (u16, F),
    ) -> u16 {
        let (mut rest, mut needed) = (faces, 0);
        while rest != 0 {
            let n = rest.trailing_zeros() as usize % MAX_FLAT;
            rest &= rest - 1;
            let part = self.part_low[usize::from(chunk.faces[n].part) % MAX_PARTS];
            let part = l.sub(part, room);
            let least = l.le(part, self.high) & near != 0;
            let most = l.le(part, self.face_high[n]) & near != 0;
            needed |= u16::from(least && most) << n;
        }
        needed
    }
}

/// Bounds of the distance to face `n` of a chunk's node over boxes of the brick whose first voxel lies at
/// `o` there, about the points `p` from there.
#[inline(always)]
fn in_brick<L: Lanes>(
    l: L,
    (chunk, n, o): (&Node, usize, [f32; 3]),
    p: &Points<L::F>,
    extent: &Extent,
) -> [L::F; 2] {
    let face = &chunk.faces[n % MAX_FLAT];
    let own = if face.kind.has_square() {
        face.square.moved(o)
    } else {
        face.square
    };
    let frame = chunk.frame.moved(o);
    let (r, z) = match face.kind {
        Kind::Ball | Kind::WideBall => (p.z, p.z),
        Kind::Plane | Kind::WideCylinder => {
            let z = frame.z(l, p);
            (z, z)
        }
        Kind::Cone | Kind::Ring => {
            let z = frame.z(l, p);
            (frame.r(l, p, z), z)
        }
    };
    of_face(l, &frame, (face, &own), p, (r, z), extent)
}

/// `square` is the face's own.
#[inline(always)]
fn of_face<L: Lanes>(
    l: L,
    frame: &Frame,
    (face, square): (&NodeFace, &Square),
    p: &Points<L::F>,
    (r, z): (L::F, L::F),
    extent: &Extent,
) -> [L::F; 2] {
    match face.kind {
        Kind::Plane => {
            let [x, y, height] = frame.axis;
            let reach = l.splat(extent.reach([x, y, height]));
            extent.around(l, face.distance(l, (r, z), z), reach, l.splat(0.0))
        }
        Kind::Ball => of_ball(l, (square, face.c), p, extent),
        Kind::Cone => of_cone(l, (frame, face), p, (r, z), extent),
        Kind::Ring => {
            let reach = l.splat(extent.radius);
            extent.around(l, face.distance(l, (r, z), z), reach, l.splat(0.0))
        }
        Kind::WideBall => {
            let e = l.add(square.flat(l, p), square.rises(l, p));
            of_wide(l, face, (e, square.gradient(l, p)), extent)
        }
        Kind::WideCylinder => {
            let foot = l.add(square.flat(l, p), square.rises(l, p));
            let e = face.across(l, foot, z);
            of_wide(l, face, (e, frame.steepness(l, square, p, z)), extent)
        }
    }
}

/// Bounds of the distance to a wide face, from e and its gradient.
#[inline(always)]
fn of_wide<L: Lanes>(
    l: L,
    face: &NodeFace,
    (e, gradient): (L::F, [L::F; 3]),
    extent: &Extent,
) -> [L::F; 2] {
    let bend = l.splat(face.square.share * extent.square());
    let [low, high] = extent.around(l, e, extent.along(l, gradient), bend);
    [face.wide(l, low), face.wide(l, high)]
}

/// Bounds of the distance to a ball of radius `c`.
#[inline(always)]
fn of_ball<L: Lanes>(
    l: L,
    (square, c): (&Square, f32),
    p: &Points<L::F>,
    extent: &Extent,
) -> [L::F; 2] {
    let one = l.splat(1.0);
    let q = l.add(square.flat(l, p), square.rises(l, p));
    let away = root(l, q);
    let inverse = l.div(one, l.max(away, one));
    let reach = l.mul(extent.along(l, square.off_centre(l, p)), inverse);
    let bend = l.mul(l.splat(extent.half_square), inverse);
    extent.around(l, l.sub(away, l.splat(c)), reach, bend)
}

/// Bounds of the distance to a cone or cylinder, at points (r, z) of the node.
#[inline(always)]
fn of_cone<L: Lanes>(
    l: L,
    (frame, face): (&Frame, &NodeFace),
    p: &Points<L::F>,
    (r, z): (L::F, L::F),
    extent: &Extent,
) -> [L::F; 2] {
    let one = l.splat(1.0);
    let across = frame.across(l, p, z);
    let share = l.div(l.splat(face.a), l.max(r, one));
    // nᵣ (w − z a)/r + n₂ a
    let g = [
        l.add(l.mul(share, across[0]), l.splat(face.b * frame.axis[0])),
        l.add(l.mul(share, across[1]), l.splat(face.b * frame.axis[1])),
        l.add(l.mul(share, across[2]), l.splat(face.b * frame.axis[2])),
    ];
    let bend = l.mul(l.splat(extent.half_square), share);
    extent.around(l, face.distance(l, (r, z), z), extent.along(l, g), bend)
}
