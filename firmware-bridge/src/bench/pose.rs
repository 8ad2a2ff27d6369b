//! How well the host knows where the stylus is: counts against the plant's truth.

use crate::fake::plant::{ArmParameters, Plant, gimbal_counts};
use crate::fake::pots::Pots;
use crate::fake::random::Random;
use glam::{DQuat, DVec3};
use osteon_sim_core::omni::{self, JOINT_LIMITS};
use osteon_sim_core::pots::PotWrist;
use serde::Serialize;

const COUNTS_PER_REV: u32 = 15_000;
const GIMBAL_COUNTS_PER_REV: u16 = 16_384;
/// From the gimbal's centre to the stylus' tip, mm (`mtsSensableHD.cpp` of sawSensablePhantom).
pub const TIP_MM: f64 = 39.0;
/// Corner of the host's velocity filter, Hz, as in the shipped parameters.
const FILTER_HZ: f64 = 50.0;
/// From the sampling of a state to its use, s: half a tick in lockstep.
const AGE_S: f64 = 0.5e-3;

/// Errors of many poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Root of the mean square.
    pub rms: f64,
    /// 99 of 100 are smaller.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    fn of(mut errors: Vec<f64>) -> Self {
        errors.sort_by(f64::total_cmp);
        let count = errors.len().max(1);
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count as f64).sqrt();
        Self {
            rms,
            p99: errors.get(count * 99 / 100).copied().unwrap_or(0.0),
            max: errors.last().copied().unwrap_or(0.0),
        }
    }
}

/// A speed and what it costs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Moving {
    /// Speed of the gimbal's centre, m/s.
    pub speed_m_s: f64,
    /// Place as the host uses it against the truth at that moment, mm.
    pub place_mm: Spread,
    /// Filtered velocity against the true one, steady motion, m/s.
    pub velocity_m_s: Spread,
    /// Time by which the filtered velocity lags a sine of 5 Hz, ms.
    pub velocity_lag_ms: f64,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PoseErrors {
    /// Gimbal centre at rest, mm.
    pub static_mm: Spread,
    /// In motion.
    pub moving: Vec<Moving>,
    /// Tip, from the gimbal's sensors alone, mm: 14-bit encoders.
    pub tip_encoders_mm: Spread,
    /// The same with potentiometers that are taken for linear.
    pub tip_pots_mm: Spread,
    /// The same with a table of 17 points for each.
    pub tip_pots_calibrated_mm: Spread,
}

fn joints(random: &mut Random) -> DVec3 {
    let [waist, shoulder, bend] = JOINT_LIMITS.map(|[lo, hi]| lo + (hi - lo) * random.unit());
    DVec3::new(waist, shoulder, shoulder + bend)
}

fn seen(plant: &Plant) -> DVec3 {
    omni::forward(omni::angles_from_counts(plant.encoders(), COUNTS_PER_REV))
}

fn at_rest(random: &mut Random) -> Spread {
    let mut plant = Plant::new(ArmParameters::default(), [0; 3]);
    let error = |_| {
        plant.place(joints(random), DVec3::ZERO);
        (seen(&plant) - plant.motion().position).length()
    };
    Spread::of((0..20_000).map(error).collect())
}

// along x through the middle of the workspace, there and back
fn moving(speed_m_s: f64) -> Moving {
    let mut plant = Plant::new(ArmParameters::default(), [0; 3]);
    let gain = 1.0 - libm::exp(-core::f64::consts::TAU * FILTER_HZ * 1e-3);
    let (mut places, mut velocities) = (Vec::new(), Vec::new());
    for y in -20..=20 {
        let mut filtered = 0.0;
        let mut before: Option<f64> = None;
        let ticks = (100.0 / speed_m_s).min(400.0);
        let mut tick = 0.0;
        while tick < ticks {
            let x = -50.0 + speed_m_s * tick;
            let point = |x| omni::inverse(DVec3::new(x, f64::from(y) * 1.37, 5.0));
            tick += 1.0;
            let (Some(now), Some(used)) = (point(x), point(x + speed_m_s * AGE_S * 1e3)) else {
                continue;
            };
            plant.place(now, DVec3::ZERO);
            let host = seen(&plant);
            places.push((host - omni::forward(used)).length());
            if let Some(last) = before {
                filtered += (host.x - last - filtered) * gain;
            } else {
                filtered = speed_m_s;
            }
            before = Some(host.x);
            // mm a tick are m/s
            velocities.push((filtered - speed_m_s).abs());
        }
    }
    Moving {
        speed_m_s,
        place_mm: Spread::of(places),
        velocity_m_s: Spread::of(velocities),
        velocity_lag_ms: lag_ms(gain),
    }
}

