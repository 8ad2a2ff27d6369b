//! What a session file holds, from one reading of it.

use crate::recording::{Entry, Reader, RecordingError};
use osteon_protocol::ipc::Digest;
use osteon_protocol::session::Mark;
use std::collections::BTreeMap;
use std::path::Path;

/// The marks of a file, and how long it is.
#[derive(Debug, Clone, Default)]
pub(crate) struct Survey {
    /// Ticks from the first on without a gap.
    pub ticks: u64,
    /// When each began, ns.
    pub times_ns: Vec<u64>,
    /// Digests by the number of ticks that were over.
    pub digests: BTreeMap<u64, Digest>,
    /// Ticks that the recorder lost; the replay ends before them.
    pub lost: u64,
    /// Why the session ended, where the file has its end; and the cut at it.
    pub end: Option<(String, Option<Digest>)>,
    /// Why the file ends without its own end.
    pub cut_short: Option<String>,
}

impl Survey {
    pub(crate) fn of(path: &Path) -> Result<Self, RecordingError> {
        let mut reader = Reader::open(path)?;
        let mut survey = Self::default();
        let mut gap = false;
        for entry in reader.by_ref() {
            match entry? {
                Entry::Tick(tick) => {
                    gap |= tick.tick != survey.ticks;
                    if !gap {
                        survey.ticks += 1;
                        survey.times_ns.push(tick.started_ns);
                    }
                }
                Entry::Mark(Mark::Digest { ticks, digest }) => {
                    survey.digests.insert(ticks, digest);
                }
                Entry::Mark(Mark::Lost { count, .. }) => survey.lost += count,
                Entry::Mark(Mark::End { reason, digest, .. }) => {
                    survey.end = Some((reason, digest));
                }
            }
        }
        survey.cut_short = reader.cut_short().map(ToOwned::to_owned);
        Ok(survey)
    }

    /// Length of what can be played, s.
    pub(crate) fn seconds(&self) -> f64 {
        self.times_ns.last().map_or(0.0, |ns| *ns as f64 * 1e-9)
    }
}
