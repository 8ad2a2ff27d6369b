//! The house rules that a compiler does not check.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "what goes wrong here is a failed test"
)]

use osteon_tests::workspace;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Which of our crates a crate may depend on.
const MAY_USE: [(&str, &[&str]); 4] = [
    ("protocol", &[]),
    ("sim-core", &[]),
    ("firmware-bridge", &["sim-core", "protocol"]),
    ("viewer", &["sim-core", "protocol"]),
];

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Crates of ours that a manifest names, in whatever table and notation, itself left out.
fn ours(manifest: &str) -> BTreeSet<String> {
    let own = |line: &&str| !line.trim_start().starts_with("name");
    manifest
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default())
        .filter(own)
        .flat_map(|line| line.split("osteon-").skip(1))
        .map(|rest| {
            rest.chars()
                .take_while(|c| c.is_ascii_alphanumeric() || *c == '-')
                .collect()
        })
        .collect()
}

#[test]
fn crates_depend_only_downwards() {
    for (krate, allowed) in MAY_USE {
        let found = ours(&read(&workspace().join(krate).join("Cargo.toml")));
        // firmware-bridge names its own lean program
        for name in found.iter().filter(|name| *name != "haptics") {
            assert!(
                allowed.contains(&name.as_str()),
                "{krate} must not depend on {name}"
            );
        }
    }
    // controls: the reader sees every notation
    let all = "osteon-a.workspace = true\n[dependencies.osteon-b]\nx = { package = \"osteon-c\" }";
    assert_eq!(ours(all), ["a", "b", "c"].map(str::to_owned).into());
    let bridge = ours(&read(&workspace().join("firmware-bridge/Cargo.toml")));
    assert!(bridge.contains("sim-core") && bridge.contains("protocol"));
}

#[test]
fn the_haptics_program_has_no_graphics_crate_in_its_tree() {
    let tree = |package: &str| {
        let output = Command::new(env!("CARGO"))
            .args([
                "tree",
                "--locked",
                "--offline",
                "--edges",
                "normal",
                "--prefix",
                "none",
                "-p",
                package,
            ])
            .current_dir(workspace())
            .output()
            .expect("cargo tree");
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let banned = [
        "wgpu", "winit", "eframe", "egui", "ash ", "naga", "glow ", "x11rb", "wayland", "tokio",
    ];
    let bridge = tree("osteon-firmware-bridge");
    assert!(
        bridge.contains("serialport"),
        "a control: the tree is not empty"
    );
    for krate in banned {
        let found = bridge.lines().find(|l| l.starts_with(krate));
        assert_eq!(found, None, "in the tree of osteon-firmware-bridge");
    }
    assert!(
        tree("osteon-viewer").lines().any(|l| l.starts_with("wgpu")),
        "a control"
    );
}

#[test]
fn sim_core_keeps_the_roots_bans_and_adds_its_own() {
    let root = read(&workspace().join("clippy.toml"));
    let core = read(&workspace().join("sim-core/clippy.toml"));
    for line in root
        .lines()
        .filter(|l| !l.starts_with('#') && !l.is_empty())
    {
        assert!(core.contains(line), "sim-core/clippy.toml lacks: {line}");
    }
    for ban in ["Instant::now", "SystemTime::now", "File::open", "Mutex"] {
        assert!(core.contains(ban), "{ban}");
    }
}

fn sources(dir: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path
            .file_name()
            .and_then(|n| n.to_str())
            .unwrap_or_default();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn files_can_be_read_in_one_sitting() {
    let mut found = Vec::new();
    sources(&workspace(), &mut found);
    assert!(found.len() > 50);
    for path in found {
        let lines = read(&path).lines().count();
        assert!(
            lines <= 500,
            "{}: {lines} lines (500 is the wall)",
            path.display()
        );
    }
}

#[test]
fn the_numbers_name_no_clock_and_no_file() {
    let mut found = Vec::new();
    sources(&workspace().join("sim-core/src"), &mut found);
    for path in found {
        let text = read(&path);
        for word in [
            "mul_add(",
            "Instant::",
            "SystemTime",
            "std::fs",
            "std::io",
            "std::net",
            "std::thread",
        ] {
            assert!(!text.contains(word), "{}: {word}", path.display());
        }
    }
}
