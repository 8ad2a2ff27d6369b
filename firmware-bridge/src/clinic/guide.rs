//! A task in a running session: the publisher feeds it, what it says goes to stderr.

use super::ClinicError;
use super::session::trace_tick;
use super::target::plan_of;
use super::task::{Mode, Said, Task};
use crate::haptics::record::TickRecord;
use crate::scene::Scene;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use std::path::Path;
use std::sync::Arc;

/// A task and what it watches.
#[derive(Debug)]
pub(crate) struct Guide {
    task: Task,
    bone: Arc<Bone>,
    protected: Vec<u8>,
}

impl Guide {
    /// Refuses a task without a scene, before anything is loaded.
    pub(crate) fn check(mode: Mode, dir: Option<&Path>) -> Result<(), ClinicError> {
        if mode == Mode::Free || dir.is_some() {
            return Ok(());
        }
        Err(ClinicError::Plan(
            "--task guided and --task exam need a plan; give --scene DIR with one".to_owned(),
        ))
    }

    /// The task of a scene's plan; `None` in free mode.
    pub(crate) fn new(
        mode: Mode,
        dir: Option<&Path>,
        scene: &Scene,
    ) -> Result<Option<Self>, ClinicError> {
        Self::check(mode, dir)?;
        let Some(dir) = dir.filter(|_| mode != Mode::Free) else {
            return Ok(None);
        };
        let plan = plan_of(dir)?;
        let bone_from_component = scene
            .bone
            .lps_from_bone()
            .inverse()
            .then(&plan.lps_from_component());
        Ok(Some(Self {
            task: Task::new(mode, &plan.component()?, &bone_from_component),
            bone: Arc::clone(&scene.bone),
            protected: scene.protected_labels.clone(),
        }))
    }

    /// Takes a tick, with the cut as the publisher has it.
    pub(crate) fn tick(&mut self, tick: &TickRecord, cut: &Cut) -> Option<Said> {
        let by_label = &cut.totals().by_label;
        let units: i64 = self
            .protected
            .iter()
            .map(|&l| by_label[usize::from(l)])
            .sum();
        let protected_mm3 = Cut::mm3(self.bone.grid(), units);
        self.task.tick(&trace_tick(&self.bone, tick), protected_mm3)
    }
}
