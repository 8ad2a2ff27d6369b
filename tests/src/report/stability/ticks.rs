//! Time of the tick, and how many elements it buys.

use super::Output;
use crate::feel::ripple::{RippleRow, ball_of, slide_with};
use crate::feel::ticks::{TickRow, patient, row, scapula};
use crate::measure::intrinsic;
use crate::report::Machine;
use crate::report::plot::{Plot, Point};
use crate::report::table::{Table, percent, short};
use anyhow::Result;
use serde::Serialize;

/// Voxels of the scapula, mm.
const VOXELS_MM: [f64; 2] = [0.5, 0.235];
/// Elements tried; the tools are made with about 500 at most.
const ELEMENTS: [u16; 7] = [50, 100, 200, 500, 1000, 2000, 5000];

/// A number of elements and what it gives.
#[derive(Debug, Clone, Serialize)]
struct ElementRow {
    elements: u16,
    ripple_rms: f64,
    mean_over_exact: f64,
    tick_p50_us: f64,
    tick_p99_us: f64,
}

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Time of a tick");
    // the pool's threads inherit the affinity of the thread that starts them: start them first
    rayon::join(|| (), || ());
    rayon::broadcast(|_| ());
    let mut machine = Machine::look(intrinsic::pin(), intrinsic::timer_cost_ns());
    let mut rows = Vec::new();
    for voxel in VOXELS_MM {
        out.stage(&format!("{voxel} mm"));
        rows.extend(patient(voxel)?);
        rows.push(scapula(voxel)?);
    }
    out.section("tick_us", &rows)?;
    out.table(&ticks_table(&rows))?;
    let mut elements = Vec::new();
    for count in ELEMENTS {
        out.stage(&format!("{count} elements"));
        elements.push(element_row(count));
    }
    out.section("elements", &elements)?;
    elements_shown(out, &elements)?;
    machine.finish();
    out.say(&format!("Machine: {}.", machine.words()));
    out.section("machine", &machine)
}

fn element_row(elements: u16) -> ElementRow {
    let (ripple, bench, spec): (RippleRow, _, _) = slide_with(ball_of(elements), 0.5, 20.0);
    let ticks: TickRow = row("slide", 0.5, &spec, &bench);
    ElementRow {
        elements,
        ripple_rms: ripple.ripple_rms,
        mean_over_exact: ripple.mean_over_exact,
        tick_p50_us: ticks.p50_us,
        tick_p99_us: ticks.p99_us,
    }
}

fn ticks_table(rows: &[TickRow]) -> Table {
    let mut table = Table::new(
        "tick_us",
        "Whole tick",
        "The reamer under 1.5 N, wobbling by 5°, for 6 s; the least of three replays for each tick, over the ticks with contact. *Raw*: all \
         replays, with the machine's noise.",
        &[
            "scene",
            "voxel mm",
            "elements",
            "ticks",
            "p50 µs",
            "p99 µs",
            "max µs",
            "raw p99 µs",
        ],
    );
    for row in rows {
        table.push([
            row.scene.clone(),
            short(Some(row.voxel_mm)),
            row.elements.to_string(),
            row.ticks.to_string(),
            short(Some(row.p50_us)),
            short(Some(row.p99_us)),
            short(Some(row.max_us)),
            short(Some(row.raw_p99_us)),
        ]);
    }
    table
}

fn elements_shown(out: &mut Output, rows: &[ElementRow]) -> Result<()> {
    let note = "Ball of 6 mm over a plane tilted by 20°, 0.5 mm voxels. The tools are made with about 500 at most.";
    let axes = ["tick, median, µs", "ripple, %"];
    let mut plot = Plot::new(
        "elements_plot",
        "Elements against ripple and time",
        note,
        axes,
    );
    let mut table = Table::new(
        "elements",
        "Elements against ripple and time",
        note,
        &["elements", "ripple", "mean/exact", "p50 µs", "p99 µs"],
    );
    for row in rows {
        plot.series("from few to many")
            .push(Point::at(row.tick_p50_us, 100.0 * row.ripple_rms));
        table.push([
            row.elements.to_string(),
            percent(Some(row.ripple_rms)),
            short(Some(row.mean_over_exact)),
            short(Some(row.tick_p50_us)),
            short(Some(row.tick_p99_us)),
        ]);
    }
    out.plot(&plot)?;
    out.table(&table)
}
