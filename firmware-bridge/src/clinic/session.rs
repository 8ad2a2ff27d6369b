//! A session as the judge sees it: what each tick was, and the cut at its end.

use crate::bench::world::{Lab, World};
use crate::fake::device::DeviceSetup;
use crate::fake::{Segment, Stroke};
use crate::haptics::record::TickRecord;
use anyhow::bail;
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::metrics::trace::{SessionTrace, TraceTick};
use osteon_sim_core::planning::component::Component;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::register::{WORKSPACE_CENTRE_MM, bone_from_base};
use osteon_sim_core::tool::Tool;

use super::target::Target;
use crate::scene::Scene;

/// Height over the back from which each tool comes, mm.
const APPROACH_MM: f64 = 22.0;
/// Longest session of a scripted hand, s.
const MOST_S: f64 = 120.0;

/// A session that has been played.
#[derive(Debug)]
pub struct Played {
    /// What each tick was.
    pub trace: SessionTrace,
    /// What was cut in the end.
    pub cut: Cut,
}

/// A tick of the servo's loop as the judge takes it.
pub(crate) fn trace_tick(bone: &Bone, tick: &TickRecord) -> TraceTick {
    let grid = bone.grid();
    TraceTick {
        tick: tick.tick,
        bone_from_tool: tick.bone_from_tool,
        shown_n: tick.force_n,
        physical_n: tick.felt.physical_force_n,
        tool: tick.tool,
        spindle_on: tick.flags.spindle_on,
        removed_mm3: tick.removed_by_class.map(|units| Cut::mm3(grid, units)),
    }
}

/// What the scripted hand does for a plan: drill the central peg's hole, change the tool, ream, let go; the
/// component's frame put at `plan_from_goal` (identity: as planned). The device's base is registered with its z
/// along the plan's axis. Further pegs are drilled with the same drill where they have its diameter.
pub fn stroke(target: &Target, plan_from_goal: &Pose) -> Stroke {
    let bone_from_goal = target.bone_from_component.then(plan_from_goal);
    stroke_to(&target.scene, &target.component, &bone_from_goal)
}

/// The same for a component's frame.
pub(crate) fn stroke_to(scene: &Scene, component: &Component, bone_from_goal: &Pose) -> Stroke {
    let base_from_bone =
        bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()).inverse();
    let base_from_goal = base_from_bone.then(bone_from_goal);
    let axis = base_from_goal.vector(DVec3::Z);
    let at = |name: &str, x: f64, y: f64, z: f64, speed: f64, timeout_s: f64| Segment {
        name: name.to_owned(),
        goal_mm: base_from_goal.point(DVec3::new(x, y, z)).to_array(),
        axis: axis.to_array(),
        speed_mm_s: speed,
        max_push_n: 2.5,
        press: None,
        dwell_s: 0.1,
        timeout_s,
    };
    let pressing = |segment: Segment, button: u8| Segment {
        press: Some(button),
        ..segment
    };
    let lead = DVec3::new(0.0, -20.0, 60.0) + WORKSPACE_CENTRE_MM;
    let mut leave = at("leave the dock", 0.0, 0.0, APPROACH_MM, 130.0, 4.0);
    (leave.goal_mm, leave.axis) = (lead.to_array(), [0.0, 0.0, 1.0]);
    let mut segments = vec![
        leave,
        pressing(at("before the joint", 0.0, 0.0, APPROACH_MM, 100.0, 3.0), 1),
    ];
    if let Some(peg) = component.pegs.first() {
        let [x, y] = peg.at_mm;
        segments.extend([
            at("drill: approach", x, y, 6.0, 25.0, 3.0),
            at("drill", x, y, -peg.length_mm, 4.0, 12.0),
            at("drill: withdraw", x, y, APPROACH_MM, 40.0, 3.0),
        ]);
    }
    segments.extend([
        pressing(at("change the tool", 0.0, 0.0, APPROACH_MM, 40.0, 3.0), 2),
        at("ream: approach", 0.0, 0.0, 5.0, 25.0, 3.0),
        Segment {
            dwell_s: 0.8,
            ..at("ream", 0.0, 0.0, 0.0, 1.0, 14.0)
        },
        pressing(at("ream: withdraw", 0.0, 0.0, APPROACH_MM, 40.0, 3.0), 1),
    ]);
    Stroke { segments }
}

/// Plays a stroke in lockstep with the simulated device: faster than real time, the same bits every time.
pub fn play(
    target: &Target,
    tools: &[Tool],
    feel: &Feel,
    stroke: Stroke,
) -> anyhow::Result<Played> {
    let lab = Lab::with(target.scene.clone(), tools.to_vec(), feel)?;
    let mut world = World::new(&lab, DeviceSetup::new(stroke, 7), 0, 0);
    world.keep_ticks();
    let bone = &target.scene.bone;
    let mut trace = SessionTrace {
        ticks: Vec::new(),
        tools: tools
            .iter()
            .map(|t| (t.id.clone(), t.name.clone()))
            .collect(),
    };
    while world.now_ns() as f64 * 1e-9 < MOST_S && !world.device().hand_done() {
        world.tick();
        trace
            .ticks
            .extend(world.kept_ticks().iter().map(|t| trace_tick(bone, t)));
        if let Some(why) = world.over() {
            bail!("the scripted session ended early: {why}");
        }
    }
    Ok(Played {
        trace,
        cut: world.cut(),
    })
}

/// The reamer's axis where it was deepest in the bone along the plan's axis, bone frame: of the last tool used.
pub fn tool_axis(trace: &SessionTrace, bone_from_plan: &Pose) -> Option<DVec3> {
    let plan_from_bone = bone_from_plan.inverse();
    let (_, ticks) = trace.uses().pop()?;
    ticks
        .iter()
        .min_by(|a, b| {
            let z = |t: &TraceTick| plan_from_bone.point(t.tip()).z;
            z(a).total_cmp(&z(b))
        })
        .map(TraceTick::axis)
}
