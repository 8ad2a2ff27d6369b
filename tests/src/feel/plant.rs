//! The device as a point: mass, viscous and Coulomb friction, the same in all directions.
//!
//! The motors' joint torques act through J⁻ᵀ of the joints at every step, so a torque that is held over
//! a tick does exactly the work τ·Δt that the device's own counts show.

use super::hand::{Hand, Pull};
use glam::DVec3;
use osteon_sim_core::omni;

/// Integration step at most, s.
pub const STEP_S: f64 = 50e-6;

/// What may differ between two devices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantSpec {
    /// Apparent mass at the stylus, kg.
    pub mass_kg: f64,
    /// Viscous friction at the stylus, N·s/m.
    pub viscous_n_s_per_m: f64,
    /// Coulomb friction at the stylus, N.
    pub coulomb_n: f64,
}

impl PlantSpec {
    /// What an Omni-class arm is taken for.
    pub const TYPICAL: Self = Self {
        mass_kg: 0.045,
        viscous_n_s_per_m: 0.1,
        coulomb_n: 0.1,
    };
    /// One with hardly any friction.
    pub const BAD: Self = Self {
        viscous_n_s_per_m: 0.01,
        coulomb_n: 0.03,
        ..Self::TYPICAL
    };
    /// Without Coulomb friction and with `viscous` N·s/m: a linear loop.
    pub const fn linear(viscous: f64) -> Self {
        Self {
            mass_kg: 0.045,
            viscous_n_s_per_m: viscous,
            coulomb_n: 0.0,
        }
    }
}

/// The moving point, base frame.
#[derive(Debug, Clone)]
pub struct Plant {
    spec: PlantSpec,
    /// mm.
    pub position_mm: DVec3,
    /// mm/s.
    pub velocity_mm_s: DVec3,
    /// Energy that went from the plant into the motors so far, mJ; negative: the loop gave energy.
    pub absorbed_mj: f64,
    /// Steps in which the workspace's end held it.
    pub stops: u64,
    joints: DVec3,
}

impl Plant {
    /// At rest at a place inside the workspace; `None` outside it.
    pub fn new(spec: PlantSpec, position_mm: DVec3) -> Option<Self> {
        Some(Self {
            spec,
            position_mm,
            velocity_mm_s: DVec3::ZERO,
            absorbed_mj: 0.0,
            stops: 0,
            joints: omni::inverse(position_mm)?,
        })
    }

    /// Motor angles, rad.
    pub fn joints(&self) -> DVec3 {
        self.joints
    }

    /// Force of joint torques (N·mm) at the stylus, N.
    pub fn force_of(&self, torque_nmm: DVec3) -> DVec3 {
        let force = omni::jacobian(self.joints).transpose().inverse() * torque_nmm;
        if force.is_finite() {
            force
        } else {
            DVec3::ZERO
        }
    }

    /// One step of `dt_s` under joint torques (N·mm) and a hand. Semi-implicit; both frictions are
    /// implicit, so that Coulomb friction holds the point exactly where the forces are below it.
    pub fn step(&mut self, dt_s: f64, torque_nmm: DVec3, hand: &Hand, pull: &Pull) {
        let motors = self.force_of(torque_nmm);
        let spring = (pull.target_mm - self.position_mm) * (hand.stiffness_n_per_m * 1e-3);
        let dragged = pull.target_mm_s * (hand.damping_n_s_per_m * 1e-3);
        let mass = self.spec.mass_kg + hand.mass_kg;
        let per_mass = dt_s / mass;
        let wish =
            self.velocity_mm_s + (motors + pull.push_n + spring + dragged) * (1e3 * per_mass);
        let speed = wish.length();
        let held = 1e3 * per_mass * self.spec.coulomb_n;
        let share = if speed > held {
            1.0 - held / speed
        } else {
            0.0
        };
        let viscous = self.spec.viscous_n_s_per_m + hand.damping_n_s_per_m;
        self.velocity_mm_s = wish * (share / (1.0 + per_mass * viscous));
        self.go(self.velocity_mm_s * dt_s, motors);
    }

    /// One step along a prescribed way, whatever the forces.
    pub fn carry(&mut self, step_mm: DVec3, dt_s: f64, torque_nmm: DVec3) {
        let motors = self.force_of(torque_nmm);
        self.velocity_mm_s = step_mm / dt_s;
        self.go(step_mm, motors);
    }

    fn go(&mut self, step_mm: DVec3, motors: DVec3) {
        let to = self.position_mm + step_mm;
        if let Some(joints) = omni::inverse(to) {
            self.joints = joints;
            self.position_mm = to;
            self.absorbed_mj -= motors.dot(step_mm);
        } else {
            self.velocity_mm_s = DVec3::ZERO;
            self.stops += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn released(spec: PlantSpec) -> Plant {
        Plant::new(spec, DVec3::ZERO).expect("in reach")
    }

    #[test]
    fn coulomb_friction_holds_below_its_force_and_slows_above_it() {
        let mut plant = released(PlantSpec::TYPICAL);
        let mut pull = Pull::at(DVec3::ZERO);
        pull.push_n = DVec3::X * 0.099;
        for _ in 0..20_000 {
            plant.step(STEP_S, DVec3::ZERO, &Hand::NONE, &pull);
        }
        assert_eq!(plant.position_mm, DVec3::ZERO);
        pull.push_n = DVec3::X * 0.2;
        for _ in 0..200 {
            plant.step(STEP_S, DVec3::ZERO, &Hand::NONE, &pull);
        }
        // 0.1 N on 45 g for 10 ms, a little less for the viscous part
        let expected = 0.1 / 0.045 * 0.01 * 1e3;
        assert!((plant.velocity_mm_s.x / expected - 1.0).abs() < 0.03);
    }

    #[test]
    fn torques_do_the_work_that_the_account_says() {
        let mut plant = released(PlantSpec {
            viscous_n_s_per_m: 0.0,
            coulomb_n: 0.0,
            ..PlantSpec::TYPICAL
        });
        let torque = DVec3::new(20.0, -30.0, 10.0);
        let before = plant.joints();
        for _ in 0..1000 {
            plant.step(2e-6, torque, &Hand::NONE, &Pull::at(DVec3::ZERO));
        }
        let work = torque.dot(plant.joints() - before);
        let kinetic = 0.5 * 0.045 * plant.velocity_mm_s.length_squared() * 1e-3;
        assert!((-plant.absorbed_mj / work - 1.0).abs() < 1e-3, "{work}");
        assert!((kinetic / work - 1.0).abs() < 5e-3, "{kinetic} {work}");
    }

    #[test]
    fn a_spring_swings_at_its_own_frequency() {
        let mut plant = released(PlantSpec {
            viscous_n_s_per_m: 0.0,
            coulomb_n: 0.0,
            mass_kg: 0.1,
        });
        let hand = Hand {
            stiffness_n_per_m: 100.0,
            ..Hand::NONE
        };
        let pull = Pull::at(DVec3::X);
        let mut least = f64::MAX;
        let mut at = 0.0;
        // a whole period is 2π √(m/k) = 0.1987 s
        for n in 1..=5000u32 {
            plant.step(STEP_S, DVec3::ZERO, &hand, &pull);
            let t = f64::from(n) * STEP_S;
            if t > 0.15 && plant.position_mm.x < least {
                least = plant.position_mm.x;
                at = t;
            }
        }
        assert!((at - 0.1987).abs() < 1e-3, "{at}");
        assert!(least.abs() < 0.01, "{least}");
    }
}
