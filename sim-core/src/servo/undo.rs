//! Reset, checkpoints and undo, in the servo's step.

use super::{CutEvent, Servo};

impl Servo {
    /// Takes the checkpoint that is wanted, where the cut is whole: no step is pending, no undo under way.
    pub(super) fn take_checkpoint(&mut self) {
        if !self.checkpoint_wanted || self.carry.is_pending() || self.cut.is_undoing() {
            return;
        }
        self.checkpoint_wanted = false;
        if let Some(id) = self.cut.checkpoint() {
            self.events.push(CutEvent::Checkpoint { id });
        }
    }

    /// Back to the uncut bone, without checkpoints.
    pub(super) fn reset(&mut self) {
        self.carry.forget();
        self.checkpoint_wanted = false;
        let epoch = self.cut.epoch().wrapping_add(1);
        self.cut.reset(epoch);
        self.events.push(CutEvent::Reset { epoch });
        self.start_over();
    }

    /// Back to the newest checkpoint: what is pending belongs to a cut that is gone.
    pub(super) fn undo(&mut self) {
        // a checkpoint that still waits is gone back to by not taking it: nothing was begun since
        if core::mem::take(&mut self.checkpoint_wanted) {
            return;
        }
        let epoch = self.cut.epoch().wrapping_add(1);
        if let Some(id) = self.cut.undo(epoch) {
            self.carry.forget();
            self.events.push(CutEvent::Undone { id, epoch });
            self.start_over();
        }
    }
}
