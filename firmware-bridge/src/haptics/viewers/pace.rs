//! How fast bricks go to a viewer: as a stream that a modest network carries, however much is cut.

use std::time::{Duration, Instant};

/// Bytes a second of bricks to one viewer in the long run. Bricks wait, and later values replace
/// earlier ones; none is lost.
const BYTES_PER_SECOND: f64 = 1_800_000.0;
/// Bytes at once after a pause.
const BURST: f64 = 1_000_000.0;

/// What one viewer may be sent.
#[derive(Debug)]
pub(crate) struct Pace {
    allowed: f64,
    at: Instant,
}

impl Pace {
    /// A full allowance.
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            allowed: BURST,
            at: now,
        }
    }

    /// Whether a batch may go now.
    pub(crate) fn may_send(&mut self, now: Instant) -> bool {
        let passed = now.saturating_duration_since(self.at);
        self.at = now;
        let earned = passed.min(Duration::from_mins(1)).as_secs_f64() * BYTES_PER_SECOND;
        self.allowed = (self.allowed + earned).min(BURST);
        self.allowed > 0.0
    }

    /// A batch of `bytes` went.
    pub(crate) fn spend(&mut self, bytes: usize) {
        self.allowed -= bytes as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_greedy_stream_gets_the_rate_and_no_more() {
        let begin = Instant::now();
        let mut pace = Pace::new(begin);
        let (mut total, mut worst) = (0.0, 0.0_f64);
        let mut in_second = 0.0;
        for ms in 0..60_000u64 {
            if ms % 1000 == 0 {
                in_second = 0.0;
            }
            if pace.may_send(begin + Duration::from_millis(ms)) {
                pace.spend(100_000);
                total += 100_000.0;
                in_second += 100_000.0;
                worst = worst.max(in_second);
            }
        }
        let mean = total / 60.0;
        assert!((1.7e6..1.9e6).contains(&mean), "{mean}");
        assert!(worst <= BURST + BYTES_PER_SECOND + 200_000.0, "{worst}");
    }

    #[test]
    fn a_pause_earns_one_burst() {
        let begin = Instant::now();
        let mut pace = Pace::new(begin);
        pace.spend(3_000_000);
        assert!(!pace.may_send(begin + Duration::from_secs(1)));
        assert!(pace.may_send(begin + Duration::from_secs(2)));
        assert!(pace.may_send(begin + Duration::from_secs(1000)));
        pace.spend(1_000_001);
        assert!(!pace.may_send(begin + Duration::from_secs(1000)));
    }
}
