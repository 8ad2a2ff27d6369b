//! One pose of the tool taken out of the bone, chunk by chunk.
//!
//! A chunk is done in two rounds: first all its bricks are bounded, which gives for each the lines to be
//! filled and those to be computed ([`super::plan`]); then the lines are written ([`super::write`]).
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::batch::Batch;
use super::bounds::{Bounds, Extent, Sides};
use super::flats::Voxels;
use super::ledger::Ledger;
use super::many::Room;
use super::node::{Node, Points};
use super::patterns::{brick_layer, heights, layer, line_middles};
use super::pencil::{Losses, Pencil};
use super::placed::Placed;
use super::plan::{Plan, Plans, Standing};
use super::sampled::{Box3, Offsets, Sampled};
use super::since::Since;
use super::write::Desk;
use crate::bone::{Bone, Occupancy};
use crate::broad::ChunkRange;
use crate::cut::Cut;
use crate::grid::{BRICKS_PER_CHUNK, CHUNK, LINES_PER_BRICK, brick_origin};
use crate::lanes::{Isa, Job, Lanes, dispatch};
use glam::{DVec3, Vec3};

/// Units of work that a pose costs whatever it meets.
const STAMP_WORK: i64 = 16;
/// Units of work of a line that is read from a sampled tool, 32 times eight samples, and of sorting the
/// lines of one of its bricks.
const SAMPLE_WORK: i64 = 10;
const SORT_WORK: i64 = 4;

/// One pose's work.
pub(super) struct Stamp<'a> {
    pub bone: &'a Bone,
    pub cut: &'a mut Cut,
    pub changed: &'a mut dyn FnMut(usize, usize),
    pub placed: &'a Placed,
    /// The last stamp, where it says something.
    pub since: Option<Since<'a>>,
    /// Where it moves slowly, how plans are kept.
    pub standing: Option<Standing>,
    /// A tool that is sampled on a grid; it has no faces then.
    pub sampled: Option<Sampled<'a>>,
    pub tool: u8,
    pub account: bool,
    /// Units of work left.
    pub budget: &'a mut i64,
}

impl Stamp<'_> {
    /// Carves the chunks of `range` from the `first` on while there is budget; the first that is left.
    pub(super) fn run(&mut self, isa: Isa, range: &ChunkRange, first: usize) -> usize {
        dispatch(
            isa,
            Chunks {
                stamp: self,
                range,
                first,
            },
        )
    }
}

struct Chunks<'a, 'b> {
    stamp: &'a mut Stamp<'b>,
    range: &'a ChunkRange,
    first: usize,
}

impl Job for Chunks<'_, '_> {
    type Output = usize;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> usize {
        let size: [usize; 3] = core::array::from_fn(|a| self.range.hi[a] - self.range.lo[a]);
        let kernel = Kernel::new(l, self.stamp);
        let mut scratch = Scratch {
            chunk: Node::empty(),
            last: Node::empty(),
            brick: Node::empty(),
            bounds: Bounds::new(l),
            sides: Sides::new(l),
            ledger: Ledger::new(l, self.stamp.tool),
            losses: [l.splat_i(0); LINES_PER_BRICK],
            room: Room::new(l),
            batch: Batch::new(l),
        };
        let mut plans = core::mem::replace(&mut self.stamp.cut.plans, Plans::absent());
        let mut own = Plan::EMPTY;
        let mut next = self.first;
        while next < size[0] * size[1] * size[2] && *self.stamp.budget > 0 {
            let at = [
                next % size[0],
                next / size[0] % size[1],
                next / (size[0] * size[1]),
            ];
            let coord = core::array::from_fn(|a| self.range.lo[a] + at[a]);
            *self.stamp.budget -= 1;
            if let Some(chunk) = self.stamp.bone.chunk_at(coord) {
                if let Some(sampled) = self.stamp.sampled {
                    kernel.sample_chunk(self.stamp, &mut scratch, &sampled, (chunk, coord));
                } else {
                    let first = coord.map(|c| c * CHUNK);
                    kernel.chunk(
                        self.stamp,
                        &mut scratch,
                        (&mut plans, &mut own),
                        (chunk, first),
                    );
                }
                *self.stamp.budget -= self.stamp.cut.take_saving_work();
            }
            next += 1;
        }
        self.stamp.cut.plans = plans;
        scratch.ledger.book(&mut self.stamp.cut.totals);
        // at the end: a budget of one must still get on
        *self.stamp.budget -= STAMP_WORK;
        next
    }
}

/// Constants of a pose on a vector unit.
pub(super) struct Kernel<L: Lanes> {
    pub(super) l: L,
    /// middles of the 16 bricks of each layer of a chunk, from the chunk's middle
    pub(super) bricks: [Points<L::F>; 4],
    /// middles of the 16 lines of a brick, from its first voxel
    pub(super) lines: Points<L::F>,
    pub(super) voxels: Voxels<L::F>,
    /// voxels of a line in a sampled tool's frame
    pub(super) offsets: Offsets<L::F>,
    pub(super) chunk_middle: DVec3,
    pub(super) chunk_radius: f64,
    pub(super) spacing: [f32; 3],
    pub(super) brick: Extent,
    pub(super) line: Extent,
    pub(super) band: f32,
    /// half the occupancy's
    pub(super) window: i16,
    /// how far the tool may have moved since the last stamp where plans are kept
    pub(super) slow: f32,
}

