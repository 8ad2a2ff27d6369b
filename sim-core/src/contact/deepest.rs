//! The deepest point of an element's facet, and what a small motion does to its depth.
//!
//! Bone touches a smooth face where the face is deepest. On smooth bone that is where the two are
//! parallel, and the field's slope there is the face's normal. At an edge or a corner of the bone the
//! field has a crease: its slope jumps from one flank's to the other's, neither of which the contact can
//! push along (a ball on a knife's edge would be held by the knife's flank, hooked). What pushes is a
//! mean of the slopes on the sides that has no part along the face: the optimality condition of the
//! deepest point. It is found by going uphill in at most [`PASSES`] directions, each the shortest mean of
//! the slopes met so far (as bundle methods do), and by cutting planes (Kelley) along each. Where the deepest
//! point lies at an end of the facet at which the tool's surface goes on, a neighbour's is deeper, and what
//! is left along the face says no more than how far away that one is. Where the end is an edge of the
//! tool, it stays: a tool's rim pushes along the normal of smooth bone.

use crate::sample::Sampler;
use crate::tool::Facet;
use glam::{DVec2, DVec3};

/// Directions searched.
const PASSES: u32 = 6;
/// Cuts of each at most; fewer where the deepest point cannot be deeper than the one found by more than
/// [`CLOSE_MM`].
const CUTS: u32 = 6;
const CLOSE_MM: f64 = 1e-3;
/// A slope along the face below this is none.
const LEVEL: f64 = 0.01;
/// A room below this is none, mm.
const LEAST_MM: f64 = 0.01;
/// A mean gradient shorter than this is one over a crease (a distance's own has length 1): there the field is no
/// roof of planes between the voxels, and the last of the way is looked for in [`RINGS`] ever smaller rings.
const CREASED: f64 = 0.85;
const RINGS: u32 = 5;
/// Creased facets at most that are looked at so closely in a step: a bound on the time.
pub(super) const CREASES: u32 = 24;
/// Bone that leans on a face by less than this share of its slope is beside or behind it: it holds the
/// less, and where it faces the other way not at all. What is in front holds.
const LEANING: f64 = 0.2;

/// A facet in the bone.
pub(super) struct Face<'a> {
    pub(super) sampler: Sampler<'a>,
    pub(super) facet: &'a Facet,
    /// The element's place, bone frame, mm.
    pub(super) origin: DVec3,
    pub(super) along: DVec3,
    pub(super) across: DVec3,
    pub(super) normal: DVec3,
}

/// A point of a facet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    // place on the facet, mm
    at: DVec2,
    /// Depth in the bone, mm.
    pub(super) depth: f64,
    // how a shift of the tool changes the depth
    gradient: DVec3,
}

