//! A tool's faces as a chunk or a brick sees them, 16 points at a time ([`super::placed`] has the
//! formula).
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "lengths become f32 inside a node; lanes must melt into the job"
)]

use super::placed::{Kind, MAX_FLAT};
use crate::lanes::Lanes;
use glam::DVec3;

/// Points of a node: δ from its base, and the squares that the formula needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Points<F> {
    pub x: F,
    pub y: F,
    pub z: F,
    xy2: F,
    z2: F,
}

impl<F: Copy> Points<F> {
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L, [x, y, z]: [F; 3]) -> Self {
        Self {
            x,
            y,
            z,
            xy2: l.add(l.mul(x, x), l.mul(y, y)),
            z2: l.mul(z, z),
        }
    }
}

/// Distance of a square, which rounding may have brought below zero about its own point.
#[inline(always)]
pub(super) fn root<L: Lanes>(l: L, q: L::F) -> L::F {
    l.sqrt(l.max(q, l.splat(0.0)))
}

/// A square distance as a function of δ, or a multiple of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Square {
    pub base: f32,
    pub twice: [f32; 3],
    /// How much of |δ|²: 1 where it is a square distance.
    pub share: f32,
}

impl Square {
    /// No distance at all.
    pub(super) const ZERO: Self = Self {
        base: 0.0,
        twice: [0.0; 3],
        share: 1.0,
    };

    /// About a point that lies −`w` from the base.
    #[inline(always)]
    pub(super) fn new(w: DVec3) -> Self {
        Self {
            base: w.length_squared() as f32,
            twice: (2.0 * w).as_vec3().to_array(),
            share: 1.0,
        }
    }

    /// (q − R²)/2R, q being the square distance to that point.
    #[inline(always)]
    pub(super) fn less(w: DVec3, radius: f64) -> Self {
        let share = 0.5 / radius;
        Self {
            base: ((w.length_squared() - radius * radius) * share) as f32,
            twice: (2.0 * share * w).as_vec3().to_array(),
            share: share as f32,
        }
    }

    /// The same for points that begin at `o`: base + ((t.x o.x + t.y o.y) + (t.z o.z + s |o|²)),
    /// t = twice, s = share.
    #[inline(always)]
    pub(super) fn moved(self, o: [f32; 3]) -> Self {
        let t = self.twice;
        let o2 = self.share * ((o[0] * o[0] + o[1] * o[1]) + o[2] * o[2]);
        let s = 2.0 * self.share;
        Self {
            base: self.base + ((t[0] * o[0] + t[1] * o[1]) + (t[2] * o[2] + o2)),
            twice: [t[0] + s * o[0], t[1] + s * o[1], t[2] + s * o[2]],
            share: self.share,
        }
    }

    /// Its gradient, by axis.
    #[inline(always)]
    pub(super) fn gradient<L: Lanes>(&self, l: L, p: &Points<L::F>) -> [L::F; 3] {
        let s = l.splat(2.0 * self.share);
        [
            l.add(l.splat(self.twice[0]), l.mul(s, p.x)),
            l.add(l.splat(self.twice[1]), l.mul(s, p.y)),
            l.add(l.splat(self.twice[2]), l.mul(s, p.z)),
        ]
    }

    /// From the point that it is about to the points, by axis.
    #[inline(always)]
    pub(super) fn off_centre<L: Lanes>(&self, l: L, p: &Points<L::F>) -> [L::F; 3] {
        [
            l.add(l.splat(0.5 * self.twice[0]), p.x),
            l.add(l.splat(0.5 * self.twice[1]), p.y),
            l.add(l.splat(0.5 * self.twice[2]), p.z),
        ]
    }

    /// The part that does not depend on δ.z.
    #[inline(always)]
    pub(super) fn flat<L: Lanes>(self, l: L, p: &Points<L::F>) -> L::F {
        let x = l.add(l.splat(self.base), l.mul(l.splat(self.twice[0]), p.x));
        let y = l.add(x, l.mul(l.splat(self.twice[1]), p.y));
        l.add(y, l.mul(l.splat(self.share), p.xy2))
    }

    /// The part that does, for points at different heights.
    #[inline(always)]
    pub(super) fn rises<L: Lanes>(self, l: L, p: &Points<L::F>) -> L::F {
        let z2 = l.mul(l.splat(self.share), p.z2);
        l.add(l.mul(l.splat(self.twice[2]), p.z), z2)
    }

