//! Writing the lines of a brick: which code computes them, and the chunk that they go to.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::flats::{
    Field, Many, One, OneBall, OneCone, OnePlane, OneWideBall, OneWideCylinder, Room, Sheet as _,
    Two,
};
use super::node::Node;
use super::pencil::{Ground, Pencil};
use super::placed::{Kind, MAX_FLAT};
use super::stamp::{Kernel, Scratch, Stamp, Task, single};
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

/// What a brick's lines are computed from.
struct Sight<'a, L: Lanes> {
    chunk: &'a Node,
    brick: &'a mut Node,
    room: &'a mut Room<L::F>,
}

impl<L: Lanes> Kernel<L> {
    /// Writes a brick's lines.
    #[inline(always)]
    pub(super) fn write(&self, desk: &mut Desk<'_>, scratch: &mut Scratch<L>, n: usize) {
        let task = scratch.tasks[n % BRICKS_PER_CHUNK];
        let brick = usize::from(task.brick) % BRICKS_PER_CHUNK;
        let values = desk.open.lines(brick);
        let place = (&desk.ground, brick);
        let mut pencil = Pencil::new(self.l, place, values, self.window, &mut scratch.losses);
        if task.full != 0 {
            pencil.fill(task.full);
        }
        if task.near != 0 {
            let mut sight = Sight {
                chunk: &scratch.chunk,
                brick: &mut scratch.brick,
                room: &mut scratch.room,
            };
            self.lower(&mut pencil, &mut sight, task);
        }
        if desk.account {
            pencil.book(place, &mut scratch.ledger, desk.totals);
        }
        let end = pencil.end();
        desk.finish(brick, task.bony, end);
    }

    /// Lowers a brick's lines to the tool's distance.
    #[inline(always)]
    fn lower(&self, pencil: &mut Pencil<'_, L>, sight: &mut Sight<'_, L>, task: Task) {
        let (l, near) = (self.l, task.near);
        let (chunk, voxels, o) = (sight.chunk, &self.voxels, self.offset(task.brick));
        let a = task.faces.trailing_zeros() as usize % MAX_FLAT;
        let others = task.faces & task.faces.wrapping_sub(1);
        let b = others.trailing_zeros() as usize % MAX_FLAT;
        if others == 0 {
            match chunk.faces[a].kind {
                Kind::WideBall => {
                    let field = One(OneWideBall::new(l, chunk, a, o, voxels));
                    return self.compute(pencil, field, near);
                }
                Kind::WideCylinder => {
                    let field = One(OneWideCylinder::new(l, chunk, a, o, voxels));
                    return self.compute(pencil, field, near);
                }
                Kind::Ball => {
                    let field = One(OneBall::new(l, chunk, a, o, voxels));
                    return self.compute(pencil, field, near);
                }
                Kind::Cone => {
                    let field = One(OneCone::new(l, chunk, a, o, voxels));
                    return self.compute(pencil, field, near);
                }
                Kind::Plane | Kind::Ring => {}
            }
        } else if single(others) && chunk.faces[a].part == chunk.faces[b].part {
            match (chunk.faces[a].kind, chunk.faces[b].kind) {
                (Kind::WideBall, Kind::WideCylinder) => {
                    let ball = OneWideBall::new(l, chunk, a, o, voxels);
                    let field = Two(ball, OneWideCylinder::new(l, chunk, b, o, voxels));
                    return self.compute(pencil, field, near);
                }
                (Kind::WideCylinder, Kind::Plane) => {
                    let side = OneWideCylinder::new(l, chunk, a, o, voxels);
                    let field = Two(side, OnePlane::new(l, chunk, b, o, voxels));
                    return self.compute(pencil, field, near);
                }
                (Kind::Cone, Kind::Cone) => {
                    let point = OneCone::new(l, chunk, a, o, voxels);
                    let field = Two(point, OneCone::new(l, chunk, b, o, voxels));
                    return self.compute(pencil, field, near);
                }
                _ => {}
            }
        }
        sight.brick.enter(chunk, o, task.faces);
        let field = Many::<L>::new(sight.brick, sight.room);
        self.compute(pencil, field, near);
    }

    /// Lowers lines to the distances of `field`.
    #[inline(always)]
    fn compute(&self, pencil: &mut Pencil<'_, L>, mut field: impl Field<L>, mut near: u16) {
        let l = self.l;
        field.prepare(l, &self.voxels, near);
        while near != 0 {
            let line = near.trailing_zeros() as usize;
            near &= near - 1;
            let [low, high] = field.pair(l, &self.voxels, line);
            pencil.lower(line, l.round(low, high));
        }
    }
}
