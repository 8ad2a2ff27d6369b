//! Every kind of device through the product's own programs: sessions, the list, refusals by name, and devices
//! that go away and come back.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_tests::{
    Running, fake, fake_with, haptics, json, number, one_at_a_time, run, skipped, stroke, text,
    truth, until,
};
use rustix::process::Signal;
use serde_json::Value;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");

/// The vendor's library, played by the mock.
fn mock_library() -> PathBuf {
    let program = Path::new(OSTEON).parent().expect("a folder");
    let path = program.join("deps/libmock_hd.so");
    assert!(path.exists(), "{}: not built", path.display());
    path
}

/// A session of 1.5 s on `device`; its report.
fn session(dir: &Path, device: &str, more: &[&str]) -> Value {
    let report = dir.join("report.json").display().to_string();
    let socket = osteon_tests::socket(dir).display().to_string();
    let mut args = vec![
        "haptics",
        "--device",
        device,
        "--seconds",
        "1.5",
        "--voxel-mm",
        "2",
    ];
    args.extend(["--socket", &socket, "--json", &report]);
    args.extend(more);
    let output = run(OSTEON, &args, dir, Duration::from_secs(30));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{device} {more:?}: {errors}");
    json(Path::new(&report))
}

/// Most ticks had a sample, nothing was damaged, the digests agree.
fn check(report: &Value, what: &str) {
    let frames = number(report, "/device/frames");
    let ticks = number(report, "/ticks");
    assert!(
        ticks > 100.0 && frames > 0.5 * ticks,
        "{what}: {frames} in {ticks} ticks"
    );
    assert!(number(report, "/device/crc_errors") < 1.0, "{what}");
    assert_eq!(report["ended"], "as asked", "{what}");
    assert_eq!(
        report["digest"]["servo"], report["digest"]["publisher"],
        "{what}"
    );
}

#[test]
fn a_session_on_every_kind_of_device_and_on_either_clock() {
    let _turn = one_at_a_time();
    for (link, device, clocks) in [
        ("omni", "open:", &["host", "device"][..]),
        ("packet:omni", "packet:", &["host", "device"]),
        ("hfab3:omni", "hfab:", &["host"]),
    ] {
        let dir = tempfile::tempdir().expect("a folder");
        let dir = dir.path();
        let path = dir.join("omni").display().to_string();
        let place = link.replace("omni", &path);
        let _fake = Running::start(OSTEON, &["fake-omni", "--link", &place], dir, "fake");
        until("the port", Duration::from_secs(10), || {
            dir.join("omni").exists()
        });
        for clock in clocks {
            let report = session(dir, &format!("{device}{path}"), &["--clock", clock]);
            check(&report, &format!("{device} on the {clock}'s clock"));
        }
    }
    let dir = tempfile::tempdir().expect("a folder");
    check(&session(dir.path(), "sim", &[]), "sim");
    check(
        &session(dir.path(), "sim", &["--clock", "device", "--no-realtime"]),
        "sim",
    );
}

#[test]
fn a_session_through_the_vendors_library() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let report = dir.join("report.json");
    let output = |more: &[&str]| {
        Command::new(OSTEON)
            .args([
                "haptics",
                "--device",
                "openhaptics",
                "--seconds",
                "1.5",
                "--voxel-mm",
                "2",
            ])
            .arg("--json")
            .arg(&report)
            .args(more)
            .env("OSTEON_LIBHD", mock_library())
            .env("XDG_RUNTIME_DIR", dir)
            .output()
            .expect("run")
    };
    let ran = output(&[]);
    assert!(
        ran.status.success(),
        "{}",
        String::from_utf8_lossy(&ran.stderr)
    );
    check(&json(&report), "openhaptics");
    let refused = output(&["--clock", "host"]);
    let errors = String::from_utf8_lossy(&refused.stderr);
    assert!(
        !refused.status.success() && errors.contains("--clock device"),
        "{errors}"
    );
}

fn list(dir: &Path, more: &[&str]) -> (String, Value) {
    let file = dir.join("list.json").display().to_string();
    let args = [&["devices", "--json", &file], more].concat();
    let output = run(OSTEON, &args, dir, Duration::from_secs(30));
    assert!(output.status.success());
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    (text, json(Path::new(&file)))
}

