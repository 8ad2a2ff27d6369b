//! A hand as a mass, spring and damper that follow a target.

use glam::DVec3;

/// A hand that holds the stylus rigidly: its mass is added to the device's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// Name for tables.
    pub name: &'static str,
    /// Mass at the stylus, kg.
    pub mass_kg: f64,
    /// Damper to the target, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Spring to the target, N/m.
    pub stiffness_n_per_m: f64,
}

impl Hand {
    /// No hand: only a constant push moves the bare device.
    pub const NONE: Self = Self {
        name: "none",
        mass_kg: 0.0,
        damping_n_s_per_m: 0.0,
        stiffness_n_per_m: 0.0,
    };
    /// Two fingers.
    pub const LIGHT: Self = Self {
        name: "light",
        mass_kg: 0.02,
        damping_n_s_per_m: 0.5,
        stiffness_n_per_m: 50.0,
    };
    /// A firm grip.
    pub const GRIP: Self = Self {
        name: "grip",
        mass_kg: 0.1,
        damping_n_s_per_m: 4.0,
        stiffness_n_per_m: 400.0,
    };
    /// The hands that every press is tried with.
    pub const ALL: [Self; 3] = [Self::NONE, Self::LIGHT, Self::GRIP];

    /// A dead weight on the stylus, kg.
    pub const fn weight(mass_kg: f64) -> Self {
        Self {
            name: "weight",
            mass_kg,
            damping_n_s_per_m: 0.0,
            stiffness_n_per_m: 0.0,
        }
    }
}

/// What the hand does at this moment, base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pull {
    /// Constant force beside the spring's, N.
    pub push_n: DVec3,
    /// Where the spring ends, mm.
    pub target_mm: DVec3,
    /// How fast that moves, mm/s.
    pub target_mm_s: DVec3,
}

impl Pull {
    /// A hand that holds the stylus where it is.
    pub fn at(position_mm: DVec3) -> Self {
        Self {
            push_n: DVec3::ZERO,
            target_mm: position_mm,
            target_mm_s: DVec3::ZERO,
        }
    }
}
