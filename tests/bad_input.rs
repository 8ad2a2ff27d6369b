//! Bad input: one line on stderr that names what, where and the remedy; exit code not 0.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_tests::failed;
use std::fs;
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");

fn refused(dir: &Path, args: &[&str], words: &[&str]) {
    osteon_tests::refused(OSTEON, dir, args, words);
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

/// A file's name, its bytes, words that the error must hold.
type Spoilt<'a> = (&'a str, &'a [u8], &'a [&'a str]);

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

/// Zipped without squeezing: a cut file holds what it says.
fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::none());
    out.write_all(bytes).expect("zipped");
    out.finish().expect("zipped")
}

/// A copy of `bytes` with `patch` at `at`.
fn patched(bytes: &[u8], at: usize, patch: &[u8]) -> Vec<u8> {
    let mut copy = bytes.to_vec();
    copy[at..at + patch.len()].copy_from_slice(patch);
    copy
}

/// Writes a file into a test's folder; its path.
fn file(dir: &Path, name: &str, bytes: &[u8]) -> String {
    fs::write(dir.join(name), bytes).expect("written");
    dir.join(name).display().to_string()
}

const PLAN: &[u8] = br#"{"glenoid_centre": [-8, -8, 12], "glenoid_normal_outward": [0, 0, 1]}"#;

/// Both programs that load a bone refuse this one.
fn bone_refused(dir: &Path, name: &str, words: &[&str]) {
    let plan = file(dir, "plan.json", PLAN);
    let bone = dir.join(name).display().to_string();
    let all = [&[name], words].concat();
    refused(dir, &["haptics", "--bone", &bone, "--pose", &plan], &all);
    refused(
        dir,
        &["demo", "--headless", "--bone", &bone, "--pose", &plan],
        &all,
    );
}

#[test]
fn volumes_that_cannot_be_read() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let good = volume(16);
    bone_refused(dir, "missing.nii", &["cannot be read"]);
    let cases: [Spoilt<'_>; 8] = [
        (
            "truncated.nii",
            &good[..5000],
            &["truncated", "8192", "4648"],
        ),
        (
            "truncated.nii.gz",
            &gzip(&good)[..5000],
            &["truncated", "8192"],
        ),
        ("words.nii.gz", b"no gzip at all", &["NIfTI"]),
        ("words.nii", b"no volume", &["NIfTI", "dcm2niix"]),
        ("short.nii", &good[..100], &["truncated", "348", "100"]),
        ("magic.nii", &patched(&good, 344, b"abcd"), &["NIfTI"]),
        // datatype 32: complex numbers
        ("complex.nii", &patched(&good, 70, &[32, 0]), &["complex"]),
        (
            "huge.nii",
            &header([30_000, 30_000, 30_000], 4, 1.0),
            &["dim[1]", "4096"],
        ),
    ];
    for (name, bytes, words) in cases {
        file(dir, name, bytes);
        bone_refused(dir, name, words);
    }
}

#[test]
fn text_cts_that_cannot_be_read() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    bone_refused(dir, "missing.txt", &["cannot be read"]);
    let lines: Vec<String> = (0..4000).map(|n| format!("{n} {n} {n} 500\n")).collect();
    let diagonal = lines.concat();
    let cases: [Spoilt<'_>; 8] = [
        ("empty.txt", b"# nothing\n", &["no voxel", "x y z density"]),
        (
            "words.txt",
            b"x y z d\n0 0 0 1\n0 0 bone 1\n",
            &["line 3", "`bone`"],
        ),
        (
            "comma.csv",
            b"0,5 1,5 0,5 9\n",
            &["line 1", "decimal point"],
        ),
        (
            "far.xyz",
            b"0 0 0 1\n1e9 1 1 1\n",
            &["line 2", "x = 1000000000", "mm"],
        ),
        (
            "dense.txt",
            b"0 0 0 70000\n",
            &["line 1", "density = 70000"],
        ),
        (
            "uneven.txt",
            b"0 0 0 1\n1 1 1 1\n2 2 2 1\n3 3 3 1\n4.5 4 4 1\n",
            &["line 5", "x = 4.5", "every 1 mm", "resample"],
        ),
        (
            "twice.txt",
            b"0 0 0 1\n1 1 1 1\n0 0 0 2\n",
            &["line 3", "already on line 1", "remove"],
        ),
        (
            "huge.txt",
            diagonal.as_bytes(),
            &["[4000, 4000, 4000]", "64000000000", "crop"],
        ),
    ];
    for (name, bytes, words) in cases {
        file(dir, name, bytes);
        bone_refused(dir, name, words);
    }
}

