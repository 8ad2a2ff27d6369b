//! One face for every method of carving that a report compares.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the lattice before the cast; f64 becomes f32 as in every field"
)]

use crate::baselines::Baseline;
use crate::measure::intrinsic::Replay;
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, Carving, Isa, Model};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::{CHUNK_VOXELS, Grid};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::fields;
use osteon_sim_core::tool::{Shape, Tool};

/// A method on a bone with a tool.
pub trait Carver: Sync {
    /// Name in the report's rows.
    fn name(&self) -> &str;
    /// The instructions that it runs on.
    fn isa(&self) -> &str;
    /// One event, the tool moving from a pose to the next (`bone_from_tool`): everything that a tick
    /// would do for it, the account of removed volume included. True where something changed.
    fn event(&mut self, from: &Pose, to: &Pose) -> bool;
    /// Back to the uncut bone.
    fn reset(&mut self);
    /// Memory that the method holds for bone, cut and tool, bytes.
    fn bytes(&self) -> usize;
    /// Distance to what was cut at a point of the bone frame, mm, positive outside: as the method's own
    /// surface is defined. Only its sign matters to the report.
    fn cut_mm(&self, p: DVec3) -> f32;
    /// Whether the voxel's centre was removed.
    fn is_removed(&self, voxel: [usize; 3]) -> bool;
    /// Removed volume by the method's own account, mm³.
    fn removed_mm3(&self) -> f64;
    /// Ours, and not a rival: gets more time, and is what floors are about.
    fn ours(&self) -> bool {
        self.name().starts_with("osteon")
    }
}

/// The product's kernel.
#[derive(Debug)]
pub struct Kernel<'a> {
    name: String,
    bone: &'a Bone,
    tool: &'a Tool,
    cut: Cut,
    epoch: u32,
    carving: Carving,
}

impl<'a> Kernel<'a> {
    /// As the servo runs it.
    pub fn new(bone: &'a Bone, tool: &'a Tool) -> Self {
        Self::variant(bone, tool, "", Model::FULL)
    }

    /// On another vector unit: the same bits.
    pub fn on(bone: &'a Bone, tool: &'a Tool, isa: Isa) -> Self {
        let mut kernel = Self::variant(bone, tool, isa.name(), Model::FULL);
        kernel.carving.isa = isa;
        kernel
    }

    /// With another model; `suffix` tells it from the product's in the report's rows.
    pub fn variant(bone: &'a Bone, tool: &'a Tool, suffix: &str, model: Model) -> Self {
        let kind = match tool.shape {
            Shape::Revolved(_) => "osteon",
            Shape::Grid(_) => "osteon-sdf-grid",
        };
        Self {
            name: [kind, suffix]
                .map(str::to_owned)
                .join("-")
                .trim_end_matches('-')
                .to_owned(),
            bone,
            tool,
            cut: Cut::new(bone),
            epoch: 0,
            carving: Carving {
                isa: Isa::best(),
                model,
            },
        }
    }

    /// One stamp an event, at its end: without the sweep.
    pub fn stamping(bone: &'a Bone, tool: &'a Tool) -> Self {
        let model = Model {
            sweep: false,
            ..Model::FULL
        };
        Self::variant(bone, tool, "one-stamp", model)
    }
}

impl Carver for Kernel<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn isa(&self) -> &'static str {
        self.carving.isa.name()
    }

    fn event(&mut self, from: &Pose, to: &Pose) -> bool {
        let step = CarveStep {
            tool: 0,
            before: *from,
            after: *to,
        };
        let mut hit = false;
        let mut changed = |_: usize, _: usize| hit = true;
        self.carving
            .carve(self.bone, &mut self.cut, self.tool, &step, &mut changed);
        hit
    }

    fn reset(&mut self) {
        self.epoch += 1;
        self.cut.reset(self.epoch);
    }

    fn bytes(&self) -> usize {
        self.bone.chunk_count() * CHUNK_VOXELS * FIELDS.iter().map(|f| f.1).sum::<usize>()
    }

    fn cut_mm(&self, p: DVec3) -> f32 {
        fields(self.bone, &self.cut, p).cut
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        self.bone
            .locate(voxel)
            .is_some_and(|(chunk, at)| self.cut.value(chunk, at) < 0)
    }

    fn removed_mm3(&self) -> f64 {
        Cut::mm3(self.bone.grid(), self.cut.totals().units())
    }
}

/// The product's kernel, its cut read by whole voxels: what the sub-voxel field is worth. Its time is the
/// kernel's, which makes the field all the same.
#[derive(Debug)]
pub struct WholeVoxels<'a>(Kernel<'a>);

