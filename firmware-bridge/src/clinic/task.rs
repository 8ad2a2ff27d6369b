//! The guided task: a hole for each peg that the drill fits, then reaming, as steps with goals, hints and stop
//! conditions. A pure machine over ticks: fed live or from a recording it says the same.

use glam::DVec3;
use osteon_sim_core::metrics::trace::TraceTick;
use osteon_sim_core::planning::component::Component;
use osteon_sim_core::pose::Pose;
use serde::Serialize;

/// How a session is led.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Nothing is said or stopped.
    #[default]
    Free,
    /// Steps with hints.
    Guided,
    /// Steps without hints, against the clock.
    Exam,
}

/// Time for an exam, s.
pub const EXAM_S: f64 = 300.0;
/// A depth within this of its goal is reached, mm.
const DEPTH_MM: f64 = 0.5;
/// Deeper than the goal by this is a failure, mm.
const TOO_DEEP_MM: f64 = 2.0;
/// An axis farther off than this earns a hint, degrees.
const AXIS_DEG: f64 = 4.0;
/// An entry farther off than this earns a hint, mm.
const ENTRY_MM: f64 = 2.0;
/// The tip is at the bone below this height over a step's entry, mm.
const NEAR_MM: f64 = 8.0;
/// In front of the joint: as near to the plan's axis as this, mm.
const GATE_MM: f64 = 30.0;
/// A hint is not said again before this time, s.
const AGAIN_S: f64 = 4.0;
/// The smallest hole that the built-in drill cannot make is this much narrower or wider, mm.
const FITS_MM: f64 = 0.5;
/// Diameter of the built-in drill, mm.
const DRILL_MM: f64 = 8.0;

/// A step of the task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    /// What to do.
    pub name: String,
    /// Index of the tool.
    pub tool: u8,
    /// Where the tool's tip goes in, plan frame, mm.
    pub at_mm: [f64; 2],
    /// How far below the planned back's middle, mm.
    pub depth_mm: f64,
}

/// Something to say.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Said {
    /// Seconds since the first tick.
    pub at_s: f64,
    /// What.
    pub kind: SaidKind,
    /// In words.
    pub text: String,
}

/// What is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SaidKind {
    /// Advice.
    Hint,
    /// A step is done.
    Done,
    /// The task is over and lost.
    Stop,
}

/// The task's state.
#[derive(Debug, Clone)]
pub struct Task {
    mode: Mode,
    steps: Vec<Step>,
    plan_from_bone: Pose,
    protected_mm3: f64,
    now: usize,
    over: bool,
    deepest_mm: f64,
    // the tool has been in front of the joint: on its way from the dock it passes through the virtual patient
    in_front: bool,
    began_tick: Option<u64>,
    last_hint_s: f64,
}

/// The steps of a plan.
pub fn steps(component: &Component) -> Vec<Step> {
    let pegs = component.pegs.iter().enumerate();
    let mut all: Vec<Step> = pegs
        .filter(|(_, peg)| (peg.diameter_mm - DRILL_MM).abs() <= FITS_MM)
        .map(|(n, peg)| Step {
            name: format!("Drill the hole of peg {}", n + 1),
            tool: 0,
            at_mm: peg.at_mm,
            depth_mm: peg.length_mm,
        })
        .collect();
    all.push(Step {
        name: "Ream the face".to_owned(),
        tool: 1,
        at_mm: [0.0, 0.0],
        depth_mm: 0.0,
    });
    all
}

impl Task {
    /// A task for a plan.
    pub fn new(mode: Mode, component: &Component, bone_from_component: &Pose) -> Self {
        Self::of(mode, steps(component), bone_from_component.inverse())
    }

    /// A task of steps.
    pub fn of(mode: Mode, steps: Vec<Step>, plan_from_bone: Pose) -> Self {
        Self {
            mode,
            steps,
            plan_from_bone,
            protected_mm3: 0.0,
            now: 0,
            over: false,
            deepest_mm: f64::INFINITY,
            in_front: false,
            began_tick: None,
            last_hint_s: f64::NEG_INFINITY,
        }
    }

    /// The steps.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// True when every step is done or the task was stopped.
    pub fn over(&self) -> bool {
        self.over
    }

    /// True where every step is done.
    pub fn done(&self) -> bool {
        self.now == self.steps.len()
    }

