//! `osteon report NAME --out DIR`: measurements as JSON, CSV, plots and a document.

pub mod carver;
pub mod carving;
pub mod faults;
pub mod isolation;
pub mod latency;
mod machine;
pub mod plot;
pub mod pose;
pub mod rendering;
pub mod stability;
pub mod table;

pub use machine::Machine;

use anyhow::Result;

/// Reports.
#[derive(Debug, Clone, clap::Subcommand)]
pub enum Report {
    /// Time, error and memory of removing bone, beside the thesis's method and its rivals
    Carving(carving::CarvingArgs),
    /// Every fault of cable and device, in lockstep: time to zero torque, energy, recovery
    Faults(faults::FaultsArgs),
    /// What viewers of every kind, good and bad, do to the force loop: its times, its bits, the bone, the memory
    Isolation(isolation::IsolationArgs),
    /// How punctual the servo is here, beside cyclictest: by transport, scheduler and load
    Latency(latency::LatencyArgs),
    /// Where the host takes the stylus to be, against the plant's truth: at rest, in motion, with potentiometers
    Pose(pose::PoseArgs),
    /// A session against its plan: HTML, JSON, a table over many sessions
    Session(osteon_firmware_bridge::clinic::report::SessionArgs),
    /// Frame time, picture error and memory of every way to draw the bone; the thesis's kernel on the adapter
    Rendering(rendering::RenderingArgs),
    /// How still, safe and true the force loop is, with its hard cases and other programs' defects beside it
    Stability(stability::StabilityArgs),
}

/// Makes a report.
pub fn run(report: &Report) -> Result<()> {
    match report {
        Report::Carving(args) => carving::run(args),
        Report::Faults(args) => faults::run(args),
        Report::Isolation(args) => isolation::run(args),
        Report::Latency(args) => latency::run(args),
        Report::Pose(args) => pose::run(args),
        Report::Session(args) => osteon_firmware_bridge::clinic::report::run(args),
        Report::Rendering(args) => rendering::run(args),
        Report::Stability(args) => stability::run(args),
    }
}
