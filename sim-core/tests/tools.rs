//! Tools of faces: the elements against closed forms, distances of random parts, refusals.

use glam::Vec3;
use osteon_sim_core::tool::MAX_ELEMENTS;
use osteon_sim_core::tool::elements::{RELIEF_MM, of_revolved};
use osteon_sim_core::tool::revolved::{
    Face, Form, MAX_FACES, MAX_PARTS, Part, Revolved, RevolvedError,
};
use proptest::prelude::*;
use std::f32::consts::{PI, TAU};

fn part(faces: &[(Form, bool)]) -> Part {
    Part {
        faces: (faces.iter())
            .map(|&(form, cutting)| Face { form, cutting })
            .collect(),
    }
}

fn plane(height_mm: f32, up: bool) -> Form {
    Form::Plane { height_mm, up }
}

fn ball(radius_mm: f32, centre_mm: f32) -> Form {
    Form::Ball {
        radius_mm,
        centre_mm,
    }
}

/// Solids with the exact area of their exposed cutting faces, mm².
#[expect(clippy::too_many_lines, reason = "a table")]
fn solids() -> Vec<(&'static str, Vec<Part>, f32)> {
    let cap = |r: f32, h: f32| TAU * r * h;
    let ring = Form::Ring {
        disc_mm: 1.5,
        centre_mm: 1.5,
        radius_mm: 1.5,
    };
    // lower half of a torus and the disc below it
    let bull_nose = PI * PI * 1.5 * 1.5 + TAU * 1.5 * 1.5 + PI * 1.5 * 1.5;
    // a dome of radius 30 from the pilot's rim (r 3) to its own (r 18)
    let sagitta = |r: f32| 30.0 - (900.0 - r * r).sqrt();
    vec![
        (
            "ball",
            vec![part(&[(ball(3.0, 3.0), true)])],
            4.0 * PI * 9.0,
        ),
        (
            "hemisphere on a shank",
            vec![
                part(&[(ball(18.0, 18.0), true), (plane(20.5, true), false)]),
                part(&[
                    (Form::cylinder(18.0), false),
                    (plane(18.0, false), false),
                    (plane(20.5, true), false),
                ]),
            ],
            cap(18.0, 18.0),
        ),
        (
            "reamer with a pilot",
            vec![
                part(&[
                    (ball(30.0, 40.0), true),
                    (Form::cylinder(18.0), false),
                    (plane(22.0, true), false),
                ]),
                part(&[
                    (Form::cylinder(3.0), false),
                    (plane(0.0, false), false),
                    (plane(15.0, true), false),
                ]),
            ],
            cap(30.0, sagitta(18.0) - sagitta(3.0)),
        ),
        (
            "bull nose",
            vec![part(&[(ring, true), (plane(1.5, true), false)])],
            bull_nose,
        ),
        (
            "countersink",
            vec![part(&[
                (Form::cone(0.0, 45.0, true), true),
                (Form::cone(16.0, 45.0, false), true),
            ])],
            2.0 * PI * 8.0 * 8.0 * 2f32.sqrt(),
        ),
        (
            "two parts with one face",
            vec![
                part(&[
                    (Form::cylinder(2.0), true),
                    (plane(0.0, false), true),
                    (plane(8.0, true), false),
                ]),
                part(&[
                    (Form::cylinder(2.0), true),
                    (plane(4.0, false), true),
                    (plane(12.0, true), true),
                ]),
            ],
            TAU * 2.0 * 12.0 + 2.0 * PI * 4.0,
        ),
    ]
}

#[test]
fn elements_sum_to_the_area_of_the_cutting_faces_and_look_outwards() {
    for (name, parts, truth) in solids() {
        let solid = Revolved::new(parts).expect("a solid");
        let elements = of_revolved(&solid);
        assert!(elements.len() <= MAX_ELEMENTS, "{name}");
        let mut area = 0.0;
        for e in &elements {
            let relief = if e.cutting { 0.0 } else { RELIEF_MM };
            let d = solid.signed_distance(e.position);
            assert!((d + relief).abs() < 1e-3, "{name} {e:?} {d}");
            assert!((e.normal.length() - 1.0).abs() < 1e-5, "{name} {e:?}");
            assert!((e.radius_mm - e.position.truncate().length()).abs() < 1e-4);
            // outside in front of it, inside behind it, both by the way gone
            let ahead = solid.signed_distance(e.position + e.normal * 0.2);
            let groove = name == "reamer with a pilot" || e.radius_mm == 0.0;
            assert!(
                groove || (ahead - 0.2 + relief).abs() < 2e-3,
                "{name} {e:?} {ahead}"
            );
            let behind = solid.signed_distance(e.position - e.normal * 0.02);
            assert!(behind < 0.0, "{name} {e:?} {behind}");
            area += if e.cutting { e.area_mm2 } else { 0.0 };
        }
        // where two faces meet without an edge, rounding moves the border by hundredths of a millimetre
        assert!((area / truth - 1.0).abs() < 2e-3, "{name} {area} {truth}");
    }
}

#[test]
fn a_steep_tip_has_an_element_and_a_flat_one_none() {
    let point = |half_angle| {
        let solid = Revolved::drill([3.0, half_angle, 20.0]);
        let elements = of_revolved(&solid);
        elements
            .iter()
            .any(|e| e.position == Vec3::ZERO && e.normal == Vec3::NEG_Z)
    };
    assert!(point(20.0) && point(59.0) && !point(85.0));
}

