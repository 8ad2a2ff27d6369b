//! Messages of the device link. See `WIRE.md`, part 1.
//!
//! The device's clock is the master: it sends a [`StateFrame`] every millisecond unasked. All
//! numbers on this wire are raw (encoder counts, DAC counts); kinematics and torque maps live on the
//! host. Integers only, so that a NaN cannot exist here, and of fixed width (little endian), so
//! that every message has one size.

use serde::{Deserialize, Serialize};

/// Version of the device link. A host refuses a device of another version and says so.
pub const DEVICE_VERSION: u16 = 1;

/// The layout of every message, tags and fields in the order of their bytes. Whoever changes a
/// message changes this text in the same commit; the golden tests hold its hash.
pub const DEVICE_LAYOUT: &str = "osteon-device/1; to host: \
    0 Hello version:u16 schema:u32 model:u16 serial:u32 counts_per_rev:u32 \
    gimbal_counts_per_rev:u16 dac_max:i16 micro_nm_per_count:u16 period_micros:u16, \
    1 State seq:u16 time_micros:u32 encoders:i32x3 gimbal:i16x3 switches:u8 drive:u8 faults:u16 \
    applied:i16x3 temperature:i8x3 ack:u16 crc_errors:u8 refused:u8 trips:u8, \
    2 Challenge nonce:u32; to device: \
    0 HelloRequest version:u16 schema:u32, \
    1 Command seq:u16 state_seq:u16 torque:i16x3 enable:u8, \
    2 Home, 3 Arm, 4 ArmConfirm nonce:u32, 5 Disarm";

/// FNV-1a of [`DEVICE_LAYOUT`]: tells two layouts apart although a version number was forgotten.
pub const DEVICE_SCHEMA: u32 = crate::crc32c::fnv1a(DEVICE_LAYOUT.as_bytes());

/// Drive states, in the order of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum DriveState {
    /// Starting up; motors off.
    Boot,
    /// Encoders have no reference yet; motors off.
    Unhomed,
    /// Encoders are referenced; motors off.
    Homed,
    /// Motors on at zero torque, after the two-step arming with a nonce.
    Armed,
    /// Torque commands are applied.
    Active,
    /// Commands are missing: the last torque is held (≤ 5 ms), then ramped to zero (by 20 ms).
    Hold,
    /// Watchdog trip: motors off. Re-arms by itself after 50 ms of healthy commands.
    Tripped,
    /// Hard fault (over-temperature, e-stop, limit, self-test): motors off, latched until disarmed.
    Fault,
}

/// Bits of [`StateFrame::faults`].
pub mod fault {
    /// A winding is too hot.
    pub const OVER_TEMPERATURE: u16 = 1;
    /// The emergency stop is open.
    pub const E_STOP: u16 = 2;
    /// A torque command was above the limit and was refused.
    pub const TORQUE_LIMIT: u16 = 4;
    /// A torque command rose faster than the slew limit and was slewed.
    pub const SLEW_LIMIT: u16 = 8;
    /// A joint is at its stop.
    pub const JOINT_LIMIT: u16 = 16;
    /// The self-test failed.
    pub const SELF_TEST: u16 = 32;
    /// Commands were missing for 20 ms.
    pub const WATCHDOG: u16 = 64;
}

/// Bits of [`StateFrame::switches`].
pub mod switch {
    /// Stylus button 1 (front) is pressed.
    pub const BUTTON_1: u8 = 1;
    /// Stylus button 2 (back) is pressed.
    pub const BUTTON_2: u8 = 2;
    /// The stylus is in its dock.
    pub const DOCKED: u8 = 4;
}

