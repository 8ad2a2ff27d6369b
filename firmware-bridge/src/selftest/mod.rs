//! `osteon selftest`: commissioning of real hardware, step by step, with a written record.
//!
//! * `procedure`: the steps, on a clock of milliseconds; it knows no cable and no terminal.
//! * `rig`: the device and the operator as the steps see them: a link and a terminal here, a simulated arm
//!   in the tests.
//! * `staircase`: what a force staircase against a spring or a weight says of the force's scale.
//! * `record`: what is written.

mod procedure;
mod record;
mod rig;
mod staircase;
#[cfg(test)]
mod tests;

use crate::haptics::{default_device, positive};
use crate::link::{self, DeviceSpec};
use crate::rt::{self, RtReport};
use anyhow::{Context as _, anyhow, ensure};
use procedure::{Against, Plan, procedure};
use record::Record;
use rig::Bench;
use std::path::PathBuf;

/// Options of the self-test.
#[derive(Debug, Clone, clap::Args)]
pub struct SelftestArgs {
    /// Device to test; as 'osteon haptics' takes it
    #[arg(long, value_name = "KIND:PATH", default_value_t = default_device().to_string())]
    pub device: String,
    /// Folder for the record, selftest.json and selftest.md; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Who does it, for the record
    #[arg(long, value_name = "NAME", default_value = "")]
    pub operator: String,
    /// The stylus will be tied to a fixed point by a spring of this stiffness, N/mm: forces are measured by how far
    /// they draw it
    #[arg(long, value_name = "N/MM", value_parser = positive, conflicts_with = "weight")]
    pub spring: Option<f64>,
    /// A weight of this mass, g, will hang on the stylus: forces are measured by when they lift it and let it sink
    #[arg(long, value_name = "G", value_parser = positive)]
    pub weight: Option<f64>,
    /// Largest force of the staircase, N
    #[arg(long, value_name = "N", default_value_t = 1.5, value_parser = staircase_limit)]
    pub most: f64,
    /// Longest wait for the operator in each step, s
    #[arg(long, value_name = "S", default_value_t = 120.0, value_parser = positive)]
    pub patience: f64,
}

fn staircase_limit(text: &str) -> Result<f64, String> {
    let most = osteon_sim_core::chain::FORCE_LIMIT_N;
    match positive(text)? {
        v if v <= most => Ok(v),
        v => Err(format!("{v} N is above the device's {most} N")),
    }
}

/// Goes through the steps and writes the record; an error where a step fails.
pub fn run(args: &SelftestArgs) -> anyhow::Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    let spec = args.device.parse::<DeviceSpec>();
    let spec = spec.map_err(|e| anyhow!("--device {e}"))?;
    let stop = crate::stop::on_signals()?;
    let mut link = link::open(&spec)?;
    let info = link.info().clone();
    link.prepare()?;
    link.start()?;
    let rights = RtReport::ask(rt::servo_core());
    let mut bench = Bench::new(link, stop)?;
    for line in rights.warnings() {
        rig::Rig::tell(&mut bench, &line);
    }
    let against = match (args.spring, args.weight) {
        (Some(stiffness), _) => Against::Spring(stiffness),
        (None, Some(grams)) => Against::Weight(grams),
        (None, None) => Against::Nothing,
    };
    let plan = Plan {
        against,
        most_n: args.most,
        patience_ms: milliseconds(args.patience),
    };
    let steps = procedure(&mut bench, &plan);
    bench.end();
    let record = Record::new(&args.device, &info, &args.operator, steps);
    record.write(&args.out)?;
    say(&record.verdict());
    say(&format!(
        "record: {}",
        args.out.join("selftest.md").display()
    ));
    let failed = record.failed();
    ensure!(failed.is_empty(), "selftest: failed: {}", failed.join(", "));
    Ok(())
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "positive, and the cast saturates"
)]
fn milliseconds(seconds: f64) -> u64 {
    (seconds * 1e3) as u64
}

#[expect(clippy::print_stdout, reason = "the verdict is the program's output")]
fn say(text: &str) {
    println!("{text}");
}
