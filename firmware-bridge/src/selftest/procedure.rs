//! The steps. Each waits for the operator with no force, has an end, and can be skipped with `s` and Enter.

use super::rig::{Look, Rig};
use super::staircase::{Stair, spring_scale, weight_scale};
use glam::DVec3;
use osteon_protocol::device::{DriveState, fault};
use serde::Serialize;
use std::collections::BTreeMap;

/// What forces are measured against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Against {
    /// Nothing: the step is left out.
    Nothing,
    /// A spring between stylus and a fixed point, N/mm.
    Spring(f64),
    /// A weight on the stylus, g.
    Weight(f64),
}

/// What is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    pub(super) against: Against,
    pub(super) most_n: f64,
    pub(super) patience_ms: u64,
}

/// How a step ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Verdict {
    Pass,
    Fail,
    Skipped,
}

/// A step of the record.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Step {
    pub(super) name: &'static str,
    pub(super) verdict: Verdict,
    /// What was seen, and what to do about it.
    pub(super) seen: String,
    pub(super) numbers: BTreeMap<&'static str, f64>,
}

/// A movement counts from here on, mm, and must be so much longer along its own axis than along the others.
const MOVED_MM: f64 = 25.0;
const CLEARLY: f64 = 2.0;
/// Slower than this for this long is still: mm in a window of so many ms.
const STILL_MM: f64 = 1.5;
const STILL_MS: u64 = 400;
/// Time for the workspace, ms, and the share of the data sheet's 160 × 120 × 70 mm that must be reached.
const ROAM_MS: u64 = 15_000;
const SHEET_MM: DVec3 = DVec3::new(160.0, 120.0, 70.0);
const REACHED: f64 = 0.6;
/// A stair of the force, N and ms; the mean of its last part is its place.
const STAIR_N: f64 = 0.1;
const STAIR_MS: u64 = 250;
const SETTLED_MS: u64 = 150;
/// The measured scale of the force must be so near to 1.
const SCALE_ERROR: f64 = 0.15;
/// Torques must be zero so long after the first state that names the emergency stop, ms.
const E_STOP_MS: u64 = 20;

/// A step.
type Doing = fn(&mut dyn Rig, &Plan) -> anyhow::Result<Step>;

enum Waited<T> {
    Came(T),
    Skipped,
    Over,
}

/// Goes through the steps; a device that goes away ends them, in the record as well.
pub(super) fn procedure(rig: &mut dyn Rig, plan: &Plan) -> Vec<Step> {
    let mut steps = Vec::new();
    let all: [Doing; 8] = [
        undock, right, up, towards, buttons, workspace, staircase, e_stop,
    ];
    for step in all {
        match step(rig, plan) {
            Ok(done) => {
                rig.tell(&format!(
                    "  {:?}: {}: {}",
                    done.verdict, done.name, done.seen
                ));
                steps.push(done);
            }
            Err(error) => {
                steps.push(made("link", Verdict::Fail, format!("{error:#}")));
                break;
            }
        }
    }
    steps
}

fn made(name: &'static str, verdict: Verdict, seen: String) -> Step {
    Step {
        name,
        verdict,
        seen,
        numbers: BTreeMap::new(),
    }
}

fn unfinished(name: &'static str, over: bool, plan: &Plan) -> Step {
    if over {
        let seconds = plan.patience_ms / 1000;
        made(name, Verdict::Fail, format!("nothing within {seconds} s"))
    } else {
        made(
            name,
            Verdict::Skipped,
            "left out by the operator".to_owned(),
        )
    }
}

/// Beats without force until `done` gives something, the operator skips, or patience ends.
fn wait<T>(
    rig: &mut dyn Rig,
    plan: &Plan,
    mut done: impl FnMut(u64, &Look) -> Option<T>,
) -> anyhow::Result<Waited<T>> {
    for ms in 0..plan.patience_ms {
        let look = rig.beat(DVec3::ZERO)?;
        if let Some(found) = done(ms, &look) {
            return Ok(Waited::Came(found));
        }
        if rig.answer().is_some_and(|line| line.trim() == "s") {
            return Ok(Waited::Skipped);
        }
    }
    Ok(Waited::Over)
}

/// Sees when a point keeps still.
#[derive(Default)]
struct Stillness {
    at: Option<DVec3>,
    since: u64,
}

impl Stillness {
    fn look(&mut self, ms: u64, position: DVec3) -> bool {
        let stays = self.at.is_some_and(|at| at.distance(position) < STILL_MM);
        if !stays {
            (self.at, self.since) = (Some(position), ms);
        }
        ms - self.since >= STILL_MS
    }
}

