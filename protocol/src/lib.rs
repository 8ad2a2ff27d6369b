//! Every byte that crosses a border of Osteon.
//!
//! * [`device`]: the link between the haptics process and a device (or its simulation): COBS frames
//!   of at most 63 bytes with CRC-32C. `no_std`, no allocation: a microcontroller can use it.
//!   [`frame`] makes the bytes, [`firmware`] is the device's side as a state machine.
//! * [`hfab`]: the text lines of open Phantom-class controllers, likewise `no_std`.
//! * [`ipc`] (feature `std`): the messages between the haptics process and a viewer.
//!   [`ipc_frame`] makes the bytes, packs bone and cut, and checks every range on arrival.
//! * [`secure`] (feature `std`): the same messages over a network, authenticated and encrypted.
//! * [`session`] (feature `std`): what a session file holds for a replay.
//!
//! The bytes are written down in `WIRE.md` and proven by golden tests. Decoders are total: no input
//! makes them panic, and each length is bounded before it is used.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]

#[cfg(feature = "std")]
mod bytes;
pub mod crc32c;
pub mod device;
pub mod firmware;
mod fixed;
pub mod frame;
pub mod hfab;
#[cfg(feature = "std")]
pub mod ipc;
#[cfg(feature = "std")]
pub mod ipc_frame;
#[cfg(feature = "std")]
mod ipc_join;
#[cfg(feature = "std")]
mod ipc_pack;
#[cfg(feature = "std")]
mod ipc_valid;
pub mod omni_raw;
#[cfg(feature = "std")]
pub mod secure;
#[cfg(feature = "std")]
pub mod session;
