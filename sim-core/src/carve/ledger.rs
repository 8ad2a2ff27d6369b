//! The account of a pose: removed occupancy by tissue class and label.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use crate::cut::Totals;
use crate::lanes::Lanes;
use crate::tissue::TISSUES;

/// Kinds (class and label) of voxels that are kept apart before they are booked.
const KINDS: usize = 8;
/// Lines after which sums are booked: a lane gets at most 2 × 2¹⁵ units a line, in an `i32`.
const LINES: u32 = 1 << 14;

/// Removed units of one kind.
#[derive(Clone, Copy)]
struct Kind<S> {
    class: u8,
    label: u8,
    units: S,
}

/// The account of one pose.
pub(super) struct Ledger<L: Lanes> {
    l: L,
    kinds: [Kind<L::S>; KINDS],
    used: usize,
    lines: u32,
    tool: usize,
}

impl<L: Lanes> Ledger<L> {
    #[inline(always)]
    pub(super) fn new(l: L, tool: u8) -> Self {
        let none = Kind {
            class: 0,
            label: 0,
            units: l.no_sums(),
        };
        Self {
            l,
            kinds: [none; KINDS],
            used: 0,
            lines: 0,
            tool: usize::from(tool),
        }
    }

    /// Adds a line's removed units of one kind.
    #[inline(always)]
    pub(super) fn add(&mut self, units: L::I, kind: (u8, u8), totals: &mut Totals) {
        let l = self.l;
        let mut n = 0;
        while n < self.used && (self.kinds[n].class, self.kinds[n].label) != kind {
            n += 1;
        }
        if n == self.used || self.lines == LINES {
            if self.used == KINDS || self.lines == LINES {
                self.book(totals);
            }
            n = self.used;
            self.kinds[n] = Kind {
                class: kind.0,
                label: kind.1,
                units: l.no_sums(),
            };
            self.used = n + 1;
        }
        self.lines += 1;
        let sums = &mut self.kinds[n].units;
        *sums = l.add_products(*sums, units, l.splat_i(1));
    }

    /// Books all kinds and forgets them.
    #[inline(always)]
    pub(super) fn book(&mut self, totals: &mut Totals) {
        for n in 0..self.used.min(KINDS) {
            let kind = self.kinds[n];
            let units = self.l.total(kind.units);
            totals.by_class[usize::from(kind.class) % TISSUES] += units;
            totals.by_label[usize::from(kind.label)] += units;
            totals.by_tool[self.tool] += units;
        }
        self.used = 0;
        self.lines = 0;
    }
}
