//! The desktop program of Osteon: it connects to the haptics process, keeps a copy of bone and
//! cut, and shows it with force, depth and rates; commands go back.
//!
//! Millimetres, newtons, seconds; positions in the bone frame.
//!
//! **Invariants.** Nothing here can hold up the haptics process: the link is read by a thread of
//! its own, and a viewer that stops reading is only behind. Nothing that comes over the link is
//! trusted, and none of it makes this process panic. The viewer opens no device and computes no
//! force.
#![forbid(unsafe_code)]

mod adapter;
mod app;
mod bricks;
mod camera;
mod cli;
mod history;
pub mod lab;
mod link;
mod memory;
mod meshing;
mod mirror;
mod offscreen;
mod pace;
mod palette;
mod panels;
mod render;
mod report;
mod screenshot;
mod session;
mod slices;
mod system;
#[cfg(test)]
#[expect(
    clippy::print_stderr,
    clippy::too_many_lines,
    clippy::type_complexity,
    reason = "tests that show their figures, and synthetic scenes"
)]
mod testing;
mod watch;

pub use adapter::{AdapterBrief, Probe, probe};
pub use cli::ViewArgs;
pub use link::Remote;
pub use render::method::Kind as RendererKind;

use session::Manners;

/// Shows a session until it ends, the window is closed or `--seconds` are over. The process may
/// start itself again first, to bound the threads of a software renderer: call this from `main`
/// of a program whose arguments lead here, before anything else is started.
pub fn run(args: ViewArgs) -> anyhow::Result<()> {
    if args.die_with_parent {
        system::die_with_parent();
    }
    prepare();
    run_here(args)
}

/// Sets what graphics libraries read from the environment, by starting the program again once: one
/// raster thread for a software renderer, and a runtime directory where there is none (so that they
/// do not complain about it). Call it first; it returns where nothing is left to set.
pub fn prepare() {
    system::prepare_environment();
}

/// [`run`] without starting the process again.
fn run_here(args: ViewArgs) -> anyhow::Result<()> {
    let core_left_free = system::avoid_core(args.avoid_core);
    let manners = move |is_cpu: bool| Manners {
        priority: if is_cpu {
            system::lower_priority()
        } else {
            "normal priority".into()
        },
        core_left_free,
    };
    if args.mirror_only {
        return watch::run(&args);
    }
    match args.offscreen.clone() {
        Some(out) => offscreen::run(&args, &out, manners),
        None => app::run(args, manners),
    }
}

/// A line for people on stderr.
#[expect(
    clippy::print_stderr,
    reason = "the viewer's one way to tell the terminal something"
)]
fn say(line: &str) {
    eprintln!("osteon view: {line}");
}
