//! What reports measure: intrinsic time, the error of a cut surface, the exact volume.

pub mod intrinsic;
pub mod surface;
pub mod swept;
pub mod volume;
