//! What a whole servo tick costs: kinematics, contact, solve, carve, guards, on a reamer pressed into a
//! joint. The samples are recorded once with a hand that pushes with a constant force; every replay sees
//! the same samples, so it does the same.
#![expect(
    clippy::cast_possible_truncation,
    reason = "encoder counts within ± a turn, ticks below 2^32"
)]

use crate::measure::intrinsic::Replay;
use glam::{DQuat, DVec3};
use osteon_firmware_bridge::scene::Scene;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::omni;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{DeviceScale, Request, Sample, Servo, ServoSetup, TickOutput};
use osteon_sim_core::tool::Tool;
use std::f64::consts::TAU;

/// The device of the bench: an Omni-class arm.
pub const DEVICE: DeviceScale = DeviceScale {
    counts_per_rev: 15_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    nmm_per_count: 0.215,
};
/// Ticks before the tool comes down: the ramp, the spindle.
const RUN_IN: usize = 1200;
/// Wobble of the hand: tilt, rad, sideways, mm, and its rate, Hz.
const WOBBLE: (f64, f64, f64) = (0.035, 0.3, 1.0);

/// A servo and the samples that it is fed.
#[derive(Debug)]
pub struct TickReplay {
    fresh: Servo,
    servo: Servo,
    samples: Vec<Sample>,
}

/// The raw sample of a device that holds the tool at `base_from_stylus`; `None` out of its reach.
pub fn sample_at(base_from_stylus: &Pose, time_micros: u32) -> Option<Sample> {
    let angles = omni::inverse(base_from_stylus.translation)?;
    let gimbal = omni::gimbal_for(angles, base_from_stylus.rotation)?;
    let per_rad = f64::from(DEVICE.counts_per_rev) / TAU;
    let gimbal_per_rad = f64::from(DEVICE.gimbal_counts_per_rev) / TAU;
    Some(Sample {
        time_micros,
        encoders: ((angles - omni::DOCK) * per_rad)
            .floor()
            .to_array()
            .map(|v| v as i32),
        gimbal: (gimbal * gimbal_per_rad)
            .floor()
            .to_array()
            .map(|v| v as i16),
        buttons: 0,
        drive_active: true,
        docked: false,
        applied: [0; 3],
        ack_age: 0,
    })
}

impl TickReplay {
    /// Records `ticks` of `tool` pushed with `push_n` N along the plan's axis of a scene.
    pub fn press(scene: &Scene, tool: Tool, push_n: f64, ticks: usize) -> Option<Self> {
        let registered = bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone());
        let feel = Feel::default();
        let setup = ServoSetup {
            bone: scene.bone.clone(),
            tools: vec![tool],
            bone_from_base: registered,
            bone_from_plan: scene.bone_from_plan,
            device: DEVICE,
            force_limit_n: 3.3,
            feel,
        };
        let fresh = Servo::new(setup)?;
        let mut servo = fresh.clone();
        let base_from_plan = registered.inverse().then(&scene.bone_from_plan);
        let plan_from_bone = scene.bone_from_plan.inverse();
        let lag = push_n / feel.coupling.stiffness_n_per_mm;
        let mut samples = Vec::with_capacity(ticks);
        let mut height = 8.0;
        for n in 0..ticks {
            let time_micros = (n as u32 + 1) * 1000;
            let angle = TAU * WOBBLE.2 * n as f64 * 1e-3;
            let turn = DQuat::from_rotation_x(WOBBLE.0 * angle.sin());
            let side = DVec3::X * (WOBBLE.1 * (0.7 * angle).sin());
            let plan_from_tool = Pose::new(turn, side + DVec3::Z * height);
            let sample = sample_at(&base_from_plan.then(&plan_from_tool), time_micros)?;
            let requests: &[Request] = if n == 0 {
                &[Request::Spindle(true)]
            } else {
                &[]
            };
            let out = servo.tick(Some(&sample), requests);
            samples.push(sample);
            let proxy = plan_from_bone.point(out.bone_from_tool.translation).z;
            if n > RUN_IN {
                // 20 mm/s down, and no further ahead of the tool than the push asks
                height = (height - 0.02).max(proxy - lag);
            }
        }
        Some(Self {
            servo: fresh.clone(),
            fresh,
            samples,
        })
    }

    /// Tick number `n`.
    pub fn tick(&mut self, n: usize) -> TickOutput {
        let requests: &[Request] = if n == 0 {
            &[Request::Spindle(true)]
        } else {
            &[]
        };
        self.servo.tick(Some(&self.samples[n]), requests)
    }

    /// Ticks that were recorded.
    pub fn ticks(&self) -> usize {
        self.samples.len()
    }

    /// The servo as the last replay left it.
    pub fn servo(&self) -> &Servo {
        &self.servo
    }
}

impl Replay for TickReplay {
    fn reset(&mut self) {
        self.servo.clone_from(&self.fresh);
    }

    fn event(&mut self, n: usize) -> bool {
        self.tick(n).force_n != DVec3::ZERO
    }
}
