//! The device and the operator as the steps see them.

use crate::link::{DeviceLink, LinkError};
use crate::rt::{now_ns, sleep_until};
use anyhow::{Context as _, bail};
use glam::DVec3;
use osteon_protocol::device::{CommandFrame, DriveState, StateFrame, switch};
use osteon_sim_core::servo::DeviceScale;
use std::io::{BufRead as _, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};

const PERIOD_NS: u64 = 1_000_000;
/// A device that is silent for so many periods has gone.
const SILENT: u32 = 1000;

/// What a state says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    /// Gimbal's centre, base frame, mm.
    pub(super) position: DVec3,
    /// Stylus axis from its tip to its rear end, base frame.
    pub(super) axis: DVec3,
    /// Pressed buttons: bit 0 the front one, bit 1 the back one.
    pub(super) buttons: u8,
    pub(super) docked: bool,
    pub(super) drive: DriveState,
    pub(super) faults: u16,
    /// Largest torque at the motors, counts.
    pub(super) applied: i16,
}

impl Look {
    pub(super) fn new(state: &StateFrame, scale: &DeviceScale) -> Self {
        let q = scale.arm.coordinates(state.encoders, scale);
        let stylus = scale.arm.stylus(q, scale.arm.gimbal(state.gimbal, scale));
        Self {
            position: stylus.translation,
            axis: stylus.rotation * DVec3::Z,
            buttons: state.switches & (switch::BUTTON_1 | switch::BUTTON_2),
            docked: state.switches & switch::DOCKED != 0,
            drive: state.drive,
            faults: state.faults,
            applied: state.applied.map(i16::abs).into_iter().max().unwrap_or(0),
        }
    }
}

/// A command's counts that show `force_n` (base frame) in this state; the vector is scaled into the range.
pub(super) fn counts(state: &StateFrame, scale: &DeviceScale, force_n: DVec3) -> [i16; 3] {
    let q = scale.arm.coordinates(state.encoders, scale);
    let torque = scale.arm.torque(q, force_n) / scale.arm.gear() / scale.nmm_per_count;
    let most = f64::from(scale.dac_max);
    let share = (most / torque.abs().max_element().max(1e-9)).min(1.0);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "|value| ≤ dac_max; NaN gives 0"
    )]
    let counts = (torque * share).round().to_array().map(|v| v as i16);
    counts
}

/// Device and operator.
pub(super) trait Rig {
    /// One millisecond with this force at the stylus, N, base frame; the newest state.
    fn beat(&mut self, force_n: DVec3) -> anyhow::Result<Look>;
    /// A line from the operator, if one has come.
    fn answer(&mut self) -> Option<String>;
    /// A line to the operator.
    fn tell(&mut self, line: &str);
}

/// A link and the terminal.
pub(super) struct Bench {
    link: Box<dyn DeviceLink>,
    scale: DeviceScale,
    stop: Arc<AtomicBool>,
    lines: Receiver<String>,
    state: Option<StateFrame>,
    seq: u16,
    silent: u32,
    deadline: u64,
}

impl Bench {
    pub(super) fn new(link: Box<dyn DeviceLink>, stop: Arc<AtomicBool>) -> anyhow::Result<Self> {
        let (say, lines) = sync_channel(16);
        std::thread::Builder::new()
            .name("operator".to_owned())
            .spawn(move || {
                for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                    if say.send(line).is_err() {
                        return;
                    }
                }
            })
            .context("no thread to hear the operator")?;
        Ok(Self {
            scale: link.info().scale,
            link,
            stop,
            lines,
            state: None,
            seq: 0,
            silent: 0,
            deadline: now_ns(),
        })
    }

    fn command(&mut self, torque: [i16; 3], enable: bool) -> Result<(), LinkError> {
        self.seq = self.seq.wrapping_add(1).max(1);
        let command = CommandFrame {
            seq: self.seq,
            state_seq: self.state.map_or(0, |s| s.seq),
            torque,
            enable,
        };
        self.link.send(&command)
    }

    /// Motors off.
    pub(super) fn end(&mut self) {
        if self.command([0; 3], false).is_ok() {
            self.link.disarm();
        }
    }
}

impl Rig for Bench {
    fn beat(&mut self, force_n: DVec3) -> anyhow::Result<Look> {
        // a period that is over is skipped
        self.deadline = (self.deadline + PERIOD_NS).max(now_ns());
        sleep_until(self.deadline);
        if self.stop.load(Ordering::Relaxed) {
            bail!("asked to end");
        }
        let fresh = self.link.poll()?;
        self.silent = if fresh.is_some() { 0 } else { self.silent + 1 };
        if self.silent > SILENT {
            bail!("the device sent nothing for 1 s; check its power and cable");
        }
        self.state = fresh.or(self.state);
        let torque = self
            .state
            .map_or([0; 3], |state| counts(&state, &self.scale, force_n));
        self.command(torque, true)?;
        match self.state {
            Some(state) => Ok(Look::new(&state, &self.scale)),
            None => self.beat(force_n),
        }
    }

    fn answer(&mut self) -> Option<String> {
        self.lines.try_recv().ok()
    }

    fn tell(&mut self, line: &str) {
        // a terminal that is gone is noticed by its operator
        let _gone = writeln!(std::io::stderr(), "{line}");
    }
}
