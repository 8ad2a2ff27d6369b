//! What each guard and each term of the law is for: the loop without it.

pub mod law;

use super::bench::Bench;
use super::cases::impact::tap;
use super::hand::Hand;
use super::press;
use super::setup::Spec;
use super::trace::{rms_force_n, swing_mm};
use glam::DVec3;
use osteon_sim_core::chain::FORCE_LIMIT_N;
use osteon_sim_core::feel::Feel;
use serde::Serialize;

/// The loop without one of its guards.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AblationRow {
    /// What is left out.
    pub without: &'static str,
    /// Peak to peak of a press without a hand at two ticks of delay, mm.
    pub press_mm: f64,
    /// Most energy that the motors gave in it beyond what they took, mJ.
    pub press_gave_mj: f64,
    /// The same at 0.7 N/mm and three ticks, mm.
    pub stiff_press_mm: f64,
    /// Rebound over entry of a tap of 45 g at 1 m/s and two ticks.
    pub rebound_ratio: f64,
    /// Largest change of force in a tick in that tap, N.
    pub step_n: f64,
    /// RMS force from 3 s to 20 s deep in the bone, N.
    pub deep_rms_n: f64,
}

/// A guard that can be left out: its name and how.
type Ablation = (&'static str, fn(&mut Feel));

/// What can be left out.
const ABLATIONS: &[Ablation] = &[
    ("nothing", |_| {}),
    ("damping", |feel| feel.guard.damping_n_s_per_mm = 0.0),
    ("passivity controller", |feel| {
        feel.guard.passivity_n_s_per_mm = 0.0;
    }),
    ("both of them", |feel| {
        feel.guard.damping_n_s_per_mm = 0.0;
        feel.guard.passivity_n_s_per_mm = 0.0;
    }),
    ("slew limit", |feel| {
        feel.guard.rise_n_per_ms = FORCE_LIMIT_N;
    }),
    ("heat limit", |feel| feel.guard.continuous_n = FORCE_LIMIT_N),
];

/// The loop with each guard left out in turn.
pub fn rows() -> Vec<AblationRow> {
    ABLATIONS.iter().map(row).collect()
}

fn row((without, change): &Ablation) -> AblationRow {
    let mut spec = Spec::flat().with(Hand::NONE, 2);
    change(&mut spec.feel);
    let pressed = press::pressed(&spec, 10.0);
    let stiff = press::pressed(&spec.clone().with(Hand::NONE, 3).stiff(0.7), 10.0);
    let tapped = tap(&spec, 0.0, 2, 1000.0);
    AblationRow {
        without,
        press_mm: swing_mm(pressed.trace.last(1.0)),
        press_gave_mj: -pressed.trace.least_absorbed_mj(),
        stiff_press_mm: swing_mm(stiff.trace.last(1.0)),
        rebound_ratio: tapped.rebound_mm_s / tapped.entry_mm_s,
        step_n: tapped.step_n,
        deep_rms_n: deep_rms_n(&spec),
    }
}

fn deep_rms_n(spec: &Spec) -> f64 {
    let mut bench = Bench::new(spec);
    bench.run_in();
    bench.glide(DVec3::Z * -10.0, 40.0);
    bench.trace.clear();
    bench.rest(20.0);
    rms_force_n(bench.trace.last(17.0))
}
