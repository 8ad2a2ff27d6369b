//! Sessions recorded by real processes: played again to the same bits, whatever became of the process.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_tests::{
    data, fake, haptics, json, number, one_at_a_time, refused, run, stroke, text, until, workspace,
};
use rustix::process::Signal;
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
const LIMIT: Duration = Duration::from_mins(1);

/// Plays a recording again; what was found equal.
fn verified(dir: &Path, file: &Path) -> Value {
    let out = dir.join("verified.json");
    let args = ["replay", text_of(file), "--verify", "--json", text_of(&out)];
    let output = run(OSTEON, &args, dir, LIMIT);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{errors}");
    json(&out)
}

fn text_of(path: &Path) -> &str {
    path.to_str().expect("text")
}

/// A demonstration, recorded; its report.
fn demo(dir: &Path, file: &Path, more: &[&str]) -> Value {
    let report = dir.join("demo.json");
    let mut args = vec!["demo", "--headless", "--record", text_of(file)];
    args.extend(["--json", text_of(&report)]);
    args.extend(more);
    let output = run(OSTEON, &args, dir, Duration::from_mins(2));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{errors}");
    json(&report)
}

fn assert_whole(verified: &Value, report: &Value) {
    assert_eq!(verified["end_digest"], true);
    assert_eq!(verified["ended"], "as asked");
    let (ticks, removed) = (number(verified, "/ticks"), number(verified, "/removed_mm3"));
    assert!((ticks - number(report, "/ticks")).abs() < 0.5);
    assert!((removed - number(report, "/removed_mm3")).abs() < 1e-9);
    assert!(removed > 50.0, "{removed}");
    assert!(number(report, "/recording/lost_ticks") < 0.5);
}

#[test]
fn a_demonstration_on_the_phantom_is_played_to_the_same_bits() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("phantom.mcap");
    let report = demo(dir.path(), &file, &["--seconds", "12", "--voxel-mm", "1"]);
    assert_whole(&verified(dir.path(), &file), &report);
    // it is never written over
    let again = ["haptics", "--record", text_of(&file), "--voxel-mm", "2"];
    refused(
        OSTEON,
        dir.path(),
        &again,
        &["phantom.mcap", "is there already"],
    );
}

#[test]
fn a_demonstration_on_a_patient_is_played_to_the_same_bits() {
    let Some(data) = data("recording on a patient") else {
        return;
    };
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("patient.mcap");
    let path = |name: &str| data.join(name).display().to_string();
    let (bone, labels) = (
        path("right_shoulder_ct.nii.gz"),
        path("right_shoulder_labels.nii.gz"),
    );
    // the plan is a copy, so that it can be changed
    let plan = dir.path().join("plan.json");
    std::fs::copy(path("right_glenoid_pose.json"), &plan).expect("a copy");
    let mut more = vec!["--bone", &bone, "--labels", &labels, "--keep", "1"];
    more.extend([
        "--threshold",
        "120",
        "--seconds",
        "12",
        "--pose",
        text_of(&plan),
    ]);
    let report = demo(dir.path(), &file, &more);
    assert_whole(&verified(dir.path(), &file), &report);
    let text = std::fs::read_to_string(&plan).expect("a plan");
    std::fs::write(&plan, text + "\n").expect("written");
    let args = ["replay", text_of(&file), "--verify"];
    refused(
        OSTEON,
        dir.path(),
        &args,
        &["plan.json", "is not the file of the recording"],
    );
}

#[test]
fn a_killed_session_has_lost_a_second_at_most() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, Some(&stroke::peck(dir)));
    let (file, poses) = (dir.join("session.mcap"), dir.join("poses.csv"));
    let more = ["--record", text_of(&file), "--pose-log", text_of(&poses)];
    let mut haptics = haptics(OSTEON, dir, &more);
    // the pose log is written in blocks: its last whole line is a tick that was over
    let last_tick = || {
        let log = std::fs::read_to_string(&poses).unwrap_or_default();
        let lines = log.lines().rev().skip(1);
        let numbers = lines.map(|line| line.split(',').next().and_then(|n| n.parse::<f64>().ok()));
        numbers.flatten().next().unwrap_or(0.0)
    };
    // the drill is in the bone from the sixth second on
    until("nine seconds", LIMIT, || last_tick() > 9000.0);
    let told = last_tick();
    haptics.signal(Signal::KILL);
    until("the end", LIMIT, || !haptics.runs());
    let found = verified(dir, &file);
    assert!(found["ended"].is_null());
    let ticks = number(&found, "/ticks");
    assert!(ticks > told - 1000.0, "{ticks} of more than {told}");
    assert!(number(&found, "/removed_mm3") > 0.0);
}

#[test]
fn what_is_no_session_is_refused_by_name() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let readme = workspace().join("README.md");
    let replay =
        |file: &str, words: &[&str]| refused(OSTEON, dir, &["replay", file, "--verify"], words);
    replay(text_of(&readme), &["README.md", "not an Osteon session"]);
    replay("absent.mcap", &["absent.mcap", "cannot be read"]);
    let export = ["export", "absent.mcap", "--csv", "out"];
    refused(OSTEON, dir, &export, &["absent.mcap", "cannot be read"]);
    refused(
        OSTEON,
        dir,
        &["export", "absent.mcap"],
        &["nothing to export"],
    );
    assert!(!dir.join("out").exists());
    assert!(text(dir, "run.err").contains("nothing to export"));
}
