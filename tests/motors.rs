//! Whatever ends the haptics process, the torque at the plant goes to zero: seen on the plant.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_tests::{
    Running, fake, fake_with, haptics, one_at_a_time, socket, stroke, text, truth, until,
};
use rustix::process::Signal;
use std::path::Path;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
/// Torque of a firm press, N·mm.
const PRESSED: f64 = 20.0;

/// A session in which the hand presses; `end` ends the haptics process. The truth afterwards, cut
/// to what came from the last line with a firm torque on, and the haptics' errors and exit code.
fn pressed_until(more: &[&str], end: Option<Signal>) -> (Vec<truth::Line>, String, Option<i32>) {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let stroke = stroke::press(dir.path());
    let mut device = fake(OSTEON, dir.path(), Some(&stroke));
    let mut haptics = haptics(OSTEON, dir.path(), more);
    wait_for_press(dir.path());
    if let Some(signal) = end {
        haptics.signal(signal);
    }
    let status = haptics.wait(Duration::from_secs(30));
    std::thread::sleep(Duration::from_millis(500));
    device.signal(Signal::TERM);
    assert!(device.wait(Duration::from_secs(10)).success());
    let lines = truth::read(&dir.path().join("truth.csv"));
    let last = lines
        .iter()
        .rposition(|l| l.torque > PRESSED)
        .expect("a press");
    (
        lines[last..].to_vec(),
        text(dir.path(), "haptics.err"),
        status.code(),
    )
}

fn wait_for_press(dir: &Path) {
    let path = dir.join("truth.csv");
    until("a press", Duration::from_secs(30), || {
        truth::read(&path)
            .last()
            .is_some_and(|l| l.torque > PRESSED)
    });
}

/// Device time from the last firm torque to the first line from which it stays zero, ms.
fn stop_time_ms(lines: &[truth::Line]) -> f64 {
    let zero = lines.iter().rposition(|l| l.torque > 0.5).expect("torque") + 1;
    assert!(zero < lines.len(), "never zero");
    (lines[zero].micros - lines[0].micros) as f64 * 1e-3
}

/// The host itself set the motors to zero: the device's watchdog had nothing to do.
fn check_host_stopped(lines: &[truth::Line]) {
    let last = lines.last().expect("lines");
    assert!(!last.motors_on && last.torque < 1e-9, "{last:?}");
    assert!(stop_time_ms(lines) <= 25.0, "{} ms", stop_time_ms(lines));
    assert!(
        lines.iter().all(|l| l.drive != "tripped"),
        "only the watchdog stopped the motors"
    );
}

#[test]
fn an_asked_for_end_stops_the_motors() {
    for signal in [Signal::TERM, Signal::INT, Signal::HUP] {
        let (lines, errors, code) = pressed_until(&[], Some(signal));
        assert_eq!(code, Some(0), "{errors}");
        check_host_stopped(&lines);
    }
}

#[test]
fn a_viewer_that_does_not_answer_delays_no_motor() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let mut device = fake(OSTEON, dir, Some(&stroke::press(dir)));
    let mut haptics = haptics(OSTEON, dir, &[]);
    let socket = socket(dir).display().to_string();
    let args = ["view", "--mirror-only", "--socket", &socket];
    let viewer = Running::start(OSTEON, &args, dir, "viewer");
    wait_for_press(dir);
    viewer.signal(Signal::STOP);
    haptics.signal(Signal::TERM);
    // longer than the watchdog, shorter than the wait for the viewer's last digest
    std::thread::sleep(Duration::from_secs(2));
    assert!(haptics.runs(), "it waits for the viewer");
    device.signal(Signal::TERM);
    assert!(device.wait(Duration::from_secs(10)).success());
    let lines = truth::read(&dir.join("truth.csv"));
    let last = lines.iter().rposition(|l| l.torque > PRESSED);
    check_host_stopped(&lines[last.expect("a press")..]);
    viewer.signal(Signal::CONT);
    let status = haptics.wait(Duration::from_secs(15));
    assert!(status.success(), "{}", text(dir, "haptics.err"));
}

#[test]
fn a_killed_host_is_caught_by_the_devices_watchdog() {
    let (lines, _, code) = pressed_until(&[], Some(Signal::KILL));
    assert_eq!(code, None);
    assert!(lines.iter().any(|l| l.drive == "tripped"), "a trip");
    assert!(!lines.last().expect("lines").motors_on);
    // 20 ms from the last command, which may lie a tick before the last torque, and the lag of the
    // actuator
    assert!(stop_time_ms(&lines) <= 25.0, "{} ms", stop_time_ms(&lines));
}

