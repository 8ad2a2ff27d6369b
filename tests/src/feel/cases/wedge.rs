//! Places that no tool fits: cases 25 and 26.

use super::super::bench::Bench;
use super::super::feed::{Faced, seated};
use super::super::hand::Hand;
use super::super::press;
use super::super::setup::{Scene, Spec, ball, bone_of};
use super::super::tilt::tilted;
use super::super::trace::{peak_force_n, swing_mm};
use super::press::{hold_words, holds};
use super::{Case, Worst};
use glam::{DQuat, DVec3};
use osteon_sim_core::contact::MAX_ITERATIONS;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::proxy::MAX_SUBSTEPS;
use rayon::prelude::*;

/// What a peg tool tilted by `degrees` in its own hole, 8 mm deep, did.
struct Pried {
    iterations: u32,
    residual_n: f64,
    inside_mm: f64,
    force_n: f64,
    finite: bool,
}

fn pried(degrees: f64, about: DVec3) -> Pried {
    let mut faced = Faced::drill();
    faced.depth_mm = 8.0;
    let (mut guided, spec) = seated(&faced, 1.9, false);
    let foot = spec.scene.bone_from_base;
    let (mut inside, mut force, mut finite) = (f64::MIN, 0.0f64, true);
    for n in 1..=600u32 {
        let share = (f64::from(n) / 300.0).min(1.0);
        guided.rotation = DQuat::from_axis_angle(about, (degrees * share).to_radians());
        // and sideways, and down: nowhere to go
        guided.tick_at(DVec3::new(2.0, 1.0, -3.0) * share);
        let pose = foot.inverse().then(&guided.output.bone_from_tool);
        finite &= pose.is_valid() && guided.force_n().is_finite();
        force = force.max(guided.force_n().length());
        for e in &faced.tool.elements {
            let p = pose.point(e.position.as_dvec3());
            let hole = f64::from(faced.tool.shape.signed_distance(p.as_vec3()));
            inside = inside.max(hole.min(faced.depth_mm - p.z));
        }
    }
    Pried {
        iterations: guided.iterations,
        residual_n: guided.residual_n,
        inside_mm: inside,
        force_n: force,
        finite,
    }
}

/// Case 25.
pub(super) fn pegs() -> Case {
    let mut all = Vec::new();
    for degrees in [30.0, -30.0] {
        all.extend([DVec3::X, DVec3::Y, DVec3::new(0.6, 0.8, 0.0)].map(|about| (degrees, about)));
    }
    let rows: Vec<_> = all
        .into_par_iter()
        .map(|(d, about)| (d, about, pried(d, about)))
        .collect();
    let (mut most, mut residual) = (0, Worst::default());
    let (mut inside, mut force) = (Worst::default(), Worst::default());
    let mut finite = true;
    for (degrees, about, row) in rows {
        let place = || format!("{degrees}° about {about}");
        most = most.max(row.iterations);
        residual.note(row.residual_n, place);
        inside.note(row.inside_mm, place);
        force.note(row.force_n, place);
        finite &= row.finite;
    }
    let (tilt_holds, tilt) = tilt();
    let bound = MAX_ITERATIONS * u32::try_from(MAX_SUBSTEPS).unwrap_or(u32::MAX);
    Case {
        id: 25,
        name: "Wedged peg, tilted reamer",
        criterion: format!(
            "the drill turned by ± 30° in its own hole 8 mm deep and pushed aside and down: a solve takes ≤ {MAX_ITERATIONS} iterations (a \
             tick ≤ {bound}), the residual is ≤ 1e-4 N, no element is deeper than 0.5 h, no NaN, ≤ 3.3 N. A reamer engaged in its socket and \
             turned by 10° needs torque: spindle off, 10 mm deep, it turns less than half as far and cuts nothing; spindle on the torque is the law's over the elements within \
             10 % and the volume that of its own way within 5 %"
        ),
        measured: format!(
            "{most} iterations in a tick; residual {}; deepest {}; {}; finite: {finite}; {tilt}",
            residual.words("N"),
            inside.words("mm"),
            force.words("N"),
        ),
        pass: most <= bound
            && residual.value <= 1e-4
            && inside.value <= 0.25
            && finite
            && force.value <= 3.3 + 1e-9
            && tilt_holds,
    }
}

