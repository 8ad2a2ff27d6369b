//! A scene with its plan: all that a session is judged by.

use super::ClinicError;
use super::plan_file::PlanFile;
use crate::scene::{Scene, SceneArgs, file, load};
use glam::DVec3;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::metrics::Metric;
use osteon_sim_core::metrics::result::{Case, metrics};
use osteon_sim_core::planning::component::Component;
use osteon_sim_core::planning::perform::perform;
use osteon_sim_core::planning::scapula::Scapula;
use osteon_sim_core::pose::Pose;
use std::path::Path;

/// The plan of a scene.
pub fn plan_of(dir: &Path) -> Result<PlanFile, ClinicError> {
    if let Some((_, text)) = file::built_in(dir) {
        return PlanFile::parse(dir, text);
    }
    let folder = file::path_in(dir);
    PlanFile::read(&folder.parent().unwrap_or(dir).join(file::PLAN))
}

/// A scene with its plan.
#[derive(Debug)]
pub struct Target {
    /// The bone.
    pub scene: Scene,
    /// The plan.
    pub plan: PlanFile,
    /// Its component.
    pub component: Component,
    /// Its scapula.
    pub scapula: Scapula,
    /// The seated component's frame.
    pub bone_from_component: Pose,
    /// What the plan removes.
    pub planned: Cut,
}

impl Target {
    /// Loads the scene `dir` with its plan.
    pub fn load(dir: &Path, progress: &mut dyn FnMut(&str, f32)) -> Result<Self, ClinicError> {
        let args = SceneArgs {
            scene: Some(dir.to_path_buf()),
            ..SceneArgs::default()
        };
        let scene = load(&args, progress)?;
        Self::of(scene, plan_of(dir)?)
    }

    /// A scene and a plan that are there already.
    pub fn of(scene: Scene, plan: PlanFile) -> Result<Self, ClinicError> {
        let component = plan.component()?;
        let scapula = plan.scapula()?;
        let bone_from_lps = scene.bone.lps_from_bone().inverse();
        let bone_from_component = bone_from_lps.then(&plan.lps_from_component());
        let planned = perform(&scene.bone, &component, &bone_from_component);
        Ok(Self {
            scene,
            plan,
            component,
            scapula,
            bone_from_component,
            planned,
        })
    }

    /// The result's metrics of a cut. `tool_axis` is the reamer's recorded axis at its deepest, bone frame.
    pub fn judge(&self, cut: &Cut, tool_axis: Option<DVec3>) -> Vec<Metric> {
        metrics(&Case {
            bone: &self.scene.bone,
            cut,
            planned: &self.planned,
            bone_from_plan: &self.bone_from_component,
            component: &self.component,
            native_mm: self.plan.depth_mm,
            scapula: Some(&self.scapula),
            protected: &self.scene.protected_labels,
            tool_axis,
        })
    }
}
