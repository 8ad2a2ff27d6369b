//! `osteon report latency`: how punctual the servo is on this machine, beside `cyclictest` in the same minute.
//!
//! What is measured is the product itself: `osteon haptics` on a simulated device, its own histograms. An
//! absolute figure says little on a shared machine; each row has a ratio to what `cyclictest` saw under the same
//! scheduler and load.

mod bystander;
mod load;
mod output;

use super::Machine;
use crate::measure::intrinsic;
use anyhow::{Context as _, Result, bail};
use bystander::cyclictest;
use load::{Load, Loaded};
use osteon_firmware_bridge::progress::Progress;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct LatencyArgs {
    /// Folder for latency.json, latency.md, the table and the plots; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Length of each session and of each run of cyclictest, s
    #[arg(long, value_name = "S", default_value_t = 8.0, value_parser = osteon_firmware_bridge::haptics::positive)]
    pub seconds: f64,
    /// Only check that the report can be made: two short sessions
    #[arg(long)]
    pub quick: bool,
}

/// p50, p99, p99.9 and the largest, µs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub p50: f64,
    /// 99 %.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

/// One way to a device, at a scheduler, under a load.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// How the bytes go.
    pub transport: &'static str,
    /// Whose clock ran the loop.
    pub clock: &'static str,
    /// Scheduling of the servo's thread.
    pub scheduler: &'static str,
    /// What else the machine did.
    pub load: &'static str,
    /// From a tick's deadline to its start, µs.
    pub wake_us: Spread,
    /// Duration of a tick, µs.
    pub tick_us: Spread,
    /// From a command to its acknowledgement, µs; the device's period of 1 ms is in it.
    pub roundtrip_us: Spread,
    /// What cyclictest saw in the same minute; absent where it is not installed.
    pub cyclictest_us: Option<Spread>,
    /// Ticks that were made.
    pub ticks: u64,
    /// Periods that were skipped, as a tick began that late.
    pub skipped_periods: u64,
    /// State frames that are missing in their sequence.
    pub gaps: u64,
    /// Watchdog trips of the device.
    pub trips: u64,
    /// Pictures that a viewer drew meanwhile.
    pub frames_rendered: u64,
    /// Rights that the system refused.
    pub refused: Vec<String>,
}

/// A way to a simulated device: its name, what `fake-omni` serves, what `--device` says, the clock.
struct Way {
    name: &'static str,
    link: Option<&'static str>,
    device: &'static str,
    clock: &'static str,
}

const WAYS: [Way; 4] = [
    Way {
        name: "pty",
        link: Some(""),
        device: "open:",
        clock: "host",
    },
    Way {
        name: "pty",
        link: Some(""),
        device: "open:",
        clock: "device",
    },
    Way {
        name: "packets",
        link: Some("packet:"),
        device: "packet:",
        clock: "host",
    },
    Way {
        name: "in-process",
        link: None,
        device: "sim",
        clock: "host",
    },
];

const SCHEDULERS: [&str; 2] = ["fifo", "other"];

/// Measures and writes. A machine that is late is no error.
pub fn run(args: &LatencyArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    // asked for, and given back: the sessions choose their core themselves
    let timer = intrinsic::timer_cost_ns();
    let mut machine = Machine::look(Err("sessions pin their own servo".to_owned()), timer);
    let (seconds, loads, ways) = if args.quick {
        (1.0, &[Load::Idle][..], &WAYS[2..])
    } else {
        (args.seconds, &Load::ALL[..], &WAYS[..])
    };
    let mut progress = Progress::new("latency report");
    let mut rows = Vec::new();
    let schedulers = &SCHEDULERS[..if args.quick { 1 } else { 2 }];
    let all = (loads.len() * schedulers.len() * (ways.len() + 1)) as f32;
    let mut done = 0.0;
    for &load in loads {
        for scheduler in schedulers {
            let mut step = |what: &str| {
                progress.show(&format!("{} {scheduler} {what}", load.name()), done / all);
                done += 1.0;
            };
            step("cyclictest");
            let beside = cyclictest(scheduler, load, seconds)?;
            for way in ways {
                step(way.name);
                rows.push(
                    session(way, scheduler, load, seconds)?.row(way, scheduler, load, beside),
                );
            }
        }
    }
    progress.finish();
    machine.finish();
    output::write(&args.out, &machine, seconds, &rows)
}

