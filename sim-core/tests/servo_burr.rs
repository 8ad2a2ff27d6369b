//! A burr, whose curved face is carved larger than it is: its elements must still feel the bone.

#![expect(clippy::print_stdout, reason = "a test that shows its figures")]

mod common;

use common::{Rig, slab};
use glam::DVec3;
use osteon_sim_core::servo::Request;
use osteon_sim_core::tool::revolved::Revolved;
use osteon_sim_core::tool::{STEEL, Tool};
use std::f64::consts::{PI, TAU};

const TOP: f64 = 18.3;
const RADIUS: f64 = 3.0;
const RPM: f64 = 1500.0;

fn burr() -> Tool {
    Tool::revolved(["Burr", "burr"], Revolved::ball(3.0), (RPM, 6), STEEL)
}

/// Force at the stylus, N, of the burr fed at `v` mm/s along its axis into bone of density `rho`, its
/// lower half in bone. The proxy's equilibrium: each element in front gives `n (Y + V s)` with
/// `s = |n_z| v` per tick, so along the axis
///
/// ```text
/// F = Σ A |n_z| c y ρ² + Σ A n_z² c u ρ² v / (ω max(r, r_min))
/// ```
fn law(rho: f64, v: f64) -> f64 {
    let omega = RPM * TAU / 60.0;
    let front = burr().elements.into_iter().filter(|e| e.normal.z < 0.0);
    front
        .map(|e| {
            let (area, nz) = (f64::from(e.area_mm2), f64::from(-e.normal.z));
            let r = f64::from(e.radius_mm).max(0.1 * RADIUS);
            0.03 * rho * rho * area * nz * (0.005 + 40.0 * nz * v / (omega * r))
        })
        .sum()
}

/// The same as an integral over the half sphere: Y takes the circle's area, V
/// ∫ 2πR cos²θ dθ = π²R/2, less what the smallest radius takes from the pole.
fn integral(rho: f64, v: f64) -> f64 {
    let omega = RPM * TAU / 60.0;
    let rim = 0.1f64.asin();
    let beyond = TAU * RADIUS * (PI / 4.0 - rim / 2.0 - (2.0 * rim).sin() / 4.0);
    let pole = TAU * RADIUS * RADIUS * (1.0 - rim.cos().powi(3)) / 3.0 / (0.1 * RADIUS);
    let area = PI * RADIUS * RADIUS;
    0.03 * rho * rho * (0.005 * area + 40.0 * v / omega * (beyond + pole))
}

/// Feed, mm/s, under a constant push of `force` N with the lower half in bone.
fn feed_under(rho: f64, force: f64) -> f64 {
    let bone = slab(DVec3::new(46.0, 46.0, 24.0), DVec3::splat(0.5), TOP, rho);
    // not on a node of the lattice
    let surface = DVec3::new(23.1, 22.8, TOP);
    let mut rig = Rig::with_tools(bone, surface, vec![burr()]);
    rig.rest(surface + DVec3::Z * 10.0, 1100);
    rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
    let mut out = rig.glide(surface + DVec3::Z * 10.0, surface + DVec3::Z * 3.5, 15.0);
    let mut push = |ticks: u32| {
        for _ in 0..ticks {
            let hand = out.bone_from_tool.translation.z - force / 0.5;
            out = rig.tick_at(DVec3::new(surface.x, surface.y, hand), &[]);
        }
        out.bone_from_tool.translation.z
    };
    let mut from = push(1);
    while from > TOP - 0.5 {
        from = push(1);
    }
    from - push(1000)
}

#[test]
fn a_burr_feeds_as_its_law_says() {
    for (rho, v) in [(0.45, 3.0), (0.6, 1.0), (1.9, 0.6)] {
        let force = law(rho, v);
        // the pole, where 1/r is large, has few elements
        let ratio = force / integral(rho, v);
        assert!((ratio - 1.0).abs() < 0.05, "the elements: {ratio}");
        let got = feed_under(rho, force);
        println!("rho {rho}: push {force:.3} N, feed {got:.3} mm/s, law {v}");
        assert!((got / v - 1.0).abs() < 0.05, "{got} {v}");
    }
}
