//! Smoothness of movement: log dimensionless jerk and spectral arc length.
//!
//! Balasubramanian, Melendez-Calderon, Roby-Brami, Burdet: "On the analysis of movement smoothness", J
//! Neuroeng Rehabil 12:112, 2015. Both on the velocity of a tip, low-passed at 10 Hz and taken at 100 Hz.

use glam::DVec3;

/// Corner of the low pass, and the highest frequency of the spectrum, Hz.
pub const CORNER_HZ: f64 = 10.0;
/// Samples a second after the low pass.
pub const RATE_HZ: f64 = 100.0;
/// Ticks a second before it.
const TICKS_HZ: f64 = 1000.0;
/// Below this share of the largest amplitude the spectrum ends.
const LEAST_SHARE: f64 = 0.05;

/// Positions at 1 kHz as velocities, mm/s, at 100 Hz: a second-order Butterworth low pass of 10 Hz run
/// forwards and backwards (fourth order, no lag), central differences, every tenth value.
pub fn velocities(positions: &[DVec3]) -> Vec<DVec3> {
    if positions.len() < 30 {
        return Vec::new();
    }
    let forward = low_pass(positions.iter().copied());
    let mut smooth = low_pass(forward.into_iter().rev());
    smooth.reverse();
    (10..smooth.len() - 10)
        .step_by(10)
        .map(|n| (smooth[n + 5] - smooth[n - 5]) * (TICKS_HZ / 10.0))
        .collect()
}

/// Direct form of the bilinear transform, begun in the steady state of the first value.
fn low_pass(values: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
    // the two passes together are 3 dB down at the corner
    let corner = CORNER_HZ / (core::f64::consts::SQRT_2 - 1.0).sqrt().sqrt();
    let k = libm::tan(core::f64::consts::PI * corner / TICKS_HZ);
    let norm = 1.0 / (1.0 + core::f64::consts::SQRT_2 * k + k * k);
    let b = k * k * norm;
    let a1 = 2.0 * (k * k - 1.0) * norm;
    let a2 = (1.0 - core::f64::consts::SQRT_2 * k + k * k) * norm;
    let (mut x, mut y): ([DVec3; 2], [DVec3; 2]) = ([DVec3::ZERO; 2], [DVec3::ZERO; 2]);
    let mut out = Vec::new();
    for (n, v) in values.enumerate() {
        if n == 0 {
            (x, y) = ([v; 2], [v; 2]);
        }
        let next = b * (v + 2.0 * x[0] + x[1]) - a1 * y[0] - a2 * y[1];
        x = [v, x[0]];
        y = [next, y[0]];
        out.push(next);
    }
    out
}

/// Log dimensionless jerk of velocities at 100 Hz: −ln(T³/v²ₚₑₐₖ ∫|d²v/dt²|² dt). Nearer to 0 is smoother; a
/// minimum-jerk reach has −5.32. `None` for fewer than 5 values or no movement.
pub fn ldlj(velocity: &[DVec3]) -> Option<f64> {
    let dt = 1.0 / RATE_HZ;
    let peak = velocity
        .iter()
        .map(|v| v.length_squared())
        .fold(0.0, f64::max);
    if velocity.len() < 5 || peak < 1e-6 {
        return None;
    }
    let squares: f64 = velocity
        .windows(3)
        .map(|w| ((w[2] - 2.0 * w[1] + w[0]) / (dt * dt)).length_squared())
        .sum();
    let time = (velocity.len() - 1) as f64 * dt;
    let dimensionless = time.powi(3) / peak * squares * dt;
    (dimensionless > 0.0).then(|| -libm::log(dimensionless))
}

/// Spectral arc length of the speed: minus the length of the normalised amplitude spectrum up to the last
/// frequency, at most 10 Hz, that has 5 % of the largest amplitude. Nearer to 0 is smoother. `None` for fewer
/// than 5 values or no movement.
pub fn sparc(velocity: &[DVec3]) -> Option<f64> {
    let speed: Vec<f64> = velocity.iter().map(|v| v.length()).collect();
    let sum: f64 = speed.iter().sum();
    if speed.len() < 5 || sum < 1e-6 {
        return None;
    }
    // sixteen bins for each one that the length resolves, as the paper's zero padding gives
    let bins = speed.len().next_power_of_two() * 16;
    let step_hz = RATE_HZ / bins as f64;
    let mut spectrum = Vec::new();
    let mut frequency = 0.0;
    while frequency <= CORNER_HZ {
        spectrum.push(amplitude(&speed, frequency) / sum);
        frequency += step_hz;
    }
    // speed is nowhere negative, so its spectrum is largest at 0, where it is now 1
    let last = spectrum.iter().rposition(|&a| a >= LEAST_SHARE)?;
    let width = last as f64 * step_hz;
    if last == 0 {
        return None;
    }
    let arc: f64 = spectrum[..=last]
        .windows(2)
        .map(|w| (step_hz / width).hypot(w[1] - w[0]))
        .sum();
    Some(-arc)
}

