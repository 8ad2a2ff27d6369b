//! Playing a session file again.

mod film;
mod orders;
mod player;
mod survey;
mod verify;
mod watch;

pub(crate) use player::Player;
pub(crate) use survey::Survey;
pub use verify::{Verified, verify};

use crate::haptics::default_socket;
use crate::recording::Moved;
use anyhow::Context as _;
use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use watch::{Watching, watch};

/// Options of a replay. Without --verify it serves viewers: start 'osteon view' beside it.
#[derive(Debug, Clone, clap::Args)]
pub struct ReplayArgs {
    /// Session file, as 'osteon haptics --record FILE' writes it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Play as fast as it goes and compare every tick: poses, forces and digests, bit for bit
    #[arg(long)]
    pub verify: bool,
    /// Socket for viewers [default: that of a session, haptics.sock in the user's runtime directory]
    #[arg(long, value_name = "PATH", conflicts_with = "verify")]
    pub socket: Option<PathBuf>,
    /// Times real time, from 0.01 to 100
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = speed, conflicts_with = "verify")]
    pub speed: f64,
    /// Begin at this time of the session, s
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        conflicts_with = "verify"
    )]
    pub from: f64,
    /// Write what was compared as JSON
    #[arg(long, value_name = "FILE", requires = "verify")]
    pub json: Option<PathBuf>,
    /// Where its files are now.
    #[command(flatten)]
    pub moved: Moved,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text
        .parse::<f64>()
        .ok()
        .filter(|s| orders::SPEEDS.contains(s));
    speed.ok_or_else(|| "must be a number from 0.01 to 100".to_owned())
}

/// Plays a session again.
#[expect(clippy::print_stdout, reason = "what a command-line program found")]
pub fn run(args: &ReplayArgs) -> anyhow::Result<()> {
    if !args.verify {
        let socket = args.socket.clone().unwrap_or_else(default_socket);
        return watch(&Watching {
            file: &args.file,
            moved: &args.moved,
            socket: &socket,
            speed: args.speed,
            from_s: args.from,
        });
    }
    let verified = verify(&args.file, &args.moved)?;
    println!("{}", verified.in_words());
    if let Some(path) = &args.json {
        let cannot = || format!("{}: cannot write", path.display());
        let file = File::create(path).with_context(cannot)?;
        serde_json::to_writer_pretty(BufWriter::new(file), &verified).with_context(cannot)?;
    }
    Ok(())
}
