//! Beginnings and ends: cases 11 to 13.

use super::super::device::FINE;
use super::super::feed::{Faced, seated};
use super::super::guided::Guided;
use super::super::setup::{Slab, Spec, ball};
use super::{Case, Worst};
use core::f64::consts::PI;
use glam::DVec3;
use osteon_sim_core::servo::Request;
use osteon_sim_core::tool::Tool;

/// A servo over soft bone.
fn over(density: f64, tools: Vec<Tool>, spindle: bool) -> Guided {
    let slab = Slab {
        extent_mm: DVec3::new(24.0, 24.0, 28.0),
        density,
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(tools));
    spec.scale = FINE;
    Guided::new(&spec, DVec3::Z * 8.0, spindle)
}

/// Largest rise of the force in a tick while `run` runs, N.
fn largest_rise(guided: &mut Guided, to_mm: DVec3, speed_mm_s: f64) -> f64 {
    let (mut last, mut rise) = (guided.force_n().length(), 0.0f64);
    guided.glide_seen(to_mm, speed_mm_s, |g| {
        let now = g.force_n().length();
        rise = rise.max(now - last);
        last = now;
    });
    rise
}

/// A way to appear in bone; it leaves the device deep inside, just now.
type Appearance = (&'static str, fn() -> Guided);
const APPEARANCES: [Appearance; 3] = [
    ("reset in the hole", || {
        let mut guided = over(0.3, vec![ball(3.0)], true);
        guided.glide(DVec3::ZERO, 20.0);
        guided.push_up_to(0.3, 0.1);
        while guided.proxy_mm().z > -4.0 {
            guided.push(0.3);
        }
        let here = guided.proxy_mm();
        guided.glide(here, 20.0);
        guided.ask(&[Request::Reset]);
        guided
    }),
    ("another tool", || {
        let mut tools = Tool::standard_set();
        tools.insert(0, ball(1.0));
        let mut guided = over(0.3, tools, true);
        guided.glide(DVec3::ZERO, 20.0);
        guided.push_up_to(0.1, 0.1);
        while guided.proxy_mm().z > -4.0 {
            guided.push(0.1);
        }
        let here = guided.proxy_mm();
        guided.glide(here, 20.0);
        guided.ask(&[Request::SelectTool(2)]);
        guided
    }),
    ("a pause that ends in bone", || {
        let mut guided = over(0.3, vec![ball(3.0)], true);
        guided.ask(&[Request::Pause(true)]);
        guided.glide(DVec3::Z * -5.0, 50.0);
        guided.ask(&[Request::Pause(false)]);
        guided
    }),
];

/// Case 11.
pub(super) fn appears_inside() -> Case {
    let (mut inside, mut rise) = (Worst::default(), Worst::default());
    let (mut flagged, mut removed) = (true, Worst::default());
    for (name, appear) in APPEARANCES {
        let mut guided = appear();
        flagged &= guided.output.embedded;
        let before = guided.removed_mm3();
        let mut most = 0.0f64;
        guided.rest(0.3);
        // free after some mm: until then no force and no cut
        guided.glide_seen(DVec3::Z * 6.0, 20.0, |g| {
            if g.output.embedded {
                most = most.max(g.force_n().length());
            }
        });
        inside.note(most, || name.to_owned());
        removed.note(guided.removed_mm3() - before, || name.to_owned());
        guided.ask(&[Request::Spindle(false)]);
        rise.note(largest_rise(&mut guided, DVec3::Z * -2.0, 20.0), || {
            name.to_owned()
        });
    }
    // the clutch, held and let go at a press of 1 N and at the limit
    for deep in [2.0, 8.0] {
        let mut guided = over(1.9, vec![ball(3.0)], false);
        guided.glide(DVec3::Z * -deep, 50.0);
        guided.ask(&[Request::Clutch(true)]);
        guided.glide(DVec3::new(3.0, 2.0, 4.0 - deep), 50.0);
        guided.ask(&[Request::Clutch(false)]);
        let here = guided.place_mm;
        let up = largest_rise(&mut guided, here + DVec3::Z * 1e-3, 0.01);
        rise.note(up, || format!("clutch, {deep} mm deep"));
    }
    Case {
        id: 11,
        name: "Begins inside bone",
        criterion: "a reset in the hole, a larger tool, the end of a pause: \"embedded\" is flagged, no force and no cut until the \
                    tool is free; then, and when the clutch is let go at 1 N and at 3.3 N, the force rises ≤ 0.05 N in a tick \
                    (at 20 mm/s the coupling itself rises by 0.01 N and the damping by 0.02 N)"
            .to_owned(),
        measured: format!(
            "flagged: {flagged}; embedded {}, cut {}; rise {}",
            inside.words("N"),
            removed.words("mm³"),
            rise.words("N")
        ),
        pass: flagged && inside.value <= 0.0 && removed.value <= 0.0 && rise.value <= 0.05,
    }
}

/// Case 12.
pub(super) fn spindle_on_at_rest() -> Case {
    let mut guided = over(0.6, vec![ball(3.0)], false);
    guided.glide(DVec3::Z * -1.5, 20.0);
    guided.rest(0.3);
    guided.ask(&[Request::Spindle(true)]);
    let (mut last, mut step) = (guided.force_n(), 0.0f64);
    for _ in 0..3000 {
        guided.ask(&[]);
        step = step.max((guided.force_n() - last).length());
        last = guided.force_n();
    }
    let depth = -guided.proxy_mm().z;
    let removed = guided.removed_mm3();
    let exact = PI * depth * depth * (3.0 - depth / 3.0);
    // truly embedded: nothing is cut
    let mut inside = APPEARANCES[0].1();
    inside.ask(&[Request::Spindle(false)]);
    let before = inside.removed_mm3();
    inside.ask(&[Request::Spindle(true)]);
    inside.rest(1.0);
    let cut_inside = inside.removed_mm3() - before;
    Case {
        id: 12,
        name: "Spindle on at rest",
        criterion: "a ball pressed 1.5 mm deep, spindle switched on: the force changes ≤ 0.2 N in a tick; removed is the overlap of the \
                    tool where the bone holds it, ± 1 %. A tool that is embedded at rest is free of force and cuts nothing until it \
                    has been out, so that there the volume is 0"
            .to_owned(),
        measured: format!(
            "largest step {step:.4} N; {removed:.3} mm³ against {exact:.3} at {depth:.3} mm ({:+.2} %); embedded: {cut_inside} mm³",
            100.0 * (removed / exact - 1.0)
        ),
        pass: step <= 0.2 && (removed / exact - 1.0).abs() <= 0.01 && depth > 0.5 && cut_inside <= 0.0,
    }
}

/// Case 13.
pub(super) fn spindle_off_in_mid_cut() -> Case {
    let mut worst = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for faced in Faced::all() {
        let (mut guided, spec) = seated(&faced, 0.45, true);
        let push = 40.0 * spec.feel.force_scale;
        guided.push_up_to(push, 0.1);
        guided.push_for(push, 0.05);
        let before = guided.removed_mm3();
        let hand = guided.place_mm;
        guided.ask(&[Request::Spindle(false)]);
        let (first, after_first) = (guided.proxy_mm(), guided.removed_mm3());
        guided.rest(0.2);
        let still = (guided.proxy_mm() - first).length();
        // the hand pushes on
        guided.glide(hand - DVec3::Z, 20.0);
        guided.rest(0.2);
        let pushed = (guided.proxy_mm() - first).length();
        worst.0 = worst.0.max(still);
        worst.1 = worst.1.max(pushed);
        worst.2 = worst.2.max(after_first - before);
        worst.3 = worst.3.max(guided.removed_mm3() - after_first);
    }
    let (still, pushed, tick, after) = worst;
    Case {
        id: 13,
        name: "Spindle off in mid-cut",
        criterion: "three tools cutting at 40 N (physical): switched off, the proxy stops within a tick (then, also if the hand pushes 1 mm deeper, it only closes the gap \
                    by which a cut lies ahead of a curved face: 2 h²/6R = 0.028 mm at the ball) and nothing more is removed"
            .to_owned(),
        measured: format!(
            "moved {still:.1e} mm, pushed on {pushed:.5} mm; removed in the tick {tick} mm³, after it {after} mm³"
        ),
        pass: still <= 0.028 && pushed <= 0.028 && tick <= 0.0 && after <= 0.0,
    }
}
