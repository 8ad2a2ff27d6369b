use super::*;

fn frictionless(weight_n: f64, grip_kg: f64) -> ArmParameters {
    ArmParameters {
        coulomb_nm: 0.0,
        viscous_nms: 0.0,
        weight_n,
        grip_kg,
    }
}

/// Every joint pose of a grid over the box between the stops.
fn joint_box(steps: u32) -> impl Iterator<Item = DVec3> {
    let at = move |[lo, hi]: [f64; 2], n: u32| lo + (hi - lo) * f64::from(n) / f64::from(steps);
    (0..=steps).flat_map(move |i| {
        (0..=steps).flat_map(move |j| {
            (0..=steps).map(move |k| {
                let [waist, shoulder, bend] = JOINT_LIMITS;
                let t2 = at(shoulder, j);
                DVec3::new(at(waist, i), t2, t2 + at(bend, k))
            })
        })
    })
}

#[test]
fn the_mass_matrix_is_positive_definite_between_the_stops() {
    for grip in [0.0, 0.1, 0.3] {
        let inertia = Inertia::new(grip);
        for t in joint_box(24) {
            let m = inertia.matrix(t);
            let minor = m.y_axis.y * m.z_axis.z - m.y_axis.z * m.y_axis.z;
            assert!(m.x_axis.x > 1e-4 && minor > 1e-7, "{t} {m}");
        }
    }
}

#[test]
fn the_mass_matrix_is_that_of_the_links() {
    // Oracle: kinetic energy of the rods cut into 2000 points each, plus the joints' own part.
    let point_speed2 = |t: DVec3, v: DVec3, upper: f64, fore: f64| {
        let place = |t: DVec3| {
            let r = LINK_M * (upper * libm::cos(t.y) + fore * libm::sin(t.z));
            let y = LINK_M * (upper * libm::sin(t.y) - fore * libm::cos(t.z));
            DVec3::new(-r * libm::sin(t.x), y, r * libm::cos(t.x))
        };
        let h = 1e-6;
        ((place(t + v * h) - place(t - v * h)) / (2.0 * h)).length_squared()
    };
    let grip = 0.1;
    let inertia = Inertia::new(grip);
    for (t, v) in [
        (DVec3::new(0.3, 0.4, -0.2), DVec3::new(1.0, -2.0, 0.5)),
        (DVec3::new(-0.5, 1.2, 1.6), DVec3::new(0.2, 1.0, 3.0)),
    ] {
        let n = 2000;
        let mut energy = 0.5 * (GIMBAL_KG + grip) * point_speed2(t, v, 1.0, 1.0);
        for i in 0..n {
            let part = (f64::from(i) + 0.5) / f64::from(n);
            energy += 0.5 * UPPER_KG / f64::from(n) * point_speed2(t, v, part, 0.0);
            energy += 0.5 * FORE_KG / f64::from(n) * point_speed2(t, v, 1.0, part);
        }
        let links_2 = (UPPER_KG / 3.0 + FORE_KG + GIMBAL_KG) * LINK2;
        let links_3 = (FORE_KG / 3.0 + GIMBAL_KG) * LINK2;
        energy += 0.5 * TURRET_KGM2 * v.x * v.x;
        energy += 0.5 * (JOINT_KGM2 - links_2) * v.y * v.y;
        energy += 0.5 * (JOINT_KGM2 - links_3) * v.z * v.z;
        assert!(links_2 < JOINT_KGM2 && links_3 < JOINT_KGM2);
        let kinetic = 0.5 * v.dot(inertia.matrix(t) * v);
        assert!(
            (kinetic - energy).abs() < 1e-6 * energy,
            "{kinetic} {energy}"
        );
    }
}

#[test]
fn energy_stays_without_friction_and_input() {
    // A kick that stays between the stops for 0.4 s; weight and Coriolis at work.
    let mut plant = Plant::new(frictionless(0.1, 0.02), [0; 3]);
    plant.place(DVec3::new(-0.6, 1.1, 1.0), DVec3::new(2.2, 0.8, -0.6));
    let start = plant.energy();
    let kinetic = start - 0.1 * omni::forward(plant.joints()).y * 1e-3;
    let mut worst = 0.0_f64;
    for _ in 0..8_000 {
        assert_eq!(plant.at_stop(), [false; 3], "{}", plant.joints());
        plant.step(STEP_S, DVec3::ZERO);
        worst = worst.max((plant.energy() - start).abs());
    }
    assert!(worst < 0.001 * kinetic, "{worst} J of {kinetic} J");
}

