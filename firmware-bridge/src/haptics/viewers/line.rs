//! One viewer's connection, never waited for: at most one batch is in flight, and while it has not
//! gone out nothing more is made.

use super::BATCH_BYTES;
use osteon_protocol::ipc::{FromViewer, MAX_FROM_VIEWER, MAX_PAYLOAD, ToViewer};
use osteon_protocol::ipc_frame::{HEADER_BYTES, StreamDecoder, encode_into};
use osteon_protocol::secure::PublicKey;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// Bytes read at one visit.
const READ_BYTES: usize = 4096;

/// Who is at the other end, as far as it is proven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Peer {
    /// A process of the same user on this machine.
    Local,
    /// The owner of a trusted key.
    Key(PublicKey),
}

/// A stream that does not block.
pub(crate) trait Wire: Read + Write + Send {}

impl<T: Read + Write + Send> Wire for T {}

/// Why a connection has ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Ended {
    /// The other side went away; it may come back.
    Left(String),
    /// What it sent is not of this protocol; it is not taken back.
    Rude(String),
}

impl core::fmt::Display for Ended {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (Self::Left(why) | Self::Rude(why)) = self;
        f.write_str(why)
    }
}

/// The connection.
pub(crate) struct Line {
    wire: Box<dyn Wire>,
    decoder: StreamDecoder,
    out: Vec<u8>,
    written: usize,
    /// When it was opened.
    pub(crate) since: Instant,
    // when bytes last went out, or nothing waited to
    moved: Instant,
    /// Bytes written in all.
    pub(crate) sent: u64,
}

impl core::fmt::Debug for Line {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Line")
            .field("waiting", &(self.out.len() - self.written))
            .finish_non_exhaustive()
    }
}

impl Line {
    /// Over a stream that does not block.
    pub(crate) fn new(wire: Box<dyn Wire>) -> Self {
        let now = Instant::now();
        Self {
            wire,
            decoder: StreamDecoder::bounded(MAX_FROM_VIEWER),
            out: Vec::new(),
            written: 0,
            since: now,
            moved: now,
            sent: 0,
        }
    }

    /// Most bytes of memory that [`Self::held`] can give: a vector grows by doubling.
    pub(crate) const MOST_HELD: usize = 2 * (BATCH_BYTES + HEADER_BYTES + MAX_PAYLOAD)
        + 2 * (READ_BYTES + HEADER_BYTES + MAX_FROM_VIEWER);

    /// Bytes of memory that it holds.
    pub(crate) fn held(&self) -> usize {
        self.out.capacity() + self.decoder.held()
    }

    /// How long bytes have been waiting to go out without one going.
    pub(crate) fn stuck_for(&self) -> Duration {
        if self.out.is_empty() {
            Duration::ZERO
        } else {
            self.moved.elapsed()
        }
    }

    /// Reads a few bytes, where all that came before was taken out.
    pub(crate) fn read(&mut self) -> Result<(), Ended> {
        if self.decoder.unread() >= HEADER_BYTES + MAX_FROM_VIEWER {
            // not before what is here was taken out: a flood waits in the other side's socket
            return Ok(());
        }
        let mut buffer = [0u8; READ_BYTES];
        match self.wire.read(&mut buffer) {
            Ok(0) => Err(Ended::Left("closed its connection".to_owned())),
            Ok(n) => {
                self.decoder.push(&buffer[..n]);
                Ok(())
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(()),
            Err(e) if e.kind() == ErrorKind::InvalidData => Err(Ended::Rude(e.to_string())),
            Err(e) => Err(Ended::Left(format!("read failed ({e})"))),
        }
    }

    /// The next message that has come.
    pub(crate) fn next(&mut self) -> Result<Option<FromViewer>, Ended> {
        self.decoder.next::<FromViewer>().map_err(|e| {
            Ended::Rude(format!(
                "sent what is no message ({e}); use a viewer of the same release"
            ))
        })
    }

    /// Bytes that wait to be written, those under way included.
    pub(crate) fn waiting(&self) -> usize {
        self.out.len()
    }

    /// Puts a message behind what is in flight.
    pub(crate) fn put(&mut self, message: &ToViewer) -> Result<(), Ended> {
        // our own messages are within their bounds; one that is not must not go unnoticed
        encode_into(message, &mut self.out)
            .map_err(|e| Ended::Left(format!("cannot be told something: {e}")))
    }

    /// Writes what is in flight; true where all of it went.
    pub(crate) fn flush(&mut self) -> Result<bool, Ended> {
        while self.written < self.out.len() {
            match self.wire.write(&self.out[self.written..]) {
                Ok(0) => return Err(Ended::Left("takes no more bytes".to_owned())),
                Ok(n) => {
                    self.written += n;
                    self.sent += n as u64;
                    self.moved = Instant::now();
                }
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(Ended::Left("closed its connection".to_owned())),
            }
        }
        self.out.clear();
        self.written = 0;
        self.moved = Instant::now();
        Ok(true)
    }

    /// Says one last thing; what does not go out at once does not go.
    pub(crate) fn say_last(&mut self, message: &ToViewer) -> Result<(), Ended> {
        self.put(message)?;
        self.flush().map(drop)
    }
}
