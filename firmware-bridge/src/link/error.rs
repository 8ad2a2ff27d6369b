//! Why a device is refused or lost: one line each, with what to do about it.

use osteon_protocol::frame::FrameError;
use std::sync::Arc;

/// Why a link is refused or lost. Each prints as one line: which device, what, and the remedy.
/// `link` is [`super::DeviceLink::describe`].
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
        "device {link}: permission denied; join the group that owns it \
         (sudo usermod -aG {group} $USER) and log in again"
    )]
    Denied {
        /// The link.
        link: Arc<str>,
        /// Group of the port.
        group: String,
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
    /// The user may not open the HID device.
    #[error(
        "device {link}: permission denied on {node}; install the udev rule that 'osteon doctor' \
         prints, then plug the device in again"
    )]
    DeniedHid {
        /// The link.
        link: Arc<str>,
        /// The device file.
        node: String,
    },
    /// No HID device of these numbers.
    #[error("device {link}: no such HID device; connected: {available}; see 'osteon devices'")]
    NoHid {
        /// The link.
        link: Arc<str>,
        /// HID devices that there are, or "none".
        available: String,
    },
    /// The device speaks a protocol that another kind of `--device` knows.
    #[error("device {link}: speaks {speaks}; give --device {instead}")]
    WrongKind {
        /// The link.
        link: Arc<str>,
        /// The protocol.
        speaks: &'static str,
        /// The right option.
        instead: String,
    },
    /// Bytes came that are neither text nor frames.
    #[error(
        "device {link}: noise instead of frames (first bytes: {first_bytes}): most likely another \
         bit rate; a UART needs one of 1000000 or more, on both sides: open:PATH@BAUD"
    )]
    WrongBaud {
        /// The link.
        link: Arc<str>,
        /// The first bytes in hexadecimal.
        first_bytes: String,
    },
    /// The emergency stop is open.
    #[error("device {link}: the emergency stop is open; release it and start again")]
    EStop {
        /// The link.
        link: Arc<str>,
    },
    /// The device does not know where it is.
    #[error("device {link}: not calibrated; {remedy}")]
    Uncalibrated {
        /// The link.
        link: Arc<str>,
        /// What to do.
        remedy: String,
    },
    /// An arm whose kinematics are not known here.
    #[error("device {link}: model {model} is unknown here; this release knows {known}")]
    UnknownModel {
        /// The link.
        link: Arc<str>,
        /// The model number.
        model: i32,
        /// Those that are known.
        known: &'static str,
    },
    /// Another device than the session began with.
    #[error(
        "device {link}: another device than before ({model} instead of {wanted}); \
         plug the first one in, or start a new session"
    )]
    Another {
        /// The link.
        link: Arc<str>,
        /// Model of this one.
        model: String,
        /// Model of the first one.
        wanted: String,
    },
    /// The vendor's library is not there or lacks a function.
    #[error(
        "device {link}: cannot use the vendor's library ({why}); install OpenHaptics and the \
         device's driver from 3D Systems, or name the library in OSTEON_LIBHD"
    )]
    NoLibrary {
        /// The link.
        link: Arc<str>,
        /// What the loader said.
        why: String,
    },
    /// The vendor's library refused a call.
    #[error("device {link}: {call} failed: {what} (code {code:#x}); {remedy}")]
    Library {
        /// The link.
        link: Arc<str>,
        /// The call.
        call: &'static str,
        /// What the library says of it.
        what: String,
        /// Its error code.
        code: u32,
        /// What to do.
        remedy: &'static str,
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

/// Bytes in hexadecimal, for people.
pub(super) fn hex(bytes: &[u8]) -> String {
    let pairs: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    pairs.join(" ")
}
