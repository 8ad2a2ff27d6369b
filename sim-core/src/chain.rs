//! The output chain: from the coupling's force to what may reach the motors.
//!
//! Order: spring − damping → vector clamp → rising slew. The limit in force (ramp × user's limit) is
//! also the saturation inside the contact solve. Every intervention is counted.

use glam::DVec3;

/// Force limit of an Omni-class device, N.
pub const FORCE_LIMIT_N: f64 = 3.3;
/// Fastest rise of the force, N per tick.
pub const SLEW_N_PER_TICK: f64 = 0.5;
/// Damping of the hand against the proxy, N·s/mm.
const DAMPING_N_S_PER_MM: f64 = 1.0e-3;
/// Share of the new value in the 50 Hz velocity filter at 1 kHz (1 − exp(−2π·50/1000)).
const FILTER_GAIN: f64 = 0.269_597;
/// Ticks that the last force is held when samples are missing.
pub const HOLD_TICKS: u32 = 5;
/// Ticks without a sample after which the force is zero.
pub const ZERO_TICKS: u32 = 20;
/// Ramp after a start, ticks.
pub const START_RAMP_TICKS: u32 = 1000;
/// Ramp after a gap, ticks.
pub const GAP_RAMP_TICKS: u32 = 50;

/// Counts of what the chain had to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GuardCounts {
    /// Ticks at the force limit.
    pub clamped: u64,
    /// Ticks in which the rise was slewed.
    pub slewed: u64,
    /// Values that were not finite and became zero.
    pub not_finite: u64,
    /// Samples refused as implausible.
    pub implausible: u64,
    /// Ticks in which samples were missing for so long that the force was reduced.
    pub held: u64,
}

impl GuardCounts {
    /// All interventions.
    pub fn total(&self) -> u64 {
        self.clamped + self.slewed + self.not_finite + self.implausible + self.held
    }
}

/// State of the output chain. Forces in the base frame, N.
#[derive(Debug, Clone)]
pub struct OutputChain {
    user_limit_n: f64,
    ramp: f64,
    ramp_ticks: u32,
    velocity_mm_s: DVec3,
    // the last force that a sample gave
    last_n: DVec3,
    // the last force that went out, smaller while samples are missing
    shown_n: DVec3,
    /// What it had to do so far.
    pub counts: GuardCounts,
}

impl OutputChain {
    /// A chain that begins at zero. The user's limit is cut to [`FORCE_LIMIT_N`].
    pub fn new(user_limit_n: f64) -> Self {
        Self {
            user_limit_n: user_limit_n.clamp(0.0, FORCE_LIMIT_N),
            ramp: 0.0,
            ramp_ticks: START_RAMP_TICKS,
            velocity_mm_s: DVec3::ZERO,
            last_n: DVec3::ZERO,
            shown_n: DVec3::ZERO,
            counts: GuardCounts::default(),
        }
    }

    /// The limit in force at this tick, N.
    pub fn limit_n(&self) -> f64 {
        self.user_limit_n * self.ramp
    }

    /// Force off; the next one ramps up over `ramp_ticks`.
    pub fn off(&mut self, ramp_ticks: u32) {
        self.ramp = 0.0;
        self.ramp_ticks = ramp_ticks.max(1);
        self.last_n = DVec3::ZERO;
        self.shown_n = DVec3::ZERO;
        self.velocity_mm_s = DVec3::ZERO;
    }

    /// One tick with a fresh sample: the coupling's force and the stylus' velocity (backward
    /// difference, mm/s) in, the force for the motors out.
    pub fn step(&mut self, spring_n: DVec3, velocity_mm_s: DVec3) -> DVec3 {
        self.ramp = (self.ramp + 1.0 / f64::from(self.ramp_ticks)).min(1.0);
        let limit = self.limit_n();
        let clean = self.finite(velocity_mm_s);
        self.velocity_mm_s += (clean - self.velocity_mm_s) * FILTER_GAIN;
        let mut force = self.finite(spring_n);
        // only against the motion, and only where there is contact
        if force != DVec3::ZERO && self.velocity_mm_s.dot(clean) > 0.0 {
            force -= self.velocity_mm_s * DAMPING_N_S_PER_MM;
        }
        let length = force.length();
        if length > limit {
            force *= limit / length;
            self.counts.clamped += 1;
        }
        self.last_n = self.slew(force);
        self.shown_n = self.last_n;
        self.last_n
    }

