//! The bone that is drawn.

use crate::scenes::bones::scapula;
use anyhow::Result;
use glam::DVec3;
use osteon_firmware_bridge::scene::{self, SceneArgs};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::sync::Arc;

/// A bone with its plan.
#[derive(Debug)]
pub(super) struct Scene {
    pub(super) name: &'static str,
    pub(super) bone: Bone,
    pub(super) plan: Pose,
    pub(super) tools: Vec<Tool>,
}

/// The patient's scapula at the CT's own spacing; the built-in one, coarse or where the data are missing.
pub(super) fn load(quick: bool) -> Result<Scene> {
    if !quick && let Some(folder) = crate::data("drawing the patient's scapula") {
        let args = SceneArgs {
            bone: Some(folder.join("right_shoulder_ct.nii.gz")),
            labels: Some(folder.join("right_shoulder_labels.nii.gz")),
            keep: vec![1],
            pose: Some(folder.join("right_glenoid_pose.json")),
            threshold: 120.0,
            ..SceneArgs::default()
        };
        let scene = scene::load(&args, &mut |_, _| {})?;
        return Ok(Scene {
            name: "patient's scapula",
            bone: Arc::unwrap_or_clone(scene.bone),
            plan: scene.bone_from_plan,
            tools: Tool::standard_set(),
        });
    }
    let built = scapula(if quick { 1.5 } else { 0.5 }, 1.0)?;
    Ok(Scene {
        name: "built-in scapula",
        bone: built.bone,
        plan: built.bone_from_plan,
        tools: Tool::standard_set(),
    })
}

impl Scene {
    /// In words, for a document.
    pub(super) fn words(&self) -> String {
        let h = self.bone.grid().spacing_mm;
        format!(
            "{}, voxels of {:.3} × {:.3} × {:.3} mm, {} chunks of 32³ with bone",
            self.name,
            h.x,
            h.y,
            h.z,
            self.bone.chunk_count()
        )
    }

    /// The tool at a depth along the plan, mm past the joint face.
    fn at(&self, depth_mm: f64) -> Pose {
        Pose::new(self.plan.rotation, self.plan.point(DVec3::Z * -depth_mm))
    }

    /// A step of a tool along the plan, from one depth to another.
    pub(super) fn step(&self, from_mm: f64, to_mm: f64) -> CarveStep {
        CarveStep {
            tool: 0,
            before: self.at(from_mm),
            after: self.at(to_mm),
        }
    }

    /// A peg hole of 12 mm and a face reamed 1 mm deep.
    pub(super) fn operated(&self) -> Cut {
        let mut cut = Cut::new(&self.bone);
        for (tool, depth) in self.tools.iter().zip([12.0, 1.0]) {
            for n in 0..80 {
                let at = |n: i32| -4.0 + (4.0 + depth) * f64::from(n) / 80.0;
                let step = self.step(at(n), at(n + 1));
                carve(&self.bone, &mut cut, tool, &step, &mut |_, _| {});
            }
        }
        cut
    }
}
