//! Missing, late and broken samples: cases 14 to 16.

use super::super::bench::{Bench, Faults, Gaps};
use super::super::device::Glitch;
use super::super::hand::Hand;
use super::super::press::{SETTLED_MM, borne, pressed};
use super::super::setup::Spec;
use super::super::trace::{Record, force_step_n, swing_mm};
use super::press::{hold_words, holds};
use super::{Case, Worst};
use glam::DVec3;
use osteon_sim_core::servo::Request;
use rayon::prelude::*;
use serde::Serialize;

/// From one gap to the next, ticks: 5 Hz.
const EVERY: u64 = 200;
/// Lengths of the gaps, ticks.
const LENGTHS: [u64; 6] = [1, 2, 5, 10, 20, 50];
/// The time over which the force may come back, ticks.
const RAMP: usize = 50;

/// What gaps of one length did to a press.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GapRow {
    /// Who holds the device.
    pub hand: &'static str,
    /// From a sample to its command in force.
    pub delay_ticks: usize,
    /// Ticks without a sample, five times a second.
    pub gap_ticks: u64,
    /// Peak to peak of the place over the second second of gaps, mm.
    pub swing_mm: f64,
    /// Force that is still asked for in the last missing tick, N.
    pub left_n: f64,
    /// Largest share of the limit's ramp that is used after a gap; above 1 the force came back faster.
    pub ramp_share: f64,
    /// Peak to peak of the place in the last of two seconds without gaps, mm.
    pub after_mm: f64,
    /// Whether the face bears the push then; if not, the servo has lost the side that the tool is on.
    pub borne: bool,
    /// Least of the energy account, mJ.
    pub least_absorbed_mj: f64,
}

/// A press that is still, then two seconds of gaps, then two without.
pub fn gap_row(spec: &Spec, gap_ticks: u64) -> GapRow {
    let mut bench = pressed(spec, 2.0);
    bench.trace.clear();
    bench.faults.gaps = Some(Gaps {
        from: bench.ticks(),
        every: EVERY,
        length: gap_ticks,
    });
    bench.run(2.0);
    let swing = swing_mm(bench.trace.last(1.0));
    let (left_n, ramp_share) = force_around(&bench.trace.records, gap_ticks);
    bench.faults = Faults::default();
    bench.run(2.0);
    GapRow {
        hand: spec.hand.name,
        delay_ticks: spec.delay_ticks,
        gap_ticks,
        swing_mm: swing,
        left_n,
        ramp_share,
        after_mm: swing_mm(bench.trace.last(1.0)),
        borne: borne(&bench),
        least_absorbed_mj: bench.trace.least_absorbed_mj(),
    }
}

/// Force asked for in the last missing tick of any gap, N, and the largest share of a ramp of
/// [`RAMP`] ticks to 3.3 N that is used after one.
fn force_around(records: &[Record], gap_ticks: u64) -> (f64, f64) {
    let gap = usize::try_from(gap_ticks).unwrap_or(usize::MAX);
    let (mut left, mut share) = (0.0f64, 0.0f64);
    for period in records.chunks(usize::try_from(EVERY).unwrap_or(1)) {
        left = left.max(period.get(gap - 1).map_or(0.0, |r| r.asked_n.length()));
        for (n, record) in period.iter().skip(gap).take(RAMP).enumerate() {
            let allowed = 3.3 * (n + 1) as f64 / RAMP as f64;
            share = share.max(record.asked_n.length() / allowed);
        }
    }
    (left, share)
}

/// Every length of gap with every hand and one tick of delay.
pub fn all_gaps(spec: &Spec) -> Vec<GapRow> {
    let lengths = |hand| LENGTHS.map(|length| (hand, length));
    let all: Vec<(Hand, u64)> = Hand::ALL.into_iter().flat_map(lengths).collect();
    all.into_par_iter()
        .map(|(hand, length)| gap_row(&spec.clone().with(hand, 1), length))
        .collect()
}

/// Case 14.
pub(super) fn dropped_frames() -> Case {
    let mut short = Worst::default();
    let (mut left, mut share, mut after) = (Worst::default(), Worst::default(), Worst::default());
    let (mut lost, mut held_are_borne) = (Vec::new(), true);
    for row in all_gaps(&Spec::flat()) {
        let place = || format!("{}, {} ms", row.hand, row.gap_ticks);
        if !row.borne {
            lost.push(place());
            // a bare device falls 10 mm in 50 ms, and nobody holds it
            held_are_borne &= row.hand == Hand::NONE.name;
        }
        if row.gap_ticks <= 5 {
            short.note(row.swing_mm, place);
        }
        if row.gap_ticks >= 20 {
            left.note(row.left_n, place);
            share.note(row.ramp_share, place);
            after.note(row.after_mm, place);
        }
    }
    Case {
        id: 14,
        name: "Dropped frames",
        criterion: "gaps of 1, 2, 5, 10, 20 and 50 ms five times a second, three hands: up to 5 ms the place swings ≤ \
                    0.25 mm; the force is 0 by 20 ms; after gaps of 20 and 50 ms it returns no faster than over 50 ms \
                    and two seconds later the press is still (and with a hand still borne)"
            .to_owned(),
        measured: format!(
            "≤ 5 ms: {}; left at 20 ms: {}; share of the ramp {}; after: {}; not borne: {lost:?}",
            short.words("mm"),
            left.words("N"),
            share.words(""),
            after.words("mm")
        ),
        pass: short.value <= 0.25
            && left.value <= 0.0
            && share.value <= 1.0 + 1e-9
            && after.value <= SETTLED_MM
            && held_are_borne,
    }
}

