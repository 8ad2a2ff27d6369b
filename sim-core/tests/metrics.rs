//! Planted reamings of an analytic glenoid: the metrics report what was planted, however the bone lies in its
//! lattice.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "small planted numbers; what goes wrong here is a failed test"
)]

use glam::{DQuat, DVec3};
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::metrics::Metric;
use osteon_sim_core::metrics::result::{Case, metrics};
use osteon_sim_core::planning::component::{Component, Peg};
use osteon_sim_core::planning::face;
use osteon_sim_core::planning::perform::perform;
use osteon_sim_core::planning::scapula::{Landmarks, Scapula};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::solid::signed_distance;
use osteon_sim_core::tissue::Tissue;

/// Depth of the planned back under the middle of the face, mm.
const DEPTH_MM: f64 = 3.0;
const FACE_RADIUS_MM: f64 = 34.0;

/// A lattice: spacing, and how the glenoid lies in it.
struct Lattice {
    spacing: DVec3,
    turn: DQuat,
    shift: DVec3,
}

fn lattices() -> Vec<(&'static str, Lattice)> {
    let turn = |x, y, z, deg: f64| {
        let axis = DVec3::new(x, y, z).try_normalize().expect("an axis");
        DQuat::from_axis_angle(axis, deg.to_radians())
    };
    let lattice = |h: [f64; 3], turn, shift| Lattice {
        spacing: DVec3::from_array(h),
        turn,
        shift,
    };
    vec![
        ("0.8 mm", lattice([0.8; 3], DQuat::IDENTITY, DVec3::ZERO)),
        ("0.5 mm", lattice([0.5; 3], DQuat::IDENTITY, DVec3::ZERO)),
        (
            "turned by 37°",
            lattice([0.8; 3], turn(1.0, -2.0, 0.5, 37.0), DVec3::ZERO),
        ),
        (
            "shifted",
            lattice([0.8; 3], DQuat::IDENTITY, DVec3::new(0.31, -0.17, 0.43)),
        ),
        (
            "as a CT",
            lattice(
                [0.78, 0.78, 1.0],
                turn(0.3, 1.0, 0.2, 71.0),
                DVec3::new(0.2, 0.3, 0.1),
            ),
        ),
    ]
}

/// A column of 17 mm radius under a hollow face; plan's axis z, face's middle at z = 0. With its frame.
fn glenoid(lattice: &Lattice) -> (Bone, Pose) {
    let half = 30.0;
    let dims = (DVec3::splat(2.0 * half) / lattice.spacing)
        .ceil()
        .to_array();
    let grid = Grid::new(dims.map(|n| n as usize), lattice.spacing).expect("a grid");
    // the glenoid's middle lies in the lattice's
    let bone_from_glenoid = Pose::new(lattice.turn, DVec3::splat(half) + lattice.shift);
    let glenoid_from_bone = bone_from_glenoid.inverse();
    let at = |n: usize| {
        let [nx, ny, _] = grid.dims;
        // centred on the middle of the column
        glenoid_from_bone.point(grid.centre(n % nx, n / nx % ny, n / (nx * ny))) - DVec3::Z * 10.0
    };
    let under_face = |p: DVec3| p.distance(DVec3::Z * FACE_RADIUS_MM) - FACE_RADIUS_MM;
    let phi: Vec<f32> = (0..grid.len())
        .map(|n| {
            let p = at(n);
            let column = 17.0 - p.truncate().length();
            column.min(under_face(p)).min(p.z + 32.0) as f32
        })
        .collect();
    let class: Vec<u8> = (0..grid.len())
        .map(|n| match under_face(at(n)) {
            d if d < 1.8 => Tissue::Cartilage as u8,
            d if d < 3.8 => Tissue::Subchondral as u8,
            _ => Tissue::Cancellous as u8,
        })
        .collect();
    let solid = signed_distance(&grid, &phi).expect("distances");
    let dense = DenseBone {
        density_hu: &vec![300; grid.len()],
        solid_mm: &solid,
        class: &class,
        label: &vec![1; grid.len()],
    };
    let bone = Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone");
    let middle = Pose::new(DQuat::IDENTITY, DVec3::Z * 10.0);
    (bone, bone_from_glenoid.then(&middle))
}

