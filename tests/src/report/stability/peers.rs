//! Other programs' defects by their rule.

use super::Output;
use crate::feel::peers::capped::{RateRow, SideRow, directions, rate_row, side_row};
use crate::feel::peers::plate_crossed_n;
use crate::report::plot::{Plot, Point, Scale};
use crate::report::table::{Table, percent, short};
use anyhow::Result;
use serde::Serialize;
use serde_json::json;

/// Their rules: name, voxels a tick.
const RULES: [(&str, u64); 3] = [
    ("ten a tick", 10),
    ("one a tick", 1),
    ("all of them", u64::MAX),
];
const RATES_HZ: [u32; 5] = [250, 500, 1000, 2000, 4000];
/// Stiffness of the penalty, N/mm.
const STIFFNESS: f64 = 0.5;

/// A plate and what a penalty does with it.
#[derive(Debug, Clone, Serialize)]
struct PlateRow {
    thickness_mm: f64,
    crossed_at_n: f64,
    half_stiffness_times_thickness_n: f64,
}

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say(
        "## What other programs do, by their rule\n\nSmall baselines written from descriptions of the rules, with none of their code: \
         volumetric_drilling removes the first ten overlapped voxels of a tick (6 mm burr), CHAI3D's drilling demo one; \
         both in the order of memory.",
    );
    out.stage("rates");
    let rates: Vec<RateRow> = RULES
        .iter()
        .flat_map(|(rule, cap)| RATES_HZ.map(|rate| rate_row(rule, *cap, rate)))
        .collect();
    let (plot, table) = rates_shown(&rates);
    out.plot(&plot)?;
    out.table(&table)?;
    out.stage("sides");
    let sides: Vec<SideRow> = RULES[..2]
        .iter()
        .flat_map(|(rule, cap)| {
            let all = directions().into_iter();
            all.map(|d| side_row(rule, *cap, d)).collect::<Vec<_>>()
        })
        .collect();
    out.table(&sides_table(&sides))?;
    let plates: Vec<PlateRow> = [0.47, 1.0, 2.0, 3.0].map(plate).into();
    out.table(&plates_table(&plates))?;
    out.section(
        "peers",
        &json!({"rate": rates, "side": sides, "plate": plates}),
    )
}

fn plate(thickness_mm: f64) -> PlateRow {
    PlateRow {
        thickness_mm,
        crossed_at_n: plate_crossed_n(STIFFNESS, thickness_mm),
        half_stiffness_times_thickness_n: 0.5 * STIFFNESS * thickness_mm,
    }
}

fn rates_shown(rows: &[RateRow]) -> (Plot, Table) {
    let note =
        "A ball of 2 mm plunged 2 mm deep at 1 mm/s into voxels of 0.1 mm, whatever the force.";
    let axes = ["rate of the loop, Hz", "removed, mm³"];
    let mut plot = Plot::new("peers_rate_plot", "Removal with a cap a tick", note, axes)
        .on([Scale::Log, Scale::Linear]);
    let mut table = Table::new(
        "peers_rate",
        "Removal with a cap a tick",
        note,
        &[
            "removes",
            "rate Hz",
            "removed mm³",
            "mm³/s",
            "left standing",
        ],
    );
    for row in rows {
        plot.series(&row.rule)
            .push(Point::at(f64::from(row.rate_hz), row.removed_mm3));
        table.push([
            row.rule.clone(),
            row.rate_hz.to_string(),
            short(Some(row.removed_mm3)),
            short(Some(row.removed_mm3_s)),
            percent(Some(row.left_share)),
        ]);
    }
    (plot, table)
}

fn sides_table(rows: &[SideRow]) -> Table {
    let mut table = Table::new(
        "peers_side",
        "Side force of a symmetric plunge, removal in the order of memory",
        "A ball of 3 mm plunged 1 mm deep at 1 mm/s and 1 kHz into voxels of 0.1 mm.",
        &[
            "removes",
            "direction",
            "lateral/axial force",
            "centroid off axis mm",
        ],
    );
    for row in rows {
        let [x, y, z] = row.direction;
        table.push([
            row.rule.clone(),
            format!("({x}, {y}, {z})"),
            percent(Some(row.lateral_share)),
            short(Some(row.off_axis_mm)),
        ]);
    }
    table
}

fn plates_table(rows: &[PlateRow]) -> Table {
    let mut table = Table::new(
        "peers_plate",
        "Push at which a pure penalty lets through a plate",
        "0.5 N/mm; a device of this class pushes back with up to 3.3 N.",
        &["thickness mm", "crossed at N", "K t/2 N"],
    );
    for row in rows {
        table.push([
            short(Some(row.thickness_mm)),
            short(Some(row.crossed_at_n)),
            short(Some(row.half_stiffness_times_thickness_n)),
        ]);
    }
    table
}
