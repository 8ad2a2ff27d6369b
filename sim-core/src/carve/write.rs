//! Writing the lines of a brick: which code computes them, and the chunk that they go to.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::flats::{Field, One, OneBall, OneCone, OnePlane, OneWideBall, OneWideCylinder, Two};
use super::many::Many;
use super::pencil::{Ground, Pencil};
use super::placed::{Kind, MAX_FLAT};
use super::plan::Plan;
use super::stamp::{Kernel, Scratch, Stamp, single};
use crate::cut::{OpenChunk, Totals};
use crate::grid::BRICKS_PER_CHUNK;
use crate::lanes::Lanes;

/// One chunk under the pencil.
pub(super) struct Desk<'a> {
    pub(super) ground: Ground<'a>,
    pub(super) open: OpenChunk<'a>,
    pub(super) totals: &'a mut Totals,
    pub(super) changed: &'a mut dyn FnMut(usize, usize),
    pub(super) budget: &'a mut i64,
    pub(super) account: bool,
    pub(super) chunk: usize,
}

impl<'a> Desk<'a> {
    #[inline(always)]
    pub(super) fn new(stamp: &'a mut Stamp<'_>, chunk: usize) -> Self {
        let (open, totals) = stamp.cut.open(chunk);
        Self {
            ground: Ground::new(stamp.bone, chunk),
            open,
            totals,
            changed: &mut *stamp.changed,
            budget: &mut *stamp.budget,
            account: stamp.account,
            chunk,
        }
    }

    /// Notes the `lowest` lines of a brick (`bony` are those that matter), and says that it changed.
    #[inline(always)]
    pub(super) fn finish(&mut self, brick: usize, bony: u16, (any, lowest): (bool, u16)) {
        if lowest != 0 {
            self.open.add_emptied(brick, lowest, bony);
        }
        if any {
            (self.changed)(self.chunk, brick);
        }
    }
}

impl<L: Lanes> Kernel<L> {
    /// Does what a plan says in the bricks of `todo`.
    #[inline(always)]
    pub(super) fn follow(
        &self,
        stamp: &mut Stamp<'_>,
        scratch: &mut Scratch<L>,
        plan: &Plan,
        (chunk, todo): (usize, u64),
    ) {
        if todo == 0 {
            return;
        }
        let bony = stamp.bone.bony_lines(chunk);
        // what the last stamp has emptied, no step can change the volume of
        let inner = if stamp.standing.is_some() {
            u16::MAX
        } else {
            0
        };
        let mut desk = Desk::new(stamp, chunk);
        let mut full = plan.full & todo;
        while full != 0 {
            let brick = full.trailing_zeros() as usize % BRICKS_PER_CHUNK;
            full &= full - 1;
            let lines = plan.tasks[brick].full & !desk.open.emptied_lines(brick);
            if lines != 0 {
                self.fill(&mut desk, scratch, brick, (lines, bony[brick]));
            }
        }
        for set in 0..plan.near.len() {
            let (faces, members) = plan.near.get(set);
            self.lower(&mut desk, scratch, (plan, inner), (faces, members & todo));
        }
    }

    /// Fills lines of a brick; `bony` are those that can hold bone.
    #[inline(always)]
    fn fill(
        &self,
        desk: &mut Desk<'_>,
        scratch: &mut Scratch<L>,
        brick: usize,
        (lines, bony): (u16, u16),
    ) {
        *desk.budget -= i64::from(lines.count_ones());
        let values = desk.open.lines(brick);
        let place = (&desk.ground, brick);
        let mut pencil = Pencil::new(self.l, place, values, self.window, &mut scratch.losses);
        pencil.fill(lines);
        if desk.account {
            pencil.book(place, &mut scratch.ledger, desk.totals);
        }
        let end = pencil.end();
        desk.finish(brick, bony, end);
    }

