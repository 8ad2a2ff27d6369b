//! The clinic on the built-in phantom, end to end.
#![expect(clippy::print_stderr, reason = "measured figures are told")]

use super::components;
use super::plan::{Place, PlanArgs, plan, propose};
use super::plan_file::LandmarkData;
use super::score::{Bands, Judged, Verdict};
use super::session::{play, stroke};
use super::target::Target;
use crate::scene::{SceneArgs, load, phantom};
use glam::{DQuat, DVec3};
use osteon_sim_core::feel::Feel;
use osteon_sim_core::planning::perform::perform;
use osteon_sim_core::planning::scapula::Scapula;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::path::{Path, PathBuf};

/// The phantom's own landmarks in LPS.
fn landmarks(scene: &crate::scene::Scene) -> LandmarkData {
    let bone_from_phantom = Pose::new(DQuat::IDENTITY, -phantom::BOX.0);
    let lps = |p: DVec3| {
        let p = scene.bone.lps_from_bone().point(bone_from_phantom.point(p));
        p.to_array()
    };
    LandmarkData {
        glenoid_centre: lps(DVec3::ZERO),
        trigonum_spinae: lps(phantom::TRIGONUM_SPINAE),
        inferior_angle: lps(phantom::INFERIOR_ANGLE),
    }
}

fn args(marks: LandmarkData) -> PlanArgs {
    PlanArgs {
        scene: PathBuf::from("normal"),
        glenoid_centre: Place(marks.glenoid_centre),
        trigonum_spinae: Place(marks.trigonum_spinae),
        inferior_angle: Place(marks.inferior_angle),
        component: "peg_m".to_owned(),
        components: None,
        version: None,
        inclination: None,
        depth: None,
        roll: 0.0,
        wall: 0.0,
        out: None,
    }
}

/// The phantom with a plan whose depth is 2.5 mm.
fn target(voxel_mm: f64) -> Target {
    let scene = load(
        &SceneArgs {
            voxel_mm: Some(voxel_mm),
            ..SceneArgs::default()
        },
        &mut |_, _| {},
    )
    .expect("the phantom");
    let marks = landmarks(&scene);
    let scapula = Scapula::of(&marks.landmarks()).expect("a frame");
    let component = &components::load(None).expect("components")[0];
    let asked = PlanArgs {
        depth: Some(2.5),
        ..args(marks)
    };
    let plan = propose(&asked, &scene, (&scapula, marks), component).expect("a plan");
    Target::of(scene, plan).expect("a target")
}

fn value(all: &[osteon_sim_core::metrics::Metric], name: &str) -> f64 {
    let metric = all.iter().find(|m| m.name == name).expect("a metric");
    metric.value.unwrap_or(f64::NAN)
}

#[test]
fn the_proposal_is_the_phantoms_own_face() {
    let target = target(0.8);
    // the phantom's face looks along its z; its sphere is 34 mm, its rim rounded within a millimetre
    assert!(
        (target.plan.face_radius_mm - 34.0).abs() < 1.5,
        "{}",
        target.plan.face_radius_mm
    );
    assert!(target.plan.face_rms_mm < 0.2, "{}", target.plan.face_rms_mm);
    let axis = target.scene.bone_from_plan.rotation.conjugate();
    let outward = target
        .scene
        .bone
        .lps_from_bone()
        .inverse()
        .vector(DVec3::from_array(target.plan.glenoid_normal_outward));
    let off = (axis * outward)
        .dot(DVec3::Z)
        .clamp(-1.0, 1.0)
        .acos()
        .to_degrees();
    // the pear's middle lies off the axis, and a cap's plane leans with it
    assert!(off < 2.0, "{off}° off the face's axis");
    // Friedman's axis to the phantom's trigonum: by hand from the two points
    let by_hand = DVec3::ZERO - phantom::TRIGONUM_SPINAE;
    let version = -(by_hand.x / by_hand.z).atan().to_degrees();
    assert!(
        (target.plan.native_deg[0] - version).abs() < 2.0,
        "{} {version}",
        target.plan.native_deg[0]
    );
}

