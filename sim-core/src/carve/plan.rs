//! What there is to do in a chunk: bricks and lines sorted by bounds, and kept while the tool moves little.
//!
//! A press moves the tool by a few hundredths of a voxel a step, and what a chunk's bounds say then stays
//! the same. So they are made for all poses at which no point of the tool has moved farther than a margin
//! from where it was: a distance changes by no more than that, so every bound is moved outward by the
//! margin once, and stands until the tool has used it up. Chunks get different margins, so that they are
//! not all bounded anew in the same step. A plan lists too many lines rather than too few; what is stored
//! is computed at each pose, so that no bit depends on it.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "a layer's bricks are 16 bits; lengths become f32; lanes must melt into the job"
)]

use super::batch::Sets;
use super::bounds::{Deciding, active};
use super::placed::{MAX_FLAT, Placed};
use super::stamp::{Kernel, Scratch, Stamp, single};
use crate::grid::BRICKS_PER_CHUNK;
use crate::lanes::Lanes;
use glam::DVec3;

/// Chunks whose plans are kept.
const KEPT: usize = 128;
/// No plan.
const NONE: u16 = u16::MAX;
/// Longest way of the tool in a step for which plans are kept, voxels.
const SLOW: f64 = 0.12;
/// Widest margin, voxels.
const WIDEST: f64 = 0.3;
/// Steps that a margin lasts: at least, and how many more in some chunks.
const STEPS: (usize, usize) = (6, 8);

/// What is to be done in a brick: masks of its lines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Task {
    /// One bit a face that can decide.
    pub(super) faces: u16,
    /// Lines to be filled, and lines to be computed.
    pub(super) full: u16,
    pub(super) near: u16,
    /// Lines so far outside that no volume can change, and so far inside that none is left once the tool has
    /// been where it was a step ago.
    pub(super) outer: u16,
    pub(super) inner: u16,
}

impl Task {
    const NONE: Self = Self {
        faces: 0,
        full: 0,
        near: 0,
        outer: 0,
        inner: 0,
    };
}

/// What is to be done in a chunk.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    /// Bricks with something to do; those with lines to be filled; those with lines to be computed, by faces.
    pub(super) bricks: u64,
    pub(super) full: u64,
    pub(super) near: Sets,
    /// By brick; meaningless where there is nothing to do.
    pub(super) tasks: [Task; BRICKS_PER_CHUNK],
    /// By layer of bricks: where a face could decide, at any pose for which the plan stands.
    pub(super) deciding: [Deciding; 4],
    // where the tool was, and how far a point of it may be from there, units; negative: not made
    apex: DVec3,
    axis: DVec3,
    margin: f64,
    chunk: usize,
}

impl Plan {
    /// Not made.
    pub(super) const EMPTY: Self = Self {
        bricks: 0,
        full: 0,
        near: Sets::EMPTY,
        tasks: [Task::NONE; BRICKS_PER_CHUNK],
        deciding: [[0; MAX_FLAT]; 4],
        apex: DVec3::ZERO,
        axis: DVec3::ZERO,
        margin: -1.0,
        chunk: usize::MAX,
    };

    /// Begins it at a pose.
    fn begin(&mut self, placed: &Placed) {
        self.apex = placed.apex();
        self.axis = placed.axis();
        self.bricks = 0;
        self.full = 0;
        self.near = Sets::EMPTY;
    }

    /// Whether it stands at a pose, no point being farther than `far` from the apex, units.
    fn stands(&self, placed: &Placed, far: f64) -> bool {
        let turned = (placed.axis() - self.axis).length();
        (placed.apex() - self.apex).length() + turned * far <= self.margin
    }
}

/// The plans that are kept: of one tool, for one state of the cut's values or any lower one.
#[derive(Debug, Clone)]
pub(crate) struct Plans {
    tool: Option<Placed>,
    of_chunk: Vec<u16>,
    plans: Vec<Plan>,
    next: usize,
}

impl Plans {
    /// Room for plans of a bone of `chunks` chunks.
    pub(crate) fn new(chunks: usize) -> Self {
        Self {
            tool: None,
            of_chunk: vec![NONE; chunks],
            plans: vec![Plan::EMPTY; KEPT.min(chunks)],
            next: 0,
        }
    }

    /// Nothing, without memory: stands in while the plans are in use.
    pub(super) const fn absent() -> Self {
        Self {
            tool: None,
            of_chunk: Vec::new(),
            plans: Vec::new(),
            next: 0,
        }
    }

    /// Forgets all plans. Constant work for each of the chunks that are kept.
    pub(crate) fn clear(&mut self) {
        self.tool = None;
        for plan in &mut self.plans {
            plan.margin = -1.0;
        }
    }

    /// Forgets the plan of a chunk: values of it may have risen.
    pub(crate) fn forget(&mut self, chunk: usize) {
        let slot = self.of_chunk.get(chunk).copied().unwrap_or(NONE);
        if let Some(plan) = self.plans.get_mut(usize::from(slot)) {
            plan.margin = -1.0;
        }
    }

