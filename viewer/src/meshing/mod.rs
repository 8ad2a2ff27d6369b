//! Meshes of one chunk at a time, on the CPU: faces of voxels, merged faces, surface nets.
//!
//! All of them begin with one bit a voxel ([`bits`]): set where the bone is solid and not cut. A
//! chunk's mesh depends on its own voxels and one more on either side (34³), so chunks are done one
//! by one and their meshes meet without a gap. Loops run with the processor's widest vectors
//! ([`unit`]).

pub(crate) mod bits;
pub(crate) mod faces;
pub(crate) mod greedy;
pub(crate) mod nets;
#[cfg(test)]
mod tests;
pub(crate) mod unit;
