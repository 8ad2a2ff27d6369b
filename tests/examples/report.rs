//! `osteon report` without the viewer in the build.

use clap::Parser as _;
use osteon_tests::report::{Report, run};

#[derive(Debug, clap::Parser)]
struct Cli {
    #[command(subcommand)]
    report: Report,
}

fn main() -> anyhow::Result<()> {
    run(&Cli::parse().report)
}
