//! The whole servo tick on a virtual clock.

#![expect(clippy::print_stdout, reason = "a test that shows its figures")]

mod common;

use common::{Rig, bone_of, slab};
use glam::DVec3;
use osteon_sim_core::chain::Guard;
use osteon_sim_core::servo::Request;
use osteon_sim_core::tool::Tool;

const TOP: f64 = 18.3;

/// A slab of `density` g/cm³ with the rig's workspace centre on its face.
fn rig(density: f64) -> (Rig, DVec3) {
    let bone = slab(
        DVec3::new(46.0, 46.0, 24.0),
        DVec3::splat(0.5),
        TOP,
        density,
    );
    let surface = DVec3::new(23.0, 23.0, TOP);
    (Rig::new(bone, surface), surface)
}

fn warmed(density: f64) -> (Rig, DVec3) {
    let (mut rig, surface) = rig(density);
    rig.rest(surface + DVec3::Z * 10.0, 1100);
    (rig, surface)
}

#[test]
fn a_wall_holds_what_is_pressed_against_it_and_does_not_creep() {
    for tool in 0..2 {
        let (mut rig, surface) = warmed(1.9);
        rig.tick_at(surface + DVec3::Z * 10.0, &[Request::SelectTool(tool)]);
        let out = rig.glide(surface + DVec3::Z * 10.0, surface - DVec3::Z * 2.0, 50.0);
        let settled = rig.rest(surface - DVec3::Z * 2.0, 200);
        assert!(
            (settled.bone_from_tool.translation.z - TOP).abs() < 0.01,
            "{settled:?}"
        );
        assert!(
            (settled.force_n.z - 1.0).abs() < 0.01 && settled.force_n.truncate().length() < 0.01,
            "{}",
            settled.force_n
        );
        let later = rig.rest(surface - DVec3::Z * 2.0, 5000);
        let creep =
            (later.bone_from_tool.translation - settled.bone_from_tool.translation).length();
        assert!(creep < 1e-6, "{creep}");
        assert_eq!(out.carved_len, 0);
        assert_eq!(later.removed_by_class, [0; 8]);
    }
}

#[test]
fn forty_millimetres_of_lag_show_the_limit_and_no_more() {
    let (mut rig, surface) = warmed(1.9);
    rig.glide(surface + DVec3::Z * 10.0, surface - DVec3::Z * 20.0, 400.0);
    let out = rig.rest(surface - DVec3::Z * 20.0, 300);
    assert!((out.force_n.length() - 3.3).abs() < 1e-9, "{}", out.force_n);
    assert!(
        (out.bone_from_tool.translation.z - TOP).abs() < 0.05,
        "{}",
        out.bone_from_tool.translation
    );
    // withdrawn: the proxy comes back with the hand, on the right side
    let out = rig.glide(surface - DVec3::Z * 20.0, surface + DVec3::Z * 5.0, 400.0);
    assert!((out.bone_from_tool.translation.z - TOP - 5.0).abs() < 0.01);
    assert_eq!(out.force_n, DVec3::ZERO);
}

#[test]
fn a_thin_plate_is_not_crossed() {
    // 0.5 mm plate in 0.5 mm voxels
    let bone = bone_of([93, 93, 49], DVec3::splat(0.5), 1.9, |p| {
        0.25 - (p.z - 15.0).abs()
    });
    let surface = DVec3::new(23.0, 23.0, 15.25);
    let mut rig = Rig::new(bone, surface);
    rig.rest(surface + DVec3::Z * 10.0, 1100);
    rig.glide(surface + DVec3::Z * 10.0, surface - DVec3::Z * 10.0, 100.0);
    let out = rig.rest(surface - DVec3::Z * 10.0, 1000);
    assert!(
        out.bone_from_tool.translation.z > 14.9,
        "{}",
        out.bone_from_tool.translation
    );
    assert!((out.force_n.z - 3.3).abs() < 1e-6);
}

