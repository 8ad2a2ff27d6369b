//! Measurements of drawing, for reports and tests: no window, no link.

pub mod compare;
pub mod meshing;
pub mod reference;
pub mod stage;

pub use compare::{Difference, Surfaces};
pub use reference::Reference;
pub use stage::{Adapter, Frames, Stage};
