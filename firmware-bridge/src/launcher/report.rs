//! The report that ends a demonstration: text for people, JSON for machines.

use super::DemoArgs;
use super::plan::{Plan, Push};
use super::supervise::Files;
use super::truth::{last_torque, pose_error};
use anyhow::Context as _;
use serde_json::{Value, json};
use std::process::ExitStatus;

/// Joins the processes' reports, writes the JSON, prints the text.
pub(crate) fn write(
    args: &DemoArgs,
    files: &Files,
    plan: &Plan,
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
    if let Some(push) = &plan.push {
        join_push(&mut report, push);
    }
    let written = match &args.json {
        Some(path) => std::fs::write(path, format!("{report:#}\n"))
            .with_context(|| format!("{}: cannot write", path.display())),
        None => Ok(()),
    };
    // a file that cannot be written must not cost the people their report
    say(&text(&report, args));
    written
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

/// What the cutting law alone expects of the push, beside what was measured.
fn join_push(report: &mut Value, push: &Push) {
    report["push_n"] = json!(push.newtons);
    let Some(passages) = report["passages"].as_array_mut() else {
        return;
    };
    let of_tool = passages.iter_mut().filter(|p| p["tool"] == push.tool);
    for (passage, expected) in of_tool.zip(&push.expected_s) {
        passage["expected_s"] = json!(expected);
    }
}

/// Reads figures out of the joined report, for people: `-` where one is missing.
struct Figures<'a>(&'a Value);

impl Figures<'_> {
    fn number(&self, path: &str, digits: usize) -> String {
        self.0
            .pointer(path)
            .and_then(Value::as_f64)
            .map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
    }

    fn quantiles(&self, path: &str) -> String {
        ["p50", "p99", "p999", "max"]
            .map(|q| self.number(&format!("{path}/{q}"), 0))
            .join(" / ")
    }

    fn word(&self, path: &str) -> &str {
        self.0.pointer(path).and_then(Value::as_str).unwrap_or("-")
    }

    /// What each tool has removed, in the order of their names.
    fn by_tool(&self) -> String {
        let Some(tools) = self.0["removed_by_tool_mm3"].as_object() else {
            return "-".to_owned();
        };
        let each = tools.iter().map(|(id, mm3)| {
            let mm3 = mm3.as_f64().unwrap_or(0.0);
            format!("{} {mm3:.1}", id.replace('_', " "))
        });
        each.collect::<Vec<_>>().join(", ")
    }

    fn bone(&self) -> String {
        format!(
            "  bone        {}\n              {} mm3 solid, {} of {} chunks, voxels {} mm\n  \
             removed     {} mm3: {}; centroid {} mm off the planned axis\n{}",
            self.word("/bone/source"),
            self.number("/bone/solid_mm3", 0),
            self.number("/bone/chunks_active", 0),
            self.number("/bone/chunks_total", 0),
            self.0["bone"]["spacing_mm"],
            self.number("/removed_mm3", 1),
            self.by_tool(),
            self.number("/removed_centroid_off_axis_mm", 2),
            self.loads()
        )
    }

    /// Force, spindle and guards.
    fn loads(&self) -> String {
        format!(
            "  force       peak {} N at the stylus ({} N at a real tool, scale {}), limit reached in {} ticks\n  \
             spindle     peak {} Nmm of cut ({} of what the motor has), stalled in {} ticks\n  \
             guards      {}",
            self.number("/peak_force_n", 2),
            self.number("/peak_physical_force_n", 1),
            self.0["force_scale"]
                .as_f64()
                .map_or_else(|| "-".to_owned(), |scale| scale.to_string()),
            self.number("/saturated_ticks", 0),
            self.number("/peak_spindle_nmm", 0),
            self.number("/peak_spindle_load", 2),
            self.number("/stalled_ticks", 0),
            self.guards()
        )
    }

    /// The guards that intervened: in how many ticks, and when last.
    fn guards(&self) -> String {
        let Some(guards) = self.0["guards"].as_object() else {
            return "-".to_owned();
        };
        let each = guards.iter().filter_map(|(name, guard)| {
            let last = guard["last_tick"].as_f64()?;
            let name = name.replace('_', " ");
            Some(format!(
                "{name} {} (last at {:.1} s)",
                guard["count"],
                last * 1e-3
            ))
        });
        let each = each.collect::<Vec<_>>();
        if each.is_empty() {
            return "none had to act".to_owned();
        }
        format!(
            "{} ticks: {}",
            self.number("/guard_events", 0),
            each.join(", ")
        )
    }

    /// What another voxel size than the CT's own costs; nothing where it was not asked for.
    fn resampling(&self) -> Option<String> {
        self.0
            .pointer("/bone/resample_error")
            .filter(|e| !e.is_null())?;
        Some(format!(
            "  resampled   surface off by {} mm RMS, {} mm at most ({} points)",
            self.number("/bone/resample_error/surface_rms_mm", 3),
            self.number("/bone/resample_error/surface_max_mm", 3),
            self.number("/bone/resample_error/surface_points", 0)
        ))
    }

    /// Time and force of each tool in each layer; nothing where no tool came near.
    fn passages(&self) -> Option<String> {
        let passages = self.0["passages"].as_array().filter(|p| !p.is_empty())?;
        let push = match self.0["push_n"].as_f64() {
            Some(push) => format!(", {push} N pushed"),
            None => String::new(),
        };
        let mut lines = vec![format!(
            "  passages    of the tip, along the planned axis{push}"
        )];
        lines.extend(passages.iter().map(|p| Figures(p).passage()));
        Some(lines.join("\n"))
    }

    /// One of them; the figures are those of the passage.
    fn passage(&self) -> String {
        let layer = format!(
            "    {:<9} {:<11} {} to {} mm",
            self.word("/tool").replace('_', " "),
            self.word("/tissue"),
            self.number("/from_mm", 1),
            self.number("/to_mm", 1)
        );
        let time = match (self.0["seconds"].as_f64(), self.0["reached_mm"].as_f64()) {
            (Some(s), _) => format!("{s:.2} s"),
            (None, Some(depth)) => {
                let inside = self.number("/inside_s", 2);
                format!("not passed in {inside} s, came to {depth:.2} mm")
            }
            (None, None) => "not reached".to_owned(),
        };
        let expected = match self.0.get("expected_s") {
            Some(Value::Null) => " (by the law: not passed)".to_owned(),
            Some(_) => format!(" (by the law: {} s)", self.number("/expected_s", 2)),
            None => String::new(),
        };
        let force = if self.0["mean_force_n"].is_null() {
            String::new()
        } else {
            format!(
                "; mean {}, peak {} N",
                self.number("/mean_force_n", 2),
                self.number("/peak_force_n", 2)
            )
        };
        format!("{layer}: {time}{expected}{force}")
    }

    fn servo(&self) -> String {
        format!(
            "  servo       {} ticks in {} s, {} late (> 0.5 ms), {} periods skipped\n              \
             p50 / p99 / p99.9 / max, us\n    wake-up   {}\n    tick      {}\n    device    {}",
            self.number("/ticks", 0),
            self.number("/seconds", 1),
            self.number("/late_ticks", 0),
            self.number("/skipped_periods", 0),
            self.quantiles("/wake_us"),
            self.quantiles("/tick_us"),
            self.quantiles("/device_roundtrip_us")
        )
    }

    fn device(&self) -> String {
        format!(
            "  device      {} frames, {} bad, {} missing, {} watchdog trips; pose error {} mm RMS",
            self.number("/device/frames", 0),
            self.number("/device/crc_errors", 0),
            self.number("/device/gaps", 0),
            self.number("/device/watchdog_trips", 0),
            self.number("/pose_rms_mm", 3)
        )
    }

    fn viewer(&self) -> String {
        format!(
            "  viewer      {} frames, {} bricks, {} starts from empty ({})\n  \
             digest      servo {}, publisher {}, viewer {} over {} chunks",
            self.number("/viewer/frames_rendered", 0),
            self.number("/viewer/updates", 0),
            self.number("/viewer/resyncs", 0),
            self.word("/viewer/process/name"),
            self.word("/digest/servo"),
            self.word("/digest/publisher"),
            self.word("/digest/viewer"),
            self.number("/digest/changed_chunks", 0)
        )
    }
}

