//! What differs from device to device.

use super::limits::{
    COUNTS_PER_REV, DAC_MAX, GIMBAL_COUNTS_PER_REV, MICRO_NM_PER_COUNT, PERIOD_MICROS,
    SLEW_COUNTS_PER_MS, STOP_SPEED_COUNTS_PER_MS, TEMPERATURE_LIMIT_C,
};
use crate::device::{DEVICE_SCHEMA, DEVICE_VERSION, DeviceHello};

/// A device's numbers. The times of the watchdog are not among them: they are the same everywhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriveConfig {
    /// How the device introduces itself. Its `dac_max` and `period_micros` are kept to, too.
    pub hello: DeviceHello,
    /// Largest rise of each joint's torque in one period, DAC counts.
    pub slew_counts_per_tick: [i16; 3],
    /// A joint that meets its stop faster than this, counts a period, is a hard fault.
    pub stop_speed_counts_per_tick: u32,
    /// A winding at this temperature is a hard fault, °C.
    pub temperature_limit_c: i8,
    /// The first state frame's number less one.
    pub first_seq: u16,
}

impl DriveConfig {
    /// An Omni-class device.
    pub const fn omni(serial: u32) -> Self {
        Self {
            hello: DeviceHello {
                version: DEVICE_VERSION,
                schema: DEVICE_SCHEMA,
                model: 1,
                serial,
                counts_per_rev: COUNTS_PER_REV,
                gimbal_counts_per_rev: GIMBAL_COUNTS_PER_REV,
                dac_max: DAC_MAX,
                micro_nm_per_count: MICRO_NM_PER_COUNT,
                period_micros: PERIOD_MICROS,
            },
            slew_counts_per_tick: SLEW_COUNTS_PER_MS,
            stop_speed_counts_per_tick: STOP_SPEED_COUNTS_PER_MS,
            temperature_limit_c: TEMPERATURE_LIMIT_C,
            first_seq: 0,
        }
    }
}
