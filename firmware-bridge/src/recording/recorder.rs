//! The recorder: a thread of its own that takes what the servo hands over and writes it.

use super::entry::Recorded;
use super::file::SessionFile;
use super::readable::HEALTH;
use super::sink::{State, Storage};
use crate::haptics::warn;
use anyhow::{Context as _, bail};
use mcap::McapError;
use osteon_protocol::ipc::{Digest, Health};
use osteon_protocol::session::{Mark, Setup};
use rtrb::Consumer;
use serde::Serialize;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two looks at the ring.
const VISIT: Duration = Duration::from_millis(10);
/// Time after which all that was recorded is with the system, of the session and of the wall.
const FLUSH_NS: u64 = 500_000_000;
const FLUSH: Duration = Duration::from_nanos(FLUSH_NS);
/// Notes that may wait.
const NOTES: usize = 64;
/// Longest wait for the recorder's end.
const FINISH: Duration = Duration::from_secs(10);

/// What comes beside the ticks.
enum Note {
    Health(Box<Health>),
    Mark(Mark),
}

/// What became of a recording.
#[derive(Debug, Clone, Serialize)]
pub struct RecordingReport {
    /// The file.
    pub file: PathBuf,
    /// Ticks in it.
    pub ticks: u64,
    /// Ticks that are missing because the disk was too slow.
    pub lost_ticks: u64,
    /// Its length.
    pub bytes: u64,
    /// Why it ended before the session; absent where it did not.
    pub failed: Option<String>,
}

/// A running recorder.
pub(crate) struct Recorder {
    notes: SyncSender<Note>,
    thread: JoinHandle<RecordingReport>,
}

/// A file that is there and empty: asked for before the session begins, so that what is wrong with it is
/// said then.
pub(crate) struct Blank {
    path: PathBuf,
    file: Box<dyn Storage>,
}

impl Blank {
    /// On something else than a file of the system.
    #[cfg(test)]
    pub(crate) fn on(path: &Path, file: Box<dyn Storage>) -> Self {
        Self {
            path: path.to_owned(),
            file,
        }
    }

    /// Makes the file; one that is there already is never written over.
    pub(crate) fn new(path: &Path) -> anyhow::Result<Self> {
        let file = match File::create_new(path) {
            Ok(file) => file,
            Err(e) if e.kind() == ErrorKind::AlreadyExists => bail!(
                "{}: is there already; give --record a new name, a recording is never written over",
                path.display()
            ),
            Err(e) => {
                return Err(e).with_context(|| {
                    format!("{}: cannot be written; correct --record", path.display())
                });
            }
        };
        Ok(Self {
            path: path.to_owned(),
            file: Box::new(file),
        })
    }
}

impl Recorder {
    /// Starts the thread on the servo's ring.
    pub(crate) fn start(
        blank: Blank,
        setup: Setup,
        ring: Consumer<Recorded>,
    ) -> anyhow::Result<Self> {
        let (notes, waiting) = sync_channel(NOTES);
        let path = blank.path.display().to_string();
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || record(blank, &setup, ring, &waiting))
            .with_context(|| format!("{path}: cannot start the recorder's thread"))?;
        Ok(Self { notes, thread })
    }

    /// How the session fares. Never waits; a recorder that is behind does without.
    pub(crate) fn health(&self, health: Health) {
        drop(self.notes.try_send(Note::Health(Box::new(health))));
    }

    /// The cut after `ticks` ticks.
    pub(crate) fn digest(&self, ticks: u64, digest: Digest) {
        let mark = Mark::Digest { ticks, digest };
        drop(self.notes.try_send(Note::Mark(mark)));
    }

    /// Writes what is left and the end; the servo must have stopped.
    pub(crate) fn finish(
        self,
        ticks: u64,
        digest: Option<Digest>,
        reason: String,
    ) -> RecordingReport {
        let Self { notes, thread } = self;
        let end = Mark::End {
            ticks,
            digest,
            reason,
        };
        let until = Instant::now() + FINISH;
        let mut note = Note::Mark(end);
        // a disk that hangs must not hold the session's end
        while let Err(e) = notes.try_send(note) {
            if Instant::now() > until {
                break;
            }
            std::thread::sleep(VISIT);
            note = match e {
                std::sync::mpsc::TrySendError::Full(note) => note,
                std::sync::mpsc::TrySendError::Disconnected(_) => break,
            };
        }
        drop(notes);
        while !thread.is_finished() && Instant::now() < until {
            std::thread::sleep(VISIT);
        }
        let given_up = |failed: &str| RecordingReport {
            file: PathBuf::new(),
            ticks: 0,
            lost_ticks: 0,
            bytes: 0,
            failed: Some(failed.to_owned()),
        };
        if !thread.is_finished() {
            return given_up("the disk has not taken the last seconds within 10 s");
        }
        thread
            .join()
            .unwrap_or_else(|_| given_up("the recorder's thread has died; please report this"))
    }
}

