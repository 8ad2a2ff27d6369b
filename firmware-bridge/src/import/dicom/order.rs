//! From slices in any order to a stack: sorted along their normal, evenly spaced, gaps known, tilt known.

use super::header::Slice;
use crate::import::error::ImportError;
use glam::DVec3;
use std::path::Path;

/// How far from its place in the even grid a slice may lie, of the spacing.
const EVEN: f64 = 0.05;
/// Rounding of the positions in a header, mm.
const ROUNDING_MM: f64 = 0.011;
/// How far from the straight line through the stack a slice may lie, mm.
const ASIDE_MM: f64 = 0.1;
/// Largest difference of two slices' unit vectors that counts as the same orientation.
const SAME_AXIS: f64 = 1e-3;
/// Largest tilt, degrees.
const MAX_TILT_DEG: f64 = 45.0;

/// Slices missing between two that are there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gap {
    /// Place in the stack of the first missing slice, from 0.
    pub(crate) first: usize,
    /// How many are missing.
    pub(crate) missing: usize,
}

/// An ordered stack.
#[derive(Debug, Clone)]
pub(crate) struct Stack {
    /// The slices, along the normal.
    pub(crate) slices: Vec<Slice>,
    /// Each slice's place in the even grid, from 0; missing ones are left out.
    pub(crate) places: Vec<usize>,
    /// Planes of the even grid.
    pub(crate) planes: usize,
    /// Distance of the planes along the normal, mm.
    pub(crate) spacing_mm: f64,
    /// Largest distance of a slice from its plane, mm.
    pub(crate) uneven_mm: f64,
    /// Missing slices.
    pub(crate) gaps: Vec<Gap>,
    /// In-plane shift of each millimetre along the normal: along the rows, down the columns.
    pub(crate) shear: [f64; 2],
}

impl Stack {
    /// True where the slices are not stacked along their normal.
    pub(crate) fn tilted(&self) -> bool {
        let height = self.spacing_mm * (self.planes - 1) as f64;
        self.shear.iter().any(|s| (s * height).abs() > ROUNDING_MM)
    }

    /// Angle between the stack's direction and the slices' normal, degrees.
    pub(crate) fn tilt_deg(&self) -> f64 {
        self.shear[0].hypot(self.shear[1]).atan().to_degrees()
    }
}

fn at_slice(slice: &Slice, problem: String) -> ImportError {
    let (path, frame) = slice.place();
    ImportError::Slice {
        path,
        frame,
        problem,
    }
}

/// Sorts a series into a stack. `accept_gap` lets slices be missing; `input` is named where no slice is
/// to blame.
pub(crate) fn stack(
    mut slices: Vec<Slice>,
    accept_gap: bool,
    input: &Path,
) -> Result<Stack, ImportError> {
    let Some(first) = slices.first().cloned() else {
        return Err(ImportError::Input {
            path: input.to_path_buf(),
            problem: "the series has no slice; give another --series".to_owned(),
        });
    };
    same_kind(&first, &slices)?;
    let normal = first.normal();
    slices.sort_by(|a, b| a.origin.dot(normal).total_cmp(&b.origin.dot(normal)));
    if slices.len() < 3 {
        return Err(ImportError::Input {
            path: input.to_path_buf(),
            problem: format!(
                "{} slice{} no volume; give the whole series",
                slices.len(),
                if slices.len() == 1 { " is" } else { "s are" }
            ),
        });
    }
    let heights: Vec<f64> = slices.iter().map(|s| s.origin.dot(normal)).collect();
    let step = usual_step(&slices, &heights)?;
    let (places, gaps) = places(&slices, &heights, step, accept_gap)?;
    let planes = places.last().map_or(1, |p| p + 1);
    let rise = heights[heights.len() - 1] - heights[0];
    let spacing_mm = rise / (planes - 1) as f64;
    if !(0.01..=20.0).contains(&spacing_mm) {
        return Err(ImportError::Input {
            path: input.to_path_buf(),
            problem: format!(
                "slices every {spacing_mm:.3} mm are no volume (allowed: 0.01 to 20); give another --series"
            ),
        });
    }
    let uneven_mm = check_even(&slices, &heights, &places, spacing_mm)?;
    let shear = shear(&slices, &heights)?;
    let stack = Stack {
        slices,
        places,
        planes,
        spacing_mm,
        uneven_mm,
        gaps,
        shear,
    };
    if stack.tilt_deg() > MAX_TILT_DEG {
        return Err(ImportError::Input {
            path: input.to_path_buf(),
            problem: format!(
                "the slices are stacked {:.0}° off their normal (at most {MAX_TILT_DEG}° is a gantry's tilt); give another --series",
                stack.tilt_deg()
            ),
        });
    }
    Ok(stack)
}