    /// Takes a tick; `protected_mm3` is what has been removed of protected bone so far.
    pub fn tick(&mut self, tick: &TraceTick, protected_mm3: f64) -> Option<Said> {
        let began = *self.began_tick.get_or_insert(tick.tick);
        let at_s = tick.tick.saturating_sub(began) as f64 * 0.001;
        if self.mode == Mode::Free || self.over {
            return None;
        }
        let said = |kind, text: String| Some(Said { at_s, kind, text });
        if protected_mm3 > self.protected_mm3 + 1.0 {
            self.over = true;
            return said(SaidKind::Stop, "protected bone was cut".to_owned());
        }
        if self.mode == Mode::Exam && at_s > EXAM_S {
            self.over = true;
            return said(SaidKind::Stop, format!("{EXAM_S} s are over"));
        }
        let step = self.steps.get(self.now)?.clone();
        let p = self.plan_from_bone.point(tick.tip());
        self.in_front |= p.z > NEAR_MM && p.truncate().length() < GATE_MM;
        if self.in_front && tick.tool == step.tool {
            self.deepest_mm = self.deepest_mm.min(p.z);
        }
        let over_goal = self.deepest_mm + step.depth_mm;
        if over_goal < -TOO_DEEP_MM {
            self.over = true;
            return said(
                SaidKind::Stop,
                format!("{}: {:.1} mm deeper than planned", step.name, -over_goal),
            );
        }
        // done once the depth is reached and the tool has been drawn back
        if over_goal <= DEPTH_MM && p.z > NEAR_MM {
            self.now += 1;
            self.deepest_mm = f64::INFINITY;
            self.last_hint_s = f64::NEG_INFINITY;
            self.over = self.done();
            let next = self.steps.get(self.now).map_or_else(
                || "all steps done".to_owned(),
                |s| format!("next: {}", s.name),
            );
            return said(SaidKind::Done, format!("{} done; {next}", step.name));
        }
        if self.in_front && self.mode == Mode::Guided && at_s >= self.last_hint_s + AGAIN_S {
            let hint = self.hint(&step, tick, p, over_goal)?;
            self.last_hint_s = at_s;
            return said(SaidKind::Hint, hint);
        }
        None
    }

    /// What would help now, if anything.
    fn hint(&self, step: &Step, tick: &TraceTick, p: DVec3, over_goal: f64) -> Option<String> {
        if tick.tool != step.tool {
            let tool = if step.tool == 0 { "drill" } else { "reamer" };
            return Some(format!("{}: take the {tool} (button 2)", step.name));
        }
        if p.z > NEAR_MM {
            return None;
        }
        if !tick.spindle_on {
            return Some("switch the spindle on (button 1)".to_owned());
        }
        let axis = self.plan_from_bone.vector(tick.axis());
        let off = libm::atan2(axis.truncate().length(), axis.z).to_degrees();
        if off > AXIS_DEG {
            return Some(format!(
                "the axis is {off:.0}° off the plan: {}",
                tilt(axis)
            ));
        }
        let aside = p.truncate() - glam::DVec2::from_array(step.at_mm);
        // a drill's place counts where it goes in
        let entering = step.tool != 0 || p.z > -2.0;
        if entering && aside.length() > ENTRY_MM {
            return Some(format!("{:.0} mm beside the planned place", aside.length()));
        }
        if over_goal <= DEPTH_MM {
            return Some(format!("{}: depth reached, draw back", step.name));
        }
        Some(format!("{over_goal:.1} mm to go"))
    }
}

