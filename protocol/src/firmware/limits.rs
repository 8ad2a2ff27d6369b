//! What the drive allows, and what the raw numbers of an Omni-class device mean.

#[cfg(doc)]
use crate::device::DriveState;

/// Time from power-up until the drive leaves [`DriveState::Boot`], µs.
pub const BOOT_MICROS: u64 = 200_000;
/// The host must repeat the nonce within this time, µs.
pub const NONCE_MICROS: u64 = 500_000;
/// An armed drive that hears no command for this time goes back to homed, µs.
pub const ARMED_IDLE_MICROS: u64 = 1_000_000;
/// A command older than this puts the drive in hold, µs.
pub const HOLD_AFTER_MICROS: u64 = 2_000;
/// Until this age of the last command its torque is held, µs.
pub const HOLD_UNTIL_MICROS: u64 = 5_000;
/// At this age of the last command the ramp has reached zero and the motors go off, µs.
pub const TRIP_MICROS: u64 = 20_000;
/// Healthy commands for this time re-arm a tripped drive, µs.
pub const REARM_MICROS: u64 = 50_000;
/// A command that asks for torque and answers a state of this age or older is refused, µs: what comes
/// late out of a queue must move no motor.
pub const STALE_MICROS: u64 = 20_000;
/// A longer gap between two commands is not healthy, µs.
pub const HEALTHY_GAP_MICROS: u64 = 5_000;
/// On entry into active the torque is scaled from zero to full over this time, µs.
pub const RAMP_MICROS: u64 = 50_000;
/// Commands above the limit, one after the other, that make a hard fault.
pub const OVER_LIMIT_IN_A_ROW: u8 = 3;
/// Largest torque command, DAC counts (12-bit converter).
pub const DAC_MAX: i16 = 2047;
/// Joint torque of one DAC count, µN·m: 2047 counts are 0.44 N·m, 3.3 N at one link's length.
pub const MICRO_NM_PER_COUNT: u16 = 215;
/// Largest rise of a joint's torque, DAC counts a millisecond; falling is not limited. 0.5 N a
/// millisecond at the stylus through each joint's longest lever: 0.26 m for the waist, one link for
/// the others. So this limit is the backstop of the host's and does not bind before it.
pub const SLEW_COUNTS_PER_MS: [i16; 3] = [605, 312, 312];
/// A joint that meets its stop faster than this, counts a millisecond (8 rad/s), is a hard fault.
pub const STOP_SPEED_COUNTS_PER_MS: u32 = 19;
/// A winding at this temperature is a hard fault, °C.
pub const TEMPERATURE_LIMIT_C: i8 = 120;
/// Encoder counts per joint revolution.
pub const COUNTS_PER_REV: u32 = 15_000;
/// Gimbal sensor counts per revolution (14 bit).
pub const GIMBAL_COUNTS_PER_REV: u16 = 16_384;
/// Period of the state stream, µs.
pub const PERIOD_MICROS: u16 = 1_000;