fn undock(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    rig.tell("1/8 take the stylus out of its dock and hold it still in the middle of its workspace (s + Enter skips a step)");
    let mut still = Stillness::default();
    let waited = wait(rig, plan, |ms, look| {
        let rests = still.look(ms, look.position);
        (!look.docked && rests).then_some(look.position)
    })?;
    Ok(match waited {
        Waited::Came(at) => made(
            "dock switch",
            Verdict::Pass,
            format!("opens; held at {:.0} {:.0} {:.0} mm", at.x, at.y, at.z),
        ),
        Waited::Skipped => unfinished("dock switch", false, plan),
        Waited::Over => made(
            "dock switch",
            Verdict::Fail,
            "never opens: check the switch and its wire".to_owned(),
        ),
    })
}

fn right(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    direction(
        rig,
        plan,
        "encoders: right",
        "2/8 move the stylus 40 mm to the right and hold it still",
        DVec3::X,
    )
}

fn up(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    direction(
        rig,
        plan,
        "encoders: up",
        "3/8 move the stylus 40 mm up and hold it still",
        DVec3::Y,
    )
}

fn towards(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    direction(
        rig,
        plan,
        "encoders: towards you",
        "4/8 move the stylus 40 mm towards you and hold it still",
        DVec3::Z,
    )
}

fn direction(
    rig: &mut dyn Rig,
    plan: &Plan,
    name: &'static str,
    what: &str,
    along: DVec3,
) -> anyhow::Result<Step> {
    rig.tell(what);
    let (mut from, mut still) = (None, Stillness::default());
    let waited = wait(rig, plan, |ms, look| {
        let from = *from.get_or_insert(look.position);
        let way = look.position - from;
        (still.look(ms, look.position) && way.length() > MOVED_MM).then_some(way)
    })?;
    let way = match waited {
        Waited::Came(way) => way,
        Waited::Skipped => return Ok(unfinished(name, false, plan)),
        Waited::Over => return Ok(unfinished(name, true, plan)),
    };
    let own = way.dot(along);
    let other = (way - along * own).length();
    let seen = format!("moved {:.0} {:.0} {:.0} mm", way.x, way.y, way.z);
    let mut step = if own > CLEARLY * other {
        made(name, Verdict::Pass, seen)
    } else if -own > CLEARLY * other {
        let remedy = "that is the other way: turn the sense of that joint's encoder round";
        made(name, Verdict::Fail, format!("{seen}; {remedy}"))
    } else {
        let remedy = "that is another way: encoders exchanged, or a wrong count a revolution";
        made(name, Verdict::Fail, format!("{seen}; {remedy}"))
    };
    step.numbers = [("x_mm", way.x), ("y_mm", way.y), ("z_mm", way.z)].into();
    Ok(step)
}

fn buttons(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    const NAME: &str = "buttons";
    for (bit, what) in [
        (1, "5/8 press and let go the front button"),
        (2, "    press and let go the back button"),
    ] {
        rig.tell(what);
        let (mut before, mut pressed) = (None, false);
        let waited = wait(rig, plan, |_, look| {
            let first = *before.get_or_insert(look.buttons);
            if first != 0 && !pressed && look.buttons != 0 {
                return None;
            }
            pressed |= look.buttons == bit;
            match look.buttons {
                0 if pressed => Some(true),
                other if other & !bit != 0 && first == 0 => Some(false),
                _ => None,
            }
        })?;
        match waited {
            Waited::Came(true) => {}
            Waited::Came(false) => {
                let seen = "the other button answers: exchange their wires or bits".to_owned();
                return Ok(made(NAME, Verdict::Fail, seen));
            }
            Waited::Skipped => return Ok(unfinished(NAME, false, plan)),
            Waited::Over => return Ok(unfinished(NAME, true, plan)),
        }
    }
    Ok(made(
        NAME,
        Verdict::Pass,
        "both answer, each by itself".to_owned(),
    ))
}

fn workspace(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    const NAME: &str = "workspace";
    rig.tell("6/8 lead the stylus along all borders of its workspace, 15 s");
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut turned: f64 = 0.0;
    let mut first = None;
    for _ in 0..ROAM_MS.min(plan.patience_ms) {
        let look = rig.beat(DVec3::ZERO)?;
        (low, high) = (low.min(look.position), high.max(look.position));
        let axis = *first.get_or_insert(look.axis);
        turned = turned.max(axis.angle_between(look.axis));
        if rig.answer().is_some_and(|line| line.trim() == "s") {
            return Ok(unfinished(NAME, false, plan));
        }
    }
    let size = high - low;
    let enough = size.cmpge(SHEET_MM * REACHED).all();
    let seen = format!(
        "{:.0} × {:.0} × {:.0} mm reached, the stylus turned by {:.0}°",
        size.x,
        size.y,
        size.z,
        turned.to_degrees()
    );
    let mut step = if enough {
        made(NAME, Verdict::Pass, seen)
    } else {
        let remedy = "below 96 × 72 × 42 mm: reach further, or look for a joint that sticks";
        made(NAME, Verdict::Fail, format!("{seen}; {remedy}"))
    };
    step.numbers = [
        ("x_mm", size.x),
        ("y_mm", size.y),
        ("z_mm", size.z),
        ("turned_rad", turned),
    ]
    .into();
    Ok(step)
}

