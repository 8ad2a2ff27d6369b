use super::*;
use crate::fake::faults::CATALOGUE;

/// Every fault, every direction, 20 seeds.
#[test]
fn every_fault_stops_in_time_or_does_not_stop_at_all() {
    let rows = crate::bench::all_rows(20, &mut |_, _| {}).expect("a bench");
    let bad: Vec<_> = rows.iter().filter(|row| !row.pass).collect();
    assert!(bad.is_empty(), "{bad:#?}");
    let directions: usize = CATALOGUE.iter().map(|e| e.directions.len()).sum();
    assert_eq!(rows.len(), directions);
}

#[test]
fn the_measure_sees_a_torque_that_stays_and_a_zero_that_does_not_last() {
    let at = |n: u64| n * 1_000_000;
    let trace = |torque: &dyn Fn(u64) -> f64| -> Vec<(u64, f64)> {
        (0..100).map(|n| (at(n), torque(n))).collect()
    };
    let never = trace(&|_| 10.0);
    assert_eq!(zero(&never, at(10), at(50)), (None, false));
    let late = trace(&|n| if n < 31 { 10.0 } else { 0.0 });
    assert_eq!(zero(&late, at(10), at(50)), (Some(21.0), true));
    let back = trace(&|n| if (20..30).contains(&n) { 0.0 } else { 10.0 });
    assert_eq!(zero(&back, at(10), at(50)), (Some(10.0), false));
}

#[test]
fn pulled_and_put_back_a_hundred_times_in_the_middle_of_a_cut() {
    let lab = Lab::new().expect("a phantom");
    let mut world = World::new(&lab, DeviceSetup::new(stroke(Work::Cut), 5), 0, 0);
    until_firm(&mut world).expect("a cut");
    let plan: Planned = "unplug".parse().expect("a fault");
    for n in 0..100 {
        world.inject(plan, n);
        let mut last = world.device().plant().torque_nmm();
        for ms in 0..700 {
            let truth = world.tick();
            if (20..300).contains(&ms) {
                assert!(torque(&truth) <= ZERO_NMM, "round {n}, {ms} ms");
            }
            // no jump: at most a tenth of the slew limit in a millisecond while the force returns
            for joint in 0..3 {
                let rise = truth.torque_nmm[joint].abs() - last[joint].abs();
                let most = f64::from(SLEW_COUNTS_PER_MS[joint]) * 0.0215 * 2.0;
                assert!(rise <= most, "round {n}, {ms} ms: {rise} N·mm");
            }
            last = truth.torque_nmm;
        }
        assert!(world.running(), "round {n}: {:?}", world.over());
        assert_eq!(world.wrongly_applied(), 0);
    }
}

#[test]
fn the_same_seed_gives_the_same_session() {
    let lab = Lab::new().expect("a phantom");
    let bases = Bases::new(&lab).expect("sessions");
    let plan: Planned = "flip-bits:to-device".parse().expect("a fault");
    let play = |seed| play(&lab, &bases, plan, seed).expect("a session");
    assert_eq!(play(3), play(3));
}

/// Control: the counters of the wrap's sessions do wrap while the session is watched.
#[test]
fn the_counters_wrap_while_they_are_watched() {
    let lab = Lab::new().expect("a phantom");
    for (name, seed) in [("seq-wrap:to-host", 3), ("seq-wrap:to-device", 4)] {
        let plan: Planned = name.parse().expect("a fault");
        let mut world = built(&lab, plan, seed).expect("a session");
        let counter = |world: &World| match plan.direction {
            Direction::ToHost => world
                .device()
                .firmware()
                .newest_command()
                .map(|c| c.state_seq),
            _ => world.device().firmware().newest_command().map(|c| c.seq),
        };
        let before = counter(&world).expect("a command");
        for _ in 0..RECOVERY_MS {
            world.tick();
        }
        let after = counter(&world).expect("a command");
        assert!(
            before > 60_000 && after < 5_000,
            "{name}: {before} to {after}"
        );
    }
}
