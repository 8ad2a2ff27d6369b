//! Recovery from a full ring: which bricks the publisher has missed, copied a few parts a tick.
//!
//! The cut is a minimum, so copies and carved records may mix in any order: the mirror takes the
//! smaller value of both.
#![expect(
    clippy::cast_possible_truncation,
    reason = "a bone has fewer than 2^32 chunks, a chunk 64 bricks"
)]

use super::record::{BrickCopy, COPY_VALUES, Record};
use super::servo_loop::begun;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::broad::{Obb, chunk_range};
use osteon_sim_core::carve::CarveStep;
use osteon_sim_core::cut::MAX_CHECKPOINTS;
use osteon_sim_core::servo::{CutEvent, Servo, TickOutput};
use osteon_sim_core::tool::Tool;
use rtrb::Producer;

/// Brick parts copied in one tick at most: two bricks.
const PARTS_PER_TICK: usize = 16;
/// Copies leave this many records of the ring to ticks and carved steps.
const RESERVED: usize = 1024;

const _: () = assert!(MAX_CHECKPOINTS <= 8, "a bit each");

/// Bricks owed to the publisher.
#[derive(Debug)]
pub(crate) struct Resync {
    // one bit a brick, per chunk
    owed: Vec<u64>,
    tools: Vec<Tool>,
    behind: bool,
    owed_reset: bool,
    // checkpoints (one bit each, by number) that the mirror has as the servo has them
    told: u8,
    // steps carved to their end, from which on the owed bricks are whole
    whole_from: u64,
    next_part: u8,
    cursor: usize,
    overflows: u64,
}

impl Resync {
    /// Room for every brick of the bone.
    pub(crate) fn new(bone: &Bone, tools: Vec<Tool>) -> Self {
        Self {
            owed: vec![0; bone.chunk_count()],
            tools,
            behind: false,
            owed_reset: false,
            told: 0,
            whole_from: 0,
            next_part: 0,
            cursor: 0,
            overflows: 0,
        }
    }

    /// Records that found the ring full.
    pub(crate) fn overflows(&self) -> u64 {
        self.overflows
    }

    /// True while bricks are owed.
    pub(crate) fn is_behind(&self) -> bool {
        self.behind
    }

    /// True while a reset is owed: nothing that was carved after it may be sent before it.
    pub(crate) fn owes_reset(&self) -> bool {
        self.owed_reset
    }

    pub(crate) fn count_lost_tick(&mut self) {
        self.overflows += 1;
    }

    /// Tells the publisher what became of the cut as a whole.
    ///
    /// The mirror goes back to a checkpoint by itself if it had the whole cut when that was made,
    /// whatever was lost since. Else it begins anew, and all that is cut is copied.
    pub(crate) fn follow(
        &mut self,
        event: CutEvent,
        servo: &Servo,
        records: &mut Producer<Record>,
    ) {
        match event {
            CutEvent::Reset { epoch } => {
                self.begin_anew(epoch, records);
            }
            CutEvent::Checkpoint { id } => {
                let bit = 1 << (id as usize % MAX_CHECKPOINTS);
                self.told &= !bit;
                if self.behind {
                    return;
                }
                if records.push(Record::Checkpoint { id }).is_ok() {
                    self.told |= bit;
                } else {
                    self.overflows += 1;
                }
            }
            CutEvent::Undone { id, epoch } => {
                let told = self.told >> (id as usize % MAX_CHECKPOINTS) & 1 == 1;
                if told && records.push(Record::Undone { id, epoch }).is_ok() {
                    self.forget();
                    return;
                }
                self.begin_anew(epoch, records);
                for (chunk, owed) in self.owed.iter_mut().enumerate() {
                    *owed = servo.cut().touched(chunk);
                }
                self.behind = true;
            }
        }
    }

    fn begin_anew(&mut self, epoch: u32, records: &mut Producer<Record>) {
        self.forget();
        self.told = 0;
        if records.push(Record::Reset { epoch }).is_err() {
            self.owe_reset();
        }
    }