/// Force at the stylus, N, of the drill fed at `v` mm/s into bone of density `rho`: the integral of
/// the law over the cone, with `n_z` = sin 59°.
fn drill_force(rho: f64, v: f64) -> f64 {
    let tool = Tool::peg_drill();
    let omega = tool.rpm * std::f64::consts::TAU / 60.0;
    let (r, rm, nz) = (4.0, 0.4, 59f64.to_radians().sin());
    let area = std::f64::consts::PI * r * r;
    let u = 40.0 * rho * rho;
    0.03 * (area * 0.005 * rho * rho
        + u * v / omega * 2.0 * std::f64::consts::PI * nz * (r - rm / 2.0))
}

/// Drills with a constant push of `force` N (the device stays `force`/K behind the proxy); the feed
/// in mm/s over the last second.
fn feed_under(density: f64, force: f64) -> f64 {
    let (mut rig, surface) = warmed(density);
    rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
    let mut out = rig.glide(surface + DVec3::Z * 10.0, surface, 20.0);
    let mut push = |ticks: u32, out: &mut osteon_sim_core::servo::TickOutput| {
        for _ in 0..ticks {
            let device = out.bone_from_tool.translation - DVec3::Z * (force / 0.5);
            let device = DVec3::new(surface.x, surface.y, device.z);
            *out = rig.tick_at(device, &[]);
        }
    };
    push(1500, &mut out);
    let from = out.bone_from_tool.translation.z;
    push(1000, &mut out);
    from - out.bone_from_tool.translation.z
}

#[test]
fn feed_follows_the_closed_form() {
    for (rho, v) in [(0.45, 3.0), (0.45, 1.0), (1.0, 1.5), (1.9, 0.6)] {
        let force = drill_force(rho, v);
        let got = feed_under(rho, force);
        println!("rho {rho}: push {force:.3} N, feed {got:.3} mm/s, closed form {v}");
        assert!((got / v - 1.0).abs() < 0.05, "{got} {v}");
    }
}

#[test]
fn below_yield_it_sticks_exactly() {
    // drill tip fully in bone first, then a push of 80 % of the yield
    let rho = 1.9;
    let (mut rig, surface) = warmed(rho);
    rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
    rig.glide(surface + DVec3::Z * 10.0, surface, 20.0);
    let mut out = rig.rest(surface - DVec3::Z * 5.0, 6000);
    assert!(
        out.bone_from_tool.translation.z < TOP - 2.5,
        "{}",
        out.bone_from_tool.translation
    );
    let push = 0.8 * drill_force(rho, 0.0) / 0.5;
    let hold = out.bone_from_tool.translation - DVec3::Z * push;
    let hold = DVec3::new(surface.x, surface.y, hold.z);
    rig.rest(hold, 50);
    let from = rig.rest(hold, 1);
    let mut carved = 0;
    for _ in 0..5000 {
        out = rig.tick_at(hold, &[]);
        carved += out.carved_len;
    }
    assert_eq!(carved, 0);
    assert_eq!(out.bone_from_tool, from.bone_from_tool);
    assert!(out.force_n.z > 0.0);
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let run = || {
        let (mut rig, surface) = warmed(0.6);
        rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
        rig.glide(surface + DVec3::Z * 10.0, surface - DVec3::Z * 6.0, 10.0);
        let out = rig.glide(
            surface - DVec3::Z * 6.0,
            surface + DVec3::new(0.5, 0.3, -8.0),
            5.0,
        );
        (out, rig.servo.cut().digest(rig.servo.bone()))
    };
    let (a, b) = (run(), run());
    assert_eq!(a, b);
    assert!(a.1.changed_chunks > 0);
}

