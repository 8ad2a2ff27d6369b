//! Tilting a reamer that stands in its own socket: what it costs, and what it cuts.

use super::feed::{Faced, seated_with};
use super::guided::Guided;
use super::setup::Spec;
use glam::{DQuat, DVec3};
use osteon_sim_core::feel::Feel;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::Tissue;
use serde::Serialize;

/// How far, degrees, and how fast, degrees/s.
const TILT_DEG: f64 = 10.0;
const SPEED_DEG_S: f64 = 20.0;
/// g/cm³.
const DENSITY: f64 = 0.3;
/// Grid of the volume's truth, mm.
const FINE_MM: f64 = 0.25;

/// A tilt about the tool's tip.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TiltRow {
    /// Whether the spindle turned.
    pub spindle: bool,
    /// How far the tool turned in the bone, degrees (the hand: 10).
    pub turned_deg: f64,
    /// Torque at the end that holds or turns it, N·m at a real tool.
    pub torque_nm: f64,
    /// The same by the law over the elements at that place, N·m.
    pub law_nm: f64,
    /// Removed, mm³.
    pub removed_mm3: f64,
    /// What the tool's own way sweeps, mm³.
    pub swept_mm3: f64,
    /// Work of the hand, mJ at the stylus (in place; the turn is not the arm's to feel).
    pub least_hand_mj: f64,
}

/// Tilts the reamer by 10° at 20°/s.
pub fn tilted(spindle: bool) -> TiltRow {
    tilted_with(&Feel::default(), spindle)
}

/// The same with a feel of one's own.
pub fn tilted_with(feel: &Feel, spindle: bool) -> TiltRow {
    let mut faced = Faced::reamer();
    if !spindle {
        // a dome can roll out of a socket that has no wall
        faced.depth_mm = 10.0;
    }
    let (mut guided, spec) = seated_with(feel, &faced, DENSITY, spindle);
    guided.rest(0.2);
    let before = guided.removed_mm3();
    let mut way = vec![pose(&guided, &spec)];
    let ticks = 1000.0 * TILT_DEG / SPEED_DEG_S;
    let mut n = 0.0;
    let mut last = way[0];
    while n < ticks {
        n += 1.0;
        last = pose(&guided, &spec);
        guided.rotation = DQuat::from_rotation_y((TILT_DEG * n / ticks).to_radians());
        guided.ask(&[]);
        if n % 20.0 == 0.0 {
            way.push(pose(&guided, &spec));
        }
    }
    let here = pose(&guided, &spec);
    let turned = here.rotation.angle_between(way[0].rotation).to_degrees();
    let law_nmm = if spindle {
        law_torque_nmm(&faced, &spec, (&last, &here), guided.output.spindle_rad_s)
    } else {
        f64::NAN
    };
    TiltRow {
        spindle,
        turned_deg: turned,
        torque_nm: 1e-3 * guided.output.holding_torque_nmm.length(),
        law_nm: 1e-3 * law_nmm,
        removed_mm3: guided.removed_mm3() - before,
        swept_mm3: swept_mm3(&faced, &way),
        least_hand_mj: guided.least_hand_mj,
    }
}

/// The proxy in the base frame.
fn pose(guided: &Guided, spec: &Spec) -> Pose {
    let base_from_bone = spec.scene.bone_from_base.inverse();
    base_from_bone.then(&guided.output.bone_from_tool)
}

/// Torque about the tip by the law, summed over the elements that move into bone from one pose to the
/// next: each has the traction `p₁ρ² + λ u₁ρ² v_n/(ω r)` against its normal.
fn law_torque_nmm(faced: &Faced, spec: &Spec, (a, b): (&Pose, &Pose), omega_rad_s: f64) -> f64 {
    let material = spec.feel.materials[Tissue::Cancellous as usize];
    let rho2 = DENSITY * DENSITY;
    let least = spec.feel.law.min_radius * faced.radius_mm;
    let mut torque = DVec3::ZERO;
    for e in &faced.tool.elements {
        let p = e.position.as_dvec3();
        let (from, to) = (a.point(p), b.point(p));
        let normal = b.vector(e.normal.as_dvec3());
        let speed = normal.dot(to - from) / spec.feel.tick_s;
        // above the face there is no bone
        if speed > 1e-3 && to.z < faced.depth_mm {
            let r = f64::from(e.radius_mm).max(least);
            let viscous = spec.feel.law.feed_ratio * material.energy_n_per_mm2 * rho2;
            let pressure = material.yield_n_per_mm2 * rho2 + viscous * speed / (omega_rad_s * r);
            let force = normal * (pressure * f64::from(e.area_mm2));
            torque += (to - b.translation).cross(force);
        }
    }
    torque.length()
}

/// Volume of bone outside the socket that the tool covers at any of the poses.
fn swept_mm3(faced: &Faced, way: &[Pose]) -> f64 {
    let tool_from_base: Vec<Pose> = way.iter().map(Pose::inverse).collect();
    let reach = faced.radius_mm + 2.0;
    #[expect(clippy::cast_possible_truncation, reason = "some hundred points")]
    let (wide, high) = ((reach / FINE_MM) as i32, (faced.depth_mm / FINE_MM) as i32);
    let low = (-3.0 / FINE_MM).round();
    let inside =
        |tool: &Pose, p: DVec3| faced.tool.shape.signed_distance(tool.point(p).as_vec3()) < 0.0;
    let mut count = 0u32;
    for k in 0.. {
        let z = (low + f64::from(k) + 0.5) * FINE_MM;
        if z >= f64::from(high) * FINE_MM {
            break;
        }
        for j in -wide..wide {
            for i in -wide..wide {
                let p = DVec3::new(f64::from(i) + 0.5, f64::from(j) + 0.5, 0.0) * FINE_MM;
                let p = p.with_z(z);
                let first = tool_from_base[0].point(p).as_vec3();
                let d = f64::from(faced.tool.shape.signed_distance(first));
                // no point moves farther than 4 mm
                if (0.0..4.0).contains(&d) && tool_from_base.iter().any(|t| inside(t, p)) {
                    count += 1;
                }
            }
        }
    }
    f64::from(count) * FINE_MM.powi(3)
}
