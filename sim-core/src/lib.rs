//! The numbers of Osteon: bone, tools, contact and cutting, force, kinematics.
//!
//! Millimetres, newtons, seconds, radians; `f64` for poses and sums, `f32` inside a chunk or a
//! tool, integers for time and for removed volume. Transforms read `a_from_b`.
//!
//! **Invariants.** This crate reads no clock and opens nothing. What runs in the servo thread
//! ([`servo`]) allocates nothing, waits for nothing and has a stated bound on its work. The same
//! inputs give the same bits on every machine.
#![forbid(unsafe_code)]

mod aligned;
pub mod arm;
pub mod bone;
pub mod broad;
pub mod carry;
pub mod carve;
pub mod chain;
pub mod contact;
pub mod cut;
pub mod feel;
pub mod grid;
mod lanes;
pub mod merge;
pub mod metrics;
pub mod omni;
pub mod plan;
pub mod planning;
pub mod pose;
pub mod pots;
pub mod proxy;
pub mod register;
pub mod sample;
pub mod servo;
pub mod solid;
pub mod spindle;
pub mod tissue;
pub mod tool;
pub mod vibration;