fn staircase(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    const NAME: &str = "force staircase";
    let what = match plan.against {
        Against::Nothing => {
            let seen = "no spring and no weight: give --spring or --weight".to_owned();
            return Ok(made(NAME, Verdict::Skipped, seen));
        }
        Against::Spring(k) => format!(
            "7/8 tie the stylus to the spring of {k} N/mm, let it hang still, then press Enter"
        ),
        Against::Weight(g) => {
            format!("7/8 hang {g} g on the stylus, let it rest on a soft stop, then press Enter")
        }
    };
    rig.tell(&what);
    for ms in 0.. {
        rig.beat(DVec3::ZERO)?;
        match rig.answer() {
            Some(line) if line.trim() == "s" => return Ok(unfinished(NAME, false, plan)),
            Some(_) => break,
            None if ms >= plan.patience_ms => return Ok(unfinished(NAME, true, plan)),
            None => {}
        }
    }
    let stairs = climb(rig, plan.most_n)?;
    let measured = match plan.against {
        Against::Spring(k) => spring_scale(&stairs, k),
        Against::Weight(g) => weight_scale(&stairs, g * 9.81e-3),
        Against::Nothing => None,
    };
    let Some(scale) = measured else {
        let seen = "the stylus did not follow the force: check the spring or weight, then the motors and their senses";
        return Ok(made(NAME, Verdict::Fail, seen.to_owned()));
    };
    let fine = (scale - 1.0).abs() <= SCALE_ERROR;
    let seen = format!(
        "forces are {scale:.3} of what is commanded, up to {:.1} N",
        plan.most_n
    );
    let mut step = if fine {
        made(NAME, Verdict::Pass, seen)
    } else {
        let remedy = "beyond ±15 %: check torque constant, gears and current limit";
        made(NAME, Verdict::Fail, format!("{seen}; {remedy}"))
    };
    step.numbers = [("scale", scale), ("most_n", plan.most_n)].into();
    Ok(step)
}

/// Up and down again; the force acts upwards.
fn climb(rig: &mut dyn Rig, most_n: f64) -> anyhow::Result<Vec<Stair>> {
    let mut stairs = Vec::new();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few dozen stairs"
    )]
    let top = (most_n / STAIR_N).round() as u32;
    let mut last = 0.0;
    for n in (0..=top).chain((0..top).rev()) {
        let force = f64::from(n) * STAIR_N;
        let mut sum = 0.0;
        for ms in 0..STAIR_MS {
            // no step of the force: the stair is reached in its first 50 ms
            let share = (ms as f64 / 50.0).min(1.0);
            let now = last + (force - last) * share;
            let look = rig.beat(DVec3::Y * now)?;
            if ms >= SETTLED_MS {
                sum += look.position.y;
            }
        }
        last = force;
        stairs.push(Stair {
            force_n: force,
            height_mm: sum / (STAIR_MS - SETTLED_MS) as f64,
        });
    }
    Ok(stairs)
}

fn e_stop(rig: &mut dyn Rig, plan: &Plan) -> anyhow::Result<Step> {
    const NAME: &str = "emergency stop";
    rig.tell("8/8 press the emergency stop");
    let pressed = |look: &Look| look.faults & fault::E_STOP != 0;
    let waited = wait(rig, plan, |_, look| pressed(look).then_some(()))?;
    match waited {
        Waited::Came(()) => {}
        Waited::Skipped => return Ok(unfinished(NAME, false, plan)),
        Waited::Over => return Ok(unfinished(NAME, true, plan)),
    }
    // a command that asks for force all the while
    let mut off_ms = None;
    for ms in 0..200 {
        let look = rig.beat(DVec3::Y * 0.3)?;
        let off = look.drive == DriveState::Fault && look.applied == 0;
        off_ms = if off { off_ms.or(Some(ms)) } else { None };
    }
    let Some(off_ms) = off_ms.filter(|ms| *ms <= E_STOP_MS) else {
        let seen = "torque although it is pressed: do not use this device; look at the amplifiers' enable line";
        return Ok(made(NAME, Verdict::Fail, seen.to_owned()));
    };
    let seen =
        format!("motors off within {off_ms} ms of the state that names it, and they stay off");
    let mut step = made(NAME, Verdict::Pass, seen);
    step.numbers = [("off_ms", off_ms as f64)].into();
    Ok(step)
}
