//! `osteon report carving`: time and error of removing bone, beside the thesis's method and its rivals.

mod ablation;
mod floors;
pub mod lineup;
mod memory;
mod output;
mod precision;
mod rate;
mod rows;
mod scaling;
mod speed;
mod thesis;
pub(crate) mod tools;

pub use output::Output;
pub use rows::{Case, Effort, Row, measure};

use super::Machine;
use crate::measure::intrinsic;
use anyhow::{Context as _, Result};
use clap::ValueEnum;
use std::path::PathBuf;
use std::time::Instant;

/// What to measure and where to write it.
#[derive(Debug, Clone, clap::Args)]
pub struct CarvingArgs {
    /// Folder for carving.json, carving.md, tables and plots; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Small scenes and few events: a check of the report, not a measurement
    #[arg(long)]
    pub quick: bool,
    /// Only these parts [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    pub only: Vec<Part>,
}

/// A part of the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Time per event on the scapula at 0.47, 0.235 and 0.14 mm
    Speed,
    /// Time against error over voxel size, tool resolution and sub-steps
    Precision,
    /// Time over the tool's diameter and the bone's size
    Scaling,
    /// Collision rate against lag
    Rate,
    /// The thesis's tables and figures in our terms
    Thesis,
    /// Memory by field
    Memory,
    /// What each part of the model costs and what error it removes
    Ablation,
}

impl Part {
    const ALL: [Self; 7] = [
        Self::Speed,
        Self::Precision,
        Self::Scaling,
        Self::Rate,
        Self::Thesis,
        Self::Memory,
        Self::Ablation,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Speed => "speed",
            Self::Precision => "precision",
            Self::Scaling => "scaling",
            Self::Rate => "rate",
            Self::Thesis => "thesis",
            Self::Memory => "memory",
            Self::Ablation => "ablation",
        }
    }

    fn run(self, out: &mut Output) -> Result<()> {
        match self {
            Self::Speed => speed::run(out),
            Self::Precision => precision::run(out),
            Self::Scaling => scaling::run(out),
            Self::Rate => rate::run(out),
            Self::Thesis => thesis::run(out),
            Self::Memory => memory::run(out),
            Self::Ablation => ablation::run(out),
        }
    }
}

/// Measures and writes the report.
pub fn run(args: &CarvingArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    // the pool's threads inherit the affinity of the thread that starts them: start them first
    rayon::join(|| (), || ());
    rayon::broadcast(|_| ());
    let machine = Machine::look(intrinsic::pin(), intrinsic::timer_cost_ns());
    let effort = if args.quick {
        Effort::QUICK
    } else {
        Effort::FULL
    };
    let mut out = Output::new(args.out.clone(), effort, machine);
    let chosen = |part: &Part| args.only.is_empty() || args.only.contains(part);
    let parts: Vec<Part> = Part::ALL.into_iter().filter(chosen).collect();
    for (n, part) in parts.iter().enumerate() {
        out.part_begins(part.name(), n as f32 / parts.len() as f32);
        let start = Instant::now();
        part.run(&mut out)
            .with_context(|| format!("the report's part '{}'", part.name()))?;
        out.part_done(part.name(), start.elapsed().as_secs_f64());
    }
    out.finish(args.quick)
}

#[cfg(test)]
mod tests;
