//! `osteon report isolation`: the force loop alone and beside every kind of viewer, in one session; the
//! same with scripted inputs for the bits; what a viewer's stream costs.

pub mod attach;
pub mod live;
pub mod mirror;
pub mod stream;

use super::Machine;
use super::plot::{Plot, Point, Scale, Series};
use super::table::Table;
use crate::measure::intrinsic;
use anyhow::{Context as _, Result, ensure};
use attach::{Kind, Where, attach};
use live::Times;
use osteon_firmware_bridge::haptics::isolation::{Played, play};
use osteon_firmware_bridge::progress::Progress;
use serde::Serialize;
use serde_json::json;
use std::cell::RefCell;
use std::path::{Path, PathBuf};

/// Where to write it.
#[derive(Debug, Clone, clap::Args)]
pub struct IsolationArgs {
    /// Folder for isolation.json, isolation.md, tables and plots; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seconds of each viewer in each round
    #[arg(long, value_name = "S", default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=600))]
    pub seconds: u64,
    /// Rounds over all viewers
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=100))]
    pub rounds: u64,
    /// The program whose processes are watched [default: this one]
    #[arg(long, value_name = "PATH")]
    pub osteon: Option<PathBuf>,
    /// A CT, with its labels and plan as in 'osteon demo', for the late viewer and the stream while reaming
    #[command(flatten)]
    pub patient: stream::Patient,
}

/// One kind of viewer.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Its name.
    pub viewer: &'static str,
    /// Delay from a tick's deadline to its start, µs.
    pub wake_us: Times,
    /// Duration of a tick, µs.
    pub tick_us: Times,
    /// p99.9 of the tick over that of haptics alone.
    pub ratio_tick_p999: f64,
    /// p99.9 of the wake-up over that of haptics alone.
    pub ratio_wake_p999: f64,
    /// Ticks measured, and periods skipped among them.
    pub ticks: usize,
    /// Periods of the force loop that were skipped.
    pub skipped: u64,
    /// Carve records whose effect is missing from the viewer's final bone; of a viewer that keeps none,
    /// from the publisher's.
    pub removals_lost: usize,
    /// Whether its digest is the servo's; null where it cannot answer.
    pub digest_equal: Option<bool>,
    /// Most memory that the publisher held for viewers.
    pub publisher_peak_bytes: usize,
    /// What so many viewers could have made of it.
    pub publisher_bound_bytes: usize,
    /// Whether every torque and the bone are those of a session without viewers, bit for bit.
    pub force_bits_equal: bool,
}

/// Measures and writes; an error where a bit differs, a removal is lost or memory is over its bound.
pub fn run(args: &IsolationArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    let osteon = match &args.osteon {
        Some(path) => path.clone(),
        None => std::env::current_exe().context("this program's own path")?,
    };
    let folder = std::env::temp_dir().join(format!("osteon-isolation-{}", std::process::id()));
    std::fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    let done = measure(args, &osteon, &folder);
    // what is left is only temporary
    std::fs::remove_dir_all(&folder).unwrap_or(());
    let (rows, stream, machine) = done?;
    write(args, &rows, &stream, &machine)?;
    for row in &rows {
        ensure!(
            row.force_bits_equal,
            "{}: torques or bone differ",
            row.viewer
        );
        ensure!(
            row.removals_lost == 0,
            "{}: {} removals lost",
            row.viewer,
            row.removals_lost
        );
        ensure!(
            row.digest_equal != Some(false),
            "{}: digests differ",
            row.viewer
        );
        ensure!(
            row.publisher_peak_bytes <= row.publisher_bound_bytes,
            "{}: memory over its bound",
            row.viewer
        );
    }
    Ok(())
}

type Done = (Vec<Row>, Vec<stream::Line>, Machine);

fn measure(args: &IsolationArgs, osteon: &Path, folder: &Path) -> Result<Done> {
    let pinned = Err("all threads of a session".to_owned());
    let mut machine = Machine::look(pinned, intrinsic::timer_cost_ns());
    let mut progress = Progress::new("isolation report");
    progress.show("times", 0.0);
    let times = live::session(args, osteon, folder, &mut |share| {
        progress.show("times", share);
    })?;
    let mut rows = Vec::new();
    let mut alone = None;
    for (n, kind) in Kind::ALL.into_iter().enumerate() {
        progress.show("bits", n as f32 / Kind::ALL.len() as f32);
        let (played, lost) = scripted(kind, args, osteon, folder)?;
        let mut row = times.row(kind, &played);
        row.removals_lost = lost;
        let reference = alone.get_or_insert_with(|| (played.torques.clone(), played.digest));
        row.force_bits_equal = *reference == (played.torques.clone(), played.digest)
            && played.mirror_digest == played.digest;
        rows.push(row);
    }
    let stream = stream::measure(&args.patient, osteon, folder, &mut |share| {
        progress.show("stream", share);
    })?;
    progress.finish();
    machine.finish();
    Ok((rows, stream, machine))
}