/// The first of a list.
fn only(list: &Value) -> &Value {
    assert_eq!(list.as_array().map(Vec::len), Some(1), "{list:#}");
    &list[0]
}

/// A simulated device at `link`, its port at `DIR/omni`.
fn serve(dir: &Path, link: &str, more: &[&str]) -> Running {
    let args = [&["fake-omni", "--link", link], more].concat();
    let running = Running::start(OSTEON, &args, dir, "fake");
    let port = dir.join("omni");
    until("the port", Duration::from_secs(10), || port.exists());
    std::thread::sleep(Duration::from_millis(300));
    running
}

fn end(mut fake: Running) {
    fake.signal(Signal::TERM);
    assert!(fake.wait(Duration::from_secs(10)).success());
}

/// The problem of the one device of a list, with a remedy.
fn problem(list: &Value, word: &str) {
    let text = only(list)["problem"].as_str().unwrap_or_default();
    assert!(text.contains(word) && text.contains("; "), "{list:#}");
}

#[test]
fn the_list_names_the_protocol_and_who_has_the_port() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let path = dir.join("omni").display().to_string();
    let fake = serve(dir, &path, &[]);
    let (text, all) = list(dir, &[&path]);
    let found = only(&all);
    assert_eq!(found["protocol"], "the open protocol");
    assert_eq!(found["device"], format!("open:{path}"));
    assert_eq!(found["state"], "unhomed, in its dock");
    assert!(
        found["problem"].is_null() && text.starts_with("ok   open:"),
        "{text}"
    );
    // a session has the port: left alone, and said so
    let session = haptics(OSTEON, dir, &[]);
    problem(&list(dir, &[&path]).1, "another program");
    drop(session);
    end(fake);
    let fake = serve(dir, &format!("hfab3:{path}"), &[]);
    let (_, all) = list(dir, &[&path]);
    assert_eq!(only(&all)["device"], format!("hfab:{path}"));
    assert_eq!(only(&all)["state"], "in its home pose");
    end(fake);
    problem(&list(dir, &["open:/dev/osteon-none"]).1, "no such port");
    problem(&list(dir, &["hid:f055:0001"]).1, "no such HID device");
    let (text, all) = list(dir, &["--list-only"]);
    assert!(all.is_array() && text.contains("openhaptics"), "{text}");
}

#[test]
fn the_list_names_what_keeps_a_device_from_a_session() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let path = dir.join("omni").display().to_string();
    for (fault, word) in [
        ("e-stop@0", "emergency stop"),
        ("over-temperature@0", "motor too hot"),
        ("wrong-version@0", "speaks version"),
        ("wrong-schema@0", "lays its messages out otherwise"),
    ] {
        let fake = serve(dir, &path, &["--fault", fault]);
        problem(&list(dir, &[&path]).1, word);
        end(fake);
    }
    // power-up outside of the dock: what a brown-out in the hand leaves
    let stroke = stroke::tap(dir, 1).display().to_string();
    let fake = serve(dir, &path, &["--stroke", &stroke, "--fault", "brown-out@4"]);
    let session = haptics(OSTEON, dir, &["--reconnect-for", "0"]);
    until("the brown-out", Duration::from_secs(20), || {
        text(dir, "fake.err").contains("brown-out")
    });
    drop(session);
    std::thread::sleep(Duration::from_secs(1));
    problem(&list(dir, &[&path]).1, "not in its dock");
    end(fake);
}

#[test]
fn a_port_of_others_is_refused_with_the_group_to_join() {
    if !rustix::process::geteuid().is_root() {
        skipped("a_port_of_others_is_refused_with_the_group_to_join: needs root to become nobody");
        return;
    }
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let _fake = fake(OSTEON, dir.path(), None);
    // nobody may not pass the test's own folder, but the port behind the link
    let port = std::fs::read_link(dir.path().join("omni")).expect("a link");
    let output = Command::new(OSTEON)
        .args(["devices", &port.display().to_string()])
        .current_dir("/")
        .uid(65_534)
        .gid(65_534)
        .output();
    let Ok(output) = output else {
        skipped(
            "a_port_of_others_is_refused_with_the_group_to_join: nobody may not run the program",
        );
        return;
    };
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        text.contains("permission denied") && text.contains("usermod -aG"),
        "{text}"
    );
}

