//! A linear wall with a delay but without a servo: the loop that the stability laws speak of.

use glam::DVec3;
use osteon_sim_core::chain::FORCE_LIMIT_N;
use osteon_sim_core::omni;
use osteon_sim_core::servo::{DeviceScale, Sample};

/// A spring below base z = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// N/mm.
    pub stiffness_n_per_mm: f64,
    /// What the device's numbers mean.
    pub scale: DeviceScale,
}

impl Wall {
    /// Force, N, and the torque for it, DAC counts.
    pub fn tick(&self, sample: &Sample) -> (DVec3, [i16; 3]) {
        let angles = omni::angles_from_counts(sample.encoders, self.scale.counts_per_rev);
        let depth = -omni::forward(angles).z;
        let push = (self.stiffness_n_per_mm * depth).clamp(0.0, FORCE_LIMIT_N);
        let force = DVec3::Z * push;
        let torque = omni::torque_from_force(angles, force) / self.scale.nmm_per_count;
        #[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
        let counts = torque.round().to_array().map(|v| v as i16);
        (force, counts)
    }
}