    /// Forgets the plans of any other tool.
    pub(super) fn are_of(&mut self, placed: &Placed) {
        let same = self.tool.is_some_and(|tool| placed.is_the_tool_of(&tool));
        if !same {
            self.clear();
            self.tool = Some(*placed);
        }
    }

    /// A chunk's plan, made or not. Another chunk may have to give up its own.
    fn of(&mut self, chunk: usize) -> Option<&mut Plan> {
        let mut slot = usize::from(*self.of_chunk.get(chunk)?);
        if slot >= self.plans.len() {
            slot = self.next;
            self.next = (self.next + 1) % self.plans.len();
            if let Some(other) = self.of_chunk.get_mut(self.plans[slot].chunk) {
                *other = NONE;
            }
            self.of_chunk[chunk] = slot as u16;
            self.plans[slot].chunk = chunk;
            self.plans[slot].margin = -1.0;
        }
        self.plans.get_mut(slot)
    }
}

/// How plans are kept at a pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Standing {
    // farthest point of the tool's box from its apex, how far the tool has moved since the last stamp, and the
    // widest margin, units
    far: f64,
    moved: f64,
    widest: f64,
}

impl Standing {
    /// For a tool none of whose points is farther than `far` from the apex and has moved farther than `moved`
    /// since the last stamp, units. `None` where it moves too fast for plans to stand.
    pub(super) fn new(placed: &Placed, far: f64, moved: f64) -> Option<Self> {
        let voxel = placed.spacing.min_element();
        (moved <= SLOW * voxel).then(|| Self {
            far: far + voxel,
            moved: SLOW * voxel,
            widest: (WIDEST * voxel).min(moved * (STEPS.0 + STEPS.1) as f64),
        })
    }

    /// How far the tool may have moved since the last stamp, units.
    pub(super) fn moved(&self) -> f32 {
        self.moved as f32
    }

    /// A chunk's margin: different in neighbouring chunks.
    fn margin(&self, chunk: usize) -> f64 {
        let share = (STEPS.0 + chunk.wrapping_mul(5) % STEPS.1) as f64;
        self.widest * share / (STEPS.0 + STEPS.1) as f64
    }
}

/// A chunk, and its first voxel's number.
pub(super) type Place = (usize, [usize; 3]);

impl<L: Lanes> Kernel<L> {
    /// Does what there is to do in a chunk, by the plan that is kept for it or else by one of its own.
    #[inline(always)]
    pub(super) fn chunk(
        &self,
        stamp: &mut Stamp<'_>,
        scratch: &mut Scratch<L>,
        (plans, own): (&mut Plans, &mut Plan),
        (chunk, first): Place,
    ) {
        let live = stamp.bone.bony_bricks(chunk) & !stamp.cut.emptied(chunk);
        if live == 0 {
            return;
        }
        let middle = stamp.placed.apex_to(first) + self.chunk_middle;
        let kept = stamp.standing.and_then(|how| Some((how, plans.of(chunk)?)));
        let keeps = kept.is_some();
        let (plan, stands) = if let Some((how, plan)) = kept {
            let stands = plan.stands(stamp.placed, how.far);
            if !stands {
                plan.margin = how.margin(chunk);
            }
            (plan, stands)
        } else {
            own.margin = 0.0;
            (own, false)
        };
        if stands && plan.bricks & live == 0 {
            return;
        }
        let reach = f64::from(self.band) + plan.margin;
        if !stands && stamp.placed.distance(middle) - self.chunk_radius >= reach {
            plan.begin(stamp.placed);
            return;
        }
        stamp.placed.enter(&mut scratch.chunk, middle);
        if let Some(since) = &stamp.since {
            since.enter(&mut scratch.last, first, self.chunk_middle);
        }
        if !stands {
            plan.begin(stamp.placed);
            self.make(stamp, scratch, plan, (chunk, live));
        }
        let mut todo = plan.bricks & live;
        if keeps {
            todo = self.nearer(stamp, scratch, plan, todo);
        }
        self.follow(stamp, scratch, plan, (chunk, todo));
    }

    /// Of the bricks in `todo`, those where the tool may have come nearer since the last stamp.
    #[inline(always)]
    fn nearer(&self, stamp: &mut Stamp<'_>, scratch: &Scratch<L>, plan: &Plan, todo: u64) -> u64 {
        let Some(since) = &stamp.since else {
            return todo;
        };
        let mut left = 0;
        for layer in 0..4 {
            let here = (todo >> (16 * layer)) as u16;
            if here != 0 {
                *stamp.budget -= 1;
                let nodes = (&scratch.chunk, &scratch.last);
                let boxes = (&self.bricks[layer], &self.brick, &plan.deciding[layer]);
                left |= u64::from(since.nearer(self.l, nodes, boxes, here)) << (16 * layer);
            }
        }
        left
    }

