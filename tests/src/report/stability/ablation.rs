//! What breaks without each guard.

use super::Output;
use crate::feel::ablation::rows;
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
    out.table(&table)
}