#[test]
fn volumes_without_sense() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let good = volume(16);
    let small = |datatype, voxel: &[u8]| {
        let mut bytes = header([16, 16, 16], datatype, 1.0);
        bytes.extend(voxel.repeat(4096));
        bytes
    };
    let (zero, nan) = (0f32.to_le_bytes(), f32::NAN.to_le_bytes());
    let cases: [Spoilt<'_>; 4] = [
        ("flat.nii", &patched(&good, 80, &zero), &["pixdim[1]", "0"]),
        (
            "nowhere.nii",
            &patched(&good, 84, &nan),
            &["pixdim[2]", "NaN"],
        ),
        ("nan.nii", &small(16, &nan), &["no bone", "--threshold"]),
        ("empty.nii", &small(4, &[0, 0]), &["no bone", "--threshold"]),
    ];
    for (name, bytes, words) in cases {
        file(dir, name, bytes);
        bone_refused(dir, name, words);
    }
}

#[test]
fn labels_and_thresholds_that_do_not_fit() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let bone = file(dir, "bone.nii", &volume(16));
    let plan = file(dir, "plan.json", PLAN);
    let twos = [
        header([16, 16, 16], 4, 1.0),
        2i16.to_le_bytes().repeat(4096),
    ]
    .concat();
    file(dir, "other.nii", &volume(12));
    file(dir, "twos.nii", &twos);
    let start = ["haptics", "--bone", &bone, "--pose", &plan];
    for (labels, words) in [
        ("other.nii", ["bone.nii", "grid", "resample"]),
        ("twos.nii", ["no voxel", "label 1", "--keep one of: 2"]),
        ("absent.nii", ["absent.nii", "cannot be read", "check"]),
    ] {
        let path = dir.join(labels).display().to_string();
        let args = [&start[..], &["--labels", &path, "--keep", "1"]].concat();
        refused(dir, &args, &[&[labels], &words[..]].concat());
    }
    refused(dir, &start[..3], &["bone.nii", "--pose"]);
    refused(
        dir,
        &[&start[..], &["--threshold", "2500"]].concat(),
        &["bone.nii", "no bone above 2500", "--threshold"],
    );
    // the control: with a good plan and a good volume the next thing missing is the device
    refused(
        dir,
        &[&start[..], &["--device", "open:/x"]].concat(),
        &["open:/x", "no such port"],
    );
}

#[test]
fn plans_that_lead_nowhere() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let bone = file(dir, "bone.nii", &volume(16));
    let plan = |centre: &str, outward: &str| {
        format!(r#"{{"glenoid_centre": {centre}, "glenoid_normal_outward": {outward}}}"#)
    };
    let no_outward = r#"{"glenoid_centre": [0, 0, 0]}"#.to_owned();
    for (name, text, word) in [
        ("none.json", no_outward, "glenoid_normal_outward is missing"),
        (
            "zero.json",
            plan("[0, 0, 0]", "[0, 0, 0]"),
            "glenoid_normal_outward",
        ),
        (
            "words.json",
            plan(r#"["x", 0, 0]"#, "[0, 0, 1]"),
            "glenoid_centre",
        ),
        (
            "null.json",
            plan("[0, 0, null]", "[0, 0, 1]"),
            "glenoid_centre",
        ),
        ("torn.json", plan("[0, 0", ""), "correct the file"),
        ("nan.json", plan("[NaN, 0, 0]", "[0, 0, 1]"), "not JSON"),
        (
            "endless.json",
            plan("[0, 1e999, 0]", "[0, 0, 1]"),
            "out of range",
        ),
        (
            "far.json",
            plan("[900, 0, 0]", "[0, 0, 1]"),
            "outside the bone",
        ),
    ] {
        let path = file(dir, name, text.as_bytes());
        let args = ["haptics", "--bone", &bone, "--pose", &path];
        refused(dir, &args, &[name, word]);
    }
}

#[test]
fn tools_that_cannot_be() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    // a header of ten million triangles
    let mut huge = [0u8; 84];
    huge[80..].copy_from_slice(&10_000_000u32.to_le_bytes());
    file(dir, "huge.stl", &huge);
    file(dir, "empty.stl", b"");
    let tool = |id: &str, shape: &str| {
        format!("[[tool]]\nname = 'X'\nid = '{id}'\nrpm = 900\nlips = 2\n{shape}\n")
    };
    let ball = "[[tool.part]]\nball = { radius_mm = 3, centre_mm = 3 }";
    let mesh = |name: &str| tool("x", &format!("[tool.mesh]\nfile = '{name}'"));
    for (name, text, words) in [
        ("words.toml", "no tools".to_owned(), ["line 1", "examples"]),
        ("none.toml", String::new(), ["0 tools", "1 to 8"]),
        (
            "open.toml",
            tool("x", "[[tool.part]]\ncylinder = { radius_mm = 3 }"),
            ["part 1", "from_mm"],
        ),
        ("huge.toml", mesh("huge.stl"), ["huge.stl", "decimate"]),
        (
            "empty.toml",
            mesh("empty.stl"),
            ["empty.stl", "no triangle"],
        ),
        (
            "lost.toml",
            mesh("lost.stl"),
            ["lost.stl", "check the path"],
        ),
    ] {
        let path = file(dir, name, text.as_bytes());
        refused(dir, &["haptics", "--tools", &path], &words);
        refused(dir, &["demo", "--headless", "--tools", &path], &words);
    }
    let missing = dir.join("missing.toml").display().to_string();
    refused(
        dir,
        &["haptics", "--tools", &missing],
        &["missing.toml", "--tools"],
    );
    // one tool is enough for a session, not for the demonstration
    let one = file(dir, "one.toml", tool("x", ball).as_bytes());
    let args = ["demo", "--headless", "--voxel-mm", "2", "--tools", &one];
    refused(
        dir,
        &args,
        &["1 tool", "a drill and a reamer", "osteon haptics"],
    );
}

