//! DICOM files written byte by byte for tests, independent of the reader's crates (PS3.5, PS3.10).

use std::collections::BTreeMap;
use std::path::Path;

/// A value that can be written in either byte order.
#[derive(Debug, Clone)]
pub(crate) enum Value {
    Text(String),
    Words(Vec<u16>),
    Items(Vec<Planted>),
}

/// A way of writing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Syntax {
    Implicit,
    Explicit,
    BigEndian,
    Deflated,
    Rle,
    JpegLs,
}

impl Syntax {
    fn uid(self) -> &'static str {
        match self {
            Self::Implicit => "1.2.840.10008.1.2",
            Self::Explicit => "1.2.840.10008.1.2.1",
            Self::Deflated => "1.2.840.10008.1.2.1.99",
            Self::BigEndian => "1.2.840.10008.1.2.2",
            Self::Rle => "1.2.840.10008.1.2.5",
            Self::JpegLs => "1.2.840.10008.1.2.4.80",
        }
    }
}

/// A data set.
#[derive(Debug, Clone, Default)]
pub(crate) struct Planted(BTreeMap<(u16, u16), ([u8; 2], Value)>);

pub(crate) const PIXELS: (u16, u16) = (0x7fe0, 0x0010);

impl Planted {
    /// One axial CT slice of 16-bit pixels; slope 1, intercept −1000.
    pub(crate) fn ct(columns: u16, rows: u16, position: [f64; 3]) -> Self {
        let mut d = Self::default();
        d.text((0x0008, 0x0016), "UI", "1.2.840.10008.5.1.4.1.1.2");
        d.text(
            (0x0008, 0x0018),
            "UI",
            &format!("1.2.3.4.{}", position[2].to_bits()),
        );
        d.text((0x0008, 0x0060), "CS", "CT");
        d.text((0x0008, 0x0070), "LO", "Planted");
        d.text((0x0010, 0x0010), "PN", "Secret^Name");
        d.text((0x0010, 0x0020), "LO", "ID-17");
        d.text((0x0020, 0x000e), "UI", "1.2.3.4");
        d.text((0x0020, 0x0011), "IS", "3");
        d.numbers((0x0020, 0x0032), &position);
        d.numbers((0x0020, 0x0037), &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        d.word((0x0028, 0x0002), 1);
        d.text((0x0028, 0x0004), "CS", "MONOCHROME2");
        d.word((0x0028, 0x0010), rows);
        d.word((0x0028, 0x0011), columns);
        d.numbers((0x0028, 0x0030), &[0.5, 0.5]);
        d.word((0x0028, 0x0100), 16);
        d.word((0x0028, 0x0101), 16);
        d.word((0x0028, 0x0102), 15);
        d.word((0x0028, 0x0103), 0);
        d.text((0x0028, 0x1052), "DS", "-1000");
        d.text((0x0028, 0x1053), "DS", "1");
        d
    }

    pub(crate) fn text(&mut self, tag: (u16, u16), vr: &str, text: &str) {
        let vr = [vr.as_bytes()[0], vr.as_bytes()[1]];
        self.0.insert(tag, (vr, Value::Text(text.to_owned())));
    }

    /// Decimal strings.
    pub(crate) fn numbers(&mut self, tag: (u16, u16), numbers: &[f64]) {
        let text: Vec<String> = numbers.iter().map(|n| format!("{n:.6}")).collect();
        self.text(tag, "DS", &text.join("\\"));
    }

    pub(crate) fn word(&mut self, tag: (u16, u16), word: u16) {
        self.0.insert(tag, (*b"US", Value::Words(vec![word])));
    }

    pub(crate) fn pixels(&mut self, words: Vec<u16>) {
        self.0.insert(PIXELS, (*b"OW", Value::Words(words)));
    }

    pub(crate) fn items(&mut self, tag: (u16, u16), items: Vec<Self>) {
        self.0.insert(tag, (*b"SQ", Value::Items(items)));
    }

    pub(crate) fn remove(&mut self, tag: (u16, u16)) {
        self.0.remove(&tag);
    }

    /// A whole file.
    pub(crate) fn file(&self, syntax: Syntax) -> Vec<u8> {
        let mut meta = Self::default();
        meta.text((0x0002, 0x0002), "UI", "1.2.840.10008.5.1.4.1.1.2");
        meta.text((0x0002, 0x0003), "UI", "1.2.3.4.5");
        meta.text((0x0002, 0x0010), "UI", syntax.uid());
        meta.text((0x0002, 0x0012), "UI", "1.2.3");
        let meta = meta.data_set(Syntax::Explicit);
        let mut out = vec![0; 128];
        out.extend_from_slice(b"DICM");
        out.extend_from_slice(&[2, 0, 0, 0, b'U', b'L', 4, 0]);
        out.extend_from_slice(&u32::try_from(meta.len()).expect("short").to_le_bytes());
        out.extend_from_slice(&meta);
        let body = self.data_set(syntax);
        if syntax == Syntax::Deflated {
            use std::io::Write as _;
            let mut z = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
            z.write_all(&body).expect("deflated");
            out.extend(z.finish().expect("deflated"));
        } else {
            out.extend(body);
        }
        out
    }

    pub(crate) fn write(&self, path: &Path, syntax: Syntax) {
        std::fs::write(path, self.file(syntax)).expect("written");
    }

    fn data_set(&self, syntax: Syntax) -> Vec<u8> {
        let mut out = Vec::new();
        for (&tag, (vr, value)) in &self.0 {
            let packed = matches!(syntax, Syntax::Rle | Syntax::JpegLs);
            if tag == PIXELS && packed {
                encapsulated(value, &mut out);
                continue;
            }
            let body = value.bytes(syntax);
            head(tag, *vr, body.len(), syntax, &mut out);
            out.extend(body);
        }
        out
    }
}

fn head(tag: (u16, u16), vr: [u8; 2], length: usize, syntax: Syntax, out: &mut Vec<u8>) {
    let length = u32::try_from(length).expect("short");
    word(tag.0, syntax, out);
    word(tag.1, syntax, out);
    let big = syntax == Syntax::BigEndian;
    let long = if big {
        length.to_be_bytes()
    } else {
        length.to_le_bytes()
    };
    if syntax == Syntax::Implicit {
        out.extend(long);
        return;
    }
    out.extend(vr);
    if matches!(&vr, b"OW" | b"SQ" | b"OB") {
        out.extend([0, 0]);
        out.extend(long);
    } else {
        word(u16::try_from(length).expect("short"), syntax, out);
    }
}

fn word(word: u16, syntax: Syntax, out: &mut Vec<u8>) {
    if syntax == Syntax::BigEndian {
        out.extend(word.to_be_bytes());
    } else {
        out.extend(word.to_le_bytes());
    }
}

impl Value {
    fn bytes(&self, syntax: Syntax) -> Vec<u8> {
        let mut out = Vec::new();
        match self {
            Self::Text(text) => {
                out.extend(text.bytes());
                if out.len() % 2 == 1 {
                    out.push(b' ');
                }
            }
            Self::Words(words) => words.iter().for_each(|&w| word(w, syntax, &mut out)),
            Self::Items(items) => {
                for item in items {
                    let body = item.data_set(syntax);
                    // items have no VR
                    word(0xfffe, syntax, &mut out);
                    word(0xe000, syntax, &mut out);
                    let length = u32::try_from(body.len()).expect("short");
                    if syntax == Syntax::BigEndian {
                        out.extend(length.to_be_bytes());
                    } else {
                        out.extend(length.to_le_bytes());
                    }
                    out.extend(body);
                }
            }
        }
        out
    }
}

/// Pixels as one RLE fragment of literal runs (PS3.5 annex G): high bytes, then low bytes.
fn encapsulated(value: &Value, out: &mut Vec<u8>) {
    let Value::Words(words) = value else {
        return;
    };
    let mut segments = Vec::new();
    for shift in [8, 0] {
        let bytes: Vec<u8> = words.iter().map(|w| (w >> shift & 0xff) as u8).collect();
        let mut packed = Vec::new();
        for run in bytes.chunks(128) {
            packed.push(u8::try_from(run.len() - 1).expect("short"));
            packed.extend(run);
        }
        if packed.len() % 2 == 1 {
            packed.push(0);
        }
        segments.push(packed);
    }
    let mut fragment = Vec::new();
    for v in [2, 64, 64 + segments[0].len()] {
        fragment.extend(u32::try_from(v).expect("short").to_le_bytes());
    }
    fragment.resize(64, 0);
    fragment.extend(segments.concat());
    out.extend([
        0xe0, 0x7f, 0x10, 0, b'O', b'B', 0, 0, 0xff, 0xff, 0xff, 0xff,
    ]);
    // an empty offset table, the fragment, the end
    out.extend([0xfe, 0xff, 0, 0xe0, 0, 0, 0, 0]);
    out.extend([0xfe, 0xff, 0, 0xe0]);
    out.extend(u32::try_from(fragment.len()).expect("short").to_le_bytes());
    out.extend(fragment);
    out.extend([0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
}
