//! The table of parameters.

use super::{Feel, FeelError};
use crate::tissue::Tissue;

const CARTILAGE: usize = Tissue::Cartilage as usize;
const SUBCHONDRAL: usize = Tissue::Subchondral as usize;
const CANCELLOUS: usize = Tissue::Cancellous as usize;
const CORTICAL: usize = Tissue::Cortical as usize;

/// One parameter.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Name in a file of parameters: `table.name`, or `name` alone.
    pub key: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Lowest and highest value.
    pub range: [f64; 2],
    /// Where the default comes from.
    pub source: &'static str,
    at: fn(&mut Feel) -> &mut f64,
}

impl Field {
    /// Its value.
    pub fn get(&self, feel: &Feel) -> f64 {
        let mut copy = *feel;
        *(self.at)(&mut copy)
    }

    /// Sets it; an error where the value is outside its range or no number.
    pub fn set(&self, feel: &mut Feel, value: f64) -> Result<(), FeelError> {
        self.check(value)?;
        *(self.at)(feel) = value;
        Ok(())
    }

    pub(super) fn check(&self, value: f64) -> Result<(), FeelError> {
        if (self.range[0]..=self.range[1]).contains(&value) {
            return Ok(());
        }
        Err(FeelError {
            key: self.key,
            value,
            range: self.range,
            unit: self.unit,
        })
    }
}

const fn field(
    key: &'static str,
    unit: &'static str,
    range: [f64; 2],
    source: &'static str,
    at: fn(&mut Feel) -> &mut f64,
) -> Field {
    Field {
        key,
        unit,
        range,
        source,
        at,
    }
}

