//! Sessions recorded by real processes: played again to the same bits, whatever became of the process.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "what goes wrong here is a failed test"
)]

use osteon_tests::{
    Running, data, fake, haptics, json, number, one_at_a_time, refused, run, stroke, text, until,
    workspace,
};
use rustix::process::Signal;
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Lines, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
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

/// A replay that serves viewers, and takes orders.
struct Watched {
    child: Child,
    words: Lines<BufReader<ChildStdout>>,
}

impl Watched {
    fn start(dir: &Path, file: &Path, socket: &Path) -> Self {
        let mut child = Command::new(OSTEON)
            .args([
                "replay",
                text_of(file),
                "--socket",
                text_of(socket),
                "--speed",
                "4",
            ])
            .env("XDG_RUNTIME_DIR", dir)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("started");
        let words = BufReader::new(child.stdout.take().expect("output")).lines();
        Self { child, words }
    }

    /// Gives an order; the moment of the session after it, s, and whether it plays.
    fn order(&mut self, order: &str) -> (f64, bool) {
        let orders = self.child.stdin.as_mut().expect("input");
        writeln!(orders, "{order}").expect("written");
        for line in self.words.by_ref() {
            let line = line.expect("a line");
            if line.contains(" s, p") {
                let word = |n: usize| line.split_whitespace().nth(n).unwrap_or("");
                return (word(1).parse().expect("a time"), word(3) == "playing,");
            }
        }
        panic!("no answer to {order}");
    }
}

#[test]
fn a_replay_is_watched_at_any_speed_and_from_any_moment() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let file = dir.join("session.mcap");
    let device = fake(OSTEON, dir, Some(&stroke::peck(dir)));
    let mut session = haptics(OSTEON, dir, &["--record", text_of(&file), "--seconds", "8"]);
    assert!(session.wait(LIMIT).success());
    drop(device);
    let (socket, report) = (dir.join("w/replay.sock"), dir.join("viewer.json"));
    let mut film = Watched::start(dir, &file, &socket);
    until("the replay's socket", LIMIT, || socket.exists());
    let args = [
        "view",
        "--mirror-only",
        "--socket",
        text_of(&socket),
        "--report",
        text_of(&report),
    ];
    let mut viewer = Running::start(OSTEON, &args, dir, "view");
    std::thread::sleep(Duration::from_secs(2));
    let near = |(at, playing): (f64, bool), (wanted, plays): (f64, bool)| {
        assert!(
            (at - wanted).abs() < 0.25 && playing == plays,
            "{at} s, {wanted} s"
        );
    };
    let (paused, _) = film.order("pause");
    assert!(paused > 1.0, "{paused}");
    near(film.order("seek 7"), (7.0, false));
    near(film.order("step 100"), (7.1, false));
    near(film.order("step -3100"), (4.0, false));
    near(film.order("seek 0"), (0.0, false));
    near(film.order("speed 20"), (0.0, false));
    near(film.order("play"), (0.0, true));
    std::thread::sleep(Duration::from_secs(1));
    let (played, _) = film.order("pause");
    assert!(played > 1.0, "{played}");
    near(film.order("seek 6.5"), (6.5, false));
    writeln!(film.child.stdin.as_mut().expect("input"), "quit").expect("written");
    // the replay has compared the viewer's bone with its own
    assert!(film.child.wait().expect("an end").success());
    assert!(viewer.wait(LIMIT).success());
    let report = json(&report);
    assert!(number(&report, "/updates") > 0.0, "{report:#}");
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
