//! What was asked for, beside what the rows say. Nothing here is written by hand but the bounds.

use super::rows::Row;
use crate::report::table::{Table, short};
use serde::Serialize;
use std::fmt::Write as _;

/// A floor and what was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Verdict {
    /// What was asked for.
    pub floor: String,
    /// The bound.
    pub bound: f64,
    /// Whether more is better.
    pub at_least: bool,
    /// The best of our methods; absent where none was measured.
    pub measured: Option<f64>,
    /// The method and instructions that reached it.
    pub by: Option<String>,
    /// Whether the bound is met; absent where nothing was measured.
    pub met: Option<bool>,
}

/// A bound on one figure of the rows of one scene.
struct Floor {
    what: &'static str,
    scene: &'static str,
    // only this method; any of ours (with an exact tool) where empty
    method: &'static str,
    value: fn(&Row) -> Option<f64>,
    bound: f64,
    at_least: bool,
}

const fn most(
    what: &'static str,
    scene: &'static str,
    value: fn(&Row) -> Option<f64>,
    bound: f64,
) -> Floor {
    Floor {
        what,
        scene,
        method: "",
        value,
        bound,
        at_least: false,
    }
}

const fn least(
    what: &'static str,
    scene: &'static str,
    method: &'static str,
    value: fn(&Row) -> Option<f64>,
    bound: f64,
) -> Floor {
    Floor {
        what,
        scene,
        method,
        value,
        bound,
        at_least: true,
    }
}

const fn p50(r: &Row) -> Option<f64> {
    r.p50_us
}
const fn worst(r: &Row) -> Option<f64> {
    r.max_us
}
const fn scalar(r: &Row) -> Option<f64> {
    r.ratio_thesis_scalar
}
const fn simd(r: &Row) -> Option<f64> {
    r.ratio_thesis_simd
}
const fn rms(r: &Row) -> Option<f64> {
    r.surface_rms_um
}
fn volume(r: &Row) -> Option<f64> {
    r.volume_rel_err.map(|v| 100.0 * v.abs())
}
fn lost(r: &Row) -> Option<f64> {
    (r.surface_points > 0).then_some(r.surface_lost as f64)
}

const PRESS: [&str; 3] = [
    "reamer-press-0.47",
    "reamer-press-0.235",
    "reamer-press-0.14",
];
const GRID: &str = "osteon-sdf-grid";

const FLOORS: [Floor; 22] = [
    most("contact event p50, µs", PRESS[0], p50, 11.0),
    most("contact event p50, µs", PRESS[1], p50, 36.0),
    most("contact event p50, µs", PRESS[2], p50, 95.0),
    most("worst event, µs", PRESS[0], worst, 20.0),
    most("worst event, µs", PRESS[1], worst, 55.0),
    most("worst event, µs", PRESS[2], worst, 130.0),
    least(
        "mean over the press against the thesis's scan, ×",
        PRESS[0],
        "",
        scalar,
        100.0,
    ),
    least(
        "mean over the press against the thesis's scan, ×",
        PRESS[1],
        "",
        scalar,
        130.0,
    ),
    least(
        "mean over the press against the thesis's scan, ×",
        PRESS[2],
        "",
        scalar,
        180.0,
    ),
    least(
        "mean over the press against its SIMD form, ×",
        PRESS[0],
        "",
        simd,
        18.0,
    ),
    least(
        "mean over the press against its SIMD form, ×",
        PRESS[1],
        "",
        simd,
        20.0,
    ),
    least(
        "mean over the press against its SIMD form, ×",
        PRESS[2],
        "",
        simd,
        30.0,
    ),
    least(
        "STL tool through its SDF grid against the thesis's scan, ×",
        PRESS[0],
        GRID,
        scalar,
        15.0,
    ),
    least(
        "STL tool through its SDF grid against the thesis's scan, ×",
        PRESS[1],
        GRID,
        scalar,
        15.0,
    ),
    least(
        "STL tool through its SDF grid against the thesis's scan, ×",
        PRESS[2],
        GRID,
        scalar,
        15.0,
    ),
    most("surface RMS, µm", PRESS[0], rms, 6.0),
    most("surface RMS, µm", PRESS[1], rms, 2.5),
    most(
        "surface RMS in a block, 0.5 mm, µm",
        "block-reamer-0.5-1",
        rms,
        3.0,
    ),
    most("volume, %", PRESS[0], volume, 0.6),
    most("volume, %", PRESS[1], volume, 0.2),
    most("surface points not found", PRESS[0], lost, 0.0),
    most("surface points not found", PRESS[1], lost, 0.0),
];