impl Face<'_> {
    /// The point of a spot, bone frame, mm.
    pub(super) fn point(&self, spot: &Spot) -> DVec3 {
        self.place(spot.at)
    }

    fn place(&self, at: DVec2) -> DVec3 {
        let [ku, kv] = self.facet.curvature.map(f64::from);
        let sag = 0.5 * (ku * at.x * at.x + kv * at.y * at.y);
        self.origin + self.along * at.x + self.across * at.y - self.normal * sag
    }

    fn read(&self, at: DVec2) -> Spot {
        let fields = self.sampler.fields(self.place(at));
        Spot {
            at,
            depth: f64::from(fields.depth()),
            gradient: fields.gradient.as_dvec3(),
        }
    }

    /// The element's own point.
    pub(super) fn middle(&self) -> Spot {
        self.read(DVec2::ZERO)
    }

    // how the depth rises along the face
    fn slopes(&self, spot: &Spot) -> DVec2 {
        let [bent_u, bent_v] = self.bends(spot);
        let g = spot.gradient;
        let steep = g.dot(self.normal);
        DVec2::new(
            g.dot(self.along) - bent_u * steep,
            g.dot(self.across) - bent_v * steep,
        )
    }

    /// Whether any point of the facet could be as deep as `depth`, were the bone convex.
    pub(super) fn may_reach(&self, middle: &Spot, depth: f64) -> bool {
        let slope = self.slopes(middle);
        let length = slope.length();
        let room = if length > LEVEL {
            self.facet.room(DVec2::ZERO, slope / length)
        } else {
            0.0
        };
        middle.depth + length * room >= depth
    }

    /// How a shift of the tool changes the depth at the facet's deepest point, and the share of its
    /// stiffness with which the facet holds.
    pub(super) fn push(&self, spot: &Spot) -> (DVec3, f64) {
        let g = spot.gradient;
        let [bent_u, bent_v] = self.bends(spot);
        let normal = (self.normal + self.along * bent_u + self.across * bent_v).normalize_or_zero();
        let steep = g.dot(normal);
        let mut push = normal * steep;
        let slopes = self.slopes(spot);
        for (axis, way, bend) in [(0, self.along, bent_u), (1, self.across, bent_v)] {
            let (at, slope) = (spot.at[axis], slopes[axis]);
            let end = usize::from(slope > 0.0);
            let room = f64::from(self.facet.room_mm[axis][end]);
            if self.facet.edge[axis][end] && at.abs() >= room - LEAST_MM && at * slope >= 0.0 {
                let way = (way - self.normal * bend).normalize_or_zero();
                push += way * g.dot(way);
            }
        }
        // what is parallel pushes as the bone says: a face that is hardly off it must not push aside
        let off = (slopes.length() / LEVEL - 1.0) / 3.0;
        push += (g - push) * (1.0 - off.clamp(0.0, 1.0));
        let lean = steep / (LEANING * g.length().max(1e-9));
        (push, lean.clamp(0.0, 1.0))
    }

    // by how much the face's normal is tilted at a spot
    fn bends(&self, spot: &Spot) -> [f64; 2] {
        let [ku, kv] = self.facet.curvature.map(f64::from);
        [ku * spot.at.x, kv * spot.at.y]
    }

    /// The deepest point; its gradient is the mean that pushes there. `creases`: how many may be looked at
    /// closely.
    pub(super) fn deepest(&self, middle: Spot, creases: &mut u32) -> Spot {
        let mut best = middle;
        for _ in 0..PASSES {
            let slope = self.slopes(&best);
            let length = slope.length();
            if length < LEVEL {
                break;
            }
            let way = slope / length;
            let room = self.facet.room(best.at, way);
            if room < LEAST_MM {
                break;
            }
            best = self.climb(best, way, room);
        }
        if *creases > 0 && best.gradient.length() < CREASED {
            *creases -= 1;
            best = self.close_by(best);
        }
        best
    }

    /// The deepest of the points around a spot, in rings of eight.
    fn close_by(&self, from: Spot) -> Spot {
        let room = self.facet.room_mm;
        let lo = DVec2::new(-f64::from(room[0][0]), -f64::from(room[1][0]));
        let hi = DVec2::new(f64::from(room[0][1]), f64::from(room[1][1]));
        let mut best = from;
        let mut radius = 0.3 * (hi - lo).max_element();
        // an eighth of a turn, and less from ring to ring
        let eighth = DVec2::from_angle(core::f64::consts::FRAC_PI_4);
        let twist = DVec2::from_angle(0.3);
        let mut first = DVec2::X;
        for _ in 0..RINGS {
            let centre = best.at;
            let mut way = first;
            for _ in 0..8 {
                let at = (centre + way * radius).clamp(lo, hi);
                let spot = self.read(at);
                if spot.depth > best.depth {
                    (best.at, best.depth) = (at, spot.depth);
                }
                way = way.rotate(eighth);
            }
            first = first.rotate(twist);
            radius *= 0.5;
        }
        best
    }

    /// Uphill from a spot in a direction, as far as it goes up and `room` lasts. Where it has gone over a
    /// crease, the gradient is the least along the face that any mean of those on both sides has: it points
    /// along the crease, and at a corner nowhere.
    fn climb(&self, from: Spot, way: DVec2, room: f64) -> Spot {
        let slope = |spot: &Spot| self.slopes(spot).dot(way);
        let start = from.at;
        let (mut lo, mut lo_t, mut lo_m) = (from, 0.0, slope(&from));
        let (mut hi, mut hi_t) = (self.read(start + way * room), room);
        let mut hi_m = slope(&hi);
        if hi_m >= 0.0 {
            return if hi.depth > lo.depth { hi } else { lo };
        }
        for _ in 0..CUTS {
            // where the tangents meet: on a crease that is its very place
            let meet = (hi.depth - hi_m * hi_t - lo.depth + lo_m * lo_t) / (lo_m - hi_m);
            if lo.depth + lo_m * (meet - lo_t) - lo.depth.max(hi.depth) < CLOSE_MM {
                break;
            }
            let edge = 0.02 * (hi_t - lo_t);
            let t = meet.clamp(lo_t + edge, hi_t - edge);
            let spot = self.read(start + way * t);
            let m = slope(&spot);
            if m > 0.0 {
                (lo, lo_t, lo_m) = (spot, t, m);
            } else {
                (hi, hi_t, hi_m) = (spot, t, m);
            }
        }
        let sides = [from, lo, hi];
        let shares = least_mean(sides.map(|side| self.slopes(&side)));
        let mut gradient = DVec3::ZERO;
        for (side, share) in sides.iter().zip(shares) {
            gradient += side.gradient * share;
        }
        let deeper = if lo.depth > hi.depth { lo } else { hi };
        Spot { gradient, ..deeper }
    }
}

/// The shares of the shortest mean of three vectors.
fn least_mean([a, b, c]: [DVec2; 3]) -> [f64; 3] {
    let area = (b - a).perp_dot(c - a);
    if area.abs() > 1e-12 {
        let inside = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)].map(|part| part / area);
        if inside.iter().all(|share| *share >= 0.0) {
            return inside;
        }
    }
    let between = |p: DVec2, q: DVec2| {
        let t = (p.dot(p - q) / (p - q).length_squared().max(1e-12)).clamp(0.0, 1.0);
        (t, p.lerp(q, t).length_squared())
    };
    let (ab, bc, ca) = (between(a, b), between(b, c), between(c, a));
    if ab.1 <= bc.1 && ab.1 <= ca.1 {
        [1.0 - ab.0, ab.0, 0.0]
    } else if bc.1 <= ca.1 {
        [0.0, 1.0 - bc.0, bc.0]
    } else {
        [ca.0, 0.0, 1.0 - ca.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_mean_is_found() {
        let mean = |v: [DVec2; 3]| {
            let shares = least_mean(v);
            assert!(shares.iter().all(|s| *s >= 0.0));
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            v[0] * shares[0] + v[1] * shares[1] + v[2] * shares[2]
        };
        let v = |x: f64, y: f64| DVec2::new(x, y);
        // about the origin, beside it, and in a line with it
        assert!(mean([v(1.0, 0.0), v(-1.0, 1.0), v(-1.0, -2.0)]).length() < 1e-12);
        let beside = mean([v(1.0, 0.3), v(-1.0, 0.3), v(0.0, 2.0)]);
        assert!((beside - v(0.0, 0.3)).length() < 1e-12, "{beside}");
        assert!(mean([v(2.0, 0.0), v(2.0, 0.0), v(-1.0, 0.0)]).length() < 1e-12);
        let least = mean([v(0.5, 0.5), v(3.0, 0.0), v(0.0, 3.0)]);
        assert!((least - v(0.5, 0.5)).length() < 1e-12, "{least}");
    }
}
