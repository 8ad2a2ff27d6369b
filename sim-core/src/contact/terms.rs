//! The elements' terms in the minimisation, kept in columns so that a step over all is cheap.

use super::{Resistance, YIELD_EPS_MM};
use core::ops::{Add, Mul, Sub};
use glam::DVec3;

/// A small rigid motion, or a force along one: shift (mm or N), and turn times the turning radius (the
/// same unit).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Shift of the tool's origin.
    pub shift: DVec3,
    /// Turn about it, times the turning radius.
    pub turn: DVec3,
}

/// One element's term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// Unit normal: how a shift brings the element into the bone.
    pub normal: DVec3,
    /// The same for a turn, per turning radius.
    pub lever: DVec3,
    /// s = normal·shift + lever·turn + offset, mm.
    pub offset: f64,
    /// Area, mm², and resistance of a cutting element.
    pub cut: Option<(f64, Resistance)>,
    /// Stiffness of a rigid one, N/mm.
    pub rigid: f64,
}

/// Terms at most. Tools are made with at most [`crate::tool::MAX_ELEMENTS`]; a study of more of them may go
/// up to this.
pub const MAX_TERMS: usize = 5120;

/// All terms. At most [`MAX_TERMS`]; allocates only when made.
#[derive(Debug, Clone)]
pub struct Terms {
    // normal and lever
    rows: Vec<[f64; 6]>,
    offset: Vec<f64>,
    // Y, N
    yield_n: Vec<f64>,
    // N·s/mm of a cutting element
    drag: Vec<f64>,
    // N/mm: that of a rigid element, or the drag over the time of the step
    viscous: Vec<f64>,
    // real tool: N/mm, N·mm; and the vibration's share
    energy: Vec<f64>,
    edge: Vec<f64>,
    vibration: Vec<f64>,
    // scratch of the solver: s, and its slope along a direction
    pub(super) s: Vec<f64>,
    pub(super) slope: Vec<f64>,
}

impl Motion {
    /// No motion.
    pub const ZERO: Self = Self {
        shift: DVec3::ZERO,
        turn: DVec3::ZERO,
    };

    /// Of six numbers.
    pub fn from_array([a, b, c, d, e, f]: [f64; 6]) -> Self {
        Self {
            shift: DVec3::new(a, b, c),
            turn: DVec3::new(d, e, f),
        }
    }

    /// As six numbers.
    pub fn to_array(self) -> [f64; 6] {
        let (a, b) = (self.shift, self.turn);
        [a.x, a.y, a.z, b.x, b.y, b.z]
    }

    /// Scalar product.
    pub fn dot(self, other: Self) -> f64 {
        self.shift.dot(other.shift) + self.turn.dot(other.turn)
    }

    /// Length.
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// No NaN and no infinity.
    pub fn is_finite(self) -> bool {
        self.shift.is_finite() && self.turn.is_finite()
    }
}

impl Add for Motion {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            shift: self.shift + other.shift,
            turn: self.turn + other.turn,
        }
    }
}

impl Sub for Motion {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self {
            shift: self.shift - other.shift,
            turn: self.turn - other.turn,
        }
    }
}

impl Mul<f64> for Motion {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self {
            shift: self.shift * factor,
            turn: self.turn * factor,
        }
    }
}

/// What the elements did in a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deed {
    /// Work of the hand on the bone, mJ at the stylus.
    pub hand_mj: f64,
    /// Work of the spindle, mJ at a real tool, but for the edges' friction.
    pub spindle_mj: f64,
    /// Spindle torque of the edges' friction, N·mm at a real tool.
    pub edge_nmm: f64,
    /// Vibration, N at the stylus: Σ share × normal force.
    pub vibration_n: f64,
}

impl Terms {
    /// Room for every element of any tool.
    pub fn new() -> Self {
        let column = || Vec::with_capacity(MAX_TERMS);
        Self {
            rows: Vec::with_capacity(MAX_TERMS),
            offset: column(),
            yield_n: column(),
            drag: column(),
            viscous: column(),
            energy: column(),
            edge: column(),
            vibration: column(),
            s: column(),
            slope: column(),
        }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.rows.clear();
        for column in [
            &mut self.offset,
            &mut self.yield_n,
            &mut self.drag,
            &mut self.viscous,
            &mut self.energy,
            &mut self.edge,
            &mut self.vibration,
            &mut self.s,
            &mut self.slope,
        ] {
            column.clear();
        }
    }

    /// Number of terms.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// One more; beyond [`MAX_TERMS`] it is left out.
    pub fn push(&mut self, term: &Term) {
        if self.rows.len() >= MAX_TERMS {
            return;
        }
        let (n, l) = (term.normal, term.lever);
        self.rows.push([n.x, n.y, n.z, l.x, l.y, l.z]);
        self.offset.push(term.offset);
        self.viscous.push(term.rigid);
        self.s.push(0.0);
        self.slope.push(0.0);
        let part = |of: fn(&Resistance) -> f64| term.cut.map_or(0.0, |(area, law)| area * of(&law));
        self.yield_n.push(part(|law| law.yield_n_per_mm2));
        self.drag.push(part(|law| law.viscous_n_s_per_mm3));
        self.energy.push(part(|law| law.energy_n_per_mm2));
        self.edge.push(part(|law| law.edge_nmm_per_mm2));
        self.vibration
            .push(term.cut.map_or(0.0, |(_, law)| law.vibration));
    }

