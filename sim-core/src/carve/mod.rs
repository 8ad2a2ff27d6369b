//! Carving: `cut = min(cut, signed distance to the tool)` along a step of the tool, with the exact
//! removed volume by tissue class, structure and tool.
//!
//! Chunks → 8³ bricks → 4×4×2 lines, 16 boxes tested at a time; boxes farther than the band outside
//! the tool are skipped, those deeper than the band inside are filled, and only lines in between are
//! computed, 32 voxels at a time. So the cost follows the swept surface.
//!
//! **A stored value** is a function of the tool's pose, the brick and the voxel alone: neither the
//! vector unit, nor the order of work, nor what was skipped changes a bit of it (`placed.rs` has the
//! formula). So servo, publisher and replay hold the same cut.

mod batch;
mod bounds;
mod flats;
mod ledger;
mod many;
mod node;
mod patterns;
mod pencil;
mod placed;
mod plan;
mod sampled;
mod since;
mod stamp;
mod write;

use crate::bone::Bone;
use crate::broad::{ChunkRange, Obb, chunk_range};
use crate::cut::{Cut, MAX_TOOLS};
pub use crate::lanes::Isa;
use crate::pose::Pose;
use crate::tool::{Shape, Tool};
pub(crate) use placed::Placed;
pub(crate) use plan::Plans;
use plan::Standing;
use sampled::Sampled;
use since::Since;
use stamp::Stamp;

/// Most poses at which one step is stamped.
pub const MAX_STAMPS: u32 = 16;
/// Height of the ridges that two stamps may leave between them on a face, mm.
pub const SCALLOP_MM: f64 = 1e-3;
/// Longest way between two stamps in smallest spacings: an edge leaves notches of that order along
/// its line.
const EDGE_STRIDE: f64 = 0.5;

/// One step of a tool through the bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarveStep {
    /// Index of the tool.
    pub tool: u8,
    /// `bone_from_tool` at the beginning.
    pub before: Pose,
    /// `bone_from_tool` at the end.
    pub after: Pose,
}

/// How much of a step has been carved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    // whole stamps, and chunks of the next one
    stamps: u32,
    chunks: usize,
}

/// Parts of the model that can be left out, to see what they cost and what they are worth. The product
/// leaves out none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// Sub-voxel offsets that undo the bias of reading a curved distance field linearly.
    pub curvature: bool,
    /// Volume by class, label and tool.
    pub account: bool,
    /// Stamps between the ends of a step.
    pub sweep: bool,
}

impl Model {
    /// All of it.
    pub const FULL: Self = Self {
        curvature: true,
        account: true,
        sweep: true,
    };
}

/// How a carving is to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Carving {
    /// Vector unit; the bits do not depend on it.
    pub isa: Isa,
    /// The model.
    pub model: Model,
}

impl Carving {
    /// The full model on the widest unit that there is.
    pub fn best() -> Self {
        Self {
            isa: Isa::best(),
            model: Model::FULL,
        }
    }

