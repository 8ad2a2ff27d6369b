//! A file that never fails to be written: after the first error it swallows what comes, and says why.
//!
//! The container's writer knows no way back from an error; a session must go on when its disk is full.

use std::fs::File;
use std::io::{BufWriter, Result, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// What a session is written to.
pub(crate) trait Storage: Write + Send {
    /// Drops what lies beyond `len` bytes.
    fn shorten(&mut self, len: u64) -> Result<()>;
}

impl Storage for File {
    fn shorten(&mut self, len: u64) -> Result<()> {
        self.set_len(len)
    }
}

/// In place of a file that has failed.
struct Nowhere;

impl Write for Nowhere {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }
}

impl Storage for Nowhere {
    fn shorten(&mut self, _len: u64) -> Result<()> {
        Ok(())
    }
}

/// What became of the file.
#[derive(Debug, Clone, Default)]
pub(super) struct State {
    failed: Arc<OnceLock<String>>,
    bytes: Arc<AtomicU64>,
}

impl State {
    /// Why nothing more is written.
    pub(super) fn failed(&self) -> Option<&str> {
        self.failed.get().map(String::as_str)
    }

    /// Bytes that are with the system.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }
}

/// The file.
pub(super) struct Sink {
    file: BufWriter<Box<dyn Storage>>,
    state: State,
    // bytes handed over, and of them those up to the last flush
    begun: u64,
    sound: u64,
}

impl Sink {
    pub(super) fn new(file: Box<dyn Storage>, state: State) -> Self {
        Self {
            file: BufWriter::with_capacity(1 << 18, file),
            state,
            begun: 0,
            sound: 0,
        }
    }

    fn note(&mut self, outcome: Result<()>) {
        let Err(e) = outcome else {
            return;
        };
        // a second error cannot come: nothing is written any more
        drop(self.state.failed.set(e.to_string()));
        // half a chunk is no use to anybody: neither what was written of it nor what is in the buffer;
        // where even this is refused the reader passes it over
        let nowhere = BufWriter::with_capacity(0, Box::new(Nowhere) as Box<dyn Storage>);
        let (mut file, _) = core::mem::replace(&mut self.file, nowhere).into_parts();
        drop(file.shorten(self.sound));
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        if self.state.failed().is_none() {
            let outcome = self.file.write_all(bytes);
            self.note(outcome);
            self.begun += bytes.len() as u64;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        if self.state.failed().is_none() {
            let outcome = self.file.flush();
            if outcome.is_ok() {
                self.sound = self.begun;
                self.state.bytes.store(self.sound, Ordering::Relaxed);
            }
            self.note(outcome);
        }
        Ok(())
    }
}
