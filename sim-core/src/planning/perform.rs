//! What a plan removes when it is carried out exactly: drill each peg's hole, then ream to the back.

use super::component::Component;
use crate::bone::Bone;
use crate::carve::{CarveStep, carve};
use crate::cut::Cut;
use crate::pose::Pose;
use crate::tool::revolved::Revolved;
use crate::tool::{STEEL, Tool};
use glam::{DQuat, DVec3};

/// Height over the back from which the tools come, mm.
const ABOVE_MM: f64 = 15.0;
/// Longest step, mm.
const STEP_MM: f64 = 0.5;

/// The drill of a peg, and how far its apex goes below the back's middle: its point is part of the length.
#[expect(clippy::cast_possible_truncation, reason = "a tool is sampled in f32")]
fn drill(diameter_mm: f64) -> Tool {
    let radius = 0.5 * diameter_mm as f32;
    Tool::revolved(
        ["Planned peg drill", "planned_drill"],
        Revolved::drill([radius, 59.0, 40.0]),
        (1000.0, 2),
        STEEL,
    )
}

/// The reamer of a component's back.
#[expect(clippy::cast_possible_truncation, reason = "a tool is sampled in f32")]
fn reamer(component: &Component) -> Tool {
    let (radius, back) = (
        0.5 * component.reamer_mm as f32,
        component.backside_radius_mm as f32,
    );
    Tool::revolved(
        ["Planned reamer", "planned_reamer"],
        Revolved::dome([radius, back, 12.0]),
        (1000.0, 6),
        STEEL,
    )
}

/// The cut of `component` seated at `bone_from_component`.
pub fn perform(bone: &Bone, component: &Component, bone_from_component: &Pose) -> Cut {
    let mut cut = Cut::new(bone);
    for peg in &component.pegs {
        let at = DVec3::new(peg.at_mm[0], peg.at_mm[1], 0.0);
        plunge(
            bone,
            &mut cut,
            (&drill(peg.diameter_mm), 0),
            (bone_from_component, at, peg.length_mm),
        );
    }
    plunge(
        bone,
        &mut cut,
        (&reamer(component), 1),
        (bone_from_component, DVec3::ZERO, 0.0),
    );
    cut
}

/// One tool straight down the component's z axis over `at`, its apex to `depth` below the back's middle.
fn plunge(
    bone: &Bone,
    cut: &mut Cut,
    (tool, index): (&Tool, u8),
    (bone_from_component, at, depth): (&Pose, DVec3, f64),
) {
    let pose = |z: f64| bone_from_component.then(&Pose::new(DQuat::IDENTITY, at + DVec3::Z * z));
    let steps = ((ABOVE_MM + depth) / STEP_MM).ceil();
    let mut before = pose(ABOVE_MM);
    let mut n = 1.0;
    while n <= steps {
        let after = pose(ABOVE_MM - (ABOVE_MM + depth) * n / steps);
        let step = CarveStep {
            tool: index,
            before,
            after,
        };
        carve(bone, cut, tool, &step, &mut |_, _| {});
        before = after;
        n += 1.0;
    }
}
