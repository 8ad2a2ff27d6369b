//! Reading a session file, whole or cut short.

use mcap::io::MessageReader;
use mcap::sans_io::LinearReaderOptions;
use osteon_protocol::session::{
    MARK_TOPIC, Mark, SESSION_VERSION, SETUP_TOPIC, Setup, TICK_TOPIC, Tick, decode,
};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Longest record that is believed, bytes: a chunk is one.
const MAX_RECORD: usize = 1 << 26;

/// Why a file is no session.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be opened.
    #[error("{}: cannot be read ({reason}); check the path", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// It holds no setup.
    #[error("{}: not an Osteon session ({reason}); give a file that --record wrote", path.display())]
    NoSession {
        /// The file.
        path: PathBuf,
        /// What the reader says.
        reason: String,
    },
    /// It was made by another release.
    #[error("{}: session format {version}, this release reads {SESSION_VERSION}; replay with {software}", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: u16,
        /// What recorded it.
        software: String,
    },
    /// A message is none.
    #[error("{}: message {number} on {topic} is damaged; what is before it can be exported", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// Its topic.
        topic: String,
        /// Number on its topic, from 1.
        number: u32,
    },
}

/// One message that a replay needs.
#[derive(Debug, Clone, PartialEq)]
pub enum Entry {
    /// A tick.
    Tick(Box<Tick>),
    /// What is not of one tick.
    Mark(Mark),
}

/// A session file, read from its beginning. As an iterator it gives the ticks and marks up to the last
/// whole chunk.
pub struct Reader {
    path: PathBuf,
    setup: Setup,
    messages: MessageReader<BufReader<File>>,
    cut_short: Option<String>,
    over: bool,
}

impl core::fmt::Debug for Reader {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Reader")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl Reader {
    /// Opens a file and reads its setup.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = File::open(path).map_err(|e| RecordingError::Open {
            path: path.to_owned(),
            reason: e.to_string(),
        })?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD);
        let mut messages = MessageReader::new_with_options(BufReader::new(file), options);
        let none = |reason: String| RecordingError::NoSession {
            path: path.to_owned(),
            reason,
        };
        let setup: Setup = loop {
            match messages.next() {
                None => return Err(none("it has no setup".to_owned())),
                Some(Err(e)) => return Err(none(e.to_string())),
                Some(Ok(message)) if message.channel.topic == SETUP_TOPIC => {
                    // the version comes first and stays there
                    let version = message.data.first().copied().unwrap_or(0);
                    break match decode(&message.data) {
                        Ok(setup) => setup,
                        Err(_) if u16::from(version) != SESSION_VERSION => {
                            return Err(RecordingError::Version {
                                path: path.to_owned(),
                                version: version.into(),
                                software: "the release that recorded it".to_owned(),
                            });
                        }
                        Err(e) => return Err(none(e.to_string())),
                    };
                }
                Some(Ok(_)) => {}
            }
        };
        if setup.version != SESSION_VERSION {
            return Err(RecordingError::Version {
                path: path.to_owned(),
                version: setup.version,
                software: setup.software,
            });
        }
        Ok(Self {
            path: path.to_owned(),
            setup,
            messages,
            cut_short: None,
            over: false,
        })
    }

    /// What the session began with.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Passes over the next `count` ticks, unread.
    pub(crate) fn pass_over(&mut self, count: u64) -> Result<(), RecordingError> {
        let mut left = count;
        while left > 0 {
            match self.messages.next() {
                Some(Ok(message)) if message.channel.topic == TICK_TOPIC => left -= 1,
                Some(Ok(_)) => {}
                Some(Err(e)) => {
                    return Err(RecordingError::NoSession {
                        path: self.path.clone(),
                        reason: format!("{left} ticks are missing: {e}"),
                    });
                }
                None => break,
            }
        }
        Ok(())
    }

    /// After the last entry: why the file ends where it does, if not in its own end.
    pub fn cut_short(&self) -> Option<&str> {
        self.cut_short.as_deref()
    }
}

impl Iterator for Reader {
    type Item = Result<Entry, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.over {
            let message = match self.messages.next() {
                Some(Ok(message)) => message,
                Some(Err(e)) => {
                    self.cut_short = Some(e.to_string());
                    self.over = true;
                    return None;
                }
                None => {
                    self.over = true;
                    return None;
                }
            };
            let entry = match message.channel.topic.as_str() {
                TICK_TOPIC => decode(&message.data).map(|tick| Entry::Tick(Box::new(tick))),
                MARK_TOPIC => decode(&message.data).map(Entry::Mark),
                _ => continue,
            };
            let (path, topic) = (&self.path, &message.channel.topic);
            let bad = |_| RecordingError::Message {
                path: path.clone(),
                topic: topic.clone(),
                number: message.sequence,
            };
            self.over = entry.is_err();
            return Some(entry.map_err(bad));
        }
        None
    }
}
