//! The force loop on a virtual clock: the real servo against a simulated device and hand, the hard cases
//! that it must pass, and the defects of other programs beside it.
//!
//! Base frame: z is the surface's outward normal, the origin lies on the surface. Millimetres, newtons,
//! seconds; energies in mJ (= N·mm).

pub mod ablation;
pub mod bench;
pub mod cases;
#[cfg(test)]
mod ct_density;
pub mod device;
pub mod feed;
pub mod force_table;
pub mod guided;
pub mod hand;
pub mod map;
pub mod peers;
pub mod plant;
pub mod press;
pub mod rate;
pub mod ripple;
pub mod setup;
pub mod side;
pub mod ticks;
pub mod tilt;
pub mod trace;
pub mod wall;

#[cfg(test)]
mod tests;

pub use bench::{Bench, Faults};
pub use cases::{CASES, Case};
pub use hand::Hand;
pub use plant::PlantSpec;
