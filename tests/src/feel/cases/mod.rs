//! The hard cases, each a function that measures and judges.
//!
//! A case's criterion is never weaker than what was asked for. Where what was asked for cannot be meant
//! so, the case says why and what it judges instead.

mod buzz;
pub mod carving;
pub(super) mod cutting;
pub mod gaps;
pub mod heat;
pub mod impact;
pub mod meshes;
pub mod numbers;
mod odd;
mod plates;
pub mod press;
pub mod sizes;
pub(super) mod sliding;
mod start;
pub mod viewers;
mod wedge;
pub mod wire;

use serde::Serialize;

/// What a hard case asked for and what was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// 1 to 42.
    pub id: u8,
    /// In a few words.
    pub name: &'static str,
    /// What is asked for.
    pub criterion: String,
    /// What was measured, with units.
    pub measured: String,
    /// Whether all of it holds.
    pub pass: bool,
}

/// Measures a case.
pub type Measure = fn() -> Case;

/// Every case with its number, in order.
pub const CASES: &[(u8, Measure)] = &[
    (1, press::still),
    (2, press::bad_device),
    (3, press::onset),
    (4, impact::taps),
    (5, impact::saturated),
    (6, plates::plates),
    (7, sliding::edges),
    (8, sliding::oblique),
    (9, sliding::chunk_borders),
    (10, sliding::grazing),
    (11, start::appears_inside),
    (12, start::spindle_on_at_rest),
    (13, start::spindle_off_in_mid_cut),
    (14, gaps::dropped_frames),
    (15, gaps::jitter),
    (16, gaps::glitch),
    (17, wire::no_numbers),
    (18, wire::same_pose),
    (19, numbers::denormals),
    (20, cutting::layers),
    (21, cutting::stall),
    (22, cutting::feed),
    (23, cutting::spindle_speeds),
    (24, cutting::explicit_limit),
    (25, wedge::pegs),
    (26, wedge::narrow_walls),
    (27, carving::borders),
    (28, carving::larger_tool),
    (29, carving::ties),
    (30, carving::anisotropic),
    (31, carving::again),
    (32, meshes::degenerate),
    (33, numbers::far_coordinates),
    (34, numbers::long_session),
    (35, numbers::saturation),
    (36, sizes::scales),
    (37, viewers::stalled),
    (38, sizes::leap),
    (39, wire::time_back),
    (40, numbers::degenerate_volumes),
    (41, heat::minute_at_the_limit),
    (42, buzz::vibration),
];

/// The case with a number, measured now; `None` where there is none.
pub fn case(id: u8) -> Option<Case> {
    let (_, measure) = CASES.iter().find(|(n, _)| *n == id)?;
    Some(measure())
}

/// The worst of several figures and where it was.
#[derive(Debug, Clone, Default)]
pub(super) struct Worst {
    pub(super) value: f64,
    place: String,
}

impl Worst {
    /// Notes a figure; `place` is only made where it is the worst so far.
    fn note(&mut self, value: f64, place: impl Fn() -> String) {
        if value.is_nan() || value > self.value || self.place.is_empty() {
            self.value = value;
            self.place = place();
        }
    }

    /// "1.23 mm (where)".
    pub(super) fn words(&self, unit: &str) -> String {
        let value = crate::report::table::short(Some(self.value));
        format!("{value} {unit} ({})", self.place)
    }
}
