//! Ten hours of loop time in one piece.

use super::Output;
use crate::feel::setup::Spec;
use crate::feel::trace::{peak_force_n, swing_mm};
use crate::feel::{Hand, press};
use anyhow::Result;
use serde_json::json;

/// Seconds of loop time.
const SECONDS: u32 = 36_000;

/// Presses for ten hours with ticks of 1 ± 0.3 ms.
pub(super) fn run(out: &mut Output) -> Result<()> {
    let mut bench = press::pressed(&Spec::flat().with(Hand::GRIP, 1), 2.0);
    let place = bench.plant.position_mm;
    let absorbed = bench.plant.absorbed_mj;
    bench.faults.jitter_micros = 300;
    let (mut swing, mut peak) = (0.0f64, 0.0f64);
    for second in 0..SECONDS {
        if second % 600 == 0 {
            out.stage(&format!("minute {} of {}", second / 60, SECONDS / 60));
        }
        bench.trace.clear();
        bench.run(1.0);
        swing = swing.max(swing_mm(&bench.trace.records));
        peak = peak.max(peak_force_n(&bench.trace.records));
    }
    let drift = (bench.plant.position_mm - place).length();
    let row = json!({
        "ticks": bench.ticks(), "swing_mm": swing, "peak_n": peak, "drift_mm": drift,
        "absorbed_mj": bench.plant.absorbed_mj - absorbed,
    });
    out.section("soak", &row)?;
    out.say(&format!(
        "## Ten hours\n\n{} ticks of a press by a firm grip: largest swing in a second {swing:.4} mm, largest force \
         {peak:.3} N, drift {drift:.4} mm.",
        bench.ticks()
    ));
    Ok(())
}
