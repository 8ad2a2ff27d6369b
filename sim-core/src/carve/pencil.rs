//! Lines of one brick: lowered without a branch on what they hold, then booked.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::batch::ChunkLines;
use super::ledger::Ledger;
use crate::bone::Bone;
use crate::cut::Totals;
use crate::grid::{BRICKS_PER_CHUNK, LINE_VOXELS, LINES_PER_BRICK, LINES_PER_CHUNK};
use crate::lanes::Lanes;

/// The stored values of a line.
type Line = [i16; LINE_VOXELS];
/// The stored values of a brick.
pub(super) type Lines = [Line; LINES_PER_BRICK];
/// Room for what each line of a brick loses, units.
pub(super) type Losses<L> = [<L as Lanes>::I; LINES_PER_BRICK];

/// What the bone holds in one chunk, by lines.
#[derive(Clone, Copy)]
pub(super) struct Ground<'a> {
    solid: &'a ChunkLines,
    class: &'a [[u8; LINE_VOXELS]; LINES_PER_CHUNK],
    label: &'a [[u8; LINE_VOXELS]; LINES_PER_CHUNK],
    // class and label of the lines that have one of each, and which of a brick have not
    kinds: &'a [[u8; 2]; LINES_PER_CHUNK],
    mixed: &'a [u16; BRICKS_PER_CHUNK],
}

impl<'a> Ground<'a> {
    /// Of chunk `chunk`.
    pub(super) fn new(bone: &'a Bone, chunk: usize) -> Self {
        let data = bone.chunk(chunk);
        Self {
            solid: &data.solid.as_chunks().0.as_chunks().0[0],
            class: &data.class.as_chunks().0.as_chunks().0[0],
            label: &data.label.as_chunks().0.as_chunks().0[0],
            kinds: &bone.line_kinds(chunk).as_chunks().0[0],
            mixed: bone.mixed_lines(chunk),
        }
    }

    /// Distances to the bone's surface on line `at` of the chunk.
    #[inline(always)]
    pub(super) fn solid(&self, at: usize) -> &Line {
        &self.solid[at % LINES_PER_CHUNK]
    }

    /// Of a brick.
    #[inline(always)]
    fn solid_of(&self, brick: usize) -> &'a Lines {
        &self.solid.as_chunks().0[brick % BRICKS_PER_CHUNK]
    }

    /// Books what line `at` of the chunk lost.
    #[inline(always)]
    pub(super) fn book<L: Lanes>(
        &self,
        l: L,
        at: usize,
        loss: L::I,
        (ledger, totals): (&mut Ledger<L>, &mut Totals),
    ) {
        let at = at % LINES_PER_CHUNK;
        if self.mixed[at / LINES_PER_BRICK] >> (at % LINES_PER_BRICK) & 1 == 0 {
            let [class, label] = self.kinds[at];
            ledger.add(loss, (class, label), totals);
            return;
        }
        let (class, label) = (&self.class[at], &self.label[at]);
        let mut lanes = l.not_zero(loss);
        while lanes != 0 {
            let n = lanes.trailing_zeros() as usize;
            let kind = (class[n], label[n]);
            let same = l.equal_bytes(class, kind.0) & l.equal_bytes(label, kind.1);
            ledger.add(l.keep(loss, same), kind, totals);
            lanes &= !same;
        }
    }
}

/// Writes lines of one brick.
pub(super) struct Pencil<'a, L: Lanes> {
    l: L,
    values: &'a mut Lines,
    solid: &'a Lines,
    // half the occupancy's window, and its negative
    window: [L::I; 2],
    losses: &'a mut Losses<L>,
    // where values changed, lines with a changed volume, and lines with every value at its lowest
    changed: L::I,
    losing: u16,
    lowest: u16,
}

impl<'a, L: Lanes> Pencil<'a, L> {
    /// For brick `brick` of the ground's chunk, whose cut values are `values`; `window` is half the
    /// occupancy's.
    #[inline(always)]
    pub(super) fn new(
        l: L,
        (ground, brick): (&Ground<'a>, usize),
        values: &'a mut Lines,
        window: i16,
        losses: &'a mut Losses<L>,
    ) -> Self {
        Self {
            l,
            values,
            solid: ground.solid_of(brick),
            window: [l.splat_i(window), l.splat_i(-window)],
            losses,
            changed: l.splat_i(0),
            losing: 0,
            lowest: 0,
        }
    }

    /// Fills lines with the lowest value.
    #[inline(always)]
    pub(super) fn fill(&mut self, mut lines: u16) {
        self.lowest = lines;
        while lines != 0 {
            let line = lines.trailing_zeros() as usize;
            lines &= lines - 1;
            self.lower(line, self.l.splat_i(-i16::MAX));
        }
    }

    /// Takes the smaller values.
    #[inline(always)]
    pub(super) fn lower(&mut self, line: usize, new: L::I) {
        let l = self.l;
        let line = line % LINES_PER_BRICK;
        let values = &mut self.values[line];
        let old = l.load_i(values);
        let new = l.min_i(new, old);
        l.store_i(new, values);
        self.changed = l.note_difference(self.changed, old, new);
        // units of occupancy, less half a voxel: clamp(min(solid, cut), ± window)
        let [high, low] = self.window;
        let solid = l.min_i(l.load_i(&self.solid[line]), high);
        let before = l.max_i(l.min_i(solid, old), low);
        let after = l.max_i(l.min_i(solid, new), low);
        self.losses[line] = l.sub_i(before, after);
        self.losing |= u16::from(l.any_less(after, before)) << line;
    }

    /// Whether a value changed, and the lines that are at their lowest.
    #[inline(always)]
    pub(super) fn end(&self) -> (bool, u16) {
        let zero = self.l.splat_i(0);
        let changed = self.l.any_less(self.changed, zero) || self.l.any_less(zero, self.changed);
        (changed, self.lowest)
    }

    /// Books what was removed.
    #[inline(always)]
    pub(super) fn book(
        &self,
        (ground, brick): (&Ground<'a>, usize),
        ledger: &mut Ledger<L>,
        totals: &mut Totals,
    ) {
        let mut losing = self.losing;
        while losing != 0 {
            let line = losing.trailing_zeros() as usize % LINES_PER_BRICK;
            losing &= losing - 1;
            let at = brick * LINES_PER_BRICK + line;
            ground.book(self.l, at, self.losses[line], (&mut *ledger, &mut *totals));
        }
    }
}
