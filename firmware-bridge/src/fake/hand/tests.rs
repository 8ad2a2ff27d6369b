use super::*;
use crate::fake::plant::{ArmParameters, Plant, STEP_S, SUBSTEPS};

fn segment(goal: DVec3, speed_mm_s: f64, max_push_n: f64) -> Segment {
    Segment {
        name: "test".to_owned(),
        goal_mm: goal.to_array(),
        axis: [0.0, 0.0, 1.0],
        speed_mm_s,
        max_push_n,
        press: None,
        dwell_s: 0.0,
        timeout_s: 20.0,
    }
}

/// Hand and arm on a virtual clock, with a stiff wall z ≥ `wall_z` (mm) for the stylus.
struct Rig {
    hand: Hand,
    plant: Plant,
    wall_z: f64,
    wall_n: f64,
    most_hand_n: f64,
}

impl Rig {
    fn new(segments: Vec<Segment>) -> Self {
        let arm = ArmParameters {
            grip_kg: Hold::Grip.mass_kg(),
            ..ArmParameters::default()
        };
        let mut plant = Plant::new(arm, [0; 3]);
        plant.release();
        Self {
            hand: Hand::new(Stroke { segments }),
            plant,
            wall_z: f64::NEG_INFINITY,
            wall_n: 0.0,
            most_hand_n: 0.0,
        }
    }

    fn tick(&mut self, engaged: bool) {
        self.hand.plan(1e-3, &self.plant.motion(), engaged);
        for _ in 0..SUBSTEPS {
            let motion = self.plant.motion();
            let depth = (self.wall_z - motion.position.z).max(0.0);
            // 5 N/mm with damping: what a bone's reaction looks like at the stylus.
            let damping = if depth > 0.0 {
                0.02 * motion.velocity.z
            } else {
                0.0
            };
            self.wall_n = (5.0 * depth - damping).max(0.0);
            let force = self.hand.force(&motion);
            self.most_hand_n = self.most_hand_n.max(force.length());
            self.plant.step(STEP_S, force + DVec3::Z * self.wall_n);
        }
    }

    fn until(&mut self, limit_ms: u32, stop: impl Fn(&Self) -> bool) -> u32 {
        for ms in 0..limit_ms {
            if stop(self) {
                return ms;
            }
            self.tick(true);
        }
        limit_ms
    }

    fn position(&self) -> DVec3 {
        self.plant.motion().position
    }
}

const DOCKED_AT: DVec3 = DVec3::new(0.0, -70.647, -86.729);

#[test]
fn it_stays_in_the_dock_until_the_drive_is_engaged() {
    let mut rig = Rig::new(vec![segment(DOCKED_AT + DVec3::Z * 20.0, 20.0, 2.0)]);
    for _ in 0..100 {
        rig.hand.plan(1e-3, &rig.plant.motion(), false);
        assert!(rig.hand.docked() && rig.hand.segment() == -1);
        assert_eq!(rig.hand.force(&rig.plant.motion()), DVec3::ZERO);
    }
    rig.tick(true);
    assert!(!rig.hand.docked() && rig.hand.segment() == 0);
    let mut idle = Hand::new(Stroke::default());
    idle.plan(1e-3, &rig.plant.motion(), true);
    assert!(idle.docked(), "left the dock with nothing to do");
}

#[test]
fn it_reaches_the_goal_on_a_straight_line_at_speed_without_overshoot() {
    let goal = DOCKED_AT + DVec3::new(15.0, 20.0, 35.0);
    let mut rig = Rig::new(vec![segment(goal, 30.0, 2.0)]);
    let direction = (goal - DOCKED_AT).try_normalize().unwrap();
    let (mut off, mut beyond) = (0.0_f64, 0.0_f64);
    let mut ms = 0;
    while !rig.hand.done() && ms < 5000 {
        rig.tick(true);
        let way = rig.position() - DOCKED_AT;
        off = off.max((way - direction * way.dot(direction)).length());
        beyond = beyond.max(way.dot(direction) - (goal - DOCKED_AT).length());
        ms += 1;
    }
    // 43 mm at 30 mm/s, and the time to speed up and slow down.
    assert!((1450..2200).contains(&ms), "{ms} ms");
    assert!(off < 0.6, "{off} mm off the line");
    assert!(beyond < 0.15, "{beyond} mm beyond");
    let left = (goal - rig.position()).dot(direction);
    assert!(left.abs() < 2.0 * ARRIVED_MM, "{left} mm left");
}

#[test]
fn it_holds_still_at_the_end() {
    let goal = DOCKED_AT + DVec3::Z * 20.0;
    let mut rig = Rig::new(vec![segment(goal, 30.0, 2.0)]);
    rig.until(3000, |rig| rig.hand.done());
    for _ in 0..2000 {
        rig.tick(true);
        assert!((rig.position() - goal).length() < 0.3, "{}", rig.position());
    }
    assert!(rig.plant.motion().velocity.length() < 0.05);
}

