//! Stream framing of the viewer link: length (u32 LE), CRC-32C of the payload (u32 LE), postcard
//! payload.
//!
//! The link is a local stream socket, so a wrong byte means a wrong program at the other end: an
//! error is final, and the connection is to be closed. Nothing is believed before it is bounded.

use crate::crc32c::crc32c;
use crate::ipc::MAX_PAYLOAD;
use serde::{Serialize, de::DeserializeOwned};

pub use crate::ipc_pack::{PieceValues, UnpackedPiece};
pub use crate::ipc_pack::{pack_bricks, pack_piece, unpack_bricks, unpack_piece};
pub use crate::ipc_valid::{MAX_NAME, MAX_OUTLINE, MAX_TEXT, MAX_TOOLS, clip};

/// Bytes before the payload.
pub const HEADER_BYTES: usize = 8;

/// Most bytes that a [`StreamDecoder`] keeps: two largest messages.
pub const MAX_BUFFERED: usize = 2 * (HEADER_BYTES + MAX_PAYLOAD);

/// Why a message was refused. Final: close the connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IpcError {
    /// A payload above [`MAX_PAYLOAD`], or above what the receiver takes, is announced or made.
    TooLong,
    /// The CRC does not match.
    Crc,
    /// The CRC matches but the payload is not the message asked for, or bytes are left over.
    Message,
    /// A field is outside its documented range; the name says which.
    Range(&'static str),
    /// A block does not unpack to its exact size; the name says which.
    Block(&'static str),
    /// More than [`MAX_BUFFERED`] bytes were pushed without taking messages out.
    Overrun,
}

impl core::fmt::Display for IpcError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooLong => write!(f, "message of too many bytes"),
            Self::Crc => write!(f, "message with a CRC-32C mismatch"),
            Self::Message => write!(f, "bytes that are no message of this protocol"),
            Self::Range(field) => write!(f, "message whose {field} is out of range"),
            Self::Block(block) => write!(f, "{block} that does not unpack to its exact size"),
            Self::Overrun => write!(f, "more than {MAX_BUFFERED} bytes unread"),
        }
    }
}

impl core::error::Error for IpcError {}

/// A message of the viewer link: known to serde, and able to check its own ranges.
pub trait Message: Serialize + DeserializeOwned {
    /// Whether every field is inside its documented range: lengths, indices, finite numbers.
    fn validate(&self) -> Result<(), IpcError>;
}

/// Appends one framed message to `out`; on an error `out` is as before.
pub fn encode_into<T: Serialize>(message: &T, out: &mut Vec<u8>) -> Result<(), IpcError> {
    let begin = out.len();
    out.extend_from_slice(&[0; HEADER_BYTES]);
    let appended = postcard::serialize_with_flavor(message, Append::new(out));
    if let Err(error) = appended {
        out.truncate(begin);
        return Err(match error {
            postcard::Error::SerializeBufferFull => IpcError::TooLong,
            _ => IpcError::Message,
        });
    }
    let payload = &out[begin + HEADER_BYTES..];
    let Ok(length) = u32::try_from(payload.len()).map(u32::to_le_bytes) else {
        return Err(IpcError::TooLong);
    };
    let crc = crc32c(payload).to_le_bytes();
    out[begin..begin + 4].copy_from_slice(&length);
    out[begin + 4..begin + HEADER_BYTES].copy_from_slice(&crc);
    Ok(())
}

/// Appends to a vector, at most [`MAX_PAYLOAD`] bytes.
struct Append<'a> {
    out: &'a mut Vec<u8>,
    // out.len() may not pass this
    limit: usize,
}

impl<'a> Append<'a> {
    fn new(out: &'a mut Vec<u8>) -> Self {
        let limit = out.len() + MAX_PAYLOAD;
        Self { out, limit }
    }
}

impl postcard::ser_flavors::Flavor for Append<'_> {
    type Output = ();

    fn try_extend(&mut self, data: &[u8]) -> postcard::Result<()> {
        if data.len() > self.limit - self.out.len() {
            return Err(postcard::Error::SerializeBufferFull);
        }
        self.out.extend_from_slice(data);
        Ok(())
    }

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.try_extend(&[byte])
    }

    fn finalize(self) -> postcard::Result<()> {
        Ok(())
    }
}

/// Cuts a byte stream into messages. Feed it with [`Self::push`], then take messages with
/// [`Self::next`] until it gives `None`.
#[derive(Debug)]
pub struct StreamDecoder {
    buffer: Vec<u8>,
    // bytes of `buffer` that are used up; in 0..=buffer.len()
    used: usize,
    // largest payload
    most: usize,
    failed: Option<IpcError>,
}

impl Default for StreamDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl StreamDecoder {
    /// A decoder at a stream's beginning.
    pub const fn new() -> Self {
        Self::bounded(MAX_PAYLOAD)
    }

    /// A decoder that refuses payloads of more than `most` bytes, at most [`MAX_PAYLOAD`].
    pub const fn bounded(most: usize) -> Self {
        Self {
            buffer: Vec::new(),
            used: 0,
            most,
            failed: None,
        }
    }

    /// Bytes that were pushed and are no message yet, or were not asked for.
    pub fn unread(&self) -> usize {
        self.buffer.len() - self.used
    }

    /// Bytes of memory that it holds.
    pub fn held(&self) -> usize {
        self.buffer.capacity()
    }

    /// Takes bytes of the stream. Holds at most [`MAX_BUFFERED`]; more is an error that
    /// [`Self::next`] reports.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.failed.is_some() {
            return;
        }
        self.buffer.drain(..self.used);
        self.used = 0;
        if bytes.len() > MAX_BUFFERED - self.buffer.len() {
            self.fail(IpcError::Overrun);
            return;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole message, checked; `None` when more bytes are needed. After an error the
    /// stream cannot be trusted: every later call gives the same error.
    #[expect(
        clippy::should_implement_trait,
        reason = "the caller names the message, which an iterator cannot"
    )]
    pub fn next<T: Message>(&mut self) -> Result<Option<T>, IpcError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        match next_message(&self.buffer[self.used..], self.most) {
            Ok(Some((message, length))) => {
                self.used += length;
                Ok(Some(message))
            }
            Ok(None) => Ok(None),
            Err(error) => Err(self.fail(error)),
        }
    }

    fn fail(&mut self, error: IpcError) -> IpcError {
        self.failed = Some(error);
        self.buffer = Vec::new();
        self.used = 0;
        error
    }
}

/// The first message of `bytes` and its framed length; `None` when it is not whole yet.
fn next_message<T: Message>(bytes: &[u8], most: usize) -> Result<Option<(T, usize)>, IpcError> {
    let Some((length, rest)) = bytes.split_first_chunk::<4>() else {
        return Ok(None);
    };
    let length = u32::from_le_bytes(*length) as usize;
    if length > most.min(MAX_PAYLOAD) {
        return Err(IpcError::TooLong);
    }
    let Some((crc, rest)) = rest.split_first_chunk::<4>() else {
        return Ok(None);
    };
    let Some(payload) = rest.get(..length) else {
        return Ok(None);
    };
    if u32::from_le_bytes(*crc) != crc32c(payload) {
        return Err(IpcError::Crc);
    }
    let Ok((message, [])) = postcard::take_from_bytes::<T>(payload) else {
        return Err(IpcError::Message);
    };
    message.validate()?;
    Ok(Some((message, HEADER_BYTES + length)))
}
