//! The clinic's commands as a lab runs them: a scanner's series in, a plan, a report out.
#![expect(
    clippy::expect_used,
    clippy::print_stderr,
    reason = "what goes wrong here is a failed test; measured figures are told"
)]

#[expect(dead_code, reason = "other tests use the rest")]
#[path = "../firmware-bridge/src/import/dicom/planted.rs"]
mod planted;

use osteon_tests::{failed, refused};
use planted::{Planted, Syntax};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
const SLICES: u16 = 275;
const EDGE: u16 = 512;

/// A pixel of the synthesised series (splitmix64's finaliser over place and seed).
fn pixel(at: u64) -> u16 {
    let mut x = at.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x ^= x >> 27;
    u16::try_from(x & 0xfff).expect("twelve bits")
}

fn write_series(dir: &Path) {
    let layer = u64::from(EDGE) * u64::from(EDGE);
    for k in 0..SLICES {
        let mut d = Planted::ct(EDGE, EDGE, [-200.0, -200.0, -300.0 + f64::from(k)]);
        d.pixels(
            (0..layer)
                .map(|n| pixel(u64::from(k) * layer + n))
                .collect(),
        );
        d.write(
            &dir.join(format!("{:04}.dcm", u32::from(k) * 101 % 9973)),
            Syntax::Explicit,
        );
    }
}

/// Largest resident set of a process so far, bytes.
fn peak_bytes(pid: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim()
        .strip_suffix("kB")?
        .trim()
        .parse::<u64>()
        .ok()
        .map(|k| k * 1024)
}

