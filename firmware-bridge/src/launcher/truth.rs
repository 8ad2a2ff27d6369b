//! The host's poses against the simulated device's ground truth.

use anyhow::{Context as _, ensure};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What the comparison gives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseError {
    /// RMS distance of the gimbal's centre, host against truth, mm.
    pub rms_mm: f64,
    /// Largest distance, mm.
    pub max_mm: f64,
    /// Samples compared.
    pub samples: u64,
}

/// One row of numbers by the name of its column.
fn rows(path: &Path, columns: &[&str]) -> anyhow::Result<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("{}: cannot read", path.display()))?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let places = columns
        .iter()
        .map(|c| {
            header
                .iter()
                .position(|h| h == c)
                .with_context(|| format!("{}: no column {c}", path.display()))
        })
        .collect::<anyhow::Result<Vec<usize>>>()?;
    let mut rows = Vec::new();
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let row: Option<Vec<f64>> = places
            .iter()
            .map(|&p| fields.get(p).and_then(|f| f.parse().ok()))
            .collect();
        // a line cut off by a kill has fewer fields: left out
        rows.extend(row);
    }
    Ok(rows)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "written as a whole number; a cast of anything else saturates"
)]
fn micros(time: f64) -> u64 {
    time as u64
}

/// Joins host and truth by the device's time.
pub(crate) fn pose_error(host: &Path, truth: &Path) -> anyhow::Result<PoseError> {
    let columns = ["time_micros", "x_mm", "y_mm", "z_mm"];
    let truth: BTreeMap<u64, [f64; 3]> = rows(truth, &columns)?
        .iter()
        .map(|r| (micros(r[0]), [r[1], r[2], r[3]]))
        .collect();
    let (mut sum, mut max, mut samples) = (0.0, 0.0f64, 0u64);
    for row in rows(host, &columns)? {
        let Some(t) = truth.get(&micros(row[0])) else {
            continue;
        };
        let d2: f64 = (0..3).map(|a| (row[a + 1] - t[a]).powi(2)).sum();
        sum += d2;
        max = max.max(d2.sqrt());
        samples += 1;
    }
    ensure!(
        samples > 0,
        "no state is in both the host's pose log and the device's ground truth"
    );
    Ok(PoseError {
        rms_mm: (sum / samples as f64).sqrt(),
        max_mm: max,
        samples,
    })
}

/// Torque truly applied at the plant in the last line, N·mm, per joint.
pub(crate) fn last_torque(truth: &Path) -> anyhow::Result<Option<[f64; 3]>> {
    let rows = rows(truth, &["torque1_nmm", "torque2_nmm", "torque3_nmm"])?;
    Ok(rows.last().map(|r| [r[0], r[1], r[2]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write as _;

    #[test]
    fn a_planted_offset_is_found() {
        let dir = tempfile::tempdir().expect("dir");
        let (host, truth) = (dir.path().join("h.csv"), dir.path().join("t.csv"));
        let mut t = String::from("time_micros,seq,x_mm,y_mm,z_mm\n");
        let mut h = String::from("tick,state_seq,time_micros,x_mm,y_mm,z_mm\n");
        for n in 65_000u32..66_000 {
            writeln!(t, "{},{},{n},0,0", n * 1000, n % 65_536).expect("write");
            if n % 3 == 0 {
                writeln!(h, "{n},{},{},{n},0.3,0.4", n % 65_536, n * 1000).expect("write");
            }
        }
        h.push_str("9,5,1");
        std::fs::write(&host, h).expect("write");
        std::fs::write(&truth, t).expect("write");
        let e = pose_error(&host, &truth).expect("joined");
        assert!((e.rms_mm - 0.5).abs() < 1e-12 && (e.max_mm - 0.5).abs() < 1e-12);
        assert_eq!(e.samples, 333);
    }
}