fn record(
    blank: Blank,
    setup: &Setup,
    ring: Consumer<Recorded>,
    notes: &Receiver<Note>,
) -> RecordingReport {
    let state = State::default();
    let mut report = RecordingReport {
        file: blank.path.clone(),
        ticks: 0,
        lost_ticks: 0,
        bytes: 0,
        failed: None,
    };
    let outcome = SessionFile::begin(blank.file, state.clone(), setup).and_then(|file| {
        let mut work = Work {
            file,
            state: state.clone(),
            ring,
            origin_ns: None,
            last_ns: 0,
            flushed_ns: 0,
            taken: 0,
            told: false,
        };
        work.until_end(notes, &mut report)?;
        let (taken, mut told) = (work.taken, work.told);
        work.file.finish()?;
        if state.failed().is_none() {
            report.ticks = taken;
        }
        tell_once(&state, &report, &mut told);
        Ok(())
    });
    report.bytes = state.bytes();
    report.failed = state
        .failed()
        .map(ToOwned::to_owned)
        .or_else(|| outcome.err().map(|e| e.to_string()));
    report
}

struct Work {
    file: SessionFile,
    state: State,
    ring: Consumer<Recorded>,
    origin_ns: Option<u64>,
    last_ns: u64,
    flushed_ns: u64,
    taken: u64,
    told: bool,
}

impl Work {
    fn until_end(
        &mut self,
        notes: &Receiver<Note>,
        report: &mut RecordingReport,
    ) -> Result<(), McapError> {
        let mut flushed = Instant::now();
        loop {
            self.take_ticks(report)?;
            loop {
                match notes.try_recv() {
                    Ok(Note::Health(health)) => self.health(&health)?,
                    Ok(Note::Mark(mark)) => {
                        let end = matches!(mark, Mark::End { .. });
                        if end {
                            self.take_ticks(report)?;
                        }
                        self.file.mark(self.last_ns, &mark)?;
                        if end {
                            return Ok(());
                        }
                    }
                    Err(TryRecvError::Empty) => break,
                    // the session died: what is here is kept
                    Err(TryRecvError::Disconnected) => return self.take_ticks(report),
                }
            }
            if flushed.elapsed() >= FLUSH {
                flushed = Instant::now();
                self.flush(report)?;
            }
            tell_once(&self.state, report, &mut self.told);
            std::thread::sleep(VISIT);
        }
    }

    fn take_ticks(&mut self, report: &mut RecordingReport) -> Result<(), McapError> {
        while let Ok(recorded) = self.ring.pop() {
            let origin = *self.origin_ns.get_or_insert(recorded.started_ns);
            let tick = recorded.in_file(origin);
            if recorded.lost > 0 {
                report.lost_ticks += recorded.lost;
                let mark = Mark::Lost {
                    first: tick.tick - recorded.lost,
                    count: recorded.lost,
                };
                self.file.mark(tick.started_ns, &mark)?;
            }
            self.last_ns = tick.started_ns;
            self.file.tick(&tick)?;
            self.taken += 1;
            if tick.started_ns.saturating_sub(self.flushed_ns) >= FLUSH_NS {
                self.flush(report)?;
            }
        }
        Ok(())
    }

    fn flush(&mut self, report: &mut RecordingReport) -> Result<(), McapError> {
        self.flushed_ns = self.last_ns;
        self.file.flush()?;
        if self.state.failed().is_none() {
            report.ticks = self.taken;
        }
        Ok(())
    }

    fn health(&mut self, health: &Health) -> Result<(), McapError> {
        // plain numbers and texts: there is nothing that JSON lacks
        match serde_json::to_value(health) {
            Ok(json) => self.file.show(HEALTH, self.last_ns, &json),
            Err(_) => Ok(()),
        }
    }
}

fn tell_once(state: &State, report: &RecordingReport, told: &mut bool) {
    if let Some(why) = state.failed()
        && !core::mem::replace(told, true)
    {
        warn(&format!(
            "{}: {why}; the session goes on without its recording, which ends after {:.1} s",
            report.file.display(),
            report.ticks as f64 * 1e-3
        ));
    }
}