/// One size, one spacing, one orientation, one time.
fn same_kind(first: &Slice, slices: &[Slice]) -> Result<(), ImportError> {
    for slice in slices {
        let differs = |what: &str, this: String, that: String| {
            Err(at_slice(
                slice,
                format!(
                    "{what} {this}, but {that} in {}; one series has one {what}: choose it with --series or move the others away",
                    first.path.display()
                ),
            ))
        };
        let (a, b) = (&slice.stored, &first.stored);
        if (a.columns, a.rows) != (b.columns, b.rows) {
            let size = |s: &super::header::Stored| format!("{}×{}", s.columns, s.rows);
            return differs("size", size(a), size(b));
        }
        let spacing_apart = (0..2).any(|n| (slice.pixel_mm[n] - first.pixel_mm[n]).abs() > 1e-4);
        if spacing_apart {
            let text = |v: [f64; 2]| format!("{}×{} mm", v[0], v[1]);
            return differs("pixel spacing", text(slice.pixel_mm), text(first.pixel_mm));
        }
        let apart = |p: DVec3, q: DVec3| p.distance(q) > SAME_AXIS;
        if apart(slice.along_row, first.along_row) || apart(slice.down_column, first.down_column) {
            let text = |s: &Slice| format!("({:.3}) / ({:.3})", s.along_row, s.down_column);
            return differs("orientation", text(slice), text(first));
        }
        if slice.time_point != first.time_point {
            let text = |s: &Slice| s.time_point.clone().unwrap_or_else(|| "none".to_owned());
            return differs("time point", text(slice), text(first));
        }
    }
    Ok(())
}

/// The median step between neighbours, mm. Two slices in one place are refused.
fn usual_step(slices: &[Slice], heights: &[f64]) -> Result<f64, ImportError> {
    let mut steps: Vec<f64> = heights.windows(2).map(|h| h[1] - h[0]).collect();
    if let Some(at) = steps.iter().position(|&s| s < 1e-3) {
        let other = &slices[at];
        return Err(at_slice(
            &slices[at + 1],
            format!(
                "lies at the same place ({:.2} mm along the normal) as {}; one volume has one slice a place: move the second acquisition away",
                heights[at],
                other.path.display()
            ),
        ));
    }
    steps.sort_unstable_by(f64::total_cmp);
    // the lower median: of two steps the shorter is the spacing, the longer a gap
    Ok(steps[(steps.len() - 1) / 2])
}

/// Each slice's place and the gaps, from the usual step.
fn places(
    slices: &[Slice],
    heights: &[f64],
    step: f64,
    accept_gap: bool,
) -> Result<(Vec<usize>, Vec<Gap>), ImportError> {
    let mut places = vec![0];
    let mut gaps = Vec::new();
    for (n, pair) in heights.windows(2).enumerate() {
        let here = pair[1] - pair[0];
        let steps = (here / step).round().max(1.0);
        let tolerance = (EVEN * step).max(2.0 * ROUNDING_MM);
        if (here - steps * step).abs() > tolerance * steps.sqrt() {
            return Err(at_slice(
                &slices[n + 1],
                format!(
                    "lies {here:.3} mm from the slice before it where {step:.3} mm is usual: uneven spacing makes no volume; reconstruct the series evenly"
                ),
            ));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "rounded, at least 1; a huge gap is refused below"
        )]
        let steps = steps as usize;
        let last = places.last().copied().unwrap_or(0);
        if steps > 1 {
            if !accept_gap || steps > 20 {
                let missing = steps - 1;
                let remedy = if steps > 20 {
                    "copy the whole series"
                } else {
                    "copy the whole series, or --accept-gap to fill it from its neighbours (recorded in the scene)"
                };
                return Err(at_slice(
                    &slices[n + 1],
                    format!(
                        "{missing} slice{} missing before it ({here:.2} mm after {} where {step:.2} mm is usual); {remedy}",
                        if missing == 1 { " is" } else { "s are" },
                        slices[n].path.display()
                    ),
                ));
            }
            gaps.push(Gap {
                first: last + 1,
                missing: steps - 1,
            });
        }
        places.push(last + steps);
    }
    Ok((places, gaps))
}

