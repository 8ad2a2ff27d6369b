//! The surgical plan of a glenoid component: frames from landmarks, fits to the joint face, components.

pub mod component;
pub mod face;
pub mod fit;
pub mod perform;
pub mod scapula;
