//! The device's comings and goings: how it is opened, whose clock it may be, and how a session waits for one
//! that went away.

use super::publisher::{Publisher, warn};
use super::servo_loop::{Ending, Finished, Master, ServoThread};
use super::{Clock, HapticsArgs};
use crate::link::{self, Clocks, DeviceInfo, DeviceLink, DeviceSpec, LinkError, LinkStats};
use anyhow::{Context as _, anyhow, bail};
use osteon_protocol::ipc_frame::clip;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Pause between two tries to open a device that went away.
const RETRY: Duration = Duration::from_millis(100);
/// Time between two visits of the publisher.
const VISIT: Duration = Duration::from_millis(4);
/// How far a device's period may be from a tick for its clock to run the loop, µs.
const PERIODS_MICROS: std::ops::RangeInclusive<u16> = 950..=1050;

/// Whose clock runs the loop on this link.
pub(super) fn master(wanted: Option<Clock>, link: &dyn DeviceLink) -> anyhow::Result<Master> {
    let period = link.info().period_micros;
    let name = link.describe();
    match (wanted, link.clock()) {
        (Some(Clock::Host), Clocks::DeviceOnly) => {
            bail!("--clock host: {name}: its library calls when it wants; give --clock device")
        }
        (Some(Clock::Device), Clocks::HostOnly) => {
            bail!("--clock device: {name}: the device only answers; give --clock host")
        }
        (Some(Clock::Device), _) | (None, Clocks::DeviceOnly) => {
            if !PERIODS_MICROS.contains(&period) {
                bail!(
                    "--clock device: {name}: its period is {period} µs, a tick is 1000 µs; give --clock host"
                );
            }
            Ok(Master::Device)
        }
        (Some(Clock::Host) | None, _) => Ok(Master::Host),
    }
}

/// What is left of a session's device.
pub(super) enum Left {
    /// It is back: a thread for it, and the tick to go on with.
    Back(Box<ServoThread>, u64),
    /// The session is over; whether somebody asked for it.
    Over(Box<Finished>, bool),
}

/// A session's device over all its links.
pub(super) struct Comings {
    spec: DeviceSpec,
    info: DeviceInfo,
    patience: Duration,
    /// Counters of the links that went away.
    pub(super) gone: LinkStats,
    /// Times that it came back.
    pub(super) reconnects: u64,
}

impl Comings {
    pub(super) fn new(args: &HapticsArgs, spec: DeviceSpec, link: &dyn DeviceLink) -> Self {
        Self {
            spec,
            info: link.info().clone(),
            patience: Duration::from_secs_f64(args.reconnect_for),
            gone: LinkStats::default(),
            reconnects: 0,
        }
    }

    /// Whether this ending is one that a device may come back from.
    fn may_return(&self, ending: &Ending) -> bool {
        let away = matches!(
            ending,
            Ending::Link(
                LinkError::Gone { .. } | LinkError::Restarted { .. } | LinkError::Library { .. }
            ) | Ending::Silent
                | Ending::Restarted
        );
        away && !self.patience.is_zero()
    }

    /// Waits for the device, serving the viewers meanwhile. It must be the same arm with the same scale: the
    /// servo's numbers are made for it.
    pub(super) fn wait(
        &mut self,
        finished: Finished,
        publisher: &mut Publisher,
        over: &dyn Fn() -> bool,
    ) -> anyhow::Result<Left> {
        if !self.may_return(&finished.ending) {
            return Ok(Left::Over(Box::new(finished), false));
        }
        let why = super::session::ending_text(&finished.ending).unwrap_or_default();
        let seconds = self.patience.as_secs_f64();
        warn(&format!(
            "{why}; the motors are off, the bone stays as it is: waiting {seconds} s for the device"
        ));
        let name = std::mem::replace(
            &mut publisher.link_name,
            clip("device gone: waiting for it").to_owned(),
        );
        let Finished {
            mut thread,
            tick,
            ending,
        } = finished;
        self.gone = self.gone + thread.link.stats();
        // the port must be free, and a vendor's library let go, before it can be opened again
        thread.link = Box::new(Absent(self.info.clone()));
        let search = Search::begin(self.spec.clone(), self.info.clone())?;
        let began = Instant::now();
        let (mut asked, mut back) = (false, None);
        while !asked && back.is_none() && began.elapsed() < self.patience {
            asked = over() || publisher.visit(None);
            search.news().for_each(|line| warn(&line));
            back = search.found()?;
            std::thread::sleep(VISIT);
        }
        publisher.link_name = name;
        let late = search.end()?;
        let Some(link) = back.or(late).filter(|_| !asked) else {
            let ending = Finished {
                thread,
                tick,
                ending,
            };
            return Ok(Left::Over(Box::new(ending), asked));
        };
        warn("the device is back: the session goes on, the force begins anew from zero");
        self.reconnects += 1;
        thread.link = link;
        thread.servo.reconnect();
        if let Some(recording) = &mut thread.recording {
            recording.reconnect();
        }
        Ok(Left::Back(Box::new(thread), tick))
    }
}

