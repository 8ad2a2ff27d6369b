//! Frames of the device link: postcard bytes and their CRC-32C in COBS, ended by a zero byte.
//!
//! ```text
//! message ─postcard→ payload ─+ CRC-32C (LE)→ body ─COBS→ no zero byte inside ─+ 0x00→ cable
//!            ≤ 57 bytes            ≤ 61 bytes          ≤ 62 bytes                ≤ 63 bytes
//! ```
//! A frame fits one full-speed USB packet and never fills it, so no zero-length packet is needed.

use crate::crc32c::crc32c;
use serde::{Serialize, de::DeserializeOwned};

/// Most bytes of one frame, delimiter included.
pub const MAX_FRAME: usize = 63;

/// Bytes of every frame that carries a [`crate::device::StateFrame`], delimiter included.
pub const STATE_FRAME_BYTES: usize = 49;

/// Bytes of every frame that carries a [`crate::device::CommandFrame`], delimiter included.
pub const COMMAND_FRAME_BYTES: usize = 18;

/// Bytes of a HID report (and of a packet) that carries one frame.
pub const REPORT_BYTES: usize = 64;

const CRC_BYTES: usize = 4;
const DELIMITER: u8 = 0;
// COBS adds one byte to a body of up to 254.
const MAX_CODED: usize = MAX_FRAME - 1;
const MAX_BODY: usize = MAX_CODED - 1;
const MAX_MESSAGE: usize = MAX_BODY - CRC_BYTES;

/// Why bytes are no message, or a message makes no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameError {
    /// More than [`MAX_FRAME`] bytes without a delimiter, or a message too large for one frame.
    TooLong,
    /// The stuffing is broken or the frame is too short to hold a CRC.
    Framing,
    /// The CRC does not match: bytes were lost or altered.
    Crc,
    /// The CRC matches but the payload is not the message asked for, or bytes are left over.
    Message,
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooLong => "frame of more than 63 bytes",
            Self::Framing => "broken COBS framing",
            Self::Crc => "CRC-32C mismatch",
            Self::Message => "not a message of this protocol",
        })
    }
}

impl core::error::Error for FrameError {}

/// Writes one frame, delimiter included, and returns its bytes.
pub fn encode<'a, T: Serialize>(
    message: &T,
    out: &'a mut [u8; MAX_FRAME],
) -> Result<&'a [u8], FrameError> {
    let mut body = [0; MAX_BODY];
    let length = match postcard::to_slice(message, &mut body[..MAX_MESSAGE]) {
        Ok(payload) => payload.len(),
        Err(postcard::Error::SerializeBufferFull) => return Err(FrameError::TooLong),
        Err(_) => return Err(FrameError::Message),
    };
    let crc = crc32c(&body[..length]).to_le_bytes();
    body[length..length + CRC_BYTES].copy_from_slice(&crc);
    let Ok(coded) = cobs::try_encode(&body[..length + CRC_BYTES], &mut out[..MAX_CODED]) else {
        return Err(FrameError::TooLong);
    };
    out[coded] = DELIMITER;
    Ok(&out[..=coded])
}

/// A frame as a HID report without a number: the frame, then zeros. Zeros after a frame are empty lines, so
/// a [`FrameReader`] reads reports and a serial line alike. `None` where `frame` is longer than
/// [`MAX_FRAME`].
pub fn report(frame: &[u8]) -> Option<[u8; REPORT_BYTES]> {
    let mut report = [0; REPORT_BYTES];
    let room = report[..MAX_FRAME].get_mut(..frame.len())?;
    room.copy_from_slice(frame);
    Some(report)
}

/// Whether 16-bit sequence number `seq` comes after `than`: serial-number arithmetic, so that it
/// holds across the wrap. Numbers 32 768 or more ahead count as old.
pub const fn is_newer(seq: u16, than: u16) -> bool {
    matches!(seq.wrapping_sub(than), 1..=0x7FFF)
}

/// Cuts a byte stream into messages. Holds one frame, allocates nothing, and falls into step at
/// the next delimiter whatever came before.
#[derive(Debug, Clone)]
pub struct FrameReader {
    coded: [u8; MAX_CODED],
    // in 0..=MAX_CODED
    length: usize,
    // set when more than MAX_CODED bytes came since the last delimiter
    too_long: bool,
    body: [u8; MAX_CODED],
}

impl FrameReader {
    /// A reader at a frame's beginning.
    pub const fn new() -> Self {
        Self {
            coded: [0; MAX_CODED],
            length: 0,
            too_long: false,
            body: [0; MAX_CODED],
        }
    }

    /// Takes one byte. `Some` at the end of a frame: its message, or why it is refused. Nothing of
    /// a refused frame is used. A delimiter after a delimiter is an empty line and says nothing.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<Result<T, FrameError>> {
        let payload = self.push_raw(byte)?;
        Some(payload.and_then(message))
    }

    /// As [`Self::push`], but gives the payload whose CRC matched, before it is read as a message.
    /// A handshake needs it to name the version of a peer whose messages it cannot read.
    pub fn push_raw(&mut self, byte: u8) -> Option<Result<&[u8], FrameError>> {
        if byte != DELIMITER {
            match self.coded.get_mut(self.length) {
                Some(slot) => {
                    *slot = byte;
                    self.length += 1;
                }
                None => self.too_long = true,
            }
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.too_long) {
            return Some(Err(FrameError::TooLong));
        }
        (length > 0).then(|| unwrap_body(&self.coded[..length], &mut self.body))
    }
}

impl Default for FrameReader {
    fn default() -> Self {
        Self::new()
    }
}

/// Reads a payload of [`FrameReader::push_raw`] as a message; every byte must be used.
pub fn message<T: DeserializeOwned>(payload: &[u8]) -> Result<T, FrameError> {
    match postcard::take_from_bytes(payload) {
        Ok((message, [])) => Ok(message),
        Ok(_) | Err(_) => Err(FrameError::Message),
    }
}

fn unwrap_body<'a>(coded: &[u8], body: &'a mut [u8; MAX_CODED]) -> Result<&'a [u8], FrameError> {
    let length = match cobs::decode(coded, body) {
        Ok(report) => report.frame_size(),
        Err(_) => return Err(FrameError::Framing),
    };
    let body: &'a [u8] = body.get(..length).ok_or(FrameError::Framing)?;
    let (payload, crc) = body
        .split_last_chunk::<CRC_BYTES>()
        .ok_or(FrameError::Framing)?;
    if u32::from_le_bytes(*crc) == crc32c(payload) {
        Ok(payload)
    } else {
        Err(FrameError::Crc)
    }
}
