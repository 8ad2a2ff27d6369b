//! The hard cases.
use serde::Serialize;
/// c
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case { /// i
 pub id: u8 }
/// c
pub const CASES: &[(u8, fn() -> Case)] = &[];
