//! Lines about viewers, so few that a flood of bad ones fills no disk and hides no other line.

use std::time::{Duration, Instant};

/// Lines in one [`WINDOW`].
const MOST: u32 = 20;
const WINDOW: Duration = Duration::from_secs(10);

/// Counts the lines.
#[derive(Debug)]
pub(crate) struct Complaints {
    window_began: Instant,
    said: u32,
    unsaid: u64,
}

impl Complaints {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            window_began: now,
            said: 0,
            unsaid: 0,
        }
    }

    /// Makes a line; the lines to say now, oldest first.
    pub(crate) fn line(&mut self, text: String, now: Instant) -> Vec<String> {
        let mut lines = Vec::new();
        if now.saturating_duration_since(self.window_began) >= WINDOW {
            lines.extend(self.rest());
            self.window_began = now;
            self.said = 0;
        }
        if self.said < MOST {
            self.said += 1;
            lines.push(text);
        } else {
            self.unsaid += 1;
        }
        lines
    }

    /// How many lines were left out since the last time, if any.
    pub(crate) fn rest(&mut self) -> Option<String> {
        let unsaid = std::mem::take(&mut self.unsaid);
        (unsaid > 0).then(|| format!("{unsaid} more lines about viewers were left out"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_counted_and_the_next_window_says_so() {
        let begin = Instant::now();
        let mut complaints = Complaints::new(begin);
        let said: usize = (0..1000)
            .map(|n| complaints.line(format!("line {n}"), begin).len())
            .sum();
        assert_eq!(said, 20);
        let lines = complaints.line("later".to_owned(), begin + WINDOW);
        assert_eq!(
            lines,
            ["980 more lines about viewers were left out", "later"]
        );
        assert_eq!(complaints.rest(), None);
    }
}
