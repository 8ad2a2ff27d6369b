//! The haptics process: device link, servo thread, publisher.
//!
//! ```text
//! servo thread (1 kHz) ── ring of records ──▶ publisher (main thread) ── socket ──▶ viewers
//!                      ◀── ring of requests ──                        ◀── commands ──
//! ```

pub mod isolation;
mod loads;
mod mirror;
mod net;
mod notes;
mod opening;
mod outset;
mod publisher;
mod reconnect;
pub(crate) mod record;
pub mod rehearsal;
mod report;
pub(crate) mod resync;
pub(crate) mod servo_loop;
pub(crate) mod session;
pub mod socket;
mod stats;
#[cfg(test)]
pub(crate) mod tests;
mod viewers;

pub(crate) use opening::{Session, publisher_of};
pub(crate) use publisher::{Publisher, warn, wire_digest, wire_pose};
pub(crate) use record::{Felt, Flags, Record, TickRecord};

pub use loads::{GuardReport, Loads};
pub use report::SessionReport;
pub use session::small_tools;
pub use stats::{LATE_NS, Quantiles};

use crate::clinic::task::Mode;
use crate::feel::{self, FeelArgs};
use crate::link::DeviceSpec;
use crate::scene::SceneArgs;
use crate::tools::ToolArgs;
use std::path::PathBuf;

/// Options of the haptics process.
#[derive(Debug, Clone, clap::Args)]
pub struct HapticsArgs {
    /// Device to own: open:PATH or open:PATH@BAUD (open controller on a serial port, or 'osteon fake-omni'),
    /// hid:VID:PID (the same as HID reports), hfab:PATH (`WoodenHaptics`, vintage Phantom),
    /// openhaptics or openhaptics:NAME (Omni, Touch through 3D Systems' library), packet:PATH (reports over a socket),
    /// sim or sim:STROKE.json (simulated, in this process); 'osteon devices' lists what is there
    #[arg(long, value_name = "KIND:PATH", default_value_t = default_device().to_string())]
    pub device: String,
    /// Socket for viewers [default: haptics.sock in the user's runtime directory]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Let viewers on other machines connect to this address and port, for example 0.0.0.0:4610 (encrypted;
    /// only with keys that 'osteon key trust' knows) [default: none can]
    #[arg(long, value_name = "HOST:PORT")]
    pub listen: Option<String>,
    /// The keys.
    #[command(flatten)]
    pub keys: crate::keys::KeyArgs,
    /// The bone.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// The tools.
    #[command(flatten)]
    pub tools: ToolArgs,
    /// The feel.
    #[command(flatten)]
    pub feel: FeelArgs,
    /// Task after the scene's plan: free (nothing is said), guided (steps with hints), exam (steps, 300 s, no hints)
    #[arg(long, value_name = "MODE", value_enum, default_value_t)]
    pub task: Mode,
    /// End the session after this many seconds [default: run until Ctrl-C or Stop]
    #[arg(long, value_name = "S", value_parser = positive)]
    pub seconds: Option<f64>,
    /// Largest force at the stylus, N
    #[arg(long, value_name = "N", default_value_t = osteon_sim_core::chain::FORCE_LIMIT_N, value_parser = force_limit)]
    pub force_limit: f64,
    /// Whose clock runs the loop: this machine's (host), or the device's, a tick for each of its states (device)
    /// [default: host; device with openhaptics]
    #[arg(long, value_enum)]
    pub clock: Option<Clock>,
    /// Ask for no real-time rights: for comparison
    #[arg(long)]
    pub no_realtime: bool,
    /// When the device goes away, wait so many seconds for it to come back; the bone stays as it is. 0: end the
    /// session
    #[arg(long, value_name = "S", default_value_t = 600.0, value_parser = seconds)]
    pub reconnect_for: f64,
    /// Write the session report as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the gimbal centre of every tick (CSV with tick, state number and x, y, z in mm, base frame)
    #[arg(long, value_name = "FILE")]
    pub pose_log: Option<PathBuf>,
    /// Record the session: every input of every tick and what came out, as MCAP; 'osteon replay FILE'
    /// plays it again, 'osteon export FILE' makes tables and volumes. The file must not be there yet
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Write when each tick began and how long it took (CSV), for the report on isolation
    #[arg(long, hide = true, value_name = "FILE")]
    pub timing_log: Option<PathBuf>,
    /// End with the process that started this one
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
    /// Panic in the servo thread at this tick: proves that the motors stop
    #[arg(long, hide = true, value_name = "TICK")]
    pub panic_at_tick: Option<u64>,
}

/// Whose clock runs the servo loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Clock {
    /// This machine's.
    Host,
    /// The device's.
    Device,
}

/// The device where none is named: the simulated one, by its default name.
pub fn default_device() -> DeviceSpec {
    let path = crate::fake::run::default_link().display().to_string();
    DeviceSpec::Open {
        path,
        baud: crate::link::BAUD,
    }
}

/// The socket used where none is named.
pub fn default_socket() -> PathBuf {
    socket::runtime_dir().join("haptics.sock")
}

/// A positive, finite number, from the command line.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
        _ => Err("must be a positive number".to_owned()),
    }
}

/// Seconds, 0 included, from the command line.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (0.0..=1e6).contains(&v) => Ok(v),
        _ => Err("must be a number of seconds, 0 or more".to_owned()),
    }
}

fn force_limit(text: &str) -> Result<f64, String> {
    let most = osteon_sim_core::chain::FORCE_LIMIT_N;
    match positive(text)? {
        v if v <= most => Ok(v),
        v => Err(format!("{v} N is above the device's {most} N")),
    }
}

/// Runs the haptics process to the end of its session.
pub fn run(args: &HapticsArgs) -> anyhow::Result<()> {
    if feel::printed(&args.feel)? {
        return Ok(());
    }
    session::run(args)
}
