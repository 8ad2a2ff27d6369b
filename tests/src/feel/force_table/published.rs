//! The table as it was published: rows of a CSV file with a header.

use anyhow::{Context as _, Result, ensure};
use serde::Serialize;

const HEADER: &str = "id,process,material,tool,spindle_rpm,feed,force_N_mean,force_N_sd_or_range,torque_Nmm_mean,torque_Nmm_sd_or_range,source,where_read";
const COLUMNS: usize = 12;

/// Thrust (N) and torque (N·mm) as published: a mean, and a standard deviation or a range in words.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Published {
    /// Mean thrust, N.
    pub force_n: Option<f64>,
    /// Its standard deviation, range or remark.
    pub force_spread: String,
    /// Mean torque, N·mm.
    pub torque_nmm: Option<f64>,
    /// Its standard deviation, range or remark.
    pub torque_spread: String,
}

/// One row, read.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Number.
    pub row: u32,
    /// Process.
    pub process: String,
    /// Material.
    pub material: String,
    /// Tool.
    pub tool: String,
    /// Diameter of the tool, mm, where the row has one.
    pub diameter_mm: Option<[f64; 2]>,
    /// Revolutions per minute, lowest and highest.
    pub rpm: Option<[f64; 2]>,
    /// Feed, lowest and highest, mm/s.
    pub feed_mm_s: Option<[f64; 2]>,
    /// Forces.
    pub published: Published,
    /// Where published, and where read.
    pub source: String,
}

impl Record {
    /// Process, material, tool, speed and feed in one line.
    pub fn what(&self) -> String {
        let range = |range: Option<[f64; 2]>, unit: &str| {
            let [lo, hi] = range?.map(hundredths);
            Some(if (hi - lo).abs() < 1e-9 {
                format!("{lo} {unit}")
            } else {
                format!("{lo} to {hi} {unit}")
            })
        };
        let words = [&self.process, &self.material, &self.tool];
        let words = words.into_iter().filter(|w| !w.is_empty()).cloned();
        let ranges = [range(self.rpm, "rpm"), range(self.feed_mm_s, "mm/s")];
        let all: Vec<String> = words.chain(ranges.into_iter().flatten()).collect();
        all.join(", ")
    }
}

impl Published {
    /// Thrust from the lowest to the highest, N: mean ± standard deviation, or the range.
    pub fn force(&self) -> Option<[f64; 2]> {
        spread(self.force_n, &self.force_spread)
    }

    /// Torque from the lowest to the highest, N·mm.
    pub fn torque(&self) -> Option<[f64; 2]> {
        spread(self.torque_nmm, &self.torque_spread)
    }
}

/// As people write it: at most two digits after the point.
fn hundredths(v: f64) -> f64 {
    (v * 100.0).round() / 100.0
}

fn spread(mean: Option<f64>, words: &str) -> Option<[f64; 2]> {
    let range = range(words);
    match (mean, range) {
        (Some(mean), Some([lo, hi])) if hi <= lo => Some([mean - lo, mean + lo]),
        (Some(mean), None) => Some([mean, mean]),
        (_, Some([lo, hi])) if hi > lo => Some([lo, hi]),
        _ => None,
    }
}

/// `a` or `a-b` in front of a text.
fn range(text: &str) -> Option<[f64; 2]> {
    let first = text.split_whitespace().next()?;
    let number = |text: &str| text.parse::<f64>().ok().filter(|v| v.is_finite());
    match first.split_once('-') {
        Some((lo, hi)) => Some([number(lo)?, number(hi)?]),
        None => number(first).map(|v| [v, v]),
    }
}

/// A range with its unit behind it.
fn range_of(text: &str, unit: &str) -> Option<[f64; 2]> {
    let (number, rest) = text.split_once(' ')?;
    rest.starts_with(unit).then(|| range(number))?
}

/// Reads the table. Every row must have all columns; what is not understood is an error, not a gap.
pub fn parse(text: &str) -> Result<Vec<Record>> {
    let mut lines = text.lines().enumerate();
    let header = lines.next().map_or("", |(_, line)| line.trim_end());
    ensure!(header == HEADER, "line 1: other columns than {HEADER}");
    let rows = lines.filter(|(_, line)| !line.trim().is_empty());
    rows.map(|(n, line)| record(line).with_context(|| format!("line {}", n + 1)))
        .collect()
}

fn record(line: &str) -> Result<Record> {
    let cells: Vec<&str> = line.split(',').map(str::trim).collect();
    ensure!(
        cells.len() == COLUMNS,
        "{} columns instead of {COLUMNS}",
        cells.len()
    );
    // an empty cell is none; anything else must be read
    let understood = |cell: &str, read: Option<[f64; 2]>| {
        ensure!(cell.is_empty() || read.is_some(), "'{cell}' is no number");
        Ok(read)
    };
    let mean = |cell: &str| Ok::<_, anyhow::Error>(understood(cell, range(cell))?.map(|[v, _]| v));
    let per_minute = understood(cells[5], range_of(cells[5], "mm/min"))?;
    Ok(Record {
        row: cells[0].parse().context("no number of a row")?,
        process: cells[1].to_owned(),
        material: cells[2].to_owned(),
        tool: cells[3].to_owned(),
        diameter_mm: range_of(cells[3], "mm"),
        rpm: understood(cells[4], range(cells[4]))?,
        feed_mm_s: per_minute.map(|range| range.map(|v| v / 60.0)),
        published: Published {
            force_n: mean(cells[6])?,
            force_spread: cells[7].to_owned(),
            torque_nmm: mean(cells[8])?,
            torque_spread: cells[9].to_owned(),
        },
        source: format!("{} ({})", cells[10], cells[11]),
    })
}
