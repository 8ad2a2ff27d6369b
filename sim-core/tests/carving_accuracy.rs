//! Where the carved surface lies: read trilinearly from the cut, along exact normals.

#![expect(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::expect_used,
    reason = "a test that shows its figures; radii are f32"
)]

mod common;

use common::bone_of;
use common::random::{Random, tool_of};
use common::surface::{Errors, offset, smooth_point, stamped};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{Carving, Isa};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::revolved::Revolved;
use osteon_sim_core::tool::{Shape, Tool};
use std::f64::consts::PI;
use std::sync::Arc;

/// Bone everywhere in a box of `extent` mm.
fn block(extent: DVec3, spacing: DVec3) -> Arc<Bone> {
    let dims = (extent / spacing).to_array().map(|n| n as usize + 1);
    bone_of(dims, spacing, 1.0, |_| 9.0)
}

fn solid_of(tool: &Tool) -> &Revolved {
    let Shape::Revolved(solid) = &tool.shape else {
        unreachable!("a tool of faces")
    };
    solid
}

/// Poses at which the ball stands: aligned on a voxel, half-way between voxels, and five more.
fn places(random: &mut Random, middle: DVec3, h: DVec3) -> Vec<DVec3> {
    let aligned = (middle / h).round() * h;
    let mut all = vec![aligned, aligned + 0.5 * h];
    all.extend([(); 6].map(|()| aligned + random.vector(0.5) * h));
    all
}

/// Surface errors of a ball in a lattice, and the relative error of its volume at each place.
fn ball_errors(carving: Carving, radius: f64, h: DVec3, points: u16) -> (Errors, Vec<f64>) {
    let room = radius + 2.5 * h.length();
    let bone = block(DVec3::splat(2.0 * room), h);
    let tool = tool_of(Revolved::ball(radius as f32));
    let mut random = Random(5);
    let (mut all, mut volumes) = (Errors::default(), Vec::new());
    let truth = 4.0 / 3.0 * PI * radius.powi(3);
    let places = places(&mut random, DVec3::splat(room), h);
    for &place in &places {
        let cut = stamped(carving, &bone, &tool, &Pose::new(random.rotation(), place));
        let got = Cut::mm3(bone.grid(), cut.totals().units());
        volumes.push(got / truth - 1.0);
        for _ in 0..points {
            let normal = random.direction();
            let off = offset(&bone, &cut, place + normal * radius, normal);
            all.add(off.expect("a surface"));
        }
    }
    (all, volumes)
}

#[test]
fn a_balls_surface_and_volume_converge_at_second_order() {
    let mut last: Option<(f64, f64)> = None;
    let mut first = None;
    for h in [2.0, 1.0, 0.5, 0.25] {
        let (e, volumes) = ball_errors(Carving::best(), 6.0, DVec3::splat(h), 1500);
        let order = last.map(|(h0, rms)| (rms / e.rms()).log2() / f64::log2(h0 / h));
        println!(
            "R 6, h {h}: RMS {:.5} mean {:.5} max {:.5} mm, order {order:.2?}; volume {volumes:.6?}",
            e.rms(),
            e.mean(),
            e.max
        );
        if (h - 0.5).abs() < 1e-9 {
            assert!(e.rms() <= 0.003, "{}", e.rms());
            // what the surface encloses, from the mean of its offsets
            let enclosed = 3.0 * e.mean() / 6.0;
            let mean = volumes[2..].iter().sum::<f64>() / (volumes.len() - 2) as f64;
            // what the account counts too much by its rule (bone::Occupancy)
            let rule = 3.0 * h * h / (4.0 * 36.0);
            println!("enclosed {enclosed:.1e}; account: mean {mean:.1e}, by its rule {rule:.1e}");
            assert!(enclosed.abs() <= 1e-4, "{enclosed}");
            assert!((mean - rule).abs() <= 5e-4, "{mean}");
            // the account of one ball rings with its place in the lattice: most where it is aligned
            assert!(
                volumes.iter().all(|v| (v - rule).abs() <= 2e-3),
                "{volumes:?}"
            );
        }
        first.get_or_insert(e.rms());
        last = Some((h, e.rms()));
    }
    let order = (first.unwrap_or(0.0) / last.map_or(1.0, |l| l.1)).log2() / 3.0;
    println!("order over h = 2 to 0.25: {order:.2}");
    assert!(order >= 1.8, "{order}");
}

#[test]
fn reamer_drill_and_burr_at_random_poses_lie_within_micrometres() {
    let mut random = Random(7);
    let burr = tool_of(Revolved::ball(2.5));
    for (h, bound) in [(0.47, 0.006), (0.235, 0.0025), (0.14, 0.0025)] {
        let spacing = DVec3::splat(h);
        let edge = if h < 0.2 { 14.0 } else { 26.0 };
        let bone = block(DVec3::splat(edge), spacing);
        for tool in [Tool::glenoid_reamer(), Tool::peg_drill(), burr.clone()] {
            let e = random_errors(&mut random, &bone, &tool, 8);
            println!(
                "{} h {h}: {} points, RMS {:.2} um, mean {:.2}, max {:.2}",
                tool.id,
                e.count,
                1e3 * e.rms(),
                1e3 * e.mean(),
                1e3 * e.max
            );
            assert!(e.rms() <= bound, "{} {h} {}", tool.id, e.rms());
        }
    }
    let bone = block(DVec3::splat(26.0), DVec3::new(0.47, 0.47, 1.0));
    for tool in [Tool::glenoid_reamer(), Tool::peg_drill(), burr] {
        let e = random_errors(&mut random, &bone, &tool, 8);
        println!(
            "{} 0.47 x 0.47 x 1: RMS {:.4} max {:.4} mm",
            tool.id,
            e.rms(),
            e.max
        );
        assert!(e.rms() <= 0.02, "{} {}", tool.id, e.rms());
    }
}