/// Long arrays that are made once a job.
pub(super) struct Scratch<L: Lanes> {
    pub(super) chunk: Node,
    pub(super) last: Node,
    pub(super) brick: Node,
    pub(super) bounds: Bounds<L::F>,
    pub(super) sides: Sides<L::F>,
    pub(super) ledger: Ledger<L>,
    pub(super) losses: Losses<L>,
    pub(super) room: Room<L::F>,
    pub(super) batch: Batch<L>,
}

impl<L: Lanes> Kernel<L> {
    #[inline(always)]
    fn new(l: L, stamp: &Stamp<'_>) -> Self {
        let placed = stamp.placed;
        let spacing = placed.spacing;
        let h = spacing.as_vec3().to_array();
        let slack = placed.slack;
        Self {
            l,
            bricks: [
                brick_layer(l, h, 0),
                brick_layer(l, h, 1),
                brick_layer(l, h, 2),
                brick_layer(l, h, 3),
            ],
            lines: line_middles(l, h),
            voxels: Voxels {
                layers: [
                    layer(l, h, 0),
                    layer(l, h, 1),
                    layer(l, h, 2),
                    layer(l, h, 3),
                ],
                rise: h[2],
                heights: heights(l, h[2]),
            },
            offsets: Offsets::new(l, stamp.sampled.as_ref()),
            chunk_middle: spacing * 15.5,
            chunk_radius: 15.5 * spacing.length() + f64::from(slack),
            spacing: h,
            brick: Extent::new([3.5 * h[0], 3.5 * h[1], 3.5 * h[2]], slack),
            line: Extent::new([1.5 * h[0], 1.5 * h[1], 0.5 * h[2]], slack),
            band: placed.band,
            window: Occupancy::new(stamp.bone.grid()).half_window(),
            slow: stamp.standing.map_or(0.0, |standing| standing.moved()),
        }
    }

    /// A chunk under a tool that is sampled on a grid.
    #[inline(always)]
    fn sample_chunk(
        &self,
        stamp: &mut Stamp<'_>,
        scratch: &mut Scratch<L>,
        sampled: &Sampled<'_>,
        (chunk, coord): (usize, [usize; 3]),
    ) {
        let mut bricks = stamp.bone.bony_bricks(chunk) & !stamp.cut.emptied(chunk);
        if bricks == 0 || !sampled.reaches(coord) {
            return;
        }
        let bony_lines = stamp.bone.bony_lines(chunk);
        let mut desk = Desk::new(stamp, chunk);
        while bricks != 0 {
            let brick = bricks.trailing_zeros() as usize % BRICKS_PER_CHUNK;
            bricks &= bricks - 1;
            *desk.budget -= 1;
            let first = sampled.first(coord, brick);
            let bony = bony_lines[brick];
            let live = bony & !desk.open.emptied_lines(brick);
            let what = sampled.brick(first);
            if what == Box3::Skip || live == 0 {
                continue;
            }
            let values = desk.open.lines(brick);
            let place = (&desk.ground, brick);
            let mut pencil = Pencil::new(self.l, place, values, self.window, &mut scratch.losses);
            if what == Box3::Fill {
                *desk.budget -= i64::from(live.count_ones());
                pencil.fill(live);
            } else {
                *desk.budget -= SORT_WORK;
                *desk.budget -= self.sample_lines(&mut pencil, sampled, first, live);
            }
            if desk.account {
                pencil.book(place, &mut scratch.ledger, desk.totals);
            }
            let end = pencil.end();
            desk.finish(brick, bony, end);
        }
    }

    /// Lowers a brick's lines to a sampled tool's distance; the units of work that it took.
    #[inline(always)]
    fn sample_lines(
        &self,
        pencil: &mut Pencil<'_, L>,
        sampled: &Sampled<'_>,
        first: Vec3,
        live: u16,
    ) -> i64 {
        let (mut lines, mut full, mut work) = (live, 0, 0);
        while lines != 0 {
            let line = lines.trailing_zeros() as usize;
            lines &= lines - 1;
            match sampled.line(self.l, &self.offsets, first, line) {
                (Box3::Skip, _) => {}
                (Box3::Fill, _) => {
                    work += 1;
                    full |= 1 << line;
                }
                (Box3::Look, values) => {
                    work += SAMPLE_WORK;
                    pencil.lower(line, values);
                }
            }
        }
        pencil.fill(full);
        work
    }

    /// First voxel of a brick, from the chunk's middle.
    #[inline(always)]
    pub(super) fn offset(&self, brick: usize) -> [f32; 3] {
        let corner = brick_origin(brick);
        [
            self.spacing[0] * (corner[0] as f32 - 15.5),
            self.spacing[1] * (corner[1] as f32 - 15.5),
            self.spacing[2] * (corner[2] as f32 - 15.5),
        ]
    }
}

#[inline(always)]
pub(super) fn single(faces: u16) -> bool {
    faces & faces.wrapping_sub(1) == 0
}
