//! The simulated device `fake-omni`: a separate process with its own clock behind a serial pty.
//!
//! * [`osteon_protocol::firmware`]: the drive, the same that a microcontroller would run.
//! * [`plant`]: the arm. [`hand`]: who holds it. [`stroke`]: what the hand is to do.
//! * [`device`]: the three together, in device time. [`faults`]: what goes wrong with them on purpose.
//! * [`cable`]: a pty ([`port`]) or packets on a socket; [`hfab`]: an arm that speaks text lines instead.
//!   [`raw`]: the stock Omni's payload of the same state. [`truth`]: the ground truth file. [`mod@run`]: the process.

pub mod cable;
pub mod device;
mod disturb;
pub mod faults;
pub mod hand;
pub mod hfab;
pub mod plant;
pub mod port;
pub mod pots;
pub mod random;
pub mod raw;
pub mod run;
pub mod stroke;
pub mod truth;

pub use run::{FakeArgs, run};
pub use stroke::{Segment, Stroke};