/// Largest rise of a torque in a millisecond, N·mm, and the time without torque in each pulled plug.
fn smooth(lines: &[truth::Line]) -> f64 {
    let rises = lines.windows(2).map(|w| w[1].torque - w[0].torque);
    rises.fold(0.0, f64::max)
}

/// The plug is pulled while the drill is pressed on, lifted and pressed on, again and again: no torque while it is out, and the force comes
/// back without a jump.
fn pulled_and_put_back(times: u32, begin: f64, every: f64) {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let stroke = stroke::tap(dir, 40 + 4 * times);
    let faults: Vec<String> = (0..times)
        .flat_map(|n| {
            [
                "--fault".to_owned(),
                format!("unplug@{}", begin + every * f64::from(n)),
            ]
        })
        .collect();
    let faults: Vec<&str> = faults.iter().map(String::as_str).collect();
    let mut device = fake_with(OSTEON, dir, Some(&stroke), &faults);
    let mut session = haptics(OSTEON, dir, &[]);
    let limit = Duration::from_secs_f64(begin + every * f64::from(times) * 2.0 + 30.0);
    until("the last plug", limit, || {
        text(dir, "fake.err").matches("unplug").count() >= times as usize
    });
    std::thread::sleep(Duration::from_secs_f64(every));
    assert!(session.runs(), "{}", text(dir, "haptics.err"));
    session.signal(Signal::TERM);
    let status = session.wait(Duration::from_secs(20));
    let errors = text(dir, "haptics.err");
    assert!(status.success(), "{errors}");
    device.signal(Signal::TERM);
    assert!(device.wait(Duration::from_secs(10)).success());
    let report = json(&dir.join("report.json"));
    assert!(
        (number(&report, "/device/reconnects") - f64::from(times)).abs() < 0.5,
        "{errors}"
    );
    assert_eq!(report["digest"]["servo"], report["digest"]["publisher"]);
    let lines = truth::read(&dir.join("truth.csv"));
    let mut firm = 0;
    for n in 0..times {
        let at = (begin + every * f64::from(n)) * 1e6;
        let within = |from: f64, to: f64| {
            let span = at + from * 1e6..at + to * 1e6;
            lines
                .iter()
                .filter(move |l| span.contains(&(l.micros as f64)))
        };
        let out: Vec<_> = within(0.05, 0.3).collect();
        assert!(
            !out.is_empty() && out.iter().all(|l| l.torque < 0.5 && !l.motors_on),
            "plug {n}"
        );
        // in contact at once the force waits until the tool is free: it is felt again with the next press
        firm += u32::from(within(0.3, every).any(|l| l.torque > 20.0));
    }
    assert!(
        firm * 10 >= times * 9,
        "the force came back {firm} times of {times}"
    );
    // what the drive lets a torque rise in a millisecond: 605 counts of 0.215 N·mm; a busy machine skips ticks,
    // so no less can be asked here (lockstep asks for it)
    let rise = smooth(&lines);
    assert!(rise < 130.0, "{rise} N·mm in a millisecond");
}

#[test]
fn a_pulled_plug_is_waited_for_and_the_session_goes_on() {
    pulled_and_put_back(4, 7.0, 2.3);
}

/// The issue's own figure; takes four minutes.
#[test]
#[ignore = "four minutes; run with --ignored"]
fn a_hundred_pulled_plugs() {
    pulled_and_put_back(100, 7.0, 2.3);
}

#[test]
fn the_latency_report_has_its_rows() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("out").display().to_string();
    let args = ["report", "latency", "--quick", "--out", &out];
    let output = run(OSTEON, &args, dir.path(), Duration::from_mins(1));
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report = json(&dir.path().join("out/latency.json"));
    let rows = report["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2);
    for row in rows {
        for key in ["transport", "scheduler", "load"] {
            assert!(row[key].is_string(), "{row:#}");
        }
        for key in ["wake_us", "roundtrip_us", "cyclictest_us"] {
            let absent = key == "cyclictest_us" && row[key].is_null();
            let in_order = ["p50", "p99", "p999", "max"].map(|q| row[key][q].as_f64());
            assert!(
                absent || in_order.is_sorted() && in_order[0].is_some(),
                "{row:#}"
            );
        }
        assert!(number(row, "/ticks") > 100.0);
    }
    assert!(dir.path().join("out/latency.md").exists());
}
