//! What the stamp before leaves to do.
//!
//! The cut holds the smallest of all distances so far, that of the last stamp among them. Where the tool
//! has not come nearer since, there is nothing to do: over a box where every face that could decide at
//! the last pose has risen, the new distance is not less than the last one. In a press more than half of
//! the bricks are such.
//!
//! A face's rise over a box of half edges b about c, from the last pose (0) to this one (1), is at least
//!
//! * plane: (z₁ − z₀)(c) − Σ bₖ |a₁ − a₀|ₖ, times its sign;
//! * ball: (q₁ − q₀)/(|w₁| + |w₀|), q₁ − q₀ being linear, as the radii are the same;
//! * cone, cylinder: nᵣ (s₁ − s₀)/(r₁ + r₀) + n₂ (z₁ − z₀), s = r², whose difference bends by at most
//!   2 |a₁ − a₀|;
//! * wide faces: the rise of e, whose slope is that of the distance to a fifth;
//! * ring: not known.
//!
//! [`Since::margin`] is left for the rounding of both distances, so a box that is passed over holds no
//! value that could become smaller.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "lengths become f32 with room to spare; lanes must melt into the job"
)]

use super::bounds::{Deciding, Extent};
use super::node::{Node, Points, Square};
use super::placed::{Kind, MAX_FLAT, Placed};
use crate::lanes::Lanes;
use glam::DVec3;

/// A tool that moved farther than this share of a voxel since is looked at everywhere.
const FAR: f64 = 0.5;
/// One over the least slope of a wide face's distance over e.
const STEEP: f32 = 1.25;
/// Boxes nearer to the axis than this share of a voxel are looked at: r is not exact there.
const AXIS: f64 = 0.25;

/// The last stamp, and how far the tool is from there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Since<'a> {
    last: &'a Placed,
    // farthest that a point of the tool moved, and how far its axis turned
    moved: f32,
    turned: f32,
    margin: f32,
    band: f32,
    axis_radius: f32,
}

impl<'a> Since<'a> {
    /// From `last` to `now`, for points in the box of the bone frame (`lo`, `hi`, units). `None` where
    /// the last stamp says nothing: another tool, or too far away.
    pub(super) fn new(last: &'a Placed, now: &Placed, (lo, hi): (DVec3, DVec3)) -> Option<Self> {
        if !now.is_the_tool_of(last) {
            return None;
        }
        let turned = (now.axis() - last.axis()).length();
        let apex = last.apex();
        let far = (lo - apex).abs().max((hi - apex).abs()).length();
        let moved = (now.apex() - apex).length() + turned * far;
        let voxel = now.spacing.min_element();
        (moved <= FAR * voxel).then_some(Self {
            last,
            moved: (1.001 * moved) as f32 + 1.0,
            turned: (1.001 * turned) as f32,
            margin: 2.0 * now.slack,
            band: now.band,
            axis_radius: (AXIS * voxel) as f32,
        })
    }

    /// Moves the last pose's node to a chunk whose first voxel's number is `first`, its middle
    /// `half` beyond.
    #[inline(always)]
    pub(super) fn enter(&self, node: &mut Node, first: [usize; 3], half: DVec3) {
        self.last.enter(node, self.last.apex_to(first) + half);
    }

    /// Farthest that a point of the tool moved, units.
    pub(super) fn moved(&self) -> f32 {
        self.moved
    }

    /// Of the boxes in `todo` about the points `p` of this pose's node and the last one's, those where
    /// the tool may have come nearer. `deciding` has where a face can decide at this pose or the last.
    #[inline(always)]
    pub(super) fn nearer<L: Lanes>(
        &self,
        l: L,
        (now, last): (&Node, &Node),
        (p, extent, deciding): (&Points<L::F>, &Extent, &Deciding),
        todo: u16,
    ) -> u16 {
        let polar = [now.polar(l, p), last.polar(l, p)];
        let mut held = todo;
        for n in 0..now.count {
            let decides = deciding[n % MAX_FLAT] & held;
            if decides == 0 {
                continue;
            }
            let risen = match now.faces[n].kind {
                Kind::Plane => self.plane(l, (now, last), n, polar, extent),
                Kind::Ball => self.ball(l, (now, last), n, (p, extent)),
                Kind::Cone => self.cone(l, (now, last), n, polar, (p, extent)),
                Kind::WideBall => self.wide_ball(l, (now, last), n, (p, extent)),
                Kind::WideCylinder => self.wide_cylinder(l, (now, last), n, polar, (p, extent)),
                Kind::Ring => 0,
            };
            held &= risen | !decides;
            if held == 0 {
                break;
            }
        }
        todo & !held
    }