#[test]
fn planted_reamings_of_the_phantom_are_reported() {
    let target = target(0.8);
    let cases = [
        (0.0, 0.0, 0.0),
        (5.0, 0.0, 0.0),
        (10.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, -1.0, 0.0),
        (0.0, 0.0, 2.0),
    ];
    for (version_deg, deeper_mm, aside_mm) in cases {
        let wrong = Pose::new(
            DQuat::from_rotation_y(f64::to_radians(version_deg)),
            DVec3::new(aside_mm, 0.0, -deeper_mm),
        );
        let cut = perform(
            &target.scene.bone,
            &target.component,
            &target.bone_from_component.then(&wrong),
        );
        let all = target.judge(&cut, None);
        let got = [
            value(&all, "version_error"),
            value(&all, "depth_error"),
            value(&all, "centre_ap"),
            value(&all, "centre_si"),
        ];
        eprintln!("planted {version_deg}°, {deeper_mm} mm, {aside_mm} mm: {got:.3?}");
        assert!((got[0] - version_deg).abs() < 0.3, "{got:?}");
        assert!((got[1] - deeper_mm).abs() < 0.05, "{got:?}");
        assert!(
            (got[2] - aside_mm).abs() < 0.1 && got[3].abs() < 0.1,
            "{got:?}"
        );
        assert!(value(&all, "inclination_error").abs() < 0.3);
        if version_deg == 0.0 && deeper_mm == 0.0 && aside_mm == 0.0 {
            assert!(value(&all, "removed_beyond_plan").abs() < 1e-9);
            assert!(value(&all, "seating") > 95.0);
        }
    }
}

#[test]
fn each_scenario_is_played_and_judged_the_same_twice() {
    let bands = Bands::load(None).expect("bands");
    let judged = |name: &str| {
        let target = Target::load(Path::new(name), &mut |_, _| {}).expect(name);
        let hand = stroke(&target, &Pose::IDENTITY);
        let played = play(&target, &Tool::standard_set(), &Feel::default(), hand).expect(name);
        let page = super::report::html(
            &target,
            &played,
            &Judged::of(&target, &played, &bands, name),
        );
        assert!(
            page.contains("not validated") && !page.contains("NaN"),
            "{name}"
        );
        Judged::of(&target, &played, &bands, name)
    };
    let mut forces = Vec::new();
    for name in ["normal", "eroded", "soft"] {
        let one = judged(name);
        let number = |metric: &str| one.value(metric).unwrap_or(f64::NAN);
        eprintln!(
            "{name}: version error {:.2}°, depth error {:.2} mm, centre {:.2} mm, seating {:.1} %, peak {:.1} N",
            number("version_error"),
            number("depth_error"),
            number("centre_error"),
            number("seating"),
            number("force_peak")
        );
        // a hand on a spring of 1 N/mm against bone: a millimetre or so short
        assert!(number("version_error").abs() < 5.0, "{name}");
        assert!(number("centre_error") < 2.5, "{name}");
        assert!(number("removed_cancellous") > 100.0, "{name}");
        assert!(number("perforation") < 1.0, "{name}");
        assert!(one.metrics.iter().any(|m| m.verdict == Some(Verdict::Good)));
        forces.push(number("impulse"));
        if name == "normal" {
            assert_eq!(
                one.json().expect("text"),
                judged(name).json().expect("text")
            );
        }
    }
    assert!(forces[2] < forces[0], "soft bone takes less: {forces:?}");
}

