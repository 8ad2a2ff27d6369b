//! The wrist's potentiometers of a stock Omni: not quite linear, and noisy.

use super::random::Random;
use core::f64::consts::TAU;
use glam::DVec3;
use osteon_sim_core::pots::{PotWrist, TABLE_POINTS};

/// Largest deviation from a straight line, share of the track (data sheet: ±5 %).
pub const LINEARITY: f64 = 0.05;
/// Bits of a reading that are noise.
pub const NOISY_BITS: u32 = 5;

/// Three tracks of one device.
#[derive(Debug, Clone)]
pub struct Pots {
    // shares of one, two and three waves along each track
    waves: [[f64; 3]; 3],
    random: Random,
}

impl Pots {
    /// The tracks of the device with this seed: each deviates by up to [`LINEARITY`].
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let waves = [(); 3].map(|()| {
            let parts = [(); 3].map(|()| 2.0 * random.unit() - 1.0);
            // waves of k periods may not bend the track backwards: higher ones are smaller
            let scaled = [parts[0], parts[1] / 2.0, parts[2] / 3.0];
            let sum: f64 = scaled.iter().map(|p| p.abs()).sum();
            scaled.map(|p| LINEARITY * p / sum)
        });
        Self { waves, random }
    }

    fn share(&self, axis: usize, place: f64) -> f64 {
        let waves = (1..).zip(self.waves[axis]);
        place
            + waves
                .map(|(k, a)| a * libm::sin(TAU * f64::from(k) * place))
                .sum::<f64>()
    }

    /// Readings from both ends of each track at these gimbal angles, rad.
    pub fn read(&mut self, angles: DVec3) -> ([u16; 3], [u16; 3]) {
        let noise = 1 << NOISY_BITS;
        let mut both = [[0; 2]; 3];
        for (axis, reading) in both.iter_mut().enumerate() {
            let place = (angles[axis] / PotWrist::OMNI.span_rad[axis] + 0.5).clamp(0.0, 1.0);
            let share = self.share(axis, place);
            for (end, value) in [share, 1.0 - share].into_iter().enumerate() {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "in 0..65,536, and the cast saturates"
                )]
                let counts = (value * 65_535.0) as u16 & !(noise - 1);
                let [low, ..] = self.random.bits().to_le_bytes();
                let low = u16::from(low) & (noise - 1);
                reading[end] = counts | low;
            }
        }
        (both.map(|r| r[0]), both.map(|r| r[1]))
    }

    /// What a person who calibrates this device with a protractor writes down.
    pub fn calibration(&self) -> PotWrist {
        let point = |axis, n: usize| self.share(axis, n as f64 / (TABLE_POINTS - 1) as f64);
        PotWrist {
            table: Some([0, 1, 2].map(|axis| core::array::from_fn(|n| point(axis, n)))),
            ..PotWrist::OMNI
        }
    }
}
