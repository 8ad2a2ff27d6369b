//! The whole path: encoder counts to pixels, over a real pty, with every process.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use glam::DVec3;
use osteon_firmware_bridge::scene::{SceneArgs, load};
use osteon_tests::{data, json, number, one_at_a_time, run, skipped};
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");

/// Runs the demonstration headless with `more` options; its report, and what it said.
fn demo(dir: &Path, more: &[&str]) -> (Value, String) {
    let (out, png) = (dir.join("out.json"), dir.join("out.png"));
    let (out_text, png_text) = (out.display().to_string(), png.display().to_string());
    let mut args = vec![
        "demo",
        "--headless",
        "--seconds",
        "20",
        "--json",
        &out_text,
        "--screenshot",
        &png_text,
    ];
    args.extend(more);
    let output = run(OSTEON, &args, dir, Duration::from_mins(2));
    let errors = String::from_utf8_lossy(&output.stderr);
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{errors}");
    assert!(text.contains("Osteon session report"), "{text}");
    (json(&out), text.into_owned())
}

/// A planned axis in LPS: a point on it, mm, and its direction.
type Axis = (DVec3, DVec3);

fn vector(json: &Value, pointer: &str) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|n| number(json, &format!("{pointer}/{n}"))))
}

/// Distance of a point from the axis, mm.
fn off_axis(point: DVec3, (on, along): Axis) -> f64 {
    (point - on).cross(along).length() / along.length()
}

/// What the force loop bore: told whole, and consistent with itself.
fn check_loads(report: &Value) {
    let n = |path: &str| number(report, path);
    let real = n("/peak_physical_force_n") * n("/force_scale");
    // the vibration and the ramps come after
    assert!(real > 0.1 && real <= 3.3 + 1e-6, "{real}");
    assert!(n("/peak_spindle_nmm") > 0.0);
    assert!((0.0..=1.0).contains(&n("/peak_spindle_load")));
    for ticks in ["/saturated_ticks", "/stalled_ticks", "/clutched_ticks"] {
        assert!((0.0..=n("/ticks")).contains(&n(ticks)), "{ticks}");
    }
    let guards = report["guards"].as_object().expect("guards");
    let each = guards.values().filter_map(|g| g["count"].as_f64());
    assert!((each.sum::<f64>() - n("/guard_events")).abs() < 0.5);
    for guard in guards.values() {
        let last = guard["last_tick"].as_f64().unwrap_or(0.0);
        assert!(last <= n("/ticks"), "{guard}");
    }
}

/// What was removed: by the right tools, from the right bone, in the right place.
fn check_removal(report: &Value, axis: Axis) {
    let n = |pointer: &str| number(report, pointer);
    let (drill, ream) = (
        n("/removed_by_tool_mm3/peg_drill"),
        n("/removed_by_tool_mm3/reamer"),
    );
    assert!(ream > 100.0 && drill > 300.0, "{drill} {ream}");
    assert!((drill + ream - n("/removed_mm3")).abs() < 1e-6);
    let labels = report["removed_by_label_mm3"].as_object().expect("labels");
    for (label, mm3) in labels {
        assert!(label == "1" || label == "0", "label {label}: {mm3}");
    }
    assert!(labels["1"].as_f64() > Some(0.99 * (drill + ream)));
    let centroid = vector(report, "/removed_centroid_lps_mm");
    let off = off_axis(centroid, axis);
    assert!(off <= 3.0, "{off} mm off the axis");
    assert!((off - n("/removed_centroid_off_axis_mm")).abs() < 1e-6);
}

