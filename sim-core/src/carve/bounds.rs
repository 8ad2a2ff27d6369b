//! Bounds of the signed distance over 16 boxes at a time, and which faces can decide it there.
//!
//! About a box's middle c, with half edges b and a face's gradient **g** there, a convex distance is at
//! least d(c) − Σ bₖ |gₖ|. It is at most d(c) + Σ bₖ |gₖ| + |b|²/2ρ, ρ = the distance to a ball's
//! centre or to the axis: |v + δ| ≤ |v| + v·δ/|v| + |δ|²/2|v|. A ring takes d(c) ± |b|.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::node::{Node, NodeFace, Points, Square, root};
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

    /// Σ bₖ |gₖ|.
    #[inline(always)]
    fn along<L: Lanes>(&self, l: L, g: [L::F; 3]) -> L::F {
        let zero = l.splat(0.0);
        let size = |g: L::F| l.max(g, l.sub(zero, g));
        let x = l.mul(l.splat(self.half[0]), size(g[0]));
        let y = l.mul(l.splat(self.half[1]), size(g[1]));
        let z = l.mul(l.splat(self.half[2]), size(g[2]));
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
            let [face_low, face_high] = of_face(l, (node, face), p, polar, extent);
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

    /// Where each face of the node can decide the distance: where it can be the largest of a part
    /// that can be the smallest.
    #[inline(always)]
    pub(super) fn deciding<L: Lanes<F = F>>(&self, l: L, node: &Node) -> Deciding {
        let mut bits = [0; MAX_FLAT];
        for (n, bits) in bits.iter_mut().enumerate().take(node.count) {
            let part = self.part_low[usize::from(node.faces[n].part) % MAX_PARTS];
            *bits = l.le(part, self.face_high[n]) & l.le(part, self.high);
        }
        bits
    }
}

/// The faces that can decide at box `lane`, one bit each.
#[inline(always)]
pub(super) fn active(deciding: &Deciding, count: usize, lane: usize) -> u32 {
    let mut bits = 0;
    for (n, deciding) in deciding.iter().enumerate().take(count) {
        bits |= u32::from(deciding >> lane & 1) << n;
    }
    bits
}

#[inline(always)]
fn of_face<L: Lanes>(
    l: L,
    (node, face): (&Node, &NodeFace),
    p: &Points<L::F>,
    (r, z): (L::F, L::F),
    extent: &Extent,
) -> [L::F; 2] {
    match face.kind {
        Kind::Plane => {
            let [x, y, height] = node.axis;
            let reach = extent.along(l, [l.splat(x), l.splat(y), l.splat(height)]);
            extent.around(l, face.distance(l, (r, z), z), reach, l.splat(0.0))
        }
        Kind::Ball => of_ball(l, (&face.square, face.c), p, extent),
        Kind::Cone => of_cone(l, (node, face), p, (r, z), extent),
        Kind::Ring => {
            let reach = l.splat(extent.radius);
            extent.around(l, face.distance(l, (r, z), z), reach, l.splat(0.0))
        }
    }
}

/// Bounds of the distance to a ball of radius `c`.
#[inline(always)]
pub(super) fn of_ball<L: Lanes>(
    l: L,
    (square, c): (&Square, f32),
    p: &Points<L::F>,
    extent: &Extent,
) -> [L::F; 2] {
    let one = l.splat(1.0);
    let q = l.add(square.flat(l, p), square.rises(l, p));
    let away = root(l, q);
    let inverse = l.div(one, l.max(away, one));
    let reach = l.mul(extent.along(l, from_centre(l, square.twice, p)), inverse);
    let bend = l.mul(l.splat(extent.half_square), inverse);
    extent.around(l, l.sub(away, l.splat(c)), reach, bend)
}

/// Bounds of the distance to a cone or cylinder, at points (r, z) of the node.
#[inline(always)]
fn of_cone<L: Lanes>(
    l: L,
    (node, face): (&Node, &NodeFace),
    p: &Points<L::F>,
    (r, z): (L::F, L::F),
    extent: &Extent,
) -> [L::F; 2] {
    let one = l.splat(1.0);
    let w = from_centre(l, node.square.twice, p);
    let share = l.div(l.splat(face.a), l.max(r, one));
    let g = [
        slope(l, w[0], z, node.axis[0], (share, face.b)),
        slope(l, w[1], z, node.axis[1], (share, face.b)),
        slope(l, w[2], z, node.axis[2], (share, face.b)),
    ];
    let bend = l.mul(l.splat(extent.half_square), share);
    extent.around(l, face.distance(l, (r, z), z), extent.along(l, g), bend)
}

/// From the point that a square distance is about to the points, by axis.
#[inline(always)]
fn from_centre<L: Lanes>(l: L, twice: [f32; 3], p: &Points<L::F>) -> [L::F; 3] {
    [
        l.add(l.splat(0.5 * twice[0]), p.x),
        l.add(l.splat(0.5 * twice[1]), p.y),
        l.add(l.splat(0.5 * twice[2]), p.z),
    ]
}

/// nᵣ (w − z a)/r + n₂ a, one axis of a cone's gradient.
#[inline(always)]
fn slope<L: Lanes>(l: L, w: L::F, z: L::F, axis: f32, (share, b): (L::F, f32)) -> L::F {
    let radial = l.sub(w, l.mul(z, l.splat(axis)));
    l.add(l.mul(share, radial), l.splat(b * axis))
}