#[test]
fn a_panic_in_the_servo_stops_the_motors_and_is_told() {
    let (lines, errors, code) = pressed_until(&["--panic-at-tick", "5000"], None);
    assert_eq!(code, Some(1));
    assert!(errors.contains("induced by --panic-at-tick"), "{errors}");
    assert!(errors.contains("motors were set to zero"), "{errors}");
    check_host_stopped(&lines);
}

#[test]
fn the_end_of_the_session_stops_the_motors() {
    let (lines, errors, code) = pressed_until(&["--seconds", "6"], None);
    assert_eq!(code, Some(0), "{errors}");
    check_host_stopped(&lines);
}

#[test]
fn a_device_that_goes_away_ends_the_session_with_a_reason() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let device = fake(OSTEON, dir.path(), None);
    let mut haptics = haptics(OSTEON, dir.path(), &["--reconnect-for", "0"]);
    device.signal(Signal::KILL);
    let status = haptics.wait(Duration::from_secs(15));
    let errors = text(dir.path(), "haptics.err");
    assert_eq!(status.code(), Some(1), "{errors}");
    assert!(errors.contains("device open:"), "{errors}");
}

/// Lines whose device time lies in `from..until`, s.
fn between(lines: &[truth::Line], from: f64, until: f64) -> Vec<&truth::Line> {
    let micros = |s: f64| s * 1e6;
    let inside = |l: &&truth::Line| (micros(from)..micros(until)).contains(&(l.micros as f64));
    lines.iter().filter(inside).collect()
}

/// In real time, over the pty: logic alone.
#[test]
fn faults_of_the_cable_stop_the_motors_and_the_session_goes_on_until_the_emergency_stop() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let stroke = stroke::press(dir.path());
    let faults = [
        "drop-frames@8:to-host",
        "flip-bits@9:to-device",
        "e-stop@10",
    ];
    let more = faults.map(|fault| ["--fault", fault]).concat();
    let mut device = fake_with(OSTEON, dir.path(), Some(&stroke), &more);
    let mut haptics = haptics(OSTEON, dir.path(), &[]);
    wait_for_press(dir.path());
    until("the last fault", Duration::from_secs(40), || {
        text(dir.path(), "fake.err").contains("e-stop")
    });
    std::thread::sleep(Duration::from_millis(500));
    assert!(haptics.runs(), "it stands in the fault and says so");
    haptics.signal(Signal::TERM);
    assert!(haptics.wait(Duration::from_secs(20)).success());
    device.signal(Signal::TERM);
    assert!(device.wait(Duration::from_secs(10)).success());
    let lines = truth::read(&dir.path().join("truth.csv"));
    for at in [8.0, 9.0] {
        let during = between(&lines, at + 0.03, at + 0.1);
        assert!(
            during.iter().all(|l| l.torque < 0.5),
            "a torque while nothing gets through, {at} s"
        );
        let after = between(&lines, at + 0.1, at + 1.0);
        assert!(after.iter().any(|l| l.torque > PRESSED), "{at} s: gone");
    }
    let stopped = between(&lines, 10.01, 1e3);
    assert!(!stopped.is_empty());
    assert!(stopped.iter().all(|l| !l.motors_on && l.torque < 1e-9));
    assert!(stopped.iter().any(|l| l.drive == "fault"));
}

#[test]
fn a_pulled_plug_ends_the_session_with_its_name() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let stroke = stroke::press(dir.path());
    let mut device = fake_with(OSTEON, dir.path(), Some(&stroke), &["--fault", "unplug@7"]);
    let mut haptics = haptics(OSTEON, dir.path(), &["--reconnect-for", "0"]);
    let status = haptics.wait(Duration::from_secs(40));
    let errors = text(dir.path(), "haptics.err");
    assert_eq!(status.code(), Some(1), "{errors}");
    assert!(errors.contains("gone"), "{errors}");
    std::thread::sleep(Duration::from_millis(100));
    device.signal(Signal::TERM);
    assert!(device.wait(Duration::from_secs(10)).success());
    let lines = truth::read(&dir.path().join("truth.csv"));
    let out = between(&lines, 7.05, 1e3);
    assert!(!out.is_empty() && out.iter().all(|l| !l.motors_on && l.torque < 1e-9));
}
