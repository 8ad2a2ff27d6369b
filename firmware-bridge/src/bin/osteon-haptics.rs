//! The haptics process alone, for the dedicated haptics PC: no graphics crate in its tree.

use clap::Parser;
use osteon_firmware_bridge::haptics::{HapticsArgs, run};
use std::process::ExitCode;

/// Owns the haptic device and runs the 1 kHz force loop; viewers connect to its socket
#[derive(Debug, Parser)]
#[command(name = "osteon-haptics", version)]
struct Cli {
    #[command(flatten)]
    haptics: HapticsArgs,
}

#[expect(
    clippy::print_stderr,
    reason = "the error line of a command-line program"
)]
fn main() -> ExitCode {
    match run(&Cli::parse().haptics) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("osteon-haptics: {e:#}");
            ExitCode::FAILURE
        }
    }
}
