//! The simulated device's ground truth.
#![expect(
    clippy::expect_used,
    clippy::missing_panics_doc,
    reason = "helpers for tests"
)]

use std::path::Path;

/// One line of `truth.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Device time, µs.
    pub micros: u64,
    /// Drive state.
    pub drive: String,
    /// Whether the motors have power.
    pub motors_on: bool,
    /// Largest torque of the three joints, truly applied, N·mm.
    pub torque: f64,
}

/// All whole lines of the file; none where it has only just been made.
pub fn read(path: &Path) -> Vec<Line> {
    let text = std::fs::read_to_string(path).expect("truth");
    let mut lines = text.lines();
    let Some(header) = lines.next() else {
        return Vec::new();
    };
    let header: Vec<&str> = header.split(',').collect();
    let column = |name: &str| header.iter().position(|h| *h == name).expect("a column");
    let [micros, drive, motors] = ["time_micros", "drive", "motors_on"].map(column);
    let torques = ["torque1_nmm", "torque2_nmm", "torque3_nmm"].map(column);
    lines
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|fields| fields.len() == header.len())
        .map(|fields| Line {
            micros: fields[micros].parse().expect("a time"),
            drive: fields[drive].to_owned(),
            motors_on: fields[motors] == "1",
            torque: torques
                .iter()
                .map(|&t| fields[t].parse::<f64>().expect("a torque").abs())
                .fold(0.0, f64::max),
        })
        .collect()
}
