//! Links to haptic devices: what the servo loop needs of a cable, and why a link is refused.
//!
//! ```text
//! servo thread ── poll/send (never wait) ──▶ OpenLink ──▶ SerialPort ──▶ cable
//!              ◀── ring of states ── relay thread (may wait) ◀── │
//! start-up     ── open, prepare (may wait, every wait has an end) ──▶ │
//! ```
//! The bytes are those of `WIRE.md`, part 1.

mod handshake;
pub(crate) mod inbox;
mod open;
mod port;
mod receiver;
mod relay;
#[cfg(test)]
mod tests;

pub use open::OpenLink;

use osteon_protocol::device::{CommandFrame, DeviceHello, StateFrame};
use osteon_protocol::frame::FrameError;
use std::sync::Arc;

/// A haptic device as the servo loop sees it: raw counts in, raw counts out.
pub trait DeviceLink: Send {
    /// Who the device is and what its counts mean.
    fn info(&self) -> &DeviceHello;

    /// The newest state that has arrived since the last call, if any. Never blocks and does a
    /// bounded amount of work; stale and repeated states are refused and counted.
    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError>;

    /// Sends one command. Never blocks: a full cable drops the command and counts it.
    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "a frame is written from where it lies, whatever its size"
    )]
    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError>;

    /// Asks for motors off; the last thing on every way out. Best effort, within 20 ms.
    fn disarm(&mut self);

    /// Counters since the link was opened.
    fn stats(&self) -> LinkStats;

    /// The link's name for people, for example `open:/dev/ttyACM0`.
    fn describe(&self) -> String;
}

/// What went over a link, and what went wrong on it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LinkStats {
    /// State frames accepted.
    pub frames: u64,
    /// Frames refused for a bad CRC or a bad shape.
    pub crc_errors: u64,
    /// State frames missing in the sequence.
    pub gaps: u64,
    /// State frames refused because a newer one, or the same one, had come before.
    pub stale: u64,
    /// Commands not sent because the cable was full.
    pub dropped_commands: u64,
}

/// Why a link is refused or lost. Each prints as one line: which device, what, and the remedy.
/// `link` is [`DeviceLink::describe`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// The path does not exist.
    #[error(
        "device {link}: no such port; available: {available}; \
         start one with 'osteon fake-omni' or give --device"
    )]
    NoPort {
        /// The link.
        link: Arc<str>,
        /// Ports that exist, or "none".
        available: String,
    },
    /// Another program holds the port.
    #[error("device {link}: another program is using this port; end it or give another --device")]
    Busy {
        /// The link.
        link: Arc<str>,
    },
    /// The user may not open the port.
    #[error(
        "device {link}: permission denied; join the group that owns the port (often 'dialout') \
         and log in again"
    )]
    Denied {
        /// The link.
        link: Arc<str>,
    },
    /// The path is a file, a directory, a pipe: no serial port.
    #[error("device {link}: not a serial port; available: {available}; give --device a port")]
    NotSerial {
        /// The link.
        link: Arc<str>,
        /// Ports that exist, or "none".
        available: String,
    },
    /// Nothing came within the time limit.
    #[error(
        "device {link}: nothing answered for {seconds} s; check power and cable, \
         or give another --device"
    )]
    Silent {
        /// The link.
        link: Arc<str>,
        /// The time limit, s.
        seconds: u64,
    },
    /// Bytes came, but no valid frame.
    #[error(
        "device {link}: speaks another protocol (first bytes: {first_bytes}); \
         check the port and the device's firmware, or give another --device"
    )]
    Foreign {
        /// The link.
        link: Arc<str>,
        /// The first bytes in hexadecimal.
        first_bytes: String,
    },
    /// Valid frames came, but no answer to the hello request.
    #[error(
        "device {link}: streams, but does not answer the hello request; \
         switch the device off and on"
    )]
    NoHello {
        /// The link.
        link: Arc<str>,
    },
    /// The device speaks another version.
    #[error(
        "device {link}: speaks version {device} of the device protocol, this program version \
         {host}; update the older of the two"
    )]
    Version {
        /// The link.
        link: Arc<str>,
        /// The device's version.
        device: u16,
        /// This program's version.
        host: u16,
    },
    /// The device's messages are laid out otherwise although the version is the same.
    #[error(
        "device {link}: lays its messages out otherwise (schema {device:08x}, here {host:08x}); \
         build firmware and program from the same release"
    )]
    Schema {
        /// The link.
        link: Arc<str>,
        /// The device's schema.
        device: u32,
        /// This program's schema.
        host: u32,
    },
    /// The hello names a model or a number that cannot be worked with.
    #[error("device {link}: its hello has an unusable {what}; update the device's firmware")]
    BadHello {
        /// The link.
        link: Arc<str>,
        /// The field and its value.
        what: String,
    },
    /// Homing needs the stylus in its dock.
    #[error("device {link}: the stylus is not in its dock; put it there and start again")]
    NotDocked {
        /// The link.
        link: Arc<str>,
    },
    /// A latched fault did not clear.
    #[error("device {link}: fault: {faults}; remove the cause, then switch the device off and on")]
    Fault {
        /// The link.
        link: Arc<str>,
        /// Names of the fault bits.
        faults: String,
    },
    /// The device did not take the next step of its start in time.
    #[error("device {link}: stays {state} and does not {step}; switch the device off and on")]
    Stuck {
        /// The link.
        link: Arc<str>,
        /// The drive state it is in.
        state: String,
        /// What it was asked to do.
        step: &'static str,
    },
    /// The device began its count anew while it was in use.
    #[error("device {link}: restarted; start the session again to home and arm it")]
    Restarted {
        /// The link.
        link: Arc<str>,
    },
    /// The port vanished while it was in use.
    #[error("device {link}: gone ({errno}); check cable and power, then start again")]
    Gone {
        /// The link.
        link: Arc<str>,
        /// What the system said.
        errno: rustix::io::Errno,
    },
    /// A message does not fit a frame: a fault of this program.
    #[error("device {link}: cannot frame a message ({error}); please report this")]
    Frame {
        /// The link.
        link: Arc<str>,
        /// Why.
        error: FrameError,
    },
    /// Any other refusal of the system.
    #[error("device {link}: cannot set up the port: {why}; check the device and its driver")]
    Setup {
        /// The link.
        link: Arc<str>,
        /// What the system said.
        why: String,
    },
}
