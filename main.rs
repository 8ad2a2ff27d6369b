//! `osteon`: one program, one sub-command for each process and report.

use clap::{Parser, Subcommand};
use osteon_firmware_bridge::{
    bench, clinic, devices, doctor, export, fake, haptics, import, keys, launcher, replay, selftest,
};
use osteon_tests::report;
use std::process::ExitCode;

/// Haptic bone-reaming simulator for clinical labs, and the test bench that proves it.
///
/// Without a sub-command it runs the demonstration: a simulated haptic device, the haptics process and
/// the viewer; a scripted hand drills a peg hole and reams the glenoid of a built-in scapula.
/// A training simulator, not a medical device.
#[derive(Debug, Parser)]
#[command(name = "osteon", version, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    task: Option<Task>,
    #[command(flatten)]
    demo: launcher::DemoArgs,
}

#[derive(Debug, Subcommand)]
enum Task {
    /// Start everything, drill and ream with a scripted hand, report
    Demo(launcher::DemoArgs),
    /// Own the haptic device and run the 1 kHz force loop; viewers connect to its socket
    Haptics(haptics::HapticsArgs),
    /// Show a running session
    View(osteon_viewer::ViewArgs),
    /// Simulated haptic device behind a serial port
    FakeOmni(fake::FakeArgs),
    /// Play a script of sessions and faults in lockstep, without hardware and faster than real time
    Bench(bench::BenchArgs),
    /// Make a scene of a lab's own data: a folder of DICOM slices
    Import(import::ImportArgs),
    /// List what is plugged in, which protocol answers, and what keeps it from a session
    Devices(devices::DevicesArgs),
    /// Play a recorded session again, and compare every tick bit for bit
    Replay(replay::ReplayArgs),
    /// Make tables and volumes of a recorded session for other programs
    Export(export::ExportArgs),
    /// Choose how a scene's bone is made: threshold, parts, labels, cartilage, density
    Prepare(clinic::prepare::PrepareArgs),
    /// Plan a glenoid component in a scene from three landmarks
    Plan(clinic::plan::PlanArgs),
    /// Make and show the key with which this user's programs talk to other machines, say whose are trusted
    #[command(subcommand)]
    Key(keys::KeyTask),
    /// Say what this machine can do: real-time rights, ports, display, graphics
    Doctor(doctor::DoctorArgs),
    /// Commission a device step by step: encoders, buttons, workspace, force, emergency stop; writes a record
    Selftest(selftest::SelftestArgs),
    /// Measure, and write a document with its tables and plots
    #[command(subcommand)]
    Report(report::Report),
}

#[expect(
    clippy::print_stderr,
    reason = "the error line of a command-line program"
)]
fn main() -> ExitCode {
    let cli = Cli::parse();
    let task = cli.task.unwrap_or(Task::Demo(cli.demo));
    if matches!(task, Task::Demo(_) | Task::View(_) | Task::Doctor(_)) {
        osteon_viewer::prepare();
    }
    let result = match task {
        Task::Demo(args) => launcher::run(&args, screen),
        Task::Haptics(args) => haptics::run(&args),
        Task::View(args) => view(args),
        Task::FakeOmni(args) => fake::run(&args),
        Task::Bench(args) => bench::run(&args),
        Task::Prepare(args) => clinic::prepare::run(&args),
        Task::Plan(args) => clinic::plan::run(&args),
        Task::Import(args) => import::run(&args),
        Task::Devices(args) => devices::run(&args),
        Task::Replay(args) => replay::run(&args),
        Task::Export(args) => export::run(&args),
        Task::Key(task) => keys::run(&task),
        Task::Doctor(args) => doctor::run(&args, screen),
        Task::Selftest(args) => selftest::run(&args),
        Task::Report(report) => report::run(&report),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("osteon: {e:#}");
            ExitCode::FAILURE
        }
    }
}

/// A viewer; where it shows a session of another machine, with the keys for that.
fn view(mut args: osteon_viewer::ViewArgs) -> anyhow::Result<()> {
    if let Some(address) = &args.connect {
        let place = keys::KeyArgs {
            keys: args.keys.clone(),
        };
        args.remote = Some(osteon_viewer::Remote {
            address: address.clone(),
            own: keys::identity(&place)?,
            theirs: keys::peer(&place, args.peer.as_deref())?.key,
        });
    }
    osteon_viewer::run(args)
}

/// What the viewer could show here.
fn screen() -> launcher::Screen {
    let probe = osteon_viewer::probe();
    launcher::Screen {
        no_window: (!probe.display).then_some(probe.display_note),
        adapter: probe.adapter.map(|a| format!("{} ({})", a.name, a.backend)),
    }
}
