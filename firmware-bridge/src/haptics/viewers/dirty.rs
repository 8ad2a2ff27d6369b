//! Which bricks a viewer has not seen in their newest state: one bit a brick, so bounded by the bone
//! whatever the viewer does.
#![expect(
    clippy::cast_possible_truncation,
    reason = "a bone has fewer than 2^32 chunks, a chunk 64 bricks"
)]

use osteon_protocol::ipc::MAX_BRICKS;

/// The dirty set of one viewer.
#[derive(Debug)]
pub(crate) struct DirtySet {
    bits: Vec<u64>,
    // where the next batch begins, so that no chunk starves
    cursor: usize,
}

impl DirtySet {
    /// All clean.
    pub(crate) fn new(chunks: usize) -> Self {
        Self {
            bits: vec![0; chunks],
            cursor: 0,
        }
    }

    /// Marks a brick.
    pub(crate) fn mark(&mut self, chunk: usize, brick: usize) {
        self.bits[chunk] |= 1 << brick;
    }

    /// Marks bricks of a chunk, one bit each.
    pub(crate) fn mark_bricks(&mut self, chunk: usize, bricks: u64) {
        self.bits[chunk] |= bricks;
    }

    /// Bytes of memory that it holds.
    pub(crate) fn held(&self) -> usize {
        8 * self.bits.capacity()
    }

    /// Forgets everything: after a reset there is nothing to send.
    pub(crate) fn clear(&mut self) {
        self.bits.fill(0);
    }

    /// True where nothing is left to send.
    pub(crate) fn is_clean(&self) -> bool {
        self.bits.iter().all(|&b| b == 0)
    }

    /// Takes up to [`MAX_BRICKS`] bricks out of the set, going round over the chunks.
    pub(crate) fn take(&mut self) -> Vec<(u32, u8)> {
        let mut batch = Vec::new();
        for n in 0..self.bits.len() {
            let chunk = (self.cursor + n) % self.bits.len();
            while self.bits[chunk] != 0 {
                if batch.len() == MAX_BRICKS {
                    self.cursor = chunk;
                    return batch;
                }
                let brick = self.bits[chunk].trailing_zeros();
                self.bits[chunk] &= self.bits[chunk] - 1;
                batch.push((chunk as u32, brick as u8));
            }
        }
        batch
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_marked_brick_comes_out_once() {
        let mut set = DirtySet::new(7);
        for chunk in 0..7 {
            set.mark_bricks(chunk, u64::MAX);
        }
        set.mark(3, 5);
        let mut seen = std::collections::BTreeSet::new();
        while !set.is_clean() {
            let batch = set.take();
            assert!(!batch.is_empty() && batch.len() <= MAX_BRICKS);
            for id in batch {
                assert!(seen.insert(id), "{id:?} twice");
            }
        }
        assert_eq!(seen.len(), 7 * 64);
        assert!(set.take().is_empty());
    }
}
