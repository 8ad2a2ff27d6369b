//! Bones and trajectories that the reports run on.

pub mod bones;
pub mod press;
pub mod thesis;