    #[inline(always)]
    fn plane<L: Lanes>(
        &self,
        l: L,
        (now, last): (&Node, &Node),
        n: usize,
        [(_, z1), (_, z0)]: [(L::F, L::F); 2],
        extent: &Extent,
    ) -> u16 {
        let (a, c) = (now.faces[n].a, now.faces[n].c - last.faces[n].c);
        let rise = l.mul(l.splat(a), l.sub(z1, z0));
        let least = c + extent.reach(difference(now.frame.axis, last.frame.axis)) + self.margin;
        l.le(l.splat(least), rise)
    }

    #[inline(always)]
    fn ball<L: Lanes>(
        &self,
        l: L,
        (now, last): (&Node, &Node),
        n: usize,
        (p, extent): (&Points<L::F>, &Extent),
    ) -> u16 {
        let (s1, s0) = (&now.faces[n].square, &last.faces[n].square);
        // beyond the band outside the new ball nothing can be lowered
        let most = 2.0 * (now.faces[n].c + self.band) + self.moved;
        let least = extent.reach(difference(s1.twice, s0.twice)) + self.margin * most;
        l.le(l.splat(least), risen(l, s1, s0, p))
    }

    #[inline(always)]
    fn wide_ball<L: Lanes>(
        &self,
        l: L,
        (now, last): (&Node, &Node),
        n: usize,
        (p, extent): (&Points<L::F>, &Extent),
    ) -> u16 {
        let (s1, s0) = (&now.faces[n].square, &last.faces[n].square);
        let least = extent.reach(difference(s1.twice, s0.twice)) + STEEP * self.margin;
        l.le(l.splat(least), risen(l, s1, s0, p))
    }

    #[inline(always)]
    fn wide_cylinder<L: Lanes>(
        &self,
        l: L,
        (now, last): (&Node, &Node),
        n: usize,
        [(_, z1), (_, z0)]: [(L::F, L::F); 2],
        (p, extent): (&Points<L::F>, &Extent),
    ) -> u16 {
        let (f1, f0) = (&now.faces[n], &last.faces[n]);
        let share = f1.square.share;
        let up = l.mul(l.sub(z1, z0), l.add(z1, z0));
        let rise = l.sub(
            risen(l, &f1.square, &f0.square, p),
            l.mul(l.splat(share), up),
        );
        let g1 = now.frame.steepness(l, &f1.square, p, z1);
        let g0 = last.frame.steepness(l, &f0.square, p, z0);
        let turn = [
            l.sub(g1[0], g0[0]),
            l.sub(g1[1], g0[1]),
            l.sub(g1[2], g0[2]),
        ];
        let least = share * extent.square() * self.turned + STEEP * self.margin;
        l.le(l.add(extent.along(l, turn), l.splat(least)), rise)
    }

    #[inline(always)]
    fn cone<L: Lanes>(
        &self,
        l: L,
        (now, last): (&Node, &Node),
        n: usize,
        [(r1, z1), (r0, z0)]: [(L::F, L::F); 2],
        (p, extent): (&Points<L::F>, &Extent),
    ) -> u16 {
        let face = &now.faces[n];
        let up = l.sub(z1, z0);
        let q = risen(l, &now.frame.square, &last.frame.square, p);
        let s = l.sub(q, l.mul(up, l.add(z1, z0)));
        let (w1, w0) = (now.frame.across(l, p, z1), last.frame.across(l, p, z0));
        let turn = [
            l.sub(w1[0], w0[0]),
            l.sub(w1[1], w0[1]),
            l.sub(w1[2], w0[2]),
        ];
        let along = extent.along(l, turn);
        let bend = l.splat(extent.square() * self.turned);
        let least = l.sub(s, l.add(l.add(along, along), bend));
        let sum = l.add(r1, r0);
        let width = l.splat(2.0 * extent.radius());
        let (most, fewest) = (l.add(sum, width), l.sub(sum, width));
        let off = l.le(l.splat(2.0 * self.axis_radius), fewest);
        let fewest = l.max(fewest, l.splat(1.0));
        let out = l.min(l.div(least, most), l.div(least, fewest));
        let slant = l.add(l.mul(l.splat(face.a), out), l.mul(l.splat(face.b), up));
        let tilt = face.b.abs() * extent.reach(difference(now.frame.axis, last.frame.axis));
        let needed = (face.c - last.faces[n].c) + tilt + self.margin;
        l.le(l.splat(needed), slant) & off
    }
}

fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The difference of two square distances, which is linear.
#[inline(always)]
fn risen<L: Lanes>(l: L, now: &Square, last: &Square, p: &Points<L::F>) -> L::F {
    let t = difference(now.twice, last.twice);
    let x = l.add(l.splat(now.base - last.base), l.mul(l.splat(t[0]), p.x));
    let y = l.add(x, l.mul(l.splat(t[1]), p.y));
    l.add(y, l.mul(l.splat(t[2]), p.z))
}