/// Every parameter that a file may set, in the order of the documents.
pub const FIELDS: &[Field] = &[
    field(
        "force_scale",
        "N/N",
        [0.001, 1.0],
        "30 N at a real tool = 0.9 N, what an Omni bears for ever",
        |feel| &mut feel.force_scale,
    ),
    field(
        "motion_scale",
        "mm/mm",
        [0.2, 5.0],
        "a glenoid fits the workspace as it is",
        |feel| &mut feel.motion_scale,
    ),
    field(
        "coupling.stiffness_n_per_mm",
        "N/mm",
        [0.05, 0.7],
        "below what the map of `report stability` allows with one tick of delay; CHAI3D ships 0.7 for the Omni",
        |feel| &mut feel.coupling.stiffness_n_per_mm,
    ),
    field(
        "coupling.turning_radius_mm",
        "mm",
        [5.0, 100.0],
        "about the reach of a reamer's rim from the grip",
        |feel| &mut feel.coupling.turning_radius_mm,
    ),
    field(
        "law.feed_ratio",
        "N/N",
        [0.0, 5.0],
        "tractions along and across an edge of like size; unvalidated",
        |feel| &mut feel.law.feed_ratio,
    ),
    field(
        "law.edge_friction",
        "N/N",
        [0.0, 1.0],
        "steel on wet bone; unvalidated",
        |feel| &mut feel.law.edge_friction,
    ),
    field(
        "law.look_ahead_voxels",
        "voxels",
        [0.0, 3.0],
        "a voxel: at the bone's own surface a density is half air",
        |feel| &mut feel.law.look_ahead_voxels,
    ),
    field(
        "law.min_radius",
        "mm/mm",
        [0.02, 1.0],
        "the chisel edge, a tenth of a drill's diameter",
        |feel| &mut feel.law.min_radius,
    ),
    field(
        "law.density_at_zero_hu",
        "g/cm3",
        [-1.0, 2.0],
        "Rho et al. 1995 as commonly cited; scanner-dependent",
        |feel| &mut feel.law.density_at_zero_hu,
    ),
    field(
        "law.density_per_hu",
        "g/cm3/HU",
        [1e-05, 0.01],
        "Rho et al. 1995 as commonly cited; scanner-dependent",
        |feel| &mut feel.law.density_per_hu,
    ),
    field(
        "grip.take_mm",
        "mm",
        [0.0, 0.1],
        "some units of the stored distance (0.03 um a unit at 0.5 mm), and what carving may be off",
        |feel| &mut feel.grip.take_mm,
    ),
    field(
        "grip.release",
        "times",
        [1.0, 20.0],
        "hysteresis: what holds does not let go for a rounding",
        |feel| &mut feel.grip.release,
    ),
    field(
        "spindle.spin_up_s",
        "s",
        [0.01, 5.0],
        "surgical power tools reach their speed in some tenths of a second",
        |feel| &mut feel.spindle.spin_up_s,
    ),
    field(
        "spindle.stall_nmm",
        "N mm",
        [10.0, 50000.0],
        "order of a battery drill in its drill gear; unvalidated",
        |feel| &mut feel.spindle.stall_nmm,
    ),
    field(
        "guard.damping_n_s_per_mm",
        "N s/mm",
        [0.0, 0.005],
        "the map of `report stability` is made with it; CHAI3D ships 5 N s/m for the Omni",
        |feel| &mut feel.guard.damping_n_s_per_mm,
    ),
    field(
        "guard.velocity_hz",
        "Hz",
        [5.0, 200.0],
        "above a hand's bandwidth, below the quantisation's noise",
        |feel| &mut feel.guard.velocity_hz,
    ),
    field(
        "guard.passivity_n_s_per_mm",
        "N s/mm",
        [0.0, 0.05],
        "Hannaford and Ryu 2002, a third of what a bare stylus of 45 g bears in a tick",
        |feel| &mut feel.guard.passivity_n_s_per_mm,
    ),
    field(
        "guard.passivity_n",
        "N",
        [0.0, 3.3],
        "below what startles a hand",
        |feel| &mut feel.guard.passivity_n,
    ),
    field(
        "guard.rise_n_per_ms",
        "N/ms",
        [0.01, 3.3],
        "does not bind below 1 m/s at the default stiffness",
        |feel| &mut feel.guard.rise_n_per_ms,
    ),
    field(
        "guard.continuous_n",
        "N",
        [0.1, 3.3],
        "data sheet of the Omni class",
        |feel| &mut feel.guard.continuous_n,
    ),
    field(
        "guard.thermal_s",
        "s",
        [1.0, 600.0],
        "small DC motors' windings",
        |feel| &mut feel.guard.thermal_s,
    ),
    field(
        "guard.start_ramp_s",
        "s",
        [0.05, 10.0],
        "a hand notices and lets go",
        |feel| &mut feel.guard.start_ramp_s,
    ),
    field(
        "guard.gap_ramp_s",
        "s",
        [0.01, 5.0],
        "3.3 N at no more than 0.05 N in a tick",
        |feel| &mut feel.guard.gap_ramp_s,
    ),
    field(
        "guard.vibration_n",
        "N",
        [0.0, 0.5],
        "felt clearly, and below a tenth of the peak force",
        |feel| &mut feel.guard.vibration_n,
    ),
    field(
        "guard.acceleration_mm_ms2",
        "mm/ms2",
        [0.1, 100.0],
        "700 m/s2: no hand does it, and a jump of 1 mm in a sample is found",
        |feel| &mut feel.guard.acceleration_mm_ms2,
    ),
    field(
        "cartilage.yield_n_per_mm2",
        "N/mm2",
        [0.0, 10.0],
        "low end of published bone drilling thrusts",
        |feel| &mut feel.materials[CARTILAGE].yield_n_per_mm2,
    ),
    field(
        "cartilage.energy_n_per_mm2",
        "N/mm2",
        [0.0, 1000.0],
        "low end of published drilling; cortical rows with a known feed took 3 to 13 times its thrust",
        |feel| &mut feel.materials[CARTILAGE].energy_n_per_mm2,
    ),
    field(
        "cartilage.vibration",
        "N/N",
        [0.0, 1.0],
        "what experts feel of the layers, least in cartilage (after Strelzow et al. 2023)",
        |feel| &mut feel.materials[CARTILAGE].vibration,
    ),
    field(
        "subchondral.yield_n_per_mm2",
        "N/mm2",
        [0.0, 10.0],
        "low end of published bone drilling thrusts",
        |feel| &mut feel.materials[SUBCHONDRAL].yield_n_per_mm2,
    ),
    field(
        "subchondral.energy_n_per_mm2",
        "N/mm2",
        [0.0, 1000.0],
        "low end of published drilling; cortical rows with a known feed took 3 to 13 times its thrust",
        |feel| &mut feel.materials[SUBCHONDRAL].energy_n_per_mm2,
    ),
    field(
        "subchondral.vibration",
        "N/N",
        [0.0, 1.0],
        "the plate sings; unvalidated",
        |feel| &mut feel.materials[SUBCHONDRAL].vibration,
    ),
    field(
        "cancellous.yield_n_per_mm2",
        "N/mm2",
        [0.0, 10.0],
        "low end of published bone drilling thrusts",
        |feel| &mut feel.materials[CANCELLOUS].yield_n_per_mm2,
    ),
    field(
        "cancellous.energy_n_per_mm2",
        "N/mm2",
        [0.0, 1000.0],
        "low end of published drilling; cortical rows with a known feed took 3 to 13 times its thrust",
        |feel| &mut feel.materials[CANCELLOUS].energy_n_per_mm2,
    ),
    field(
        "cancellous.vibration",
        "N/N",
        [0.0, 1.0],
        "soft and wet; unvalidated",
        |feel| &mut feel.materials[CANCELLOUS].vibration,
    ),
    field(
        "cortical.yield_n_per_mm2",
        "N/mm2",
        [0.0, 10.0],
        "low end of published bone drilling thrusts",
        |feel| &mut feel.materials[CORTICAL].yield_n_per_mm2,
    ),
    field(
        "cortical.energy_n_per_mm2",
        "N/mm2",
        [0.0, 1000.0],
        "low end of published drilling; cortical rows with a known feed took 3 to 13 times its thrust",
        |feel| &mut feel.materials[CORTICAL].energy_n_per_mm2,
    ),
    field(
        "cortical.vibration",
        "N/N",
        [0.0, 1.0],
        "as the plate; unvalidated",
        |feel| &mut feel.materials[CORTICAL].vibration,
    ),
];
