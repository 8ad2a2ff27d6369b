//! Points against binary voxels by tangent planes: a point in a voxel that the surface touches, or below it, is as deep as the plane
//! through the voxel's centre, across the point's own normal, says.

use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use serde::Serialize;

/// Points on the ball.
const POINTS: u32 = 1000;
/// The ball's radius and how deep it is in the bone, mm.
const RADIUS: f64 = 6.0;
const DEPTH: f64 = 0.3;
/// The way along the plane and its steps, mm.
const WAY: f64 = 20.0;
const STEP: f64 = 0.02;

/// One slide.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RippleRow {
    /// Whose rule.
    pub rule: String,
    /// Voxels, mm.
    pub voxel_mm: f64,
    /// Tilt of the plane against the lattice, degrees.
    pub tilt_deg: f64,
    /// Mean normal force over that of the same points against the exact plane.
    pub mean_over_exact: f64,
    /// Standard deviation of the normal force over its mean.
    pub ripple_rms: f64,
    /// Half of its peak to peak over its mean.
    pub ripple_peak: f64,
    /// Standard deviation of the force along the way over the mean normal force.
    pub tangential_rms: f64,
}

/// Directions spread evenly over a ball.
fn points() -> Vec<DVec3> {
    (0..POINTS)
        .map(|n| {
            let z = 1.0 - 2.0 * (f64::from(n) + 0.5) / f64::from(POINTS);
            let turn = TAU * 0.618_033_988_75 * f64::from(n);
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * turn.cos(), r * turn.sin(), z)
        })
        .collect()
}

/// Slides the ball over a plane through the origin that is tilted about y.
pub fn slide(voxel_mm: f64, tilt_deg: f64) -> RippleRow {
    let turn = DQuat::from_rotation_y(tilt_deg.to_radians());
    let (normal, along) = (turn * DVec3::Z, turn * DVec3::X);
    let points = points();
    // a voxel that the surface touches is a surface voxel
    let touch = 0.5 * voxel_mm * normal.abs().element_sum();
    let (mut binary, mut across, mut exact) = (Vec::new(), Vec::new(), 0.0);
    let mut way = 0.0;
    while way < WAY {
        let centre = normal * (RADIUS - DEPTH) + along * way + DVec3::Y * 0.123;
        let (mut force, mut true_force) = (DVec3::ZERO, DVec3::ZERO);
        for out in &points {
            let p = centre + *out * RADIUS;
            true_force += normal * (-normal.dot(p)).max(0.0);
            let voxel = (p / voxel_mm).round() * voxel_mm;
            let full = normal.dot(voxel) < touch;
            let depth = (voxel - p).dot(-*out);
            if full && depth > 0.0 {
                force -= *out * depth;
            }
        }
        binary.push(force.dot(normal));
        across.push(force.dot(along));
        exact += true_force.dot(normal);
        way += STEP;
    }
    let (mean, deviation) = moments(&binary);
    let (lo, hi) = binary
        .iter()
        .fold((f64::MAX, f64::MIN), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    RippleRow {
        rule: "binary voxels".to_owned(),
        voxel_mm,
        tilt_deg,
        mean_over_exact: mean * binary.len() as f64 / exact,
        ripple_rms: deviation / mean,
        ripple_peak: 0.5 * (hi - lo) / mean,
        tangential_rms: moments(&across).1 / mean,
    }
}

/// Mean and standard deviation.
pub fn moments(values: &[f64]) -> (f64, f64) {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count;
    (mean, square.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binary_voxels_ripple_at_every_tilt() {
        for voxel in [1.0, 0.5] {
            for tilt in [7.0, 20.0, 35.26] {
                let row = slide(voxel, tilt);
                assert!(row.ripple_rms > 0.01, "{row:?}");
            }
        }
    }
}
