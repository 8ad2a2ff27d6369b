//! Passivity observer and controller (Hannaford and Ryu 2002) on the torque that the device reports as
//! applied.
//!
//! Between two samples the drive holds its torque, so the energy that went into the loop,
//!
//! ```text
//! W ← W − τ_applied · (q − q_before)
//! ```
//!
//! is exact for encoders and a zero-order hold, whatever the delay, and needs no velocity. A loop that is
//! passive keeps W ≥ 0. What is kept is no more than the coupling stores and a little: what cutting has
//! really used up is gone, or a minute of drilling would pay for a minute of buzzing. And a smooth arm's
//! own friction is credited, which burns what the counting of encoders makes.

use crate::feel::GuardFeel;
use glam::DVec3;

/// Energy below this counts as made by the loop, mJ (encoder counts alone make 1.5 µJ).
const TOLERANCE_MJ: f64 = -5e-3;
/// An encoder count at the stylus, mm, at most.
const COUNT_MM: f64 = 0.06;
/// Coulomb friction of a joint that even a smooth arm has, N·mm (0.02 N at the stylus): it burns what
/// counting makes, K Δ²/2 a count, and the account knows it.
const FRICTION_NMM: f64 = 2.7;
/// It is credited for one count a tick of each joint, rad: a fast hand needs no credit.
const COUNT_RAD: f64 = 5e-4;
/// Surplus over what the coupling stores that is kept, mJ.
const SURPLUS_MJ: f64 = 0.1;

/// The observer's account.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Passivity {
    energy_mj: f64,
    // angles, rad, torque in force since, N·mm, and the vibration's beside it
    last: Option<(DVec3, DVec3, DVec3)>,
}

impl Passivity {
    /// What the loop holds of the hand's energy, mJ; negative: it has made some.
    pub fn energy_mj(&self) -> f64 {
        self.energy_mj
    }

    /// Begins anew: after a gap nobody knows what was applied.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// A sample: joint angles, rad, and the torque in force from it on without what lies outside the
    /// account, and that (vibration), N·mm. A stylus that vibrates crosses counts of its encoders back and
    /// forth, and each makes energy as counting does: up to the vibration's torque times a count that is
    /// the vibration's doing.
    pub fn observe(&mut self, angles: DVec3, applied_nmm: DVec3, buzz_nmm: DVec3) {
        if let Some((before, torque, buzz)) = self.last {
            let work = torque.dot(angles - before);
            if work.is_finite() {
                self.energy_mj -= work;
                let counted = (angles - before).abs().min(DVec3::splat(COUNT_RAD));
                self.energy_mj += (buzz.abs() + FRICTION_NMM).dot(counted);
            }
        }
        self.last = Some((angles, applied_nmm, buzz_nmm));
    }

    /// The coupling stores `stored_mj` at the stylus now (0 out of contact): what is more than that, and
    /// a little, is used up.
    pub fn settle(&mut self, stored_mj: f64) {
        self.energy_mj = self.energy_mj.min(stored_mj.max(0.0) + SURPLUS_MJ);
    }

