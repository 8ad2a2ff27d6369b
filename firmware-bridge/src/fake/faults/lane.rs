//! One direction of a cable. Bytes go in, and come out later, or otherwise, or not at all.
//!
//! The lane knows frames by their delimiter alone: what it breaks goes through the real receiver. Time is
//! given, in ns, so that the same lane serves both clocks. Bytes keep their order, but where the fault is
//! to change it.

use super::catalogue::Fault;
use crate::fake::random::Random;
use osteon_protocol::device::DeviceMessage;
use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};
use std::collections::VecDeque;

/// Pieces that may be under way; what is beyond is lost, as in a full cable.
const MOST_PIECES: usize = 20_000;
/// Between two bytes of a frame that comes byte by byte, ns.
const BYTE_NS: u64 = 10_000;
/// How far a device's clock jumps, µs.
const CLOCK_JUMP_MICROS: u32 = 1_000_000;

/// Bytes on their way.
#[derive(Debug, Clone)]
struct Piece {
    due_ns: u64,
    bytes: Vec<u8>,
}

/// One direction.
#[derive(Debug, Clone)]
pub struct Lane {
    transit_ns: u64,
    random: Random,
    fault: Option<(Fault, u64, u64)>,
    frame: Vec<u8>,
    held: Option<Vec<u8>>,
    queue: VecDeque<Piece>,
    touched: u64,
    first_touched_ns: Option<u64>,
}

impl Lane {
    /// A sound lane through which a byte takes `transit_ns`.
    pub fn new(transit_ns: u64) -> Self {
        Self {
            transit_ns,
            random: Random::new(0),
            fault: None,
            frame: Vec::with_capacity(MAX_FRAME),
            held: None,
            queue: VecDeque::new(),
            touched: 0,
            first_touched_ns: None,
        }
    }

    /// Makes a fault of the catalogue begin at `now_ns`. One at a time: a later one replaces it.
    pub fn inject(&mut self, fault: Fault, now_ns: u64, seed: u64) {
        let lasts = u64::from(fault.entry().lasts_ms) * 1_000_000;
        self.random = Random::new(seed);
        self.fault = Some((fault, now_ns, now_ns + lasts));
        self.touched = 0;
        self.first_touched_ns = None;
    }

    /// Frames that the fault has met.
    pub fn touched(&self) -> u64 {
        self.touched
    }

    /// When it met the first one.
    pub fn first_touched_ns(&self) -> Option<u64> {
        self.first_touched_ns
    }

    /// Throws away all that is under way: the plug is out.
    pub fn clear(&mut self) {
        self.queue.clear();
        self.frame.clear();
        self.held = None;
    }

    /// Sends bytes at `now_ns`.
    pub fn put(&mut self, now_ns: u64, bytes: &[u8]) {
        for &byte in bytes {
            self.frame.push(byte);
            if byte == 0 || self.frame.len() >= 4 * MAX_FRAME {
                let frame = core::mem::take(&mut self.frame);
                self.put_frame(now_ns, frame);
            }
        }
    }

    /// Takes what has arrived by `now_ns`.
    pub fn take(&mut self, now_ns: u64, out: &mut Vec<u8>) {
        if let Some((Fault::StopReading, from, until)) = self.fault
            && (from..until).contains(&now_ns)
        {
            self.touch(now_ns);
            return;
        }
        while self.queue.front().is_some_and(|p| p.due_ns <= now_ns) {
            if let Some(piece) = self.queue.pop_front() {
                out.extend_from_slice(&piece.bytes);
            }
        }
    }

    fn touch(&mut self, now_ns: u64) {
        self.touched += 1;
        self.first_touched_ns.get_or_insert(now_ns);
    }

    fn push(&mut self, due_ns: u64, bytes: Vec<u8>) {
        let last = self.queue.back().map_or(0, |piece| piece.due_ns);
        if self.queue.len() < MOST_PIECES {
            self.queue.push_back(Piece {
                due_ns: due_ns.max(last),
                bytes,
            });
        }
    }

    fn put_frame(&mut self, now_ns: u64, frame: Vec<u8>) {
        let due = now_ns + self.transit_ns;
        let Some((fault, from, until)) = self.fault else {
            return self.push(due, frame);
        };
        let lasting = fault.entry().lasts_ms > 0;
        let meant = if lasting {
            (from..until).contains(&now_ns)
        } else {
            now_ns >= from && (self.touched == 0 || is_for_good(fault))
        };
        // a lone delimiter is no frame, and a rewrite waits for the message it is about
        if !meant || frame.len() < 4 {
            if let Some(held) = self.held.take() {
                self.push(due, held);
            }
            return self.push(due, frame);
        }
        self.strike(fault, until, now_ns, frame);
    }

