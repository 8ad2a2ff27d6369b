//! STL, binary and ASCII. A reader of our own: what it has to do well is to refuse (from the size,
//! before anything is read or allocated) and to name the place.

use glam::Vec3;
use osteon_sim_core::tool::bvh::Triangle;
use osteon_sim_core::tool::mesh::MAX_TRIANGLES;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read as _};
use std::path::Path;

/// Bytes of a binary file before its first triangle, and of a triangle.
const HEAD: u64 = 84;
const RECORD_BYTES: usize = 50;
const RECORD: u64 = RECORD_BYTES as u64;
/// Longest ASCII file: 400 bytes are plenty for a triangle.
const MAX_TEXT: u64 = MAX_TRIANGLES as u64 * 400;
/// Longest line of an ASCII file.
const MAX_LINE: u64 = 4096;

/// Why a file is no mesh; one line with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum StlError {
    /// It cannot be read.
    #[error("cannot be read ({0}); check the path, which starts at the folder of the tools file")]
    Read(#[from] io::Error),
    /// A folder, a pipe, a device.
    #[error("is no regular file; give an STL file")]
    NoFile,
    /// No triangle.
    #[error("has no triangle; export the solid again")]
    Empty,
    /// Too short for a binary header, and no text.
    #[error("no STL: {0} bytes that are neither ASCII nor a binary header of 84; export it as STL")]
    NoStl(u64),
    /// More than [`MAX_TRIANGLES`].
    #[error("{0} triangles (at most {MAX_TRIANGLES}); decimate it, 100000 are plenty for a tool")]
    TooMany(u64),
    /// An ASCII file beyond any mesh that is taken.
    #[error("{0} bytes of ASCII (at most {MAX_TEXT}); decimate it, or export it as binary STL")]
    TooLong(u64),
    /// Fewer bytes than the header's count asks for.
    #[error(
        "truncated: its header says {says} triangles and it holds {holds}; export or copy it again"
    )]
    Truncated {
        /// Triangles by the header.
        says: u64,
        /// Whole triangles there.
        holds: u64,
    },
    /// More bytes than the header's count asks for.
    #[error("its header says {says} triangles and it holds {holds}; export it again")]
    Count {
        /// Triangles by the header.
        says: u64,
        /// Whole triangles there.
        holds: u64,
    },
    /// ASCII that is no STL.
    #[error("line {line}: {problem}; export it again, binary if possible")]
    Text {
        /// Where, from 1.
        line: u64,
        /// What is wrong.
        problem: String,
    },
}

/// Triangles as they stand in the file, in its units; corners may be anything, NaN included.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Soup {
    /// The triangles.
    pub triangles: Vec<Triangle>,
    /// Bytes after the last triangle, ignored.
    pub trailing: u64,
}

/// Reads a file.
pub fn read(path: &Path) -> Result<Soup, StlError> {
    // asked first: opening a pipe would wait for its writer
    let about = std::fs::metadata(path)?;
    if !about.is_file() {
        return Err(StlError::NoFile);
    }
    parse(BufReader::new(File::open(path)?), about.len())
}

/// Reads a stream of `size` bytes.
pub fn parse(mut input: impl BufRead, size: u64) -> Result<Soup, StlError> {
    let mut head = Vec::new();
    input.by_ref().take(HEAD).read_to_end(&mut head)?;
    if head.is_empty() {
        return Err(StlError::Empty);
    }
    let says = head
        .last_chunk::<4>()
        .filter(|_| head.len() as u64 == HEAD)
        .map(|count| u64::from(u32::from_le_bytes(*count)));
    let exact = says.is_some_and(|n| size == HEAD + n * RECORD);
    if !exact && is_text(&head) {
        if size > MAX_TEXT {
            return Err(StlError::TooLong(size));
        }
        return text(head.chain(input));
    }
    let says = says.ok_or(StlError::NoStl(size))?;
    if says > MAX_TRIANGLES as u64 {
        return Err(StlError::TooMany(says));
    }
    let holds = size.saturating_sub(HEAD) / RECORD;
    if holds < says {
        return Err(StlError::Truncated { says, holds });
    }
    if holds > says {
        return Err(StlError::Count { says, holds });
    }
    if says == 0 {
        return Err(StlError::Empty);
    }
    let trailing = size - HEAD - says * RECORD;
    binary(input, says, trailing)
}