/// Which way the handle is to go.
fn tilt(axis: DVec3) -> &'static str {
    if axis.x.abs() > axis.y.abs() {
        if axis.x > 0.0 {
            "handle towards the plan's -x"
        } else {
            "handle towards the plan's +x"
        }
    } else if axis.y > 0.0 {
        "handle down"
    } else {
        "handle up"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use osteon_sim_core::tissue::TISSUES;

    fn tick(n: u64, z: f64, tool: u8, spindle_on: bool, turn: DQuat) -> TraceTick {
        TraceTick {
            tick: n,
            bone_from_tool: Pose::new(turn, DVec3::new(0.0, 0.0, z)),
            shown_n: DVec3::ZERO,
            physical_n: 0.0,
            tool,
            spindle_on,
            removed_mm3: [0.0; TISSUES],
        }
    }

    fn two() -> Vec<Step> {
        let step = |name: &str, tool, depth_mm| Step {
            name: name.to_owned(),
            tool,
            at_mm: [0.0; 2],
            depth_mm,
        };
        vec![step("Drill", 0, 18.0), step("Ream", 1, 0.0)]
    }

    /// Goes down to a depth and back with a tool; all that is said.
    fn plunge(task: &mut Task, from: u64, tool: u8, depth: f64) -> Vec<Said> {
        let down = (0..=300).map(|n| 12.0 - (12.0 + depth) * f64::from(n) / 300.0);
        let up = down.clone().rev().collect::<Vec<_>>();
        down.chain(up)
            .zip(from..)
            .filter_map(|(z, n)| task.tick(&tick(n, z, tool, true, DQuat::IDENTITY), 0.0))
            .collect()
    }

    #[test]
    fn steps_are_done_in_their_order_and_in_exam_nothing_else_is_said() {
        let mut task = Task::of(Mode::Exam, two(), Pose::IDENTITY);
        let said = plunge(&mut task, 0, 0, 17.8);
        assert_eq!(said.len(), 1);
        assert_eq!(said[0].kind, SaidKind::Done);
        assert!(said[0].text.contains("next: Ream"), "{}", said[0].text);
        let said = plunge(&mut task, 1000, 1, 0.3);
        assert_eq!(said.len(), 1);
        assert!(task.done() && task.over());
    }

    #[test]
    fn hints_name_the_tool_the_spindle_the_axis_and_the_depth() {
        let hint = |tool, spindle, z, turn| {
            let mut task = Task::of(Mode::Guided, two(), Pose::IDENTITY);
            task.in_front = true;
            task.tick(&tick(0, z, tool, spindle, turn), 0.0)
                .map(|s| s.text)
        };
        let straight = DQuat::IDENTITY;
        assert!(
            hint(1, true, 20.0, straight)
                .expect("a hint")
                .contains("take the drill")
        );
        assert!(
            hint(0, false, 3.0, straight)
                .expect("a hint")
                .contains("spindle")
        );
        let off = DQuat::from_rotation_y(0.2);
        assert!(hint(0, true, 3.0, off).expect("a hint").contains("11° off"));
        assert!(
            hint(0, true, -10.0, straight)
                .expect("a hint")
                .contains("8.0 mm to go")
        );
        assert_eq!(hint(0, true, 20.0, straight), None);
        let mut free = Task::of(Mode::Free, two(), Pose::IDENTITY);
        assert_eq!(free.tick(&tick(0, -30.0, 0, true, straight), 99.0), None);
    }

    #[test]
    fn the_way_from_the_dock_through_the_virtual_patient_does_not_count() {
        let mut task = Task::of(Mode::Guided, two(), Pose::IDENTITY);
        for n in 0..200u32 {
            let z = -85.0 + 0.5 * f64::from(n);
            let said = task.tick(&tick(u64::from(n), z, 0, true, DQuat::IDENTITY), 0.0);
            assert_eq!(said, None, "{z}");
        }
        assert!(!task.over());
    }

    #[test]
    fn too_deep_protected_bone_and_the_clock_stop_the_task() {
        let mut task = Task::of(Mode::Guided, two(), Pose::IDENTITY);
        let said = plunge(&mut task, 0, 0, 21.0);
        assert!(
            said.iter()
                .any(|s| s.kind == SaidKind::Stop && s.text.contains("deeper"))
        );
        assert!(task.over() && !task.done());
        let mut task = Task::of(Mode::Exam, two(), Pose::IDENTITY);
        let z = tick(0, 20.0, 0, true, DQuat::IDENTITY);
        assert_eq!(task.tick(&z, 0.5), None);
        assert!(
            task.tick(&z, 1.5)
                .expect("stopped")
                .text
                .contains("protected")
        );
        let mut task = Task::of(Mode::Exam, two(), Pose::IDENTITY);
        assert_eq!(task.tick(&z, 0.0), None);
        let late = tick(300_001, 20.0, 0, true, DQuat::IDENTITY);
        assert_eq!(task.tick(&late, 0.0).expect("stopped").kind, SaidKind::Stop);
    }
}
