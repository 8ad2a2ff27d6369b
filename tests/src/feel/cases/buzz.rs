//! Vibration: case 42.

use super::super::bench::Bench;
use super::super::feed::Faced;
use super::super::hand::Hand;
use super::super::press;
use super::super::setup::{Spec, socket};
use super::super::trace::{peak_force_n, swing_mm};
use super::press::{hold_words, holds};
use super::{Case, Worst};
use glam::DVec3;
use osteon_sim_core::chain::Guard;
use osteon_sim_core::servo::Request;
use rayon::prelude::*;

/// Push, N: below the engaged reamer's yield in hard bone, 0.55 N.
const PUSH_N: f64 = 0.4;
/// The press, s.
const SECONDS: f64 = 2.0;

/// A press of the turning reamer in its socket in hard bone, which does not bite.
struct Buzzed {
    /// What the servo's account lost or won in a second, mJ.
    drift_mj_s: f64,
    swing_mm: f64,
    peak_n: f64,
    vibration_n: f64,
    acted: u64,
}

fn buzzed((hand, delay): (Hand, usize), most_n: f64) -> Buzzed {
    let faced = Faced::reamer();
    let extent = DVec3::new(42.0, 42.0, 14.0);
    let mut spec = Spec::at(socket(&faced.tool, extent, 6.5, 1.9, 0.5)).with(hand, delay);
    // as strong as it may be
    spec.feel
        .materials
        .iter_mut()
        .for_each(|m| m.vibration = 2.0);
    spec.feel.guard.vibration_n = most_n;
    let mut bench = Bench::new(&spec);
    bench.requests.push(Request::Spindle(true));
    bench.run_in();
    press::meet(&mut bench, 20.0);
    press::push(
        &mut bench,
        PUSH_N,
        spec.feel.coupling.stiffness_n_per_mm,
        20.0,
    );
    bench.run(1.0);
    let energy = |b: &Bench| b.output.map_or(f64::NAN, |o| o.energy_mj);
    let acted = |b: &Bench| b.servo().map_or(0, |s| s.guards().of(Guard::Passivity));
    let (from, before) = (energy(&bench), acted(&bench));
    bench.trace.clear();
    let mut vibration_n = 0.0f64;
    for _ in 0..2000 {
        bench.tick();
        let shown = bench.output.map_or(f64::NAN, |o| o.vibration_n.length());
        vibration_n = vibration_n.max(shown);
    }
    Buzzed {
        drift_mj_s: (energy(&bench) - from) / SECONDS,
        swing_mm: swing_mm(bench.trace.last(1.0)),
        peak_n: peak_force_n(&bench.trace.records),
        vibration_n,
        acted: acted(&bench) - before,
    }
}

/// The largest force of a grip that reams flat bone with 0.9 N, and its vibration, N.
fn reamed(delay: usize) -> (f64, f64) {
    let faced = Faced::reamer();
    let extent = DVec3::new(42.0, 42.0, 18.0);
    let mut spec = Spec::at(socket(&faced.tool, extent, 6.5, 1.0, 0.5)).with(Hand::GRIP, delay);
    spec.feel
        .materials
        .iter_mut()
        .for_each(|m| m.vibration = 0.15);
    let mut bench = Bench::new(&spec);
    bench.requests.push(Request::Spindle(true));
    bench.run_in();
    press::meet(&mut bench, 20.0);
    // the grip's own spring slackens as the tool feeds: a steady push instead
    bench.hand.stiffness_n_per_m = 0.0;
    bench.pull.push_n = DVec3::Z * -0.9;
    // the push begins with a step: its overshoot is none of the vibration's doing
    bench.run(0.5);
    bench.trace.clear();
    let mut vibration = 0.0f64;
    for _ in 0..1500 {
        bench.tick();
        vibration = vibration.max(bench.output.map_or(f64::NAN, |o| o.vibration_n.length()));
    }
    (peak_force_n(&bench.trace.records), vibration)
}

/// Case 42.
pub(super) fn vibration() -> Case {
    let runs: Vec<_> = holds()
        .into_par_iter()
        .map(|hold| (hold, buzzed(hold, 0.25), buzzed(hold, 0.0)))
        .collect();
    let (mut drift, mut swing) = (Worst::default(), Worst::default());
    let (mut over, mut acted) = (Worst::default(), Worst::default());
    let mut least = f64::MAX;
    for (hold, with, without) in &runs {
        let place = || hold_words(*hold);
        drift.note((with.drift_mj_s - without.drift_mj_s).abs(), place);
        swing.note(with.swing_mm, place);
        over.note(with.peak_n - without.peak_n - with.vibration_n, place);
        acted.note(with.acted as f64, place);
        least = least.min(with.vibration_n);
    }
    let mut reaming = Worst::default();
    for delay in 0..=2 {
        let (peak, vibration) = reamed(delay);
        reaming.note(peak - 0.9 - vibration, || {
            format!("peak {peak:.3} N, {delay} ticks")
        });
    }
    Case {
        id: 42,
        name: "Vibration",
        criterion: "the engaged reamer at 1000 rpm (100 Hz) pressed by 0.4 N below yield, up to 0.25 N of vibration, three hands, 0 to 2 ticks of \
                    delay: against the same without vibration the servo's account drifts ≤ 1 mJ/s, no limit cycle (swing ≤ 0.11 mm), the \
                    peak is no more than the vibration higher (+ 0.1 N); a grip that reams with 0.9 N peaks at push + vibration (+ 0.15 N, \
                    friction and damping)"
            .to_owned(),
        measured: format!(
            "vibration {least:.3} N or more; drift {}; {}; beyond it {}; passivity acted in {} of 2000 ticks; reaming {}",
            drift.words("mJ/s"),
            swing.words("mm"),
            over.words("N"),
            acted.words(""),
            reaming.words("N")
        ),
        pass: drift.value <= 1.0
            && swing.value <= 0.11
            && over.value <= 0.1
            && reaming.value <= 0.15
            && least > 0.1,
    }
}
