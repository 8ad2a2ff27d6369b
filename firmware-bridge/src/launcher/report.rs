//! The report that ends a demonstration: text for people, JSON for machines.

use super::DemoArgs;
use super::supervise::Files;
use super::truth::{last_torque, pose_error};
use anyhow::Context as _;
use serde_json::{Value, json};
use std::process::ExitStatus;

/// Joins the processes' reports, writes the JSON, prints the text.
pub(crate) fn write(
    args: &DemoArgs,
    files: &Files,
    viewer: Option<&ExitStatus>,
) -> anyhow::Result<()> {
    let haptics = files.path("haptics.json");
    let Ok(bytes) = std::fs::read(&haptics) else {
        // the haptics process ended before it could report; it has said why
        return Ok(());
    };
    let mut report: Value = serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: not a report", haptics.display()))?;
    join(&mut report, files, viewer)?;
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&report)?;
        std::fs::write(path, text + "\n")
            .with_context(|| format!("{}: cannot write", path.display()))?;
    }
    say(&text(&report, args));
    Ok(())
}

fn join(report: &mut Value, files: &Files, viewer: Option<&ExitStatus>) -> anyhow::Result<()> {
    let truth = files.path("truth.csv");
    match pose_error(&files.path("poses.csv"), &truth) {
        Ok(error) => {
            report["pose_rms_mm"] = json!(error.rms_mm);
            report["pose_max_mm"] = json!(error.max_mm);
            report["pose_samples"] = json!(error.samples);
        }
        Err(e) => {
            report["pose_rms_mm"] = Value::Null;
            report["pose_problem"] = json!(format!("{e:#}"));
        }
    }
    report["device"]["last_torque_nmm"] = json!(last_torque(&truth)?);
    if let Ok(bytes) = std::fs::read(files.path("viewer.json"))
        && let Ok(details) = serde_json::from_slice::<Value>(&bytes)
    {
        report["viewer"]["process"] = details;
    }
    report["viewer"]["exit"] = json!(viewer.map(ToString::to_string));
    Ok(())
}

/// The report for people.
fn text(report: &Value, args: &DemoArgs) -> String {
    let number = |path: &str, digits: usize| {
        report
            .pointer(path)
            .and_then(Value::as_f64)
            .map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
    };
    let quantiles = |path: &str| {
        ["p50", "p99", "p999", "max"]
            .map(|q| number(&format!("{path}/{q}"), 0))
            .join(" / ")
    };
    let word = |path: &str| {
        report
            .pointer(path)
            .and_then(Value::as_str)
            .unwrap_or("-")
            .to_owned()
    };
    let mut lines = vec![
        "Osteon session report".to_owned(),
        format!("  bone        {}", word("/bone/source")),
        format!(
            "              {} mm3 solid, {} of {} chunks, voxels {}",
            number("/bone/solid_mm3", 0),
            number("/bone/chunks_active", 0),
            number("/bone/chunks_total", 0),
            report["bone"]["spacing_mm"]
        ),
        format!(
            "  removed     {} mm3: peg drill {}, reamer {}; centroid {} mm off the planned axis",
            number("/removed_mm3", 1),
            number("/removed_by_tool_mm3/peg_drill", 1),
            number("/removed_by_tool_mm3/reamer", 1),
            number("/removed_centroid_off_axis_mm", 2)
        ),
        format!(
            "  force       peak {} N at the stylus",
            number("/peak_force_n", 2)
        ),
        format!(
            "  servo       {} ticks in {} s, {} late (> 0.5 ms), {} periods skipped",
            number("/ticks", 0),
            number("/seconds", 1),
            number("/late_ticks", 0),
            number("/skipped_periods", 0)
        ),
        "              p50 / p99 / p99.9 / max, us".to_owned(),
        format!("    wake-up   {}", quantiles("/wake_us")),
        format!("    tick      {}", quantiles("/tick_us")),
        format!("    device    {}", quantiles("/device_roundtrip_us")),
        format!(
            "  device      {} frames, {} bad, {} missing, {} watchdog trips; pose error {} mm RMS",
            number("/device/frames", 0),
            number("/device/crc_errors", 0),
            number("/device/gaps", 0),
            number("/device/watchdog_trips", 0),
            number("/pose_rms_mm", 3)
        ),
        format!(
            "  viewer      {} frames, {} bricks, {} starts from empty ({})",
            number("/viewer/frames_rendered", 0),
            number("/viewer/updates", 0),
            number("/viewer/resyncs", 0),
            word("/viewer/process/adapter")
        ),
        format!(
            "  digest      servo {}, publisher {}, viewer {} over {} chunks",
            word("/digest/servo"),
            word("/digest/publisher"),
            word("/digest/viewer"),
            number("/digest/changed_chunks", 0)
        ),
        format!("  ended       {}", word("/ended")),
    ];
    for (name, file) in [("picture", &args.screenshot), ("json", &args.json)] {
        if let Some(path) = file.as_ref().filter(|p| p.exists()) {
            lines.push(format!("  {name:<11} {}", path.display()));
        }
    }
    lines.join("\n")
}

#[expect(clippy::print_stdout, reason = "the report of a command-line program")]
pub(crate) fn say(text: &str) {
    println!("{text}");
}
