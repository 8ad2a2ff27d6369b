//! Time of the servo's whole tick: inputs of a run on the bench, replayed.

use super::bench::{Bench, Input};
use super::hand::Hand;
use super::press;
use super::setup::{Scene, Spec};
use crate::measure::intrinsic::{Quantiles, Replay, Subject, Timing, interleaved};
use crate::scenes::bones;
use anyhow::Result;
use glam::DVec3;
use osteon_sim_core::servo::{Request, Servo};
use osteon_sim_core::tool::Tool;
use serde::Serialize;
use std::sync::Arc;

/// Replays; the least time of each tick is kept.
const REPLAYS: usize = 3;
/// Push while reaming, N.
const PUSH_N: f64 = 1.5;
/// Reaming, s.
const CUT_S: u32 = 6;

/// Time of a tick.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TickRow {
    /// What was done.
    pub scene: String,
    /// Voxels, mm.
    pub voxel_mm: f64,
    /// Elements of the tool.
    pub elements: usize,
    /// Ticks in which the proxy touched or cut.
    pub ticks: usize,
    /// Median over those ticks, µs.
    pub p50_us: f64,
    /// 99th percentile, µs.
    pub p99_us: f64,
    /// Largest, µs.
    pub max_us: f64,
    /// The 99th percentile of all replays with the machine's noise, µs.
    pub raw_p99_us: f64,
}

/// A servo that is given the same inputs again.
struct Again<'a> {
    fresh: &'a Servo,
    servo: Servo,
    inputs: &'a [Input],
}

impl Replay for Again<'_> {
    fn reset(&mut self) {
        self.servo = self.fresh.clone();
    }

    fn event(&mut self, n: usize) -> bool {
        let input = &self.inputs[n];
        let output = self.servo.tick(input.sample.as_ref(), &input.requests);
        output.force_n != DVec3::ZERO || output.carved_len > 0
    }
}

/// Replays the inputs that a bench has kept on a fresh servo of its specification.
pub fn timing(spec: &Spec, inputs: &[Input]) -> Timing {
    let fresh = spec.servo();
    let mut again = Again {
        servo: fresh.clone(),
        fresh: &fresh,
        inputs,
    };
    let mut subjects = [Subject {
        replay: &mut again,
        events: inputs.len(),
        stride: 1,
    }];
    interleaved(&mut subjects, REPLAYS).remove(0)
}

/// The row of a run.
pub fn row(scene: &str, voxel_mm: f64, spec: &Spec, bench: &Bench) -> TickRow {
    let timing = timing(spec, bench.kept.as_deref().unwrap_or_default());
    let (contact, raw): (Quantiles, Quantiles) = (timing.contact(), timing.raw());
    TickRow {
        scene: scene.to_owned(),
        voxel_mm,
        elements: spec.scene.tools.first().map_or(0, |t| t.elements.len()),
        ticks: contact.count,
        p50_us: contact.p50_us,
        p99_us: contact.p99_us,
        max_us: contact.max_us,
        raw_p99_us: raw.p99_us,
    }
}

/// The built-in scapula reamed by a firm grip that wobbles by 5°.
pub fn scapula(voxel_mm: f64) -> Result<TickRow> {
    let built = bones::scapula(voxel_mm, 1.0)?;
    let scene = Scene {
        bone: Arc::new(built.bone),
        bone_from_base: built.bone_from_plan,
        tools: vec![Tool::glenoid_reamer()],
    };
    let spec = Spec::at(scene).with(Hand::GRIP, 1);
    let mut bench = Bench::new(&spec);
    bench.kept = Some(Vec::new());
    bench.run_in();
    bench.requests.push(Request::Spindle(true));
    press::push(
        &mut bench,
        PUSH_N,
        spec.feel.coupling.stiffness_n_per_mm,
        20.0,
    );
    for n in 0..CUT_S * 1000 {
        let (s, c) = (core::f64::consts::PI * f64::from(n) * 1e-3).sin_cos();
        let lean = 5f64.to_radians();
        bench.device.point(DVec3::new(lean * s, lean * s * c, 1.0));
        bench.tick();
    }
    Ok(row("scapula, reamer, wobbling", voxel_mm, &spec, &bench))
}
