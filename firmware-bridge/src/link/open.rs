//! The link to a device that speaks Osteon's open protocol on a serial port.

use super::port::SerialPort;
use super::{DeviceLink, LinkError, LinkStats};
use osteon_protocol::device::{
    CommandFrame, DeviceHello, DeviceMessage, DriveState, HostMessage, StateFrame,
};
use osteon_protocol::frame::{self, FrameReader, MAX_FRAME, is_newer};
use rustix::io::Errno;
use std::sync::Arc;
use std::time::Duration;

/// Most bytes that one poll takes from the cable: 83 state frames.
const POLL_BYTES: usize = 4096;

/// So many stale states in a row, each newer than the one before: the device counts anew.
const RESTART_RUN: u32 = 100;

/// Tries to send the disarm message on a full cable, 1 ms apart.
const DISARM_TRIES: u32 = 20;

/// A device on a serial port.
///
/// [`OpenLink::open`] and [`OpenLink::prepare`] may wait (each wait has an end); `poll` and `send`
/// neither wait nor allocate. Dropping an armed link sends the disarm message.
#[derive(Debug)]
pub struct OpenLink {
    pub(super) name: Arc<str>,
    pub(super) hello: DeviceHello,
    pub(super) stats: LinkStats,
    port: SerialPort,
    reader: FrameReader,
    input: [u8; POLL_BYTES],
    outbox: Outbox,
    sequence: Sequence,
    pub(super) armed: bool,
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

impl OpenLink {
    /// Opens the port at `path` and shakes hands: the device must answer, in this version.
    /// Takes at most 2 s.
    pub fn open(path: &str) -> Result<Self, LinkError> {
        let name: Arc<str> = format!("open:{path}").into();
        let port = SerialPort::open(path, &name)?;
        let mut link = Self {
            name,
            hello: NO_HELLO,
            stats: LinkStats::default(),
            port,
            reader: FrameReader::new(),
            input: [0; POLL_BYTES],
            outbox: Outbox::default(),
            sequence: Sequence::default(),
            armed: false,
        };
        link.shake_hands()?;
        Ok(link)
    }

    /// Takes at most [`POLL_BYTES`] bytes from the cable and sorts what they hold.
    pub(super) fn receive(&mut self) -> Result<Arrivals, LinkError> {
        let bytes = match self.port.read(&mut self.input) {
            Ok(count) => count,
            Err(errno) => return Err(self.gone(errno)),
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

    /// Sends one message, or drops it when the cable is full: then `false`.
    pub(super) fn transmit(&mut self, message: HostMessage) -> Result<bool, LinkError> {
        let sent = self.outbox.flush(&self.port).and_then(|clear| {
            if clear {
                self.outbox.write(message, &self.port)
            } else {
                Ok(false)
            }
        });
        match sent {
            Ok(sent) => Ok(sent),
            Err(OutboxError::Errno(errno)) => Err(self.gone(errno)),
            Err(OutboxError::Frame(error)) => Err(LinkError::Frame {
                link: Arc::clone(&self.name),
                error,
            }),
        }
    }

    /// The first bytes of the last [`Self::receive`].
    pub(super) fn input(&self, count: usize) -> &[u8] {
        &self.input[..count.min(POLL_BYTES)]
    }

    /// Forgets the counts of the handshake: a session begins with clean ones, in the middle of a
    /// stream whose first piece may have been half a frame.
    pub(super) fn reset_stats(&mut self) {
        self.stats = LinkStats::default();
        self.sequence = Sequence::default();
    }

    fn gone(&self, errno: Errno) -> LinkError {
        LinkError::Gone {
            link: Arc::clone(&self.name),
            errno,
        }
    }
}

impl DeviceLink for OpenLink {
    fn info(&self) -> &DeviceHello {
        &self.hello
    }

    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        Ok(self.receive()?.state)
    }

    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        self.armed = true;
        if !self.transmit(HostMessage::Command(*command))? {
            self.stats.dropped_commands += 1;
        }
        Ok(())
    }

    fn disarm(&mut self) {
        self.armed = false;
        for _ in 0..DISARM_TRIES {
            // A cable that is gone needs no message: the device's watchdog sees the silence.
            match self.transmit(HostMessage::Disarm) {
                Ok(false) => std::thread::sleep(Duration::from_millis(1)),
                Ok(true) | Err(_) => return,
            }
        }
    }

    fn stats(&self) -> LinkStats {
        self.stats
    }

    fn describe(&self) -> String {
        self.name.to_string()
    }
}

impl Drop for OpenLink {
    fn drop(&mut self) {
        if self.armed {
            self.disarm();
        }
    }
}

/// Placeholder until the device has introduced itself; never seen outside this module.
const NO_HELLO: DeviceHello = DeviceHello {
    version: 0,
    schema: 0,
    model: 0,
    serial: 0,
    counts_per_rev: 0,
    gimbal_counts_per_rev: 0,
    dac_max: 0,
    micro_nm_per_count: 0,
    period_micros: 0,
};

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

/// The frame on its way out. A frame that was begun is finished before another one starts, or the
/// device would see a torn one.
#[derive(Debug)]
struct Outbox {
    frame: [u8; MAX_FRAME],
    // bytes of `frame` still to be written: begin..end
    begin: usize,
    end: usize,
}

impl Default for Outbox {
    fn default() -> Self {
        Self {
            frame: [0; MAX_FRAME],
            begin: 0,
            end: 0,
        }
    }
}

enum OutboxError {
    Errno(Errno),
    Frame(frame::FrameError),
}

impl Outbox {
    /// Writes the rest of a frame that was begun; true = nothing is left.
    fn flush(&mut self, port: &SerialPort) -> Result<bool, OutboxError> {
        if self.begin < self.end {
            let rest = &self.frame[self.begin..self.end];
            self.begin += port.write(rest).map_err(OutboxError::Errno)?;
        }
        Ok(self.begin == self.end)
    }

    /// Writes a message onto a clear cable; false = not a byte of it went out.
    fn write(&mut self, message: HostMessage, port: &SerialPort) -> Result<bool, OutboxError> {
        let length = frame::encode(&message, &mut self.frame)
            .map_err(OutboxError::Frame)?
            .len();
        let count = port
            .write(&self.frame[..length])
            .map_err(OutboxError::Errno)?;
        (self.begin, self.end) = if count == 0 { (0, 0) } else { (count, length) };
        Ok(count > 0)
    }
}

/// Name of a drive state for people.
pub(super) fn drive_name(drive: DriveState) -> &'static str {
    match drive {
        DriveState::Boot => "booting",
        DriveState::Unhomed => "unhomed",
        DriveState::Homed => "homed",
        DriveState::Armed => "armed",
        DriveState::Active => "active",
        DriveState::Hold => "in hold",
        DriveState::Tripped => "tripped",
        DriveState::Fault => "in fault",
    }
}
