//! One pose of the tool taken out of the bone, chunk by chunk.
//!
//! A chunk is done in two rounds: first all its bricks are bounded, which gives for each the lines to be
//! filled and those to be computed; then the lines are written. No line waits for a bound.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "a brick's number is below 64; lanes must melt into the job"
)]

use super::bounds::{Bounds, Deciding, Extent, active};
use super::flats::{Field, Many, OneBall, OneCone, Room, Voxels};
use super::ledger::Ledger;
use super::node::{Node, Points};
use super::patterns::{brick_layer, layer, line_middles};
use super::pencil::{Losses, Pencil};
use super::placed::{Kind, MAX_FLAT, Placed};
use super::sampled::{Box3, Sampled};
use crate::bone::{Bone, Occupancy};
use crate::broad::ChunkRange;
use crate::cut::Cut;
use crate::grid::{BRICKS_PER_CHUNK, CHUNK, LINES_PER_BRICK, brick_origin};
use crate::lanes::{Isa, Job, Lanes, dispatch};
use glam::DVec3;

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

impl Stamp<'_> {
    /// Notes the `lowest` lines of a brick (`bony` are those that matter), and says that it changed.
    fn finish(&mut self, place: (usize, usize), bony: u16, (any, lowest): (bool, u16)) {
        if lowest != 0 {
            self.cut.add_emptied(place, lowest, bony);
        }
        if any {
            (self.changed)(place.0, place.1);
        }
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
            brick: Node::empty(),
            bounds: Bounds::new(l),
            tasks: [Task::NONE; BRICKS_PER_CHUNK],
            ledger: Ledger::new(l, self.stamp.tool),
            losses: [l.splat_i(0); LINES_PER_BRICK],
            room: Room::new(l),
        };
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
                    kernel.chunk(self.stamp, &mut scratch, chunk, coord);
                }
            }
            next += 1;
        }
        scratch.ledger.book(&mut self.stamp.cut.totals);
        // at the end: a budget of one must still get on
        *self.stamp.budget -= STAMP_WORK;
        next
    }
}

/// Constants of a pose on a vector unit.
struct Kernel<L: Lanes> {
    l: L,
    // middles of the 16 bricks of each layer of a chunk, from the chunk's middle
    bricks: [Points<L::F>; 4],
    // middles of the 16 lines of a brick, from its first voxel
    lines: Points<L::F>,
    voxels: Voxels<L::F>,
    chunk_middle: DVec3,
    chunk_radius: f64,
    spacing: [f32; 3],
    brick: Extent,
    line: Extent,
    band: f32,
    // half the occupancy's window; none for no account
    window: Option<i16>,
}

/// Long arrays that are made once a job.
struct Scratch<L: Lanes> {
    chunk: Node,
    brick: Node,
    bounds: Bounds<L::F>,
    tasks: [Task; BRICKS_PER_CHUNK],
    ledger: Ledger<L>,
    losses: Losses<L>,
    room: Room<L::F>,
}

/// What is to be done in a brick.
#[derive(Clone, Copy)]
struct Task {
    brick: u8,
    // one bit a face that can decide
    faces: u32,
    // lines that can hold bone; of them, those to be filled, and those to be computed
    bony: u16,
    full: u16,
    near: u16,
    // where each face of the tool can decide
    deciding: Deciding,
}

impl Task {
    const NONE: Self = Self {
        brick: 0,
        faces: 0,
        bony: 0,
        full: 0,
        near: 0,
        deciding: [0; MAX_FLAT],
    };
}

