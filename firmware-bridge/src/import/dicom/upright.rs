//! A tilted stack on an upright grid: each slice shifted within its own plane by what the tilt did.
//!
//! With a tilted gantry the table carries the patient past slices that are not at right angles to
//! its way: the origins of successive slices move within the plane. The slices themselves are true. So
//! each is shifted by −shear · height along its rows and columns, read by a Catmull-Rom cubic (exact
//! for quadratics), into a frame wide enough for all of them; nothing is interpolated across slices.
#![expect(
    clippy::cast_possible_wrap,
    reason = "places in a slice of at most a few thousand pixels"
)]

use super::order::Stack;
use rayon::prelude::*;

/// Air, HU: what lies outside of a shifted slice.
pub(crate) const OUTSIDE_HU: f32 = -1000.0;

/// How one plane is shifted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shift {
    // pixels that the slice is moved by, along a row and down a column; at least 0
    moved: [f64; 2],
    from: [usize; 2],
    to: [usize; 2],
}

/// The upright frame around a stack.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    /// Pixels along a row and down a column.
    pub(crate) dims: [usize; 2],
    /// Pixels by which the frame begins before the first slice, along a row and down a column.
    pub(crate) before: [usize; 2],
    // pixels a plane
    step: [f64; 2],
    from: [usize; 2],
}

impl Frame {
    /// The frame that holds every shifted slice of `stack`, the slices' own where there is no tilt.
    pub(crate) fn around(stack: &Stack) -> Self {
        let first = &stack.slices[0];
        let from = [first.stored.columns, first.stored.rows];
        if !stack.tilted() {
            return Self {
                dims: from,
                before: [0; 2],
                step: [0.0; 2],
                from,
            };
        }
        let step: [f64; 2] =
            core::array::from_fn(|a| stack.shear[a] * stack.spacing_mm / first.pixel_mm[a]);
        let last = (stack.planes - 1) as f64;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most a few thousand pixels: the tilt is below 45°"
        )]
        let reach = |v: f64| v.max(0.0).ceil() as usize;
        let before: [usize; 2] = core::array::from_fn(|a| reach(-step[a] * last));
        let after: [usize; 2] = core::array::from_fn(|a| reach(step[a] * last));
        Self {
            dims: core::array::from_fn(|a| from[a] + before[a] + after[a]),
            before,
            step,
            from,
        }
    }

    /// The shift of the plane at place `place`; `None` where nothing moves.
    pub(crate) fn shift(&self, place: usize) -> Option<Shift> {
        self.step.iter().any(|s| s.abs() > 0.0).then(|| Shift {
            moved: core::array::from_fn(|a| self.before[a] as f64 + self.step[a] * place as f64),
            from: self.from,
            to: self.dims,
        })
    }
}

impl Shift {
    /// The slice in the upright frame.
    pub(crate) fn apply(&self, slice: &[f32]) -> Vec<f32> {
        let [nx, ny] = self.from;
        let [mx, my] = self.to;
        let (x0, wx) = whole_and_weights(self.moved[0]);
        let (y0, wy) = whole_and_weights(self.moved[1]);
        // along the rows
        let mut wide = vec![OUTSIDE_HU; mx * ny];
        wide.par_chunks_mut(mx)
            .zip(slice.par_chunks(nx))
            .for_each(|(out, row)| {
                for (i, v) in out.iter_mut().enumerate() {
                    *v = read(|at| row[at], nx, i as isize - x0, wx);
                }
            });
        let mut tall = vec![OUTSIDE_HU; mx * my];
        tall.par_chunks_mut(mx).enumerate().for_each(|(j, out)| {
            for (i, v) in out.iter_mut().enumerate() {
                *v = read(|at| wide[at * mx + i], ny, j as isize - y0, wy);
            }
        });
        tall
    }
}

/// Output pixel n reads the input around n − moved: the whole part to take away, and the cubic's weights
/// of the pixels −1, 0, 1, 2 there.
fn whole_and_weights(moved: f64) -> (isize, [f32; 4]) {
    let whole = moved.ceil();
    let t = whole - moved;
    let (t2, t3) = (t * t, t * t * t);
    let weights = [
        -0.5 * t + t2 - 0.5 * t3,
        1.0 - 2.5 * t2 + 1.5 * t3,
        0.5 * t + 2.0 * t2 - 1.5 * t3,
        0.5 * (t3 - t2),
    ];
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a few thousand pixels; weights within ±2"
    )]
    let out = (whole as isize, weights.map(|w| w as f32));
    out
}

fn read(value: impl Fn(usize) -> f32, length: usize, base: isize, weights: [f32; 4]) -> f32 {
    let last = length as isize - 1;
    // outside by a pixel or more: air; the edge pixel goes on over the last fraction
    if base < -1
        || base > last
        || (base == -1 && weights[2] < 0.5)
        || (base == last && weights[1] < 0.5)
    {
        return OUTSIDE_HU;
    }
    let mut sum = 0.0;
    for (n, w) in weights.iter().enumerate() {
        let at = (base + n as isize - 1).clamp(0, last);
        #[expect(clippy::cast_sign_loss, reason = "clamped to the slice")]
        let at = at as usize;
        sum += w * value(at);
    }
    sum
}
