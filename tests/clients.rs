//! A viewer in another language, written from WIRE.md alone, comes to the same bone.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_tests::{
    fake, haptics, json, number, one_at_a_time, run, skipped, socket, stroke, text, workspace,
};
use serde_json::Value;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
const LIMIT: Duration = Duration::from_mins(1);

fn has_python() -> bool {
    let found = Command::new("python3").arg("--version").output();
    let found = found.is_ok_and(|o| o.status.success());
    if !found {
        skipped("a viewer in another language: no python3 here");
    }
    found
}

/// Runs it beside a session of a few seconds; what it printed and the session's report.
fn session(dir: &Path, more: &[&str]) -> (Value, Value) {
    let _device = fake(OSTEON, dir, Some(&stroke::peck(dir)));
    let mut haptics = haptics(OSTEON, dir, &["--seconds", "7"]);
    let program = workspace().join("tests/clients/viewer.py");
    let (program, socket) = (program.display().to_string(), socket(dir));
    let socket = socket.display().to_string();
    let mut args = vec![program.as_str(), socket.as_str()];
    args.extend(more);
    let output = run("python3", &args, dir, LIMIT);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    assert!(
        haptics.wait(LIMIT).success(),
        "{}",
        text(dir, "haptics.err")
    );
    let found = serde_json::from_slice(&output.stdout).expect("a line of JSON");
    (found, json(&dir.join("report.json")))
}

#[test]
fn a_viewer_in_python_mirrors_the_bone_to_the_digest() {
    if !has_python() {
        return;
    }
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (found, report) = session(dir.path(), &[]);
    assert_eq!(found["equal"], Value::Bool(true), "{found}");
    assert_eq!(found["digest"], report["digest"]["servo"]);
    assert!(number(&found, "/changed_chunks") > 0.0 && number(&found, "/poses") > 20.0);
    // bone of which it counted the voxels itself
    let solid = number(&found, "/solid_mm3") / number(&found, "/solid_mm3_told");
    assert!((solid - 1.0).abs() < 0.02, "{found}");
    // in control it never was
    assert_eq!(found["granted"], Value::from(30));
}

#[test]
fn a_viewer_in_python_hangs_up_and_comes_back_to_its_seat() {
    if !has_python() {
        return;
    }
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (found, report) = session(dir.path(), &["--break-after", "30"]);
    assert_eq!(found["resumed"], Value::Bool(true), "{found}");
    assert_eq!(found["digest"], report["digest"]["servo"]);
    assert!(number(&report, "/viewer/resumed") >= 1.0);
    assert!(number(&report, "/viewer/peak_bytes") <= number(&report, "/viewer/bound_bytes"));
}
