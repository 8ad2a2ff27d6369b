//! Links to haptic devices: what the servo loop needs of a cable, and why a link is refused.
//!
//! ```text
//! --device open:  ─ OpenLink ─ Cable: SerialPort ──────────────┐
//!          hid:   ─ OpenLink ─ Cable: ReportCable (hidapi) ────┤ states ─ relay ─ mailbox ─▶ servo
//!          packet:─ OpenLink ─ Cable: ReportCable (socket) ────┤ thread                      thread
//!          sim    ─ OpenLink ─ Cable: PairCable, device thread ┤
//!          hfab:  ─ HfabLink ─ SerialPort, text lines ─────────┘
//!          openhaptics ─ HdLink ─ the library's own thread ──── mailbox ─────────────────────▶
//! ```
//! [`open`] and [`DeviceLink::prepare`] may wait; every wait has an end and an error of its own. From
//! [`DeviceLink::start`] on, `poll` and `send` neither wait nor allocate. The bytes are those of `WIRE.md`,
//! part 1.

mod cable;
mod error;
pub(crate) mod handshake;
pub(crate) mod hd;
mod hfab;
mod hid;
pub(crate) mod inbox;
mod mailbox;
mod open;
mod order;
mod port;
mod receiver;
mod relay;
mod report_cable;
mod sim;
mod spec;
#[cfg(test)]
mod tests;

pub use error::LinkError;
pub use hd::vendor_library;
pub use hfab::HfabLink;
pub use hid::{HidFound, found as hid_found};
pub use open::{BAUD, OpenLink};
pub(crate) use port::group_of;
pub use spec::{DeviceSpec, KINDS, open};

use osteon_protocol::device::{CommandFrame, DeviceHello, StateFrame};
use osteon_sim_core::arm::Arm;
use osteon_sim_core::servo::DeviceScale;

/// A haptic device as the servo loop sees it: raw counts in, raw counts out.
pub trait DeviceLink: Send {
    /// Who the device is and what its counts mean.
    fn info(&self) -> &DeviceInfo;

    /// Brings the device to the point where commands are applied: homed or calibrated, motors on at zero
    /// torque. May wait some seconds. Commands must follow within a second.
    fn prepare(&mut self) -> Result<(), LinkError> {
        Ok(())
    }

    /// In which state the device is, for people; what keeps it from a session is the error. Turns no motor
    /// on and takes some seconds at most. Before [`Self::prepare`].
    fn look(&mut self) -> Result<String, LinkError> {
        Ok("answers".to_owned())
    }

    /// From here on nothing waits: reading goes to a thread of its own.
    fn start(&mut self) -> Result<(), LinkError> {
        Ok(())
    }

    /// Waits until a state is there for [`Self::poll`], at most until `deadline_ns` on the monotonic
    /// clock ([`crate::rt::now_ns`]).
    fn wait(&mut self, deadline_ns: u64) {
        crate::rt::sleep_until(deadline_ns);
    }

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

    /// Whose clock may run the loop.
    fn clock(&self) -> Clocks {
        Clocks::Either
    }
}

/// Whose clock may run the servo loop on a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clocks {
    /// The device streams by its own clock and takes commands at any time.
    Either,
    /// The device only answers.
    HostOnly,
    /// The device's library calls when it wants.
    DeviceOnly,
}

/// Who a device is.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceInfo {
    /// Model, for people.
    pub model: String,
    /// Serial number, or empty.
    pub serial: String,
    /// Firmware or driver, for people, or empty.
    pub firmware: String,
    /// What its counts mean.
    pub scale: DeviceScale,
    /// Period of its states, µs.
    pub period_micros: u16,
}

impl DeviceInfo {
    /// An Omni-class arm that says `hello`.
    pub fn omni(hello: &DeviceHello) -> Self {
        Self {
            model: Arm::Omni.name().to_owned(),
            serial: hello.serial.to_string(),
            firmware: format!("device protocol {}", hello.version),
            scale: DeviceScale {
                arm: Arm::Omni,
                counts_per_rev: hello.counts_per_rev,
                gimbal_counts_per_rev: hello.gimbal_counts_per_rev,
                dac_max: hello.dac_max,
                nmm_per_count: f64::from(hello.micro_nm_per_count) * 1e-3,
            },
            period_micros: hello.period_micros,
        }
    }
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

impl std::ops::Add for LinkStats {
    type Output = Self;

    fn add(self, more: Self) -> Self {
        Self {
            frames: self.frames + more.frames,
            crc_errors: self.crc_errors + more.crc_errors,
            gaps: self.gaps + more.gaps,
            stale: self.stale + more.stale,
            dropped_commands: self.dropped_commands + more.dropped_commands,
        }
    }
}
