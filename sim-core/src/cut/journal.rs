//! Checkpoints of a cut: each brick as it was, copied before it is first written after a checkpoint.
//!
//! All memory is taken when the cut is made: a ring of bricks in the order in which they were saved, so
//! that nothing has to be given back in the servo's loop. A full ring gives up the oldest checkpoint,
//! which depends on what was carved alone: a replay gives it up in the same tick. A checkpoint costs a
//! few bytes a chunk, a copied or restored brick [`BRICK_WORK`] units of the tick's budget.

use super::{Cut, Totals, UNCUT};
use crate::bone::Bone;
use crate::carve::Placed;
use crate::grid::BRICK_VOXELS;

/// Checkpoints that are kept at most; the oldest is given up for a new one.
pub const MAX_CHECKPOINTS: usize = 8;
/// Bricks that the servo's journal holds at most: 32 MiB, or 217 cm³ of bone at a spacing of 0.235 mm.
pub const JOURNAL_BRICKS: usize = 32_768;
/// Units of work of a brick that is saved or restored.
pub(crate) const BRICK_WORK: i64 = 8;

/// A brick as it was.
#[derive(Debug, Clone, Copy)]
struct Saved {
    chunk: u32,
    emptied_lines: u16,
    brick: u8,
    touched: bool,
    emptied: bool,
}

impl Saved {
    const NONE: Self = Self {
        chunk: 0,
        emptied_lines: 0,
        brick: 0,
        touched: false,
        emptied: false,
    };
}

/// What holds for the whole cut at a checkpoint.
#[derive(Debug, Clone)]
struct Mark {
    // number of the first brick saved after it
    first: u64,
    revision: u64,
    last_stamp: Option<Placed>,
    totals: Totals,
}

/// The journal. Checkpoints have running numbers; those in `oldest..next` are kept.
#[derive(Debug)]
pub(crate) struct Journal {
    marks: Vec<Mark>,
    oldest: u32,
    next: u32,
    // bricks saved since each checkpoint, one bit each; `chunks` words a checkpoint
    done: Vec<u64>,
    chunks: usize,
    // the ring: `head - tail` bricks, by number modulo its size
    bricks: Vec<Saved>,
    values: Vec<i16>,
    tail: u64,
    head: u64,
    // restoring goes down to this number
    undo_to: Option<u64>,
    spent: i64,
}

impl Clone for Journal {
    // the room that is free is not copied: what forks a session pays for what the session has saved
    fn clone(&self) -> Self {
        let mut copy = Self {
            marks: self.marks.clone(),
            done: self.done.clone(),
            bricks: vec![Saved::NONE; self.bricks.len()],
            values: vec![0; self.values.len()],
            ..*self
        };
        for number in self.tail..self.head {
            let slot = self.slot(number);
            copy.bricks[slot] = self.bricks[slot];
            let at = slot * BRICK_VOXELS..(slot + 1) * BRICK_VOXELS;
            copy.values[at.clone()].copy_from_slice(&self.values[at]);
        }
        copy
    }
}

fn place(id: u32) -> usize {
    id as usize % MAX_CHECKPOINTS
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "a slot is below the ring's size, chunks are fewer than 2^32"
)]
impl Journal {
    /// Room for `bricks` bricks of a bone of `chunks` chunks; without room there are no checkpoints.
    pub(super) fn new(chunks: usize, bricks: usize) -> Self {
        let kept = if bricks == 0 { 0 } else { MAX_CHECKPOINTS };
        let mut values = vec![0; bricks * BRICK_VOXELS];
        // written once, so that no page fault is left for later
        values.fill(UNCUT);
        Self {
            marks: (0..kept)
                .map(|_| Mark {
                    first: 0,
                    revision: 0,
                    last_stamp: None,
                    totals: Totals::zero(),
                })
                .collect(),
            oldest: 0,
            next: 0,
            done: vec![0; kept * chunks],
            chunks,
            bricks: vec![Saved::NONE; bricks],
            values,
            tail: 0,
            head: 0,
            undo_to: None,
            spent: 0,
        }
    }

    fn slot(&self, number: u64) -> usize {
        (number % self.bricks.len().max(1) as u64) as usize
    }

    /// Checkpoints that are kept.
    fn count(&self) -> u32 {
        self.next - self.oldest
    }

    pub(super) fn forget(&mut self) {
        self.oldest = self.next;
        self.tail = 0;
        self.head = 0;
        self.undo_to = None;
    }

    fn drop_oldest(&mut self) {
        self.oldest += 1;
        self.tail = if self.count() == 0 {
            self.head
        } else {
            self.marks[place(self.oldest)].first
        };
    }

    /// Whether a brick is to be saved before it is written.
    pub(super) fn wants(&self, chunk: usize, brick: usize) -> bool {
        self.oldest != self.next
            && self.done[place(self.next - 1) * self.chunks + chunk] >> brick & 1 == 0
    }

    /// Saves a brick; `values` where this epoch has touched it.
    pub(super) fn save(
        &mut self,
        (chunk, brick): (usize, usize),
        (emptied_lines, emptied): (u16, bool),
        values: Option<&[i16]>,
    ) {
        self.done[place(self.next - 1) * self.chunks + chunk] |= 1 << brick;
        while self.head - self.tail == self.bricks.len() as u64 {
            self.drop_oldest();
            if self.count() == 0 {
                return;
            }
        }
        let slot = self.slot(self.head);
        self.bricks[slot] = Saved {
            chunk: chunk as u32,
            emptied_lines,
            brick: brick as u8,
            touched: values.is_some(),
            emptied,
        };
        if let Some(values) = values {
            self.values[slot * BRICK_VOXELS..(slot + 1) * BRICK_VOXELS].copy_from_slice(values);
            self.spent += BRICK_WORK;
        }
        self.head += 1;
    }
}