fn component() -> Component {
    let peg = |x, y, diameter_mm, length_mm| Peg {
        at_mm: [x, y],
        diameter_mm,
        length_mm,
    };
    Component {
        name: "Planted".to_owned(),
        id: "planted".to_owned(),
        backside_radius_mm: 30.0,
        width_mm: 24.0,
        height_mm: 30.0,
        thickness_mm: 4.0,
        reamer_mm: 36.0,
        pegs: vec![peg(0.0, 0.0, 8.0, 18.0), peg(0.0, 10.0, 5.0, 12.0)],
    }
}

/// What a hand did wrong.
#[derive(Debug, Clone, Copy, Default)]
struct Wrong {
    version_deg: f64,
    inclination_deg: f64,
    roll_deg: f64,
    deeper_mm: f64,
    anterior_mm: f64,
}

/// The component's frame where the hand put it: turned about the middle of the planned back.
fn put(wrong: Wrong) -> Pose {
    let turn = DQuat::from_rotation_y(wrong.version_deg.to_radians())
        * DQuat::from_rotation_x(-wrong.inclination_deg.to_radians())
        * DQuat::from_rotation_z(wrong.roll_deg.to_radians());
    Pose::new(turn, DVec3::new(wrong.anterior_mm, 0.0, -wrong.deeper_mm))
}

/// Metrics of a component put wrongly into `bone`.
fn judge(bone: &Bone, bone_from_glenoid: &Pose, wrong: Wrong) -> Vec<Metric> {
    let component = component();
    let seated = Pose::new(DQuat::IDENTITY, -DVec3::Z * DEPTH_MM);
    let bone_from_plan = bone_from_glenoid.then(&seated);
    let planned = perform(bone, &component, &bone_from_plan);
    let cut = perform(bone, &component, &bone_from_plan.then(&put(wrong)));
    // the bone frame is the patient's here; landmarks such that the plan's axis is Friedman's
    let at = |p: DVec3| bone_from_glenoid.point(p);
    let scapula = Scapula::of(&Landmarks {
        glenoid_centre: at(DVec3::ZERO),
        trigonum_spinae: at(DVec3::Z * -100.0),
        inferior_angle: at(DVec3::new(0.0, -100.0, -80.0)),
    })
    .expect("a frame");
    metrics(&Case {
        bone,
        cut: &cut,
        planned: &planned,
        bone_from_plan: &bone_from_plan,
        component: &component,
        native_mm: DEPTH_MM,
        scapula: Some(&scapula),
        protected: &[],
        tool_axis: None,
    })
}

fn get<'a>(all: &'a [Metric], name: &str) -> &'a Metric {
    all.iter().find(|m| m.name == name).expect("a metric")
}

