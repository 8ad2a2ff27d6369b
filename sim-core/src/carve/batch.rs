//! Lines of several bricks that see the same faces, lowered in one loop.
//!
//! A brick has few lines to compute, and a loop over these alone ends where the processor cannot foresee it.
//! Bricks of the same faces share a loop: what each has in common is laid out first, then their lines are
//! listed without a branch, and one loop runs over all. The faces are looked up once for the loop, and lines
//! whose volume cannot change go through one that does not book.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "a brick's number is below 64, a line's below 16, a place in a batch below 8; lanes must melt into the job"
)]

use super::flats::{Field, Pair, Plate, Voxels};
use super::ledger::Ledger;
use super::node::Node;
use super::pencil::Ground;
use crate::cut::Totals;
use crate::grid::{BRICKS_PER_CHUNK, LINE_VOXELS, LINES_PER_BRICK, LINES_PER_CHUNK};
use crate::lanes::Lanes;

/// Bricks of a batch.
pub(super) const BRICKS: usize = 8;
/// Lines of a batch.
const LINES: usize = BRICKS * LINES_PER_BRICK;

/// The stored values of a chunk by lines.
pub(super) type ChunkLines = [[i16; LINE_VOXELS]; LINES_PER_CHUNK];

/// The numbers of the bits that are set in each byte, the lowest first.
const LINES_OF: [[u8; 8]; 256] = {
    let mut all = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut bit, mut count) = (0u8, 0);
        while bit < 8 {
            if mask >> bit & 1 == 1 {
                all[mask][count] = bit;
                count += 1;
            }
            bit += 1;
        }
        mask += 1;
    }
    all
};

/// A list of lines: the brick's place in the batch, and the line.
struct List {
    // room for the entries that the last brick's absent lines write
    lines: [u8; LINES + LINES_PER_BRICK],
    count: usize,
}

impl List {
    const EMPTY: Self = Self {
        lines: [0; LINES + LINES_PER_BRICK],
        count: 0,
    };

    /// Appends a brick's lines in `mask`, without a branch on it.
    #[inline(always)]
    fn push(&mut self, place: usize, mask: u16) {
        let brick = u64::from_le_bytes([(place << 4) as u8; 8]);
        for (half, first) in [(mask & 255, 0), (mask >> 8, 8)] {
            let lines = u64::from_le_bytes(LINES_OF[usize::from(half)]);
            let first = u64::from_le_bytes([first; 8]);
            if let Some(to) = self.lines.get_mut(self.count..self.count + 8) {
                to.copy_from_slice(&(brick | first | lines).to_le_bytes());
            }
            self.count += half.count_ones() as usize;
        }
    }

    fn entries(&self) -> &[u8] {
        &self.lines[..self.count.min(LINES)]
    }
}

/// Bricks under way.
pub(super) struct Batch<L: Lanes> {
    plates: [Pair<Plate<L::F>>; BRICKS],
    bricks: [u8; BRICKS],
    used: usize,
    // lines whose volume can change, and the others
    counted: List,
    outer: List,
    // lines that lost volume, and what they lost
    losses: [L::I; LINES],
    lost: [u16; LINES],
}

impl<L: Lanes> Batch<L> {
    /// Room, made once a job.
    #[inline(always)]
    pub(super) fn new(l: L) -> Self {
        Self {
            plates: [[Plate::new(l); 2]; BRICKS],
            bricks: [0; BRICKS],
            used: 0,
            counted: List::EMPTY,
            outer: List::EMPTY,
            losses: [l.splat_i(0); LINES],
            lost: [0; LINES],
        }
    }