#[test]
fn a_whole_series_is_imported_within_three_times_its_size() {
    let dir = tempfile::tempdir().expect("a folder");
    let input = dir.path().join("in");
    std::fs::create_dir(&input).expect("a folder");
    write_series(&input);
    let out = dir.path().join("out");
    let began = Instant::now();
    let mut child = Command::new(OSTEON)
        .args([
            "import".as_ref(),
            input.as_os_str(),
            "--out".as_ref(),
            out.as_os_str(),
        ])
        .stderr(Stdio::null())
        .spawn()
        .expect("started");
    let mut peak = 0;
    let status = loop {
        peak = peak.max(peak_bytes(child.id()).unwrap_or(0));
        if let Some(status) = child.try_wait().expect("waited") {
            break status;
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    let seconds = began.elapsed().as_secs_f64();
    assert!(status.success());
    let size = 2 * u64::from(SLICES) * u64::from(EDGE) * u64::from(EDGE);
    eprintln!(
        "{SLICES} slices of {EDGE}²: {seconds:.2} s, {:.0} MB at most of {:.0} MB ({:.2}×)",
        peak as f64 / 1e6,
        size as f64 / 1e6,
        peak as f64 / size as f64
    );
    assert!(peak > 0 && peak <= 3 * size, "{peak} bytes");
    // every voxel, from the file's own bytes
    let bytes = std::fs::read(out.join("volume.nii")).expect("a volume");
    let (words, _) = bytes[352..].as_chunks::<2>();
    assert_eq!(words.len() as u64 * 2, size);
    for (n, word) in words.iter().enumerate() {
        let expected = i32::from(pixel(n as u64)) - 1000;
        assert_eq!(i32::from(i16::from_le_bytes(*word)), expected, "voxel {n}");
    }
}

#[test]
fn the_reports_of_a_scenario_are_written_and_the_same_again() {
    let dir = tempfile::tempdir().expect("a folder");
    let report = |name: &str| {
        let out = dir.path().join(name);
        let done = Command::new(OSTEON)
            .args([
                "report".as_ref(),
                "session".as_ref(),
                "--scripted".as_ref(),
                "soft".as_ref(),
                "--out".as_ref(),
                out.as_os_str(),
            ])
            .output()
            .expect("run");
        assert!(
            done.status.success(),
            "{}",
            String::from_utf8_lossy(&done.stderr)
        );
        std::fs::read_to_string(out.join("session.json")).expect("a file")
    };
    let one = report("one");
    assert_eq!(one, report("two"), "byte for byte");
    let json: serde_json::Value = serde_json::from_str(&one).expect("JSON");
    let metrics = json["metrics"].as_array().expect("metrics");
    for metric in metrics {
        for field in ["name", "value", "unit", "uncertainty", "plan"] {
            assert!(metric.get(field).is_some(), "{metric}");
        }
    }
    for name in [
        "version_error",
        "depth_error",
        "seating",
        "force_peak",
        "sparc",
        "ldlj",
    ] {
        assert!(metrics.iter().any(|m| m["name"] == name), "{name}");
    }
    let html = std::fs::read_to_string(dir.path().join("one/session.html")).expect("a page");
    assert!(
        !html.contains("http://")
            || html.matches("http://").count()
                == html.matches("http://www.w3.org/2000/svg").count()
    );
    assert!(
        html.contains("not validated") && !html.contains("src="),
        "self-contained"
    );
    let csv = std::fs::read_to_string(dir.path().join("one/cohort.csv")).expect("a table");
    let rows: Vec<&str> = csv.lines().collect();
    assert_eq!(rows.len(), 2);
    assert!(rows[0].contains(",version_error_deg,") && rows[1].starts_with("\"soft\","));
    let columns = |row: &str| row.split(',').count();
    assert!(columns(rows[1]) >= columns(rows[0]));
}

#[test]
fn a_recorded_session_is_judged_to_the_same_bytes_twice() {
    let _turn = osteon_tests::one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("trainee.mcap").display().to_string();
    let run = |args: &[&str]| {
        let done = Command::new(OSTEON)
            .args(args)
            .env("XDG_RUNTIME_DIR", dir.path())
            .env("LP_NUM_THREADS", "1")
            .output()
            .expect("run");
        let errors = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{args:?}:\n{errors}");
        errors
    };
    let demo = [
        "demo",
        "--headless",
        "--scene",
        "soft",
        "--task",
        "guided",
        "--seconds",
        "12",
        "--record",
        &file,
    ];
    run(&demo);
    let out = |name: &str| dir.path().join(name).display().to_string();
    for name in ["one", "two"] {
        run(&["report", "session", &file, "--out", &out(name)]);
    }
    for name in ["session.json", "session.html", "cohort.csv"] {
        let bytes = |of: &str| std::fs::read(dir.path().join(of).join(name)).expect("a file");
        assert!(bytes("one") == bytes("two"), "{name}");
    }
}

#[test]
fn bad_input_is_one_line_each() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    std::fs::create_dir(dir.join("empty")).expect("a folder");
    std::fs::write(dir.join("words.txt"), "no numbers here\n").expect("written");
    let path = |name: &str| dir.join(name).display().to_string();
    let (empty, out) = (path("empty"), path("out"));
    refused(
        OSTEON,
        dir,
        &["import", &empty, "--out", &out],
        &["no DICOM image among 0 files", &empty],
    );
    refused(
        OSTEON,
        dir,
        &["import", &path("missing"), "--out", &out],
        &["missing", "check the path"],
    );
    refused(
        OSTEON,
        dir,
        &["import", &path("words.txt"), "--out", &out],
        &["words.txt"],
    );
    refused(
        OSTEON,
        dir,
        &["demo", "--headless", "--scene", &empty],
        &["scene.toml", "osteon import"],
    );
    refused(OSTEON, dir, &["haptics", "--task", "exam"], &["--scene"]);
    refused(
        OSTEON,
        dir,
        &["report", "session", "--scripted", &empty, "--out", &out],
        &["scene.toml"],
    );
    assert!(!dir.join("out").exists(), "nothing half-written");
    let lines = failed(
        OSTEON,
        dir,
        &[
            "plan",
            "normal",
            "--glenoid-centre",
            "1,2",
            "--trigonum-spinae",
            "1,2,3",
            "--inferior-angle",
            "1,2,3",
        ],
        2,
    );
    assert!(lines.contains("three numbers"), "{lines}");
}
