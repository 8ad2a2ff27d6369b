//! The host in lockstep: the servo's own beat behind a link of bytes, and the start of a session.

use crate::haptics::record::{Record, TickRecord};
use crate::haptics::resync::Resync;
use crate::haptics::servo_loop::{Beat, Ending, ServoThread, Timing, one_beat};
use crate::link::inbox::{Arrivals, Inbox};
use crate::link::{DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::scene::Scene;
use osteon_protocol::device::{
    CommandFrame, DEVICE_SCHEMA, DEVICE_VERSION, DriveState, HostMessage, StateFrame, switch,
};
use osteon_protocol::firmware::DriveConfig;
use osteon_protocol::frame::{MAX_FRAME, encode};
use osteon_sim_core::servo::{Request, Servo};
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A request without an answer is repeated so often, ns.
const REPEAT_NS: u64 = 100_000_000;
/// Longest start, ns.
const START_NS: u64 = 4_000_000_000;
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

    fn arrivals(&mut self) -> Result<Arrivals, LinkError> {
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
        Ok(arrivals)
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
        Ok(self.end.lock().arrivals()?.state)
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

/// The start: hello, home, arm.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Start {
    greeted: bool,
    began: Option<u64>,
    asked: Option<u64>,
}

impl Start {
    /// One look at the cable; true when the drive is armed.
    pub(super) fn step(&mut self, now: u64, end: &mut End) -> Result<bool, LinkError> {
        let link = name();
        let began = *self.began.get_or_insert(now);
        let got = end.arrivals()?;
        if let Some(hello) = got.hello {
            let (device, host) = (hello.version, DEVICE_VERSION);
            if device != host {
                return Err(LinkError::Version { link, device, host });
            }
            if hello.schema != DEVICE_SCHEMA {
                return Err(LinkError::Schema {
                    link,
                    device: hello.schema,
                    host: DEVICE_SCHEMA,
                });
            }
            if !self.greeted {
                (self.greeted, self.asked) = (true, None);
            }
        }
        if let Some(nonce) = got.nonce {
            end.tell(HostMessage::ArmConfirm { nonce });
        }
        let drive = got.state.map(|s| s.drive);
        if self.greeted && drive == Some(DriveState::Armed) {
            return Ok(true);
        }
        if now.saturating_sub(began) > START_NS {
            return Err(LinkError::Silent { link, seconds: 4 });
        }
        if self.asked.is_some_and(|at| now - at < REPEAT_NS) {
            return Ok(false);
        }
        let docked = got.state.is_some_and(|s| s.switches & switch::DOCKED != 0);
        let message = match (self.greeted, drive) {
            (false, _) => HostMessage::HelloRequest {
                version: DEVICE_VERSION,
                schema: DEVICE_SCHEMA,
            },
            (true, Some(DriveState::Unhomed)) if !docked => {
                return Err(LinkError::NotDocked { link });
            }
            (true, Some(DriveState::Unhomed)) => HostMessage::Home,
            (true, Some(DriveState::Homed)) => HostMessage::Arm,
            (true, Some(DriveState::Fault)) => HostMessage::Disarm,
            _ => return Ok(false),
        };
        end.tell(message);
        self.asked = Some(now);
        Ok(false)
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
