//! Cutting: cases 20 to 24.

use super::super::bench::Bench;
use super::super::device::FINE;
use super::super::feed::{Faced, Law, all_fed, seated};
use super::super::guided::Guided;
use super::super::hand::Hand;
use super::super::press::meet;
use super::super::setup::{Scene, Slab, Spec, ball, layered};
use super::{Case, Worst};
use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::Request;
use osteon_sim_core::tissue::Tissue;
use osteon_sim_core::tool::Tool;
use rayon::prelude::*;

/// Depth below the face of the plate, and of the cancellous bone, mm.
const PLATE_MM: f64 = 2.0;
const CANCELLOUS_MM: f64 = 3.0;

/// Cartilage of 2 mm, a plate of 1 mm, cancellous bone.
pub(in super::super) fn joint() -> Scene {
    let top = DVec3::new(8.01, 8.02, 18.03);
    let bone = layered(DVec3::new(16.0, 16.0, 20.0), DVec3::splat(0.5), |p| {
        let depth = top.z - p.z;
        let (density, tissue) = if depth < PLATE_MM {
            (0.1, Tissue::Cartilage)
        } else if depth < CANCELLOUS_MM {
            (1.9, Tissue::Subchondral)
        } else {
            (0.45, Tissue::Cancellous)
        };
        (depth, density, tissue)
    });
    Scene {
        bone,
        bone_from_base: Pose::new(DQuat::IDENTITY, top),
        tools: vec![Tool::peg_drill()],
    }
}

/// Case 20.
pub(super) fn layers() -> Case {
    const PUSH_N: f64 = 0.6;
    let mut spec = Spec::at(joint());
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 10.0, true);
    guided.glide(DVec3::ZERO, 20.0);
    guided.push_up_to(PUSH_N, 0.1);
    let (mut backward, mut force, mut fastest) = (0.0f64, f64::MAX, 0.0f64);
    let (mut at, mut omega, mut ticks) = (guided.proxy_mm().z, 0.0f64, 0);
    while guided.proxy_mm().z > -9.0 && ticks < 20_000 {
        guided.push(PUSH_N);
        ticks += 1;
        let now = guided.proxy_mm().z;
        backward = backward.max(now - at);
        force = force.min(guided.coupling_n().z);
        if now < -CANCELLOUS_MM {
            fastest = fastest.max((at - now) / spec.feel.tick_s);
            omega = omega.max(guided.output.spindle_rad_s);
        }
        at = now;
    }
    let law = Law::of(&spec.feel, 0.45);
    let closed = law.feed_mm_s(&Faced::drill(), PUSH_N / spec.feel.force_scale, omega);
    // the same with a hand at the device
    let (held_least_mj, held_force) = held_through(&Spec::at(joint()).with(Hand::GRIP, 1));
    Case {
        id: 20,
        name: "Layers",
        criterion: "the drill at 20 N (physical) through cartilage, plate and cancellous bone: the tool never goes back and the force \
                    never reverses; every tick's work into bone is ≥ 0; after the breakthrough it is no faster than 1.1 × v(F) in \
                    cancellous bone. The same held by a firm grip: force and work"
            .to_owned(),
        measured: format!(
            "back {backward:.1e} mm; least force {force:.3} N; least work {:.1e} mJ; fastest {fastest:.2} mm/s against {closed:.2}; \
             through in {ticks} ms; held: least work {held_least_mj:.1e} mJ, least force {held_force:.3} N",
            guided.least_hand_mj
        ),
        pass: backward <= 1e-4
            && force > 0.0
            && guided.least_hand_mj >= 0.0
            && (fastest / closed - 1.0) <= 0.1
            && fastest > 0.8 * closed
            && held_least_mj >= 0.0
            && held_force > -0.26,
    }
}

/// The least work into bone in a tick, and the least force along the axis, of a grip that pushes the
/// drill through the layers.
fn held_through(spec: &Spec) -> (f64, f64) {
    let mut bench = Bench::new(spec);
    bench.requests.push(Request::Spindle(true));
    bench.run_in();
    meet(&mut bench, 20.0);
    bench.goal = Some((DVec3::Z * -11.0, 3.0));
    let (mut work, mut force) = (0.0f64, f64::MAX);
    for _ in 0..6000 {
        bench.tick();
        if let Some(output) = bench.output {
            work = work.min(output.hand_mj);
            force = force.min(output.force_n.z);
        }
    }
    (work, force)
}

/// Case 21.
pub(super) fn stall() -> Case {
    let mut creep = Worst::default();
    let mut stands = true;
    for faced in Faced::all() {
        for density in [0.45, 1.9] {
            let (mut guided, spec) = seated(&faced, density, true);
            let bites = Law::of(&spec.feel, density).yield_n(&faced) * spec.feel.force_scale;
            // first through the socket's own roughness
            guided.push_up_to(1.5 * bites, 0.1);
            guided.push_for(1.5 * bites, 0.5);
            let push = 0.8 * bites;
            guided.push_for(push, 0.5);
            let (from, before) = (guided.proxy_mm(), guided.removed_mm3());
            let hand = guided.place_mm;
            for _ in 0..2000 {
                guided.tick_at(hand);
            }
            let moved = (guided.proxy_mm() - from).length();
            creep.note(moved / 2.0, || {
                format!("{}, {density} g/cm³", faced.tool.id)
            });
            stands &= guided.removed_mm3() <= before;
        }
    }
    Case {
        id: 21,
        name: "Stall",
        criterion: "three tools engaged all over in cancellous and hard bone, after a push of 150 %, under 80 % of the yield A p₁ρ²: creep ≤ 1e-6 mm/s over 2 s, \
                    nothing removed"
            .to_owned(),
        measured: format!("{}; nothing removed: {stands}", creep.words("mm/s")),
        pass: creep.value <= 1e-6 && stands,
    }
}