/// Errors over `poses` random poses that bring a smooth point of the tool near the bone's middle.
fn random_errors(random: &mut Random, bone: &Bone, tool: &Tool, poses: u32) -> Errors {
    let solid = solid_of(tool);
    let grid = bone.grid();
    let far = grid.centre(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
    let h = grid.spacing_mm.max_element();
    let clear = (2.0 * h, 1.5 * h);
    let mut all = Errors::default();
    for _ in 0..poses {
        let (p, _) = smooth_point(random, solid, clear);
        let rotation = random.rotation();
        let pose = Pose::new(rotation, 0.5 * far - rotation * p);
        let cut = stamped(Carving::best(), bone, tool, &pose);
        let (mut found, mut tried) = (0, 0);
        while found < 300 && tried < 20_000 {
            tried += 1;
            let (p, normal) = smooth_point(random, solid, clear);
            let (p, normal) = (pose.point(p), pose.vector(normal));
            let room = 2.5 * h;
            if p.min_element() > room && (far - p).min_element() > room {
                found += 1;
                all.add(offset(bone, &cut, p, normal).expect("a surface"));
            }
        }
    }
    assert!(all.count >= 1500, "{}", all.count);
    all
}

#[test]
fn every_vector_unit_passes_from_4_to_200_voxels() {
    let h = 0.5;
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let carving = Carving {
            isa,
            ..Carving::best()
        };
        for voxels in [4.0, 8.0, 20.0, 60.0, 200.0] {
            let radius = h * voxels;
            let tool = tool_of(Revolved::ball(radius as f32));
            let bone = block(DVec3::splat(14.0), DVec3::splat(h));
            let (mut random, mut e) = (Random(11), Errors::default());
            for _ in 0..6 {
                // the middle of the block lies on the surface
                let place = DVec3::splat(7.0) + random.vector(h);
                let centre = place - random.direction() * radius;
                let pose = Pose::new(random.rotation(), centre);
                let cut = stamped(carving, &bone, &tool, &pose);
                for _ in 0..400 {
                    let near = place + random.vector(4.0) - centre;
                    let normal = near / near.length();
                    let p = centre + normal * radius;
                    if p.min_element() > 1.5 && p.max_element() < 12.5 {
                        e.add(offset(&bone, &cut, p, normal).expect("a surface"));
                    }
                }
            }
            println!(
                "{} R {voxels} voxels: {} points, RMS {:.5} h, max {:.5} h",
                isa.name(),
                e.count,
                e.rms() / h,
                e.max / h
            );
            assert!(
                e.count >= 1500 && e.rms() <= 0.013 * h,
                "{voxels} {}",
                e.rms()
            );
        }
    }
}

#[test]
fn balls_of_half_a_voxel_to_three_remove_more_and_more_down_to_a_bounded_error() {
    let h = 0.5;
    let mut random = Random(13);
    for voxels in [0.5, 0.75, 1.0, 1.5, 2.0, 3.0] {
        let radius = h * voxels;
        let tool = tool_of(Revolved::ball(radius as f32));
        let bone = bone_of([24, 24, 24], DVec3::splat(h), 1.0, |p| 8.0 - p.z);
        let (mut worst, mut sum) = (0.0f64, 0.0);
        for _ in 0..20 {
            let start = DVec3::new(5.5, 5.5, 8.0 + radius) + random.vector(h).with_z(0.0);
            let mut cut = Cut::new(&bone);
            let (depth, mut before) = (2.0 * radius + 2.0, 0);
            let pose = |n: u32| {
                Pose::new(
                    glam::DQuat::IDENTITY,
                    start - DVec3::Z * depth * f64::from(n) / 64.0,
                )
            };
            for n in 0..64 {
                let step = osteon_sim_core::carve::CarveStep {
                    tool: 0,
                    before: pose(n),
                    after: pose(n + 1),
                };
                Carving::best().carve(&bone, &mut cut, &tool, &step, &mut |_, _| {});
                let now = cut.totals().units();
                assert!(now >= before, "{voxels} {now} {before}");
                before = now;
            }
            let truth = PI * radius * radius * (2.0 + radius) + 2.0 / 3.0 * PI * radius.powi(3);
            let error = Cut::mm3(bone.grid(), before) / truth - 1.0;
            worst = worst.max(error.abs());
            sum += error / 20.0;
        }
        println!("R {voxels} voxels: volume off by {worst:.3} at worst, {sum:+.3} on the average");
        let most = match voxels {
            v if v < 0.7 => 1.35,
            v if v < 1.2 => 0.8,
            v if v < 1.7 => 0.35,
            _ => 0.2,
        };
        assert!(worst <= most, "{voxels} {worst}");
    }
}
