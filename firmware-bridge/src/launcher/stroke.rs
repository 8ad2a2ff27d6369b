//! What the scripted hand does in the demonstration: drill the peg hole and ream the glenoid, or press
//! the reamer in with a constant force.

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
/// Past the last timed layer a pressed tool goes on by this, mm: a hand slows down before its goal.
const BEYOND_MM: f64 = 1.0;
/// Furthest first touch from the plan's origin that the device can reach, mm.
const REACH_MM: f64 = 15.0;

/// The stroke for a scene. The device's base is registered so that its z is the plan's axis, so a
/// height over the plan is a z in the base frame. Button 1 is the spindle, button 2 the next tool.
pub(crate) fn drill_and_ream(scene: &Scene, tools: &[Tool]) -> anyhow::Result<Stroke> {
    let [drill, ream] = drill_and_reamer(tools)?;
    let drill = touch(scene, drill)?;
    let ream = touch(scene, ream)?;
    let away = drill.max(ream) + APPROACH_MM;
    Ok(Stroke {
        segments: vec![
            leave(),
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
            aside(),
        ],
    })
}

/// The stroke that presses the second tool straight along the planned axis: with `push_n` at most, until
/// the stylus has gone `depth_mm` and a little under the bone, or for `seconds`. The target runs ahead of the
/// stylus as far as the push allows, so the push is constant. Also the tool.
pub(crate) fn press<'a>(
    scene: &Scene,
    tools: &'a [Tool],
    [push_n, depth_mm, seconds]: [f64; 3],
) -> anyhow::Result<(Stroke, &'a Tool)> {
    let [_, tool] = drill_and_reamer(tools)?;
    let height = touch(scene, tool)?;
    let away = height + APPROACH_MM;
    let press = Segment {
        max_push_n: push_n,
        dwell_s: 0.0,
        ..at("press", height - depth_mm - BEYOND_MM, 25.0, seconds)
    };
    let segments = vec![
        leave(),
        pressing(at("before the joint", away, 100.0, 3.0), 2),
        pressing(at("spindle", away - 2.0, 25.0, 3.0), 1),
        at("approach", height + 1.0, 25.0, 3.0),
        press,
        pressing(at("withdraw", away, 40.0, 3.0), 1),
        aside(),
    ];
    Ok((Stroke { segments }, tool))
}

fn drill_and_reamer(tools: &[Tool]) -> anyhow::Result<[&Tool; 2]> {
    let [drill, ream, ..] = tools else {
        bail!(
            "--tools: {} tool; the demonstration drills with the first and reams with the second, so list a drill and a reamer, or run 'osteon haptics'",
            tools.len()
        );
    };
    Ok([drill, ream])
}

/// A way to `z` mm over the plan's origin, at a speed (mm/s), for at most `timeout` s.
fn at(name: &str, z: f64, speed: f64, timeout: f64) -> Segment {
    Segment {
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
    }
}

fn pressing(segment: Segment, button: u8) -> Segment {
    Segment {
        press: Some(button),
        ..segment
    }
}

fn leave() -> Segment {
    let mut leave = at("leave the dock", 60.0, 130.0, 4.0);
    leave.goal_mm[1] -= 20.0;
    leave
}

/// Out of the picture.
fn aside() -> Segment {
    let mut aside = at("aside", 55.0, 80.0, 3.0);
    aside.goal_mm[0] -= 60.0;
    aside
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

    #[test]
    fn a_push_is_the_reamers_and_ends_behind_the_layers() {
        let args = SceneArgs {
            voxel_mm: Some(2.0),
            ..SceneArgs::default()
        };
        let scene = load(&args, &mut |_, _| {}).expect("the phantom");
        let tools = Tool::standard_set();
        let (stroke, tool) = press(&scene, &tools, [0.9, 7.8, 20.0]).expect("a stroke");
        assert_eq!(tool.id, "reamer");
        stroke.validate().expect("within reach");
        let named = |name: &str| stroke.segments.iter().find(|s| s.name == name);
        let (approach, press) = named("approach").zip(named("press")).expect("segments");
        assert!((approach.goal_mm[2] - press.goal_mm[2] - 1.0 - 7.8 - BEYOND_MM).abs() < 1e-9);
        assert!((press.max_push_n - 0.9).abs() < 1e-12 && press.timeout_s <= 20.0);
        assert!(super::press(&scene, &tools[..1], [0.9, 7.8, 20.0]).is_err());
    }
}