impl Task {
    /// Keeps the faces that decide on lines to be computed; `deciding` has those of the brick's node.
    #[inline(always)]
    fn narrow(&mut self, deciding: &Deciding) {
        let mut faces = self.faces;
        let mut n = 0;
        while faces != 0 {
            let face = faces.trailing_zeros() as usize % MAX_FLAT;
            faces &= faces - 1;
            let lines = deciding[n % MAX_FLAT] & self.near;
            self.deciding[face] = lines;
            if lines == 0 {
                self.faces &= !(1 << face);
            }
            n += 1;
        }
    }
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
            },
            chunk_middle: spacing * 15.5,
            chunk_radius: 15.5 * spacing.length() + f64::from(slack),
            spacing: h,
            brick: Extent::new([3.5 * h[0], 3.5 * h[1], 3.5 * h[2]], slack),
            line: Extent::new([1.5 * h[0], 1.5 * h[1], 0.5 * h[2]], slack),
            band: placed.band,
            window: stamp
                .account
                .then(|| Occupancy::new(stamp.bone.grid()).half_window()),
        }
    }

    #[inline(always)]
    fn chunk(
        &self,
        stamp: &mut Stamp<'_>,
        scratch: &mut Scratch<L>,
        chunk: usize,
        coord: [usize; 3],
    ) {
        let live = stamp.bone.bony_bricks(chunk) & !stamp.cut.emptied(chunk);
        let placed = stamp.placed;
        if live == 0 {
            return;
        }
        let middle = placed.apex_to([coord[0] * CHUNK, coord[1] * CHUNK, coord[2] * CHUNK])
            + self.chunk_middle;
        if placed.distance(middle) - self.chunk_radius >= f64::from(self.band) {
            return;
        }
        placed.enter(&mut scratch.chunk, middle);
        let mut count = 0;
        for layer in 0..4 {
            let here = (live >> (16 * layer)) as u16;
            if here != 0 {
                *stamp.budget -= 1;
                self.bound_bricks(stamp, scratch, (chunk, layer, here), &mut count);
            }
        }
        let mut kept = 0;
        for n in 0..count {
            let task = self.bound_lines(scratch, scratch.tasks[n % BRICKS_PER_CHUNK], placed);
            *stamp.budget -= 1 + i64::from((task.full | task.near).count_ones());
            scratch.tasks[kept % BRICKS_PER_CHUNK] = task;
            kept += usize::from(task.full | task.near != 0);
        }
        for n in 0..kept {
            self.write(stamp, scratch, chunk, n);
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
        while bricks != 0 {
            let brick = bricks.trailing_zeros() as usize;
            bricks &= bricks - 1;
            *stamp.budget -= 1;
            let first = sampled.first(coord, brick);
            let place = (chunk, brick);
            let bony = stamp.bone.bony_lines(chunk)[brick % BRICKS_PER_CHUNK];
            let live = bony & !stamp.cut.emptied_lines(chunk, brick);
            let [full, mut near] = match sampled.brick(first) {
                Box3::Skip => continue,
                Box3::Fill => [live, 0],
                Box3::Look => {
                    *stamp.budget -= SORT_WORK;
                    sampled.lines(first, live)
                }
            };
            *stamp.budget -=
                i64::from(full.count_ones()) + SAMPLE_WORK * i64::from(near.count_ones());
            if full | near == 0 {
                continue;
            }
            let fields = (stamp.bone, &mut *stamp.cut);
            let mut pencil = Pencil::new(self.l, fields, place, self.window, &mut scratch.losses);
            pencil.fill(full);
            while near != 0 {
                let line = near.trailing_zeros() as usize;
                near &= near - 1;
                pencil.lower(line, sampled.line(self.l, first, line));
            }
            let end = pencil.close(&mut scratch.ledger);
            stamp.finish(place, bony, end);
        }
    }

    /// Lists the bricks of a layer that the tool reaches.
    #[inline(always)]
    fn bound_bricks(
        &self,
        stamp: &Stamp<'_>,
        scratch: &mut Scratch<L>,
        (chunk, layer, here): (usize, usize, u16),
        count: &mut usize,
    ) {
        let l = self.l;
        let bounds = &mut scratch.bounds;
        bounds.enter(l, &scratch.chunk, &self.bricks[layer], &self.brick);
        let full = l.le(bounds.high, l.splat(-self.band));
        let mut todo = l.le(bounds.low, l.splat(self.band)) & here;
        if todo == 0 {
            return;
        }
        let deciding = bounds.deciding(l, &scratch.chunk);
        let (bony, faces) = (stamp.bone.bony_lines(chunk), stamp.placed.count());
        while todo != 0 {
            let lane = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let brick = 16 * layer + lane;
            let live = bony[brick % 64] & !stamp.cut.emptied_lines(chunk, brick);
            // inside by more than the band no face matters
            let full = full >> lane & 1 == 1;
            scratch.tasks[*count % BRICKS_PER_CHUNK] = Task {
                brick: brick as u8,
                faces: if full {
                    0
                } else {
                    active(&deciding, faces, lane)
                },
                bony: bony[brick % 64],
                full: if full { live } else { 0 },
                near: live,
                deciding: [0; MAX_FLAT],
            };
            *count += 1;
        }
    }

    /// Sorts a brick's lines.
    #[inline(always)]
    fn bound_lines(&self, scratch: &mut Scratch<L>, task: Task, placed: &Placed) -> Task {
        let faces = task.faces;
        let face = faces.trailing_zeros() as usize % MAX_FLAT;
        if faces == 0 {
            return Task { near: 0, ..task };
        }
        let l = self.l;
        let o = self.offset(task.brick);
        let [low, high] = if single(faces) && placed.kind(face) == Kind::Ball {
            let field = OneBall::new(l, &scratch.chunk.faces[face], o);
            field.bounds(l, &self.lines, &self.line)
        } else {
            scratch.brick.enter(&scratch.chunk, o, faces);
            scratch
                .bounds
                .enter(l, &scratch.brick, &self.lines, &self.line);
            [scratch.bounds.low, scratch.bounds.high]
        };
        let full = l.le(high, l.splat(-self.band)) & task.near;
        let near = l.le(low, l.splat(self.band)) & task.near & !full;
        let mut task = Task { full, near, ..task };
        if single(faces) {
            task.deciding[face] = near;
        } else {
            let deciding = scratch.bounds.deciding(l, &scratch.brick);
            task.narrow(&deciding);
        }
        task
    }

    /// First voxel of a brick, from the chunk's middle.
    #[inline(always)]
    fn offset(&self, brick: u8) -> [f32; 3] {
        let corner = brick_origin(usize::from(brick));
        [
            self.spacing[0] * (corner[0] as f32 - 15.5),
            self.spacing[1] * (corner[1] as f32 - 15.5),
            self.spacing[2] * (corner[2] as f32 - 15.5),
        ]
    }

    /// Writes a brick's lines.
    #[inline(always)]
    fn write(&self, stamp: &mut Stamp<'_>, scratch: &mut Scratch<L>, chunk: usize, n: usize) {
        let l = self.l;
        let task = scratch.tasks[n % BRICKS_PER_CHUNK];
        let brick = usize::from(task.brick);
        let placed = stamp.placed;
        let place = (chunk, brick);
        let fields = (stamp.bone, &mut *stamp.cut);
        let mut pencil = Pencil::new(l, fields, place, self.window, &mut scratch.losses);
        pencil.fill(task.full);
        let faces = task.faces;
        let face = faces.trailing_zeros() as usize % MAX_FLAT;
        if task.near != 0 {
            let o = self.offset(task.brick);
            if single(faces) && placed.kind(face) == Kind::Ball {
                let mut field = OneBall::new(l, &scratch.chunk.faces[face], o);
                self.compute(&mut pencil, &mut field, task.near);
            } else {
                scratch.brick.enter(&scratch.chunk, o, faces);
                if single(faces) && placed.kind(face) == Kind::Cone {
                    let mut field = OneCone::new(l, &scratch.brick);
                    self.compute(&mut pencil, &mut field, task.near);
                } else {
                    let room = &mut scratch.room;
                    let mut field = Many::<L>::new(&scratch.brick, faces, &task.deciding, room);
                    self.compute(&mut pencil, &mut field, task.near);
                }
            }
        }
        let end = pencil.close(&mut scratch.ledger);
        stamp.finish(place, task.bony, end);
    }

    /// Lowers lines to the distances of `field`.
    #[inline(always)]
    fn compute(&self, pencil: &mut Pencil<'_, L>, field: &mut impl Field<L>, mut near: u16) {
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

#[inline(always)]
fn single(faces: u32) -> bool {
    faces & faces.wrapping_sub(1) == 0
}
