//! Stiffness against delay, hand and guard.

use super::Output;
use crate::feel::Hand;
use crate::feel::map::{MapRow, SwingRow, delay_law_n_per_m, stiffness_map, swings};
use crate::feel::plant::PlantSpec;
use crate::report::plot::{Plot, Point, Scale};
use crate::report::table::{Table, short};
use anyhow::Result;
use osteon_sim_core::feel::Feel;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## How stiff the loop bears to be");
    out.stage("limits");
    let rows = stiffness_map();
    out.section("stiffness", &rows)?;
    out.plot(&limits_plot(&rows))?;
    out.table(&limits_table(&rows))?;
    out.stage("swings");
    // twelve steps from 0.1 to 6 N/mm
    let stiffnesses: Vec<f64> = (0..12)
        .map(|n| 0.1 * 60f64.powf(f64::from(n) / 11.0))
        .collect();
    let rows = swings(&stiffnesses);
    out.section("swing", &rows)?;
    out.plot(&swing_plot(&rows))
}

/// What "guards" are in these figures.
const GUARDS_NOTE: &str = "Dashed: the delay law for each hand, without Coulomb friction. The default is 500 N/m. *Guards off*: damping, passivity, \
     slew and heat limit off.";

fn guard_words(guard: bool) -> &'static str {
    if guard { "guards on" } else { "guards off" }
}

fn limits_table(rows: &[MapRow]) -> Table {
    let mut table = Table::new(
        "stiffness",
        "Stiffest coupling whose press settles",
        "0.9 N, met at 0.1 m/s; settled: ≤ 0.11 mm peak to peak in the last of 10 s. Law: (b + B)/(T/2 + t_d); Colgate: 2b/T, \
         which knows no delay. Both leave Coulomb friction out. 6000 is the search's end.",
        &[
            "hand",
            "delay, ticks",
            "guards",
            "measured N/m",
            "law N/m",
            "Colgate N/m",
        ],
    );
    for row in rows {
        table.push([
            row.hand.to_owned(),
            row.delay_ticks.to_string(),
            guard_words(row.guard).to_owned(),
            short(Some(row.k_max_n_per_m)),
            short(Some(row.law_n_per_m)),
            short(Some(row.colgate_n_per_m)),
        ]);
    }
    table
}

fn limits_plot(rows: &[MapRow]) -> Plot {
    let mut plot = Plot::new(
        "stiffness_map",
        "Stiffest coupling whose press settles",
        GUARDS_NOTE,
        ["delay, ticks", "stiffness, N/m"],
    )
    .on([Scale::Linear, Scale::Log]);
    for row in rows {
        let name = format!("{}, {}", row.hand, guard_words(row.guard));
        let point = Point {
            failed: row.k_max_n_per_m <= 0.0,
            ..Point::at(row.delay_ticks as f64, row.k_max_n_per_m)
        };
        plot.series(&name).push(point);
    }
    for hand in Hand::ALL {
        for guard in [false, true] {
            let law = rows
                .iter()
                .filter(|r| r.hand == hand.name && r.guard == guard);
            let points: Vec<[f64; 2]> =
                law.map(|r| [r.delay_ticks as f64, r.law_n_per_m]).collect();
            if !points.is_empty() {
                let label = format!("law, {}, {}", hand.name, guard_words(guard));
                plot.curves.push((points, label));
            }
        }
    }
    plot.levels.push((500.0, "default".to_owned()));
    plot
}

fn swing_plot(rows: &[SwingRow]) -> Plot {
    let mut plot = Plot::new(
        "swing",
        "Swing of a press without a hand",
        "Peak to peak in the last of 10 s. Dashed: where the delay law says that it begins, without Coulomb friction.",
        ["stiffness, N/m", "swing, mm"],
    )
    .on([Scale::Log, Scale::Linear]);
    let mut laws: Vec<(f64, String)> = Vec::new();
    for row in rows {
        let name = format!("{} ticks, {}", row.delay_ticks, guard_words(row.guard));
        plot.series(&name)
            .push(Point::at(row.stiffness_n_per_m, row.swing_mm));
        let own = PlantSpec::TYPICAL.viscous_n_s_per_m;
        let added = if row.guard {
            1e3 * Feel::default().guard.damping_n_s_per_mm
        } else {
            0.0
        };
        let label = format!(
            "law, {}{}",
            row.delay_ticks,
            if row.guard { " on" } else { " off" }
        );
        if laws.iter().all(|(_, known)| *known != label) {
            laws.push((delay_law_n_per_m(own + added, row.delay_ticks), label));
        }
    }
    for (at, label) in laws {
        let points = (0..=60).map(|n| [at, f64::from(n)]).collect();
        plot.curves.push((points, label));
    }
    plot
}
