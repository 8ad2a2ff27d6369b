//! Sliding over an oblique plane with the real servo.

use super::bench::Bench;
use super::device::FINE;
use super::peers::tangent::moments;
use super::setup::{Slab, Spec, ball};
use glam::{DVec3, Vec3};
use osteon_sim_core::tool::{Element, Tool};

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

/// A ball of 6 mm with so many surface elements, spread evenly; the servo takes at most
/// [`osteon_sim_core::tool::MAX_ELEMENTS`].
pub fn ball_of(elements: u16) -> Tool {
    let count = f32::from(elements);
    let spread = (0..elements)
        .map(|n| {
            let z = (2.0 * f32::from(n) + 1.0) / count - 1.0;
            let turn = 2.399_963_2 * f32::from(n);
            let r = (1.0 - z * z).sqrt();
            let normal = Vec3::new(r * turn.cos(), r * turn.sin(), z);
            Element {
                position: normal * 6.0 + Vec3::Z * 6.0,
                normal,
                area_mm2: 4.0 * core::f32::consts::PI * 36.0 / count,
                radius_mm: 6.0 * r,
                cutting: true,
            }
        })
        .collect();
    ball(6.0).with_elements(spread)
}

/// Slides a ball of 6 mm over a plane that is tilted about y, the device 0.3 mm below it.
pub fn slide(voxel_mm: f64, tilt_deg: f64) -> RippleRow {
    slide_with(ball(6.0), voxel_mm, tilt_deg).0
}

/// The same with a tool of one's own; also the run itself, with its inputs, and what it was made from.
pub fn slide_with(tool: Tool, voxel_mm: f64, tilt_deg: f64) -> (RippleRow, Bench, Spec) {
    let slab = Slab {
        extent_mm: DVec3::new(44.0, 24.0, 44.0),
        spacing_mm: DVec3::splat(voxel_mm),
        tilt_deg,
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(vec![tool]));
    spec.scale = FINE;
    let mut bench = Bench::new(&spec);
    bench.kept = Some(Vec::new());
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
    let row = RippleRow {
        rule: "ours".to_owned(),
        voxel_mm,
        tilt_deg,
        mean_over_exact: mean / (DEPTH * spec.feel.coupling.stiffness_n_per_mm),
        ripple_rms: deviation / mean,
        ripple_peak: 0.5 * (hi - lo) / mean,
        tangential_rms: moments(&along).1 / mean,
    };
    (row, bench, spec)
}