impl<'a> WholeVoxels<'a> {
    /// As [`Kernel::new`].
    pub fn new(bone: &'a Bone, tool: &'a Tool) -> Self {
        Self(Kernel {
            name: "osteon-whole-voxels".to_owned(),
            ..Kernel::new(bone, tool)
        })
    }
}

impl Carver for WholeVoxels<'_> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn isa(&self) -> &str {
        self.0.isa()
    }

    fn event(&mut self, from: &Pose, to: &Pose) -> bool {
        self.0.event(from, to)
    }

    fn reset(&mut self) {
        self.0.reset();
    }

    fn bytes(&self) -> usize {
        self.0.bytes()
    }

    fn cut_mm(&self, p: DVec3) -> f32 {
        let grid = self.0.bone.grid();
        signed_by_voxel(grid, self.0.is_removed(nearest_voxel(grid, p)))
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        self.0.is_removed(voxel)
    }

    fn removed_mm3(&self) -> f64 {
        let bone = self.0.bone;
        let gone = |chunk: usize| {
            let solid = bone.chunk(chunk).solid.iter().enumerate();
            solid
                .filter(|&(at, &d)| d > 0 && self.0.cut.value(chunk, at) < 0)
                .count()
        };
        let voxels: usize = (0..bone.chunk_count()).map(gone).sum();
        voxels as f64 * bone.grid().voxel_mm3()
    }
}

/// The voxel whose centre is nearest to a point of the bone frame, clamped to the lattice.
fn nearest_voxel(grid: &Grid, p: DVec3) -> [usize; 3] {
    let at = (p / grid.spacing_mm + 0.5).floor();
    let dims = DVec3::from_array(grid.dims.map(|n| n as f64 - 1.0));
    at.clamp(DVec3::ZERO, dims).to_array().map(|v| v as usize)
}

/// Half a voxel to either side: only the sign counts.
fn signed_by_voxel(grid: &Grid, removed: bool) -> f32 {
    let half = 0.5 * grid.spacing_mm.min_element() as f32;
    if removed { -half } else { half }
}

/// The fields of a voxel and their bytes: all of a bone's chunk, and the cut's pool.
pub const FIELDS: [(&str, usize); 5] = [
    ("density", 2),
    ("solid distance", 2),
    ("tissue class", 1),
    ("structure label", 1),
    ("cut distance", 2),
];

/// A rival as a [`Carver`]: its surface lies on the faces between voxels.
pub struct Rival<'a> {
    grid: Grid,
    method: Box<dyn Baseline + 'a>,
    isa: &'static str,
    removed: u64,
}

impl<'a> Rival<'a> {
    /// On the lattice of `bone`, on plain scalar code.
    pub fn new(bone: &Bone, method: Box<dyn Baseline + 'a>) -> Self {
        Self {
            grid: *bone.grid(),
            method,
            isa: "scalar",
            removed: 0,
        }
    }

    /// The same on other instructions.
    #[must_use]
    pub fn running_on(self, isa: &'static str) -> Self {
        Self { isa, ..self }
    }
}

impl std::fmt::Debug for Rival<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} on {}", self.method.name(), self.isa)
    }
}

impl Carver for Rival<'_> {
    fn name(&self) -> &str {
        self.method.name()
    }

    fn isa(&self) -> &str {
        self.isa
    }

    fn event(&mut self, _from: &Pose, to: &Pose) -> bool {
        let removed = self.method.event(to);
        self.removed += removed;
        removed > 0
    }

    fn reset(&mut self) {
        self.removed = 0;
        self.method.restore();
    }

    fn bytes(&self) -> usize {
        self.method.bytes()
    }

    fn cut_mm(&self, p: DVec3) -> f32 {
        let voxel = nearest_voxel(&self.grid, p);
        signed_by_voxel(&self.grid, self.method.is_removed(voxel))
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        self.method.is_removed(voxel)
    }

    fn removed_mm3(&self) -> f64 {
        self.removed as f64 * self.grid.voxel_mm3()
    }
}

/// A carver on its way along a trajectory.
pub struct Along<'a, 'b> {
    carver: &'a mut (dyn Carver + 'b),
    poses: &'a [Pose],
}

impl<'a, 'b> Along<'a, 'b> {
    /// From the first pose on.
    pub fn new(carver: &'a mut (dyn Carver + 'b), poses: &'a [Pose]) -> Self {
        Self { carver, poses }
    }
}

impl std::fmt::Debug for Along<'_, '_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} over {} poses", self.carver.name(), self.poses.len())
    }
}

impl Replay for Along<'_, '_> {
    fn reset(&mut self) {
        self.carver.reset();
    }

    fn event(&mut self, n: usize) -> bool {
        // an event that is left out is not carved: the others cost what they would cost
        self.carver.event(&self.poses[n], &self.poses[n + 1])
    }
}

#[cfg(test)]
mod tests;
