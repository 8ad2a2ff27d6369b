//! The virtual coupling: a spring between device and proxy in place and in turn, each saturated.

use super::terms::Motion;
use glam::{DMat3, DVec3};

/// A spring that pulls no harder than its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saturating {
    /// N/mm.
    pub stiffness: f64,
    /// N.
    pub limit: f64,
}

/// Both springs, and how far apart device and proxy are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// Device − proxy.
    pub error: Motion,
    /// The spring in place and, by the turning radius, in turn.
    pub spring: Saturating,
}

/// Share of the stiffness that is kept along a saturated pull: the matrix stays regular, the minimum is
/// where it is.
const FLAT: f64 = 1e-3;

impl Saturating {
    /// Energy of a stretch of length `r` mm, N·mm.
    pub fn energy(self, r: f64) -> f64 {
        let knee = self.limit / self.stiffness;
        if r <= knee {
            0.5 * self.stiffness * r * r
        } else {
            self.limit * (r - 0.5 * knee)
        }
    }

    /// Pull along a stretch, N.
    pub fn pull(self, stretch: DVec3) -> DVec3 {
        let pull = stretch * self.stiffness;
        let length = pull.length();
        if length > self.limit {
            pull * (self.limit / length)
        } else {
            pull
        }
    }

    fn hessian(self, stretch: DVec3) -> DMat3 {
        let r = stretch.length();
        if r * self.stiffness <= self.limit {
            return DMat3::from_diagonal(DVec3::splat(self.stiffness));
        }
        let unit = stretch / r;
        let across = self.limit / r;
        let along = FLAT * self.stiffness - across;
        DMat3::from_diagonal(DVec3::splat(across))
            + DMat3::from_cols(
                unit * (unit.x * along),
                unit * (unit.y * along),
                unit * (unit.z * along),
            )
    }

    // a stretch beyond the knee by more than `room` pulls no otherwise than one at its end
    fn shorten(self, stretch: DVec3, room: f64) -> DVec3 {
        let longest = self.limit / self.stiffness + room;
        let r = stretch.length();
        if r > longest {
            stretch * (longest / r)
        } else {
            stretch
        }
    }
}

impl Coupling {
    /// A coupling for a step that is cut at `room` mm: a longer error is shortened to where the spring
    /// is saturated all along such a step. A limit below 0.05 N is taken as that: without it a proxy would
    /// not follow at all.
    pub fn new(error: Motion, stiffness: f64, limit_n: f64, room: f64) -> Self {
        let spring = Saturating {
            stiffness,
            limit: limit_n.max(0.05),
        };
        Self {
            error: Motion {
                shift: spring.shorten(error.shift, room),
                turn: spring.shorten(error.turn, room),
            },
            spring,
        }
    }

    /// Energy after a motion, N·mm.
    pub fn energy(&self, motion: &Motion) -> f64 {
        let left = self.error - *motion;
        self.spring.energy(left.shift.length()) + self.spring.energy(left.turn.length())
    }

    /// Its slope by the motion, N.
    pub fn gradient(&self, motion: &Motion) -> Motion {
        let left = self.error - *motion;
        Motion {
            shift: -self.spring.pull(left.shift),
            turn: -self.spring.pull(left.turn),
        }
    }

    /// Its curvature along a direction, N/mm × mm².
    pub(super) fn curvature(&self, motion: &Motion, along: &Motion) -> f64 {
        let [shift, turn] = self.hessian(motion);
        along.shift.dot(shift * along.shift) + along.turn.dot(turn * along.turn)
    }

    /// Its curvature by shift and by turn, N/mm.
    pub(super) fn hessian(&self, motion: &Motion) -> [DMat3; 2] {
        let left = self.error - *motion;
        [left.shift, left.turn].map(|stretch| self.spring.hessian(stretch))
    }
}