#[test]
fn the_work_of_a_force_becomes_energy() {
    let mut plant = Plant::new(frictionless(0.0, 0.1), [0; 3]);
    plant.place(DVec3::new(0.1, 0.5, 0.2), DVec3::ZERO);
    let force = DVec3::new(0.2, -0.1, 0.3);
    let from = plant.motion().position;
    for _ in 0..3000 {
        plant.step(STEP_S, force);
    }
    let work = force.dot(plant.motion().position - from) * 1e-3;
    let gained = plant.energy();
    assert!(
        work > 1e-4 && (work - gained).abs() < 0.01 * work,
        "{work} {gained}"
    );
}

#[test]
fn a_push_at_the_stylus_meets_45_g_and_the_hand() {
    // Shoulder lever upright to the push: 8.0e-4 kg·m² at one link is 45 g, and 100 g of hand.
    for (grip, mass) in [(0.0, 0.045), (0.1, 0.145)] {
        let mut plant = Plant::new(frictionless(0.0, grip), [0; 3]);
        plant.place(DVec3::ZERO, DVec3::ZERO);
        plant.step(1e-4, DVec3::new(0.0, 1.0, 0.0));
        let acceleration = plant.motion().velocity.y * 1e-3 / 1e-4;
        assert!((1.0 / acceleration - mass).abs() < 0.001, "{acceleration}");
    }
}

#[test]
fn friction_stops_a_coasting_arm() {
    let mut plant = Plant::new(ArmParameters::default(), [0; 3]);
    plant.place(DVec3::new(0.0, 0.5, 0.2), DVec3::new(1.0, 1.0, -1.0));
    let mut before = plant.energy();
    for _ in 0..2000 {
        plant.step(STEP_S, DVec3::ZERO);
        let now = plant.energy();
        assert!(now <= before + 1e-12, "energy out of nothing");
        before = now;
    }
    assert!(
        plant.motion().velocity.length() < 5.0,
        "{}",
        plant.motion().velocity
    );
}

#[test]
fn motors_lag_by_0_4_ms_and_stop_at_once() {
    let mut plant = Plant::new(frictionless(0.0, 0.0), [0; 3]);
    plant.set_drive([1000, 0, 0], true);
    for _ in 0..8 {
        plant.step(STEP_S, DVec3::ZERO);
    }
    let part = plant.torque_nmm().x / 215.0;
    assert!((part - (1.0 - libm::exp(-1.0))).abs() < 1e-9, "{part}");
    plant.set_drive([1000, 0, 0], false);
    assert_eq!(plant.torque_nmm(), DVec3::ZERO);
    plant.step(STEP_S, DVec3::ZERO);
    assert_eq!(plant.torque_nmm(), DVec3::ZERO);
}

#[test]
fn stops_bear_a_hard_push_in_every_direction() {
    for force in [
        DVec3::X,
        DVec3::NEG_X,
        DVec3::Y,
        DVec3::NEG_Y,
        DVec3::Z,
        DVec3::NEG_Z,
    ] {
        let mut plant = Plant::new(ArmParameters::default(), [0; 3]);
        plant.release();
        for _ in 0..40_000 {
            plant.step(STEP_S, force * 5.0);
        }
        let travel = plant.travel();
        for joint in 0..3 {
            let [lo, hi] = JOINT_LIMITS[joint];
            let inside = travel[joint] > lo - 0.2 && travel[joint] < hi + 0.2;
            assert!(inside, "{force}: joint {joint} at {}", travel[joint]);
        }
        assert!(plant.at_stop().contains(&true), "{force}");
    }
}

#[test]
fn encoders_floor_and_start_anywhere() {
    let mut plant = Plant::new(ArmParameters::default(), [5, -6, 7]);
    assert_eq!(plant.encoders(), [5, -6, 7]);
    let count = TAU / 15_000.0;
    plant.place(DOCK + DVec3::new(-0.001, 0.999, 41.5) * count, DVec3::ZERO);
    assert_eq!(plant.encoders(), [4, -6, 48]);
    let quarter = gimbal_counts(DVec3::new(TAU / 4.0 + 1e-9, -1e-6, 0.0));
    assert_eq!(quarter, [4096, -1, 0]);
}

#[test]
fn windings_warm_up_to_the_closed_form() {
    let mut plant = Plant::new(ArmParameters::default(), [0; 3]);
    // 0.117 N·m on the shoulder: 40 K · (1 − e⁻¹) after one time constant.
    plant.set_drive([0, 544, 0], true);
    for _ in 0..120_000 {
        plant.step(1e-3, DVec3::ZERO);
    }
    let [waist, shoulder, _] = plant.temperature();
    assert_eq!(waist, 25);
    assert!((50..=51).contains(&shoulder), "{shoulder}");
}
