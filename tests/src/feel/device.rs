//! The device's electronics: encoders that floor, a delay of whole ticks, the torque that is in force.

use super::plant::{Plant, STEP_S};
use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use osteon_sim_core::arm::Arm;
use osteon_sim_core::omni;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{DeviceScale, Sample};
use std::collections::VecDeque;

/// The numbers of the simulated Omni-class device.
pub const OMNI: DeviceScale = DeviceScale {
    arm: Arm::Omni,
    counts_per_rev: 15_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    nmm_per_count: 0.215,
};

/// Encoders and converters so fine that quantisation is out of the picture.
pub const FINE: DeviceScale = DeviceScale {
    arm: Arm::Omni,
    counts_per_rev: 15_000_000,
    gimbal_counts_per_rev: 65_535,
    dac_max: 32_767,
    nmm_per_count: 0.0135,
};

/// Longest delay, ticks.
pub const MAX_DELAY: usize = 3;

/// A jump of the encoders in one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Glitch {
    /// In which tick.
    pub tick: u64,
    /// How far the stylus seems to jump, mm (through the shoulder, along its circle).
    pub jump_mm: f64,
}

/// Encoders, converters and the cable.
#[derive(Debug, Clone)]
pub struct Device {
    /// What the numbers mean.
    pub scale: DeviceScale,
    /// From a sample to the moment at which its command is in force, ticks; 0: at once.
    pub delay_ticks: usize,
    /// Whether the drive applies torque.
    pub drive_active: bool,
    /// Rotation of the stylus, base frame.
    pub rotation: DQuat,
    /// Buttons that are pressed.
    pub buttons: u8,
    // oldest first; at most `delay_ticks` that are still on the way
    coming: VecDeque<[i16; 3]>,
    in_force: [i16; 3],
    commands: u64,
    micros: u64,
}

impl Device {
    /// A device whose drive is active, its stylus along base z.
    pub fn new(scale: DeviceScale, delay_ticks: usize) -> Self {
        Self {
            scale,
            delay_ticks: delay_ticks.min(MAX_DELAY),
            drive_active: true,
            rotation: DQuat::IDENTITY,
            buttons: 0,
            coming: VecDeque::with_capacity(MAX_DELAY + 1),
            in_force: [0; 3],
            commands: 0,
            micros: 0,
        }
    }

    /// Points the stylus (from its tip to its rear end) along `axis`, base frame.
    pub fn point(&mut self, axis: DVec3) {
        self.rotation = Pose::from_origin_and_z(DVec3::ZERO, axis).rotation;
    }

    /// Device time, s.
    pub fn time_s(&self) -> f64 {
        self.micros as f64 * 1e-6
    }

    /// Torque in force, N·mm.
    pub fn torque_nmm(&self) -> DVec3 {
        if self.drive_active {
            DVec3::from_array(
                self.in_force
                    .map(|n| f64::from(n) * self.scale.nmm_per_count),
            )
        } else {
            DVec3::ZERO
        }
    }

    /// What the device reports of a plant at this moment; `jump_mm` is a broken encoder's.
    ///
    /// `applied` is the torque in force when the encoders are sampled, and from then on with any delay
    /// of one tick or more. Without delay the command of this very sample replaces it at once, which no
    /// frame can know.
    pub fn sample(&self, plant: &Plant, jump_mm: f64) -> Sample {
        let joints = plant.joints() + DVec3::Y * (jump_mm / omni::LINK_MM);
        let gimbal = omni::gimbal_for(plant.joints(), self.rotation).unwrap_or(DVec3::ZERO);
        let per_rad = f64::from(self.scale.counts_per_rev) / TAU;
        let gimbal_per_rad = f64::from(self.scale.gimbal_counts_per_rev) / TAU;
        #[expect(clippy::cast_possible_truncation, reason = "the casts saturate")]
        Sample {
            time_micros: (self.micros & 0xffff_ffff) as u32,
            encoders: ((joints - omni::DOCK) * per_rad)
                .to_array()
                .map(|v| v.floor() as i32),
            gimbal: (gimbal * gimbal_per_rad)
                .to_array()
                .map(|v| v.floor() as i16),
            buttons: self.buttons,
            drive_active: self.drive_active,
            docked: false,
            applied: if self.drive_active {
                self.in_force
            } else {
                [0; 3]
            },
            ack_age: self.ack_age(),
        }
    }

    fn ack_age(&self) -> u8 {
        let age = self.delay_ticks.max(1);
        if self.commands < age as u64 {
            return 0;
        }
        u8::try_from(age).unwrap_or(u8::MAX)
    }

    /// Takes a tick's command.
    pub fn command(&mut self, torque: [i16; 3]) {
        self.commands += 1;
        self.coming.push_back(torque);
        if self.delay_ticks == 0 {
            self.next_in_force();
        }
    }

    /// Lets `micros` pass: `step` is called for steps of at most [`STEP_S`] with the torque in force.
    pub fn pass(&mut self, micros: u32, mut step: impl FnMut(f64, DVec3)) {
        let whole = f64::from(micros) * 1e-6;
        let steps = (whole / STEP_S - 1e-9).ceil().max(1.0);
        let dt = whole / steps;
        let torque = self.torque_nmm();
        let mut done = 0.0;
        while done < steps {
            step(dt, torque);
            done += 1.0;
        }
        self.micros += u64::from(micros);
        if self.delay_ticks > 0 && self.coming.len() >= self.delay_ticks {
            self.next_in_force();
        }
    }

    fn next_in_force(&mut self) {
        if let Some(torque) = self.coming.pop_front() {
            self.in_force = torque;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::plant::PlantSpec;
    use super::*;

    #[test]
    fn a_command_is_in_force_after_its_delay_and_reported_so() {
        let plant = Plant::new(PlantSpec::TYPICAL, DVec3::ZERO).expect("in reach");
        for delay in 0..=MAX_DELAY {
            let mut device = Device::new(OMNI, delay);
            let mut seen = Vec::new();
            for k in 0..8i16 {
                let reported = device.sample(&plant, 0.0);
                device.command([100 + k, 0, 0]);
                let mut torque = DVec3::ZERO;
                device.pass(1000, |_, t| torque = t);
                let now = (torque.x / OMNI.nmm_per_count).round();
                if delay > 0 {
                    assert!((f64::from(reported.applied[0]) - now).abs() < 1e-9);
                }
                seen.push((now, reported.ack_age));
            }
            let late = i16::try_from(delay).expect("small");
            let age = u8::try_from(delay.max(1)).expect("small");
            assert_eq!(seen[7], (f64::from(107 - late), age), "delay {delay}");
            assert_eq!(seen[0].1, 0);
        }
    }

    #[test]
    fn encoders_floor_and_a_glitch_is_in_one_sample() {
        let plant = Plant::new(PlantSpec::TYPICAL, DVec3::new(3.0, 2.0, 1.0)).expect("in reach");
        let device = Device::new(OMNI, 1);
        let sample = device.sample(&plant, 0.0);
        let angles = omni::angles_from_counts(sample.encoders, OMNI.counts_per_rev);
        let off = (angles - plant.joints()).abs().max_element();
        assert!(off <= 0.5 * TAU / 15_000.0 + 1e-12, "{off}");
        let broken = device.sample(&plant, 10.0);
        let counts = broken.encoders[1] - sample.encoders[1];
        assert!((f64::from(counts) - 10.0 / omni::LINK_MM * 15_000.0 / TAU).abs() <= 1.0);
        assert_eq!(broken.encoders[0], sample.encoders[0]);
    }
}