/// The report for people.
fn text(report: &Value, args: &DemoArgs) -> String {
    let figures = Figures(report);
    let mut lines = vec![
        "Osteon session report".to_owned(),
        figures.bone(),
        figures.servo(),
        figures.device(),
        figures.viewer(),
        format!("  ended       {}", figures.word("/ended")),
    ];
    let more = [figures.resampling(), figures.passages()];
    lines.splice(2..2, more.into_iter().flatten());
    for (name, file) in [
        ("picture", &args.screenshot),
        ("json", &args.json),
        ("recording", &args.record),
    ] {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loads_are_told_in_both_newtons() {
        let report = json!({
            "peak_force_n": 0.951, "peak_physical_force_n": 31.7, "force_scale": 0.03,
            "saturated_ticks": 7, "peak_spindle_nmm": 912.4, "peak_spindle_load": 0.46,
            "stalled_ticks": 2, "guard_events": 40,
            "guards": {
                "clamp": {"count": 7, "last_tick": 2345},
                "implausible_sample": {"count": 33, "last_tick": 100},
                "hold": {"count": 0, "last_tick": null},
            },
        });
        assert_eq!(
            Figures(&report).loads(),
            "  force       peak 0.95 N at the stylus (31.7 N at a real tool, scale 0.03), limit reached in 7 ticks\n  \
             spindle     peak 912 Nmm of cut (0.46 of what the motor has), stalled in 2 ticks\n  \
             guards      40 ticks: clamp 7 (last at 2.3 s), implausible sample 33 (last at 0.1 s)"
        );
        let none = json!({"guards": {"clamp": {"count": 0, "last_tick": null}}});
        assert!(
            Figures(&none)
                .loads()
                .ends_with("guards      none had to act")
        );
        assert!(
            Figures(&json!({}))
                .loads()
                .contains("peak - N at the stylus")
        );
    }
}
