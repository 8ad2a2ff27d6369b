//! Measurements of drawing, for reports and tests: no window, no link.

pub mod meshing;
