//! Incoming bytes of the open protocol: frames, their order, their counters.

use super::port::SerialPort;
use super::{LinkError, LinkStats};
use osteon_protocol::device::{DeviceHello, DeviceMessage, StateFrame};
use osteon_protocol::frame::{self, FrameReader, is_newer};
use std::sync::Arc;

/// Most bytes that one poll takes from the cable: 83 state frames.
const POLL_BYTES: usize = 4096;

/// So many stale states in a row, each newer than the one before: the device counts anew.
const RESTART_RUN: u32 = 100;

/// Reads one cable. Neither waits of itself nor allocates.
#[derive(Debug)]
pub(super) struct Receiver {
    name: Arc<str>,
    pub(super) port: Arc<SerialPort>,
    reader: FrameReader,
    input: [u8; POLL_BYTES],
    sequence: Sequence,
    pub(super) stats: LinkStats,
}

/// What one look at the cable brought: the newest of each message.
#[derive(Debug, Default)]
pub(super) struct Arrivals {
    pub(super) state: Option<StateFrame>,
    pub(super) hello: Option<DeviceHello>,
    pub(super) nonce: Option<u32>,
    /// Version and schema of a hello that cannot be read further.
    pub(super) foreign_hello: Option<(u16, u32)>,
    /// Frames whose CRC matched.
    pub(super) valid: u32,
    /// Bytes taken; they are the first ones of the input buffer.
    pub(super) bytes: usize,
}

impl Receiver {
    pub(super) fn new(name: Arc<str>, port: Arc<SerialPort>) -> Self {
        Self {
            name,
            port,
            reader: FrameReader::new(),
            input: [0; POLL_BYTES],
            sequence: Sequence::default(),
            stats: LinkStats::default(),
        }
    }

    /// The link's name.
    pub(super) fn name(&self) -> &Arc<str> {
        &self.name
    }

    /// The first bytes of the last [`Self::receive`].
    pub(super) fn input(&self, count: usize) -> &[u8] {
        &self.input[..count.min(POLL_BYTES)]
    }

    /// Counts anew.
    pub(super) fn reset(&mut self) {
        self.stats = LinkStats::default();
        self.sequence = Sequence::default();
    }

    /// Takes at most [`POLL_BYTES`] bytes from the cable and sorts what they hold.
    pub(super) fn receive(&mut self) -> Result<Arrivals, LinkError> {
        let bytes = match self.port.read(&mut self.input) {
            Ok(count) => count,
            Err(errno) => {
                return Err(LinkError::Gone {
                    link: Arc::clone(&self.name),
                    errno,
                });
            }
        };
        let mut arrivals = Arrivals {
            bytes,
            ..Arrivals::default()
        };
        for &byte in &self.input[..bytes] {
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
        if self.sequence.restarted() {
            return Err(LinkError::Restarted {
                link: Arc::clone(&self.name),
            });
        }
        Ok(arrivals)
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
#[derive(Debug, Default)]
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

    fn restarted(&self) -> bool {
        self.rising >= RESTART_RUN
    }
}