/// All floors against the rows.
pub(super) fn verdicts(rows: &[Row]) -> Vec<Verdict> {
    FLOORS
        .iter()
        .map(|floor| floor.verdict(rows))
        .chain([bone_size(rows)])
        .collect()
}

impl Floor {
    fn verdict(&self, rows: &[Row]) -> Verdict {
        let ours = rows.iter().filter(|r| {
            r.scene == self.scene
                && if self.method.is_empty() {
                    r.method.starts_with("osteon") && r.method != GRID
                } else {
                    r.method == self.method
                }
        });
        let sign = if self.at_least { -1.0 } else { 1.0 };
        let best = ours
            .filter_map(|r| Some(((self.value)(r)?, format!("{} ({})", r.method, r.isa))))
            .min_by(|a, b| (sign * a.0).total_cmp(&(sign * b.0)));
        Verdict::of(
            format!("{}: {}", self.scene, self.what),
            (self.bound, self.at_least),
            best,
        )
    }
}

impl Verdict {
    fn of(floor: String, (bound, at_least): (f64, bool), best: Option<(f64, String)>) -> Self {
        let measured = best.as_ref().map(|b| b.0);
        Self {
            floor,
            bound,
            at_least,
            measured,
            by: best.map(|b| b.1),
            met: measured.map(|v| if at_least { v >= bound } else { v <= bound }),
        }
    }
}

/// The time on the largest plate over that on the smallest.
fn bone_size(rows: &[Row]) -> Verdict {
    let plates: Vec<(f64, &Row)> = rows
        .iter()
        .filter(|r| r.method.starts_with("osteon"))
        .filter_map(|r| Some((r.scene.strip_prefix("plate-")?.parse().ok()?, r)))
        .collect();
    let smallest = plates.iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let best = smallest.and_then(|(least, first)| {
        let same = plates
            .iter()
            .filter(|p| p.1.method == first.method && p.1.isa == first.isa);
        let (most, last) = same.max_by(|a, b| a.0.total_cmp(&b.0))?;
        (most > least).then_some(())?;
        Some((
            last.p50_us? / first.p50_us?,
            format!("{} ({})", first.method, first.isa),
        ))
    });
    Verdict::of(
        "plate: p50 on the largest lattice over p50 on the smallest".to_owned(),
        (1.3, false),
        best,
    )
}

/// The verdicts as a table.
pub(super) fn table(verdicts: &[Verdict]) -> Table {
    let mut table = Table::new(
        "floors",
        "Floors",
        "Bounds on times are those for AVX-512 on one core; the best of our methods with an exact tool counts.",
        &["asked for", "bound", "measured", "by", "met"],
    );
    for v in verdicts {
        table.push([
            v.floor.clone(),
            format!("{} {}", if v.at_least { "≥" } else { "≤" }, v.bound),
            short(v.measured),
            v.by.clone().unwrap_or_default(),
            match v.met {
                Some(true) => "yes",
                Some(false) => "**no**",
                None => "not measured",
            }
            .to_owned(),
        ]);
    }
    table
}

/// What falls short, in words, computed.
pub(super) fn shortfall(verdicts: &[Verdict]) -> String {
    let count = |met: Option<bool>| verdicts.iter().filter(|v| v.met == met).count();
    let mut text = format!(
        "**{} of {} met, {} not met, {} not measured.**\n\n",
        count(Some(true)),
        verdicts.len(),
        count(Some(false)),
        count(None)
    );
    for v in verdicts.iter().filter(|v| v.met == Some(false)) {
        let measured = v.measured.unwrap_or(f64::NAN);
        let by = if v.at_least {
            v.bound / measured
        } else {
            measured / v.bound
        };
        // writing to a string cannot fail
        let _infallible = writeln!(
            text,
            "* {} falls short: {} where {} was asked for ({} × off).",
            v.floor,
            short(v.measured),
            short(Some(v.bound)),
            short(Some(by)),
        );
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests;
