//! What the hand feels, as data: coupling, cutting law, materials, guards. One table ([`FIELDS`]) names
//! every number with its unit, its range and where its default comes from; a file of parameters, the
//! checks and the report all read that table.
//!
//! **Not validated:** no measured force or torque of glenoid reaming was found in the open literature.
//! The law is calibrated to the low end of bone drilling; it misses the highest cortical drilling forces
//! (`osteon report stability` shows every published row beside it).

mod fields;

pub use fields::{FIELDS, Field};

use crate::tissue::{DENSITY_AT_ZERO_HU, DENSITY_PER_HU, TISSUES, Tissue};

/// Cutting law of one tissue class; both moduli are scaled by the square of the density (strength of bone
/// goes with ρ², Carter and Hayes 1976).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Yield pressure at 1 g/cm³, N/mm²: below it a cutting edge does not bite.
    pub yield_n_per_mm2: f64,
    /// Specific cutting energy at 1 g/cm³, N/mm² (= mJ/mm³).
    pub energy_n_per_mm2: f64,
    /// Vibration per cutting force, N/N.
    pub vibration: f64,
}

/// The virtual coupling between device and proxy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CouplingFeel {
    /// Stiffness that the hand feels, N/mm at the stylus.
    pub stiffness_n_per_mm: f64,
    /// Radius at which a turn counts as a shift, mm: rotational stiffness is the square of it times the
    /// stiffness, the torque limit is it times the force limit.
    pub turning_radius_mm: f64,
}

/// The parts of the cutting law that all tissues share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawFeel {
    /// Share of the tangential traction that also resists the feed (λ).
    pub feed_ratio: f64,
    /// Friction of a cutting edge under its yield pressure (μ): torque without feed.
    pub edge_friction: f64,
    /// How far ahead of an element its density is read, voxels.
    pub look_ahead_voxels: f64,
    /// Smallest effective radius as a share of the tool's, for the centre that hardly moves.
    pub min_radius: f64,
    /// Apparent density at 0 HU, g/cm³.
    pub density_at_zero_hu: f64,
    /// Its slope, g/cm³ per HU.
    pub density_per_hu: f64,
}

/// When a cutting element holds bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GripFeel {
    /// Below this gap it takes hold, mm: wider than the stored distance's unit, so that quantisation cannot
    /// chatter.
    pub take_mm: f64,
    /// It lets go above so many times that gap.
    pub release: f64,
}

/// The spindle's motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpindleFeel {
    /// From rest to full speed without load, s.
    pub spin_up_s: f64,
    /// Torque at which it stalls, N·mm at a real tool; a tool may have its own.
    pub stall_nmm: f64,
}

/// The guards between coupling and motors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GuardFeel {
    /// Damping of the hand in contact, N·s/mm; 0 turns it off.
    pub damping_n_s_per_mm: f64,
    /// Corner of the velocity filter, Hz.
    pub velocity_hz: f64,
    /// Most damping that the passivity controller adds, N·s/mm; 0 turns it off.
    pub passivity_n_s_per_mm: f64,
    /// Most force that it adds, N.
    pub passivity_n: f64,
    /// Fastest rise of the force, N/ms.
    pub rise_n_per_ms: f64,
    /// Force that the motors bear for ever (RMS), N.
    pub continuous_n: f64,
    /// Time constant of their heating, s.
    pub thermal_s: f64,
    /// Ramp after a start, s.
    pub start_ramp_s: f64,
    /// Ramp after a gap, a trip, a clutch or a new tool, s.
    pub gap_ramp_s: f64,
    /// Largest vibration, N.
    pub vibration_n: f64,
    /// Largest second difference of a believable sample, mm/ms².
    pub acceleration_mm_ms2: f64,
}

/// All parameters of the feel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feel {
    /// The virtual coupling.
    pub coupling: CouplingFeel,
    /// The cutting law.
    pub law: LawFeel,
    /// Materials by [`Tissue`].
    pub materials: [Material; TISSUES],
    /// When an element holds bone.
    pub grip: GripFeel,
    /// The spindle.
    pub spindle: SpindleFeel,
    /// The guards.
    pub guard: GuardFeel,
    /// Newtons at the stylus per newton at a real tool (α).
    pub force_scale: f64,
    /// Millimetres of the tool per millimetre of the stylus.
    pub motion_scale: f64,
    /// Length of a tick, s. Not a matter of taste, so no file sets it.
    pub tick_s: f64,
}

const fn bone(vibration: f64) -> Material {
    Material {
        yield_n_per_mm2: 0.005,
        energy_n_per_mm2: 40.0,
        vibration,
    }
}

impl Default for Feel {
    fn default() -> Self {
        let mut materials = [bone(0.05); TISSUES];
        materials[Tissue::Cartilage as usize] = bone(0.02);
        materials[Tissue::Subchondral as usize] = bone(0.15);
        materials[Tissue::Cortical as usize] = bone(0.15);
        Self {
            coupling: CouplingFeel {
                stiffness_n_per_mm: 0.5,
                turning_radius_mm: 30.0,
            },
            law: LawFeel {
                feed_ratio: 1.0,
                edge_friction: 0.1,
                look_ahead_voxels: 1.0,
                min_radius: 0.1,
                density_at_zero_hu: DENSITY_AT_ZERO_HU,
                density_per_hu: DENSITY_PER_HU,
            },
            materials,
            grip: GripFeel {
                take_mm: 1e-3,
                release: 4.0,
            },
            spindle: SpindleFeel {
                spin_up_s: 0.3,
                stall_nmm: 3000.0,
            },
            guard: GuardFeel {
                damping_n_s_per_mm: 1e-3,
                velocity_hz: 50.0,
                passivity_n_s_per_mm: 15e-3,
                passivity_n: 2.0,
                rise_n_per_ms: 0.5,
                continuous_n: 0.88,
                thermal_s: 30.0,
                start_ramp_s: 1.0,
                gap_ramp_s: 0.07,
                vibration_n: 0.25,
                acceleration_mm_ms2: 0.7,
            },
            force_scale: 0.03,
            motion_scale: 1.0,
            tick_s: 1e-3,
        }
    }
}

/// A parameter outside its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeelError {
    /// Its name in a file of parameters.
    pub key: &'static str,
    /// What was asked.
    pub value: f64,
    /// What is allowed.
    pub range: [f64; 2],
    /// Unit.
    pub unit: &'static str,
}

impl core::fmt::Display for FeelError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let [lo, hi] = self.range;
        let Self {
            key, value, unit, ..
        } = self;
        write!(f, "{key} = {value} {unit} is outside {lo} to {hi}")
    }
}

impl core::error::Error for FeelError {}

impl Feel {
    /// Checks every number against its range.
    pub fn check(&self) -> Result<(), FeelError> {
        for field in FIELDS {
            field.check(field.get(self))?;
        }
        Ok(())
    }

    /// Sets a parameter by its name; `None` where there is none of that name.
    pub fn set(&mut self, key: &str, value: f64) -> Option<Result<(), FeelError>> {
        let field = FIELDS.iter().find(|field| field.key == key)?;
        Some(field.set(self, value))
    }

    /// Apparent density, g/cm³, of a CT number in HU; never below 0.05.
    pub fn density_g_cm3(&self, hu: f64) -> f64 {
        (self.law.density_at_zero_hu + self.law.density_per_hu * hu).max(0.05)
    }
}
