//! The spindle: a motor with a speed regulator and a torque limit.
//!
//! ```text
//! J dω/dt = M_motor − M_cut,   M_motor = M_stall · clamp((ω_set − ω)/(0.05 ω_set), 0, 1)
//! J = M_stall · t_spin_up / ω_set
//! ```
//! The regulator gives its full torque at a droop of 5 % and never brakes: a tool slows down under a load
//! and stalls where the cut asks more than the motor has. Switched off it stops at once, since a tool
//! that runs down must not cut.

use crate::feel::SpindleFeel;
use crate::tool::Tool;
use core::f64::consts::TAU;

/// Droop at which the regulator gives all it has, as a share of the set speed.
const DROOP: f64 = 0.05;

/// A turning tool.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spindle {
    omega: f64,
    load: f64,
    torque_nmm: f64,
    // of the vibration's carrier, turns in [0, 1)
    phase: f64,
}

impl Spindle {
    /// Speed, rad/s.
    pub fn omega_rad_s(&self) -> f64 {
        self.omega
    }

    /// Torque of the cut, N·mm at a real tool.
    pub fn torque_nmm(&self) -> f64 {
        self.torque_nmm
    }

    /// Torque of the cut over what the motor has, in [0, 1]: what a drill's sound follows.
    pub fn load(&self) -> f64 {
        self.load
    }

    /// Turns of the spindle, in [0, 1).
    pub fn phase(&self) -> f64 {
        self.phase
    }

    /// Stands still.
    pub fn stop(&mut self) {
        *self = Self::default();
    }

    /// One tick: switched `on` or off, under the cut's torque (N·mm at a real tool) of the last one.
    pub fn turn(&mut self, on: bool, tool: &Tool, cut_nmm: f64, feel: SpindleFeel, tick_s: f64) {
        let set = tool.rpm * TAU / 60.0;
        if !on || set <= 0.0 || !cut_nmm.is_finite() {
            self.stop();
            return;
        }
        let stall = tool.stall_nmm.unwrap_or(feel.stall_nmm);
        let inertia = stall * feel.spin_up_s / set;
        // implicit where the regulator is not at its limit: stable for any tick
        let gain = stall / (DROOP * set);
        let regulated = (self.omega + tick_s / inertia * (gain * set - cut_nmm))
            / (1.0 + tick_s / inertia * gain);
        let limited = self.omega + tick_s / inertia * (stall - cut_nmm);
        self.omega = regulated.min(limited).clamp(0.0, set);
        self.torque_nmm = cut_nmm.max(0.0);
        self.load = (self.torque_nmm / stall).clamp(0.0, 1.0);
        let turns = self.phase + self.omega * tick_s / TAU;
        self.phase = turns - libm::floor(turns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feel::Feel;

    fn run(spindle: &mut Spindle, tool: &Tool, cut_nmm: f64, ticks: u32, tick_s: f64) {
        let feel = Feel::default().spindle;
        for _ in 0..ticks {
            spindle.turn(true, tool, cut_nmm, feel, tick_s);
        }
    }

    #[test]
    fn it_reaches_its_speed_in_its_time_at_any_rate() {
        let tool = Tool::glenoid_reamer();
        let set = tool.rpm * TAU / 60.0;
        for (ticks, tick_s) in [(75, 4e-3), (300, 1e-3), (1200, 0.25e-3)] {
            let mut spindle = Spindle::default();
            run(&mut spindle, &tool, 0.0, ticks, tick_s);
            let share = spindle.omega_rad_s() / set;
            assert!((0.94..=1.0).contains(&share), "{tick_s}: {share}");
            run(&mut spindle, &tool, 0.0, ticks, tick_s);
            assert!((spindle.omega_rad_s() / set - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn it_droops_under_load_stalls_beyond_its_torque_and_comes_back() {
        let tool = Tool::glenoid_reamer();
        let set = tool.rpm * TAU / 60.0;
        let mut spindle = Spindle::default();
        run(&mut spindle, &tool, 1500.0, 2000, 1e-3);
        // half the torque at half the droop
        assert!((spindle.omega_rad_s() / set - 0.975).abs() < 1e-3);
        assert!((spindle.load() - 0.5).abs() < 1e-12);
        run(&mut spindle, &tool, 3500.0, 3000, 1e-3);
        assert_eq!((spindle.omega_rad_s(), spindle.load()), (0.0, 1.0));
        run(&mut spindle, &tool, 100.0, 1000, 1e-3);
        assert!(spindle.omega_rad_s() > 0.99 * set);
        spindle.turn(false, &tool, 100.0, Feel::default().spindle, 1e-3);
        assert_eq!(spindle, Spindle::default());
        run(&mut spindle, &tool, f64::NAN, 10, 1e-3);
        assert!(spindle.omega_rad_s() < 1e-12);
    }
}
