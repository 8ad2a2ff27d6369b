//! One slice's pixels as stored numbers, whatever they are packed in.

use super::header::{self, Stored};
use super::tags;
use dicom_encoding::transfer_syntax::{Codec, TransferSyntaxIndex as _};
use dicom_object::DefaultDicomObject;
use dicom_transfer_syntax_registry::TransferSyntaxRegistry;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// JPEG-LS: no decoder in pure Rust is known.
const JPEG_LS: [&str; 2] = ["1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.4.81"];

/// Transfer syntaxes that lose something of the CT numbers.
const LOSSY: [(&str, &str); 5] = [
    ("1.2.840.10008.1.2.4.50", "JPEG baseline"),
    ("1.2.840.10008.1.2.4.51", "JPEG extended"),
    ("1.2.840.10008.1.2.4.81", "JPEG-LS near-lossless"),
    ("1.2.840.10008.1.2.4.91", "JPEG 2000"),
    ("1.2.840.10008.1.2.4.93", "JPEG 2000 part 2"),
];

/// The name of a transfer syntax that is not lossless.
pub(crate) fn lossy(syntax: &str) -> Option<&'static str> {
    LOSSY
        .iter()
        .find(|(uid, _)| *uid == syntax)
        .map(|&(_, name)| name)
}

/// Refuses, from the header alone, a transfer syntax that nothing here decodes.
pub(crate) fn check_syntax(uid: &str) -> Result<(), String> {
    let name = |why: &str| {
        Err(format!(
            "transfer syntax {uid} ({why}) is not decoded here; unpack the series, e.g. `gdcmconv --raw IN OUT`"
        ))
    };
    if JPEG_LS.contains(&uid) {
        return name("JPEG-LS");
    }
    match TransferSyntaxRegistry.get(uid) {
        Some(syntax) if syntax.can_decode_all() => Ok(()),
        Some(syntax) => name(syntax.name()),
        None => name("unknown"),
    }
}

/// An opened file of one or more frames.
#[derive(Debug)]
pub(crate) struct Opened {
    object: DefaultDicomObject,
}

/// Opens a file with its pixels. The error is a reason without the file's name.
pub(crate) fn open(path: &Path) -> Result<Opened, String> {
    let damaged = |e| format!("a damaged DICOM file ({e}); copy the series again");
    let object = header::open(path, true)
        .map_err(damaged)?
        .ok_or_else(|| "no longer a DICOM file; import again".to_owned())?;
    Ok(Opened { object })
}

impl Opened {
    /// The stored numbers of one frame, row by row. The error is a reason without the file's name.
    pub(crate) fn frame(&self, frame: u32, stored: &Stored) -> Result<Vec<i32>, String> {
        let uid = self.object.meta().transfer_syntax();
        let uid = uid.trim_end_matches(['\0', ' ']);
        check_syntax(uid)?;
        let syntax = TransferSyntaxRegistry
            .get(uid)
            .ok_or("an unknown transfer syntax")?;
        let length = stored.rows * stored.columns * usize::from(stored.bits_allocated / 8);
        let bytes = match syntax.codec() {
            Codec::EncapsulatedPixelData(Some(reader), _) => {
                let mut bytes = Vec::new();
                // a codec of others that meets a damaged stream may panic
                let done = catch_unwind(AssertUnwindSafe(|| {
                    reader.decode_frame(&self.object, frame, &mut bytes)
                }));
                match done {
                    Ok(Ok(())) => bytes,
                    Ok(Err(e)) => {
                        let why = header::reason(&e);
                        return Err(format!(
                            "its {} pixels cannot be decoded ({why}); copy the series again",
                            syntax.name()
                        ));
                    }
                    Err(_panic) => {
                        return Err(format!(
                            "its {} pixels are damaged; copy the series again",
                            syntax.name()
                        ));
                    }
                }
            }
            _ => self.native(frame, length)?,
        };
        if bytes.len() < length {
            return Err(format!(
                "truncated: {length} bytes of pixels expected, {} there; copy the series again",
                bytes.len()
            ));
        }
        Ok(numbers(&bytes[..length], stored))
    }

    /// One frame of pixels that are not packed.
    fn native(&self, frame: u32, length: usize) -> Result<Vec<u8>, String> {
        let element = self
            .object
            .get(tags::PIXEL_DATA)
            .ok_or("holds no pixels; copy the series again")?;
        let bytes = element
            .to_bytes()
            .map_err(|e| format!("its pixels cannot be read ({})", header::reason(&e)))?;
        let from = (frame as usize).saturating_mul(length).min(bytes.len());
        let to = (from + length).min(bytes.len());
        Ok(bytes[from..to].to_vec())
    }
}

/// Little-endian containers to numbers: the stored bits alone, with their sign.
fn numbers(bytes: &[u8], stored: &Stored) -> Vec<i32> {
    let (bits, top) = (u32::from(stored.bits_stored), u32::from(stored.high_bit));
    let shift_down = 64 - bits;
    let of_container = |container: u64| {
        // the stored bits at the top of a word, then back with or without their sign
        let at_top = container << (63 - top);
        let value = if stored.signed {
            at_top.cast_signed() >> shift_down
        } else {
            (at_top >> shift_down).cast_signed()
        };
        i32::try_from(value).unwrap_or(i32::MAX)
    };
    if stored.bits_allocated == 32 {
        let (words, _) = bytes.as_chunks::<4>();
        words
            .iter()
            .map(|w| of_container(u64::from(u32::from_le_bytes(*w))))
            .collect()
    } else {
        let (words, _) = bytes.as_chunks::<2>();
        words
            .iter()
            .map(|w| of_container(u64::from(u16::from_le_bytes(*w))))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_stored_bits_count_with_their_sign() {
        let stored = |bits_stored, high_bit, signed| Stored {
            rows: 1,
            columns: 2,
            bits_allocated: 16,
            bits_stored,
            high_bit,
            signed,
        };
        // 12 of 16 bits, rubbish (an overlay) above
        let bytes = [0xff, 0xaf, 0x01, 0x70];
        assert_eq!(numbers(&bytes, &stored(12, 11, false)), [0xfff, 1]);
        assert_eq!(numbers(&bytes, &stored(12, 11, true)), [-1, 1]);
        // left-aligned
        assert_eq!(numbers(&bytes, &stored(12, 15, false)), [0xaff, 0x700]);
        assert_eq!(
            numbers(&bytes, &stored(16, 15, true)),
            [0xafff - 0x10000, 0x7001]
        );
    }
}
