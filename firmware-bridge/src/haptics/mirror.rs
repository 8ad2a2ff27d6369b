//! The publisher's own copy of the cut: it carves what the servo carved, so that the servo copies no
//! voxels.

use super::record::{COPY_VALUES, Record};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::{Cut, journal_bricks};
use osteon_sim_core::grid::BRICKS_PER_CHUNK;
use osteon_sim_core::merge::{CopyPlace, merge};
use osteon_sim_core::tissue::TISSUES;
use osteon_sim_core::tool::Tool;
use std::sync::Arc;

/// Bricks of the journal beyond the servo's: the mirror carves a step whole that the servo may still be
/// at, and must not give up a checkpoint before the servo does.
const AHEAD: usize = 8192;

/// The mirror.
#[derive(Debug)]
pub(crate) struct Mirror {
    pub bone: Arc<Bone>,
    pub cut: Cut,
    tools: Vec<Tool>,
}

impl Mirror {
    pub(crate) fn new(bone: Arc<Bone>, tools: Vec<Tool>) -> Self {
        Self {
            cut: Cut::with_journal(&bone, journal_bricks(&bone) + AHEAD),
            bone,
            tools,
        }
    }

    /// Takes over one record; `changed(chunk, brick)` is called for every brick that it changed.
    pub(crate) fn apply(&mut self, record: &Record, changed: &mut impl FnMut(usize, usize)) {
        match record {
            Record::Carved { step, .. } => self.carve(step, changed),
            Record::Reset { epoch } => self.cut.reset(*epoch),
            Record::Checkpoint { id } => {
                self.cut.checkpoint_as(*id);
            }
            Record::Undone { id, epoch } => {
                // one that is not here was never told: the digests at the end would show it
                if !self.cut.undo_to(*id, *epoch, changed) {
                    self.cut.reset(*epoch);
                }
            }
            Record::Brick(copy) => {
                let place = CopyPlace {
                    chunk: copy.chunk as usize,
                    brick: usize::from(copy.brick),
                    first: usize::from(copy.part) * COPY_VALUES,
                    tool: copy.tool,
                };
                if merge(&self.bone, &mut self.cut, place, &copy.values) {
                    changed(place.chunk, place.brick);
                }
            }
            Record::Tick(tick) => {
                // after lost records the servo's count of steps that began is the true one; a step
                // that it still carves is whole here
                if tick.epoch == self.cut.epoch() {
                    self.cut.set_revision(tick.revision);
                }
            }
        }
    }

    /// mm³ removed since the last reset, less what was undone.
    pub(crate) fn removed_mm3_by_class(&self) -> [f64; TISSUES] {
        let grid = self.bone.grid();
        let units = self.cut.totals().by_class;
        units.map(|units| Cut::mm3(grid, units))
    }

    /// Takes over the whole cut of a servo that has stopped while bricks were still owed.
    pub(crate) fn catch_up(
        &mut self,
        truth: &Cut,
        tool: u8,
        changed: &mut impl FnMut(usize, usize),
    ) {
        if truth.epoch() != self.cut.epoch() {
            self.cut.reset(truth.epoch());
        }
        for chunk in 0..self.bone.chunk_count() {
            for brick in 0..BRICKS_PER_CHUNK {
                let place = CopyPlace {
                    chunk,
                    brick,
                    first: 0,
                    tool,
                };
                let values = truth.brick(chunk, brick);
                if values.is_some_and(|v| merge(&self.bone, &mut self.cut, place, v)) {
                    changed(chunk, brick);
                }
            }
        }
        self.cut.set_revision(truth.revision());
    }

    fn carve(&mut self, step: &CarveStep, changed: &mut impl FnMut(usize, usize)) {
        if let Some(tool) = self.tools.get(usize::from(step.tool)) {
            carve(&self.bone, &mut self.cut, tool, step, changed);
        }
    }
}
