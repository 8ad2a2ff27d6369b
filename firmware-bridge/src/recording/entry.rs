//! A tick as the servo hands it to the recorder, and the same in the session file.

use crate::link::LinkStats;
use osteon_protocol::device::{DriveState, StateFrame};
use osteon_protocol::ipc::WirePose;
use osteon_protocol::session::{self, Outcome, flag};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{MAX_REQUESTS, Request, Sample, Servo, TickOutput};
use rtrb::Producer;

/// Ticks that the ring to the recorder holds: a disk may stall for 16 s.
pub(crate) const RING_TICKS: usize = 16_384;

/// A tick, of fixed size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recorded {
    pub tick: u64,
    /// On the loop's clock, ns.
    pub started_ns: u64,
    pub late_ns: u64,
    pub skipped: u64,
    /// Ticks just before this one that found the ring full.
    pub lost: u64,
    pub sample: Option<session::Sample>,
    /// Whether the device was away before this tick.
    pub reconnected: bool,
    pub requests: [Request; MAX_REQUESTS],
    pub request_count: usize,
    pub outcome: Outcome,
    pub link: session::Link,
}

/// The servo's end of the ring. A full ring stops nothing: the ticks are counted.
#[derive(Debug)]
pub(crate) struct Tap {
    ring: Producer<Recorded>,
    lost: u64,
    reconnected: bool,
}

impl Tap {
    pub(crate) fn new(ring: Producer<Recorded>) -> Self {
        Self {
            ring,
            lost: 0,
            reconnected: false,
        }
    }

    /// The device was away: the next tick begins anew.
    pub(crate) fn reconnect(&mut self) {
        self.reconnected = true;
    }

    pub(crate) fn push(&mut self, mut recorded: Recorded) {
        recorded.lost = self.lost;
        recorded.reconnected = core::mem::take(&mut self.reconnected);
        match self.ring.push(recorded) {
            Ok(()) => self.lost = 0,
            Err(_) => self.lost += 1,
        }
    }
}

impl Recorded {
    /// What the file says of it; `origin_ns`: when the first tick began.
    pub(crate) fn in_file(&self, origin_ns: u64) -> session::Tick {
        session::Tick {
            tick: self.tick,
            started_ns: self.started_ns.saturating_sub(origin_ns),
            late_ns: self.late_ns,
            skipped: self.skipped,
            sample: self.sample,
            requests: (self
                .reconnected
                .then_some(session::Request::Reconnected)
                .into_iter())
            .chain(
                self.requests[..self.request_count]
                    .iter()
                    .map(|r| request_in_file(*r)),
            )
            .collect(),
            outcome: self.outcome,
            link: self.link,
        }
    }
}

/// What a tick made, as the file has it.
pub(crate) fn outcome(output: &TickOutput, servo: &Servo) -> Outcome {
    let mut flags = 0;
    for (holds, bit) in [
        (output.spindle_on, flag::SPINDLE_ON),
        (output.paused, flag::PAUSED),
        (output.embedded, flag::EMBEDDED),
        (output.waiting, flag::WAITING),
        (output.saturated, flag::SATURATED),
        (output.clutched, flag::CLUTCHED),
        (output.fresh, flag::FRESH),
    ] {
        flags |= if holds { bit } else { 0 };
    }
    Outcome {
        torque: output.torque,
        bone_from_tool: pose_in_file(&output.bone_from_tool),
        bone_from_device: pose_in_file(&output.bone_from_device),
        force_n: output.force_n.to_array(),
        physical_force_n: output.physical_force_n.to_array(),
        spindle_rad_s: output.spindle_rad_s,
        spindle_nmm: output.spindle_nmm,
        energy_mj: output.energy_mj,
        removed_by_class: output.removed_by_class,
        epoch: output.epoch,
        revision: servo.cut().revision() + u64::from(servo.carving()),
        work: output.work,
        tool: output.tool,
        checkpoints: output.checkpoints,
        flags,
    }
}

pub(crate) fn pose_in_file(pose: &Pose) -> WirePose {
    crate::haptics::wire_pose(pose)
}

/// A sample as the file has it.
pub(crate) fn sample_in_file(sample: &Sample, seq: u16) -> session::Sample {
    session::Sample {
        seq,
        time_micros: sample.time_micros,
        encoders: sample.encoders,
        gimbal: sample.gimbal,
        buttons: sample.buttons,
        drive_active: sample.drive_active,
        docked: sample.docked,
        applied: sample.applied,
        ack_age: sample.ack_age,
    }
}

/// The sample that the step took.
pub(crate) fn sample_of(sample: &session::Sample) -> Sample {
    Sample {
        time_micros: sample.time_micros,
        encoders: sample.encoders,
        gimbal: sample.gimbal,
        buttons: sample.buttons,
        drive_active: sample.drive_active,
        docked: sample.docked,
        applied: sample.applied,
        ack_age: sample.ack_age,
    }
}

fn request_in_file(request: Request) -> session::Request {
    match request {
        Request::SelectTool(tool) => session::Request::SelectTool(tool),
        Request::Spindle(on) => session::Request::Spindle(on),
        Request::Pause(paused) => session::Request::Pause(paused),
        Request::Reset => session::Request::Reset,
        Request::Clutch(hold) => session::Request::Clutch(hold),
        Request::MotionScale(scale) => session::Request::MotionScale(scale),
        Request::TurnWorkspace(angle) => session::Request::TurnWorkspace(angle),
        Request::Checkpoint => session::Request::Checkpoint,
        Request::Undo => session::Request::Undo,
    }
}

/// The request that the step took; `None` where it is none of the step's.
pub(crate) fn request_of(request: session::Request) -> Option<Request> {
    let request = match request {
        session::Request::Reconnected => return None,
        session::Request::SelectTool(tool) => Request::SelectTool(tool),
        session::Request::Spindle(on) => Request::Spindle(on),
        session::Request::Pause(paused) => Request::Pause(paused),
        session::Request::Reset => Request::Reset,
        session::Request::Clutch(hold) => Request::Clutch(hold),
        session::Request::MotionScale(scale) => Request::MotionScale(scale),
        session::Request::TurnWorkspace(angle) => Request::TurnWorkspace(angle),
        session::Request::Checkpoint => Request::Checkpoint,
        session::Request::Undo => Request::Undo,
    };
    Some(request)
}

/// Drive states by their number on the wire.
const DRIVES: [DriveState; 8] = [
    DriveState::Boot,
    DriveState::Unhomed,
    DriveState::Homed,
    DriveState::Armed,
    DriveState::Active,
    DriveState::Hold,
    DriveState::Tripped,
    DriveState::Fault,
];

/// The drive state of a number in the file.
pub(crate) fn drive_of(number: u8) -> Option<DriveState> {
    DRIVES.get(usize::from(number)).copied()
}

/// The link as the file has it, from the newest state and the link's counters.
pub(crate) fn link_in_file(state: Option<&StateFrame>, stats: LinkStats) -> session::Link {
    let drive = state.map(|s| s.drive);
    let number = DRIVES.iter().position(|d| Some(*d) == drive);
    session::Link {
        drive: number.and_then(|n| u8::try_from(n).ok()).unwrap_or(u8::MAX),
        faults: state.map_or(0, |s| s.faults),
        trips: state.map_or(0, |s| s.trips),
        frames: stats.frames,
        crc_errors: stats.crc_errors,
        gaps: stats.gaps,
        stale: stats.stale,
        dropped_commands: stats.dropped_commands,
    }
}
