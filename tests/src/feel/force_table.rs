//! The cutting law beside published forces and torques of cutting bone, row by row, misses included.
//!
//! A row is *applicable* where a drill turns in a bone of a density that is known: the law then has a
//! thrust and a torque for it. What a row does not say of tool, speed and feed is taken from the span of
//! the rows that do, and named as assumed; then both sides are ranges.

mod law;
mod material;
mod published;
#[cfg(test)]
mod tests;

pub use law::{Drill, Figures, by_elements, closed_form};
pub use material::{Stuff, of_material};
pub use published::{Published, Record, parse};

use crate::data_folder;
use anyhow::{Context as _, Result};
use osteon_sim_core::feel::Feel;
use serde::Serialize;
use std::path::PathBuf;

/// Diameters of the drills of the table's rows, mm: for rows without one.
pub const DIAMETERS_MM: [f64; 2] = [2.5, 5.0];
/// Speeds of the table's rows, revolutions per minute: for rows without one.
pub const SPEEDS_RPM: [f64; 2] = [500.0, 1500.0];
/// Feeds for rows without one, mm/s; those of the other rows are 0.5 to 2 mm/s (30 to 120 mm/min).
pub const FEEDS_MM_S: [f64; 2] = [0.5, 2.0];

/// A force and a torque, each from the lowest to the highest; equal where there is one figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Span {
    /// Thrust, N.
    pub force_n: [f64; 2],
    /// Torque about the spindle, N·mm.
    pub torque_nmm: [f64; 2],
}

/// The law's figure over the published one, both at the middle of their ranges.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Ratio {
    /// Of the thrust.
    pub force: Option<f64>,
    /// Of the torque.
    pub torque: Option<f64>,
}

/// One row of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceRow {
    /// Its number in the table.
    pub row: u32,
    /// Process, material and tool, as published.
    pub what: String,
    /// Thrust and torque as published.
    pub published: Published,
    /// Where they were published.
    pub source: String,
    /// By the law in closed form; absent where the row is not applicable.
    pub law: Option<Span>,
    /// The same summed over the surface elements of such a drill, as the contact solve does it.
    pub law_by_elements: Option<Span>,
    /// Law over published.
    pub ratio: Ratio,
    /// Whether the law's and the published thrust overlap (a mean with its standard deviation, or its
    /// range); `None` where one of the two is missing.
    pub force_meets: Option<bool>,
    /// The same for the torque.
    pub torque_meets: Option<bool>,
    /// Whether the law can be asked at all.
    pub applicable: bool,
    /// What the row does not say and was assumed.
    pub assumed: Vec<String>,
    /// Why it does not apply, or why the law meets or misses it.
    pub why: String,
}

/// The table's file: under `OSTEON_DATA`, else `../shared/data`.
pub fn table_file() -> PathBuf {
    data_folder().join("force_tables/measured_bone_cutting_forces.csv")
}

/// Every row of the table beside the law with these parameters.
pub fn force_table(feel: &Feel) -> Result<Vec<ForceRow>> {
    let path = table_file();
    let text = std::fs::read_to_string(&path).with_context(|| {
        format!(
            "{}: cannot be read; set OSTEON_DATA to the folder that has force_tables",
            path.display()
        )
    })?;
    let records = parse(&text).with_context(|| path.display().to_string())?;
    Ok(records.iter().map(|r| compare(r, feel)).collect())
}

/// One row beside the law.
pub fn compare(record: &Record, feel: &Feel) -> ForceRow {
    let mut row = ForceRow {
        row: record.row,
        what: record.what(),
        published: record.published.clone(),
        source: record.source.clone(),
        law: None,
        law_by_elements: None,
        ratio: Ratio::default(),
        force_meets: None,
        torque_meets: None,
        applicable: false,
        assumed: Vec::new(),
        why: String::new(),
    };
    let stuff = match of_material(record) {
        Ok(stuff) => stuff,
        Err(why) => {
            return ForceRow {
                why: why.to_owned(),
                ..row
            };
        }
    };
    row.applicable = true;
    let mut or_span = |name: &str, given: Option<[f64; 2]>, span: [f64; 2], unit: &str| {
        given.unwrap_or_else(|| {
            let [lo, hi] = span;
            row.assumed.push(format!("{name} {lo} to {hi} {unit}"));
            span
        })
    };
    let ranges = [
        or_span("drill", record.diameter_mm, DIAMETERS_MM, "mm"),
        or_span("speed", record.rpm, SPEEDS_RPM, "rpm"),
        or_span("feed", record.feed_mm_s, FEEDS_MM_S, "mm/s"),
        stuff.density,
    ];
    let law = span(ranges, |drill, density| {
        closed_form(feel, stuff.tissue, density, drill)
    });
    row.law = Some(law);
    row.law_by_elements = Some(span(ranges, |drill, density| {
        by_elements(feel, stuff.tissue, density, drill)
    }));
    let (force, torque) = (row.published.force(), row.published.torque());
    row.ratio = Ratio {
        force: force.map(|p| middle(law.force_n) / middle(p)),
        torque: torque.map(|p| middle(law.torque_nmm) / middle(p)),
    };
    row.force_meets = force.map(|p| meets(law.force_n, p));
    row.torque_meets = torque.map(|p| meets(law.torque_nmm, p));
    row.why = explain(&row, &stuff);
    row
}

/// The smallest and largest figures over the corners of the ranges of diameter, speed, feed, density:
/// the law is monotone in each.
fn span(ranges: [[f64; 2]; 4], law: impl Fn(&Drill, f64) -> Figures) -> Span {
    let mut span = Span {
        force_n: [f64::INFINITY, 0.0],
        torque_nmm: [f64::INFINITY, 0.0],
    };
    let grow = |[lo, hi]: [f64; 2], v: f64| [lo.min(v), hi.max(v)];
    for corner in 0..16usize {
        let pick = |n: usize| ranges[n][corner >> n & 1];
        let drill = Drill {
            diameter_mm: pick(0),
            rpm: pick(1),
            feed_mm_s: pick(2),
        };
        let figures = law(&drill, pick(3));
        span.force_n = grow(span.force_n, figures.force_n);
        span.torque_nmm = grow(span.torque_nmm, figures.torque_nmm);
    }
    span
}

fn middle([lo, hi]: [f64; 2]) -> f64 {
    0.5 * (lo + hi)
}

fn meets(a: [f64; 2], b: [f64; 2]) -> bool {
    a[0] <= b[1] && b[0] <= a[1]
}

/// Why the law meets or misses a row.
fn explain(row: &ForceRow, stuff: &Stuff) -> String {
    let within = if row.assumed.is_empty() {
        "as published"
    } else {
        "overlaps what was published, under what was assumed"
    };
    let (low_force, low_torque) = (
        "below what was published; not in the law: the chisel edge, which extrudes bone instead of cutting it, and more than the low end of published energies",
        "below what was published; not in the law: chips that jam in the flutes, the chisel edge, the margins' friction",
    );
    let high = "above what was published: more energy, or a faster feed than the real one";
    let verdict = |name: &str, meets: Option<bool>, ratio: Option<f64>, low: &str| {
        let words = match (meets?, ratio?) {
            (true, _) => within,
            (false, r) if r < 1.0 => low,
            (false, _) => high,
        };
        Some(format!("{name} {words}"))
    };
    let force = verdict("thrust", row.force_meets, row.ratio.force, low_force);
    let torque = verdict("torque", row.torque_meets, row.ratio.torque, low_torque);
    let parts = force.into_iter().chain(torque);
    let parts: Vec<String> = parts.chain([stuff.source.to_owned()]).collect();
    parts.join("; ")
}