    /// The same for the layers of a brick, at their heights (and the squares of these).
    #[inline(always)]
    pub(super) fn steps<L: Lanes>(self, l: L, [z, z2]: &[L::F; 2]) -> [f32; 16] {
        let square = l.mul(l.splat(self.share), *z2);
        l.store(l.add(l.mul(l.splat(self.twice[2]), *z), square))
    }

    /// The same for points at one height.
    #[inline(always)]
    pub(super) fn rise(self, z: f32) -> f32 {
        self.twice[2] * z + self.share * (z * z)
    }
}

/// A face at a node; what the fields mean depends on the kind.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeFace {
    pub kind: Kind,
    pub part: u8,
    /// Plane: sign. Cone: nᵣ. Ring: radius of the disc. Wide: m/2R.
    pub a: f32,
    /// Cone: n₂. Ring: z of the centre. Wide: 1/2R².
    pub b: f32,
    /// Plane, cone: offset. Ball, ring: radius.
    pub c: f32,
    /// Ball: square distance to the centre. Wide: e of the ball; of the cylinder, that of its foot.
    pub square: Square,
}

/// The axis as a node sees it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub axis: [f32; 3],
    /// z of the base, from the foot.
    pub z0: f32,
    /// Square distance to the foot.
    pub square: Square,
}

/// The tool's faces as a node sees them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub faces: [NodeFace; MAX_FLAT],
    pub count: usize,
    pub frame: Frame,
    /// Whether a face needs r.
    pub needs_r: bool,
}

impl NodeFace {
    const NONE: Self = Self {
        kind: Kind::Plane,
        part: 0,
        a: 0.0,
        b: 0.0,
        c: 0.0,
        square: Square::ZERO,
    };

    /// Signed distance at points (r, z); a ball's or a wide face's is read from its own square `q`.
    #[inline(always)]
    pub(super) fn distance<L: Lanes>(&self, l: L, (r, z): (L::F, L::F), q: L::F) -> L::F {
        let (a, b, c) = (l.splat(self.a), l.splat(self.b), l.splat(self.c));
        match self.kind {
            Kind::Plane => l.sub(l.mul(a, z), c),
            Kind::Cone => self.cone(l, (r, z)),
            Kind::Ball => l.sub(root(l, q), c),
            Kind::WideBall => self.wide(l, q),
            Kind::WideCylinder => self.tube(l, q, z),
            Kind::Ring => {
                let beyond = l.max(l.sub(r, a), l.splat(0.0));
                let dz = l.sub(z, b);
                let q = l.add(l.mul(beyond, beyond), l.mul(dz, dz));
                l.sub(l.sqrt(q), c)
            }
        }
    }
}

impl NodeFace {
    /// Signed distance to a wide face: e (1 − e (m/2R − e/2R²)).
    #[inline(always)]
    pub(super) fn wide<L: Lanes>(&self, l: L, e: L::F) -> L::F {
        let bend = l.sub(l.splat(self.a), l.mul(l.splat(self.b), e));
        l.mul(e, l.sub(l.splat(1.0), l.mul(e, bend)))
    }

    /// e of a wide cylinder at heights z, from that of its foot.
    #[inline(always)]
    pub(super) fn across<L: Lanes>(&self, l: L, foot: L::F, z: L::F) -> L::F {
        l.sub(foot, l.mul(l.mul(l.splat(self.square.share), z), z))
    }

    /// Signed distance to a wide cylinder.
    #[inline(always)]
    pub(super) fn tube<L: Lanes>(&self, l: L, foot: L::F, z: L::F) -> L::F {
        self.wide(l, self.across(l, foot, z))
    }

    /// Signed distance to a cone or cylinder.
    #[inline(always)]
    pub(super) fn cone<L: Lanes>(&self, l: L, (r, z): (L::F, L::F)) -> L::F {
        let slant = l.add(l.mul(l.splat(self.a), r), l.mul(l.splat(self.b), z));
        l.sub(slant, l.splat(self.c))
    }
}

impl Frame {
    /// The same for points that begin at `o`.
    #[inline(always)]
    pub(super) fn moved(&self, o: [f32; 3]) -> Self {
        Self {
            axis: self.axis,
            z0: self.height(o),
            square: self.square.moved(o),
        }
    }

    /// z of the point `o`.
    #[inline(always)]
    pub(super) fn height(&self, o: [f32; 3]) -> f32 {
        let a = self.axis;
        self.z0 + ((a[0] * o[0] + a[1] * o[1]) + a[2] * o[2])
    }

    /// z of points, less what δ.z adds.
    #[inline(always)]
    pub(super) fn heights<L: Lanes>(&self, l: L, p: &Points<L::F>) -> L::F {
        let x = l.add(l.splat(self.z0), l.mul(l.splat(self.axis[0]), p.x));
        l.add(x, l.mul(l.splat(self.axis[1]), p.y))
    }

