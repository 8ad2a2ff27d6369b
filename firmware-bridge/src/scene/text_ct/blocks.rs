//! A text file in blocks on all cores, with the results in the file's order.

use super::Problem;
use super::line::{self, Entry, Fault, MAX_LINE};
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;

/// Blocks for each core between two reports of progress.
const BLOCKS_PER_CORE: usize = 16;
/// UTF-8's byte-order mark.
const MARK: &[u8] = &[0xef, 0xbb, 0xbf];

/// A text file whose comments and header at the front are passed over.
#[derive(Debug)]
pub(super) struct Text {
    file: File,
    // where the first voxel's line begins, bytes
    start: u64,
    // lines before it
    lines_before: u64,
    length: u64,
    block: usize,
}

/// The lines that begin in one block.
struct Part<S> {
    state: S,
    lines: u64,
    fault: Option<Fault>,
}

impl Text {
    /// Opens a file; `block` is what one job reads, bytes.
    pub(super) fn open(path: &Path, block: usize) -> Result<Self, Problem> {
        // asked before it is opened: opening a pipe waits for its writer
        let about = std::fs::metadata(path)?;
        if !about.is_file() {
            return Err(Problem::NotAFile);
        }
        let file = File::open(path)?;
        let (start, lines_before) = prologue(&file)?;
        Ok(Self {
            file,
            start,
            lines_before,
            length: about.len(),
            block: block.max(1),
        })
    }

    /// Bytes of the file.
    pub(super) fn bytes(&self) -> u64 {
        self.length
    }

    /// Calls `visit` for each voxel, with a state for each block and the line's number inside its
    /// block, and hands the states to `merge` in the file's order, with the number of the block's
    /// first line. The first faulty line ends it. `progress` hears the fraction done.
    pub(super) fn scan<S: Default + Send>(
        &self,
        visit: impl Fn(&mut S, u32, &Entry) + Sync,
        mut merge: impl FnMut(u64, S) -> Result<(), Problem>,
        progress: &mut dyn FnMut(f32),
    ) -> Result<(), Problem> {
        let blocks = (self.length - self.start).div_ceil(self.block as u64);
        let wave = (BLOCKS_PER_CORE * rayon::current_num_threads()) as u64;
        let mut line = self.lines_before + 1;
        let mut done = 0;
        while done < blocks {
            let next = (done + wave).min(blocks);
            let parts: Vec<Result<Part<S>, Problem>> = (done..next)
                .into_par_iter()
                .map_init(Vec::new, |buffer, n| self.part(n, buffer, &visit))
                .collect();
            for part in parts {
                let part = part?;
                let first = line;
                line += part.lines;
                merge(first, part.state)?;
                if let Some(fault) = part.fault {
                    // the faulty line is the last that was counted
                    return Err(Problem::Line {
                        line: line - 1,
                        fault,
                    });
                }
            }
            done = next;
            progress(done as f32 / blocks as f32);
        }
        Ok(())
    }

    /// The lines that begin in block `n`.
    fn part<S: Default>(
        &self,
        n: u64,
        buffer: &mut Vec<u8>,
        visit: &(impl Fn(&mut S, u32, &Entry) + Sync),
    ) -> Result<Part<S>, Problem> {
        let begin = self.start + n * self.block as u64;
        // the byte before says whether a line begins here; the last line may end behind the block
        let ahead = usize::from(n > 0);
        buffer.resize(ahead + self.block + MAX_LINE, 0);
        let got = read_at(&self.file, begin - ahead as u64, buffer)?;
        let bytes = &buffer[..got];
        let mut part = Part {
            state: S::default(),
            lines: 0,
            fault: None,
        };
        let mut at = 0;
        if ahead == 1 {
            match memchr::memchr(b'\n', bytes) {
                Some(end) => at = end + 1,
                None => return Ok(part),
            }
        }
        while at < bytes.len().min(ahead + self.block) {
            let rest = &bytes[at..];
            let end = memchr::memchr(b'\n', rest);
            let length = end.unwrap_or(rest.len());
            // the buffer holds more than a longest line from here on, unless the file ends
            let result = if length > MAX_LINE {
                Err(Fault::TooLong)
            } else {
                line::parse(&rest[..length])
            };
            match result {
                Ok(Some(entry)) => visit(&mut part.state, number(part.lines), &entry),
                Ok(None) => {}
                Err(fault) => part.fault = Some(fault),
            }
            part.lines += 1;
            if part.fault.is_some() {
                break;
            }
            at += length + 1;
        }
        Ok(part)
    }
}

/// A line's number inside a block: smaller than the block.
fn number(line: u64) -> u32 {
    u32::try_from(line).unwrap_or(u32::MAX)
}

/// Fills `buffer` from `offset` on as far as the file goes.
fn read_at(file: &File, offset: u64, buffer: &mut [u8]) -> Result<usize, Problem> {
    let mut got = 0;
    while got < buffer.len() {
        match rustix::io::pread(file, &mut buffer[got..], offset + got as u64) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(rustix::io::Errno::INTR) => {}
            Err(e) => return Err(Problem::Io(e.into())),
        }
    }
    Ok(got)
}

/// Bytes and lines of the comments, empty lines and the header before the first voxel.
fn prologue(file: &File) -> Result<(u64, u64), Problem> {
    let mut reader = BufReader::new(file);
    let mut start = 0;
    let mut lines = 0;
    let mut header = false;
    if reader.fill_buf()?.starts_with(MARK) {
        reader.consume(MARK.len());
        start = MARK.len() as u64;
    }
    let mut line = Vec::new();
    loop {
        line.clear();
        let length = (&mut reader)
            .take(MAX_LINE as u64)
            .read_until(b'\n', &mut line)?;
        let skip = match line::parse(&line) {
            Ok(None) => true,
            Ok(Some(_)) => false,
            Err(_) => !core::mem::replace(&mut header, true) && line::is_header(&line),
        };
        if length == 0 || !skip || !line.ends_with(b"\n") {
            return Ok((start, lines));
        }
        start += length as u64;
        lines += 1;
    }
}
