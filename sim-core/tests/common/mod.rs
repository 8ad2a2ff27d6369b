//! Bones made from a signed-distance function, for the tests.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::allow_attributes,
    clippy::expect_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    clippy::missing_panics_doc,
    missing_docs,
    missing_debug_implementations,
    reason = "helpers for tests; each test file uses a part of them"
)]

pub mod brute;
pub mod motley;
pub mod random;
pub mod shapes;
pub mod surface;

use glam::DVec3;
use osteon_sim_core::arm::Arm;
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::{Tissue, hu_of_density};
use std::sync::Arc;

/// A bone whose signed distance (mm, positive inside) is `sd(point in the bone frame)`, of one
/// density (g/cm³) and of class cancellous.
pub fn bone_of(
    dims: [usize; 3],
    spacing: DVec3,
    density: f64,
    sd: impl Fn(DVec3) -> f64,
) -> Arc<Bone> {
    let grid = Grid::new(dims, spacing).expect("a valid grid");
    let mut solid = vec![0.0f32; grid.len()];
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                solid[grid.dense_index(i, j, k)] = sd(grid.centre(i, j, k)) as f32;
            }
        }
    }
    let hu = vec![hu_of_density(density).round() as i16; grid.len()];
    let class = vec![Tissue::Cancellous as u8; grid.len()];
    let label = vec![1; grid.len()];
    let dense = DenseBone {
        density_hu: &hu,
        solid_mm: &solid,
        class: &class,
        label: &label,
    };
    Arc::new(Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone"))
}

/// A half space below the plane `z = top`, in a lattice of `extent` mm.
pub fn slab(extent: DVec3, spacing: DVec3, top: f64, density: f64) -> Arc<Bone> {
    let dims = (extent / spacing).to_array().map(|n| n as usize + 1);
    bone_of(dims, spacing, density, |p| top - p.z)
}

use glam::DQuat;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::omni;
use osteon_sim_core::servo::{DeviceScale, Request, Sample, Servo, ServoSetup, TickOutput};
use osteon_sim_core::tool::Tool;

/// Fine enough that quantisation does not blur a closed form.
pub const FINE: DeviceScale = DeviceScale {
    arm: Arm::Omni,
    counts_per_rev: 15_000_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    nmm_per_count: 0.215,
};

/// A servo on the virtual clock whose device is where the test says: base z is bone z, and the base's
/// origin lies at `origin` in the bone.
pub struct Rig {
    pub servo: Servo,
    pub origin: DVec3,
    pub time_micros: u32,
    pub active: bool,
}

impl Rig {
    pub fn new(bone: Arc<Bone>, origin: DVec3) -> Self {
        Self::with_tools(bone, origin, Tool::standard_set())
    }

    pub fn with_tools(bone: Arc<Bone>, origin: DVec3, tools: Vec<Tool>) -> Self {
        let setup = ServoSetup {
            bone,
            tools,
            bone_from_base: Pose::new(DQuat::IDENTITY, origin),
            bone_from_plan: Pose::new(DQuat::IDENTITY, origin),
            device: FINE,
            force_limit_n: 3.3,
            feel: Feel::default(),
        };
        Self {
            servo: Servo::new(setup).expect("tools"),
            origin,
            time_micros: 0,
            active: true,
        }
    }

    /// The raw sample of a device whose gimbal is at `tip` (bone frame), the stylus along `axis`.
    pub fn sample(&mut self, tip: DVec3, axis: DVec3) -> Sample {
        self.time_micros = self.time_micros.wrapping_add(1000);
        let t = omni::inverse(tip - self.origin).expect("in reach");
        let rotation = Pose::from_origin_and_z(DVec3::ZERO, axis).rotation;
        let gimbal = omni::gimbal_for(t, rotation).expect("a wrist pose");
        let per_rad = f64::from(FINE.counts_per_rev) / std::f64::consts::TAU;
        let gimbal_per_rad = f64::from(FINE.gimbal_counts_per_rev) / std::f64::consts::TAU;
        Sample {
            time_micros: self.time_micros,
            encoders: ((t - omni::DOCK) * per_rad)
                .floor()
                .to_array()
                .map(|v| v as i32),
            gimbal: (gimbal * gimbal_per_rad)
                .round()
                .to_array()
                .map(|v| v as i16),
            buttons: 0,
            drive_active: self.active,
            docked: false,
            applied: [0; 3],
            ack_age: 0,
        }
    }

    pub fn tick_at(&mut self, tip: DVec3, requests: &[Request]) -> TickOutput {
        let sample = self.sample(tip, DVec3::Z);
        self.servo.tick(Some(&sample), requests)
    }

    /// Runs `ticks` at one place; the last output.
    pub fn rest(&mut self, tip: DVec3, ticks: u32) -> TickOutput {
        let mut last = self.tick_at(tip, &[]);
        for _ in 1..ticks {
            last = self.tick_at(tip, &[]);
        }
        last
    }

    /// Moves in a straight line at `speed` mm/s; the last output.
    pub fn glide(&mut self, from: DVec3, to: DVec3, speed: f64) -> TickOutput {
        let ticks = ((to - from).length() / speed * 1000.0).ceil().max(1.0) as u32;
        let mut last = self.tick_at(from, &[]);
        for n in 1..=ticks {
            last = self.tick_at(from.lerp(to, f64::from(n) / f64::from(ticks)), &[]);
        }
        last
    }
}
