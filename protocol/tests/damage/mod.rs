//! Counts what damaged messages are taken for; for the test and for the program `damage`.

use osteon_protocol::device::{CommandFrame, DeviceMessage, DriveState, HostMessage, StateFrame};
use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};
use osteon_protocol::hfab::{LineReader, MAX_LINE, write_line};
use osteon_protocol::omni_raw::{RawCommand, RawState};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// `SplitMix64`.
pub(crate) struct Random(pub u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, below: usize) -> usize {
        usize::try_from(self.bits() % below as u64).unwrap_or(0)
    }

    /// In −most..=most.
    fn around_zero(&mut self, most: i32) -> i32 {
        let span = usize::try_from(2 * most + 1).unwrap_or(1);
        i32::try_from(self.below(span)).unwrap_or(0) - most
    }

    fn word(&mut self) -> u16 {
        let [a, b, ..] = self.bits().to_le_bytes();
        u16::from_le_bytes([a, b])
    }

    fn small(&mut self, most: i32) -> i16 {
        i16::try_from(self.around_zero(most)).unwrap_or(0)
    }
}

/// Messages that were read as another one, of as many that were damaged in each direction.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Mistaken {
    /// Commands of this protocol.
    pub commands: u64,
    /// States of this protocol.
    pub states: u64,
    /// hfab's commands, `[mA0,mA1,mA2]`.
    pub hfab_commands: u64,
    /// hfab's states, eight numbers.
    pub hfab_states: u64,
}

/// One bit in half of the cases, else two to eight; never none.
fn flip(random: &mut Random, bytes: &mut [u8]) {
    let whole = bytes.to_vec();
    while bytes == whole {
        let count = if random.below(2) == 0 {
            1
        } else {
            2 + random.below(7)
        };
        for _ in 0..count {
            let bit = random.below(bytes.len() * 8);
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

/// Whether a damaged frame of `message` is read as another one.
fn frame_is_mistaken<T: Serialize + DeserializeOwned + PartialEq>(
    random: &mut Random,
    message: &T,
) -> bool {
    let mut out = [0; MAX_FRAME];
    let mut bytes = encode(message, &mut out).unwrap_or(&[]).to_vec();
    flip(random, &mut bytes);
    // whatever the damage made of the frame's end, here is one
    bytes.push(0);
    let mut reader = FrameReader::new();
    let read = bytes.iter().filter_map(|&b| reader.push::<T>(b));
    read.flatten().any(|read| read != *message)
}

fn line_is_mistaken<const N: usize>(random: &mut Random, numbers: [i32; N]) -> bool {
    let mut out = [0; MAX_LINE];
    let mut line = write_line(&numbers, &mut out).to_vec();
    flip(random, &mut line);
    line.push(b'\n');
    let mut reader = LineReader::<N>::new();
    let read = line.iter().filter_map(|&b| reader.push(b));
    read.flatten().any(|read| read != numbers)
}

/// Damages `count` messages in each direction and protocol.
pub(crate) fn flips(random: &mut Random, count: u64) -> Mistaken {
    let mut mistaken = Mistaken::default();
    for _ in 0..count {
        let torque = [(); 3].map(|()| random.small(2047));
        let command = HostMessage::Command(CommandFrame {
            seq: random.word(),
            state_seq: random.word(),
            torque,
            enable: random.below(2) == 0,
        });
        mistaken.commands += u64::from(frame_is_mistaken(random, &command));
        let state = DeviceMessage::State(StateFrame {
            seq: random.word(),
            time_micros: u32::from(random.word()) << 8,
            encoders: [(); 3].map(|()| random.around_zero(8000)),
            gimbal: [(); 3].map(|()| random.small(8000)),
            switches: 0,
            drive: DriveState::Active,
            faults: 0,
            applied: torque,
            temperature: [30; 3],
            ack: random.word(),
            crc_errors: 0,
            refused: 0,
            trips: 0,
        });
        mistaken.states += u64::from(frame_is_mistaken(random, &state));
        let currents = [(); 3].map(|()| random.around_zero(6000));
        mistaken.hfab_commands += u64::from(line_is_mistaken(random, currents));
        let [a, b, c, d, e, f] = [(); 6].map(|()| random.around_zero(8000));
        let line = [3, a, b, c, d, e, f, 0];
        mistaken.hfab_states += u64::from(line_is_mistaken(random, line));
    }
    mistaken
}

/// What random bytes were taken for by every decoder of the device link.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    /// Frames taken for a message, either direction.
    pub messages: u64,
    /// Frames refused.
    pub refused: u64,
    /// hfab's lines taken for one.
    pub lines: u64,
    /// Payloads of the stock Omni that its decoder took: it has no checksum.
    pub raw: u64,
}

/// Feeds `count` bytes to every decoder: small ones in every second block, as delimiters, tags and lengths come
/// often there; digits and brackets in every fourth, as lines have them.
pub(crate) fn random_bytes(random: &mut Random, count: u64) -> Heard {
    let mut heard = Heard::default();
    let (mut host, mut device) = (FrameReader::new(), FrameReader::new());
    let (mut commands, mut states) = (LineReader::<3>::new(), LineReader::<8>::new());
    let mut window = [0; 44];
    let mut word = 0;
    for n in 0..count {
        if n % 8 == 0 {
            word = random.bits();
        }
        let byte = word.to_le_bytes()[usize::try_from(n % 8).unwrap_or(0)];
        let byte = match n / 64 % 4 {
            0 | 2 => byte & 7,
            1 => b"[],-0123456789\n\n"[usize::from(byte & 15)],
            _ => byte,
        };
        for outcome in [
            host.push::<HostMessage>(byte).map(|r| r.is_ok()),
            device.push::<DeviceMessage>(byte).map(|r| r.is_ok()),
        ] {
            heard.messages += u64::from(outcome == Some(true));
            heard.refused += u64::from(outcome == Some(false));
        }
        heard.lines += u64::from(matches!(commands.push(byte), Some(Ok(_))));
        heard.lines += u64::from(matches!(states.push(byte), Some(Ok(_))));
        window.rotate_left(1);
        window[43] = byte;
        heard.raw += u64::from(RawState::decode(&window).is_some());
        heard.raw += u64::from(RawCommand::decode(&window).is_some());
    }
    heard
}