    /// Lowers the lines of bricks that see `faces` (all bits where they differ) to the tool's distance.
    #[inline(always)]
    fn lower(
        &self,
        desk: &mut Desk<'_>,
        scratch: &mut Scratch<L>,
        plan: (&Plan, u16),
        (faces, members): (u16, u64),
    ) {
        if members == 0 {
            return;
        }
        let l = self.l;
        let a = faces.trailing_zeros() as usize % MAX_FLAT;
        let others = faces & faces.wrapping_sub(1);
        let b = others.trailing_zeros() as usize % MAX_FLAT;
        let [first, second] = [&scratch.chunk.faces[a], &scratch.chunk.faces[b]];
        let kinds = (first.kind, second.kind);
        if others == 0 {
            match kinds.0 {
                Kind::WideBall => {
                    let field = One::<OneWideBall<L::F>>::new(l, &scratch.chunk, a);
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                Kind::WideCylinder => {
                    let field = One::<OneWideCylinder<L::F>>::new(l, &scratch.chunk, a);
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                Kind::Ball => {
                    let field = One::<OneBall<L::F>>::new(l, &scratch.chunk, a);
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                Kind::Cone => {
                    let field = One::<OneCone<L::F>>::new(l, &scratch.chunk, a);
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                Kind::Plane | Kind::Ring => {}
            }
        } else if single(others) && first.part == second.part {
            match kinds {
                (Kind::WideBall, Kind::WideCylinder) => {
                    let field = Two::<OneWideBall<L::F>, OneWideCylinder<L::F>>::new(
                        l,
                        &scratch.chunk,
                        a,
                        b,
                    );
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                (Kind::WideCylinder, Kind::Plane) => {
                    let field =
                        Two::<OneWideCylinder<L::F>, OnePlane<L::F>>::new(l, &scratch.chunk, a, b);
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                (Kind::Cone, Kind::Cone) => {
                    let field = Two::<OneCone<L::F>, OneCone<L::F>>::new(l, &scratch.chunk, a, b);
                    return self.batches(desk, scratch, &field, (plan, members));
                }
                _ => {}
            }
        }
        let mut members = members;
        while members != 0 {
            let brick = members.trailing_zeros() as usize % BRICKS_PER_CHUNK;
            members &= members - 1;
            self.lower_one(desk, scratch, plan.0, brick);
        }
    }

    /// Lowers the lines of bricks to the distances of `field`.
    #[inline(always)]
    fn batches(
        &self,
        desk: &mut Desk<'_>,
        scratch: &mut Scratch<L>,
        field: &impl Field<L>,
        ((plan, inner), mut members): ((&Plan, u16), u64),
    ) {
        let l = self.l;
        let batch = &mut scratch.batch;
        while members != 0 {
            batch.clear();
            while members != 0 && !batch.is_full() {
                let brick = members.trailing_zeros() as usize % BRICKS_PER_CHUNK;
                members &= members - 1;
                let task = &plan.tasks[brick];
                let near = task.near & !desk.open.emptied_lines(brick);
                *desk.budget -= 1 + i64::from(near.count_ones());
                let place = (&scratch.chunk, self.offset(brick), &self.voxels);
                let apart = task.outer | task.inner & inner;
                batch.push(l, field, place, (brick, near, apart));
                desk.open.brick(brick);
            }
            let values = desk.open.all();
            let changed = if desk.account {
                let window = [l.splat_i(self.window), l.splat_i(-self.window)];
                let books = (&mut scratch.ledger, &mut *desk.totals);
                batch.lower(l, field, values, (&desk.ground, window), books)
            } else {
                batch.lower_only(l, field, values)
            };
            for (place, &brick) in batch.bricks().iter().enumerate() {
                if changed >> place & 1 == 1 {
                    (desk.changed)(desk.chunk, usize::from(brick));
                }
            }
        }
    }

    /// Lowers the lines of one brick, whatever it sees.
    #[inline(always)]
    fn lower_one(&self, desk: &mut Desk<'_>, scratch: &mut Scratch<L>, plan: &Plan, brick: usize) {
        let l = self.l;
        let task = &plan.tasks[brick];
        let mut near = task.near & !desk.open.emptied_lines(brick);
        *desk.budget -= 1 + i64::from(near.count_ones());
        let values = desk.open.lines(brick);
        let place = (&desk.ground, brick);
        let mut pencil = Pencil::new(l, place, values, self.window, &mut scratch.losses);
        let node = &mut scratch.brick;
        node.enter(&scratch.chunk, self.offset(brick), task.faces);
        let mut field = Many::<L>::new(node, &mut scratch.room);
        field.prepare(l, &self.voxels, near);
        while near != 0 {
            let line = near.trailing_zeros() as usize;
            near &= near - 1;
            let [low, high] = field.pair(line);
            pencil.lower(line, l.round(low, high));
        }
        if desk.account {
            pencil.book(place, &mut scratch.ledger, desk.totals);
        }
        let (any, _) = pencil.end();
        if any {
            (desk.changed)(desk.chunk, brick);
        }
    }
}
