//! The output chain: from the coupling's force to what may reach the motors.
//!
//! Order: spring − damping → passivity → vector clamp → rising slew → vibration → vector clamp. The limit
//! in force (ramp × the smaller of the user's and the motors' heat) is also the saturation inside the
//! contact solve. Every intervention is counted.

mod guards;
mod passivity;
mod thermal;

pub use guards::{GUARDS, Guard, GuardCounts};
pub use passivity::Passivity;
pub use thermal::Thermal;

use crate::feel::{Feel, GuardFeel};
use glam::DVec3;

/// Force limit of an Omni-class device, N.
pub const FORCE_LIMIT_N: f64 = 3.3;
/// The last force is held for this time when samples are missing, s.
pub const HOLD_S: f64 = 0.005;
/// Without a sample for this time the force is zero, s: so early that the command on its way and the
/// motors' lag have ended by 20 ms.
pub const ZERO_S: f64 = 0.018;

/// State of the output chain. Forces in the base frame, N.
#[derive(Debug, Clone)]
pub struct OutputChain {
    user_limit_n: f64,
    guard: GuardFeel,
    tick_s: f64,
    // share of the new value in the velocity filter
    filter_gain: f64,
    ramp: f64,
    ramp_s: f64,
    velocity_mm_s: DVec3,
    // the last force that a sample gave
    last_n: DVec3,
    // the last force that went out, smaller while samples are missing; without vibration
    shown_n: DVec3,
    thermal: Thermal,
    /// The energy account.
    pub passivity: Passivity,
    /// What it had to do so far.
    pub counts: GuardCounts,
}

impl OutputChain {
    /// A chain that begins at zero. The user's limit is cut to [`FORCE_LIMIT_N`].
    pub fn new(user_limit_n: f64, feel: &Feel) -> Self {
        let guard = feel.guard;
        let turns = core::f64::consts::TAU * guard.velocity_hz * feel.tick_s;
        Self {
            user_limit_n: user_limit_n.clamp(0.0, FORCE_LIMIT_N),
            guard,
            tick_s: feel.tick_s,
            filter_gain: 1.0 - libm::exp(-turns),
            ramp: 0.0,
            ramp_s: guard.start_ramp_s,
            velocity_mm_s: DVec3::ZERO,
            last_n: DVec3::ZERO,
            shown_n: DVec3::ZERO,
            thermal: Thermal::default(),
            passivity: Passivity::default(),
            counts: GuardCounts::default(),
        }
    }

    /// The limit in force at this tick, N.
    pub fn limit_n(&self) -> f64 {
        self.thermal.limit_n(self.user_limit_n, &self.guard) * self.ramp
    }

    /// Force off; the next one ramps up over the gap's ramp.
    pub fn off(&mut self) {
        self.ramp = 0.0;
        self.ramp_s = self.guard.gap_ramp_s;
        self.last_n = DVec3::ZERO;
        self.shown_n = DVec3::ZERO;
        self.velocity_mm_s = DVec3::ZERO;
        self.passivity.reset();
    }

    /// Force off while the drive is not engaged. The first ramp of a session stays the long one.
    pub fn disengage(&mut self) {
        if self.ramp > 0.0 {
            self.off();
        }
        self.passivity.reset();
    }

    /// One tick with a fresh sample: the coupling's force and the stylus' velocity (backward
    /// difference, mm/s) in, the force for the motors out, which will be felt `delay_ticks` later.
    pub fn step(&mut self, spring_n: DVec3, velocity_mm_s: DVec3, delay_ticks: u8) -> DVec3 {
        self.ramp = (self.ramp + self.tick_s / self.ramp_s).min(1.0);
        let limit = self.limit_n();
        let clean = self.finite(velocity_mm_s);
        self.velocity_mm_s += (clean - self.velocity_mm_s) * self.filter_gain;
        if self.velocity_mm_s.length_squared() < 1e-24 {
            self.velocity_mm_s = DVec3::ZERO; // no denormals
        }
        let mut force = self.finite(spring_n);
        // only against the motion, and only where there is contact
        if force != DVec3::ZERO && self.velocity_mm_s.dot(clean) > 0.0 {
            force -= self.velocity_mm_s * self.guard.damping_n_s_per_mm;
        }
        let coming = (self.shown_n, f64::from(delay_ticks) * self.tick_s);
        let (damped, acted) = self.passivity.damp(
            [clean, self.velocity_mm_s],
            coming,
            self.tick_s,
            &self.guard,
        );
        force += damped;
        if acted {
            self.counts.note(Guard::Passivity);
        }
        self.last_n = self.clamp(force, limit);
        self.last_n = self.slew(self.last_n);
        self.shown_n = self.last_n;
        self.last_n
    }

    /// The force with a vibration on top, N, clamped once more: what is shown, and heats. Call it once
    /// after [`Self::step`].
    pub fn vibrate(&mut self, force_n: DVec3, vibration_n: DVec3) -> DVec3 {
        let vibration = self.finite(vibration_n);
        let shown = self.clamp(force_n + vibration, self.limit_n());
        self.thermal.heat(shown.length(), self.tick_s, &self.guard);
        shown
    }

