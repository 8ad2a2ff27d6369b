//! Playing a session file again.

mod player;
mod survey;
mod verify;

pub(crate) use player::Player;
pub(crate) use survey::Survey;
pub use verify::{Verified, verify};

use crate::recording::Moved;
use anyhow::Context as _;
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;

/// Options of a replay.
#[derive(Debug, Clone, clap::Args)]
pub struct ReplayArgs {
    /// Session file, as 'osteon haptics --record FILE' writes it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Play as fast as it goes and compare every tick: poses, forces and digests, bit for bit
    #[arg(long)]
    pub verify: bool,
    /// Write what was compared as JSON
    #[arg(long, value_name = "FILE", requires = "verify")]
    pub json: Option<PathBuf>,
    /// Where its files are now.
    #[command(flatten)]
    pub moved: Moved,
}

/// Plays a session again.
#[expect(clippy::print_stdout, reason = "what a command-line program found")]
pub fn run(args: &ReplayArgs) -> anyhow::Result<()> {
    let verified = verify(&args.file, &args.moved)?;
    println!("{}", verified.in_words());
    if let Some(path) = &args.json {
        let cannot = || format!("{}: cannot write", path.display());
        let file = File::create(path).with_context(cannot)?;
        serde_json::to_writer_pretty(BufWriter::new(file), &verified).with_context(cannot)?;
    }
    Ok(())
}