/// Case 22.
pub(super) fn feed() -> Case {
    let (mut off, mut hand, mut spindle) = (Worst::default(), Worst::default(), Worst::default());
    let mut least = 0.0f64;
    for (row, ledger) in all_fed() {
        let place = || {
            format!(
                "{}, {} g/cm³, {} N",
                row.tool, row.density, row.push_n_physical
            )
        };
        off.note(100.0 * row.rel.abs(), place);
        hand.note(100.0 * ledger.hand_rel.abs(), place);
        spindle.note(100.0 * ledger.spindle_rel.abs(), place);
        least = least.min(ledger.least_hand_mj);
    }
    Case {
        id: 22,
        name: "Feed and its energy",
        criterion: "drill, reamer and ball engaged all over in bone of 0.45 and 1.9 g/cm³ under 20, 30 and 50 N (physical): feed within 5 % \
                    of v(F) at the spindle's speed under that load; the hand's work is the sum over the elements and the spindle's is \
                    u dV and the edges', each within 5 %; no tick's work of the hand is negative"
            .to_owned(),
        measured: format!(
            "feed {} off; hand {}; spindle {}; least work {least:.1e} mJ",
            off.words("%"),
            hand.words("%"),
            spindle.words("%")
        ),
        pass: off.value <= 5.0 && hand.value <= 5.0 && spindle.value <= 5.0 && least >= 0.0,
    }
}

/// A press of 1 N, 2 s, with a spindle of so many rad/s (`None`: off): where the proxy ends, mm.
fn pressed_at(omega_rad_s: Option<f64>) -> (f64, bool) {
    let mut tool = ball(3.0);
    tool.rpm = omega_rad_s.unwrap_or(100.0) * 60.0 / TAU;
    let slab = Slab {
        extent_mm: DVec3::new(16.0, 16.0, 16.0),
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(vec![tool]));
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 6.0, omega_rad_s.is_some());
    guided.glide(DVec3::Z * -2.0, 20.0);
    let mut sound = true;
    for _ in 0..2000 {
        guided.ask(&[]);
        sound &= guided.proxy_mm().is_finite() && guided.force_n().is_finite();
    }
    (guided.proxy_mm().z, sound)
}

/// Case 23.
pub(super) fn spindle_speeds() -> Case {
    let rigid = pressed_at(None).0;
    let speeds = [0.0, 1e-9, 1e-6, 1e-3];
    let slow = speeds.map(|omega| (omega, pressed_at(Some(omega))));
    let fast = pressed_at(Some(1e4));
    let mut off = Worst::default();
    let mut sound = fast.1;
    for (omega, (z, fine)) in slow {
        off.note((z - rigid).abs(), || format!("{omega:e} rad/s"));
        sound &= fine;
    }
    Case {
        id: 23,
        name: "Speeds of the spindle",
        criterion: "0, 1e-9, 1e-6, 1e-3 and 1e4 rad/s under 1 N for 2 s: all numbers finite; up to 1e-3 rad/s the proxy is where the rigid \
                    tool's is (within 1e-3 mm); at 1e4 it cuts"
            .to_owned(),
        measured: format!(
            "finite: {sound}; rigid {rigid:.5} mm; {} off; at 1e4 rad/s {:.3} mm",
            off.words("mm"),
            fast.0
        ),
        pass: sound && off.value <= 1e-3 && fast.0 < -0.5,
    }
}

/// The largest way back of the proxy in a tick, mm, and the largest change of force, N.
fn burred(density: f64, speed_mm_s: f64) -> (f64, f64) {
    let mut tool = ball(3.0);
    tool.rpm = 60_000.0;
    let slab = Slab {
        extent_mm: DVec3::new(16.0, 16.0, 20.0),
        density,
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(vec![tool]));
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 6.0, true);
    guided.glide(DVec3::Z * 0.05, 20.0);
    let (mut back, mut step) = (0.0f64, 0.0f64);
    let (mut at, mut force) = (guided.proxy_mm().z, guided.coupling_n());
    guided.glide_seen(DVec3::Z * -6.0, speed_mm_s, |g| {
        back = back.max(g.proxy_mm().z - at);
        step = step.max((g.coupling_n() - force).length());
        (at, force) = (g.proxy_mm().z, g.coupling_n());
    });
    (back, step)
}

/// Case 24.
pub(super) fn explicit_limit() -> Case {
    let all: Vec<(f64, f64)> = [0.1, 0.45]
        .into_iter()
        .flat_map(|density| [5.0, 20.0, 100.0].map(|speed| (density, speed)))
        .collect();
    let rows: Vec<_> = all
        .into_par_iter()
        .map(|(density, speed)| (density, speed, burred(density, speed)))
        .collect();
    let (mut back, mut step) = (Worst::default(), Worst::default());
    for (density, speed, (mm, n)) in rows {
        let place = || format!("{density} g/cm³, {speed} mm/s");
        back.note(mm, place);
        step.note(n, place);
    }
    Case {
        id: 24,
        name: "Beyond the explicit limit",
        criterion: "a burr of 3 mm at 60,000 rpm in bone of 0.1 (K dt/c = 1.4, where an explicit step rings) and 0.45 g/cm³ at 5, 20 and 100 mm/s: \
                    the feed is monotone (back ≤ 1e-4 mm, the encoders' step) and the force does not chatter (≤ 0.02 N in a tick)"
            .to_owned(),
        measured: format!("back {}; {}", back.words("mm"), step.words("N")),
        pass: back.value <= 1e-4 && step.value <= 0.02,
    }
}
