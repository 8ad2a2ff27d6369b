//! The cutting law at one surface element: a Bingham medium whose yield and viscosity go with ρ².
//!
//! Specific cutting energy `u = u₁ρ²`; the spindle's work on an element is its cutting energy, so the
//! tangential traction is `τ = u v_n/(ω r)`; the normal one `σ = p₁ρ² + λτ`. Source of the form: energy
//! per removed volume is constant for a given bone (Arbabtafti et al. 2008), strength goes with ρ²
//! (Carter and Hayes 1976), an edge needs a threshold (ploughing).

use super::{RIGID_N_PER_MM3, ToolState};
use crate::feel::Feel;
use crate::sample::Sampler;
use glam::DVec3;

/// What one element meets, per area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resistance {
    /// Yield pressure at the stylus, N/mm².
    pub yield_n_per_mm2: f64,
    /// Pressure at the stylus per feed, N·s/mm³.
    pub viscous_n_s_per_mm3: f64,
    /// Specific cutting energy at a real tool, N/mm².
    pub energy_n_per_mm2: f64,
    /// Spindle torque without feed at a real tool, N·mm/mm².
    pub edge_nmm_per_mm2: f64,
    /// Vibration per force, N/N.
    pub vibration: f64,
}

/// The law for one tool at one speed.
#[derive(Debug, Clone, Copy)]
pub struct Cutter<'a> {
    sampler: Sampler<'a>,
    feel: &'a Feel,
    ahead_mm: f64,
    smallest_mm: f64,
    omega_rad_s: f64,
}

impl<'a> Cutter<'a> {
    /// The law for a tool in a bone whose smallest spacing is `h` mm.
    pub fn new(sampler: Sampler<'a>, h: f64, state: &ToolState<'_>, feel: &'a Feel) -> Self {
        Self {
            sampler,
            feel,
            ahead_mm: h * feel.law.look_ahead_voxels,
            smallest_mm: feel.law.min_radius * state.tool.shape.bounds().reach_mm(),
            omega_rad_s: state.omega_rad_s,
        }
    }

    /// Apparent density, g/cm³, and tissue class that an element at `p` with outward `normal` meets (bone
    /// frame). They are read one voxel ahead of the surface (as the feel says), from the bone as it was, so
    /// that a cut that lags by a tick changes nothing; where there is none ahead, at the element.
    pub fn met(&self, p: DVec3, normal: DVec3) -> (f64, u8) {
        let ahead = self.sampler.matter(p + normal * self.ahead_mm);
        let found = ahead.or_else(|| self.sampler.matter(p));
        found.map_or((self.feel.density_g_cm3(-1000.0), 0), |matter| {
            (self.feel.density_g_cm3(f64::from(matter.hu)), matter.class)
        })
    }

    /// The law for an apparent density in g/cm³ and a tissue class.
    pub fn of(&self, density: f64, class: u8, radius_mm: f64) -> Resistance {
        let (law, scale) = (&self.feel.law, self.feel.force_scale);
        let material = &self.feel.materials[usize::from(class) % self.feel.materials.len()];
        let rho2 = density * density;
        let radius = radius_mm.max(self.smallest_mm);
        let pressure = material.yield_n_per_mm2 * rho2;
        let energy = material.energy_n_per_mm2 * rho2;
        let viscous = law.feed_ratio * energy / (self.omega_rad_s * radius);
        Resistance {
            yield_n_per_mm2: scale * pressure,
            // a spindle that hardly turns is a rigid tool, and a division by zero one too
            viscous_n_s_per_mm3: (scale * viscous).min(RIGID_N_PER_MM3 * self.feel.tick_s),
            energy_n_per_mm2: energy,
            edge_nmm_per_mm2: law.edge_friction * pressure * radius_mm,
            vibration: material.vibration,
        }
    }
}
