//! The elements' terms in the minimisation, kept in columns of eights so that a step over all is cheap.
//!
//! Sums are kept in eight lanes and added up in one order, and nothing is fused, so the bits are the same on
//! every vector unit (`pulp` picks it at run time).

#![expect(clippy::inline_always, reason = "lanes must melt into the unit's job")]

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

/// Stiffness of the regularised corner per yield force, 1/mm.
const STEEP: f64 = 1.0 / YIELD_EPS_MM;
/// Terms are worked on in groups of this many.
const LANES: usize = 8;
/// Entries of a lower triangle of six rows.
const TRIANGLE: usize = 21;

/// All terms. At most [`MAX_TERMS`]; allocates only when made.
#[derive(Debug, Clone)]
pub struct Terms {
    unit: pulp::Arch,
    count: usize,
    // columns, filled up to a multiple of LANES with terms that nothing reaches; first normal and lever
    rows: [Vec<f64>; 6],
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
    // scratch: s, and its slope along a direction
    s: Vec<f64>,
    slope: Vec<f64>,
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
        let column = || Vec::with_capacity(MAX_TERMS.next_multiple_of(LANES));
        Self {
            unit: pulp::Arch::new(),
            count: 0,
            rows: [(); 6].map(|()| column()),
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

    fn columns(&mut self) -> [&mut Vec<f64>; 15] {
        let [a, b, c, d, e, f] = &mut self.rows;
        [
            a,
            b,
            c,
            d,
            e,
            f,
            &mut self.offset,
            &mut self.yield_n,
            &mut self.drag,
            &mut self.viscous,
            &mut self.energy,
            &mut self.edge,
            &mut self.vibration,
            &mut self.s,
            &mut self.slope,
        ]
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.count = 0;
        for column in self.columns() {
            column.clear();
        }
    }

    /// Number of terms.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True where there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// One more; beyond [`MAX_TERMS`] it is left out.
    pub fn push(&mut self, term: &Term) {
        let at = self.count;
        if at >= MAX_TERMS {
            return;
        }
        if at == self.offset.len() {
            for column in self.columns() {
                column.resize(at + LANES, 0.0);
            }
            self.offset[at..].fill(-1.0);
        }
        self.count += 1;
        let (n, l) = (term.normal, term.lever);
        for (column, value) in self.rows.iter_mut().zip([n.x, n.y, n.z, l.x, l.y, l.z]) {
            column[at] = value;
        }
        self.offset[at] = term.offset;
        self.viscous[at] = term.rigid;
        if let Some((area, law)) = &term.cut {
            self.yield_n[at] = area * law.yield_n_per_mm2;
            self.drag[at] = area * law.viscous_n_s_per_mm3;
            self.energy[at] = area * law.energy_n_per_mm2;
            self.edge[at] = area * law.edge_nmm_per_mm2;
            self.vibration[at] = law.vibration;
        }
    }

    /// Sets the time, s, within which cutting elements move.
    pub fn set_time(&mut self, time_s: f64) {
        for (viscous, drag) in self.viscous.iter_mut().zip(&self.drag) {
            if *drag > 0.0 {
                *viscous = drag / time_s;
            }
        }
    }

    /// s of every term after a motion, which [`Self::deed`] and [`Self::advance_mm`] are about.
    pub fn place(&mut self, motion: &Motion) {
        let (unit, x) = (self.unit, motion.to_array());
        let (rows, offset, s) = (&self.rows, &self.offset, &mut self.s);
        unit.dispatch(|| {
            combine(rows, x, s);
            for (s, offset) in s.iter_mut().zip(offset) {
                *s += offset;
            }
        });
    }

    /// Slope of every s along `d` into the scratch.
    pub(super) fn direct(&mut self, d: [f64; 6]) {
        let (unit, rows, slope) = (self.unit, &self.rows, &mut self.slope);
        unit.dispatch(|| combine(rows, d, slope));
    }

    fn depth(&self, i: usize, x: [f64; 6]) -> f64 {
        let row = self.row(i);
        dot(row, x) + self.offset[i]
    }

    fn row(&self, i: usize) -> [f64; 6] {
        [0, 1, 2, 3, 4, 5].map(|a| self.rows[a][i])
    }

    /// Energy where the terms are placed, N·mm.
    pub(super) fn energy_here(&self) -> f64 {
        self.sum_energy(&self.s)
    }

    /// Energy without any motion, N·mm.
    pub(super) fn energy_at_rest(&self) -> f64 {
        self.sum_energy(&self.offset)
    }

    fn sum_energy(&self, s: &[f64]) -> f64 {
        let mut sums = [0.0; LANES];
        self.unit.dispatch(|| {
            let groups = s.as_chunks::<LANES>().0.iter();
            let yields = self.yield_n.as_chunks::<LANES>().0;
            let viscous = self.viscous.as_chunks::<LANES>().0;
            for ((s, y), v) in groups.zip(yields).zip(viscous) {
                for l in 0..LANES {
                    let energy = y[l] * corner(s[l]).0 + 0.5 * v[l] * s[l] * s[l];
                    sums[l] += if s[l] > 0.0 { energy } else { 0.0 };
                }
            }
        });
        total(sums)
    }

    /// Gradient, N, and curvature, N/mm (lower triangle), where the terms are placed.
    pub(super) fn derivatives(&self, gradient: &mut [f64; 6], hessian: &mut [[f64; 6]; 6]) {
        let mut first = [[0.0; LANES]; 6];
        let mut second = [[0.0; LANES]; TRIANGLE];
        self.unit
            .dispatch(|| self.sum_derivatives(&mut first, &mut second));
        let mut entry = second.into_iter();
        for (a, sums) in first.into_iter().enumerate() {
            gradient[a] += total(sums);
            for (b, sums) in entry.by_ref().take(a + 1).enumerate() {
                hessian[a][b] += total(sums);
            }
        }
    }

    #[inline(always)]
    fn sum_derivatives(
        &self,
        first: &mut [[f64; LANES]; 6],
        second: &mut [[f64; LANES]; TRIANGLE],
    ) {
        let rows = self.rows.each_ref().map(|row| row.as_chunks::<LANES>().0);
        let yields = self.yield_n.as_chunks::<LANES>().0;
        let viscous = self.viscous.as_chunks::<LANES>().0;
        for (n, s) in self.s.as_chunks::<LANES>().0.iter().enumerate() {
            if s.iter().all(|s| *s <= 0.0) {
                continue;
            }
            let (mut force, mut stiffness) = ([0.0; LANES], [0.0; LANES]);
            for l in 0..LANES {
                let (_, slope, curvature) = corner(s[l]);
                let (f, k) = (
                    yields[n][l] * slope + viscous[n][l] * s[l],
                    yields[n][l] * curvature + viscous[n][l],
                );
                force[l] = if s[l] > 0.0 { f } else { 0.0 };
                stiffness[l] = if s[l] > 0.0 { k } else { 0.0 };
            }
            let mut at = 0;
            for a in 0..6 {
                let row = &rows[a][n];
                let mut weighted = [0.0; LANES];
                for l in 0..LANES {
                    first[a][l] += row[l] * force[l];
                    weighted[l] = row[l] * stiffness[l];
                }
                for other in &rows[..=a] {
                    for l in 0..LANES {
                        second[at][l] += weighted[l] * other[n][l];
                    }
                    at += 1;
                }
            }
        }
    }

    /// Slope and curvature of the energy along the scratch's direction, `t` of the way from where the
    /// terms are placed.
    pub(super) fn along(&self, t: f64) -> (f64, f64) {
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        self.unit.dispatch(|| {
            let yields = self.yield_n.as_chunks::<LANES>().0;
            let viscous = self.viscous.as_chunks::<LANES>().0;
            let slopes = self.slope.as_chunks::<LANES>().0;
            for (n, s) in self.s.as_chunks::<LANES>().0.iter().enumerate() {
                for l in 0..LANES {
                    let (d, y, v) = (slopes[n][l], yields[n][l], viscous[n][l]);
                    let s = s[l] + t * d;
                    let (_, slope, curvature) = corner(s);
                    let f = (y * slope + v * s) * d;
                    let k = (y * curvature + v) * d * d;
                    first[l] += if s > 0.0 { f } else { 0.0 };
                    second[l] += if s > 0.0 { k } else { 0.0 };
                }
            }
        });
        (total(first), total(second))
    }

    /// The longest way, mm, that a cutting element goes into bone, where the terms are placed.
    pub fn advance_mm(&self) -> f64 {
        let ways = self.s.iter().zip(&self.yield_n);
        ways.filter(|(_, y)| **y > 0.0)
            .fold(0.0, |most: f64, (s, _)| most.max(*s))
    }

    /// Whether a term's cutting element goes into bone by more than `least` mm, where the terms are
    /// placed.
    pub(super) fn cuts(&self, i: usize, least: f64) -> bool {
        self.yield_n[i] > 0.0 && self.s[i] > least
    }

    /// A motion below yield without the regularised corner's creep: what goes into gripped bone is
    /// taken out, so that the proxy sticks exactly.
    pub fn without_creep(&self, motion: Motion) -> Motion {
        if motion.length() <= 4.0 * YIELD_EPS_MM {
            return Motion::ZERO;
        }
        let mut x = motion.to_array();
        for _ in 0..3 {
            for i in (0..self.count).filter(|&i| self.yield_n[i] > 0.0) {
                let s = self.depth(i, x);
                if s > 0.0 {
                    let row = self.row(i);
                    let back = s / dot(row, row);
                    for a in 0..6 {
                        x[a] -= row[a] * back;
                    }
                }
            }
        }
        Motion::from_array(x)
    }

    /// What the elements do on the motion that the terms are placed after, within the time that was set.
    pub fn deed(&self) -> Deed {
        let mut deed = Deed::default();
        for (i, &s) in self.s.iter().enumerate().take(self.count) {
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

fn dot(row: [f64; 6], x: [f64; 6]) -> f64 {
    (row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
        + (row[3] * x[3] + row[4] * x[4] + row[5] * x[5])
}

// the same of all rows
#[inline(always)]
fn combine(rows: &[Vec<f64>; 6], x: [f64; 6], into: &mut [f64]) {
    let rows = rows.each_ref().map(|row| row.as_chunks::<LANES>().0);
    for (n, into) in into.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let [a, b, c, d, e, f] = rows.map(|row| &row[n]);
        for l in 0..LANES {
            into[l] = (a[l] * x[0] + b[l] * x[1] + c[l] * x[2])
                + (d[l] * x[3] + e[l] * x[4] + f[l] * x[5]);
        }
    }
}

// eight sums in one order
fn total(sums: [f64; LANES]) -> f64 {
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

// value, slope and curvature of the regularised corner at s > 0
#[inline(always)]
fn corner(s: f64) -> (f64, f64, f64) {
    if s < YIELD_EPS_MM {
        (0.5 * s * (s * STEEP), s * STEEP, STEEP)
    } else {
        (s - 0.5 * YIELD_EPS_MM, 1.0, 0.0)
    }
}
