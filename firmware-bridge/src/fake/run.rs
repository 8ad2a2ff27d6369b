//! The process `fake-omni`: the simulated device in real time behind a pty.

use super::cable::Cable;
use super::device::{Device, DeviceSetup};
use super::disturb::{Disturbance, Plug};
use super::faults::Planned;
use super::hand::Hold;
use super::stroke::Stroke;
use super::truth::TruthLog;
use crate::haptics::socket::{private_dir, runtime_dir};
use crate::rt;
use anyhow::Context as _;
use osteon_protocol::device::HostMessage;
use osteon_protocol::frame::{FrameReader, MAX_FRAME};
use std::io::Write;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// One above the servo's: the device must not starve under its host's load.
const PRIORITY: u8 = rt::SERVO_PRIORITY + 1;
pub(super) const PERIOD_NS: u64 = 1_000_000;
/// A wake-up later than this is not caught up: the device's world stands still instead, or the
/// watchdog would trip for a stall of the simulation.
pub(super) const MAX_CATCH_UP_NS: u64 = 4 * PERIOD_NS;
/// Most bytes read in one tick: 227 commands.
const READ_BYTES: usize = 4096;
/// A host that says nothing for so many ticks has left.
const HOST_GONE_TICKS: u32 = 500;

/// A device in this process outlives its host by so many ticks.
const LAST_TICKS: u32 = 50;

/// Options of the simulated device.
#[derive(Debug, Clone, clap::Args)]
pub struct FakeArgs {
    /// Symbolic link to the serial port that a host opens [default: fake-omni in the user's runtime
    /// directory]; packet:PATH serves the same frames as 64-byte reports on a socket; tty:PATH and hidg:PATH serve
    /// a USB gadget of this kernel, serial or HID; hfab2:PATH and
    /// hfab3:PATH speak the text protocol of a vintage Phantom and of `WoodenHaptics`
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// What the simulated hand does: JSON with `segments` of `name`, `goal_mm`, `axis`, `speed_mm_s`,
    /// `max_push_n`, `press`, `dwell_s`, `timeout_s` (gimbal centre in the device's base frame);
    /// without it the stylus stays in its dock
    #[arg(long, value_name = "FILE")]
    pub stroke: Option<PathBuf>,
    /// Write the ground truth here, one CSV line for each state frame
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Stop after so many seconds of device time
    #[arg(long, value_name = "N", value_parser = parse_seconds)]
    pub seconds: Option<f64>,
    /// Break something on purpose: NAME@SECONDS:DIRECTION, of which NAME will do, for example drop-frames@2.5:to-host; may be
    /// given several times. A wrong name lists all; BENCH.md says what each does
    #[arg(long, value_name = "FAULT")]
    pub fault: Vec<Planned>,
    /// Who holds the stylus
    #[arg(long, value_enum, default_value_t)]
    pub hold: Hold,
    /// Seed of faults, nonces and of the encoders' values at power-up
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// End when the starting process ends
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e6 => Ok(seconds),
        _ => Err("give a number of seconds above 0".to_owned()),
    }
}

impl FakeArgs {
    /// The link's path: given, or the default.
    pub fn link_path(&self) -> PathBuf {
        self.link.clone().unwrap_or_else(default_link)
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the cast saturates at zero and at the end of time"
    )]
    pub(super) fn ticks(&self) -> u64 {
        self.seconds.map_or(u64::MAX, |s| (s * 1000.0) as u64)
    }
}

/// Where `fake-omni` puts its link, and a host looks for it, by default.
pub fn default_link() -> PathBuf {
    runtime_dir().join("fake-omni")
}

/// What happened on the cable.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// State frames made; those that the host did not take are among them.
    pub frames: u64,
    /// Frames dropped because the host did not read.
    pub dropped: u64,
    /// Torque commands that came.
    pub commands: u64,
    /// Frames refused for CRC or shape.
    pub bad_frames: u64,
    /// Time for which the device's world stood still, because the process was not run, ms.
    pub stalled_ms: u64,
}

/// The device, its cable and its files.
#[derive(Debug)]
struct Bench {
    device: Device,
    // none while the plug is out
    port: Option<Cable>,
    faults: Option<Disturbance>,
    period_ns: u64,
    reader: FrameReader,
    truth: Option<TruthLog>,
    tally: Tally,
    silent_ticks: u32,
}

