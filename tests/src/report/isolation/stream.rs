//! What a viewer's stream costs while bone is reamed, and how soon a late viewer's picture is whole.

use super::mirror::Follower;
use crate::report::table::Table;
use crate::{Running, until};
use anyhow::{Context as _, Result};
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A patient's CT.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Patient {
    /// CT as NIfTI, for the late viewer on a patient's bone [default: the built-in phantom only]
    #[arg(long, value_name = "FILE")]
    pub bone: Option<PathBuf>,
    /// Its label map
    #[arg(long, value_name = "FILE", requires = "bone")]
    pub labels: Option<PathBuf>,
    /// Labels that are the bone
    #[arg(long, value_name = "N", requires = "labels")]
    pub keep: Option<String>,
    /// Its plan
    #[arg(long, value_name = "FILE", requires = "bone")]
    pub pose: Option<PathBuf>,
    /// CT number of the bone's surface, HU
    #[arg(long, value_name = "HU", requires = "bone")]
    pub threshold: Option<String>,
}

/// One scene.
#[derive(Debug, Clone, Serialize)]
pub struct Line {
    /// What was reamed.
    pub scene: String,
    /// Edge of its voxels, mm; absent where they are the CT's.
    pub voxel_mm: Option<f64>,
    /// From connecting to the whole picture, the cut included, s.
    pub late_viewer_complete_s: Option<f64>,
    /// Seconds measured after that, while the tool cut.
    pub seconds: usize,
    /// Bytes a second, on the average.
    pub mean_bytes_per_s: f64,
    /// Bytes of the worst second.
    pub worst_second_bytes: u64,
    /// Volume that was removed in the session, mm³.
    pub removed_mm3: f64,
}

/// Measures on the phantom at 0.235 mm, and on the patient where there is one.
pub fn measure(
    patient: &Patient,
    osteon: &Path,
    folder: &Path,
    progress: &mut dyn FnMut(f32),
) -> Result<Vec<Line>> {
    let mut lines = Vec::new();
    if let Some(bone) = &patient.bone {
        let mut args = vec!["--bone".to_owned(), bone.display().to_string()];
        let paths = [("--labels", &patient.labels), ("--pose", &patient.pose)];
        for (name, path) in paths {
            if let Some(path) = path {
                args.extend([name.to_owned(), path.display().to_string()]);
            }
        }
        for (name, text) in [
            ("--keep", &patient.keep),
            ("--threshold", &patient.threshold),
        ] {
            if let Some(text) = text {
                args.extend([name.to_owned(), text.clone()]);
            }
        }
        lines.push(line("patient's CT", None, &args, osteon, folder)?);
    }
    progress(0.5);
    let args = ["--voxel-mm".to_owned(), "0.235".to_owned()];
    lines.push(line("phantom", Some(0.235), &args, osteon, folder)?);
    Ok(lines)
}

fn line(
    scene: &str,
    voxel_mm: Option<f64>,
    more: &[String],
    osteon: &Path,
    folder: &Path,
) -> Result<Line> {
    let socket = folder.join("stream/haptics.sock");
    let report = folder.join("stream.json");
    let device = format!("sim:{}", ream(folder)?.display());
    let (socket_text, report_text) = (socket.display().to_string(), report.display().to_string());
    let mut args = vec![
        "haptics",
        "--device",
        &device,
        "--socket",
        &socket_text,
        "--json",
        &report_text,
        "--seconds",
        "16",
    ];
    args.extend(more.iter().map(String::as_str));
    let mut haptics = Running::start(&osteon.display().to_string(), &args, folder, "stream");
    until("the servo", Duration::from_mins(5), || {
        std::fs::read_to_string(folder.join("stream.out")).is_ok_and(|t| t.contains("1 kHz"))
    });
    let began = Instant::now();
    // the tool has reached the bone and cuts
    std::thread::sleep(Duration::from_secs(6));
    let traffic = Follower::new(&socket).measure_until(began + Duration::from_secs(15));
    haptics.wait(Duration::from_mins(1));
    let text = std::fs::read_to_string(&report);
    let text = text.with_context(|| {
        let errors = std::fs::read_to_string(folder.join("stream.err"));
        format!("the session left no report: {}", errors.unwrap_or_default())
    })?;
    let report: Value = serde_json::from_str(&text)?;
    let mut whole = traffic.per_second;
    // the last one is not whole
    whole.pop();
    let total: u64 = whole.iter().sum();
    Ok(Line {
        scene: scene.to_owned(),
        voxel_mm,
        late_viewer_complete_s: traffic.complete_s,
        seconds: whole.len(),
        mean_bytes_per_s: total as f64 / whole.len().max(1) as f64,
        worst_second_bytes: whole.iter().copied().max().unwrap_or(0),
        removed_mm3: report["removed_mm3"].as_f64().unwrap_or(f64::NAN),
    })
}

/// A stroke that takes the reamer and goes slowly into the bone, 12 s long.
fn ream(folder: &Path) -> Result<PathBuf> {
    let segment = |name: &str, goal: [f64; 3], speed: f64, timeout: f64, press: Option<u8>| {
        json!({
            "name": name, "goal_mm": goal, "axis": [0, 0, 1], "speed_mm_s": speed,
            "max_push_n": 2.5, "press": press, "dwell_s": 0.0, "timeout_s": timeout
        })
    };
    let stroke = json!({ "segments": [
        segment("leave the dock", [0.0, -20.0, 60.0], 200.0, 3.0, None),
        segment("before the joint", [0.0, 0.0, 24.0], 150.0, 3.0, Some(2)),
        segment("spindle", [0.0, 0.0, 22.0], 50.0, 2.0, Some(1)),
        segment("approach", [0.0, 0.0, 6.0], 25.0, 3.0, None),
        segment("ream", [0.0, 0.0, -12.0], 1.0, 60.0, None),
    ]});
    let path = folder.join("ream.json");
    std::fs::write(&path, stroke.to_string())
        .with_context(|| format!("writing {}", path.display()))?;
    Ok(path)
}

/// The lines as a table.
pub fn table(lines: &[Line]) -> Table {
    let mut table = Table::new(
        "isolation_stream",
        "A late viewer, and the stream while bone is reamed",
        "Asked for: the picture whole within 1 s on the patient's CT; at most 2 MB a second on the average and 8 MB in any \
         second at 0.235 mm.",
        &[
            "scene",
            "voxel, mm",
            "whole after, s",
            "seconds",
            "mean, MB/s",
            "worst second, MB",
            "removed, mm³",
        ],
    );
    for l in lines {
        table.push([
            l.scene.clone(),
            l.voxel_mm
                .map_or_else(|| "the CT's".to_owned(), |v| v.to_string()),
            l.late_viewer_complete_s
                .map_or_else(|| "–".to_owned(), |s| format!("{s:.3}")),
            l.seconds.to_string(),
            format!("{:.3}", l.mean_bytes_per_s * 1e-6),
            format!("{:.3}", l.worst_second_bytes as f64 * 1e-6),
            format!("{:.0}", l.removed_mm3),
        ]);
    }
    table
}
