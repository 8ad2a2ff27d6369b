//! Questions about a planned axis.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a search of at most a few thousand steps"
)]

use crate::bone::Bone;
use crate::cut::Cut;
use crate::pose::Pose;
use crate::sample::fields;
use crate::tool::Tool;
use glam::{DQuat, DVec3};

/// Step of the search in [`first_touch_mm`], mm.
const STEP_MM: f64 = 0.05;

/// Height of the tool's apex over the plan's origin, mm along the plan's z, at which the tool first
/// touches the uncut bone when it comes down the plan's axis from `from_mm` (searched down to
/// −`from_mm`); `None` where it touches nothing.
pub fn first_touch_mm(
    bone: &Bone,
    tool: &Tool,
    bone_from_plan: &Pose,
    from_mm: f64,
) -> Option<f64> {
    let cut = Cut::new(bone);
    let steps = (2.0 * from_mm / STEP_MM) as u32;
    (0..steps)
        .map(|n| from_mm - STEP_MM * f64::from(n))
        .find(|&z| {
            let plan_from_tool = Pose::new(DQuat::IDENTITY, DVec3::Z * z);
            let bone_from_tool = bone_from_plan.then(&plan_from_tool);
            tool.elements.iter().any(|e| {
                let p = bone_from_tool.point(e.position.as_dvec3());
                fields(bone, &cut, p).solid > 0.0
            })
        })
}
