//! Faults in real time: the cable's two lanes in front of the pty, and what begins when.

use super::device::{Device, DeviceSetup};
use super::faults::{Direction, Fault, Lane, Planned, Where};
use osteon_protocol::device::{DEVICE_SCHEMA, DEVICE_VERSION, HostMessage};

/// The faults of a run. Time is that since the start, in whole milliseconds of the device's clock.
#[derive(Debug)]
pub(super) struct Disturbance {
    plan: Vec<Planned>,
    seed: u64,
    ms: u64,
    to_host: Lane,
    to_device: Lane,
    unplugged_until: Option<u64>,
}

/// What the pty has to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Plug {
    /// Nothing.
    Stay,
    /// Close it.
    Pull,
    /// Open it again.
    PutBack,
}

impl Disturbance {
    pub(super) fn new(plan: &[Planned], seed: u64) -> Self {
        Self {
            plan: plan.to_vec(),
            seed,
            ms: 0,
            to_host: Lane::new(0),
            to_device: Lane::new(0),
            unplugged_until: None,
        }
    }

    /// What holds from the device's start on; its period, ns.
    pub(super) fn build(&self, setup: &mut DeviceSetup, period_ns: u64) -> u64 {
        let mut period = period_ns;
        for planned in &self.plan {
            match planned.fault {
                Fault::SeqWrap => setup.first_seq = u16::MAX - 3000,
                Fault::EncoderWrap => setup.power_up = [i32::MAX - 20; 3],
                // 100 ppm of a millisecond
                Fault::DriftFast => period = period_ns - period_ns / 10_000,
                Fault::DriftSlow => period = period_ns + period_ns / 10_000,
                _ => {}
            }
        }
        period
    }

    /// Begins what is due; `said` gets a line for each fault.
    pub(super) fn begin(&mut self, device: &mut Device, mut said: impl FnMut(String)) -> Plug {
        self.ms += 1;
        let mut plug = Plug::Stay;
        if self.unplugged_until.is_some_and(|at| self.ms >= at) {
            self.unplugged_until = None;
            plug = Plug::PutBack;
        }
        let at_s = self.ms as f64 * 1e-3;
        let due = self.plan.iter().position(|p| p.at_s <= at_s);
        let Some(planned) = due.map(|n| self.plan.remove(n)) else {
            return plug;
        };
        said(format!("{at_s:.3} s: {planned} begins, seed {}", self.seed));
        let now = self.ms * 1_000_000;
        let entry = planned.entry();
        match (planned.fault, entry.place) {
            (Fault::BrownOut, _) => device.brown_out(),
            (Fault::Unplug, _) => {
                self.to_host.clear();
                self.to_device.clear();
                self.unplugged_until = Some(self.ms + u64::from(entry.lasts_ms));
                plug = Plug::Pull;
            }
            (Fault::TwoHosts, _) => {
                let hello = HostMessage::HelloRequest {
                    version: DEVICE_VERSION,
                    schema: DEVICE_SCHEMA,
                };
                let _to_the_other_host = device.receive(hello);
            }
            (fault, Where::Sensors) => device.inject(fault, self.seed),
            (Fault::WrongSchema | Fault::WrongVersion, _) => {
                self.to_host.inject(planned.fault, now, self.seed);
            }
            (_, Where::Setup) => {}
            (fault, _) if planned.direction == Direction::ToDevice => {
                self.to_device.inject(fault, now, self.seed);
            }
            (fault, _) => self.to_host.inject(fault, now, self.seed),
        }
        plug
    }

    /// Bytes from the host on their way: what comes out now.
    pub(super) fn pass_from_host(&mut self, bytes: &[u8]) -> Vec<u8> {
        pass(&mut self.to_device, self.ms, bytes)
    }

    /// Bytes to the host on their way: what comes out now.
    pub(super) fn pass_to_host(&mut self, bytes: &[u8]) -> Vec<u8> {
        pass(&mut self.to_host, self.ms, bytes)
    }
}

fn pass(lane: &mut Lane, ms: u64, bytes: &[u8]) -> Vec<u8> {
    let now = ms * 1_000_000;
    let mut out = Vec::new();
    lane.put(now, bytes);
    lane.take(now, &mut out);
    out
}