/// Who the device is and what its raw numbers mean. Answer to [`HostMessage::HelloRequest`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceHello {
    /// [`DEVICE_VERSION`] of the device.
    #[serde(with = "postcard::fixint::le")]
    pub version: u16,
    /// [`DEVICE_SCHEMA`] of the device.
    #[serde(with = "postcard::fixint::le")]
    pub schema: u32,
    /// Kinematic model: 1 = Omni-class arm (two links of 133.35 mm).
    #[serde(with = "postcard::fixint::le")]
    pub model: u16,
    /// Serial number.
    #[serde(with = "postcard::fixint::le")]
    pub serial: u32,
    /// Encoder counts per joint revolution.
    #[serde(with = "postcard::fixint::le")]
    pub counts_per_rev: u32,
    /// Gimbal sensor counts per revolution.
    #[serde(with = "postcard::fixint::le")]
    pub gimbal_counts_per_rev: u16,
    /// Largest torque command, DAC counts.
    #[serde(with = "postcard::fixint::le")]
    pub dac_max: i16,
    /// Joint torque of one DAC count, µN·m.
    #[serde(with = "postcard::fixint::le")]
    pub micro_nm_per_count: u16,
    /// Period of the state stream, µs.
    #[serde(with = "postcard::fixint::le")]
    pub period_micros: u16,
}

/// The device's state, sent every [`DeviceHello::period_micros`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct StateFrame {
    /// Counts frames; wraps.
    #[serde(with = "postcard::fixint::le")]
    pub seq: u16,
    /// Device clock at the sampling of the encoders, µs; wraps after 71 minutes.
    #[serde(with = "postcard::fixint::le")]
    pub time_micros: u32,
    /// Joint encoders (waist, shoulder, elbow as *motor* angles), counts from the homing pose.
    #[serde(with = "crate::fixed::i32x3")]
    pub encoders: [i32; 3],
    /// Gimbal angles (yaw, pitch, roll), counts from zero, absolute.
    #[serde(with = "crate::fixed::i16x3")]
    pub gimbal: [i16; 3],
    /// [`switch`] bits.
    pub switches: u8,
    /// State of the drive.
    pub drive: DriveState,
    /// [`fault`] bits.
    #[serde(with = "postcard::fixint::le")]
    pub faults: u16,
    /// Torque applied at the sampling of the encoders, DAC counts, after the device's own limits.
    #[serde(with = "crate::fixed::i16x3")]
    pub applied: [i16; 3],
    /// Winding temperatures, °C.
    pub temperature: [i8; 3],
    /// `seq` of the newest command accepted; 0 before the first after a hello or an arming.
    #[serde(with = "postcard::fixint::le")]
    pub ack: u16,
    /// Frames refused for a bad CRC or a bad shape; wraps.
    pub crc_errors: u8,
    /// Commands refused as stale, repeated or out of limits; wraps.
    pub refused: u8,
    /// Watchdog trips since boot; wraps.
    pub trips: u8,
}

/// One torque command, sent by the host in every servo tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandFrame {
    /// Counts commands from 1; wraps to 1. The device refuses a stale or repeated one (serial-number
    /// arithmetic on 16 bits); a hello and an arming make it forget the last one.
    #[serde(with = "postcard::fixint::le")]
    pub seq: u16,
    /// `seq` of the state that this command answers.
    #[serde(with = "postcard::fixint::le")]
    pub state_seq: u16,
    /// Joint torques, DAC counts.
    #[serde(with = "crate::fixed::i16x3")]
    pub torque: [i16; 3],
    /// True asks the drive to go from Armed to Active; false asks it back to Armed (zero torque).
    pub enable: bool,
}

/// Device to host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceMessage {
    /// Answer to a hello request.
    Hello(DeviceHello),
    /// The state stream.
    State(StateFrame),
    /// Answer to [`HostMessage::Arm`]: send the nonce back within 500 ms.
    Challenge {
        /// Random number that the host must repeat.
        #[serde(with = "postcard::fixint::le")]
        nonce: u32,
    },
}

/// Host to device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum HostMessage {
    /// Ask who the device is.
    HelloRequest {
        /// [`DEVICE_VERSION`] of the host.
        #[serde(with = "postcard::fixint::le")]
        version: u16,
        /// [`DEVICE_SCHEMA`] of the host.
        #[serde(with = "postcard::fixint::le")]
        schema: u32,
    },
    /// A torque command.
    Command(CommandFrame),
    /// Reference the encoders: the stylus is in its dock.
    Home,
    /// First step of arming.
    Arm,
    /// Second step of arming.
    ArmConfirm {
        /// The nonce of [`DeviceMessage::Challenge`].
        #[serde(with = "postcard::fixint::le")]
        nonce: u32,
    },
    /// Motors off; clears a latched fault.
    Disarm,
}
