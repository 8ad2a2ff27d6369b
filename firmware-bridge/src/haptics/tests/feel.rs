//! The workspace through the ring, and what the force loop tells of itself.

use super::*;

/// Way between the tools of two ticks, mm, and the angle between them, rad.
fn apart(a: &TickRecord, b: &TickRecord) -> (f64, f64) {
    let (a, b) = (&a.bone_from_tool, &b.bone_from_tool);
    (
        (a.translation - b.translation).length(),
        a.rotation.angle_between(b.rotation),
    )
}

#[test]
fn clutch_scale_and_turn_reach_the_servo_and_leave_the_tool_where_it_is() {
    let stays = |a: &TickRecord, b: &TickRecord| {
        let (way, angle) = apart(a, b);
        assert!(way < 1e-9 && angle < 1e-6, "{way} mm, {angle} rad");
    };
    let mut pair = Pair::over_phantom(4096, in_two_steps);
    let rest = pair.run_and_look(150);
    assert!(!rest.flags.clutched && !rest.flags.waiting);
    assert!((rest.felt.motion_scale - 1.0).abs() < 1e-12);
    // the hand goes down by 2 mm with the clutch held
    pair.wish(Command::Clutch(true));
    let held = pair.run_and_look(300);
    assert!(held.flags.clutched);
    assert!((held.stylus_in_base - rest.stylus_in_base).length() > 1.8);
    stays(&rest, &held);
    pair.wish(Command::Clutch(false));
    let free = pair.run_and_look(10);
    assert!(!free.flags.clutched);
    stays(&rest, &free);
    pair.wish(Command::MotionScale(2000));
    pair.wish(Command::TurnWorkspace(500));
    let scaled = pair.run_and_look(10);
    assert!((scaled.felt.motion_scale - 2.0).abs() < 1e-12);
    stays(&rest, &scaled);
    // and then it follows, twice as far as the hand; the line of sight keeps its direction
    let moved = pair.run_and_look(300);
    let hand = (moved.stylus_in_base - scaled.stylus_in_base).length();
    let (way, _) = apart(&scaled, &moved);
    assert!(
        hand > 0.8 && (way / hand - 2.0).abs() < 1e-6,
        "{way} {hand}"
    );
}

#[test]
fn wishes_out_of_their_range_do_not_reach_the_ring() {
    let (mut requests, mut out) = RingBuffer::new(4);
    let mut dropped = 0;
    for command in [
        Command::SelectTool(8),
        Command::MotionScale(0),
        Command::MotionScale(199),
        Command::MotionScale(5001),
        Command::TurnWorkspace(3143),
        Command::TurnWorkspace(i16::MIN),
    ] {
        assert!(!forward(command, &mut requests, &mut dropped));
        assert!(out.is_empty(), "{command:?}");
    }
    assert_eq!(dropped, 0, "they are refused, not dropped");
    for (command, request) in [
        (Command::Clutch(true), Request::Clutch(true)),
        (Command::MotionScale(1250), Request::MotionScale(1.25)),
        (Command::TurnWorkspace(-262), Request::TurnWorkspace(-0.262)),
    ] {
        assert!(!forward(command, &mut requests, &mut dropped));
        assert_eq!(out.pop(), Ok(request));
    }
    assert!(forward(Command::Stop, &mut requests, &mut dropped));
    assert!(out.is_empty());
}

#[test]
fn what_the_loop_knows_is_recorded_and_counted() {
    let mut pair = Pair::new(4096);
    let mut stats = Stats::new(&Tool::standard_set());
    let mut last = None;
    for _ in 0..40 {
        pair.run(100);
        while let Ok(record) = pair.records.pop() {
            if let Record::Tick(tick) = record {
                stats.add(&tick);
                last = Some(tick);
            }
        }
    }
    let last = last.expect("a tick");
    let guards = pair.thread.servo.guards();
    assert_eq!(last.guards, guards);
    let health = stats.health("scripted");
    assert_eq!(health.guard_events, guards.total());
    assert_eq!(
        health.guard_events,
        health.guards.iter().map(|g| g.count).sum::<u64>()
    );
    assert_eq!(health.guards.len(), GUARDS);
    assert!(
        health
            .guards
            .iter()
            .all(|g| (g.count == 0) == (g.last_tick == 0))
    );
    assert!(health.guards.iter().all(|g| g.last_tick <= health.ticks));
    let loads = &stats.loads;
    // a cut of 5 mm into the phantom
    assert!(
        loads.peak_physical_force_n > loads.peak_force_n,
        "{loads:?}"
    );
    assert!(
        loads.peak_spindle_nmm > 0.0 && loads.peak_vibration_n > 0.0,
        "{loads:?}"
    );
    assert!((0.0..=1.0).contains(&loads.peak_spindle_load) && loads.clutched_ticks == 0);
    assert!(last.felt.spindle_rad_s > 0.0);
}

#[test]
fn a_spindle_that_hardly_turns_under_a_load_has_stalled() {
    let mut pair = Pair::new(4096);
    let template = pair.run_and_look(10);
    let mut stats = Stats::new(&Tool::standard_set());
    let rpm = Tool::standard_set()[0].rpm;
    let mut add = |share: f64, load: f64, on: bool, saturated: bool| {
        let mut tick = template;
        tick.tool = 0;
        tick.felt.spindle_rad_s = share * rpm * std::f64::consts::TAU / 60.0;
        tick.felt.spindle_load = load;
        tick.flags.spindle_on = on;
        tick.flags.saturated = saturated;
        stats.add(&tick);
        (stats.loads.stalled_ticks, stats.loads.saturated_ticks)
    };
    assert_eq!(
        add(0.05, 0.0, true, false),
        (0, 0),
        "it spins up in the air"
    );
    assert_eq!(add(0.11, 1.0, true, true), (0, 1), "slow, not stalled");
    assert_eq!(add(0.05, 0.4, false, true), (0, 2), "switched off");
    assert_eq!(add(0.05, 0.4, true, true), (1, 3));
    assert_eq!(add(0.0, 1.0, true, false), (2, 3));
}
