//! From raw samples to a believed place of the stylus, and to button presses.

use super::io::{DeviceScale, Sample, button};
use crate::arm::Arm;
use crate::pose::Pose;
use glam::{DQuat, DVec3};

/// Implausible samples in a row after which the new place, or the new time, is believed.
const RESYNC_AFTER: u32 = 5;
/// Fastest turn of the stylus that is believed, rad/ms: a wrist makes 20 rad/s.
const TURN_RAD_PER_MS: f64 = 0.15;
/// A hand that moved less than this during a gap goes on where it was, mm.
const GAP_TRUST_MM: f64 = 40.0;
/// Time that a button is deaf after an edge (contact bounce), s.
const BUTTON_DEAF_S: f64 = 0.03;

/// A past, plausible position.
#[derive(Debug, Clone, Copy)]
struct Track {
    time_micros: u32,
    position: DVec3,
    velocity_mm_s: DVec3,
}

/// What is known of the stylus.
#[derive(Debug, Clone)]
pub(super) struct Intake {
    track: Option<Track>,
    angles: DVec3,
    base_from_stylus: Pose,
    implausible_run: u32,
    buttons: u8,
    deaf: [u32; 2],
}

/// What a sample turned out to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// Believed.
    Accepted {
        /// Backward difference, mm/s, base frame.
        velocity_mm_s: DVec3,
        /// The stylus is elsewhere than before: the proxy begins anew.
        jumped: bool,
    },
    /// No hand can have moved so.
    Implausible,
    /// Not a number.
    NotFinite,
    /// Time stood still or ran backwards: the sample was seen before.
    Stale,
}

impl Intake {
    pub(super) fn new(arm: Arm) -> Self {
        Self {
            track: None,
            angles: arm.rest(),
            base_from_stylus: Pose::IDENTITY,
            implausible_run: 0,
            buttons: 0,
            deaf: [0; 2],
        }
    }

    /// The arm's coordinates in the newest believed sample: rad, or mm.
    pub(super) fn angles(&self) -> DVec3 {
        self.angles
    }

    /// The stylus of the newest believed sample.
    pub(super) fn base_from_stylus(&self) -> &Pose {
        &self.base_from_stylus
    }

    /// Kinematics and plausibility of a sample. `silent`: the force has been off for want of samples;
    /// a hand that has not gone far meanwhile goes on where it was, since the proxy alone knows on which
    /// side of the bone the tool is. `most`: largest second difference, mm/ms².
    pub(super) fn take(
        &mut self,
        sample: &Sample,
        device: DeviceScale,
        silent: bool,
        most: f64,
    ) -> Verdict {
        let angles = device.arm.coordinates(sample.encoders, &device);
        let gimbal = device.arm.gimbal(sample.gimbal, &device);
        let base_from_stylus = device.arm.stylus(angles, gimbal);
        let position = base_from_stylus.translation;
        if !base_from_stylus.is_valid() {
            return Verdict::NotFinite;
        }
        let mut velocity_mm_s = DVec3::ZERO;
        let mut jumped = false;
        if let Some(track) = self.track {
            let micros = sample.time_micros.wrapping_sub(track.time_micros);
            let backwards = micros > u32::MAX / 2;
            if micros == 0 || (backwards && self.implausible_run < RESYNC_AFTER) {
                self.implausible_run += u32::from(backwards);
                return Verdict::Stale;
            }
            let ms = (f64::from(micros) * 1e-3).clamp(0.1, 1000.0);
            let expected = track.position + track.velocity_mm_s * (ms * 1e-3);
            let moved = (position - expected).length() <= most * (ms * ms).max(1.0);
            let turn = angle(base_from_stylus.rotation, self.base_from_stylus.rotation);
            let turned = turn <= TURN_RAD_PER_MS * ms.max(1.0);
            let plausible = moved && turned && !backwards;
            if !plausible && self.implausible_run < RESYNC_AFTER {
                self.implausible_run += 1;
                return Verdict::Implausible;
            }
            if plausible {
                velocity_mm_s = (position - track.position) / (ms * 1e-3);
            }
            let far = (position - track.position).length() > GAP_TRUST_MM;
            jumped = !plausible || (silent && far);
        }
        self.implausible_run = 0;
        self.track = Some(Track {
            time_micros: sample.time_micros,
            position,
            velocity_mm_s,
        });
        self.angles = angles;
        self.base_from_stylus = base_from_stylus;
        Verdict::Accepted {
            velocity_mm_s,
            jumped,
        }
    }

    /// A device that was connected anew: its clock and its place say nothing about the last one's.
    pub(super) fn forget(&mut self) {
        self.track = None;
        self.implausible_run = 0;
    }

    /// The buttons that were pressed anew, [`button`] bits.
    pub(super) fn pressed(&mut self, buttons: u8, tick_s: f64) -> u8 {
        let mut pressed = 0;
        for (i, bit) in [button::SPINDLE, button::NEXT_TOOL].into_iter().enumerate() {
            self.deaf[i] = self.deaf[i].saturating_sub(1);
            let changed = (buttons ^ self.buttons) & bit != 0;
            if !changed || self.deaf[i] > 0 {
                continue;
            }
            self.buttons ^= bit;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "some hundred ticks at most"
            )]
            let deaf = (BUTTON_DEAF_S / tick_s) as u32;
            self.deaf[i] = deaf;
            pressed |= buttons & bit;
        }
        pressed
    }
}

/// Angle between two rotations, rad.
fn angle(a: DQuat, b: DQuat) -> f64 {
    let arc = a * b.conjugate();
    2.0 * libm::atan2(arc.xyz().length(), arc.w.abs())
}