/// |Σ s e^{−iωn}| by Goertzel's recurrence.
fn amplitude(values: &[f64], hz: f64) -> f64 {
    let (sin, cos) = libm::sincos(core::f64::consts::TAU * hz / RATE_HZ);
    let (mut s1, mut s2) = (0.0, 0.0);
    for v in values {
        let s0 = v + 2.0 * cos * s1 - s2;
        s2 = s1;
        s1 = s0;
    }
    (s1 - s2 * cos).hypot(s2 * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Speed of a minimum-jerk reach of 1 mm in `seconds` (Flash & Hogan 1985), at 100 Hz.
    fn reach(seconds: f64) -> Vec<DVec3> {
        let n = (seconds * RATE_HZ).round();
        let mut out = Vec::new();
        let mut k = 0.0;
        while k <= n {
            let t: f64 = k / n;
            out.push(DVec3::X * (30.0 * t * t * (1.0 - t) * (1.0 - t)) / seconds);
            k += 1.0;
        }
        out
    }

    #[test]
    fn a_minimum_jerk_reach_has_the_jerk_of_its_closed_form() {
        // 720 (D/T²…)² / v_peak² with v_peak = 1.875 D/T
        let closed = -(720.0_f64 / (1.875 * 1.875)).ln();
        for seconds in [1.0, 4.0] {
            let found = ldlj(&reach(seconds)).expect("a number");
            // the sum leaves out the two ends, where the jerk is largest
            assert!((found - closed).abs() < 0.06 / seconds, "{found} {closed}");
        }
    }

    #[test]
    fn the_spectrum_is_that_of_a_plain_sum_and_free_of_scale() {
        let speed: Vec<f64> = reach(1.3).iter().map(|v| v.length()).collect();
        for hz in [0.0, 0.4, 3.7, 9.9] {
            let (mut re, mut im) = (0.0, 0.0);
            for (n, v) in speed.iter().enumerate() {
                let phase = core::f64::consts::TAU * hz * n as f64 / RATE_HZ;
                re += v * phase.cos();
                im -= v * phase.sin();
            }
            assert!((amplitude(&speed, hz) - f64::hypot(re, im)).abs() < 1e-9);
        }
        let one = sparc(&reach(1.0)).expect("a number");
        let fast: Vec<DVec3> = reach(1.0).iter().map(|v| *v * 7.0).collect();
        assert!((sparc(&fast).expect("a number") - one).abs() < 1e-12);
        let twice = [reach(1.0), reach(1.0)].concat();
        assert!(
            sparc(&twice).expect("a number") < one - 0.1,
            "two movements are less smooth than one"
        );
        assert!(ldlj(&twice).expect("a number") < ldlj(&reach(2.0)).expect("a number"));
        assert_eq!(sparc(&[DVec3::ZERO; 50]), None);
    }

    #[test]
    fn the_low_pass_keeps_slow_and_stops_fast() {
        let wave = |hz: f64| -> Vec<DVec3> {
            (0..4000)
                .map(|n| DVec3::X * (core::f64::consts::TAU * hz * f64::from(n) / TICKS_HZ).sin())
                .collect()
        };
        let peak = |hz: f64| {
            let v = velocities(&wave(hz));
            let inner = &v[100..v.len() - 100];
            inner.iter().map(|v| v.length()).fold(0.0, f64::max) / (core::f64::consts::TAU * hz)
        };
        assert!((peak(1.0) - 1.0).abs() < 0.01);
        assert!(
            (peak(10.0) - core::f64::consts::FRAC_1_SQRT_2).abs() < 0.05,
            "{}",
            peak(10.0)
        );
        assert!(peak(40.0) < 0.01);
    }
}