fn value(all: &[Metric], name: &str) -> f64 {
    get(all, name).value.unwrap_or(f64::NAN)
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of cases")]
fn planted_errors_are_reported_however_the_bone_lies() {
    let wrongs = [
        Wrong::default(),
        Wrong {
            version_deg: 5.0,
            ..Wrong::default()
        },
        Wrong {
            version_deg: 10.0,
            ..Wrong::default()
        },
        Wrong {
            deeper_mm: 1.0,
            ..Wrong::default()
        },
        Wrong {
            deeper_mm: -1.0,
            ..Wrong::default()
        },
        Wrong {
            anterior_mm: 2.0,
            ..Wrong::default()
        },
        Wrong {
            version_deg: -4.0,
            inclination_deg: 6.0,
            roll_deg: 8.0,
            deeper_mm: 0.4,
            anterior_mm: 1.0,
        },
    ];
    for (name, lattice) in lattices() {
        let (bone, bone_from_glenoid) = glenoid(&lattice);
        for wrong in wrongs {
            let all = judge(&bone, &bone_from_glenoid, wrong);
            let put = put(wrong);
            let axis = put.vector(DVec3::Z);
            let expected = [
                // a left scapula's x is posterior; the signs below are the frame's own
                ("version_error", axis.x.atan2(axis.z).to_degrees(), 0.3),
                ("inclination_error", axis.y.atan2(axis.z).to_degrees(), 0.3),
                ("centre_ap", put.translation.x, 0.1),
                ("centre_si", put.translation.y, 0.1),
                ("depth_error", -put.translation.z, 0.05),
                ("medialisation", DEPTH_MM - put.translation.z, 0.05),
            ];
            for (metric, planted, within) in expected {
                let m = get(&all, metric);
                let mirrored = ["version_error", "centre_ap"].contains(&metric);
                let side = if mirrored && left(&bone_from_glenoid) {
                    -1.0
                } else {
                    1.0
                };
                let got = side * m.value.unwrap_or(f64::NAN);
                let stated = m.uncertainty.expect("an uncertainty");
                eprintln!("{name} {metric}: planted {planted:.3}, got {got:.4} ± {stated:.3}");
                assert!(
                    (got - planted).abs() < within,
                    "{name} {wrong:?} {metric}: {got} for {planted}"
                );
                assert!(
                    (got - planted).abs() <= stated,
                    "{name} {wrong:?} {metric}: {got} for {planted}, stated {stated}"
                );
            }
            let roll = value(&all, "roll_error");
            assert!(
                (roll - wrong.roll_deg).abs() < 0.7,
                "{name} {wrong:?}: roll {roll}"
            );
        }
    }
}

fn left(bone_from_glenoid: &Pose) -> bool {
    bone_from_glenoid.vector(DVec3::Z).x >= 0.0
}

#[test]
fn amounts_of_a_perfect_session_are_the_plans_and_of_a_deep_one_closed_forms() {
    for (name, lattice) in lattices() {
        let (bone, bone_from_glenoid) = glenoid(&lattice);
        let perfect = judge(&bone, &bone_from_glenoid, Wrong::default());
        for metric in [
            "removed_beyond_plan",
            "left_of_plan",
            "perforation",
            "protected_removed",
        ] {
            assert!(value(&perfect, metric).abs() < 1e-9, "{name} {metric}");
        }
        for metric in [
            "removed_cartilage",
            "removed_subchondral",
            "removed_cancellous",
            "plate_preserved",
            "seating",
        ] {
            let m = get(&perfect, metric);
            let (got, plan) = (m.value.expect("a number"), m.plan.expect("a plan"));
            assert!((got - plan).abs() < 1e-6, "{name} {metric}: {got} {plan}");
        }
        assert!(
            value(&perfect, "seating") > 97.0,
            "{name}: {}",
            value(&perfect, "seating")
        );
        assert!(
            value(&perfect, "surface_rms") < 0.08,
            "{name}: {}",
            value(&perfect, "surface_rms")
        );
        // a millimetre deeper over the reamer's disc within the column, and the holes' ends
        let deep = judge(
            &bone,
            &bone_from_glenoid,
            Wrong {
                deeper_mm: 1.0,
                ..Wrong::default()
            },
        );
        let pi = core::f64::consts::PI;
        let holes = pi * (16.0 + 6.25);
        // the reamed disc: where the back lies under the face, out to the column's rim
        let disc = pi * 17.0 * 17.0;
        let expected = disc - holes + holes;
        let got = value(&deep, "removed_beyond_plan");
        let m = get(&deep, "removed_beyond_plan");
        let stated = m.uncertainty.expect("an uncertainty");
        assert!(
            (got - expected).abs() < stated + 0.05 * expected,
            "{name}: {got} for {expected} ± {stated}"
        );
        // planned points see the surface a millimetre lower, along normals up to 30° off
        let rms = value(&deep, "surface_rms");
        assert!((0.9..1.1).contains(&rms), "{name}: {rms}");
        assert!(
            value(&deep, "seating") > 97.0,
            "seated where it was reamed to: {name}"
        );
    }
}

#[test]
fn amounts_do_not_depend_on_the_lattice() {
    let wrong = Wrong {
        version_deg: 5.0,
        deeper_mm: 0.5,
        ..Wrong::default()
    };
    let all: Vec<(&str, Vec<Metric>)> = lattices()
        .into_iter()
        .map(|(name, lattice)| {
            let (bone, pose) = glenoid(&lattice);
            (name, judge(&bone, &pose, wrong))
        })
        .collect();
    let names = [
        "removed_cartilage",
        "removed_subchondral",
        "removed_cancellous",
        "removed_beyond_plan",
        "left_of_plan",
        "plate_preserved",
        "seating",
        "surface_rms",
    ];
    for metric in names {
        let reference = get(&all[1].1, metric);
        for (name, metrics) in &all {
            let m = get(metrics, metric);
            let (a, b) = (
                m.value.expect("a number"),
                reference.value.expect("a number"),
            );
            let stated = m.uncertainty.expect("stated") + reference.uncertainty.expect("stated");
            eprintln!("{metric} {name}: {a:.3}, 0.5 mm: {b:.3}, stated {stated:.3}");
            assert!(
                (a - b).abs() <= stated,
                "{metric} {name}: {a} against {b}, stated {stated}"
            );
        }
    }
}

#[test]
fn a_peg_through_the_wall_is_a_perforation() {
    let (_, lattice) = lattices().remove(0);
    let (bone, bone_from_glenoid) = glenoid(&lattice);
    // 45° out of the side of a 17 mm column, 18 mm long: the hole ends 2 mm outside
    let steep = judge(
        &bone,
        &bone_from_glenoid,
        Wrong {
            version_deg: 40.0,
            anterior_mm: -8.0,
            ..Wrong::default()
        },
    );
    assert!(
        value(&steep, "perforation") > 20.0,
        "{}",
        value(&steep, "perforation")
    );
}

#[test]
fn the_face_is_found_as_it_was_made() {
    for (name, lattice) in lattices() {
        let (bone, bone_from_glenoid) = glenoid(&lattice);
        let off = Pose::new(DQuat::from_rotation_x(0.1), DVec3::new(1.0, -1.0, 0.5));
        let found = face::find(&bone, &bone_from_glenoid.then(&off), 14.0).expect("a face");
        assert!(
            (found.sphere.radius_mm - FACE_RADIUS_MM).abs() < 0.5,
            "{name}: {}",
            found.sphere.radius_mm
        );
        assert!(
            found.sphere.rms_mm < 0.05,
            "{name}: {}",
            found.sphere.rms_mm
        );
        let normal = bone_from_glenoid.vector(DVec3::Z);
        // the patch is centred off the axis, so its plane tilts by about that over the radius
        assert!(found.plane.normal.dot(normal) > 0.998, "{name}");
    }
}

#[test]
fn an_untouched_bone_has_no_pose_and_nothing_removed() {
    let (_, lattice) = lattices().remove(0);
    let (bone, bone_from_glenoid) = glenoid(&lattice);
    let component = component();
    let planned = perform(&bone, &component, &bone_from_glenoid);
    let all = metrics(&Case {
        bone: &bone,
        cut: &Cut::new(&bone),
        planned: &planned,
        bone_from_plan: &bone_from_glenoid,
        component: &component,
        native_mm: 0.0,
        scapula: None,
        protected: &[],
        tool_axis: None,
    });
    assert_eq!(get(&all, "version_error").value, None);
    assert!(value(&all, "removed_subchondral").abs() < 1e-12);
}
