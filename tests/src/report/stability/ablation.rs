//! What breaks without each guard, and without each term of the law.

use super::Output;
use crate::feel::ablation::{law, rows};
use crate::report::table::{Table, short};
use anyhow::Result;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## What each guard is for");
    let rows = rows();
    out.section("ablation", &rows)?;
    let mut table = Table::new(
        "ablation",
        "The loop without each guard",
        "*Press*: 0.9 N without a hand, two ticks of delay; *stiff*: 0.7 N/mm and three ticks; *tap*: 45 g at 1 m/s, two ticks.",
        &[
            "without",
            "press swings mm",
            "press gave mJ",
            "stiff press swings mm",
            "tap: rebound/entry",
            "tap: largest step N",
            "20 s at the limit: RMS N",
        ],
    );
    for row in &rows {
        table.push([
            row.without.to_owned(),
            short(Some(row.press_mm)),
            short(Some(row.press_gave_mj)),
            short(Some(row.stiff_press_mm)),
            short(Some(row.rebound_ratio)),
            short(Some(row.step_n)),
            short(Some(row.deep_rms_n)),
        ]);
    }
    out.table(&table)?;
    terms(out)
}

fn terms(out: &mut Output) -> Result<()> {
    out.say("## What each term of the law is for");
    let rows = law::rows();
    out.section("law_ablation", &rows)?;
    let mut table = Table::new(
        "law_ablation",
        "The law without each term",
        "One figure for each, with the term and without it.",
        &[
            "term",
            "left out by",
            "figure",
            "unit",
            "with it",
            "without it",
        ],
    );
    for row in &rows {
        table.push([
            row.term.to_owned(),
            row.how.to_owned(),
            row.figure.to_owned(),
            row.unit.to_owned(),
            short(Some(row.with)),
            short(Some(row.without)),
        ]);
    }
    out.table(&table)
}
