//! The host in lockstep: the servo's own beat behind a link of bytes, and the start of a session.

use crate::haptics::record::{Record, TickRecord};
use crate::haptics::resync::Resync;
use crate::haptics::servo_loop::{Beat, Ending, ServoThread, Timing, one_beat};
use crate::link::handshake::{Arming, Greeting, Step};
use crate::link::inbox::{Arrivals, Inbox};
use crate::link::{DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::scene::Scene;
use osteon_protocol::device::{CommandFrame, HostMessage, StateFrame};
use osteon_protocol::firmware::DriveConfig;
use osteon_protocol::frame::{MAX_FRAME, encode};
use osteon_sim_core::servo::{Request, Servo};
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const RING: usize = 4096;

/// The host's end of the cable.
#[derive(Debug, Clone, Default)]
pub(super) struct End {
    pub(super) inbound: Vec<u8>,
    pub(super) outbound: Vec<u8>,
    pub(super) unplugged: bool,
    inbox: Inbox,
}

impl End {
    fn tell(&mut self, message: HostMessage) {
        let mut out = [0; MAX_FRAME];
        self.outbound
            .extend_from_slice(encode(&message, &mut out).unwrap_or(&[]));
    }

    fn arrivals(&mut self) -> Result<(Arrivals, Vec<u8>), LinkError> {
        if self.unplugged {
            return Err(LinkError::Gone {
                link: name(),
                errno: rustix::io::Errno::IO,
            });
        }
        let bytes = core::mem::take(&mut self.inbound);
        let arrivals = self.inbox.take(&bytes);
        if self.inbox.restarted() {
            return Err(LinkError::Restarted { link: name() });
        }
        Ok((arrivals, bytes))
    }
}

fn name() -> Arc<str> {
    "lockstep".into()
}

/// The end, shared between the bench and the link.
#[derive(Debug, Clone, Default)]
pub(super) struct Shared(Arc<Mutex<End>>);

impl Shared {
    pub(super) fn of(end: End) -> Self {
        Self(Arc::new(Mutex::new(end)))
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, End> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct LockstepLink {
    end: Shared,
    info: DeviceInfo,
}

impl DeviceLink for LockstepLink {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }
    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        Ok(self.end.lock().arrivals()?.0.state)
    }
    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        self.end.lock().tell(HostMessage::Command(*command));
        Ok(())
    }
    fn disarm(&mut self) {
        self.end.lock().tell(HostMessage::Disarm);
    }
    fn stats(&self) -> LinkStats {
        self.end.lock().inbox.stats
    }
    fn describe(&self) -> String {
        name().to_string()
    }
}

/// The start: hello, home, arm; the steps are the product's.
#[derive(Debug)]
pub(super) enum Start {
    Greeting(Greeting),
    Arming(Arming),
}

impl Default for Start {
    fn default() -> Self {
        Self::Greeting(Greeting::new(name()))
    }
}

impl Start {
    /// One look at the cable; true when the drive is armed.
    pub(super) fn step(&mut self, now: u64, end: &mut End) -> Result<bool, LinkError> {
        let (got, bytes) = end.arrivals()?;
        let step = match self {
            Self::Greeting(greeting) => match greeting.step(now, &got, &bytes)? {
                Step::Done(_) => {
                    *self = Self::Arming(Arming::new(name()));
                    Step::Wait
                }
                Step::Tell(message) => Step::Tell(message),
                Step::Wait => Step::Wait,
            },
            Self::Arming(arming) => arming.step(now, &got)?,
        };
        if let Step::Tell(message) = step {
            end.tell(message);
        }
        Ok(step == Step::Done(()))
    }
}

/// A running servo thread without a thread.
pub(super) struct Loop {
    thread: ServoThread,
    beat: Beat,
    records: Consumer<Record>,
    _requests: Producer<Request>,
}

impl Loop {
    pub(super) fn new(
        servo: Servo,
        (end, scene, tools): (&Shared, &Scene, &[Tool]),
        beat: Beat,
    ) -> Self {
        let (record_in, records) = RingBuffer::new(RING);
        let (requests, request_out) = RingBuffer::new(8);
        let link = LockstepLink {
            end: end.clone(),
            info: DeviceInfo::omni(&DriveConfig::omni(1).hello),
        };
        let thread = ServoThread {
            resync: Resync::new(&scene.bone, tools.to_vec()),
            servo,
            link: Box::new(link),
            records: record_in,
            requests: request_out,
            recording: None,
            panic_at_tick: None,
        };
        Self {
            thread,
            beat,
            records,
            _requests: requests,
        }
    }

    /// One tick of the servo's own loop at `now` ns.
    pub(super) fn beat(
        &mut self,
        now: u64,
        kept: &mut Option<Vec<TickRecord>>,
    ) -> Result<(), Ending> {
        let timing = Timing {
            started: now,
            late_ns: 0,
            skipped: 0,
        };
        let done = one_beat(&mut self.thread, &mut self.beat, &timing, &|| now);
        while let Ok(record) = self.records.pop() {
            if let (Some(kept), Record::Tick(tick)) = (kept.as_mut(), record) {
                kept.push(tick);
            }
        }
        done
    }

    pub(super) fn state(&self) -> (Servo, Beat) {
        (self.thread.servo.clone(), self.beat.clone())
    }
}