    /// Forgets all bricks.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.used = 0;
        self.counted.count = 0;
        self.outer.count = 0;
    }

    /// Whether no brick fits any more.
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.used == BRICKS
    }

    /// Takes in the lines `near` of brick `brick`, whose first voxel lies at `o` in the chunk's node; the
    /// volume of those in `outer` cannot change.
    #[inline(always)]
    pub(super) fn push(
        &mut self,
        l: L,
        field: &impl Field<L>,
        (chunk, o, voxels): (&Node, [f32; 3], &Voxels<L::F>),
        (brick, near, outer): (usize, u16, u16),
    ) {
        let place = self.used % BRICKS;
        field.lay(l, &mut self.plates[place], chunk, o, voxels);
        self.bricks[place] = brick as u8;
        self.counted.push(place, near & !outer);
        self.outer.push(place, near & outer);
        self.used = place + 1;
    }

    /// Bricks in it.
    #[inline(always)]
    pub(super) fn bricks(&self) -> &[u8] {
        &self.bricks[..self.used.min(BRICKS)]
    }

    /// Number of a line in its chunk.
    #[inline(always)]
    fn at(&self, entry: u8) -> usize {
        let brick = self.bricks[usize::from(entry >> 4) % BRICKS];
        (usize::from(brick) % BRICKS_PER_CHUNK) << 4 | usize::from(entry & 15)
    }

    /// New distances of a line.
    #[inline(always)]
    fn distances(&self, l: L, field: &impl Field<L>, entry: u8) -> L::I {
        let plates = &self.plates[usize::from(entry >> 4) % BRICKS];
        let [low, high] = field.pair(l, plates, usize::from(entry & 15));
        l.round(low, high)
    }

    /// Lowers all lines; bit *n* where a value of the *n*-th brick changed. `window` is half the
    /// occupancy's, and its negative.
    #[inline(always)]
    pub(super) fn lower(
        &mut self,
        l: L,
        field: &impl Field<L>,
        values: &mut ChunkLines,
        (ground, window): (&Ground<'_>, [L::I; 2]),
        (ledger, totals): (&mut Ledger<L>, &mut Totals),
    ) -> u8 {
        let mut changed = 0;
        for &entry in self.outer.entries() {
            let at = self.at(entry);
            let new = self.distances(l, field, entry);
            let old = l.load_i(&values[at]);
            let new = l.min_i(new, old);
            l.store_i(new, &mut values[at]);
            changed |= u8::from(l.any_less(new, old)) << (entry >> 4);
        }
        let [most, least] = window;
        let mut lost = 0;
        for n in 0..self.counted.count.min(LINES) {
            let entry = self.counted.lines[n];
            let at = self.at(entry);
            let new = self.distances(l, field, entry);
            // read before the store: a load after a store at the same offset of another page may wait for it
            let solid = l.min_i(l.load_i(ground.solid(at)), most);
            let old = l.load_i(&values[at]);
            let new = l.min_i(new, old);
            l.store_i(new, &mut values[at]);
            changed |= u8::from(l.any_less(new, old)) << (entry >> 4);
            // units of occupancy, less half a voxel: clamp(min(solid, cut), ± window)
            let before = l.max_i(l.min_i(solid, old), least);
            let after = l.max_i(l.min_i(solid, new), least);
            // kept where there is one: the next overwrites it otherwise
            self.losses[lost % LINES] = l.sub_i(before, after);
            self.lost[lost % LINES] = at as u16;
            lost += usize::from(l.any_less(after, before));
        }
        for n in 0..lost.min(LINES) {
            ground.book(
                l,
                usize::from(self.lost[n]),
                self.losses[n],
                (ledger, totals),
            );
        }
        changed
    }

    /// Lowers all lines without an account.
    #[inline(always)]
    pub(super) fn lower_only(
        &mut self,
        l: L,
        field: &impl Field<L>,
        values: &mut ChunkLines,
    ) -> u8 {
        let mut changed = 0;
        for list in [&self.outer, &self.counted] {
            for &entry in list.entries() {
                let at = self.at(entry);
                let old = l.load_i(&values[at]);
                let new = l.min_i(self.distances(l, field, entry), old);
                l.store_i(new, &mut values[at]);
                changed |= u8::from(l.any_less(new, old)) << (entry >> 4);
            }
        }
        changed
    }
}

/// Bricks of a chunk by the faces that they see: what sees the same is done in a row.
#[derive(Debug, Clone)]
pub(super) struct Sets {
    faces: [u16; Self::MOST],
    members: [u64; Self::MOST],
    used: usize,
}

impl Sets {
    /// Sets that are kept apart; the last takes in all others.
    const MOST: usize = 8;

    /// No brick.
    pub(super) const EMPTY: Self = Self {
        faces: [0; Self::MOST],
        members: [0; Self::MOST],
        used: 0,
    };

    /// Adds brick `n`, which sees `faces`.
    #[inline(always)]
    pub(super) fn add(&mut self, n: usize, faces: u16) {
        let mut set = 0;
        while set < self.used && self.faces[set % Self::MOST] != faces {
            set += 1;
        }
        if set == self.used {
            if self.used < Self::MOST {
                self.faces[set % Self::MOST] = faces;
                self.members[set % Self::MOST] = 0;
                self.used += 1;
            } else {
                set = Self::MOST - 1;
                // no faces of its own: each brick's are to be looked at
                self.faces[set] = u16::MAX;
            }
        }
        self.members[set % Self::MOST] |= 1 << n;
    }

    /// Number of sets.
    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.used.min(Self::MOST)
    }

    /// Faces (all bits where they differ) and bricks of a set.
    #[inline(always)]
    pub(super) fn get(&self, set: usize) -> (u16, u64) {
        (self.faces[set % Self::MOST], self.members[set % Self::MOST])
    }
}