/// Whether the tilted reamer does what it should, and its figures.
fn tilt() -> (bool, String) {
    let (off, on) = rayon::join(|| tilted(false), || tilted(true));
    let law = on.torque_nm / on.law_nm - 1.0;
    let swept = on.removed_mm3 / on.swept_mm3 - 1.0;
    let holds = off.turned_deg <= 5.0
        && off.torque_nm > 1.0
        && off.removed_mm3 <= 0.0
        && on.torque_nm > 0.0
        && law.abs() <= 0.1
        && swept.abs() <= 0.05
        && on.least_hand_mj >= 0.0;
    let words = format!(
        "reamer off: turned {:.3}°, {:.1} N·m, removed {} mm³; on: turned {:.2}°, {:.3} N·m against {:.3} ({:+.1} %), {:.1} mm³ \
         against {:.1} ({:+.1} %)",
        off.turned_deg,
        off.torque_nm,
        off.removed_mm3,
        on.turned_deg,
        on.torque_nm,
        on.law_nm,
        100.0 * law,
        on.removed_mm3,
        on.swept_mm3,
        100.0 * swept
    );
    (holds, words)
}

/// A ball of 4 mm over a slot that is 7 mm wide, or in a groove of 60°; the base's origin is where its
/// lowest point rests.
fn narrow(groove: bool) -> Scene {
    let top = DVec3::new(12.01, 12.02, 14.03);
    let half = 30f64.to_radians();
    let bone = bone_of(DVec3::splat(24.0), DVec3::splat(0.5), 1.9, |p| {
        let p = p - top;
        let walls = if groove {
            // the groove's bottom is 10 mm below the face
            p.x.abs() * half.cos() - (p.z + 10.0) * half.sin()
        } else {
            p.x.abs() - 3.5
        };
        walls.min(-p.z)
    });
    let rest = if groove {
        -10.0 + 4.0 / half.sin() - 4.0
    } else {
        (16.0f64 - 3.5 * 3.5).sqrt() - 4.0
    };
    Scene {
        bone,
        bone_from_base: Pose::new(DQuat::IDENTITY, top + DVec3::Z * rest),
        tools: vec![ball(4.0)],
    }
}

/// Case 26.
pub(super) fn narrow_walls() -> Case {
    let mut all: Vec<(bool, (Hand, usize))> = Vec::new();
    for groove in [false, true] {
        all.extend(holds().into_iter().map(|hold| (groove, hold)));
    }
    let runs: Vec<_> = all
        .into_par_iter()
        .map(|(groove, hold)| {
            let spec = Spec::at(narrow(groove)).with(hold.0, hold.1);
            let bench = press::pressed(&spec, 5.0);
            let last = bench.trace.last(1.0);
            (
                groove,
                hold,
                swing_mm(last),
                peak_force_n(&bench.trace.records),
            )
        })
        .collect();
    let (mut swing, mut force) = (Worst::default(), Worst::default());
    for (groove, hold, mm, n) in runs {
        let name = if groove { "groove" } else { "slot" };
        let place = || format!("{name}, {}", hold_words(hold));
        swing.note(mm, place);
        force.note(n, place);
    }
    // deep in the slot, at the limit
    let mut bench = Bench::new(&Spec::at(narrow(false)));
    bench.run_in();
    bench.glide(DVec3::new(0.5, 0.0, -9.0), 50.0);
    bench.rest(0.5);
    let deep = bench.trace.last(0.3);
    let still = swing_mm(deep);
    let proxy = bench
        .trace
        .records
        .last()
        .map_or(f64::NAN, |r| r.proxy_mm.z);
    Case {
        id: 26,
        name: "Walls that are too narrow",
        criterion: "a ball of 8 mm pressed by 0.9 N onto a slot 7 mm wide and into a groove of 60°, three hands, 0 to 2 ticks of delay: the \
                    place swings ≤ 0.11 mm in the last of 5 s, the force stays ≤ 3.3 N; driven 9 mm deep the proxy stays in the slot's \
                    mouth (within 1 mm) and is still"
            .to_owned(),
        measured: format!(
            "{}; {}; driven: proxy at {proxy:.3} mm, swing {still:.4} mm",
            swing.words("mm"),
            force.words("N")
        ),
        pass: swing.value <= 0.11 && force.value <= 3.33 && proxy.abs() <= 1.0 && still <= 0.11,
    }
}