    /// z of points.
    #[inline(always)]
    pub(super) fn z<L: Lanes>(&self, l: L, p: &Points<L::F>) -> L::F {
        let flat = self.heights(l, p);
        l.add(flat, l.mul(l.splat(self.axis[2]), p.z))
    }

    /// r of points at heights z.
    #[inline(always)]
    pub(super) fn r<L: Lanes>(&self, l: L, p: &Points<L::F>, z: L::F) -> L::F {
        let q = l.add(self.square.flat(l, p), self.square.rises(l, p));
        root(l, l.sub(q, l.mul(z, z)))
    }

    /// From the axis to points at heights z, square to it: w − z a.
    #[inline(always)]
    pub(super) fn across<L: Lanes>(&self, l: L, p: &Points<L::F>, z: L::F) -> [L::F; 3] {
        let w = self.square.off_centre(l, p);
        [
            l.sub(w[0], l.mul(z, l.splat(self.axis[0]))),
            l.sub(w[1], l.mul(z, l.splat(self.axis[1]))),
            l.sub(w[2], l.mul(z, l.splat(self.axis[2]))),
        ]
    }

    /// The gradient of a wide cylinder's e, of which `square` is that of its foot, at points at heights z.
    #[inline(always)]
    pub(super) fn steepness<L: Lanes>(
        &self,
        l: L,
        square: &Square,
        p: &Points<L::F>,
        z: L::F,
    ) -> [L::F; 3] {
        let [x, y, height] = square.gradient(l, p);
        let z = l.mul(l.splat(2.0 * square.share), z);
        [
            l.sub(x, l.mul(z, l.splat(self.axis[0]))),
            l.sub(y, l.mul(z, l.splat(self.axis[1]))),
            l.sub(height, l.mul(z, l.splat(self.axis[2]))),
        ]
    }
}

impl Node {
    /// A node without faces, to be entered: made once a job, since its arrays are long.
    pub(super) fn empty() -> Self {
        Self {
            faces: [NodeFace::NONE; MAX_FLAT],
            count: 0,
            frame: Frame {
                axis: [0.0; 3],
                z0: 0.0,
                square: Square::ZERO,
            },
            needs_r: false,
        }
    }

    /// Becomes the brick whose first voxel lies at `o` in the chunk's node, with the faces in `active`
    /// (one bit each).
    #[inline(always)]
    pub(super) fn enter(&mut self, chunk: &Self, o: [f32; 3], active: u16) {
        self.count = 0;
        self.frame = chunk.frame.moved(o);
        self.needs_r = false;
        let mut active = active;
        while active != 0 {
            let face = &chunk.faces[(active.trailing_zeros() as usize) % MAX_FLAT];
            active &= active - 1;
            let own = &mut self.faces[self.count % MAX_FLAT];
            *own = *face;
            if face.kind.has_square() {
                own.square = face.square.moved(o);
            }
            self.needs_r |= matches!(face.kind, Kind::Cone | Kind::Ring);
            self.count += 1;
        }
    }

    /// Whether face `n` is the last of its part here.
    #[inline(always)]
    pub(super) fn ends_part(&self, n: usize) -> bool {
        n + 1 >= self.count || self.faces[(n + 1) % MAX_FLAT].part != self.faces[n].part
    }

    /// (r, z) of 16 points; r only where a face needs it.
    #[inline(always)]
    pub(super) fn polar<L: Lanes>(&self, l: L, p: &Points<L::F>) -> (L::F, L::F) {
        let z = self.frame.z(l, p);
        if !self.needs_r {
            return (z, z);
        }
        (self.frame.r(l, p, z), z)
    }

    /// The parts of z and of the square distance to the foot that do not depend on δ.z.
    #[inline(always)]
    pub(super) fn flat<L: Lanes>(&self, l: L, p: &Points<L::F>) -> [L::F; 2] {
        [self.frame.heights(l, p), self.frame.square.flat(l, p)]
    }

    /// (r, z) at `height` above the points of [`Self::flat`]; r only where a face needs it.
    #[inline(always)]
    pub(super) fn rise<L: Lanes>(&self, l: L, [z, q]: [L::F; 2], height: f32) -> (L::F, L::F) {
        let z = l.add(z, l.splat(self.frame.axis[2] * height));
        if !self.needs_r {
            return (z, z);
        }
        let q = l.add(q, l.splat(self.frame.square.rise(height)));
        (root(l, l.sub(q, l.mul(z, z))), z)
    }
}