/// Bricks of `bone` that can be carved, and that a journal can therefore need for one checkpoint; at
/// most [`JOURNAL_BRICKS`].
pub fn journal_bricks(bone: &Bone) -> usize {
    let bony = |chunk| bone.bony_bricks(chunk).count_ones() as usize;
    let all: usize = (0..bone.chunk_count()).map(bony).sum();
    all.min(JOURNAL_BRICKS)
}

impl Cut {
    /// As [`Self::new`], with a journal of `bricks` bricks (1 KiB each) for checkpoints.
    pub fn with_journal(bone: &Bone, bricks: usize) -> Self {
        Self {
            journal: Journal::new(bone.chunk_count(), bricks),
            ..Self::new(bone)
        }
    }

    /// Checkpoints that can be gone back to.
    pub fn checkpoints(&self) -> usize {
        self.journal.count() as usize
    }

    /// Remembers the cut as it is; the checkpoint's number, or `None` where there is no journal.
    /// Constant work: 8 bytes a chunk.
    pub fn checkpoint(&mut self) -> Option<u32> {
        let id = self.journal.next;
        self.checkpoint_as(id).then_some(id)
    }

    /// The same under another holder's number `id`. Numbers that were left out mean the same state.
    pub fn checkpoint_as(&mut self, id: u32) -> bool {
        let journal = &mut self.journal;
        if journal.marks.is_empty() || journal.undo_to.is_some() || id < journal.next {
            return false;
        }
        let far = (id - journal.next) as usize >= MAX_CHECKPOINTS;
        if journal.count() == 0 || far {
            journal.forget();
            journal.oldest = id;
            journal.next = id;
        }
        while journal.next <= id {
            if journal.count() as usize == MAX_CHECKPOINTS {
                journal.drop_oldest();
            }
            let at = place(journal.next);
            let mark = &mut journal.marks[at];
            mark.first = journal.head;
            mark.revision = self.revision;
            mark.last_stamp = self.last_stamp;
            mark.totals.copy_from(&self.totals);
            journal.done[at * journal.chunks..(at + 1) * journal.chunks].fill(0);
            journal.next += 1;
        }
        true
    }

    /// Goes back to the newest checkpoint, which is used up, under a new epoch; its number, or `None`
    /// where there is none. Sums and revision are the checkpoint's at once; the bricks follow by
    /// [`Self::go_on_undoing`].
    pub fn undo(&mut self, epoch: u32) -> Option<u32> {
        if self.journal.count() == 0 {
            return None;
        }
        let id = self.journal.next - 1;
        let mark = &self.journal.marks[place(id)];
        self.epoch = epoch;
        self.revision = mark.revision;
        self.last_stamp = mark.last_stamp;
        // values rise: lines that were left out as done are not done any more
        self.plans.clear();
        self.totals.copy_from(&mark.totals);
        self.journal.undo_to = Some(mark.first);
        self.journal.next = id;
        Some(id)
    }

    /// Goes back, whole, to another holder's checkpoint `id`; false, and nothing changed, where it is
    /// not here.
    pub fn undo_to(&mut self, id: u32, epoch: u32, changed: &mut dyn FnMut(usize, usize)) -> bool {
        let journal = &self.journal;
        if !(journal.oldest..journal.next).contains(&id) {
            return false;
        }
        while self.journal.next > id {
            self.undo(epoch);
        }
        let mut enough = i64::MAX;
        self.go_on_undoing(&mut enough, changed);
        true
    }

    /// Whether bricks are still to be restored. Until it is false the cut is neither the old nor the
    /// new one, and nothing may be carved.
    pub fn is_undoing(&self) -> bool {
        self.journal.undo_to.is_some()
    }

    /// Restores bricks while there is `budget`, which it lowers, and calls `changed(chunk, brick)`
    /// for each.
    pub fn go_on_undoing(&mut self, budget: &mut i64, changed: &mut dyn FnMut(usize, usize)) {
        while let Some(to) = self.journal.undo_to {
            if self.journal.head == to {
                self.journal.undo_to = None;
            } else if *budget > 0 {
                *budget -= BRICK_WORK;
                self.journal.head -= 1;
                self.restore(self.journal.slot(self.journal.head), changed);
            } else {
                return;
            }
        }
    }

    fn restore(&mut self, slot: usize, changed: &mut dyn FnMut(usize, usize)) {
        let saved = self.journal.bricks[slot];
        let (chunk, brick) = (saved.chunk as usize, usize::from(saved.brick));
        if saved.touched {
            let values = &self.journal.values[slot * BRICK_VOXELS..(slot + 1) * BRICK_VOXELS];
            let base = chunk * crate::grid::CHUNK_VOXELS + brick * BRICK_VOXELS;
            self.values[base..base + BRICK_VOXELS].copy_from_slice(values);
        } else {
            self.touched[chunk] &= !(1 << brick);
        }
        self.emptied_lines[chunk][brick] = saved.emptied_lines;
        let bit = u64::from(saved.emptied) << brick;
        self.emptied[chunk] = self.emptied[chunk] & !(1 << brick) | bit;
        changed(chunk, brick);
    }

    /// Units of work that saving has cost since it was last asked.
    pub(crate) fn take_saving_work(&mut self) -> i64 {
        core::mem::take(&mut self.journal.spent)
    }
}
