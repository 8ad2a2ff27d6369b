//! The motors' heat: case 41.

use super::super::bench::Bench;
use super::super::setup::Spec;
use super::super::trace::{force_step_n, peak_force_n, rms_force_n};
use super::Case;
use glam::DVec3;

/// Case 41.
pub(super) fn minute_at_the_limit() -> Case {
    let mut bench = Bench::new(&Spec::flat());
    bench.run_in();
    bench.glide(DVec3::ZERO, 50.0);
    bench.trace.clear();
    bench.glide(DVec3::Z * -10.0, 40.0);
    bench.rest(60.0);
    let start = bench.trace.records.first().map_or(0.0, |r| r.time_s);
    let from = |seconds: f64| bench.trace.between(start + seconds, f64::INFINITY);
    // the limit is reached 6.6 mm deep, after 0.17 s; the glide ends after 0.25 s
    let (peak, rms) = (peak_force_n(from(0.0)), rms_force_n(from(3.2)));
    let step = force_step_n(from(0.26));
    Case {
        id: 41,
        name: "A minute at the limit",
        criterion: "10 mm inside for 60 s: 3.3 N at first, RMS ≤ 0.88 N (and 3 steps of the converter) from 3 s after \
                    the limit was reached; no step above 0.05 N in a tick once the device rests"
            .to_owned(),
        measured: format!("peak {peak:.3} N; RMS {rms:.4} N; largest step {step:.4} N"),
        pass: peak > 3.2 && rms <= 0.885 && step <= 0.05,
    }
}