#[test]
fn faces_that_make_no_solid_are_refused() {
    let refused = |parts: Vec<Part>| Revolved::new(parts).expect_err("a refusal");
    let good = part(&[(ball(3.0, 0.0), true)]);
    assert_eq!(refused(vec![]), RevolvedError::Parts(0));
    assert_eq!(
        refused(vec![good.clone(); MAX_PARTS + 1]),
        RevolvedError::Parts(MAX_PARTS + 1)
    );
    assert_eq!(
        refused(vec![good.clone(), part(&[])]),
        RevolvedError::Faces(1)
    );
    let many = part(&[(ball(3.0, 0.0), true); MAX_FACES + 1]);
    assert_eq!(refused(vec![many]), RevolvedError::Faces(0));
    let open = [
        part(&[(plane(0.0, true), true)]),
        part(&[(Form::cylinder(3.0), true)]),
        part(&[(Form::cylinder(3.0), true), (plane(0.0, true), true)]),
        part(&[(Form::cone(0.0, 30.0, true), true)]),
        part(&[(plane(4.0, true), true), (plane(0.0, false), true)]),
        part(&[(ball(501.0, 0.0), true)]),
    ];
    let empty = [
        part(&[
            (plane(0.0, true), true),
            (plane(1.0, false), true),
            (Form::cylinder(3.0), true),
        ]),
        part(&[(ball(1.0, 0.0), true), (ball(1.0, 3.0), true)]),
        part(&[
            (Form::cone(10.0, 30.0, true), true),
            (plane(5.0, true), true),
        ]),
    ];
    for part in open.into_iter().chain(empty) {
        assert_eq!(
            refused(vec![good.clone(), part.clone()]),
            RevolvedError::Open(1),
            "{part:?}"
        );
    }
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let spoilt = part(&[(plane(4.0, true), true), (ball(bad, 0.0), true)]);
        assert_eq!(refused(vec![spoilt]), RevolvedError::Number(0, 1));
    }
    for angle in [0.0f32, 90.0, f32::NAN, -20.0, 120.0] {
        let cone = part(&[
            (Form::cone(0.0, angle, true), true),
            (plane(4.0, true), true),
        ]);
        assert!(Revolved::new(vec![cone]).is_err(), "{angle}");
    }
}

fn form() -> impl Strategy<Value = Form> {
    prop_oneof![
        (-5.0f32..30.0, any::<bool>()).prop_map(|(h, up)| plane(h, up)),
        (0.5f32..20.0).prop_map(Form::cylinder),
        (-5.0f32..30.0, 5.0f32..85.0, any::<bool>()).prop_map(|(z, a, up)| Form::cone(z, a, up)),
        (1.0f32..30.0, -5.0f32..30.0).prop_map(|(r, z)| ball(r, z)),
        (0.0f32..10.0, -5.0f32..30.0, 0.5f32..5.0).prop_map(|(disc_mm, centre_mm, radius_mm)| {
            Form::Ring {
                disc_mm,
                centre_mm,
                radius_mm,
            }
        }),
    ]
}

fn solid() -> impl Strategy<Value = Revolved> {
    let part = prop::collection::vec((form(), any::<bool>()), 1..=4).prop_map(|f| part(&f));
    prop::collection::vec(part, 1..=3).prop_filter_map("a closed solid", |p| Revolved::new(p).ok())
}

fn point() -> impl Strategy<Value = Vec3> {
    [-25.0f32..25.0, -25.0f32..25.0, -15.0f32..45.0].prop_map(Vec3::from_array)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn distances_change_by_no_more_than_the_way(s in solid(), a in point(), b in point()) {
        let step = (s.signed_distance(a) - s.signed_distance(b)).abs();
        prop_assert!(step <= (a - b).length() * 1.0001 + 1e-4, "{step}");
    }

    #[test]
    fn the_cross_section_is_where_the_distance_changes_sign(s in solid(), z in -15.0f32..45.0) {
        let d = |r: f32| s.signed_distance(Vec3::new(r, 0.0, z));
        match s.radius_at(z) {
            Some(r) => {
                prop_assert!(d(r + 0.01) > 0.0, "{r}");
                // a cross-section of a sliver has no depth
                prop_assert!(d(r) < 1e-3, "{r} {}", d(r));
                prop_assert!(f64::from(r) <= s.bounds.hi.x + 1e-3);
                prop_assert!(f64::from(z) >= s.bounds.lo.z - 1e-3);
                prop_assert!(f64::from(z) <= s.bounds.hi.z + 1e-3);
            }
            None => prop_assert!(d(0.0) >= 0.0),
        }
    }

    #[test]
    fn elements_of_random_solids_lie_on_them(s in solid()) {
        let elements = of_revolved(&s);
        prop_assert!(elements.len() <= MAX_ELEMENTS);
        for e in elements {
            let relief = if e.cutting { 0.0 } else { RELIEF_MM };
            prop_assert!(e.area_mm2 > 0.0 && e.position.is_finite());
            let d = s.signed_distance(e.position);
            prop_assert!((d + relief).abs() < 2e-3, "{e:?} {d}");
            prop_assert!((e.normal.length() - 1.0).abs() < 1e-4);
        }
    }
}