    /// Sets the time, s, within which cutting elements move.
    pub fn set_time(&mut self, time_s: f64) {
        for (viscous, drag) in self.viscous.iter_mut().zip(&self.drag) {
            if *drag > 0.0 {
                *viscous = drag / time_s;
            }
        }
    }

    fn depth(&self, i: usize, x: [f64; 6]) -> f64 {
        along(&self.rows[i], x) + self.offset[i]
    }

    /// s of every term at `x` into the scratch.
    pub(super) fn place(&mut self, x: [f64; 6]) {
        for ((s, row), offset) in self.s.iter_mut().zip(&self.rows).zip(&self.offset) {
            *s = along(row, x) + offset;
        }
    }

    /// Slope of every s along `d` into the scratch.
    pub(super) fn direct(&mut self, d: [f64; 6]) {
        for (slope, row) in self.slope.iter_mut().zip(&self.rows) {
            *slope = along(row, d);
        }
    }

    /// Energy at `x`, N·mm.
    pub fn energy(&self, motion: &Motion) -> f64 {
        let x = motion.to_array();
        (0..self.len())
            .map(|i| {
                let s = self.depth(i, x);
                if s > 0.0 {
                    self.yield_n[i] * corner(s).0 + 0.5 * self.viscous[i] * s * s
                } else {
                    0.0
                }
            })
            .sum()
    }

    /// Gradient, N, and curvature, N/mm (lower triangle), at the scratch's s.
    pub(super) fn derivatives(&self, gradient: &mut [f64; 6], hessian: &mut [[f64; 6]; 6]) {
        for (i, row) in self.rows.iter().enumerate() {
            let s = self.s[i];
            if s <= 0.0 {
                continue;
            }
            let (_, slope, curvature) = corner(s);
            let force = self.yield_n[i] * slope + self.viscous[i] * s;
            let stiffness = self.yield_n[i] * curvature + self.viscous[i];
            for a in 0..6 {
                gradient[a] += row[a] * force;
                let weighted = row[a] * stiffness;
                for b in 0..6 {
                    hessian[a][b] += weighted * row[b];
                }
            }
        }
    }

    /// Slope and curvature of the energy along the scratch's direction, `t` of the way from the
    /// scratch's s.
    pub(super) fn along(&self, t: f64) -> (f64, f64) {
        let (mut first, mut second) = (0.0, 0.0);
        for i in 0..self.len() {
            let s = self.s[i] + t * self.slope[i];
            if s > 0.0 {
                let (_, slope, curvature) = corner(s);
                first += (self.yield_n[i] * slope + self.viscous[i] * s) * self.slope[i];
                second +=
                    (self.yield_n[i] * curvature + self.viscous[i]) * self.slope[i] * self.slope[i];
            }
        }
        (first, second)
    }

    /// The longest way, mm, that a cutting element goes into bone on a motion.
    pub fn advance_mm(&self, motion: &Motion) -> f64 {
        let x = motion.to_array();
        (0..self.len())
            .filter(|&i| self.yield_n[i] > 0.0)
            .map(|i| self.depth(i, x))
            .fold(0.0, f64::max)
    }

    /// A motion below yield without the regularised corner's creep: what goes into gripped bone is
    /// taken out, so that the proxy sticks exactly.
    pub fn without_creep(&self, motion: Motion) -> Motion {
        if motion.length() <= 4.0 * YIELD_EPS_MM {
            return Motion::ZERO;
        }
        let mut x = motion.to_array();
        for _ in 0..3 {
            for i in (0..self.len()).filter(|&i| self.yield_n[i] > 0.0) {
                let s = self.depth(i, x);
                if s > 0.0 {
                    let row = &self.rows[i];
                    let back = s / along(row, *row);
                    for a in 0..6 {
                        x[a] -= row[a] * back;
                    }
                }
            }
        }
        Motion::from_array(x)
    }

    /// What the elements do on a motion within the time that was set.
    pub fn deed(&self, motion: &Motion) -> Deed {
        let x = motion.to_array();
        let mut deed = Deed::default();
        for i in 0..self.len() {
            let s = self.depth(i, x);
            if s <= 0.0 {
                continue;
            }
            let force = self.yield_n[i] * corner(s).1 + self.viscous[i] * s;
            deed.edge_nmm += self.edge[i];
            deed.vibration_n += self.vibration[i] * force;
            if self.yield_n[i] > 0.0 {
                deed.hand_mj += force * s;
                deed.spindle_mj += self.energy[i] * s;
            }
        }
        deed
    }
}

impl Default for Terms {
    fn default() -> Self {
        Self::new()
    }
}

fn along(row: &[f64; 6], x: [f64; 6]) -> f64 {
    (row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
        + (row[3] * x[3] + row[4] * x[4] + row[5] * x[5])
}

// value, slope and curvature of the regularised corner at s > 0
fn corner(s: f64) -> (f64, f64, f64) {
    if s < YIELD_EPS_MM {
        (
            0.5 * s * s / YIELD_EPS_MM,
            s / YIELD_EPS_MM,
            1.0 / YIELD_EPS_MM,
        )
    } else {
        (s - 0.5 * YIELD_EPS_MM, 1.0, 0.0)
    }
}