    /// One tick without a sample, the `missing`-th in a row: hold for [`HOLD_S`], then a ramp that
    /// reaches zero at [`ZERO_S`].
    pub fn hold(&mut self, missing: u32) -> DVec3 {
        let silent_s = f64::from(missing) * self.tick_s;
        // a tick's own length must not round across the border
        let rounding = 1e-9;
        if silent_s <= HOLD_S + rounding {
            self.heat_shown();
            return self.last_n;
        }
        self.counts.note(Guard::Hold);
        if silent_s >= ZERO_S - rounding {
            self.off();
            self.heat_shown();
            return DVec3::ZERO;
        }
        self.shown_n = self.last_n * ((ZERO_S - silent_s) / (ZERO_S - HOLD_S));
        self.heat_shown();
        self.shown_n
    }

    /// Whether samples have been missing for so long that the force is zero.
    pub fn is_silent(&self, missing: u32) -> bool {
        f64::from(missing) * self.tick_s >= ZERO_S - 1e-9
    }

    fn heat_shown(&mut self) {
        let shown = self.shown_n.length();
        self.thermal.heat(shown, self.tick_s, &self.guard);
    }

    fn clamp(&mut self, force: DVec3, limit: f64) -> DVec3 {
        let length = force.length();
        if length > limit {
            let hot = limit < self.user_limit_n * self.ramp;
            self.counts
                .note(if hot { Guard::Thermal } else { Guard::Clamp });
            force * (limit / length)
        } else {
            force
        }
    }

    fn finite(&mut self, v: DVec3) -> DVec3 {
        if v.is_finite() {
            v
        } else {
            self.counts.note(Guard::NotFinite);
            DVec3::ZERO
        }
    }

    // falling along its own direction is free, all else moves at most by the slew
    fn slew(&mut self, force: DVec3) -> DVec3 {
        let most = self.guard.rise_n_per_ms * self.tick_s * 1e3;
        let last = self.shown_n.length();
        let fallen = if last > 0.0 {
            let unit = self.shown_n / last;
            unit * force.dot(unit).clamp(0.0, last)
        } else {
            DVec3::ZERO
        };
        let rise = force - fallen;
        let length = rise.length();
        if length > most {
            self.counts.note(Guard::Slew);
            fallen + rise * (most / length)
        } else {
            force
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLEW: f64 = 0.5;

    fn settled(limit: f64) -> OutputChain {
        let mut chain = OutputChain::new(limit, &Feel::default());
        for _ in 0..=1000 {
            chain.step(DVec3::ZERO, DVec3::ZERO, 1);
        }
        chain
    }

    #[test]
    fn the_vector_is_clamped_not_its_axes() {
        let mut chain = settled(3.3);
        let asked = DVec3::new(30.0, 40.0, 0.0);
        let mut force = DVec3::ZERO;
        for _ in 0..20 {
            let next = chain.step(asked, DVec3::ZERO, 1);
            assert!((next - force).length() <= SLEW + 1e-12);
            force = next;
        }
        assert!(
            (force - DVec3::new(1.98, 2.64, 0.0)).length() < 1e-9,
            "{force}"
        );
    }

    #[test]
    fn falling_is_free_and_reversal_is_slewed() {
        let mut chain = settled(3.3);
        for _ in 0..20 {
            chain.step(DVec3::X * 3.0, DVec3::ZERO, 1);
        }
        let force = chain.step(DVec3::X * -3.0, DVec3::ZERO, 1);
        assert!((force - DVec3::X * -0.5).length() < 1e-12, "{force}");
        assert_eq!(chain.step(DVec3::ZERO, DVec3::ZERO, 1), DVec3::ZERO);
    }

    #[test]
    fn missing_samples_hold_then_ramp_to_zero_by_eighteen() {
        let mut chain = settled(3.3);
        for _ in 0..20 {
            chain.step(DVec3::X, DVec3::ZERO, 1);
        }
        for missing in 1..=5 {
            assert_eq!(chain.hold(missing), DVec3::X);
        }
        let mut last = 1.0;
        for missing in 6..18 {
            let force = chain.hold(missing).x;
            assert!(force < last && force > 0.0);
            last = force;
        }
        assert_eq!(chain.hold(18), DVec3::ZERO);
        // and back only over the gap ramp
        let first = chain.step(DVec3::X * 3.0, DVec3::ZERO, 1).x;
        assert!(first <= 3.3 / 50.0 + 1e-12, "{first}");
    }

    #[test]
    fn after_a_short_gap_the_force_rises_from_what_was_shown() {
        for gap in [6, 12, 17] {
            let mut chain = settled(3.3);
            for _ in 0..20 {
                chain.step(DVec3::X * 3.3, DVec3::ZERO, 1);
            }
            let shown = (1..=gap).map(|n| chain.hold(n)).last().expect("a gap");
            let next = chain.step(DVec3::X * 3.3, DVec3::ZERO, 1);
            let rise = next.x - shown.x;
            assert!(rise <= SLEW + 1e-12, "gap {gap}: {rise}");
        }
    }

    #[test]
    fn a_nan_becomes_no_force_and_is_counted() {
        let mut chain = settled(3.3);
        chain.counts.begin_tick();
        assert_eq!(chain.step(DVec3::NAN, DVec3::NAN, 1), DVec3::ZERO);
        assert_eq!(chain.counts.of(Guard::NotFinite), 1);
        assert!(chain.step(DVec3::X, DVec3::ZERO, 1).is_finite());
    }
}
