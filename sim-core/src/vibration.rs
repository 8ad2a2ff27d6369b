//! The buzz of a cut: lips × turns, its second harmonic, and noise, in proportion to the cutting force.
//!
//! Never above 250 Hz: a 1 kHz loop cannot show more. A burr whose lips pass faster is shown as a carrier
//! of 200 Hz under its load. Outside the energy account, zero in the mean, off where nothing is cut.
//! Experts find the layers of bone by it (Strelzow et al. 2023).

use core::f64::consts::TAU;

/// Highest frequency that is made, Hz.
pub const HIGHEST_HZ: f64 = 250.0;
/// Carrier of tools whose lips pass faster than that, Hz.
const CARRIER_HZ: f64 = 200.0;
/// The second harmonic: −6 dB.
const SECOND: f64 = 0.5;
/// Noise beside the fundamental, and its band, Hz.
const NOISE: f64 = 0.3;
const NOISE_BAND_HZ: [f64; 2] = [40.0, 250.0];

/// Oscillator and noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vibration {
    // turns in [0, 1)
    phase: f64,
    seed: u64,
    low: [f64; 2],
    amplitude: f64,
}

impl Default for Vibration {
    fn default() -> Self {
        Self {
            phase: 0.0,
            seed: 0x9e37_79b9_7f4a_7c15,
            low: [0.0; 2],
            amplitude: 0.0,
        }
    }
}

impl Vibration {
    /// One tick: `cut_n` = Σ share of each element × its cutting force, N at the stylus; the tool's speed
    /// and lips. The force along the tool's axis, N, within ± `most_n`.
    pub fn next(
        &mut self,
        cut_n: f64,
        (omega_rad_s, lips): (f64, u8),
        most_n: f64,
        tick_s: f64,
    ) -> f64 {
        let passing = omega_rad_s / TAU * f64::from(lips);
        let hz = if passing > HIGHEST_HZ {
            CARRIER_HZ
        } else {
            passing
        };
        // a cut that begins or ends does so within some ms: a step would be a kick
        let wanted = if cut_n.is_finite() {
            cut_n.max(0.0)
        } else {
            0.0
        };
        self.amplitude += (wanted - self.amplitude) * low_pass(NOISE_BAND_HZ[0], tick_s);
        if wanted == 0.0 && self.amplitude < 1e-6 {
            self.amplitude = 0.0;
        }
        let turns = self.phase + hz * tick_s;
        self.phase = turns - libm::floor(turns);
        let second = if 2.0 * hz <= HIGHEST_HZ { SECOND } else { 0.0 };
        let tone = libm::sin(TAU * self.phase) + second * libm::sin(2.0 * TAU * self.phase);
        let noise = NOISE * self.noise(tick_s);
        // bounded by its size, not by cutting off: that would leave a mean
        let size = self.amplitude.min(most_n / (1.0 + SECOND + NOISE));
        size * (tone + noise)
    }

    // uniform noise through a band pass of first order, within ± 1
    fn noise(&mut self, tick_s: f64) -> f64 {
        self.seed ^= self.seed << 13;
        self.seed ^= self.seed >> 7;
        self.seed ^= self.seed << 17;
        let white = (self.seed >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0;
        for (state, hz) in self.low.iter_mut().zip(NOISE_BAND_HZ) {
            *state += (white - *state) * low_pass(hz, tick_s);
        }
        (self.low[1] - self.low[0]).clamp(-1.0, 1.0)
    }
}

fn low_pass(hz: f64, tick_s: f64) -> f64 {
    1.0 - libm::exp(-TAU * hz * tick_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(omega: f64, lips: u8, cut: f64) -> Vec<f64> {
        let mut vibration = Vibration::default();
        (0..8000)
            .map(|_| vibration.next(cut, (omega, lips), 0.25, 1e-3))
            .skip(1000)
            .collect()
    }

    /// Amplitude of one frequency.
    fn tone(signal: &[f64], hz: f64) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in signal.iter().enumerate() {
            let angle = TAU * hz * i as f64 * 1e-3;
            re += v * angle.cos();
            im += v * angle.sin();
        }
        2.0 * re.hypot(im) / signal.len() as f64
    }

    #[test]
    fn its_frequency_is_lips_times_turns() {
        // 1000 rpm, 6 lips: 100 Hz
        let signal = series(1000.0 * TAU / 60.0, 6, 0.05);
        assert!(
            (tone(&signal, 100.0) - 0.05).abs() < 0.003,
            "{}",
            tone(&signal, 100.0)
        );
        assert!((tone(&signal, 200.0) - 0.025).abs() < 0.003);
        assert!(tone(&signal, 150.0) < 0.004);
        assert!(signal.iter().all(|v| v.abs() <= 0.25));
    }

    #[test]
    fn a_burr_is_shown_at_200_hz_and_nothing_above_250() {
        let signal = series(60_000.0 * TAU / 60.0, 8, 0.05);
        assert!((tone(&signal, 200.0) - 0.05).abs() < 0.003);
        assert!(tone(&signal, 400.0) < 0.004);
    }

    #[test]
    fn it_has_no_mean_is_bounded_and_ends_with_the_cut() {
        let signal = series(1000.0 * TAU / 60.0, 6, 5.0);
        let largest = signal.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        assert!(largest <= 0.25 && largest > 0.1, "{largest}");
        for window in signal.chunks_exact(50) {
            let mean = window.iter().sum::<f64>() / 50.0;
            assert!(mean.abs() < 0.02, "{mean}");
        }
        let mut vibration = Vibration::default();
        for _ in 0..500 {
            vibration.next(1.0, (100.0, 6), 0.25, 1e-3);
        }
        let last = (0..200)
            .map(|_| vibration.next(0.0, (100.0, 6), 0.25, 1e-3))
            .last();
        assert_eq!(last, Some(0.0));
        assert!(vibration.next(f64::NAN, (100.0, 6), 0.25, 1e-3).is_finite());
    }
}
