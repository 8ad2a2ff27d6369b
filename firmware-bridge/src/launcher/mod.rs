//! `osteon demo`: starts the simulated device, the haptics process and a viewer, supervises them,
//! brings them down in order and reports.

mod child;
mod disturb;
mod plan;
mod report;
mod stroke;
mod supervise;
mod truth;

pub use disturb::Disturbance;
pub use truth::PoseError;

use crate::clinic::task::Mode;
use crate::feel::{self, FeelArgs};
use crate::scene::SceneArgs;
use crate::tools::ToolArgs;
use std::path::PathBuf;

/// Options of the demonstration.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// The bone.
    #[command(flatten)]
    pub scene: SceneArgs,
    /// The tools.
    #[command(flatten)]
    pub tools: ToolArgs,
    /// The feel.
    #[command(flatten)]
    pub feel: FeelArgs,
    /// Instead of drilling and reaming, press the second tool straight along the planned axis with this
    /// constant force at the stylus, N, for at most 25 s; the report has its time through each tissue
    #[arg(long, value_name = "N", value_parser = push)]
    pub push: Option<f64>,
    /// Task after the scene's plan: free, guided (steps with hints on stderr), exam
    #[arg(long, value_name = "MODE", value_enum, default_value_t)]
    pub task: Mode,
    /// No window: the viewer process draws offscreen
    #[arg(long)]
    pub headless: bool,
    /// Length of the session, s; the hand needs 18 [default: 20; 34 with --push]
    #[arg(long, value_name = "S", value_parser = crate::haptics::positive)]
    pub seconds: Option<f64>,
    /// Write the session report as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a picture of the bone at the session's end (PNG)
    #[arg(long, value_name = "FILE")]
    pub screenshot: Option<PathBuf>,
    /// Size of the offscreen picture, pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    pub size: String,
    /// Record the session, see 'osteon haptics --help'
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Stop and kill the viewer on purpose, for example stop@5:5,kill@12 (seconds)
    #[arg(long, value_name = "SCRIPT", value_parser = disturb::parse)]
    pub disturb_viewer: Option<Disturbance>,
    /// Keep the session's files (stroke, ground truth, pose log) in this folder
    #[arg(long, value_name = "DIR")]
    pub keep_files: Option<PathBuf>,
}

/// Strongest push, N.
const MAX_PUSH_N: f64 = 3.0;

/// A push, from the command line.
fn push(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v <= MAX_PUSH_N => Ok(v),
        _ => Err(format!(
            "give a number of newtons above 0, at most {MAX_PUSH_N}"
        )),
    }
}

impl DemoArgs {
    /// Length of the session, s.
    fn seconds(&self) -> f64 {
        let usual = if self.push.is_some() { 34.0 } else { 20.0 };
        self.seconds.unwrap_or(usual)
    }
}

/// What this machine can show, as the viewer's own probe found it.
#[derive(Debug, Clone)]
pub struct Screen {
    /// Why no window can be opened; `None` where one can.
    pub no_window: Option<String>,
    /// The graphics adapter; `None` where nothing can be drawn at all.
    pub adapter: Option<String>,
}

/// Runs the demonstration. `screen` is asked only where a window is wanted.
pub fn run(args: &DemoArgs, screen: impl FnOnce() -> Screen) -> anyhow::Result<()> {
    if feel::printed(&args.feel)? {
        return Ok(());
    }
    supervise::run(args, &screen())
}
