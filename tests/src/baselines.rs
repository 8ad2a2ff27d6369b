//! Rival methods of material removal, for measuring only: the product never runs them.
//!
//! All of them are binary: a voxel is removed or it is not. Each says what its authors describe
//! ([`Baseline::theirs`]) and what had to be filled in ([`Baseline::inferred`]); none of their code
//! was at hand.

mod brute;
mod dense;
mod errors;
mod octree;
mod place;
mod reza;
pub mod simd;
mod thesis;
mod voxel_tool;
mod yau;
mod zheng;

#[cfg(test)]
mod tests;

pub use brute::Brute;
pub use errors::{Errors, SurfaceError, Truth, surface_error};
pub use octree::Octree;
pub use place::THRESHOLD_HU;
pub use reza::Reza;
pub use simd::Isa;
pub use thesis::Thesis;
pub use thesis::gpu::ThesisOnAdapter;
pub use voxel_tool::{Distance, THESIS_VOXEL_MM, VoxelTool};
pub use yau::Yau;
pub use zheng::Zheng;

use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;

/// A method that removes whole voxels of a bone where a tool is.
pub trait Baseline: Sync {
    /// Short name for tables.
    fn name(&self) -> &'static str;

    /// What its authors describe.
    fn theirs(&self) -> &'static str;

    /// What was inferred here because their text does not say it, or differs from it.
    fn inferred(&self) -> &'static str;

    /// One whole collision event with the tool at a pose: box test, overlap box, all that follows.
    /// Returns the voxels removed. Allocates nothing; an invalid pose removes nothing.
    fn event(&mut self, bone_from_tool: &Pose) -> u64;

    /// Back to the bone's first state. Work in proportion to what the events have touched.
    fn restore(&mut self);

    /// Whether a voxel of the bone was removed; false where none was, and outside the lattice.
    fn is_removed(&self, voxel: [usize; 3]) -> bool;

    /// Memory that the method holds for bone and tool, bytes: what its events read and write, not
    /// the bone that it was made of.
    fn bytes(&self) -> usize;
}

/// Every rival, in the order of the table: `thesis-16`, `thesis-32`, `thesis-64`, `thesis-32-simd`,
/// `reza`, `zheng`, `yau`, `octree`.
pub fn all<'a>(bone: &'a Bone, tool: &'a VoxelTool) -> Vec<Box<dyn Baseline + 'a>> {
    vec![
        Box::new(Thesis::chunks_of_16(bone, tool)),
        Box::new(Thesis::chunks_of_32(bone, tool)),
        Box::new(Thesis::chunks_of_64(bone, tool)),
        Box::new(Thesis::simd(bone, tool)),
        Box::new(Reza::surface(bone, tool)),
        Box::new(Zheng::new(bone, tool)),
        Box::new(Yau::new(bone, tool)),
        Box::new(Octree::new(bone, tool)),
    ]
}
