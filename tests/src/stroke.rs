//! Strokes for the simulated hand.
#![expect(clippy::expect_used, reason = "helpers for tests")]

use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// A straight movement without a button: to `goal` in mm, base frame, at `speed` in mm/s.
fn segment(name: &str, goal: [f64; 3], speed: f64, timeout_s: f64) -> Value {
    json!({
        "name": name, "goal_mm": goal, "axis": [0, 0, 1], "speed_mm_s": speed,
        "max_push_n": 2.0, "press": null, "dwell_s": 0.0, "timeout_s": timeout_s
    })
}

fn write(dir: &Path, segments: &[Value]) -> PathBuf {
    let path = dir.join("stroke.json");
    std::fs::write(&path, json!({ "segments": segments }).to_string()).expect("a stroke");
    path
}

/// Writes a stroke that presses the standing drill onto the phantom's glenoid with up to 2 N and
/// stays there: the motors have something to do.
pub fn press(dir: &Path) -> PathBuf {
    write(
        dir,
        &[
            segment("leave the dock", [0.0, -20.0, 60.0], 200.0, 3.0),
            segment("before the joint", [0.0, 0.0, 15.0], 150.0, 3.0),
            segment("press", [0.0, 0.0, -10.0], 40.0, 600.0),
        ],
    )
}

/// Writes a stroke that presses the standing drill onto the phantom's glenoid for 0.6 s and takes it away for
/// 0.4 s, `times` times.
pub fn tap(dir: &Path, times: u32) -> PathBuf {
    let mut segments = vec![
        segment("leave the dock", [0.0, -20.0, 60.0], 200.0, 3.0),
        segment("before the joint", [0.0, 0.0, 15.0], 150.0, 3.0),
    ];
    for _ in 0..times {
        segments.push(segment("press", [0.0, 0.0, -6.0], 60.0, 0.6));
        segments.push(segment("away", [0.0, 0.0, 12.0], 120.0, 0.4));
    }
    write(dir, &segments)
}

/// Writes a stroke that switches the spindle on and pecks at the phantom's glenoid again and again
/// for two minutes: out of the bone, into it, out of it.
pub fn peck(dir: &Path) -> PathBuf {
    let mut before = segment("before the joint", [0.0, 0.0, 15.0], 150.0, 3.0);
    before["press"] = json!(1);
    let mut segments = vec![
        segment("leave the dock", [0.0, -20.0, 60.0], 200.0, 3.0),
        before,
    ];
    for _ in 0..60 {
        segments.push(segment("in", [0.0, 0.0, -6.0], 20.0, 1.5));
        segments.push(segment("out", [0.0, 0.0, 10.0], 40.0, 1.0));
    }
    write(dir, &segments)
}
