//! The motors' heat: the limit falls to what they bear for ever.
//!
//! A leaky mean square of the force stands for the windings' temperature. Up to a share of what they
//! bear the full force is allowed (about 2 s at 3.3 N); then the limit falls with the heat, smoothly, so
//! that the mean square never passes the square of the continuous force.

use crate::feel::GuardFeel;

/// Heat at which the limit begins to fall, and at which it is at its lowest, as shares of the continuous
/// force's.
const SHARES: [f64; 2] = [0.75, 0.96];
/// The lowest limit as a share of the continuous force.
const LOWEST: f64 = 0.97;

/// Heat of the motors.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Thermal {
    // leaky mean of the square of the force, N²
    mean_square: f64,
}

impl Thermal {
    /// A tick in which `force_n` was shown.
    pub fn heat(&mut self, force_n: f64, tick_s: f64, guard: &GuardFeel) {
        let share = (tick_s / guard.thermal_s).min(1.0);
        self.mean_square += (force_n * force_n - self.mean_square) * share;
        // far below anything that matters; keeps denormals out
        if self.mean_square < 1e-12 {
            self.mean_square = 0.0;
        }
    }

    /// The limit, N, between the continuous force and `most_n`.
    pub fn limit_n(self, most_n: f64, guard: &GuardFeel) -> f64 {
        let lowest = LOWEST * guard.continuous_n;
        if most_n <= lowest {
            return most_n;
        }
        let bearable = guard.continuous_n * guard.continuous_n;
        let [begin, end] = SHARES.map(|share| share * bearable);
        let over = ((self.mean_square - begin) / (end - begin)).clamp(0.0, 1.0);
        most_n + (lowest - most_n) * over
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feel::Feel;

    #[test]
    fn a_minute_at_the_limit_is_brought_to_the_continuous_force_without_a_step() {
        let guard = Feel::default().guard;
        let mut heat = Thermal::default();
        let mut shown: Vec<f64> = Vec::new();
        for _ in 0..60_000 {
            let force = heat.limit_n(3.3, &guard);
            heat.heat(force, 1e-3, &guard);
            shown.push(force);
        }
        let full = shown.iter().take_while(|f| **f > 3.2).count();
        assert!((1500..2500).contains(&full), "{full} ms at full force");
        let rms =
            |part: &[f64]| (part.iter().map(|f| f * f).sum::<f64>() / part.len() as f64).sqrt();
        assert!(rms(&shown[3000..]) <= 0.88, "{}", rms(&shown[3000..]));
        assert!(shown[59_999] > 0.8);
        let step = shown
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .fold(0.0, f64::max);
        assert!(step <= 0.05, "{step}");
        // it recovers
        for _ in 0..60_000 {
            heat.heat(0.0, 1e-3, &guard);
        }
        assert!((heat.limit_n(3.3, &guard) - 3.3).abs() < 1e-12);
        assert!((heat.limit_n(0.5, &guard) - 0.5).abs() < 1e-15);
    }
}
