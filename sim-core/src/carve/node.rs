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

/// A square distance as a function of δ.
#[derive(Debug, Clone, Copy)]
pub(super) struct Square {
    base: f32,
    pub twice: [f32; 3],
}

impl Square {
    /// No distance at all.
    pub(super) const ZERO: Self = Self {
        base: 0.0,
        twice: [0.0; 3],
    };

    /// About a point that lies −`w` from the base.
    pub(super) fn new(w: DVec3) -> Self {
        Self {
            base: w.length_squared() as f32,
            twice: (2.0 * w).as_vec3().to_array(),
        }
    }

    /// The same for points that begin at `o`: |w|² + ((2w.x o.x + 2w.y o.y) + (2w.z o.z + |o|²)).
    #[inline(always)]
    pub(super) fn moved(self, o: [f32; 3]) -> Self {
        let t = self.twice;
        let o2 = (o[0] * o[0] + o[1] * o[1]) + o[2] * o[2];
        Self {
            base: self.base + ((t[0] * o[0] + t[1] * o[1]) + (t[2] * o[2] + o2)),
            twice: [t[0] + 2.0 * o[0], t[1] + 2.0 * o[1], t[2] + 2.0 * o[2]],
        }
    }

    /// The part that does not depend on δ.z.
    #[inline(always)]
    pub(super) fn flat<L: Lanes>(self, l: L, p: &Points<L::F>) -> L::F {
        let x = l.add(l.splat(self.base), l.mul(l.splat(self.twice[0]), p.x));
        let y = l.add(x, l.mul(l.splat(self.twice[1]), p.y));
        l.add(y, p.xy2)
    }

    /// The part that does, for points at different heights.
    #[inline(always)]
    pub(super) fn rises<L: Lanes>(self, l: L, p: &Points<L::F>) -> L::F {
        l.add(l.mul(l.splat(self.twice[2]), p.z), p.z2)
    }

    /// The same for points at one height.
    #[inline(always)]
    pub(super) fn rise(self, z: f32) -> f32 {
        self.twice[2] * z + z * z
    }
}

/// A face at a node; what the fields mean depends on the kind.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeFace {
    pub kind: Kind,
    pub part: u8,
    /// Plane: sign. Cone: nᵣ. Ring: radius of the disc.
    pub a: f32,
    /// Cone: n₂. Ring: z of the centre.
    pub b: f32,
    /// Plane, cone: offset. Ball, ring: radius.
    pub c: f32,
    /// Ball: square distance to the centre.
    pub square: Square,
}

/// The tool's faces as a node sees them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    pub faces: [NodeFace; MAX_FLAT],
    pub count: usize,
    /// z of the base, from the foot.
    pub z0: f32,
    pub axis: [f32; 3],
    /// Square distance to the foot.
    pub square: Square,
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

    /// Signed distance at points (r, z); a ball's is read from the square distance `q` to its centre.
    #[inline(always)]
    pub(super) fn distance<L: Lanes>(&self, l: L, (r, z): (L::F, L::F), q: L::F) -> L::F {
        let (a, b, c) = (l.splat(self.a), l.splat(self.b), l.splat(self.c));
        match self.kind {
            Kind::Plane => l.sub(l.mul(a, z), c),
            Kind::Cone => self.cone(l, (r, z)),
            Kind::Ball => l.sub(root(l, q), c),
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
    /// Signed distance to a cone or cylinder.
    #[inline(always)]
    pub(super) fn cone<L: Lanes>(&self, l: L, (r, z): (L::F, L::F)) -> L::F {
        let slant = l.add(l.mul(l.splat(self.a), r), l.mul(l.splat(self.b), z));
        l.sub(slant, l.splat(self.c))
    }
}

impl Node {
    /// A node without faces, to be entered: made once a job, since its arrays are long.
    pub(super) fn empty() -> Self {
        Self {
            faces: [NodeFace::NONE; MAX_FLAT],
            count: 0,
            z0: 0.0,
            axis: [0.0; 3],
            square: Square::ZERO,
            needs_r: false,
        }
    }

    /// Becomes the brick whose first voxel lies at `o` in the chunk's node, with the faces in `active`
    /// (one bit each).
    #[inline(always)]
    pub(super) fn enter(&mut self, chunk: &Self, o: [f32; 3], active: u32) {
        let a = chunk.axis;
        self.count = 0;
        self.z0 = chunk.z0 + ((a[0] * o[0] + a[1] * o[1]) + a[2] * o[2]);
        self.axis = a;
        self.square = chunk.square.moved(o);
        self.needs_r = false;
        let mut active = active;
        while active != 0 {
            let face = &chunk.faces[(active.trailing_zeros() as usize) % MAX_FLAT];
            active &= active - 1;
            let own = &mut self.faces[self.count % MAX_FLAT];
            *own = *face;
            if face.kind == Kind::Ball {
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
        let x = l.add(l.splat(self.z0), l.mul(l.splat(self.axis[0]), p.x));
        let y = l.add(x, l.mul(l.splat(self.axis[1]), p.y));
        let z = l.add(y, l.mul(l.splat(self.axis[2]), p.z));
        if !self.needs_r {
            return (z, z);
        }
        let q = l.add(self.square.flat(l, p), self.square.rises(l, p));
        (root(l, l.sub(q, l.mul(z, z))), z)
    }

    /// The parts of z and of the square distance to the foot that do not depend on δ.z.
    #[inline(always)]
    pub(super) fn flat<L: Lanes>(&self, l: L, p: &Points<L::F>) -> [L::F; 2] {
        let x = l.add(l.splat(self.z0), l.mul(l.splat(self.axis[0]), p.x));
        let z = l.add(x, l.mul(l.splat(self.axis[1]), p.y));
        [z, self.square.flat(l, p)]
    }

    /// (r, z) at `height` above the points of [`Self::flat`]; r only where a face needs it.
    #[inline(always)]
    pub(super) fn rise<L: Lanes>(&self, l: L, [z, q]: [L::F; 2], height: f32) -> (L::F, L::F) {
        let z = l.add(z, l.splat(self.axis[2] * height));
        if !self.needs_r {
            return (z, z);
        }
        let q = l.add(q, l.splat(self.square.rise(height)));
        (root(l, l.sub(q, l.mul(z, z))), z)
    }
}