// phase of backward difference and filter on a sine of 5 Hz, by correlation over whole periods
fn lag_ms(gain: f64) -> f64 {
    let omega = core::f64::consts::TAU * 5.0;
    let (mut filtered, mut with, mut across) = (0.0, 0.0, 0.0);
    for n in 0..1200 {
        let t = f64::from(n) * 1e-3;
        let rate = (libm::sin(omega * t) - libm::sin(omega * (t - 1e-3))) / 1e-3;
        filtered += (rate - filtered) * gain;
        if n >= 200 {
            with += filtered * libm::cos(omega * t);
            across += filtered * libm::sin(omega * t);
        }
    }
    libm::atan2(across, with) / omega * 1e3
}

fn tips(random: &mut Random) -> [Spread; 3] {
    let mut errors = [Vec::new(), Vec::new(), Vec::new()];
    for seed in 0..40 {
        let mut pots = Pots::new(seed);
        let calibrated = pots.calibration();
        for _ in 0..200 {
            let true_angles = DVec3::from_array([(); 3].map(|()| 2.0 * random.unit() - 1.0)) * 1.5;
            let counts = gimbal_counts(true_angles);
            let (a, b) = pots.read(true_angles);
            let read = [
                omni::gimbal_from_counts(counts, GIMBAL_COUNTS_PER_REV),
                PotWrist::OMNI.angles(a, b),
                calibrated.angles(a, b),
            ];
            for (list, angles) in errors.iter_mut().zip(read) {
                list.push((tip(angles) - tip(true_angles)).length());
            }
        }
    }
    errors.map(Spread::of)
}

// the tip against the gimbal's centre, forearm hanging
fn tip(angles: DVec3) -> DVec3 {
    let rotation: DQuat = omni::stylus(DVec3::ZERO, angles).rotation;
    rotation * DVec3::new(0.0, 0.0, -TIP_MM)
}

/// Measures.
pub fn measure() -> PoseErrors {
    let mut random = Random::new(41);
    let static_mm = at_rest(&mut random);
    let [tip_encoders_mm, tip_pots_mm, tip_pots_calibrated_mm] = tips(&mut random);
    let speeds = [0.01, 0.03, 0.1, 0.3, 0.6, 1.0];
    PoseErrors {
        static_mm,
        moving: speeds.map(moving).to_vec(),
        tip_encoders_mm,
        tip_pots_mm,
        tip_pots_calibrated_mm,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gimbals_centre_is_known_to_0_06_mm_at_rest_and_its_age_costs_what_it_must() {
        let errors = measure();
        assert!(errors.static_mm.rms <= 0.06, "{errors:?}");
        for moving in &errors.moving {
            // half a millisecond of way, and the counts
            let way = moving.speed_m_s * 0.5;
            let rms = moving.place_mm.rms;
            assert!((rms - way).abs() <= 0.06, "{moving:?}");
        }
        // one pole of 50 Hz at 5 Hz: atan(0.1) / 31.4; the difference adds half a tick, and its own
        // discreteness takes half of one away
        let lag = errors.moving[0].velocity_lag_ms;
        assert!((lag - 3.17).abs() < 0.6, "{lag}");
        assert!(errors.tip_pots_mm.rms > 10.0 * errors.tip_encoders_mm.rms);
        assert!(errors.tip_pots_calibrated_mm.rms < 0.3 * errors.tip_pots_mm.rms);
    }
}
