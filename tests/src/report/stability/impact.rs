//! Taps, dropped frames, broken samples, energy.

use super::Output;
use crate::feel::cases::gaps::{GapRow, GlitchRow, all_gaps, glitch_row};
use crate::feel::cases::impact::{Tap, all_taps};
use crate::feel::cases::press::{EnergyRow, energies};
use crate::feel::setup::Spec;
use crate::report::plot::{Plot, Point, Scale};
use crate::report::table::{Table, short};
use anyhow::Result;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## What a blow, a gap and a broken sample do");
    out.stage("taps");
    let taps = all_taps(&Spec::flat());
    out.section("impact", &taps)?;
    out.plot(&taps_plot(&taps))?;
    out.table(&taps_table(&taps))?;
    out.stage("gaps");
    let gaps = all_gaps(&Spec::flat());
    out.section("dropped_frames", &gaps)?;
    out.table(&gaps_table(&gaps))?;
    out.stage("broken samples");
    let broken: Vec<GlitchRow> = [1.0, -1.0, 10.0, -10.0, 1000.0].map(glitch_row).into();
    out.section("broken_samples", &broken)?;
    out.table(&broken_table(&broken))?;
    out.stage("energy");
    let energy = energies(&Spec::flat());
    out.section("press_energy", &energy)?;
    out.table(&energy_table(&energy))
}

fn taps_table(taps: &[Tap]) -> Table {
    let mut table = Table::new(
        "impact",
        "Taps",
        "Nothing pushes. *Absorbed*: energy that the motors took from the device; negative: they gave some.",
        &[
            "mass g",
            "delay, ticks",
            "entry m/s",
            "rebound m/s",
            "deepest mm",
            "peak N",
            "absorbed mJ",
            "proxy off the face mm",
        ],
    );
    for tap in taps {
        table.push([
            short(Some(1e3 * tap.mass_kg)),
            tap.delay_ticks.to_string(),
            short(Some(1e-3 * tap.entry_mm_s)),
            short(Some(1e-3 * tap.rebound_mm_s)),
            short(Some(tap.deepest_mm)),
            short(Some(tap.peak_n)),
            short(Some(tap.absorbed_mj)),
            short(Some(tap.proxy_highest_mm.max(-tap.proxy_lowest_mm))),
        ]);
    }
    table
}

fn taps_plot(taps: &[Tap]) -> Plot {
    let mut plot = Plot::new(
        "rebound",
        "Rebound of a tap",
        "Above the dashed line the motors gave energy.",
        ["entry, m/s", "rebound, m/s"],
    )
    .on([Scale::Linear; 2]);
    for tap in taps {
        let name = format!("{:.0} g, {} ticks", 1e3 * tap.mass_kg, tap.delay_ticks);
        plot.series(&name)
            .push(Point::at(1e-3 * tap.entry_mm_s, 1e-3 * tap.rebound_mm_s));
    }
    let same = (0..=20).map(|n| f64::from(n) / 20.0);
    plot.curves.push((
        same.map(|v| [v, v]).collect(),
        "as fast as it came".to_owned(),
    ));
    plot
}

fn gaps_table(rows: &[GapRow]) -> Table {
    let mut table = Table::new(
        "dropped_frames",
        "Dropped frames, five gaps a second in a press",
        "One tick of delay. *Ramp*: largest share of the limit that rises over 50 ms after a gap.",
        &[
            "hand",
            "gap ms",
            "swing mm",
            "left at its end N",
            "ramp",
            "swing afterwards mm",
            "borne afterwards",
            "least absorbed mJ",
        ],
    );
    for row in rows {
        table.push([
            row.hand.to_owned(),
            row.gap_ticks.to_string(),
            short(Some(row.swing_mm)),
            short(Some(row.left_n)),
            short(Some(row.ramp_share)),
            short(Some(row.after_mm)),
            row.borne.to_string(),
            short(Some(row.least_absorbed_mj)),
        ]);
    }
    table
}

fn broken_table(rows: &[GlitchRow]) -> Table {
    let mut table = Table::new(
        "broken_samples",
        "One broken sample",
        "Through the shoulder's encoder, in a press by a firm grip; the removal in a cut.",
        &[
            "jump mm",
            "refused",
            "good ones refused",
            "largest step N",
            "50 ms later N",
            "removal with/without",
        ],
    );
    for row in rows {
        table.push([
            short(Some(row.jump_mm)),
            row.refused.to_string(),
            row.good_refused.to_string(),
            short(Some(row.step_n)),
            short(Some(row.later_n)),
            short(Some(row.removed_ratio)),
        ]);
    }
    table
}

fn energy_table(rows: &[EnergyRow]) -> Table {
    let mut table = Table::new(
        "press_energy",
        "Energy of a press",
        "Counted at the plant over 10 s from the touch. *Least*: the most that the motors had given beyond what they took.",
        &["hand", "delay, ticks", "absorbed mJ", "least mJ"],
    );
    for row in rows {
        table.push([
            row.hand.to_owned(),
            row.delay_ticks.to_string(),
            short(Some(row.absorbed_mj)),
            short(Some(row.least_absorbed_mj)),
        ]);
    }
    table
}