    fn strike(&mut self, fault: Fault, until: u64, now_ns: u64, mut frame: Vec<u8>) {
        let due = now_ns + self.transit_ns;
        if fault != Fault::StopReading {
            self.touch(now_ns);
        }
        match fault {
            Fault::DropFrame | Fault::DropFrames | Fault::Gap4 | Fault::StopSending => {}
            Fault::Duplicate => {
                self.push(due, frame.clone());
                self.push(due, frame);
            }
            Fault::Reorder => match self.held.take() {
                Some(earlier) => {
                    self.push(due, frame);
                    self.push(due, earlier);
                }
                None => self.held = Some(frame),
            },
            Fault::Merge => match self.held.take() {
                Some(mut earlier) => {
                    earlier.extend(frame);
                    self.push(due, earlier);
                }
                None => self.held = Some(frame),
            },
            Fault::Split => {
                for (n, byte) in (0..).zip(frame) {
                    self.push(due + n * BYTE_NS, vec![byte]);
                }
            }
            Fault::Delay5 => self.push(due + 5_000_000, frame),
            Fault::Delay20 => self.push(due + 20_000_000, frame),
            Fault::Delay150 => self.push(due + 150_000_000, frame),
            Fault::Burst => self.push(until.max(due), frame),
            Fault::ClockForward | Fault::ClockBack | Fault::WrongSchema | Fault::WrongVersion => {
                let told = retold(fault, &frame).unwrap_or(frame);
                self.push(due, told);
            }
            _ => {
                self.damage(fault, &mut frame);
                self.push(due, frame);
            }
        }
    }

    // what is done to the bytes of a frame
    fn damage(&mut self, fault: Fault, frame: &mut Vec<u8>) {
        match fault {
            Fault::DropByte => {
                frame.remove(self.random.below(frame.len()));
            }
            Fault::FlipBit => self.flip(frame),
            Fault::FlipBits => {
                let whole = frame.clone();
                // flips may undo each other
                while *frame == whole {
                    for _ in 0..=self.random.below(8) {
                        self.flip(frame);
                    }
                }
            }
            Fault::InsertByte => self.insert(frame),
            Fault::InsertBytes => {
                for _ in 0..=self.random.below(4) {
                    self.insert(frame);
                }
            }
            Fault::Truncate => frame.truncate(1 + self.random.below(frame.len() - 1)),
            _ => {}
        }
    }

    fn flip(&mut self, frame: &mut [u8]) {
        let bit = self.random.below(frame.len() * 8);
        frame[bit / 8] ^= 1 << (bit % 8);
    }

    fn insert(&mut self, frame: &mut Vec<u8>) {
        let byte = self.random.bits().to_le_bytes()[0];
        // inside: a delimiter at an end would be an empty line
        frame.insert(1 + self.random.below(frame.len() - 2), byte);
    }
}

/// Faults that stay once they have begun.
fn is_for_good(fault: Fault) -> bool {
    matches!(
        fault,
        Fault::ClockForward | Fault::ClockBack | Fault::WrongSchema | Fault::WrongVersion
    )
}

/// A device's message with something else in it, in a sound frame; `None` where it does not apply.
fn retold(fault: Fault, frame: &[u8]) -> Option<Vec<u8>> {
    let mut reader = FrameReader::new();
    let read = frame.iter().find_map(|&b| reader.push::<DeviceMessage>(b));
    let message = match (read?.ok()?, fault) {
        (DeviceMessage::State(mut state), Fault::ClockForward) => {
            state.time_micros = state.time_micros.wrapping_add(CLOCK_JUMP_MICROS);
            DeviceMessage::State(state)
        }
        (DeviceMessage::State(mut state), Fault::ClockBack) => {
            state.time_micros = state.time_micros.wrapping_sub(CLOCK_JUMP_MICROS);
            DeviceMessage::State(state)
        }
        (DeviceMessage::Hello(mut hello), Fault::WrongSchema) => {
            hello.schema ^= 1;
            DeviceMessage::Hello(hello)
        }
        (DeviceMessage::Hello(mut hello), Fault::WrongVersion) => {
            hello.version += 1;
            DeviceMessage::Hello(hello)
        }
        _ => return None,
    };
    let mut out = [0; MAX_FRAME];
    Some(encode(&message, &mut out).ok()?.to_vec())
}

#[cfg(test)]
mod tests;
