//! What a demonstration is going to do, worked out before anything starts.

use super::DemoArgs;
use super::stroke::{drill_and_ream, press};
use crate::clinic::session::stroke_to;
use crate::clinic::target::plan_of;
use crate::fake::Stroke;
use crate::feel;
use crate::passage::{Layers, expected_s};
use crate::progress::Progress;
use crate::scene::{self, Scene};
use crate::tools::{self, Detail};

/// Time before the tool touches bone and after it leaves it, s: a session's length less this is the
/// longest press.
const AROUND_S: f64 = 8.0;
/// Longest press, s.
const LONGEST_S: f64 = 25.0;

/// The hand's stroke, and what is expected of it.
#[derive(Debug)]
pub(crate) struct Plan {
    pub stroke: Stroke,
    pub push: Option<Push>,
}

/// The stroke for a scene whose plan has a component; `None` for a bare one.
fn planned_stroke(args: &DemoArgs, scene: &Scene) -> Option<Stroke> {
    let dir = args
        .scene
        .scene
        .as_deref()
        .filter(|_| args.scene.pose.is_none())?;
    let plan = plan_of(dir).ok()?;
    let component = plan.component().ok()?;
    let bone_from_lps = scene.bone.lps_from_bone().inverse();
    let goal = bone_from_lps.then(&plan.lps_from_component());
    Some(stroke_to(scene, &component, &goal))
}

/// A press with a constant force.
#[derive(Debug)]
pub(crate) struct Push {
    /// At the stylus, N.
    pub newtons: f64,
    /// The pressed tool's id.
    pub tool: String,
    /// Time through each layer by the cutting law alone, s; `None` where it does not come through.
    pub expected_s: Vec<Option<f64>>,
}

impl Plan {
    pub(crate) fn new(args: &DemoArgs) -> anyhow::Result<Self> {
        let feel = feel::load(&args.feel)?;
        let tools = tools::load(&args.tools, Detail::Elements)?.tools;
        let mut progress = Progress::new("planning");
        let scene = scene::load(&args.scene, &mut |stage, share| progress.show(stage, share))?;
        progress.finish();
        let Some(newtons) = args.push else {
            let stroke = match planned_stroke(args, &scene) {
                Some(stroke) => stroke,
                None => drill_and_ream(&scene, &tools)?,
            };
            return Ok(Self { stroke, push: None });
        };
        let (bone, bone_from_plan) = (&scene.bone, &scene.bone_from_plan);
        let layers = Layers::along(bone, bone_from_plan);
        let seconds = (args.seconds() - AROUND_S).clamp(1.0, LONGEST_S);
        // the stylus goes on before the tool by what the coupling gives
        let depth_mm = layers.end_mm() + newtons / feel.coupling.stiffness_n_per_mm;
        let (stroke, tool) = press(&scene, &tools, [newtons, depth_mm, seconds])?;
        let expected_s = expected_s(bone, bone_from_plan, &layers, tool, &feel, newtons);
        let push = Push {
            newtons,
            tool: tool.id.clone(),
            expected_s,
        };
        Ok(Self {
            stroke,
            push: Some(push),
        })
    }
}