/// What holds on every bone. `axis` is the plan's, read past the program.
fn check(report: &Value, axis: Axis) {
    let n = |pointer: &str| number(report, pointer);
    assert!(n("/bone/solid_mm3") > 10_000.0);
    assert!(n("/bone/chunks_active") > 0.0 && n("/bone/chunks_active") < n("/bone/chunks_total"));
    for axis in 0..3 {
        assert!(n(&format!("/bone/dims/{axis}")) > 0.0);
        assert!(n(&format!("/bone/spacing_mm/{axis}")) > 0.0);
    }
    assert!(n("/ticks") >= 15_000.0, "{report:#}");
    assert!((n("/seconds") - 20.0).abs() < 1.0);
    let late: f64 = report["late_ticks_per_s"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(Value::as_f64)
        .sum();
    assert!(
        (late - n("/late_ticks")).abs() < 0.5,
        "seconds add up to the whole"
    );
    for latency in ["wake_us", "tick_us", "device_roundtrip_us"] {
        let q = ["p50", "p99", "p999", "max"].map(|q| n(&format!("/{latency}/{q}")));
        assert!(q[0] > 0.0 && q.is_sorted(), "{latency} {q:?}");
    }
    check_removal(report, axis);
    let force = n("/peak_force_n");
    assert!(force > 0.1 && force <= 3.3, "{force}");
    check_loads(report);
    assert!(n("/pose_rms_mm") <= 0.1 && n("/pose_samples") > 10_000.0);
    assert!(n("/device/frames") > 15_000.0);
    assert!(
        n("/device/crc_errors") < 1.0,
        "a cable of memory damages nothing"
    );
    // told, whatever they are: a busy machine may cost a frame
    for field in [
        "/device/gaps",
        "/device/watchdog_trips",
        "/viewer/frames_rendered",
    ] {
        number(report, field);
    }
    for joint in 0..3 {
        assert!(n(&format!("/device/last_torque_nmm/{joint}")).abs() < 1e-9);
    }
    let digest = &report["digest"];
    assert!(digest["servo"].is_string());
    assert_eq!(digest["servo"], digest["publisher"]);
    assert_eq!(digest["servo"], digest["viewer"]);
    assert!(n("/digest/changed_chunks") > 0.0);
    assert!(n("/viewer/updates") > 0.0 && n("/viewer/resyncs") >= 1.0);
}

/// The picture shows something; skipped aloud where no adapter draws.
fn check_picture(dir: &Path, report: &Value, said: &str) {
    if said.contains("no graphics adapter") {
        skipped("the picture: no graphics adapter here (apt install mesa-vulkan-drivers)");
        return;
    }
    assert!(number(report, "/viewer/frames_rendered") >= 1.0);
    let file = std::fs::File::open(dir.join("out.png")).expect("a picture");
    let decoder = png::Decoder::new(std::io::BufReader::new(file));
    let mut reader = decoder.read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut pixels).expect("pixels");
    assert_eq!((info.width, info.height), (1280, 720));
    let step = info.color_type.samples();
    // bone is light, the background dark
    let bone = pixels
        .chunks(step)
        .filter(|p| p[0] > 120 && p[0] >= p[2])
        .count();
    let share = bone as f64 / f64::from(info.width * info.height);
    assert!((0.02..0.6).contains(&share), "bone covers {share}");
}

#[test]
fn the_phantom_is_drilled_and_reamed() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (report, said) = demo(dir.path(), &[]);
    let scene = load(&SceneArgs::default(), &mut |_, _| {}).expect("the phantom");
    let lps_from_plan = scene.bone.lps_from_bone().then(&scene.bone_from_plan);
    let axis = (lps_from_plan.translation, lps_from_plan.vector(DVec3::Z));
    check(&report, axis);
    assert_eq!(report["ended"], "as asked");
    check_picture(dir.path(), &report, &said);
}

#[test]
fn a_real_shoulder_is_drilled_and_reamed_and_the_humerus_spared() {
    let Some(data) = data("the real shoulder") else {
        return;
    };
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let file = |name: &str| data.join(name).display().to_string();
    let (report, said) = demo(
        dir.path(),
        &[
            "--bone",
            &file("right_shoulder_ct.nii.gz"),
            "--labels",
            &file("right_shoulder_labels.nii.gz"),
            "--keep",
            "1",
            "--pose",
            &file("right_glenoid_pose.json"),
            "--threshold",
            "120",
        ],
    );
    let plan = json(&data.join("right_glenoid_pose.json"));
    let axis = (
        vector(&plan, "/glenoid_centre"),
        vector(&plan, "/glenoid_normal_outward"),
    );
    check(&report, axis);
    check_picture(dir.path(), &report, &said);
}

/// A constant push with parameters from a file: the report has the tip's way through the tissues, and the
/// parameters in force.
#[test]
fn a_push_is_reported_tissue_by_tissue() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (out, feel) = (dir.path().join("push.json"), dir.path().join("feel.toml"));
    std::fs::write(&feel, "[cancellous]\nenergy_n_per_mm2 = 30\n").expect("written");
    let (out_text, feel) = (out.display().to_string(), feel.display().to_string());
    let args = [
        "demo",
        "--headless",
        "--voxel-mm",
        "1.2",
        "--push",
        "2.5",
        "--seconds",
        "11",
        "--feel",
        &feel,
        "--json",
        &out_text,
    ];
    let output = run(OSTEON, &args, dir.path(), Duration::from_mins(1));
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}");
    assert!(text.contains("2.5 N pushed"), "{text}");
    let report = json(&out);
    let n = |pointer: &str| number(&report, pointer);
    assert!((n("/feel/cancellous.energy_n_per_mm2") - 30.0).abs() < 1e-9);
    assert!((n("/push_n") - 2.5).abs() < 1e-9);
    let first = &report["passages"][0];
    assert_eq!(first["tool"], "reamer", "{first}");
    assert_eq!(first["tissue"], "cartilage", "{first}");
    // how long it takes is a figure of the machine; that it came in, by the law's way, is not
    assert!(n("/passages/0/reached_mm") > 0.2, "{first}");
    assert!(n("/passages/0/expected_s") > 0.1, "{first}");
    assert!(n("/passages/0/mean_force_n") > 0.5 && n("/passages/0/peak_force_n") < 3.31);
    assert!(n("/removed_by_tool_mm3/reamer") > 0.0);
    assert!(n("/removed_by_tool_mm3/peg_drill") < 1e-9);
}
