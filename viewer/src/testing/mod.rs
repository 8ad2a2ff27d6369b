//! Synthetic bones, messages and a haptics process for tests.

pub(crate) mod bones;
pub(crate) mod messages;
pub(crate) mod server;
pub(crate) mod stage;

mod agreement_tests;
mod depth_tests;
pub(crate) mod link_tests;
mod mirror_tests;
mod picture_tests;
mod ui_tests;
