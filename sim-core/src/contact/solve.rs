//! The minimum: semi-smooth Newton in six unknowns with an exact search along each step.
//!
//! The function is convex, once differentiable and quadratic in pieces, so along a line its slope rises
//! in straight pieces: the search brackets the zero of the slope and needs no constants. Bounds: at most
//! [`MAX_ITERATIONS`] steps, [`MAX_PROBES`] probes of a line each.

use super::coupling::Coupling;
use super::terms::{Motion, Terms};

/// Newton iterations at most.
pub const MAX_ITERATIONS: u32 = 60;
/// Length of the gradient at which the solver stops, N. Round-off may end it before; what is accepted is
/// 1e-4 N (a test holds it over random problems).
pub const RESIDUAL_N: f64 = 1e-6;
/// Probes of one line at most.
const MAX_PROBES: u32 = 40;
/// Longest Newton step, mm: longer ones, along a flat part of the coupling, would lose digits.
const LONGEST_MM: f64 = 200.0;

/// Result of one solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// Motion of the proxy.
    pub motion: Motion,
    /// Newton iterations.
    pub iterations: u32,
    /// Length of the gradient where it stopped, N.
    pub residual_n: f64,
}

struct Point {
    gradient: [f64; 6],
    hessian: [[f64; 6]; 6],
}

/// The minimum of coupling and terms, begun at the better of `guess` and rest.
pub(super) fn minimum(terms: &mut Terms, coupling: &Coupling, guess: &Motion) -> Solution {
    terms.place(guess);
    let begun = coupling.energy(guess) + terms.energy_here();
    let at_rest = coupling.energy(&Motion::ZERO) + terms.energy_at_rest();
    let mut motion = if guess.is_finite() && begun < at_rest {
        *guess
    } else {
        Motion::ZERO
    };
    let mut best = Solution {
        motion,
        iterations: 0,
        residual_n: f64::INFINITY,
    };
    for iterations in 0..=MAX_ITERATIONS {
        let point = derivatives(terms, coupling, &motion);
        let residual_n = Motion::from_array(point.gradient).length();
        if residual_n < best.residual_n {
            best = Solution {
                motion,
                iterations,
                residual_n,
            };
        }
        if residual_n < RESIDUAL_N || iterations == MAX_ITERATIONS {
            break;
        }
        let Some(step) = newton_step(&point) else {
            break;
        };
        let t = search(terms, coupling, &motion, &step);
        if t <= 0.0 {
            break; // round-off floor
        }
        motion = motion + step * t;
    }
    best
}

fn derivatives(terms: &mut Terms, coupling: &Coupling, motion: &Motion) -> Point {
    let mut hessian = [[0.0; 6]; 6];
    for (block, matrix) in coupling.hessian(motion).into_iter().enumerate() {
        let at = 3 * block;
        for (c, column) in [matrix.x_axis, matrix.y_axis, matrix.z_axis]
            .into_iter()
            .enumerate()
        {
            for (r, value) in column.to_array().into_iter().enumerate() {
                hessian[at + r][at + c] = value;
            }
        }
    }
    let mut gradient = coupling.gradient(motion).to_array();
    terms.place(motion);
    terms.derivatives(&mut gradient, &mut hessian);
    Point { gradient, hessian }
}

/// How far to go along `step`: where the slope of the energy is zero, at most all of it. Newton's rule
/// inside a bracket; where that does not halve it, the middle.
fn search(terms: &mut Terms, coupling: &Coupling, from: &Motion, step: &Motion) -> f64 {
    terms.direct(step.to_array());
    let slope = |t: f64| {
        let (first, second) = terms.along(t);
        let at = *from + *step * t;
        let own = coupling.gradient(&at).dot(*step);
        (first + own, second + coupling.curvature(&at, step))
    };
    let (start, _) = slope(0.0);
    if start >= 0.0 {
        return 0.0;
    }
    let (end, mut bend) = slope(1.0);
    // a Newton step that lands well is taken whole
    if end <= 1e-3 * -start {
        return 1.0;
    }
    let (mut lo, mut hi) = (0.0, 1.0);
    let (mut t, mut value) = (1.0, end);
    for _ in 0..MAX_PROBES {
        let before = hi - lo;
        let next = t - value / bend;
        t = if next > lo && next < hi {
            next
        } else {
            0.5 * (lo + hi)
        };
        (value, bend) = slope(t);
        if value.abs() <= 1e-6 * -start || before < 1e-15 {
            break;
        }
        if value > 0.0 {
            hi = t;
        } else {
            lo = t;
        }
        if hi - lo > 0.5 * before {
            t = 0.5 * (lo + hi);
            (value, bend) = slope(t);
            if value > 0.0 {
                hi = t;
            } else {
                lo = t;
            }
        }
    }
    t
}

// −H⁻¹ g by LDLᵀ, no longer than the trust region in shift or turn; None where H is not positive
fn newton_step(point: &Point) -> Option<Motion> {
    let h = &point.hessian;
    let mut l = [[0.0; 6]; 6];
    let mut d = [0.0; 6];
    for j in 0..6 {
        let mut pivot = h[j][j];
        for k in 0..j {
            pivot -= l[j][k] * l[j][k] * d[k];
        }
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        d[j] = pivot;
        for i in j + 1..6 {
            let mut value = h[i][j];
            for k in 0..j {
                value -= l[i][k] * l[j][k] * d[k];
            }
            l[i][j] = value / pivot;
        }
    }
    let mut x = point.gradient.map(|g| -g);
    for i in 0..6 {
        for k in 0..i {
            x[i] -= l[i][k] * x[k];
        }
    }
    for i in 0..6 {
        x[i] /= d[i];
    }
    for i in (0..6).rev() {
        for k in i + 1..6 {
            x[i] -= l[k][i] * x[k];
        }
    }
    let step = Motion::from_array(x);
    let length = step.shift.length().max(step.turn.length());
    if !step.is_finite() {
        return None;
    }
    Some(if length > LONGEST_MM {
        step * (LONGEST_MM / length)
    } else {
        step
    })
}

#[cfg(test)]
mod tests;
