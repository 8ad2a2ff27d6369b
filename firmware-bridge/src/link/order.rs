//! The order of commands. The drive of the open protocol refuses a command that is not newer than the last
//! one; other devices know no order, and a cable that keeps only the newest of two must not be given an old
//! one.

use osteon_protocol::device::CommandFrame;
use osteon_protocol::frame::is_newer;

/// Refuses what is not newer than before.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Order {
    newest: Option<u16>,
}

impl Order {
    /// Whether `command` may go out. One without torque always may: it is the way out.
    pub(super) fn admits(&mut self, command: CommandFrame) -> bool {
        let newer = self.newest.is_none_or(|last| is_newer(command.seq, last));
        if newer {
            self.newest = Some(command.seq);
        }
        newer || !command.enable
    }
}
