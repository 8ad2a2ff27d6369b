//! Bones and trajectories that the reports run on.

pub mod thesis;