/// Text by its content: many binary files begin with `solid` too, but have zeros in their header or
/// count.
fn is_text(head: &[u8]) -> bool {
    let word = head.trim_ascii_start().get(..5).unwrap_or_default();
    let printable = |b: &u8| *b >= 0x20 && *b != 0x7f || b"\t\r\n\x0c".contains(b);
    word.eq_ignore_ascii_case(b"solid") && head.iter().all(printable)
}

fn binary(mut input: impl BufRead, count: u64, trailing: u64) -> Result<Soup, StlError> {
    // the file is as long as its count says, so this allocates no more than the file holds
    let mut triangles = Vec::with_capacity(usize::try_from(count).unwrap_or(0));
    for _ in 0..count {
        let mut record = [0u8; RECORD_BYTES];
        input.read_exact(&mut record)?;
        let number = |n: usize| {
            let at = 4 * n;
            f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
        };
        // the normal, numbers 0 to 2, is left to the order of the corners
        triangles.push([3, 6, 9].map(|n| Vec3::new(number(n), number(n + 1), number(n + 2))));
    }
    Ok(Soup {
        triangles,
        trailing,
    })
}

/// An ASCII file, token by token.
#[derive(Default)]
struct TextReader {
    triangles: Vec<Triangle>,
    corners: Vec<Vec3>,
    in_facet: bool,
    ended: bool,
}

fn text(mut input: impl BufRead) -> Result<Soup, StlError> {
    let mut reader = TextReader::default();
    let mut bytes = Vec::new();
    for line in 1u64.. {
        let fault = |problem: String| StlError::Text { line, problem };
        bytes.clear();
        let length = input
            .by_ref()
            .take(MAX_LINE)
            .read_until(b'\n', &mut bytes)?;
        if length == 0 {
            if !reader.ended || reader.in_facet {
                return Err(fault("the file ends before endsolid: truncated".to_owned()));
            }
            break;
        }
        if length as u64 == MAX_LINE && !bytes.ends_with(b"\n") {
            return Err(fault(format!("longer than {MAX_LINE} bytes")));
        }
        reader
            .line(&String::from_utf8_lossy(&bytes))
            .map_err(|problem| match bytes.last() {
                Some(b'\n') => fault(problem),
                _ => fault("the file ends in mid line: truncated".to_owned()),
            })?;
        if reader.triangles.len() > MAX_TRIANGLES {
            return Err(StlError::TooMany(reader.triangles.len() as u64));
        }
    }
    if reader.triangles.is_empty() {
        return Err(StlError::Empty);
    }
    Ok(Soup {
        triangles: reader.triangles,
        trailing: 0,
    })
}

impl TextReader {
    fn line(&mut self, line: &str) -> Result<(), String> {
        let mut words = line.split_ascii_whitespace();
        while let Some(word) = words.next() {
            match word.to_ascii_lowercase().as_str() {
                // the rest of the line is a name
                "solid" | "endsolid" if self.in_facet => {
                    return Err(format!("'{word}' inside a facet"));
                }
                "solid" => {
                    self.ended = false;
                    break;
                }
                "endsolid" => {
                    self.ended = true;
                    break;
                }
                "facet" if !self.in_facet => self.in_facet = true,
                // the normal is left to the order of the corners
                "normal" if self.in_facet => {
                    words.by_ref().take(3).for_each(drop);
                }
                "outer" | "loop" | "endloop" if self.in_facet => {}
                "vertex" if self.in_facet => {
                    let corner = [words.next(), words.next(), words.next()]
                        .map(|w| w.and_then(|w| w.parse().ok()));
                    let [Some(x), Some(y), Some(z)] = corner else {
                        return Err("a vertex without three numbers".to_owned());
                    };
                    self.corners.push(Vec3::new(x, y, z));
                }
                "endfacet" if self.in_facet => {
                    let &[a, b, c] = self.corners.as_slice() else {
                        return Err(format!("a facet of {} corners", self.corners.len()));
                    };
                    self.triangles.push([a, b, c]);
                    self.corners.clear();
                    self.in_facet = false;
                }
                _ => {
                    let word: String = word.chars().take(20).collect();
                    return Err(format!("'{}' is out of place", word.escape_debug()));
                }
            }
        }
        if self.corners.len() > 3 {
            return Err("a facet of more than three corners".to_owned());
        }
        Ok(())
    }
}
