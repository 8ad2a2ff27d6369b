//! Bad input: one line on stderr that names what, where and the remedy; exit code not 0.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_protocol::device::{DEVICE_SCHEMA, DeviceHello, DeviceMessage};
use osteon_protocol::frame::{MAX_FRAME, encode};
use osteon_tests::{fake, haptics, one_at_a_time, run};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");

/// Runs `osteon` with `args`: must fail within 20 s with one line that holds all of `words`.
fn refused(dir: &Path, args: &[&str], words: &[&str]) {
    let output = run(OSTEON, args, dir, Duration::from_secs(20));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{args:?} succeeded");
    assert!(output.status.code().is_some(), "{args:?} was killed");
    assert_eq!(errors.lines().count(), 1, "{args:?}:\n{errors}");
    for word in words {
        assert!(errors.contains(word), "{args:?}: no '{word}' in {errors}");
    }
}

/// A NIfTI-1 header of a small 16-bit volume; tests spoil it.
fn header(dims: [i16; 3], datatype: i16, spacing: f32) -> Vec<u8> {
    let mut h = vec![0u8; 352];
    h[0..4].copy_from_slice(&348i32.to_le_bytes());
    for (n, d) in [3, dims[0], dims[1], dims[2], 1, 1, 1, 1]
        .into_iter()
        .enumerate()
    {
        h[40 + 2 * n..42 + 2 * n].copy_from_slice(&d.to_le_bytes());
    }
    h[70..72].copy_from_slice(&datatype.to_le_bytes());
    h[72..74].copy_from_slice(&16i16.to_le_bytes());
    for n in 0..4 {
        let value = if n == 0 { 1.0 } else { spacing };
        h[76 + 4 * n..80 + 4 * n].copy_from_slice(&value.to_le_bytes());
    }
    h[108..112].copy_from_slice(&352f32.to_le_bytes());
    h[344..348].copy_from_slice(b"n+1\0");
    h
}

/// A file's name, its bytes (none: it is missing), words that the error must hold.
type Spoilt<'a> = (&'a str, Option<&'a [u8]>, &'a [&'a str]);

/// A cube of bone in air, `n` voxels along each edge.
fn volume(n: i16) -> Vec<u8> {
    let mut bytes = header([n, n, n], 4, 1.0);
    let inside = |v: i16| v > n / 4 && v < 3 * n / 4;
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                let hu: i16 = if inside(i) && inside(j) && inside(k) {
                    800
                } else {
                    -900
                };
                bytes.extend_from_slice(&hu.to_le_bytes());
            }
        }
    }
    bytes
}

const PLAN: &str = r#"{"glenoid_centre": [-8, -8, 12], "glenoid_normal_outward": [0, 0, 1]}"#;

#[test]
fn volumes_that_cannot_be_read() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let plan = dir.join("plan.json").display().to_string();
    fs::write(&plan, PLAN).expect("written");
    let good = volume(16);
    let no_magic = {
        let mut b = good.clone();
        b[344..348].copy_from_slice(b"abcd");
        b
    };
    let complex = {
        let mut b = good.clone();
        b[70..72].copy_from_slice(&32i16.to_le_bytes());
        b
    };
    let flat = {
        let mut b = good.clone();
        b[80..84].copy_from_slice(&0f32.to_le_bytes());
        b
    };
    let huge = header([30_000, 30_000, 30_000], 4, 1.0);
    let empty = {
        let mut b = header([16, 16, 16], 4, 1.0);
        b.resize(352 + 2 * 4096, 0);
        b
    };
    let cases: [Spoilt<'_>; 8] = [
        ("missing.nii", None, &["missing.nii"]),
        (
            "truncated.nii",
            Some(&good[..5000]),
            &["truncated", "8192", "4648"],
        ),
        ("short.nii", Some(&good[..100]), &["short.nii"]),
        ("magic.nii", Some(&no_magic), &["NIfTI"]),
        ("complex.nii", Some(&complex), &["complex"]),
        ("flat.nii", Some(&flat), &["flat.nii", "pixdim"]),
        ("huge.nii", Some(&huge), &["dim[1]", "4096"]),
        ("empty.nii", Some(&empty), &["no bone", "--threshold"]),
    ];
    for (name, bytes, words) in cases {
        let path = dir.join(name).display().to_string();
        if let Some(bytes) = bytes {
            fs::write(&path, bytes).expect("written");
        }
        let mut all = vec![name];
        all.extend(words);
        refused(dir, &["haptics", "--bone", &path, "--pose", &plan], &all);
        refused(
            dir,
            &["demo", "--headless", "--bone", &path, "--pose", &plan],
            &all,
        );
    }
}

#[test]
fn labels_and_plans_that_do_not_fit() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let file = |name: &str, bytes: &[u8]| {
        fs::write(dir.join(name), bytes).expect("written");
        dir.join(name).display().to_string()
    };
    let bone = file("bone.nii", &volume(16));
    let other = file("other.nii", &volume(12));
    let plan = file("plan.json", PLAN.as_bytes());
    refused(
        dir,
        &[
            "haptics", "--bone", &bone, "--labels", &other, "--pose", &plan,
        ],
        &["other.nii", "bone.nii", "grid", "resample"],
    );
    refused(dir, &["haptics", "--bone", &bone], &["bone.nii", "--pose"]);
    for (name, text, word) in [
        (
            "none.json",
            r#"{"glenoid_centre": [0, 0, 0]}"#,
            "glenoid_normal_outward",
        ),
        (
            "zero.json",
            r#"{"glenoid_centre": [0, 0, 0], "glenoid_normal_outward": [0, 0, 0]}"#,
            "glenoid_normal_outward",
        ),
        (
            "words.json",
            r#"{"glenoid_centre": ["x", 0, 0], "glenoid_normal_outward": [0, 0, 1]}"#,
            "words.json",
        ),
        ("torn.json", r#"{"glenoid_centre": [0, 0"#, "torn.json"),
    ] {
        let path = file(name, text.as_bytes());
        refused(
            dir,
            &["haptics", "--bone", &bone, "--pose", &path],
            &[name, word],
        );
    }
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
        &[&device, "another protocol", "5b 32"],
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

#[test]
fn viewers_and_folders_that_cannot_be() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let nobody = dir.join("nobody.sock").display().to_string();
    refused(
        dir,
        &["view", "--mirror-only", "--socket", &nobody],
        &[&nobody, "start one"],
    );
    let open = dir.join("open");
    fs::create_dir(&open).expect("made");
    fs::set_permissions(&open, fs::Permissions::from_mode(0o777)).expect("opened");
    let socket = open.join("s.sock").display().to_string();
    refused(
        dir,
        &["haptics", "--voxel-mm", "2", "--socket", &socket],
        &["open", "chmod 700"],
    );
    refused(
        dir,
        &["fake-omni", "--stroke", "/none.json"],
        &["/none.json", "--stroke"],
    );
}
