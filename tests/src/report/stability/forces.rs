//! The cutting law beside published forces of cutting bone.

use super::Output;
use crate::feel::force_table::{ForceRow, Span, force_table, table_file};
use crate::report::plot::{Plot, Point, Scale, Series};
use crate::report::table::{Table, short};
use anyhow::Result;
use osteon_sim_core::feel::Feel;

/// Thrust or torque of a row.
type Pick = fn(&ForceRow) -> Option<([f64; 2], [f64; 2])>;

/// Runs the part. Without the data it says so, on the terminal and in the report, and writes no section.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## The cutting law beside published forces");
    let path = table_file();
    if !path.is_file() {
        let why = format!(
            "no table of published forces at {}; set OSTEON_DATA to the folder that has force_tables",
            path.display()
        );
        crate::skipped(&why);
        out.say(&format!("**Not measured**: {why}."));
        return Ok(());
    }
    let rows = force_table(&Feel::default())?;
    let applicable = rows.iter().filter(|r| r.applicable);
    let judged = |meets: fn(&ForceRow) -> Option<bool>| {
        let all: Vec<bool> = rows.iter().filter_map(meets).collect();
        (all.iter().filter(|m| **m).count(), all.len())
    };
    let (force, forces) = judged(|r| r.force_meets);
    let (torque, torques) = judged(|r| r.torque_meets);
    out.say(&format!(
        "{} of {} rows can be asked of the law. It meets {force} of {forces} published thrusts and {torque} of {torques} torques: the \
         ranges of both overlap. Every miss is listed with what the law lacks. No published force of reaming a glenoid was found: these \
         are drills; they say nothing of how true a reamer feels.",
        applicable.count(),
        rows.len()
    ));
    let thrust: Pick = |r| Some((r.published.force()?, r.law?.force_n));
    let turning: Pick = |r| Some((r.published.torque()?, r.law?.torque_nmm));
    out.plot(&plot("force_table_thrust", "Thrust", "N", &rows, thrust))?;
    out.plot(&plot(
        "force_table_torque",
        "Torque",
        "N·mm",
        &rows,
        turning,
    ))?;
    out.table(&table(&rows))?;
    out.section("force_table", &rows)
}

fn middle([lo, hi]: [f64; 2]) -> f64 {
    0.5 * (lo + hi)
}

/// Law against published, one series a row so that nothing is joined.
fn plot(stem: &str, title: &str, unit: &str, rows: &[ForceRow], pick: Pick) -> Plot {
    let found: Vec<(u32, [f64; 2], [f64; 2])> = rows
        .iter()
        .filter_map(|r| pick(r).map(|(published, law)| (r.row, published, law)))
        .collect();
    let ends = found.iter().flat_map(|(_, p, l)| [middle(*p), l[0], l[1]]);
    let positive = ends.filter(|v| *v > 0.0);
    let [lo, hi] = positive.fold([f64::INFINITY, 0.0f64], |[lo, hi], v| {
        [lo.min(v), hi.max(v)]
    });
    let even: Vec<[f64; 2]> = (0..=60u32)
        .map(|n| lo * (hi / lo).powf(f64::from(n) / 60.0))
        .filter(|v| v.is_finite())
        .map(|v| [v, v])
        .collect();
    let series = found.iter().map(|(row, published, law)| Series {
        name: format!("row {row}"),
        points: vec![Point {
            x: middle(*published),
            y: middle(*law),
            band: Some(*law),
            failed: false,
        }],
    });
    Plot {
        stem: stem.to_owned(),
        title: format!("{title} by the law against what was published"),
        note: "One mark a row of the table, the line through it from the lowest to the highest of the law under what was assumed; on \
               the dashed line both agree."
            .to_owned(),
        axes: [format!("published, {unit}"), format!("law, {unit}")],
        scales: [Scale::Log; 2],
        series: series.collect(),
        slopes: Vec::new(),
        levels: Vec::new(),
        curves: vec![(even, "law = published".to_owned())],
    }
}

fn table(rows: &[ForceRow]) -> Table {
    let mut table = Table::new(
        "force_table",
        "Every row of the table",
        "Law: in closed form; ranges where a row does not say tool, speed, feed or density.",
        &[
            "row",
            "what",
            "published N",
            "law N",
            "meets",
            "published N·mm",
            "law N·mm",
            "meets",
            "assumed",
            "why",
            "source",
        ],
    );
    for r in rows {
        let span = |of: fn(&Span) -> [f64; 2]| range(r.law.as_ref().map(of));
        table.push([
            r.row.to_string(),
            r.what.clone(),
            range(r.published.force()),
            span(|s| s.force_n),
            verdict(r.force_meets),
            range(r.published.torque()),
            span(|s| s.torque_nmm),
            verdict(r.torque_meets),
            r.assumed.join("; "),
            r.why.clone(),
            r.source.clone(),
        ]);
    }
    table
}

fn range(span: Option<[f64; 2]>) -> String {
    match span {
        Some([lo, hi]) if (hi - lo).abs() > 1e-9 => {
            format!("{} to {}", short(Some(lo)), short(Some(hi)))
        }
        other => short(other.map(|[v, _]| v)),
    }
}

fn verdict(meets: Option<bool>) -> String {
    match meets {
        Some(true) => "yes",
        Some(false) => "**no**",
        None => "",
    }
    .to_owned()
}