/// The largest distance of a slice from its plane, mm.
fn check_even(
    slices: &[Slice],
    heights: &[f64],
    places: &[usize],
    spacing_mm: f64,
) -> Result<f64, ImportError> {
    let mut worst = 0.0_f64;
    for ((slice, height), place) in slices.iter().zip(heights).zip(places) {
        let off = (height - heights[0] - *place as f64 * spacing_mm).abs();
        if off > (2.0 * EVEN * spacing_mm).max(2.0 * ROUNDING_MM) {
            return Err(at_slice(
                slice,
                format!(
                    "lies {off:.3} mm from its place in an even stack of {spacing_mm:.3} mm; reconstruct the series evenly"
                ),
            ));
        }
        worst = worst.max(off);
    }
    Ok(worst)
}

/// In-plane shift a millimetre of height: the least-squares line through the slices' origins, which
/// must lie on it.
fn shear(slices: &[Slice], heights: &[f64]) -> Result<[f64; 2], ImportError> {
    let first = &slices[0];
    let axes = [first.along_row, first.down_column];
    let aside = |s: &Slice| axes.map(|a| (s.origin - first.origin).dot(a));
    let count = slices.len() as f64;
    let mean_height = heights.iter().sum::<f64>() / count;
    let spread: f64 = heights.iter().map(|h| (h - mean_height).powi(2)).sum();
    let slope = |axis: usize| {
        let moments = slices.iter().zip(heights);
        moments
            .map(|(s, h)| aside(s)[axis] * (h - mean_height))
            .sum::<f64>()
            / spread
    };
    let shear = [slope(0), slope(1)];
    let start: [f64; 2] = core::array::from_fn(|axis| {
        let sum: f64 = slices.iter().map(|s| aside(s)[axis]).sum();
        sum / count - shear[axis] * (mean_height - heights[0])
    });
    let off = |n: usize, shear: [f64; 2], start: [f64; 2]| {
        let here = aside(&slices[n]);
        let line = |a: usize| start[a] + shear[a] * (heights[n] - heights[0]);
        (0..2)
            .map(|a| (here[a] - line(a)).abs())
            .fold(0.0, f64::max)
    };
    if (0..slices.len()).all(|n| off(n, shear, start) <= ASIDE_MM) {
        return Ok(shear);
    }
    // one slice out of line draws the line towards it: medians name the right one
    let half = slices.len() / 2;
    let far = |a: usize, n: usize| {
        (aside(&slices[n + half])[a] - aside(&slices[n])[a]) / (heights[n + half] - heights[n])
    };
    let slope = [0, 1].map(|a| median((0..slices.len() - half).map(|n| far(a, n))));
    let rest = |a: usize, n: usize| aside(&slices[n])[a] - slope[a] * (heights[n] - heights[0]);
    let from = [0, 1].map(|a| median((0..slices.len()).map(|n| rest(a, n))));
    let worst = (0..slices.len())
        .max_by(|&p, &q| off(p, slope, from).total_cmp(&off(q, slope, from)))
        .unwrap_or(0);
    Err(at_slice(
        &slices[worst],
        format!(
            "lies {:.2} mm beside the line of the other slices (at most {ASIDE_MM} mm); the table moved or two series are mixed: give another --series",
            off(worst, slope, from)
        ),
    ))
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.collect();
    all.sort_unstable_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(0.0)
}
