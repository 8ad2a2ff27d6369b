//! Ports that are no device, or somebody else's: one line on stderr, exit code not 0.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_protocol::device::{DEVICE_SCHEMA, DeviceHello, DeviceMessage};
use osteon_protocol::frame::{MAX_FRAME, encode};
use osteon_tests::{fake, haptics, one_at_a_time};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");

fn refused(dir: &Path, args: &[&str], words: &[&str]) {
    osteon_tests::refused(OSTEON, dir, args, words);
}

/// A port with a peer that sends `bytes` again and again and listens to nothing.
fn babble(bytes: Vec<u8>) -> String {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a pty");
    grantpt(&master).expect("granted");
    unlockpt(&master).expect("unlocked");
    let name = ptsname(&master, Vec::new()).expect("a name");
    let path = name.into_string().expect("text");
    // raw from the beginning, and open for as long as the peer speaks
    let slave = fs::OpenOptions::new()
        .read(true)
        .write(true)
        .open(&path)
        .expect("the port");
    let mut settings = rustix::termios::tcgetattr(&slave).expect("settings");
    settings.make_raw();
    rustix::termios::tcsetattr(&slave, rustix::termios::OptionalActions::Now, &settings)
        .expect("raw");
    std::thread::Builder::new()
        .name("babble".to_owned())
        .spawn(move || {
            let _open = slave;
            let mut master = fs::File::from(master);
            let mut heard = [0; 1024];
            for _ in 0..400 {
                if !bytes.is_empty() && master.write_all(&bytes).is_err() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
                let _ = bytes.is_empty() || master.read(&mut heard).is_ok();
            }
        })
        .expect("a thread");
    path
}

#[test]
fn ports_that_are_no_device() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    refused(
        dir,
        &["haptics", "--device", "open:/dev/osteon-none"],
        &["open:/dev/osteon-none", "no such port", "fake-omni"],
    );
    refused(
        dir,
        &["haptics", "--device", "foo:bar"],
        &["foo:bar", "open:PATH"],
    );
    let file = dir.join("a-file");
    fs::write(&file, "x").expect("written");
    let device = format!("open:{}", file.display());
    refused(
        dir,
        &["haptics", "--device", &device],
        &["a-file", "not a serial port"],
    );

    let device = format!("open:{}", babble(b"[2,0,0,0,0,0,0,0]\n".to_vec()));
    refused(
        dir,
        &["haptics", "--device", &device],
        &[&device, "text protocol of hfab", "hfab:"],
    );
    let device = format!("open:{}", babble(Vec::new()));
    refused(
        dir,
        &["haptics", "--device", &device],
        &[&device, "nothing answered"],
    );

    let hello = DeviceMessage::Hello(DeviceHello {
        version: 77,
        schema: DEVICE_SCHEMA,
        model: 1,
        serial: 1,
        counts_per_rev: 15_000,
        gimbal_counts_per_rev: 16_384,
        dac_max: 2047,
        micro_nm_per_count: 215,
        period_micros: 1000,
    });
    let mut frame = [0; MAX_FRAME];
    let bytes = encode(&hello, &mut frame).expect("a frame").to_vec();
    let device = format!("open:{}", babble(bytes));
    refused(
        dir,
        &["haptics", "--device", &device],
        &[&device, "version 77", "update"],
    );
}

#[test]
fn a_second_program_on_the_port_and_on_the_socket() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, None);
    let _first = haptics(OSTEON, dir, &[]);
    let device = format!("open:{}", dir.join("omni").display());
    refused(
        dir,
        &["haptics", "--voxel-mm", "2", "--device", &device],
        &[&device, "another program"],
    );
    let socket = osteon_tests::socket(dir).display().to_string();
    refused(
        dir,
        &["haptics", "--voxel-mm", "2", "--socket", &socket],
        &[&socket, "another haptics process"],
    );
}