/// Case 15.
pub(super) fn jitter() -> Case {
    let runs: Vec<_> = holds()
        .into_par_iter()
        .map(|hold| {
            let mut bench = pressed(&Spec::flat().with(hold.0, hold.1), 2.0);
            bench.faults.jitter_micros = 300;
            bench.faults.stall = Some((1000, 5000));
            bench.run(8.0);
            (hold, bench)
        })
        .collect();
    let (mut swing, mut given) = (Worst::default(), Worst::default());
    let mut all_borne = true;
    for (hold, bench) in &runs {
        swing.note(swing_mm(bench.trace.last(2.5)), || hold_words(*hold));
        given.note(-bench.trace.least_absorbed_mj(), || hold_words(*hold));
        all_borne &= borne(bench);
    }
    Case {
        id: 15,
        name: "Jitter and stalls",
        criterion: "ticks of 1 ± 0.3 ms and one of 5 ms every second, three hands, 0 to 2 ticks of delay: the motors \
                    never gave more than 2 mJ beyond what they took; the place swings ≤ 0.25 mm"
            .to_owned(),
        measured: format!("gave {}; {}", given.words("mJ"), swing.words("mm")),
        pass: all_borne && given.value < 2.0 && swing.value <= 0.25,
    }
}

/// What a broken sample did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GlitchRow {
    /// Jump of the stylus in the one sample, mm.
    pub jump_mm: f64,
    /// Largest change of the motors' force from one tick to the next in the 50 ms after it, N.
    pub step_n: f64,
    /// By how much the force differs 50 ms later, N.
    pub later_n: f64,
    /// Whether the servo refused the sample.
    pub refused: bool,
    /// Good samples that it refused in the next 50 ms.
    pub good_refused: u64,
    /// Occupancy removed in 50 ticks of a cut with it over that without it.
    pub removed_ratio: f64,
}

/// A broken sample in a press, and in a steady cut.
pub fn glitch_row(jump_mm: f64) -> GlitchRow {
    let spec = Spec::flat().with(Hand::GRIP, 1);
    let mut still = pressed(&spec, 2.0);
    let mut cutting = still.clone();
    let force = |bench: &Bench| {
        bench
            .trace
            .records
            .last()
            .map_or(DVec3::ZERO, |r| r.force_n)
    };
    let before = force(&still);
    still.trace.clear();
    let missed = broken(&mut still, Some(jump_mm));
    cutting.requests.push(Request::Spindle(true));
    cutting.run(1.0);
    let mut without = cutting.clone();
    let with = broken(&mut cutting, Some(jump_mm)).removed;
    GlitchRow {
        jump_mm,
        step_n: force_step_n(&still.trace.records),
        later_n: (force(&still) - before).length(),
        refused: missed.refused,
        good_refused: missed.good_refused,
        removed_ratio: with / broken(&mut without, None).removed,
    }
}

struct Broken {
    refused: bool,
    good_refused: u64,
    removed: f64,
}

/// Runs 50 ticks, the first with a jump.
fn broken(bench: &mut Bench, jump_mm: Option<f64>) -> Broken {
    let removed = |bench: &Bench| {
        let by_class = bench.output.map(|o| o.removed_by_class);
        by_class.map_or(0, |c| c.iter().sum::<i64>()) as f64
    };
    let before = removed(bench);
    bench.faults.glitch = jump_mm.map(|jump_mm| Glitch {
        tick: bench.ticks(),
        jump_mm,
    });
    let mut fresh = || {
        bench.tick();
        bench.output.is_some_and(|o| o.fresh)
    };
    let refused = !fresh();
    let mut good_refused = 0;
    for _ in 1..50 {
        good_refused += u64::from(!fresh());
    }
    Broken {
        refused,
        good_refused,
        removed: removed(bench) - before,
    }
}

/// Case 16.
pub(super) fn glitch() -> Case {
    let jumps = [1.0, -1.0, 10.0, -10.0, 1000.0];
    let rows: Vec<GlitchRow> = jumps.into_par_iter().map(glitch_row).collect();
    let (mut step, mut later) = (Worst::default(), Worst::default());
    let (mut extra, mut good) = (Worst::default(), Worst::default());
    for row in &rows {
        let place = || format!("{:.0} mm", row.jump_mm);
        step.note(row.step_n, place);
        later.note(row.later_n, place);
        extra.note(100.0 * (row.removed_ratio - 1.0), place);
        good.note(row.good_refused as f64, place);
    }
    let kept_out = |row: &GlitchRow| row.refused || row.jump_mm.abs() < 5.0;
    Case {
        id: 16,
        name: "Broken sample",
        criterion: "one sample that jumps by 1, 10 or 1000 mm in a press and in a cut: those of more than 5 mm are \
                    refused; the force changes ≤ 0.1 N in a tick and 50 ms later; removal over 50 ms is at most 1 % more"
            .to_owned(),
        measured: format!(
            "{}; later {}; removal {} more; good samples refused: {}",
            step.words("N"),
            later.words("N"),
            extra.words("%"),
            good.words("")
        ),
        pass: rows.iter().all(kept_out)
            && step.value <= 0.1
            && later.value <= 0.1
            && extra.value <= 1.0,
    }
}
