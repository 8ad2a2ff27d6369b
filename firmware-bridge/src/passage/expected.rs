//! What the cutting law expects of a constant push.

use super::layers::{Layers, Uncut};
use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;

/// Step along the axis, mm.
const STEP_MM: f64 = 0.05;

/// Time, s, that a tool takes through each layer when it is pressed straight along the planned axis with
/// `push_n` (at the stylus) at full speed of its spindle: the law's own feed v = (F − Y)/V, with yield Y
/// and viscosity V summed over the elements that lie in bone, added up over the depth. `None` for a layer
/// that it does not pass, or does not reach.
///
/// The hand, the device's friction, the guards and the voxels' interpolation are not in it.
pub fn expected_s(
    bone: &Bone,
    bone_from_plan: &Pose,
    layers: &Layers,
    tool: &Tool,
    feel: &Feel,
    push_n: f64,
) -> Vec<Option<f64>> {
    let uncut = Uncut::new(bone);
    let h = bone.grid().spacing_mm.min_element();
    let mut stalled = false;
    let mut through = |from_mm: f64, to_mm: f64| {
        let mut seconds = 0.0;
        let mut depth = from_mm;
        while depth < to_mm && !stalled {
            let step = STEP_MM.min(to_mm - depth);
            let apex = DVec3::Z * (layers.surface_mm - depth - 0.5 * step);
            let bone_from_tool = bone_from_plan.then(&Pose::new(DQuat::IDENTITY, apex));
            let (rest, slope) = resistance(&uncut, h, (tool, &bone_from_tool), feel);
            // in air there is nothing to wait for
            if slope > 0.0 {
                seconds += step * slope / (push_n - rest).max(0.0);
            }
            depth += step;
            stalled = !seconds.is_finite();
        }
        (!stalled).then_some(seconds)
    };
    let each = layers.layers.iter();
    each.map(|layer| through(layer.from_mm, layer.to_mm))
        .collect()
}

/// Thrust of the tool at the stylus: N, and N·s/mm of feed. `h` is the bone's smallest spacing, mm.
fn resistance(
    uncut: &Uncut<'_>,
    h: f64,
    (tool, bone_from_tool): (&Tool, &Pose),
    feel: &Feel,
) -> (f64, f64) {
    let omega = tool.rpm * TAU / 60.0;
    let smallest = feel.law.min_radius * tool.shape.bounds().reach_mm();
    let mut sum = (0.0, 0.0);
    for e in tool.elements.iter().filter(|e| e.cutting) {
        let p = bone_from_tool.point(e.position.as_dvec3());
        let Some(here) = uncut.at(p) else {
            continue;
        };
        // the law looks ahead of the surface
        let ahead = bone_from_tool.vector(e.normal.as_dvec3()) * h;
        let (hu, tissue) = uncut.at(p + ahead).unwrap_or(here);
        let material = feel.materials[tissue as usize];
        let rho = feel.density_g_cm3(hu);
        // share of the element's area that looks along the feed
        let facing = f64::from(-e.normal.z).max(0.0);
        let scale = feel.force_scale * f64::from(e.area_mm2) * facing * rho * rho;
        let speed = omega * f64::from(e.radius_mm).max(smallest);
        sum.0 += scale * material.yield_n_per_mm2;
        sum.1 += scale * facing * feel.law.feed_ratio * material.energy_n_per_mm2 / speed;
    }
    sum
}
