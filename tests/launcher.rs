//! The launcher's ways out: asked to end, killed. Nobody is left behind, and the motors are at zero.

use osteon_tests::{Running, alive, children, json, number, one_at_a_time, text, truth, until};
use rustix::process::Signal;
use std::path::Path;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
/// Torque of a tool at work, N·mm.
const WORKING: f64 = 10.0;

/// A demonstration whose hand has begun to drill, its files in `DIR/files`; and its processes.
fn drilling(dir: &Path) -> (Running, Vec<u32>) {
    let (files, json) = (dir.join("files"), dir.join("out.json"));
    let (files, json) = (files.display().to_string(), json.display().to_string());
    let args = [
        "demo",
        "--headless",
        "--seconds",
        "60",
        "--voxel-mm",
        "1",
        "--keep-files",
        &files,
        "--json",
        &json,
    ];
    let demo = Running::start(OSTEON, &args, dir, "demo");
    let file = dir.join("files/truth.csv");
    until("the drill's contact", Duration::from_mins(1), || {
        file.exists()
            && truth::read(&file)
                .last()
                .is_some_and(|l| l.torque > WORKING)
    });
    let children = children(demo.id());
    assert_eq!(children.len(), 3, "device, haptics, viewer");
    (demo, children)
}

#[test]
fn ctrl_c_ends_the_demonstration_with_its_report_and_the_motors_at_zero() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (mut demo, children) = drilling(dir.path());
    demo.signal(Signal::INT);
    let status = demo.wait(Duration::from_secs(30));
    assert!(status.success(), "{}", text(dir.path(), "demo.err"));
    assert!(!children.into_iter().any(alive), "a process is left");
    let report = json(&dir.path().join("out.json"));
    assert!(number(&report, "/removed_by_tool_mm3/peg_drill") > 0.0);
    assert_eq!(report["digest"]["servo"], report["digest"]["publisher"]);
    assert_eq!(report["digest"]["servo"], report["digest"]["viewer"]);
    let lines = truth::read(&dir.path().join("files/truth.csv"));
    let last = lines.last().expect("lines");
    assert!(!last.motors_on && last.torque < 1e-9, "{last:?}");
}

#[test]
fn a_killed_launcher_leaves_no_process_behind() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (mut demo, children) = drilling(dir.path());
    demo.signal(Signal::KILL);
    assert_eq!(demo.wait(Duration::from_secs(5)).code(), None);
    until("the end of every process", Duration::from_secs(20), || {
        !children.iter().copied().any(alive)
    });
}