    /// The controller's force, N, and whether the loop had made energy beyond what counting makes.
    /// `velocity_mm_s`: as it was counted, and filtered: a slow stylus moves by single counts, which say
    /// nothing of its speed. `shown_n` is the force that is on its way to the hand for `ahead_s` whatever
    /// is decided now: what it will give is counted as given.
    pub fn damp(
        &self,
        [counted, filtered]: [DVec3; 2],
        (shown_n, ahead_s): (DVec3, f64),
        tick_s: f64,
        guard: &GuardFeel,
    ) -> (DVec3, bool) {
        // two encoder counts a tick are no speed that is known of
        let moves = counted.length_squared() > (2.0 * COUNT_MM / tick_s).powi(2);
        let (velocity_mm_s, coming) = if moves {
            (counted, shown_n.dot(counted).max(0.0) * ahead_s)
        } else {
            (filtered, 0.0)
        };
        let speed2 = velocity_mm_s.length_squared();
        let energy_mj = self.energy_mj - coming;
        if energy_mj >= 0.0 || !(speed2 > 0.0 && speed2.is_finite()) {
            return (DVec3::ZERO, false);
        }
        let damping = (-energy_mj / (tick_s * speed2)).min(guard.passivity_n_s_per_mm);
        let force = -velocity_mm_s * damping;
        let length = force.length();
        let force = if length > guard.passivity_n {
            force * (guard.passivity_n / length)
        } else {
            force
        };
        let acted = force != DVec3::ZERO && energy_mj < TOLERANCE_MJ;
        (force, acted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feel::Feel;

    #[test]
    fn a_spring_that_is_held_makes_the_energy_that_theory_says() {
        // in and out by steps Δ at stiffness K: each step in is paid late, each step out early, so the
        // loop makes K Δ² a step pair: exactly K Δ² · n over n steps in and n out
        let (k, step, n) = (5e5, 1e-4, 20);
        let mut observer = Passivity::default();
        let path = (0..=n).chain((0..n).rev());
        for i in path {
            let x = f64::from(i) * step;
            observer.observe(DVec3::X * x, DVec3::X * (-k * x), DVec3::ZERO);
        }
        let made = k * step * step * f64::from(n);
        let burnt = 2.0 * FRICTION_NMM * step * f64::from(n);
        let found = -observer.energy_mj();
        assert!(
            found <= made + 1e-12 && found >= made - burnt,
            "{found} {made}"
        );
    }

    #[test]
    fn damping_spends_what_was_made_and_no_more() {
        let guard = Feel::default().guard;
        let mut observer = Passivity::default();
        // 100 N·mm through 0.0002 rad, of which a smooth arm's friction burns 2.7 N·mm
        observer.observe(DVec3::ZERO, DVec3::X * 100.0, DVec3::ZERO);
        observer.observe(DVec3::X * 0.0002, DVec3::ZERO, DVec3::ZERO);
        let made = 0.0002 * (100.0 - FRICTION_NMM);
        assert!((observer.energy_mj() + made).abs() < 1e-12);
        let still = (DVec3::ZERO, 0.0);
        // −W/(T v²) below the limit
        let (force, acted) = observer.damp([DVec3::X * 50.0; 2], still, 1e-3, &guard);
        assert!(acted);
        assert!((force.x + made / 1e-3 / 50.0).abs() < 1e-12, "{force}");
        let (slow, _) = observer.damp([DVec3::X; 2], still, 1e-3, &guard);
        assert!((slow.x + guard.passivity_n_s_per_mm).abs() < 1e-12);
        // a single count is not taken for a speed
        let (count, _) = observer.damp([DVec3::X * 55.0, DVec3::X], still, 1e-3, &guard);
        assert_eq!(count, slow);
        // a push of 1 N outwards at 500 mm/s for 1 ms gives another 0.5 mJ
        let fast = [DVec3::X * 500.0, DVec3::X * 400.0];
        let (coming, _) = observer.damp(fast, (DVec3::X, 1e-3), 1e-3, &guard);
        assert!((coming.x + (made + 0.5) / 0.5).abs() < 1e-12, "{coming}");
        let (tiny, _) = observer.damp([DVec3::X * 1e-200; 2], still, 1e-3, &guard);
        assert!(tiny.is_finite());
    }

    #[test]
    fn a_surplus_is_not_kept_and_what_is_stored_is() {
        let mut observer = Passivity::default();
        observer.observe(DVec3::ZERO, DVec3::X * -1000.0, DVec3::ZERO);
        observer.observe(DVec3::X * 0.005, DVec3::X * 1000.0, DVec3::ZERO);
        assert!(observer.energy_mj() > 5.0);
        observer.settle(2.0);
        assert!((observer.energy_mj() - 2.0 - SURPLUS_MJ).abs() < 1e-12);
        observer.settle(-1.0);
        assert!((observer.energy_mj() - SURPLUS_MJ).abs() < 1e-12);
        // a deficit stays
        observer.observe(DVec3::X * 0.006, DVec3::ZERO, DVec3::ZERO);
        let made = observer.energy_mj();
        assert!(made < -0.8, "{made}");
        observer.settle(5.0);
        assert!((observer.energy_mj() - made).abs() < 1e-15);
        observer.observe(DVec3::NAN, DVec3::ZERO, DVec3::ZERO);
        assert!(observer.energy_mj().is_finite());
    }
}
