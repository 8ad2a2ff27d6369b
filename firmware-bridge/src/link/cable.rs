//! What carries bytes to a device and back without waiting.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::fmt;
use std::os::fd::{AsFd, OwnedFd};
use std::time::Duration;

/// Bytes of a HID report, and of a packet.
pub(super) use osteon_protocol::frame::REPORT_BYTES;

/// A cable. `read` and `write` never wait.
pub(super) trait Cable: Send + Sync + fmt::Debug {
    /// Reads what is there; 0 = nothing.
    fn read(&self, into: &mut [u8]) -> Result<usize, Errno>;

    /// Writes what fits; 0 = the cable is full. Cables of packets take a frame whole or not at all.
    fn write(&self, bytes: &[u8]) -> Result<usize, Errno>;

    /// Until there is something to read, at most `limit`.
    fn wait(&self, limit: Duration);
}

/// Until `fd` has something to read, at most `limit`; an interrupted wait must not become a busy one.
pub(super) fn wait_readable(fd: impl AsFd, limit: Duration) {
    let limit = Timespec {
        tv_sec: i64::try_from(limit.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: i64::from(limit.subsec_nanos()),
    };
    let mut look = [PollFd::new(&fd, PollFlags::IN)];
    if poll(&mut look, Some(&limit)).is_err() {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// One end of a socket of packets: a frame a packet, padded to a report.
#[derive(Debug)]
pub(super) struct PairCable {
    socket: OwnedFd,
}

impl PairCable {
    /// Takes a connected, non-blocking socket that keeps packets apart.
    pub(super) fn new(socket: OwnedFd) -> Self {
        Self { socket }
    }
}

impl Cable for PairCable {
    fn read(&self, into: &mut [u8]) -> Result<usize, Errno> {
        let mut count = 0;
        while let Some(room) = into.get_mut(count..count + REPORT_BYTES) {
            match read_packet(&self.socket, room)? {
                0 => break,
                bytes => count += bytes,
            }
        }
        Ok(count)
    }

    fn write(&self, bytes: &[u8]) -> Result<usize, Errno> {
        write_packet(&self.socket, bytes)
    }

    fn wait(&self, limit: Duration) {
        wait_readable(&self.socket, limit);
    }
}

/// One packet; 0 = none is there.
pub(super) fn read_packet(socket: &OwnedFd, into: &mut [u8]) -> Result<usize, Errno> {
    match rustix::io::read(socket, into) {
        // the other end has gone
        Ok(0) => Err(Errno::PIPE),
        Ok(count) => Ok(count),
        Err(Errno::AGAIN | Errno::INTR) => Ok(0),
        Err(errno) => Err(errno),
    }
}

/// A frame as one packet; 0 = the socket is full.
pub(super) fn write_packet(socket: &OwnedFd, frame: &[u8]) -> Result<usize, Errno> {
    let Some(report) = osteon_protocol::frame::report(frame) else {
        return Err(Errno::MSGSIZE);
    };
    match rustix::io::write(socket, &report) {
        Ok(_) => Ok(frame.len()),
        Err(Errno::AGAIN | Errno::INTR | Errno::NOBUFS) => Ok(0),
        Err(errno) => Err(errno),
    }
}