    /// Fills in a plan for its margin. A plan that is not kept leaves out what the last stamp has done.
    #[inline(always)]
    fn make(
        &self,
        stamp: &mut Stamp<'_>,
        scratch: &mut Scratch<L>,
        plan: &mut Plan,
        (chunk, live): (usize, u64),
    ) {
        let mut seen = Sets::EMPTY;
        for layer in 0..4 {
            let here = (live >> (16 * layer)) as u16;
            if here != 0 {
                *stamp.budget -= 1;
                self.bound_bricks(stamp, scratch, (plan, &mut seen), (chunk, layer, here));
            }
        }
        for set in 0..seen.len() {
            let (_, mut members) = seen.get(set);
            while members != 0 {
                let brick = members.trailing_zeros() as usize % BRICKS_PER_CHUNK;
                members &= members - 1;
                *stamp.budget -= 1;
                self.bound_lines(stamp, scratch, plan, brick);
            }
        }
    }

    /// How far a plan's bounds are moved outward: by its margin, and what rounding may add at another pose.
    #[inline(always)]
    fn outward(plan: &Plan, stamp: &Stamp<'_>) -> f32 {
        if plan.margin > 0.0 {
            plan.margin as f32 + 2.0 * stamp.placed.slack
        } else {
            0.0
        }
    }

    /// Lists the bricks of a layer that the tool reaches, with their lines that can hold bone.
    #[inline(always)]
    fn bound_bricks(
        &self,
        stamp: &Stamp<'_>,
        scratch: &mut Scratch<L>,
        (plan, seen): (&mut Plan, &mut Sets),
        (chunk, layer, here): (usize, usize, u16),
    ) {
        let l = self.l;
        let outward = Self::outward(plan, stamp);
        let bounds = &mut scratch.bounds;
        bounds.enter(l, &scratch.chunk, &self.bricks[layer], &self.brick);
        let full = l.le(bounds.high, l.splat(-self.band - outward));
        let mut todo = l.le(bounds.low, l.splat(self.band + outward)) & here;
        if todo == 0 {
            return;
        }
        if let Some(since) = &stamp.since {
            let moved = since.moved();
            if stamp.standing.is_some() {
                let room = l.splat(2.0 * (outward + moved.max(self.slow)));
                plan.deciding[layer] = bounds.deciding(l, &scratch.chunk, room);
            } else {
                let nodes = (&scratch.chunk, &scratch.last);
                let deciding = bounds.deciding(l, &scratch.chunk, l.splat(2.0 * moved));
                let boxes = (&self.bricks[layer], &self.brick, &deciding);
                todo = since.nearer(l, nodes, boxes, todo);
            }
        }
        let deciding = bounds.deciding(l, &scratch.chunk, l.splat(2.0 * outward));
        let (bony, faces) = (stamp.bone.bony_lines(chunk), stamp.placed.count());
        while todo != 0 {
            let lane = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let brick = (16 * layer + lane) % BRICKS_PER_CHUNK;
            let live = bony[brick] & !stamp.cut.emptied_lines(chunk, brick);
            // inside by more than the band no face matters
            let full = full >> lane & 1 == 1;
            let faces = if full {
                0
            } else {
                active(&deciding, faces, lane)
            };
            plan.tasks[brick] = Task {
                faces,
                full: if full { live } else { 0 },
                near: live,
                ..Task::NONE
            };
            seen.add(brick, faces);
        }
    }

    /// Sorts a brick's lines.
    #[inline(always)]
    fn bound_lines(
        &self,
        stamp: &Stamp<'_>,
        scratch: &mut Scratch<L>,
        plan: &mut Plan,
        brick: usize,
    ) {
        let l = self.l;
        let mut task = plan.tasks[brick];
        if task.faces == 0 {
            task.near = 0;
        } else {
            let outward = Self::outward(plan, stamp);
            let sides = &mut scratch.sides;
            let place = (&scratch.chunk, task.faces, self.offset(brick));
            sides.enter(l, place, &self.lines, &self.line);
            let window = f32::from(self.window);
            task.full = l.le(sides.high, l.splat(-self.band - outward)) & task.near;
            task.near &= l.le(sides.low, l.splat(self.band + outward)) & !task.full;
            task.outer = l.le(l.splat(window + outward), sides.low);
            task.inner = l.le(sides.high, l.splat(-window - outward - self.slow));
            if !single(task.faces) {
                let room = l.splat(2.0 * outward);
                task.faces = sides.deciding(l, &scratch.chunk, task.faces, (task.near, room));
            }
        }
        plan.tasks[brick] = task;
        plan.full |= u64::from(task.full != 0) << brick;
        plan.bricks |= u64::from(task.full | task.near != 0) << brick;
        if task.near != 0 {
            plan.near.add(brick, task.faces);
        }
    }
}
