//! How the device link's frames and hfab's lines bear damage:
//! `cargo run --release -p osteon-protocol --example damage [FLIPS] [FUZZED_BYTES]`.
//!
//! Flips single and several bits of sound messages and counts those that are read as *another* message; then
//! feeds random bytes, half of them behind a sound beginning, to the decoder, which must not panic. hfab's
//! lines (`[mA0,mA1,mA2]`) have no checksum; what they let through is counted beside it.
#![expect(clippy::print_stdout, reason = "a program that shows its figures")]

use osteon_protocol::device::{CommandFrame, HostMessage};
use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};
use osteon_protocol::hfab::LineReader;

/// `SplitMix64`.
struct Random(u64);

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

    fn milliamperes(&mut self) -> i16 {
        let n = i16::try_from(self.below(12_001)).unwrap_or(0);
        n - 6000
    }
}

/// What the product's own reader takes the bytes for.
fn hfab(bytes: &[u8]) -> Option<[i32; 3]> {
    let mut reader = LineReader::<3>::new();
    bytes
        .iter()
        .filter_map(|&b| reader.push(b))
        .find_map(Result::ok)
}

fn flip(random: &mut Random, bytes: &mut [u8]) {
    let whole = bytes.to_vec();
    // one flip in half of the cases, else two to eight; they may undo each other
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

fn main() {
    let mut numbers = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse::<u64>().ok());
    let flips = numbers.next().unwrap_or(10_000_000);
    let fuzzed = numbers.next().unwrap_or(100_000_000);
    let mut random = Random(1);
    let (mut ours, mut theirs) = (0_u64, 0_u64);
    for _ in 0..flips {
        let torque = [(); 3].map(|()| random.milliamperes());
        let message = HostMessage::Command(CommandFrame {
            seq: random.milliamperes().unsigned_abs(),
            state_seq: random.milliamperes().unsigned_abs(),
            torque,
            enable: true,
        });
        let mut out = [0; MAX_FRAME];
        let mut bytes = encode(&message, &mut out).unwrap_or(&[]).to_vec();
        flip(&mut random, &mut bytes);
        bytes.push(0);
        let mut reader = FrameReader::new();
        let read = bytes.iter().filter_map(|&b| reader.push::<HostMessage>(b));
        ours += read.flatten().filter(|m| *m != message).count() as u64;
        let mut line = format!("[{},{},{}]\n", torque[0], torque[1], torque[2]).into_bytes();
        flip(&mut random, &mut line);
        theirs += u64::from(hfab(&line).is_some_and(|read| read != torque.map(i32::from)));
    }
    println!(
        "{flips} damaged commands read as another: {ours} (COBS and CRC-32C), {theirs} (hfab's lines)"
    );
    let mut reader = FrameReader::new();
    let (mut messages, mut refused) = (0_u64, 0_u64);
    let mut word = 0;
    for n in 0..fuzzed {
        if n % 8 == 0 {
            word = random.bits();
        }
        // small bytes in every second block: delimiters, tags and lengths come often
        let byte = (word >> (8 * (n % 8)) & 0xff) as u8;
        let byte = if n % 128 < 64 { byte & 7 } else { byte };
        match reader.push::<HostMessage>(byte) {
            Some(Ok(_)) => messages += 1,
            Some(Err(_)) => refused += 1,
            None => {}
        }
    }
    println!(
        "{fuzzed} random bytes: {refused} frames refused, {messages} taken for messages, no panic"
    );
}
