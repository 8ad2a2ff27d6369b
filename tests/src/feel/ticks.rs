//! Time of the servo's whole tick: inputs of a run on the bench, replayed.

use super::bench::{Bench, Input};
use super::hand::Hand;
use super::press;
use super::setup::{Scene, Spec};
use crate::measure::intrinsic::{Quantiles, Replay, Subject, Timing, interleaved};
use crate::scenes::bones;
use anyhow::Result;
use glam::DVec3;
use osteon_firmware_bridge::scene::{SceneArgs, load};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Request, Servo};
use osteon_sim_core::tool::revolved::Revolved;
use osteon_sim_core::tool::{STEEL, Tool};
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

/// A reamer of about 500 elements: the standard dome with a taller flank.
fn reamer() -> Tool {
    Tool::revolved(
        ["Reamer of 500 elements", "reamer_500"],
        Revolved::dome([18.0, 30.0, 20.0]),
        (1000.0, 6),
        STEEL,
    )
}

/// The built-in scapula reamed.
pub fn scapula(voxel_mm: f64) -> Result<TickRow> {
    let built = bones::scapula(voxel_mm, 1.0)?;
    Ok(reamed(
        "built-in scapula, reamer",
        voxel_mm,
        built.bone,
        built.bone_from_plan,
    ))
}

/// The patient's scapula reamed; `None`, said aloud, where the data are missing.
pub fn patient(voxel_mm: f64) -> Result<Option<TickRow>> {
    let Some(folder) = crate::data("time of a tick on the patient's scapula") else {
        return Ok(None);
    };
    let args = SceneArgs {
        bone: Some(folder.join("right_shoulder_ct.nii.gz")),
        labels: Some(folder.join("right_shoulder_labels.nii.gz")),
        keep: vec![1],
        pose: Some(folder.join("right_glenoid_pose.json")),
        threshold: 120.0,
        voxel_mm: Some(voxel_mm),
        ..SceneArgs::default()
    };
    let scene = load(&args, &mut |_, _| {})?;
    let bone = Arc::unwrap_or_clone(scene.bone);
    Ok(Some(reamed(
        "patient's scapula, reamer",
        voxel_mm,
        bone,
        scene.bone_from_plan,
    )))
}

/// Reamed by a firm grip that wobbles by 5°.
fn reamed(name: &str, voxel_mm: f64, bone: Bone, bone_from_plan: Pose) -> TickRow {
    let scene = Scene {
        bone: Arc::new(bone),
        bone_from_base: bone_from_plan,
        tools: vec![reamer()],
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
    row(name, voxel_mm, &spec, &bench)
}
