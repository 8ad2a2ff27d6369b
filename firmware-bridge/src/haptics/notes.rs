//! What the session tells its recorder beside the ticks.

use super::publisher::{Publisher, wire_digest};
use crate::recording::Recorder;
use std::time::{Duration, Instant};

/// Times between two notes to the recorder: health, digest of the cut (some milliseconds' work).
const HEALTH_PERIOD: Duration = Duration::from_secs(1);
const DIGEST_PERIOD: Duration = Duration::from_secs(10);

/// When the recorder was last told how the session fares, and what the cut is.
#[derive(Debug, Default)]
pub(super) struct Notes {
    health: Option<Instant>,
    digest: Option<Instant>,
}

impl Notes {
    /// Tells what is due.
    pub(super) fn tell(&mut self, publisher: &Publisher, recorder: &Recorder) {
        let due = |last: &mut Option<Instant>, period: Duration| {
            let due = last.is_none_or(|at| at.elapsed() >= period);
            if due {
                *last = Some(Instant::now());
            }
            due
        };
        if due(&mut self.health, HEALTH_PERIOD) {
            recorder.health(publisher.stats.health(&publisher.link_name));
        }
        // the mirror may be ahead of the last tick that was told, or lack what a full ring lost
        let cut = &publisher.mirror.cut;
        let whole = publisher.stats.last.filter(|t| {
            t.ring_overflows == 0 && (t.epoch, t.revision) == (cut.epoch(), cut.revision())
        });
        if let Some(tick) = whole
            && due(&mut self.digest, DIGEST_PERIOD)
        {
            let digest = cut.digest(&publisher.mirror.bone);
            recorder.digest(tick.tick + 1, wire_digest(digest));
        }
    }
}