#[test]
fn feels_that_cannot_be() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let large = b"#".repeat(70_000);
    let cases: [Spoilt<'_>; 8] = [
        (
            "words.toml",
            b"force_scale is low",
            &["line 1", "standard.toml"],
        ),
        ("binary.toml", b"\n\xff\xfe", &["line 2", "UTF-8"]),
        (
            "unknown.toml",
            b"[coupling]\nstifness = 1",
            &["line 2", "coupling.stifness", "coupling.stiffness_n_per_mm"],
        ),
        (
            "type.toml",
            b"[law]\nfeed_ratio = '1'",
            &["line 2", "law.feed_ratio", "string", "give a number"],
        ),
        (
            "range.toml",
            b"[coupling]\n\nstiffness_n_per_mm = 5",
            &[
                "line 3",
                "coupling.stiffness_n_per_mm",
                "5 N/mm",
                "0.05 to 0.7",
            ],
        ),
        (
            "nan.toml",
            b"force_scale = nan",
            &["force_scale", "NaN", "0.001 to 1"],
        ),
        (
            "twice.toml",
            b"[law]\nfeed_ratio = 1\nfeed_ratio = 1",
            &["line 3", "duplicate"],
        ),
        ("large.toml", &large, &["64 KiB", "--feel"]),
    ];
    for (name, bytes, words) in cases {
        let path = file(dir, name, bytes);
        let all = [&[name], words].concat();
        refused(dir, &["haptics", "--feel", &path], &all);
        refused(dir, &["demo", "--headless", "--feel", &path], &all);
    }
    let missing = dir.join("missing.toml").display().to_string();
    let words = ["missing.toml", "cannot be read", "--feel"];
    refused(dir, &["haptics", "--feel", &missing], &words);
    refused(
        dir,
        &["haptics", "--print-feel", "--feel", &missing],
        &words,
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

/// Values that the command line itself refuses: exit code 2, the first line says what and why.
#[test]
fn options_that_make_no_sense() {
    let dir = tempfile::tempdir().expect("a folder");
    for (args, words) in [
        (
            &["haptics", "--seconds", "nan"][..],
            ["--seconds", "nan", "positive number"],
        ),
        (
            &["demo", "--seconds", "0"],
            ["--seconds", "'0'", "positive number"],
        ),
        (
            &["haptics", "--force-limit", "99"],
            ["--force-limit", "99", "3.3 N"],
        ),
        (
            &["haptics", "--force-limit", "nan"],
            ["--force-limit", "nan", "positive number"],
        ),
        (
            &["fake-omni", "--seconds", "inf"],
            ["--seconds", "inf", "above 0"],
        ),
        (
            &["demo", "--push", "0"],
            ["--push", "'0'", "newtons above 0, at most 3"],
        ),
        (
            &["demo", "--push", "3.1"],
            ["--push", "3.1", "newtons above 0, at most 3"],
        ),
        (&["demo", "--push", "nan"], ["--push", "nan", "at most 3"]),
        (
            &["demo", "--disturb-viewer", "burn@1"],
            ["--disturb-viewer", "burn@1", "kill@SECOND"],
        ),
        (
            &["view", "--offscreen", "x.png", "--size", "0x0"],
            ["--size", "0x0", "16 to 8192"],
        ),
        (
            &["haptics", "--keep", "1"],
            ["required", "not provided", "error"],
        ),
    ] {
        let errors = failed(OSTEON, dir.path(), args, 2);
        let first = errors.lines().next().unwrap_or_default();
        for word in words {
            assert!(first.contains(word), "{args:?}: no '{word}' in {errors}");
        }
    }
    for (option, value, word) in [
        ("--voxel-mm", "nan", "0.05"),
        ("--voxel-mm", "0", "0.05"),
        ("--voxel-mm", "0.001", "0.05"),
        ("--threshold", "nan", "CT number"),
    ] {
        refused(dir.path(), &["haptics", option, value], &[option, word]);
    }
}
