//! The one carved step that a tick's budget did not reach, carried over to the next ticks.
//!
//! The budget is counted in units of work, never in time: a replay on another machine carves the same
//! parts of the same steps in the same ticks.

use crate::bone::Bone;
use crate::carve::{CarveStep, Carving, Progress, Work};
use crate::cut::Cut;
use crate::tool::Tool;

/// Units of work ([`Carving::carve_some`]: one is a line of voxels written) that a tick may carve: a bound
/// on the work, not on the time. The last chunk begun may overdraw it, by 1,177 units at most
/// (a tool of triangles by ten times that), and by 512 more after a checkpoint.
pub const TICK_WORK: i64 = 12_288;

/// What is left of a step, and of the tick's budget.
#[derive(Debug, Clone, Copy, Default)]
pub struct Carry {
    pending: Option<(CarveStep, Progress)>,
    granted: i64,
    left: i64,
}

impl Carry {
    /// A new tick: what it may spend.
    pub fn grant(&mut self, units: i64) {
        self.granted = units;
        self.left = units;
    }

    /// What the tick has spent so far.
    pub fn spent(&self) -> u32 {
        u32::try_from(self.granted - self.left).unwrap_or(u32::MAX)
    }

    /// Whether a step is not carved to its end. Until it is, none may [`Self::begin`].
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Drops what is left: the cut that it belonged to is gone.
    pub fn forget(&mut self) {
        self.pending = None;
    }

    /// Restores what an undo has left, as far as the budget reaches.
    pub fn undo(&mut self, cut: &mut Cut) {
        cut.go_on_undoing(&mut self.left, &mut |_, _| {});
    }

    /// Takes up a step and carves it as far as the budget reaches.
    pub fn begin(&mut self, bone: &Bone, cut: &mut Cut, tools: &[Tool], step: CarveStep) {
        self.pending = Some((step, Progress::default()));
        self.go_on(bone, cut, tools);
    }

    /// Carves on as far as the budget reaches.
    pub fn go_on(&mut self, bone: &Bone, cut: &mut Cut, tools: &[Tool]) {
        let Some((step, progress)) = &mut self.pending else {
            return;
        };
        let done = if let Some(tool) = tools.get(usize::from(step.tool)) {
            let mut work = Work {
                bone,
                cut,
                changed: &mut |_, _| {},
            };
            Carving::best().carve_some(&mut work, tool, step, (progress, &mut self.left))
        } else {
            // a step that was begun counts, whatever became of it
            cut.bump_revision();
            true
        };
        if done {
            self.pending = None;
        }
    }

    /// Carves to the end, whatever it costs.
    pub fn finish(&mut self, bone: &Bone, cut: &mut Cut, tools: &[Tool]) {
        self.grant(i64::MAX);
        self.undo(cut);
        self.go_on(bone, cut, tools);
        self.grant(0);
    }
}
