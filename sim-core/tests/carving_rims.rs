//! Edges: a tool's convex rim takes no bone outside the tool; what two crossing cuts blunt.

#![expect(clippy::print_stdout, reason = "a test that shows its figures")]

mod common;

use common::bone_of;
use common::random::{Random, grown_distance};
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::fields;
use osteon_sim_core::tool::{Shape, Tool};
use std::sync::Arc;

const H: f64 = 0.47;

fn block(edge: f64) -> Arc<Bone> {
    let count = (1..200u16).find(|&n| f64::from(n) * H >= edge);
    let count = usize::from(count.unwrap_or(200));
    bone_of([count; 3], DVec3::splat(H), 1.0, |_| 9.0)
}

fn stamp(bone: &Bone, cut: &mut Cut, tool: &Tool, pose: Pose) {
    let step = CarveStep {
        tool: 0,
        before: pose,
        after: pose,
    };
    carve(bone, cut, tool, &step, &mut |_, _| {});
}

/// Growth of the most grown face, mm.
fn most_grown(tool: &Tool, bone: &Bone) -> f64 {
    let Shape::Revolved(solid) = &tool.shape else {
        return 0.0;
    };
    let faces = solid.parts.iter().flat_map(|p| &p.faces);
    let square = bone.grid().mean_square_spacing();
    faces.fold(0.0, |m, f| f.form.grown_mm(square).max(m))
}

/// A point near the circle of radius `r` at height `z` about the axis, within `room` mm.
fn near_rim(random: &mut Random, (r, z): (f64, f64), room: f64) -> DVec3 {
    let turn = random.within(0.0, std::f64::consts::TAU);
    let r = r + random.within(-room, room);
    DVec3::new(
        r * turn.cos(),
        r * turn.sin(),
        z + random.within(-room, room),
    )
}

#[test]
fn a_convex_rim_takes_no_bone_outside_the_tool() {
    let mut random = Random(31);
    let bone = block(26.0);
    let middle = DVec3::splat(13.0);
    let quantum = f64::from(bone.grid().quantum_mm());
    for (tool, rim) in [
        (Tool::glenoid_reamer(), (18.0, 6.0)),
        (Tool::peg_drill(), (4.0, 2.403)),
    ] {
        let grown = most_grown(&tool, &bone);
        let (mut worst, mut left) = (0.0f64, 0.0f64);
        for _ in 0..8 {
            let rotation = random.rotation();
            let on_rim = near_rim(&mut random, rim, 0.0);
            let pose = Pose::new(rotation, middle - rotation * on_rim);
            let mut cut = Cut::new(&bone);
            stamp(&bone, &mut cut, &tool, pose);
            for _ in 0..6000 {
                let p = near_rim(&mut random, rim, 1.5 * H);
                let at = pose.point(p);
                if at.min_element() < 1.0 || at.max_element() > 25.0 {
                    continue;
                }
                let outside = grown_distance(&tool.shape, 0.0, p);
                let read = f64::from(fields(&bone, &cut, at).cut);
                if read < 0.0 {
                    worst = worst.max(outside);
                } else {
                    left = left.max(-outside);
                }
            }
        }
        println!(
            "{}: bone lost to {:.2} um outside (growth {:.2} um); left {:.3} h inside",
            tool.id,
            1e3 * worst,
            1e3 * grown,
            left / H
        );
        assert!(worst <= grown + quantum, "{} {worst}", tool.id);
        assert!(left <= 0.6 * H, "{} {left}", tool.id);
    }
}

#[test]
fn where_two_cuts_cross_the_edge_moves_by_less_than_four_tenths_of_a_voxel() {
    let mut random = Random(32);
    let bone = block(26.0);
    let middle = DVec3::splat(13.0);
    let (reamer, drill) = (Tool::glenoid_reamer(), Tool::peg_drill());
    let (mut lost, mut left) = (0.0f64, 0.0f64);
    for _ in 0..8 {
        // a dome whose apex lies a little below the middle, a hole along its axis
        let rotation: DQuat = random.rotation();
        let ream = Pose::new(rotation, middle + random.vector(0.5 * H));
        let hole = Pose::new(rotation, ream.translation - rotation * (DVec3::Z * 8.0));
        let mut cut = Cut::new(&bone);
        stamp(&bone, &mut cut, &reamer, ream);
        stamp(&bone, &mut cut, &drill, hole);
        let rim = (4.0, 30.0 - (900.0f64 - 16.0).sqrt());
        for _ in 0..8000 {
            let p = near_rim(&mut random, rim, 1.2 * H);
            let q = p + DVec3::Z * 8.0;
            let outside =
                grown_distance(&reamer.shape, 0.0, p).min(grown_distance(&drill.shape, 0.0, q));
            let read = f64::from(fields(&bone, &cut, ream.point(p)).cut);
            if read < 0.0 {
                lost = lost.max(outside);
            } else {
                left = left.max(-outside);
            }
        }
    }
    println!(
        "peg hole's rim after reaming: bone lost to {:.3} h outside, left to {:.3} h inside",
        lost / H,
        left / H
    );
    assert!(lost <= 0.4 * H, "{lost}");
    assert!(left <= 0.4 * H, "{left}");
}
