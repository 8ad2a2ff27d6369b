//! Which bricks went into the last batches: after a break, what a viewer has not taken over is owed
//! to it again.

use std::collections::VecDeque;

/// Batches remembered. More than a local socket's buffer holds of full ones; where it held more small
/// ones, a viewer that resumes begins its cut anew.
const REMEMBERED: usize = 64;

/// The last batches of one viewer.
#[derive(Debug, Default)]
pub(crate) struct Sent {
    // sent in all, since the viewer was welcomed
    total: u64,
    last: VecDeque<Vec<(u32, u8)>>,
}

impl Sent {
    /// A batch goes out.
    pub(crate) fn remember(&mut self, ids: Vec<(u32, u8)>) {
        if self.last.len() == REMEMBERED {
            self.last.pop_front();
        }
        self.last.push_back(ids);
        self.total += 1;
    }

    /// The viewer has taken over `taken` batches in all: the bricks of the others, or `None` where
    /// they are not known any more, or the viewer claims more than it was sent. Counting goes on
    /// from `taken`.
    pub(crate) fn resume_from(&mut self, taken: u64) -> Option<Vec<(u32, u8)>> {
        let lost = self.total.checked_sub(taken);
        let lost = lost.and_then(|n| usize::try_from(n).ok());
        let known = lost.filter(|n| *n <= self.last.len());
        let ids = known.map(|n| {
            let from = self.last.len() - n;
            self.last.iter().skip(from).flatten().copied().collect()
        });
        self.last.clear();
        self.total = taken;
        ids
    }

    /// Bytes of memory that it holds.
    pub(crate) fn held(&self) -> usize {
        let ids: usize = self.last.iter().map(Vec::capacity).sum();
        ids * size_of::<(u32, u8)>()
    }

    /// Most bytes that [`Self::held`] can give: a vector grows by doubling.
    pub(crate) const MOST_HELD: usize =
        2 * REMEMBERED * osteon_protocol::ipc::MAX_BRICKS * size_of::<(u32, u8)>();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(batches: u32) -> Sent {
        let mut sent = Sent::default();
        for n in 0..batches {
            sent.remember(vec![(n, 0), (n, 1)]);
        }
        sent
    }

    #[test]
    fn what_was_not_taken_over_is_owed_again() {
        let mut sent = after(100);
        let lost = sent.resume_from(97);
        let expected = [97, 98, 99].map(|n| [(n, 0), (n, 1)]).concat();
        assert_eq!(lost, Some(expected));
        // counting goes on from what the viewer has
        sent.remember(vec![(7, 7)]);
        assert_eq!(sent.resume_from(97), Some(vec![(7, 7)]));
        assert_eq!(sent.resume_from(97), Some(vec![]));
    }

    #[test]
    fn what_is_too_old_or_impossible_is_not_known() {
        assert_eq!(after(100).resume_from(35), None);
        assert!(after(100).resume_from(36).is_some());
        assert_eq!(after(100).resume_from(101), None, "more than was sent");
        assert_eq!(after(0).resume_from(u64::MAX), None);
    }
}
