//! Recording a session: everything that goes into the servo's pure step, and enough of what comes out to
//! compare it bit for bit.
//!
//! ```text
//! servo thread ── ring of ticks ──▶ recorder thread ── MCAP ──▶ disk
//! publisher ────── notes ─────────▶
//! ```
//!
//! **Invariant:** nothing here reaches the servo. A ring that is full loses ticks, which are counted; a
//! disk that is full ends the recording, which is said; the session goes on.

mod entry;
mod file;
mod readable;
mod reader;
mod recorder;
mod setup;
mod sink;
#[cfg(test)]
pub(crate) mod tests;

pub(crate) use entry::{
    RING_TICKS, Recorded, Tap, drive_of, link_in_file, outcome, request_of, sample_in_file,
    sample_of,
};
pub(crate) use readable::Readable;
pub use reader::{Entry, Reader, RecordingError};
pub use recorder::RecordingReport;
pub(crate) use recorder::{Blank, Recorder};
pub use setup::Moved;
pub(crate) use setup::{Begun, describe, restore};
