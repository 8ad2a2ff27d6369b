//! Lines of one brick: lowered without a branch on what they hold, then booked.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::ledger::Ledger;
use crate::bone::{Bone, ChunkData};
use crate::cut::{Cut, Totals};
use crate::grid::{BRICK_VOXELS, LINE_VOXELS, LINES_PER_BRICK};
use crate::lanes::Lanes;

/// The stored values of a line.
type Line = [i16; LINE_VOXELS];
/// Room for what each line of a brick loses, units.
pub(super) type Losses<L> = [<L as Lanes>::I; LINES_PER_BRICK];

/// Writes lines of one brick.
pub(super) struct Pencil<'a, L: Lanes> {
    l: L,
    values: &'a mut [Line],
    totals: &'a mut Totals,
    data: ChunkData<'a>,
    solid: &'a [Line],
    // first voxel of the brick in its chunk's arrays
    base: usize,
    mixed: u16,
    // half the occupancy's; none for no account
    window: Option<i16>,
    // lines with a changed value, with a changed volume, and with every value at its lowest
    changed: u16,
    losing: u16,
    lowest: u16,
    losses: &'a mut Losses<L>,
}

impl<'a, L: Lanes> Pencil<'a, L> {
    /// For brick `brick` of chunk `chunk`.
    #[inline(always)]
    pub(super) fn new(
        l: L,
        (bone, cut): (&'a Bone, &'a mut Cut),
        (chunk, brick): (usize, usize),
        window: Option<i16>,
        losses: &'a mut Losses<L>,
    ) -> Self {
        let data = bone.chunk(chunk);
        let base = brick * BRICK_VOXELS;
        let (values, totals) = cut.brick_and_totals(chunk, brick);
        Self {
            l,
            values: values.as_chunks_mut().0,
            totals,
            solid: data.solid[base..base + BRICK_VOXELS].as_chunks().0,
            data,
            base,
            mixed: bone.mixed_lines(chunk)[brick],
            window,
            changed: 0,
            losing: 0,
            lowest: 0,
            losses,
        }
    }

    /// Fills lines with the lowest value.
    #[inline(always)]
    pub(super) fn fill(&mut self, mut lines: u16) {
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
        self.changed |= u16::from(l.any_less(new, old)) << line;
        self.lowest |= u16::from(!l.any_less(l.splat_i(-i16::MAX), new)) << line;
        if let Some(window) = self.window {
            let solid = l.load_i(&self.solid[line]);
            // units of occupancy, less half a voxel: clamp(min(solid, cut), ± window)
            let (low, high) = (l.splat_i(-window), l.splat_i(window));
            let solid = l.max_i(l.min_i(solid, high), low);
            let before = l.max_i(l.min_i(solid, old), low);
            let after = l.max_i(l.min_i(solid, new), low);
            self.losses[line] = l.sub_i(before, after);
            self.losing |= u16::from(l.any_less(after, before)) << line;
        }
    }

    /// Books what was removed; whether a value changed, and the lines that are at their lowest.
    #[inline(always)]
    pub(super) fn close(&mut self, ledger: &mut Ledger<L>) -> (bool, u16) {
        let mut losing = self.losing;
        while losing != 0 {
            let line = losing.trailing_zeros() as usize % LINES_PER_BRICK;
            losing &= losing - 1;
            let at = self.base + line * LINE_VOXELS;
            let (Some(class), Some(label)) = (
                self.data.class[at..].first_chunk(),
                self.data.label[at..].first_chunk(),
            ) else {
                continue;
            };
            let loss = self.losses[line];
            if self.mixed >> line & 1 == 0 {
                ledger.add(loss, (class[0], label[0]), self.totals);
                continue;
            }
            let mut lanes = self.l.not_zero(loss);
            while lanes != 0 {
                let n = lanes.trailing_zeros() as usize;
                let kind = (class[n], label[n]);
                let same = self.l.equal_bytes(class, kind.0) & self.l.equal_bytes(label, kind.1);
                ledger.add(self.l.keep(loss, same), kind, self.totals);
                lanes &= !same;
            }
        }
        (self.changed != 0, self.lowest)
    }
}