#[test]
fn a_broken_encoder_neither_cuts_nor_kicks() {
    let (mut rig, surface) = warmed(0.6);
    rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
    let before = rig.glide(surface + DVec3::Z * 10.0, surface - DVec3::Z * 2.0, 5.0);
    let here = surface - DVec3::Z * 2.0;
    for jump in [10.0, 40.0] {
        let out = rig.tick_at(here + DVec3::new(0.0, jump, 0.0), &[]);
        assert!(!out.fresh && out.carved_len == 0);
        assert!((out.force_n - before.force_n).length() < 0.1);
        rig.rest(here, 3);
    }
    assert_eq!(rig.servo.guards().of(Guard::Implausible), 2);
}

#[test]
fn a_tool_that_appears_in_bone_pushes_only_after_it_was_free() {
    let (mut rig, surface) = warmed(0.6);
    rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
    let deep = surface - DVec3::Z * 5.0;
    rig.glide(surface + DVec3::Z * 10.0, deep, 4.0);
    let reset = rig.tick_at(deep, &[Request::Reset]);
    assert!(reset.embedded && reset.epoch == 1);
    let out = rig.rest(deep, 500);
    assert_eq!(
        (out.force_n, out.carved_len, out.removed_by_class),
        (DVec3::ZERO, 0, [0; 8])
    );
    let free = rig.glide(deep, surface + DVec3::Z * 10.0, 50.0);
    assert!(!free.embedded);
    let again = rig.glide(surface + DVec3::Z * 10.0, deep, 4.0);
    assert!(again.removed_by_class[3] > 0);
}

#[test]
fn a_device_that_falls_silent_gets_no_torque_after_twenty_ticks() {
    let (mut rig, surface) = warmed(1.9);
    let pressed = rig.glide(surface + DVec3::Z * 10.0, surface - DVec3::Z * 2.0, 50.0);
    assert!(pressed.torque != [0; 3]);
    let mut last = pressed;
    for missing in 1..=25 {
        last = rig.servo.tick(None, &[]);
        if missing <= 5 {
            assert_eq!(last.force_n, pressed.force_n);
        }
    }
    assert_eq!(last.torque, [0; 3]);
}

#[test]
fn a_gap_in_mid_cut_costs_the_force_for_a_moment_and_no_more() {
    // the hand is more than a millimetre deeper than the tool that it presses: that is no embedded tool
    let (mut rig, surface) = warmed(1.9);
    rig.tick_at(surface + DVec3::Z * 10.0, &[Request::Spindle(true)]);
    rig.glide(surface + DVec3::Z * 10.0, surface, 20.0);
    let hand = surface - DVec3::Z * 4.0;
    let before = rig.rest(hand, 700);
    assert!(
        before.force_n.z > 0.5 && before.carved_len > 0,
        "{}",
        before.force_n
    );
    for _ in 0..25 {
        rig.time_micros = rig.time_micros.wrapping_add(1000);
        rig.servo.tick(None, &[]);
    }
    let first = rig.tick_at(hand, &[]);
    assert!(
        !first.embedded && first.force_n.length() < 0.1,
        "{}",
        first.force_n
    );
    let moved = first.bone_from_tool.translation - before.bone_from_tool.translation;
    assert!(moved.length() < 0.01, "{moved}");
    let after = rig.rest(hand, 60);
    assert!(
        after.force_n.z > 0.5 * before.force_n.z,
        "{}",
        after.force_n
    );
    let later = rig.rest(hand, 1000);
    assert!(later.removed_by_class[3] > after.removed_by_class[3]);
    // a hand that is elsewhere after the gap begins anew
    for _ in 0..25 {
        rig.time_micros = rig.time_micros.wrapping_add(1000);
        rig.servo.tick(None, &[]);
    }
    let elsewhere = rig.tick_at(hand - DVec3::Z * 12.0, &[]);
    assert!(elsewhere.embedded && elsewhere.carved_len == 0);
}

#[test]
fn tools_that_do_not_exist_are_ignored() {
    let (mut rig, surface) = warmed(1.9);
    let out = rig.tick_at(surface + DVec3::Z * 10.0, &[Request::SelectTool(200)]);
    assert_eq!(out.tool, 0);
}
