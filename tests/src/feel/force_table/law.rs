//! The cutting law for a twist drill, in closed form and summed over elements.

use core::f64::consts::{PI, TAU};
use osteon_sim_core::feel::Feel;
use osteon_sim_core::tissue::Tissue;
use osteon_sim_core::tool::elements::of_revolved;
use osteon_sim_core::tool::revolved::Revolved;

/// Half angle of a drill's point, degrees: 118° in all, the usual one; no row of the table gives it.
const HALF_ANGLE_DEG: f64 = 59.0;

/// A drill at work.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drill {
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Speed of its spindle, revolutions per minute.
    pub rpm: f64,
    /// Feed along its axis, mm/s.
    pub feed_mm_s: f64,
}

/// What it takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Thrust along the axis, N.
    pub force_n: f64,
    /// Torque about it, N·mm.
    pub torque_nmm: f64,
}

/// Thrust and torque of a drill whose point is wholly in bone of one density (g/cm³), by integration over
/// the cone: with A = πR², u = u₁ρ², p = p₁ρ², c = 1 − r₀/2R (r₀ the smallest radius) and the point's half angle κ,
///
/// F = A p + 2 A λ u v c sin κ/(ω R),  M = u A v/ω + μ p A (2R/3)/sin κ.
///
/// κ = 90° is a flat disc.
pub fn closed_form(feel: &Feel, tissue: Tissue, density: f64, drill: &Drill) -> Figures {
    let material = feel.materials[tissue as usize];
    let radius = 0.5 * drill.diameter_mm;
    let area = PI * radius * radius;
    let sine = HALF_ANGLE_DEG.to_radians().sin();
    let energy = material.energy_n_per_mm2 * density * density;
    let rest = material.yield_n_per_mm2 * density * density;
    let omega = drill.rpm * TAU / 60.0;
    let centre = 1.0 - 0.5 * feel.law.min_radius;
    let viscous = feel.law.feed_ratio * energy * drill.feed_mm_s * centre * sine;
    Figures {
        force_n: area * rest + 2.0 * area * viscous / (omega * radius),
        torque_nmm: energy * area * drill.feed_mm_s / omega
            + feel.law.edge_friction * rest * area * 2.0 * radius / (3.0 * sine),
    }
}

/// The same from the surface elements of such a drill, as the contact solve has them: each element of
/// area a, normal n and radius r adds a (p + λ u s/(ω max(r, r₀))) to the thrust along n, and
/// a (u s/(ω r) + μ p) r to the torque, where s = v n·z is how fast it goes into bone.
pub fn by_elements(feel: &Feel, tissue: Tissue, density: f64, drill: &Drill) -> Figures {
    let material = feel.materials[tissue as usize];
    let radius = 0.5 * drill.diameter_mm;
    #[expect(clippy::cast_possible_truncation, reason = "millimetres and degrees")]
    let solid = Revolved::drill([radius, HALF_ANGLE_DEG, 4.0 * radius].map(|v| v as f32));
    let energy = material.energy_n_per_mm2 * density * density;
    let rest = material.yield_n_per_mm2 * density * density;
    let omega = drill.rpm * TAU / 60.0;
    let smallest = feel.law.min_radius * radius;
    let mut sum = Figures {
        force_n: 0.0,
        torque_nmm: 0.0,
    };
    for e in of_revolved(&solid).iter().filter(|e| e.cutting) {
        let (area, facing) = (f64::from(e.area_mm2), f64::from(-e.normal.z).max(0.0));
        let speed = drill.feed_mm_s * facing;
        let r = f64::from(e.radius_mm);
        let along = rest + feel.law.feed_ratio * energy * speed / (omega * r.max(smallest));
        sum.force_n += area * along * facing;
        // u s/(ω r) times its arm r
        sum.torque_nmm += area * (energy * speed / omega + feel.law.edge_friction * rest * r);
    }
    sum
}