/// A folder that goes away again.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Result<Self> {
        let path = std::env::temp_dir().join(format!("osteon-latency-{}", std::process::id()));
        std::fs::create_dir_all(&path)
            .with_context(|| format!("{}: cannot be made", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // what is left of it is in the system's own temporary folder
        let _left = std::fs::remove_dir_all(&self.0);
    }
}

/// A child of this program, which ends with its handle.
struct Helper(Child);

impl Helper {
    fn start(args: &[&str]) -> Result<Self> {
        let program = std::env::current_exe().context("this program's own path")?;
        let mut command = Command::new(program);
        command
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Ok(Self(
            command
                .spawn()
                .context("starting a part of the measurement")?,
        ))
    }

    fn wait(&mut self, limit: Duration) -> Result<bool> {
        let began = Instant::now();
        while began.elapsed() < limit {
            if let Some(status) = self.0.try_wait()? {
                return Ok(status.success());
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        bail!("a session did not end within {} s", limit.as_secs())
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        // it has ended already, or is of no use any more
        self.0.kill().unwrap_or(());
        drop(self.0.wait());
    }
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

fn until(what: &str, mut ready: impl FnMut() -> bool) -> Result<()> {
    let began = Instant::now();
    while !ready() {
        if began.elapsed() > Duration::from_secs(30) {
            bail!("{what} did not come within 30 s");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}

/// What a session reports, as far as it is needed here.
#[derive(Debug, Deserialize)]
struct Session {
    wake_us: Spread,
    tick_us: Spread,
    device_roundtrip_us: Spread,
    ticks: u64,
    skipped_periods: u64,
    realtime_refused: Vec<String>,
    device: SessionDevice,
    viewer: SessionViewer,
}

#[derive(Debug, Deserialize)]
struct SessionDevice {
    gaps: u64,
    watchdog_trips: u64,
}

#[derive(Debug, Deserialize)]
struct SessionViewer {
    frames_rendered: u64,
}

fn session(way: &Way, scheduler: &str, load: Load, seconds: f64) -> Result<Session> {
    let folder = Folder::new()?;
    let (port, socket) = (folder.0.join("omni"), folder.0.join("s/haptics.sock"));
    let report = folder.0.join("report.json");
    let mut device = way.device.to_owned();
    let _fake = match way.link {
        None => None,
        Some(kind) => {
            device += &text(&port);
            let fake = Helper::start(&["fake-omni", "--link", &format!("{kind}{}", text(&port))])?;
            until("the simulated device", || port.exists())?;
            Some(fake)
        }
    };
    let (socket, seconds, json) = (text(&socket), seconds.to_string(), text(&report));
    let mut args = vec![
        "haptics",
        "--device",
        &device,
        "--voxel-mm",
        "1.5",
        "--socket",
        &socket,
    ];
    args.extend(["--seconds", &seconds, "--json", &json, "--clock", way.clock]);
    args.extend((scheduler == "other").then_some("--no-realtime"));
    let mut haptics = Helper::start(&args)?;
    let loaded = Loaded::begin(load, &socket, &folder.0)?;
    let fine = haptics.wait(Duration::from_mins(2))?;
    drop(loaded);
    if !fine {
        bail!(
            "a session over {} failed; try 'osteon haptics --device {device}'",
            way.name
        );
    }
    let bytes = std::fs::read(&report).with_context(|| format!("{json}: no report"))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{json}: not a session's report"))
}

impl Session {
    fn row(self, way: &Way, scheduler: &'static str, load: Load, beside: Option<Spread>) -> Row {
        Row {
            transport: way.name,
            clock: way.clock,
            scheduler,
            load: load.name(),
            wake_us: self.wake_us,
            tick_us: self.tick_us,
            roundtrip_us: self.device_roundtrip_us,
            cyclictest_us: beside,
            ticks: self.ticks,
            skipped_periods: self.skipped_periods,
            gaps: self.device.gaps,
            trips: self.device.watchdog_trips,
            frames_rendered: self.viewer.frames_rendered,
            refused: self.realtime_refused,
        }
    }
}