    /// Number of poses at which a step is stamped, the last being its end. Between two of them no point
    /// of the tool moves more than √(8 R [`SCALLOP_MM`]), R = the smallest radius of its faces (ridges
    /// of s²/8R, physics of a ball-nosed cutter), nor more than half the smallest spacing. At most
    /// [`MAX_STAMPS`].
    pub fn stamps(self, bone: &Bone, tool: &Tool, step: &CarveStep) -> u32 {
        if !self.model.sweep {
            return 1;
        }
        let reach = {
            let b = tool.shape.bounds();
            b.lo.abs().max(b.hi.abs()).length()
        };
        // |2 sin(θ/2)| of the turn between the two rotations
        let turn = 2.0
            * (step.before.rotation.conjugate() * step.after.rotation)
                .xyz()
                .length();
        let moved = (step.after.translation - step.before.translation).length() + reach * turn;
        let radius = f64::from(tool.shape.smallest_radius_mm());
        let smooth = (8.0 * radius * SCALLOP_MM).sqrt();
        let stride = smooth.min(EDGE_STRIDE * bone.grid().spacing_mm.min_element());
        let count = (moved / stride).ceil();
        if count >= f64::from(MAX_STAMPS) {
            MAX_STAMPS
        } else {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "below MAX_STAMPS; a NaN becomes 0"
            )]
            let count = (count as u32).max(1);
            count
        }
    }

    /// Carves one step and calls `changed(chunk, brick)` for each brick whose values changed (a brick
    /// may come more than once).
    ///
    /// Work is bounded by [`MAX_STAMPS`] × the bricks in the tool's box. A pose that is not finite, or
    /// a tool index beyond [`MAX_TOOLS`], carves nothing.
    pub fn carve(
        self,
        bone: &Bone,
        cut: &mut Cut,
        tool: &Tool,
        step: &CarveStep,
        changed: &mut dyn FnMut(usize, usize),
    ) {
        let mut progress = Progress::default();
        let mut budget = i64::MAX;
        let mut work = Work { bone, cut, changed };
        self.carve_some(&mut work, tool, step, (&mut progress, &mut budget));
    }

    /// Carves a part of a step: goes on from `progress` until `budget` units of work are spent, and
    /// lowers `budget` by what was spent. True where the step is done (it then counts as one revision
    /// of the cut). One unit is one line written (ten where the tool is sampled on a grid), one brick, layer
    /// of bricks or chunk coordinate looked at; a pose costs 16 more,
    /// a brick that a checkpoint has saved 8. A chunk is always finished, so the budget is overdrawn by
    /// 1,177 at most (ten times that for a sampled tool), and by 512 for what is saved. Any partition of a step
    /// gives the same cut.
    pub fn carve_some(
        self,
        work: &mut Work<'_>,
        tool: &Tool,
        step: &CarveStep,
        (progress, budget): (&mut Progress, &mut i64),
    ) -> bool {
        let sound = step.before.is_valid() && step.after.is_valid();
        if !sound || usize::from(step.tool) >= MAX_TOOLS {
            work.cut.bump_revision();
            return true;
        }
        let count = self.stamps(work.bone, tool, step);
        while progress.stamps < count {
            if *budget <= 0 {
                return false;
            }
            let n = progress.stamps + 1;
            let pose = if n == count {
                step.after
            } else {
                step.before
                    .interpolate(&step.after, f64::from(n) / f64::from(count))
            };
            if !self.stamp(work, (tool, step.tool), &pose, (progress, budget)) {
                return false;
            }
            progress.chunks = 0;
            progress.stamps = n;
        }
        work.cut.bump_revision();
        true
    }

    fn stamp(
        self,
        work: &mut Work<'_>,
        (tool, tool_index): (&Tool, u8),
        bone_from_tool: &Pose,
        (progress, budget): (&mut Progress, &mut i64),
    ) -> bool {
        let grid = work.bone.grid();
        let margin = tool.shape.margin_mm(grid);
        let (lo, hi) = Obb::of_tool(&tool.shape.bounds(), bone_from_tool, margin).aabb();
        let range = chunk_range(work.bone, lo, hi);
        let (solid, sampled) = match &tool.shape {
            Shape::Revolved(solid) => (Some(solid), None),
            Shape::Grid(samples) => (None, Some(Sampled::new(grid, samples, bone_from_tool))),
        };
        let placed = Placed::new(grid, solid, bone_from_tool, self.model.curvature);
        let last = work.cut.last_stamp();
        if solid.is_some() && last == Some(placed) {
            return true;
        }
        let corners = {
            let units = 1.0 / f64::from(grid.quantum_mm());
            (lo * units, hi * units)
        };
        let since = last
            .as_ref()
            .and_then(|last| Since::new(last, &placed, corners));
        let standing = since.as_ref().and_then(|since| {
            let apex = placed.apex();
            let far = (corners.0 - apex).abs().max((corners.1 - apex).abs());
            Standing::new(&placed, far.length(), f64::from(since.moved()))
        });
        if standing.is_some() {
            work.cut.plans.are_of(&placed);
        }
        let mut stamp = Stamp {
            standing,
            bone: work.bone,
            cut: &mut *work.cut,
            changed: &mut *work.changed,
            placed: &placed,
            since,
            sampled,
            tool: tool_index,
            account: self.model.account,
            budget,
        };
        let total = chunks_of(&range);
        while progress.chunks < total && *stamp.budget > 0 {
            progress.chunks = stamp.run(self.isa, &range, progress.chunks);
        }
        if progress.chunks < total {
            return false;
        }
        if solid.is_some() {
            work.cut.set_last_stamp(&placed);
        }
        true
    }
}

/// What is carved, and who hears of it.
#[expect(missing_debug_implementations, reason = "holds a callback")]
pub struct Work<'a> {
    /// The bone.
    pub bone: &'a Bone,
    /// Its cut.
    pub cut: &'a mut Cut,
    /// Called with (chunk, brick) for each brick whose values changed.
    pub changed: &'a mut dyn FnMut(usize, usize),
}

fn chunks_of(range: &ChunkRange) -> usize {
    (0..3).map(|a| range.hi[a] - range.lo[a]).product()
}

/// [`Carving::carve`] with the full model on the widest vector unit.
pub fn carve(
    bone: &Bone,
    cut: &mut Cut,
    tool: &Tool,
    step: &CarveStep,
    changed: &mut dyn FnMut(usize, usize),
) {
    Carving::best().carve(bone, cut, tool, step, changed);
}
