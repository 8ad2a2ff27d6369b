//! `osteon report stability`: how still, safe and true the force loop is.
//!
//! All but the times is measured on a virtual clock: the same figures on every machine.

mod ablation;
mod forces;
mod impact;
mod law;
mod map;
mod output;
mod peers;
mod ripple;
mod soak;
mod ticks;

pub use output::Output;

use super::table::Table;
use crate::feel::CASES;
use anyhow::{Context as _, Result};
use clap::ValueEnum;
use std::path::PathBuf;
use std::time::Instant;

/// What to measure and where to write it.
#[derive(Debug, Clone, clap::Args)]
pub struct StabilityArgs {
    /// Folder for stability.json, stability.md, tables and plots; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Also ten hours of loop time in one piece (some minutes)
    #[arg(long)]
    pub soak: bool,
    /// Only these parts [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    pub only: Vec<Part>,
}

/// A part of the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// The hard cases
    Cases,
    /// Stiffness against delay, hand and guard
    Map,
    /// Taps, dropped frames, broken samples, energy
    Impact,
    /// Feed, energy, rate and symmetry of a cut
    Law,
    /// Ripple while sliding over oblique planes
    Ripple,
    /// The cutting law beside published forces
    Forces,
    /// Other programs' defects by their rule
    Peers,
    /// What breaks without each guard
    Ablation,
    /// Time of a tick, elements against ripple
    Ticks,
}

impl Part {
    const ALL: [Self; 9] = [
        Self::Cases,
        Self::Map,
        Self::Impact,
        Self::Law,
        Self::Ripple,
        Self::Forces,
        Self::Peers,
        Self::Ablation,
        Self::Ticks,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Cases => "cases",
            Self::Map => "map",
            Self::Impact => "impact",
            Self::Law => "law",
            Self::Ripple => "ripple",
            Self::Forces => "forces",
            Self::Peers => "peers",
            Self::Ablation => "ablation",
            Self::Ticks => "ticks",
        }
    }

    fn run(self, out: &mut Output) -> Result<()> {
        match self {
            Self::Cases => cases(out),
            Self::Map => map::run(out),
            Self::Impact => impact::run(out),
            Self::Law => law::run(out),
            Self::Ripple => ripple::run(out),
            Self::Forces => forces::run(out),
            Self::Peers => peers::run(out),
            Self::Ablation => ablation::run(out),
            Self::Ticks => ticks::run(out),
        }
    }
}

/// Measures and writes the report.
pub fn run(args: &StabilityArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    let mut out = Output::new(args.out.clone());
    let chosen = |part: &Part| args.only.is_empty() || args.only.contains(part);
    let parts: Vec<Part> = Part::ALL.into_iter().filter(chosen).collect();
    let count = parts.len() + usize::from(args.soak);
    for (n, part) in parts.iter().enumerate() {
        timed(&mut out, part.name(), n as f32 / count as f32, |out| {
            part.run(out)
        })?;
    }
    if args.soak {
        let share = parts.len() as f32 / count as f32;
        timed(&mut out, "soak", share, soak::run)?;
    }
    out.finish()
}

fn timed(
    out: &mut Output,
    name: &'static str,
    share: f32,
    run: impl FnOnce(&mut Output) -> Result<()>,
) -> Result<()> {
    out.part_begins(name, share);
    let start = Instant::now();
    run(out).with_context(|| format!("the report's part '{name}'"))?;
    out.part_done(name, start.elapsed().as_secs_f64());
    Ok(())
}

/// The hard cases.
fn cases(out: &mut Output) -> Result<()> {
    let mut table = Table::new(
        "cases",
        "Hard cases",
        "Each is a test of its own as well.",
        &["case", "name", "asked for", "measured", "holds"],
    );
    let mut all = Vec::new();
    for (id, measure) in CASES {
        out.stage(&format!("case {id}"));
        let case = measure();
        table.push([
            case.id.to_string(),
            case.name.to_owned(),
            case.criterion.clone(),
            case.measured.clone(),
            if case.pass { "yes" } else { "**no**" }.to_owned(),
        ]);
        all.push(case);
    }
    let held = all.iter().filter(|c| c.pass).count();
    out.say(&format!(
        "## Hard cases\n\n{held} of {} measured cases hold.",
        all.len()
    ));
    out.section("cases", &all)?;
    out.table(&table)
}

#[cfg(test)]
mod tests;
