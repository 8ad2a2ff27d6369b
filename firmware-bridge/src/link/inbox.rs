//! Incoming bytes of the open protocol: frames, their order, their counters. No clock and no I/O.

use super::LinkStats;
use osteon_protocol::device::{DeviceHello, DeviceMessage, StateFrame};
use osteon_protocol::frame::{self, FrameReader, is_newer};

/// So many stale states in a row, each newer than the one before: the device counts anew.
const RESTART_RUN: u32 = 100;

/// Sorts one cable's bytes. Allocates nothing.
#[derive(Debug, Clone, Default)]
pub(crate) struct Inbox {
    reader: FrameReader,
    sequence: Sequence,
    pub(crate) stats: LinkStats,
}

/// What one look at the cable brought: the newest of each message.
#[derive(Debug, Default)]
pub(crate) struct Arrivals {
    pub(crate) state: Option<StateFrame>,
    pub(crate) hello: Option<DeviceHello>,
    pub(crate) nonce: Option<u32>,
    /// Version and schema of a hello that cannot be read further.
    pub(crate) foreign_hello: Option<(u16, u32)>,
    /// Frames whose CRC matched.
    pub(crate) valid: u32,
    /// Bytes taken; they are the first ones of the input buffer.
    pub(crate) bytes: usize,
}

impl Inbox {
    /// Counts anew.
    pub(crate) fn reset(&mut self) {
        self.stats = LinkStats::default();
        self.sequence = Sequence::default();
    }

    /// Sorts what `bytes` hold.
    pub(crate) fn take(&mut self, bytes: &[u8]) -> Arrivals {
        let mut arrivals = Arrivals {
            bytes: bytes.len(),
            ..Arrivals::default()
        };
        for &byte in bytes {
            let Some(outcome) = self.reader.push_raw(byte) else {
                continue;
            };
            let Ok(payload) = outcome else {
                self.stats.crc_errors += 1;
                continue;
            };
            arrivals.valid += 1;
            match frame::message::<DeviceMessage>(payload) {
                Ok(DeviceMessage::State(state)) => {
                    if self.sequence.accept(state.seq, &mut self.stats) {
                        arrivals.state = Some(state);
                    }
                }
                Ok(DeviceMessage::Hello(hello)) => arrivals.hello = Some(hello),
                Ok(DeviceMessage::Challenge { nonce }) => arrivals.nonce = Some(nonce),
                Err(_) => {
                    self.stats.crc_errors += 1;
                    arrivals.foreign_hello = hello_beginning(payload).or(arrivals.foreign_hello);
                }
            }
        }
        arrivals
    }

    /// Whether the device counts its states anew.
    pub(crate) fn restarted(&self) -> bool {
        self.sequence.rising >= RESTART_RUN
    }
}

/// Version and schema of a hello of any version: `WIRE.md` promises that its tag and its first two
/// fields never move.
fn hello_beginning(payload: &[u8]) -> Option<(u16, u32)> {
    match *payload {
        [0, v0, v1, s0, s1, s2, s3, ..] => Some((
            u16::from_le_bytes([v0, v1]),
            u32::from_le_bytes([s0, s1, s2, s3]),
        )),
        _ => None,
    }
}

/// Guards the order of the states.
#[derive(Debug, Clone, Default)]
struct Sequence {
    newest: Option<u16>,
    // the last stale number, and how many stale ones in a row rose
    stale: Option<u16>,
    rising: u32,
}

impl Sequence {
    /// Whether state number `seq` is newer than all before; counts what it finds.
    fn accept(&mut self, seq: u16, stats: &mut LinkStats) -> bool {
        match self.newest {
            Some(newest) if !is_newer(seq, newest) => {
                stats.stale += 1;
                let rises = self.stale.is_some_and(|stale| is_newer(seq, stale));
                self.rising = if rises { self.rising + 1 } else { 0 };
                self.stale = Some(seq);
                return false;
            }
            Some(newest) => stats.gaps += u64::from(seq.wrapping_sub(newest) - 1),
            None => {}
        }
        *self = Self {
            newest: Some(seq),
            stale: None,
            rising: 0,
        };
        stats.frames += 1;
        true
    }
}