/// The thread that tries to open the device: an attempt may take seconds.
struct Search {
    stop: Arc<AtomicBool>,
    lines: Receiver<String>,
    found: Receiver<Box<dyn DeviceLink>>,
    thread: JoinHandle<()>,
}

impl Search {
    fn begin(spec: DeviceSpec, wanted: DeviceInfo) -> anyhow::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let (say, lines) = sync_channel(8);
        let (give, found) = sync_channel(1);
        let flag = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("device-search".to_owned())
            .spawn(move || search(&spec, &wanted, &flag, (&say, &give)))
            .context("cannot start a thread to look for the device")?;
        Ok(Self {
            stop,
            lines,
            found,
            thread,
        })
    }

    fn news(&self) -> impl Iterator<Item = String> {
        self.lines.try_iter()
    }

    fn found(&self) -> anyhow::Result<Option<Box<dyn DeviceLink>>> {
        match self.found.try_recv() {
            Ok(link) => Ok(Some(link)),
            Err(_) if self.thread.is_finished() => match self.found.try_recv() {
                Ok(link) => Ok(Some(link)),
                Err(_) => Err(anyhow!(
                    "the search for the device crashed; please report this"
                )),
            },
            Err(_) => Ok(None),
        }
    }

    /// Ends the search; a device that was found at the last moment.
    fn end(self) -> anyhow::Result<Option<Box<dyn DeviceLink>>> {
        self.stop.store(true, Ordering::Relaxed);
        let crashed = |_| anyhow!("the search for the device crashed; please report this");
        self.thread.join().map_err(crashed)?;
        Ok(self.found.try_recv().ok())
    }
}

fn search(
    spec: &DeviceSpec,
    wanted: &DeviceInfo,
    stop: &AtomicBool,
    (say, give): (&SyncSender<String>, &SyncSender<Box<dyn DeviceLink>>),
) {
    let mut last = String::new();
    while !stop.load(Ordering::Relaxed) {
        let line = match again(spec, wanted) {
            Ok(link) => {
                // nobody listens any more: the link disarms itself when it is dropped
                let _given = give.send(link);
                return;
            }
            // that it is away was said already
            Err(error @ (LinkError::NoPort { .. } | LinkError::Gone { .. })) => {
                last.clear();
                drop(error);
                String::new()
            }
            Err(error) => error.to_string(),
        };
        if !line.is_empty() && line != last {
            // a line that nobody takes is one too many
            let _said = say.try_send(line.clone());
            last = line;
        }
        std::thread::sleep(RETRY);
    }
}

fn again(spec: &DeviceSpec, wanted: &DeviceInfo) -> Result<Box<dyn DeviceLink>, LinkError> {
    let mut link = link::open(spec)?;
    let info = link.info();
    if info.scale != wanted.scale || info.model != wanted.model {
        return Err(LinkError::Another {
            link: link.describe().into(),
            model: info.model.clone(),
            wanted: wanted.model.clone(),
        });
    }
    link.prepare()?;
    link.start()?;
    Ok(link)
}

/// Stands where a device was.
#[derive(Debug)]
struct Absent(DeviceInfo);

impl DeviceLink for Absent {
    fn info(&self) -> &DeviceInfo {
        &self.0
    }
    fn poll(&mut self) -> Result<Option<osteon_protocol::device::StateFrame>, LinkError> {
        Ok(None)
    }
    fn send(&mut self, _: &osteon_protocol::device::CommandFrame) -> Result<(), LinkError> {
        Ok(())
    }
    fn disarm(&mut self) {}
    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
    fn describe(&self) -> String {
        "no device".to_owned()
    }
}