/// Runs the simulated device until a signal, or for `--seconds`.
pub fn run(args: &FakeArgs) -> anyhow::Result<()> {
    if args.die_with_parent {
        rt::die_with_parent().context("fake-omni: cannot follow the starting process")?;
    }
    let stop = crate::stop::on_signals()?;
    if args.link.is_none() {
        private_dir(&runtime_dir())?;
    }
    ask_rights()?;
    let tally = serve(args, &stop, &mut std::io::stdout())?;
    writeln!(std::io::stderr(), "fake-omni: {tally}")?;
    Ok(())
}

/// Serves hosts until `stop` or for `--seconds`; `out` hears when the port is there. What happened, in a
/// line.
pub(crate) fn serve(
    args: &FakeArgs,
    stop: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<String> {
    match super::hfab::asked_for(&args.link_path()) {
        Some((model, link)) => super::hfab::serve(model, &link, args, (stop, out)),
        None => Bench::new(args)?.go(args, stop, out),
    }
}

/// A simulated device as a thread of this process.
#[derive(Debug)]
pub(crate) struct InProcess {
    pub stroke: Stroke,
    pub seed: u64,
    pub truth: Option<PathBuf>,
}

impl InProcess {
    /// Starts the thread; `end` is its end of a socket of packets. It ends with `stop`.
    pub(crate) fn start(
        self,
        end: OwnedFd,
        stop: Arc<AtomicBool>,
    ) -> anyhow::Result<JoinHandle<()>> {
        let truth = self.truth.as_deref().map(TruthLog::create).transpose()?;
        let mut bench = Bench {
            device: Device::new(self.stroke, self.seed),
            port: Some(Cable::connected(end)),
            faults: None,
            period_ns: PERIOD_NS,
            reader: FrameReader::new(),
            truth,
            tally: Tally::default(),
            silent_ticks: 0,
        };
        let thread = std::thread::Builder::new()
            .name("simulated-device".to_owned())
            .spawn(move || {
                // refused rights are those that the servo thread is refused, too
                let _right = rt::set_fifo(PRIORITY);
                bench.stream(&stop);
                // what its host said last, and its watchdog, still have their way
                for _ in 0..LAST_TICKS {
                    bench.tick();
                }
                // a truth file that fails is a test that fails
                let _written = bench.truth.map_or(Ok(()), TruthLog::finish);
            })?;
        Ok(thread)
    }
}

/// A refusal is said, and the device runs without.
fn ask_rights() -> anyhow::Result<()> {
    let mut warnings = std::io::stderr();
    for right in [rt::lock_memory(), rt::set_fifo(PRIORITY)] {
        if !right.granted() {
            writeln!(warnings, "fake-omni: {right}")?;
        }
    }
    Ok(())
}

impl Bench {
    fn new(args: &FakeArgs) -> anyhow::Result<Self> {
        let stroke = match &args.stroke {
            Some(path) => Stroke::load(path)?,
            None => Stroke::default(),
        };
        let truth = match &args.truth {
            Some(path) => Some(TruthLog::create(path)?),
            None => None,
        };
        let mut setup = DeviceSetup {
            hold: args.hold,
            ..DeviceSetup::new(stroke, args.seed)
        };
        let faults = (!args.fault.is_empty()).then(|| Disturbance::new(&args.fault, args.seed));
        let period_ns = faults
            .as_ref()
            .map_or(PERIOD_NS, |f| f.build(&mut setup, PERIOD_NS));
        Ok(Self {
            device: Device::build(setup),
            port: Some(Cable::open(&args.link_path())?),
            faults,
            period_ns,
            reader: FrameReader::new(),
            truth,
            tally: Tally::default(),
            silent_ticks: 0,
        })
    }

    fn go(
        mut self,
        args: &FakeArgs,
        stop: &AtomicBool,
        out: &mut dyn Write,
    ) -> anyhow::Result<String> {
        writeln!(out, "fake-omni: ready at {}", args.link_path().display())?;
        out.flush()?;
        self.serve(args, stop)?;
        self.finish()
    }

    // without faults, until `stop`
    fn stream(&mut self, stop: &AtomicBool) {
        let mut deadline = rt::now_ns();
        while self.in_time(&mut deadline, stop) {
            self.tick();
        }
    }

    // waits for the next period; false where the process shall end
    fn in_time(&mut self, deadline: &mut u64, stop: &AtomicBool) -> bool {
        *deadline += self.period_ns;
        rt::sleep_until(*deadline);
        let late = rt::now_ns().saturating_sub(*deadline);
        if late > MAX_CATCH_UP_NS {
            *deadline += late;
            self.tally.stalled_ms += late / PERIOD_NS;
        }
        !stop.load(Ordering::Relaxed)
    }

    fn serve(&mut self, args: &FakeArgs, stop: &AtomicBool) -> anyhow::Result<()> {
        let mut deadline = rt::now_ns();
        for _ in 0..args.ticks() {
            if !self.in_time(&mut deadline, stop) {
                break;
            }
            self.break_something(args)?;
            self.tick();
        }
        Ok(())
    }

    fn break_something(&mut self, args: &FakeArgs) -> anyhow::Result<()> {
        let Some(faults) = &mut self.faults else {
            return Ok(());
        };
        let mut said = Vec::new();
        let plug = faults.begin(&mut self.device, |line| said.push(line));
        for line in said {
            writeln!(std::io::stderr(), "fake-omni: {line}")?;
        }
        match plug {
            Plug::Stay => {}
            Plug::Pull => self.port = None,
            Plug::PutBack => self.port = Some(Cable::open(&args.link_path())?),
        }
        Ok(())
    }

    fn tick(&mut self) {
        self.device.simulate();
        self.receive();
        let mut out = [0; MAX_FRAME];
        let (state, frame) = self.device.tick_frame(&mut out);
        self.tally.frames += 1;
        if !self.send(frame) {
            self.tally.dropped += 1;
        }
        if let Some(truth) = &mut self.truth {
            truth.push(self.device.truth(&state));
        }
    }

    fn receive(&mut self) {
        let mut bytes = [0; READ_BYTES];
        let count = self.port.as_mut().map_or(0, |port| port.read(&mut bytes));
        let came = match &mut self.faults {
            Some(faults) => faults.pass_from_host(&bytes[..count]),
            None => Vec::new(),
        };
        let came = if self.faults.is_some() {
            came.as_slice()
        } else {
            &bytes[..count]
        };
        for &byte in came {
            self.count(byte);
            let mut out = [0; MAX_FRAME];
            let answer = self.device.push(byte, &mut out);
            if !answer.is_empty() {
                // An answer that does not fit is lost like any other byte: the host asks again.
                let _taken = self.send(answer);
            }
        }
        self.watch_for_a_gone_host(count);
    }

    fn count(&mut self, byte: u8) {
        match self.reader.push::<HostMessage>(byte) {
            Some(Ok(message)) => {
                self.tally.commands += u64::from(matches!(message, HostMessage::Command(_)));
            }
            Some(Err(_)) => self.tally.bad_frames += 1,
            None => {}
        }
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        let Some(port) = &mut self.port else {
            return false;
        };
        match &mut self.faults {
            Some(faults) => faults
                .pass_to_host(frame)
                .chunks(MAX_FRAME)
                .all(|piece| port.write_frame(piece)),
            None => port.write_frame(frame),
        }
    }

    fn watch_for_a_gone_host(&mut self, bytes: usize) {
        self.silent_ticks = if bytes > 0 { 0 } else { self.silent_ticks + 1 };
        if self.silent_ticks == HOST_GONE_TICKS {
            self.silent_ticks = 0;
            if let Some(port) = &self.port {
                port.release_claim();
            }
        }
    }

    fn finish(self) -> anyhow::Result<String> {
        let torque = self.device.plant().torque_nmm();
        let t = self.tally;
        let line = format!(
            "{} frames ({} dropped), {} commands, {} crc errors, {} trips, \
             {} segments given up, stood still {} ms, last torque [{:.1}, {:.1}, {:.1}] N·mm",
            t.frames,
            t.dropped,
            t.commands,
            t.bad_frames,
            self.device.firmware().trips(),
            self.device.hand().timeouts(),
            t.stalled_ms,
            torque.x,
            torque.y,
            torque.z,
        );
        self.truth.map_or(Ok(()), TruthLog::finish)?;
        Ok(line)
    }
}

#[cfg(test)]
mod tests;
