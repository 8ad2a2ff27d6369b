//! The stock Omni's own `FireWire` payload, as its users have described it: another encoding of the same state.
//!
//! Nobody drives a `FireWire` bus here; the codec is for a bridge that does, and for the simulated device. All
//! fields are little endian. Offsets and meanings: `ytsutano/raw_omni` (ISC) and the specification in
//! `scottsharris/phantom-drivers`.

/// Bytes of a state that carry something; the packet has 64.
pub const STATE_BYTES: usize = 44;
/// Bytes of a command.
pub const COMMAND_BYTES: usize = 16;
/// A converter's zero: 12-bit offset binary.
pub const FORCE_ZERO: u16 = 0x07FF;
/// Encoder counts of a joint revolution.
pub const COUNTS_PER_REV: u32 = 15_000;

const COMMAND_BASE: u16 = 0x53C0;
const MOTORS_ON: u16 = 8;

/// Device to host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawState {
    /// Joint encoders as they are on the wire, 15,000 counts a revolution; they wrap.
    pub encoders: [i16; 3],
    /// Gimbal potentiometers; the low 5 bits are noise.
    pub pots: [u16; 3],
    /// The same tracks read from their other ends.
    pub inverse_pots: [u16; 3],
    /// Counts packets; wraps.
    pub packet: u8,
    /// Button 1 (grey, front) is pressed.
    pub button_1: bool,
    /// Button 2 (white, back) is pressed.
    pub button_2: bool,
    /// The stylus is in its dock.
    pub docked: bool,
    /// +1 a message.
    pub message: u32,
}

/// Host to device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawCommand {
    /// Motor torques, converter counts from zero, in −2047..=2048.
    pub torque: [i16; 3],
    /// Power to the motors.
    pub motors_on: bool,
}

impl RawState {
    /// The packet's bytes. Fields without a known meaning have the values that were seen on real devices, or 0.
    pub fn encode(&self) -> [u8; STATE_BYTES] {
        let mut out = [0; STATE_BYTES];
        put(&mut out, 2, 0x001E);
        for joint in 0..3 {
            put(
                &mut out,
                4 + 2 * joint,
                self.encoders[joint].cast_unsigned(),
            );
            put(&mut out, 10 + 2 * joint, self.pots[joint]);
            put(&mut out, 22 + 2 * joint, self.inverse_pots[joint]);
        }
        out[18] = self.packet;
        // active low
        out[19] =
            u8::from(!self.button_1) | u8::from(!self.button_2) << 1 | u8::from(!self.docked) << 2;
        put(&mut out, 20, 0x1007);
        put(&mut out, 28, 0x5746);
        out[32..36].copy_from_slice(&self.message.to_le_bytes());
        out
    }

    /// Reads a packet; `None` where it is too short or does not begin as a state does.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; STATE_BYTES] = bytes.first_chunk()?;
        if get(bytes, 0) != 0 || get(bytes, 2) != 0x001E {
            return None;
        }
        let three = |at: usize| core::array::from_fn(|joint| get(bytes, at + 2 * joint));
        let message = [bytes[32], bytes[33], bytes[34], bytes[35]];
        Some(Self {
            encoders: three(4).map(u16::cast_signed),
            pots: three(10),
            inverse_pots: three(22),
            packet: bytes[18],
            button_1: bytes[19] & 1 == 0,
            button_2: bytes[19] & 2 == 0,
            docked: bytes[19] & 4 == 0,
            message: u32::from_le_bytes(message),
        })
    }
}

impl RawCommand {
    /// The command's bytes; torques beyond the converter are cut to it.
    pub fn encode(self) -> [u8; COMMAND_BYTES] {
        let mut out = [0; COMMAND_BYTES];
        for (joint, torque) in self.torque.into_iter().enumerate() {
            let counts = torque.clamp(-2047, 2048);
            put(&mut out, 2 * joint, FORCE_ZERO.wrapping_add_signed(counts));
        }
        let power = if self.motors_on { MOTORS_ON } else { 0 };
        put(&mut out, 6, COMMAND_BASE | power);
        out
    }

    /// Reads a command; `None` where it is too short, its status is none, or a converter's value has more than
    /// 12 bits.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; COMMAND_BYTES] = bytes.first_chunk()?;
        let status = get(bytes, 6);
        let raw: [u16; 3] = core::array::from_fn(|joint| get(bytes, 2 * joint));
        let known = status & !0x000F == COMMAND_BASE & !0x000F;
        if !known || raw.iter().any(|&n| n > 0x0FFF) {
            return None;
        }
        Some(Self {
            torque: raw.map(|n| n.cast_signed() - FORCE_ZERO.cast_signed()),
            motors_on: status & MOTORS_ON != 0,
        })
    }
}

fn put(out: &mut [u8], at: usize, value: u16) {
    out[at..at + 2].copy_from_slice(&value.to_le_bytes());
}

fn get(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_has_its_bytes_where_the_description_has_them() {
        let state = RawState {
            encoders: [1, -2, 300],
            pots: [0x1234, 0, 0xFFFF],
            inverse_pots: [0xEDCB, 0xFFFF, 0],
            packet: 7,
            button_1: true,
            button_2: false,
            docked: true,
            message: 0x0102_0304,
        };
        let expected: [u8; STATE_BYTES] = [
            0, 0, 0x1E, 0, 1, 0, 0xFE, 0xFF, 0x2C, 1, 0x34, 0x12, 0, 0, 0xFF, 0xFF, 0, 0, 7, 0b010,
            0x07, 0x10, 0xCB, 0xED, 0xFF, 0xFF, 0, 0, 0x46, 0x57, 0, 0, 4, 3, 2, 1, 0, 0, 0, 0, 0,
            0, 0, 0,
        ];
        assert_eq!(state.encode(), expected);
        assert_eq!(RawState::decode(&expected), Some(state));
    }

    #[test]
    fn zero_torque_is_7ff_and_power_is_bit_3() {
        let off = RawCommand {
            torque: [0; 3],
            motors_on: false,
        };
        assert_eq!(
            off.encode(),
            [
                0xFF, 7, 0xFF, 7, 0xFF, 7, 0xC0, 0x53, 0, 0, 0, 0, 0, 0, 0, 0
            ]
        );
        let on = RawCommand {
            torque: [1, -2047, i16::MAX],
            motors_on: true,
        };
        let bytes = on.encode();
        assert_eq!(bytes[..8], [0, 8, 0, 0, 0xFF, 0x0F, 0xC8, 0x53]);
        let read = RawCommand::decode(&bytes).unwrap();
        assert_eq!((read.torque, read.motors_on), ([1, -2047, 2048], true));
    }

    #[test]
    fn decoders_are_total() {
        let mut random = 3_u64;
        let mut states = 0;
        for length in 0..200_000_usize {
            let mut bytes = [0_u8; 50];
            for byte in &mut bytes {
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                *byte = random.to_le_bytes()[0];
            }
            let part = &bytes[..length % 50];
            states += u32::from(RawState::decode(part).is_some());
            if let Some(command) = RawCommand::decode(part) {
                assert_eq!(RawCommand::decode(&command.encode()), Some(command));
            }
        }
        assert_eq!(states, 0, "noise was taken for a state");
    }
}