/// The scripted session beside a viewer of this kind; and how many removals its bone lacks.
fn scripted(
    kind: Kind,
    args: &IsolationArgs,
    osteon: &Path,
    folder: &Path,
) -> Result<(Played, usize)> {
    let at = Where {
        socket: folder.join("scripted/haptics.sock"),
        osteon: osteon.to_owned(),
        folder: folder.to_owned(),
        inside: true,
    };
    // the whole stroke: into the bone and out of it
    let ticks = if args.seconds * args.rounds < 4 {
        4500
    } else {
        8000
    };
    let attached = RefCell::new(None);
    let ready = || *attached.borrow_mut() = Some(attach(kind, &at));
    let over = || {
        if let Some(Ok(viewer)) = &*attached.borrow() {
            viewer.calm();
        }
    };
    let played = play(ticks, &at.socket, ready, over)?;
    let attached = attached.into_inner().context("nobody was attached")??;
    let cut = attached.join();
    let lost = match cut {
        Some(cut) => played.missing(cut),
        // a process: its digest says whether it has all of them
        None if kind == Kind::Rendering && played.answers != [played.digest] => played.steps.len(),
        None => 0,
    };
    Ok((played, lost))
}

fn write(
    args: &IsolationArgs,
    rows: &[Row],
    stream: &[stream::Line],
    machine: &Machine,
) -> Result<()> {
    let file = |name: &str, text: &str| {
        let path = args.out.join(name);
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
    };
    let (table, lines, plot) = (table(rows), stream::table(stream), plot(rows));
    table.write(&args.out)?;
    lines.write(&args.out)?;
    plot.write(&args.out)?;
    let document = json!({
        "report": "isolation", "machine": machine, "seconds": args.seconds, "rounds": args.rounds,
        "rows": rows, "stream": stream
    });
    file("isolation.json", &serde_json::to_string_pretty(&document)?)?;
    let text = format!(
        "# Two processes that cannot hurt each other\n\nMade with `osteon report isolation --out DIR` on {} ({} cores). \
         All figures are in [isolation.json](isolation.json).\n\n{METHOD}\n\n{}{}{}",
        machine.cpu,
        machine.cores,
        table.markdown(),
        plot.markdown(),
        lines.markdown()
    );
    file("isolation.md", &text)?;
    #[expect(clippy::print_stderr, reason = "what a command says at its end")]
    {
        eprintln!(
            "isolation report: {}",
            args.out.join("isolation.md").display()
        );
    }
    Ok(())
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "isolation",
        "The force loop beside every kind of viewer",
        "*Wake* and *tick*: µs, p50 / p99 / p99.9 / max. *Ratio*: p99.9 over that of haptics alone. *Lost*: carve records \
         missing from the viewer's final bone. *Digest*: the viewer's against the servo's; – where it cannot answer.",
        &[
            "viewer",
            "wake",
            "tick",
            "ratio tick",
            "ratio wake",
            "skipped",
            "lost",
            "digest",
            "peak, kB",
            "bound, kB",
            "bits",
        ],
    );
    let four = |t: &Times| format!("{:.0} / {:.0} / {:.0} / {:.0}", t.p50, t.p99, t.p999, t.max);
    for row in rows {
        table.push([
            row.viewer.to_owned(),
            four(&row.wake_us),
            four(&row.tick_us),
            format!("{:.2}", row.ratio_tick_p999),
            format!("{:.2}", row.ratio_wake_p999),
            row.skipped.to_string(),
            row.removals_lost.to_string(),
            row.digest_equal
                .map_or("–", |e| if e { "equal" } else { "**differs**" })
                .to_owned(),
            (row.publisher_peak_bytes / 1000).to_string(),
            (row.publisher_bound_bytes / 1000).to_string(),
            if row.force_bits_equal {
                "equal"
            } else {
                "**differ**"
            }
            .to_owned(),
        ]);
    }
    table
}

/// A figure of a row.
type Value = fn(&Row) -> f64;

fn plot(rows: &[Row]) -> Plot {
    let mut plot = Plot::new(
        "isolation_tick",
        "Ticks and wake-ups beside every kind of viewer",
        "A point for each kind, in the table's order: its number and the p99.9.",
        ["viewer, in the table's order", "p99.9, µs"],
    );
    plot.scales = [Scale::Linear, Scale::Log];
    let series: [(&str, Value); 2] = [("tick", |r| r.tick_us.p999), ("wake", |r| r.wake_us.p999)];
    for (name, of) in series {
        let points = rows.iter().enumerate();
        plot.series.push(Series {
            name: name.to_owned(),
            points: points
                .map(|(n, r)| Point::at(n as f64 + 1.0, of(r)))
                .collect(),
        });
    }
    plot
}

const METHOD: &str = "\
## How it was measured

* **Times**: one session of `osteon haptics` on a simulated device that drills again and again; the viewers take turns, round \
after round, so that what else the machine does meets all of them alike. A viewer's first half second is left out. Good viewers \
are processes (`osteon view`), the others threads of the report; all share the machine's cores with the force loop.
* **Bits**: for each kind a session with scripted inputs on a virtual clock (the device's states of every tick are the same), at \
the speed of a real one, with the real publisher and socket. All torques and the bone's digest are compared with those of a \
session without viewers. *Lost* is counted by carving every step again into the viewer's final bone: a step that changes \
anything was missing.
* **Memory**: what the publisher holds for viewers (buffers, dirty sets, what may be sent again), against a bound that follows \
from the bone and the number of viewers alone.
* **Stream**: a viewer that connects in the middle of the cut; the time until its picture is whole, and the bytes of each second \
after that.
* Times are this machine's, and are no promise: the tests assert bits, bounds and counts, not microseconds.";
