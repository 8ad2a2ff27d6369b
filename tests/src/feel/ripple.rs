//! Sliding over an oblique plane with the real servo.

use super::bench::Bench;
use super::device::FINE;
use super::peers::tangent::moments;
use super::setup::{Slab, Spec, ball};
use glam::DVec3;

pub use super::peers::tangent::RippleRow;

/// Tilts of the plane against the lattice, degrees.
pub const TILTS_DEG: [f64; 3] = [7.0, 20.0, 35.26];
/// Voxels, mm.
pub const VOXELS_MM: [f64; 2] = [1.0, 0.5];
/// The device's depth below the face, mm.
const DEPTH: f64 = 0.3;
/// Speed of the slide, mm/s, and half of its way, mm.
const SPEED: f64 = 20.0;
const HALF_WAY: f64 = 10.0;

/// Slides a ball of 6 mm over a plane that is tilted about y, the device 0.3 mm below it.
pub fn slide(voxel_mm: f64, tilt_deg: f64) -> RippleRow {
    let slab = Slab {
        extent_mm: DVec3::new(44.0, 24.0, 44.0),
        spacing_mm: DVec3::splat(voxel_mm),
        tilt_deg,
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(vec![ball(6.0)]));
    spec.scale = FINE;
    let mut bench = Bench::new(&spec);
    let (from, to) = (-HALF_WAY, HALF_WAY);
    bench.run_in();
    bench.glide(DVec3::new(from, 0.0, 2.0), 50.0);
    bench.glide(DVec3::new(from, 0.0, -DEPTH), 20.0);
    bench.rest(0.1);
    // into the slide's steady part
    bench.glide(DVec3::new(from + 1.0, 0.0, -DEPTH), SPEED);
    bench.trace.clear();
    bench.glide(DVec3::new(to, 0.0, -DEPTH), SPEED);
    let normal: Vec<f64> = bench.trace.records.iter().map(|r| r.asked_n.z).collect();
    let along: Vec<f64> = bench.trace.records.iter().map(|r| r.asked_n.x).collect();
    let (mean, deviation) = moments(&normal);
    let (lo, hi) = normal
        .iter()
        .fold((f64::MAX, f64::MIN), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    RippleRow {
        rule: "ours".to_owned(),
        voxel_mm,
        tilt_deg,
        mean_over_exact: mean / (DEPTH * spec.feel.coupling.stiffness_n_per_mm),
        ripple_rms: deviation / mean,
        ripple_peak: 0.5 * (hi - lo) / mean,
        tangential_rms: moments(&along).1 / mean,
    }
}