    /// Makes everything owed worthless.
    fn forget(&mut self) {
        self.owed.fill(0);
        self.behind = false;
        self.owed_reset = false;
        self.whole_from = 0;
        self.next_part = 0;
        self.cursor = 0;
    }

    /// The reset itself did not fit: it goes first, once there is room.
    fn owe_reset(&mut self) {
        self.overflows += 1;
        self.owed_reset = true;
        self.behind = true;
    }

    /// Marks all bricks that a step can have changed: those of the chunks in its box.
    pub(crate) fn mark(&mut self, servo: &Servo, step: &CarveStep) {
        self.overflows += 1;
        self.behind = true;
        let bone = servo.bone();
        let Some(tool) = self.tools.get(usize::from(step.tool)) else {
            return;
        };
        let margin = tool.shape.margin_mm(bone.grid());
        for pose in [&step.before, &step.after] {
            let (lo, hi) = Obb::of_tool(&tool.shape.bounds(), pose, margin).aabb();
            let range = chunk_range(bone, lo, hi);
            for z in range.lo[2]..range.hi[2] {
                for y in range.lo[1]..range.hi[1] {
                    for x in range.lo[0]..range.hi[0] {
                        if let Some(chunk) = bone.chunk_at([x, y, z]) {
                            self.owed[chunk] |= bone.bony_bricks(chunk);
                        }
                    }
                }
            }
        }
        // a copy that is taken before the servo has carved the step to its end would miss the rest
        self.whole_from = begun(servo);
        // a part of the brick under way may have changed since: begin that brick anew
        self.next_part = 0;
    }

    /// Copies at most [`PARTS_PER_TICK`] parts of owed bricks into the ring; none while a step whose
    /// record was lost is pending or an undo is under way. (A pending step that was told is no matter: the mirror carves it. Else
    /// a tool that cuts more than the budget all the time would never be caught up with.)
    pub(crate) fn copy_some(
        &mut self,
        servo: &Servo,
        output: &TickOutput,
        records: &mut Producer<Record>,
    ) {
        if !self.behind {
            return;
        }
        if self.owed_reset {
            let reset = Record::Reset {
                epoch: output.epoch,
            };
            if records.slots() <= RESERVED || records.push(reset).is_err() {
                return;
            }
            self.owed_reset = false;
        }
        if servo.cut().revision() < self.whole_from || servo.cut().is_undoing() {
            return;
        }
        for _ in 0..PARTS_PER_TICK {
            if records.slots() <= RESERVED || !self.copy_part(servo, output.tool, records) {
                break;
            }
        }
        self.behind = self.owed.iter().any(|&bricks| bricks != 0);
    }

    /// One part of the next owed brick; false where nothing is owed.
    fn copy_part(&mut self, servo: &Servo, tool: u8, records: &mut Producer<Record>) -> bool {
        while self.cursor < self.owed.len() && self.owed[self.cursor] == 0 {
            self.cursor += 1;
        }
        if self.cursor == self.owed.len() {
            self.cursor = 0;
            return self.owed.iter().any(|&bricks| bricks != 0);
        }
        let chunk = self.cursor;
        let brick = self.owed[chunk].trailing_zeros() as usize;
        let from = usize::from(self.next_part) * COPY_VALUES;
        if let Some(values) = servo.cut().brick(chunk, brick) {
            let mut copy = BrickCopy {
                chunk: chunk as u32,
                brick: brick as u8,
                part: self.next_part,
                tool,
                values: [0; COPY_VALUES],
            };
            copy.values
                .copy_from_slice(&values[from..from + COPY_VALUES]);
            if records.push(Record::Brick(copy)).is_err() {
                return false;
            }
            self.next_part += 1;
        } else {
            self.next_part = 8;
        }
        if self.next_part == 8 {
            self.next_part = 0;
            self.owed[chunk] &= !(1 << brick);
        }
        true
    }
}
