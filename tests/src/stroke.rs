//! Strokes for the simulated hand.
#![expect(
    clippy::expect_used,
    clippy::missing_panics_doc,
    reason = "helpers for tests"
)]

use std::path::{Path, PathBuf};

/// Writes a stroke that presses the standing drill onto the phantom's glenoid with up to 2 N and
/// stays there: the motors have something to do.
pub fn press(dir: &Path) -> PathBuf {
    let at = |name: &str, goal: [f64; 3], speed: f64, timeout: f64| {
        serde_json::json!({
            "name": name, "goal_mm": goal, "axis": [0, 0, 1], "speed_mm_s": speed,
            "max_push_n": 2.0, "press": null, "dwell_s": 0.0, "timeout_s": timeout
        })
    };
    let stroke = serde_json::json!({"segments": [
        at("leave the dock", [0.0, -20.0, 60.0], 200.0, 3.0),
        at("before the joint", [0.0, 0.0, 15.0], 150.0, 3.0),
        at("press", [0.0, 0.0, -10.0], 40.0, 600.0),
    ]});
    let path = dir.join("stroke.json");
    std::fs::write(&path, stroke.to_string()).expect("a stroke");
    path
}