    /// One tick without a sample, the `missing`-th in a row: hold ≤ 5 ticks, then a ramp that
    /// reaches zero at tick 20.
    pub fn hold(&mut self, missing: u32) -> DVec3 {
        if missing <= HOLD_TICKS {
            return self.last_n;
        }
        self.counts.held += 1;
        if missing >= ZERO_TICKS {
            self.off(GAP_RAMP_TICKS);
            return DVec3::ZERO;
        }
        let left = f64::from(ZERO_TICKS - missing) / f64::from(ZERO_TICKS - HOLD_TICKS);
        self.shown_n = self.last_n * left;
        self.shown_n
    }

    fn finite(&mut self, v: DVec3) -> DVec3 {
        if v.is_finite() {
            v
        } else {
            self.counts.not_finite += 1;
            DVec3::ZERO
        }
    }

    // falling along its own direction is free, all else moves at most SLEW_N_PER_TICK
    fn slew(&mut self, force: DVec3) -> DVec3 {
        let last = self.shown_n.length();
        let fallen = if last > 0.0 {
            let unit = self.shown_n / last;
            unit * force.dot(unit).clamp(0.0, last)
        } else {
            DVec3::ZERO
        };
        let rise = force - fallen;
        let length = rise.length();
        if length > SLEW_N_PER_TICK {
            self.counts.slewed += 1;
            fallen + rise * (SLEW_N_PER_TICK / length)
        } else {
            force
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(limit: f64) -> OutputChain {
        let mut chain = OutputChain::new(limit);
        for _ in 0..=START_RAMP_TICKS {
            chain.step(DVec3::ZERO, DVec3::ZERO);
        }
        chain
    }

    #[test]
    fn the_vector_is_clamped_not_its_axes() {
        let mut chain = settled(3.3);
        let asked = DVec3::new(30.0, 40.0, 0.0);
        let mut force = DVec3::ZERO;
        for _ in 0..20 {
            let next = chain.step(asked, DVec3::ZERO);
            assert!((next - force).length() <= SLEW_N_PER_TICK + 1e-12);
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
            chain.step(DVec3::X * 3.0, DVec3::ZERO);
        }
        let force = chain.step(DVec3::X * -3.0, DVec3::ZERO);
        assert!((force - DVec3::X * -0.5).length() < 1e-12, "{force}");
        assert_eq!(chain.step(DVec3::ZERO, DVec3::ZERO), DVec3::ZERO);
    }

    #[test]
    fn missing_samples_hold_then_ramp_to_zero_by_twenty() {
        let mut chain = settled(3.3);
        for _ in 0..20 {
            chain.step(DVec3::X, DVec3::ZERO);
        }
        for missing in 1..=5 {
            assert_eq!(chain.hold(missing), DVec3::X);
        }
        let mut last = 1.0;
        for missing in 6..20 {
            let force = chain.hold(missing).x;
            assert!(force < last && force > 0.0);
            last = force;
        }
        assert_eq!(chain.hold(20), DVec3::ZERO);
        // and back only over the gap ramp
        let first = chain.step(DVec3::X * 3.0, DVec3::ZERO).x;
        assert!(first <= 3.3 / f64::from(GAP_RAMP_TICKS) + 1e-12, "{first}");
    }

    #[test]
    fn after_a_short_gap_the_force_rises_from_what_was_shown() {
        for gap in [6, 12, 19] {
            let mut chain = settled(3.3);
            for _ in 0..20 {
                chain.step(DVec3::X * 3.3, DVec3::ZERO);
            }
            let shown = (1..=gap).map(|n| chain.hold(n)).last().expect("a gap");
            let next = chain.step(DVec3::X * 3.3, DVec3::ZERO);
            let rise = next.x - shown.x;
            assert!(rise <= SLEW_N_PER_TICK + 1e-12, "gap {gap}: {rise}");
        }
    }

    #[test]
    fn a_nan_becomes_no_force_and_is_counted() {
        let mut chain = settled(3.3);
        assert_eq!(chain.step(DVec3::NAN, DVec3::NAN), DVec3::ZERO);
        assert_eq!(chain.counts.not_finite, 2);
        assert!(chain.step(DVec3::X, DVec3::ZERO).is_finite());
    }
}
