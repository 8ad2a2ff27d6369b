//! What the scripted hand does in the demonstration: drill the peg hole, ream the glenoid.

use crate::fake::{Segment, Stroke};
use crate::scene::Scene;
use anyhow::{Context as _, bail};
use osteon_sim_core::plan::first_touch_mm;
use osteon_sim_core::register::WORKSPACE_CENTRE_MM;
use osteon_sim_core::tool::Tool;

/// Height over the plan's origin from which each tool approaches, mm.
const APPROACH_MM: f64 = 20.0;
/// Depth of the peg hole past first touch, mm.
const DRILL_MM: f64 = 18.0;
/// Depth of the reaming past first touch, mm.
const REAM_MM: f64 = 2.3;
/// Furthest first touch from the plan's origin that the device can reach, mm.
const REACH_MM: f64 = 15.0;

/// The stroke for a scene. The device's base is registered so that its z is the plan's axis, so a
/// height over the plan is a z in the base frame. Button 1 is the spindle, button 2 the next tool.
pub(crate) fn drill_and_ream(scene: &Scene, tools: &[Tool]) -> anyhow::Result<Stroke> {
    let [drill, ream, ..] = tools else {
        bail!(
            "--tools: {} tool; the demonstration drills with the first and reams with the second, so list a drill and a reamer, or run 'osteon haptics'",
            tools.len()
        );
    };
    let drill = touch(scene, drill)?;
    let ream = touch(scene, ream)?;
    let away = drill.max(ream) + APPROACH_MM;
    let at = |name: &str, z: f64, speed: f64, timeout: f64| Segment {
        name: name.to_owned(),
        goal_mm: [
            WORKSPACE_CENTRE_MM.x,
            WORKSPACE_CENTRE_MM.y,
            WORKSPACE_CENTRE_MM.z + z,
        ],
        axis: [0.0, 0.0, 1.0],
        speed_mm_s: speed,
        max_push_n: 2.5,
        press: None,
        dwell_s: 0.1,
        timeout_s: timeout,
    };
    let pressing = |segment: Segment, button: u8| Segment {
        press: Some(button),
        ..segment
    };
    let mut leave = at("leave the dock", 60.0, 130.0, 4.0);
    leave.goal_mm[1] -= 20.0;
    // out of the picture
    let mut aside = at("aside", 55.0, 80.0, 3.0);
    aside.goal_mm[0] -= 60.0;
    Ok(Stroke {
        segments: vec![
            leave,
            pressing(at("before the joint", away, 100.0, 3.0), 1),
            at("drill: approach", drill + 1.0, 25.0, 3.0),
            at("drill", drill - DRILL_MM, 4.0, 9.0),
            pressing(at("drill: withdraw", away, 40.0, 3.0), 2),
            at("ream: approach", ream + 1.0, 25.0, 3.0),
            Segment {
                dwell_s: 0.3,
                ..at("ream", ream - REAM_MM, 1.0, 7.0)
            },
            pressing(at("ream: withdraw", away, 40.0, 3.0), 1),
            aside,
        ],
    })
}

/// Height of the apex at first touch, mm over the plan's origin.
fn touch(scene: &Scene, tool: &Tool) -> anyhow::Result<f64> {
    let height =
        first_touch_mm(&scene.bone, tool, &scene.bone_from_plan, 40.0).with_context(|| {
            format!(
                "{}: the {} touches no bone along the plan's axis; check --pose",
                scene.source, tool.name
            )
        })?;
    if height.abs() > REACH_MM {
        bail!(
            "{}: the {} first touches bone {height:.1} mm from the plan's origin (at most {REACH_MM} mm can be reached); check --pose, --labels and --keep",
            scene.source,
            tool.name
        );
    }
    Ok(height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{SceneArgs, load};

    #[test]
    fn the_stroke_takes_the_tools_of_the_session() {
        let args = SceneArgs {
            voxel_mm: Some(2.0),
            ..SceneArgs::default()
        };
        let scene = load(&args, &mut |_, _| {}).expect("the phantom");
        let mut tools = Tool::standard_set();
        let usual = drill_and_ream(&scene, &tools).expect("a stroke");
        // a drill whose elements begin 3 mm above its apex is drilled with 3 mm lower
        for e in &mut tools[0].elements {
            e.position.z += 3.0;
        }
        let lower = drill_and_ream(&scene, &tools).expect("a stroke");
        let drill = |s: &Stroke| {
            let segment = s.segments.iter().find(|s| s.name == "drill");
            segment.expect("a segment").goal_mm[2]
        };
        assert!((drill(&usual) - drill(&lower) - 3.0).abs() < 0.1);
        let one = drill_and_ream(&scene, &tools[..1]).expect_err("a refusal");
        assert!(
            one.to_string().contains("list a drill and a reamer"),
            "{one}"
        );
    }
}