#[test]
fn against_a_wall_the_push_grows_to_its_limit_and_no_further() {
    let goal = DOCKED_AT + DVec3::Z * 10.0;
    let mut rig = Rig::new(vec![
        segment(goal, 20.0, 2.0),
        segment(goal - DVec3::Z * 20.0, 4.0, 1.5),
    ]);
    rig.wall_z = goal.z - 5.0;
    rig.until(3000, |rig| rig.hand.segment() == 1);
    rig.most_hand_n = 0.0;
    rig.until(4000, |_| false);
    assert!(
        (rig.wall_n - 1.5).abs() < 0.15,
        "{} N on the wall",
        rig.wall_n
    );
    // Along the line 1.5 N; across it the weight and the line's hold.
    assert!(rig.most_hand_n < 1.7, "{}", rig.most_hand_n);
    assert_eq!(rig.hand.segment(), 1, "took a wall for the goal");
    // The wall gives way: the goal is reached after all.
    rig.wall_z = f64::NEG_INFINITY;
    rig.until(10_000, |rig| rig.hand.done());
    assert!(rig.hand.done() && rig.hand.timeouts() == 0);
}

#[test]
fn a_reaction_below_the_push_does_not_keep_it_from_the_goal() {
    // A spring of the wall's own holds 0.8 N at the goal: the target goes beyond it.
    let goal = DOCKED_AT + DVec3::Z * 10.0;
    let mut rig = Rig::new(vec![
        segment(goal, 20.0, 2.0),
        segment(goal - DVec3::Z * 5.0, 4.0, 1.5),
    ]);
    rig.wall_z = goal.z - 5.0 + 0.16;
    rig.until(8000, |rig| rig.hand.done());
    assert!(rig.hand.done() && rig.hand.timeouts() == 0);
    let left = rig.position().z - (goal.z - 5.0);
    assert!(left.abs() < 0.06, "{left} mm left");
}

#[test]
fn a_timeout_gives_the_segment_up_and_goes_on() {
    let goal = DOCKED_AT + DVec3::Z * 10.0;
    let mut blocked = segment(goal - DVec3::Z * 20.0, 4.0, 1.5);
    blocked.timeout_s = 1.0;
    let mut rig = Rig::new(vec![
        segment(goal, 20.0, 2.0),
        blocked,
        segment(goal, 20.0, 2.0),
    ]);
    rig.wall_z = goal.z - 1.0;
    rig.until(2000, |rig| rig.hand.segment() == 1);
    let ms = rig.until(3000, |rig| rig.hand.segment() == 2);
    assert!((1000..=1002).contains(&ms), "{ms}");
    assert_eq!(rig.hand.timeouts(), 1);
    rig.until(3000, |rig| rig.hand.done());
    rig.until(500, |_| false);
    assert!(
        (rig.position() - goal).length() < 0.3,
        "{} {goal}",
        rig.position()
    );
}

#[test]
fn a_button_is_down_for_80_ms_and_the_hand_waits_out_release_and_dwell() {
    let goal = DOCKED_AT + DVec3::Z * 5.0;
    let mut first = segment(goal, 20.0, 2.0);
    first.press = Some(2);
    first.dwell_s = 0.05;
    let mut rig = Rig::new(vec![first, segment(goal, 20.0, 2.0)]);
    rig.until(2000, |rig| rig.hand.buttons() != 0);
    assert_eq!(rig.hand.buttons(), switch::BUTTON_2);
    // The drive pauses in the middle: the press must neither bounce nor stretch.
    let mut down = 0;
    let mut arrived = 0;
    while rig.hand.segment() == 0 && arrived < 1000 {
        down += u32::from(rig.hand.buttons() != 0);
        rig.tick(!(20..60).contains(&arrived));
        arrived += 1;
    }
    assert!((79..=81).contains(&down), "{down} ms");
    assert!((249..=251).contains(&arrived), "{arrived} ms");
}

#[test]
fn without_the_drive_it_stops_pushing_and_takes_up_again() {
    let goal = DOCKED_AT + DVec3::Z * 10.0;
    let mut rig = Rig::new(vec![
        segment(goal, 20.0, 2.0),
        segment(goal - DVec3::Z * 20.0, 4.0, 1.5),
    ]);
    rig.wall_z = goal.z - 1.0;
    rig.until(4000, |_| false);
    assert!(rig.wall_n > 1.3);
    // The drive trips, and the wall that it made is gone with it.
    rig.wall_z = f64::NEG_INFINITY;
    let before = rig.position().z;
    for _ in 0..1000 {
        rig.tick(false);
    }
    assert!((rig.position().z - before).abs() < 0.5, "lunged");
    rig.until(15_000, |rig| rig.hand.done());
    assert!((rig.position().z - (goal.z - 20.0)).abs() < 0.2);
}

#[test]
fn the_stylus_turns_smoothly_to_the_axis() {
    let mut turned = segment(DOCKED_AT + DVec3::Z * 5.0, 20.0, 2.0);
    turned.axis = [0.6, 0.8, 0.0];
    let mut rig = Rig::new(vec![turned]);
    let mut before = rig.hand.rotation();
    rig.until(5000, |rig| rig.hand.done());
    let z = rig.hand.rotation() * DVec3::Z;
    assert!(z.distance(DVec3::new(0.6, 0.8, 0.0)) < 0.006, "{z}");
    // Again, watching the rate of the whole rotation, roll included.
    let mut rig = Rig::new(rig.hand.segments.clone());
    for _ in 0..2000 {
        rig.tick(true);
        let step = before.angle_between(rig.hand.rotation());
        assert!(
            step < 1.01 * TURN_RATE * 1e-3 + 1e-6,
            "{step} rad in a millisecond"
        );
        before = rig.hand.rotation();
    }
}