#[test]
fn what_cannot_be_planned_is_refused_in_one_line() {
    let scene = load(
        &SceneArgs {
            voxel_mm: Some(1.2),
            ..SceneArgs::default()
        },
        &mut |_, _| {},
    )
    .expect("the phantom");
    let marks = landmarks(&scene);
    let line = LandmarkData {
        inferior_angle: std::array::from_fn(|n| {
            0.4 * marks.glenoid_centre[n] + 0.6 * marks.trigonum_spinae[n]
        }),
        ..marks
    };
    let far = LandmarkData {
        glenoid_centre: std::array::from_fn(|n| marks.glenoid_centre[n] + [0.0, 0.0, 40.0][n]),
        ..marks
    };
    let with = |change: fn(&mut PlanArgs)| {
        let mut a = args(marks);
        change(&mut a);
        a
    };
    let cases = [
        (args(line), "collinear"),
        (args(far), "outside the bone"),
        (
            with(|a| a.component = "none".to_owned()),
            "peg_m, peg_s, pegs3_m",
        ),
        (with(|a| a.version = Some(80.0)), "--version 80"),
        (with(|a| a.version = Some(35.0)), "does not fit"),
        (with(|a| a.depth = Some(-1.0)), "--depth -1"),
        (
            with(|a| a.scene = PathBuf::from("/nowhere")),
            "osteon import",
        ),
    ];
    for (asked, expected) in cases {
        let error = plan(&asked, &mut |_, _| {})
            .expect_err(expected)
            .to_string();
        assert!(
            error.contains(expected) && !error.contains('\n'),
            "{expected}: {error}"
        );
    }
}

/// Numbers of a plan that the fit to the joint face decides: how far they may be off, by field.
fn slack(field: &str) -> f64 {
    match field {
        "native_deg" => 3.0,
        "face_radius_mm" => 5.0,
        "face_rms_mm" => 0.3,
        "face_points" => 400.0,
        "glenoid_centre" => 0.1,
        _ => 1e-6,
    }
}

fn alike(field: &str, a: &serde_json::Value, b: &serde_json::Value) {
    use serde_json::Value;
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            assert_eq!(a.len(), b.len(), "{field}");
            for (key, value) in a {
                alike(key, value, &b[key]);
            }
        }
        (Value::Array(a), Value::Array(b)) => {
            assert_eq!(a.len(), b.len(), "{field}");
            for (a, b) in a.iter().zip(b) {
                alike(field, a, b);
            }
        }
        (Value::Number(_), Value::Number(_)) => {
            let (a, b) = (a.as_f64().expect("a number"), b.as_f64().expect("a number"));
            assert!((a - b).abs() <= slack(field), "{field}: {a} {b}");
        }
        _ => assert_eq!(a, b, "{field}"),
    }
}

/// The scenarios' plans are what `osteon plan` makes of them; with `OSTEON_WRITE_PLANS` set they are written.
#[test]
fn the_shipped_plans_are_those_that_are_made() {
    let phantom = load(
        &SceneArgs {
            voxel_mm: Some(1.6),
            ..SceneArgs::default()
        },
        &mut |_, _| {},
    )
    .expect("the phantom");
    let marks = landmarks(&phantom);
    for (name, version, depth) in [
        ("normal", -2.0, 2.5),
        ("eroded", -8.0, 3.0),
        ("soft", -2.0, 2.5),
    ] {
        let asked = PlanArgs {
            scene: PathBuf::from(name),
            version: Some(version),
            inclination: Some(6.0),
            depth: Some(depth),
            ..args(marks)
        };
        let text = plan(&asked, &mut |_, _| {})
            .expect(name)
            .text()
            .expect("text");
        let file = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("scenarios")
            .join(name)
            .join("plan.json");
        if std::env::var_os("OSTEON_WRITE_PLANS").is_some() {
            std::fs::write(&file, &text).expect("written");
        }
        let shipped = std::fs::read_to_string(&file).expect("a plan");
        let json = |text: &str| serde_json::from_str(text).expect("JSON");
        alike("plan", &json(&shipped), &json(&text));
    }
}
