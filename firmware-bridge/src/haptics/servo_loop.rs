//! The servo thread: absolute deadlines of 1 ms, newest device state, one pure tick, one command.
//!
//! After [`run`] has entered its loop it allocates nothing, takes no lock, opens and logs nothing. On
//! every way out (stop, error, panic) the last bytes it sends are a zero torque and a disarm.

use super::record::{COPY_VALUES, Felt, Flags, Record, TickRecord};
use super::resync::Resync;
use crate::link::{DeviceLink, LinkError};
use crate::recording::{Recorded, Tap, link_in_file, outcome, sample_in_file};
use crate::rt::{now_ns, sleep_until};
use osteon_protocol::device::{CommandFrame, DriveState, StateFrame, switch};
use osteon_sim_core::servo::{MAX_REQUESTS, Request, Sample, Servo, TickOutput};
use rtrb::{Consumer, Producer};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};

/// Period of the servo loop, ns.
pub(crate) const PERIOD_NS: u64 = 1_000_000;
/// Device link silent for this long: the session ends, ns.
const LOST_AFTER_NS: u64 = 1_000_000_000;

/// So many states in a row of a drive that is not armed any more: the session ends.
const DISARMED_RUN: u32 = 100;

/// Why the loop ended.
#[derive(Debug)]
pub(crate) enum Ending {
    /// It was asked to.
    Stopped,
    /// The device went away or sent something impossible.
    Link(LinkError),
    /// The device stopped sending.
    Silent,
    /// The device has lost its homing: it was restarted.
    Restarted,
    /// The drive was disarmed: by another program on the same device.
    Disarmed,
    /// A bug: the message of the panic.
    Panicked(String),
}

/// What the thread owns while it runs.
pub(crate) struct ServoThread {
    pub servo: Servo,
    pub link: Box<dyn DeviceLink>,
    pub records: Producer<Record>,
    pub requests: Consumer<Request>,
    pub resync: Resync,
    /// To the recorder, where there is one.
    pub recording: Option<Tap>,
    /// Tick at which to panic: proves the motors' way to zero.
    pub panic_at_tick: Option<u64>,
}

/// What it hands back.
pub(crate) struct Finished {
    pub thread: ServoThread,
    /// The tick that would have been next.
    pub tick: u64,
    pub ending: Ending,
}

impl Finished {
    /// Whether bricks are still owed to the publisher.
    pub(crate) fn behind(&self) -> bool {
        // a panic may lie between carving and telling
        self.thread.resync.is_behind() || !matches!(self.ending, Ending::Stopped)
    }
}

/// Whose clock runs the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Master {
    /// This machine's: a deadline each millisecond.
    Host,
    /// The device's: a tick for each state.
    Device,
}

/// Loop-local state that outlives a tick.
#[derive(Debug, Clone)]
pub(crate) struct Beat {
    tick: u64,
    command_seq: u16,
    last_ack: u16,
    last_state: Option<StateFrame>,
    last_state_ns: u64,
    // when each command was sent, by the low byte of its number
    sent_ns: [u64; 256],
    // states in a row that say that nobody has armed the drive
    disarmed_run: u32,
}

/// Runs from tick `first` on until `stop`, an error or a panic; then turns the motors off.
pub(crate) fn run(
    mut thread: ServoThread,
    (master, first): (Master, u64),
    stop: &AtomicBool,
) -> Finished {
    let mut beat = Beat::new(now_ns());
    beat.tick = first;
    let outcome = catch_unwind(AssertUnwindSafe(|| match master {
        Master::Host => beat_until(&mut thread, &mut beat, stop),
        Master::Device => follow_until(&mut thread, &mut beat, stop),
    }));
    let ending = match outcome {
        Ok(ending) => ending,
        Err(payload) => Ending::Panicked(panic_message(payload.as_ref())),
    };
    motors_off(thread.link.as_mut(), beat.command_seq);
    // the mirror has carved the pending step whole
    thread.servo.finish_carving();
    Finished {
        thread,
        tick: beat.tick,
        ending,
    }
}

pub(crate) fn panic_message(payload: &(dyn std::any::Any + Send)) -> String {
    payload
        .downcast_ref::<&str>()
        .map(ToString::to_string)
        .or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "unknown panic".to_owned())
}

fn motors_off(link: &mut dyn DeviceLink, last_seq: u16) {
    let command = CommandFrame {
        seq: next_seq(last_seq),
        state_seq: 0,
        torque: [0; 3],
        enable: false,
    };
    // a cable that is gone needs no zero: the device's own watchdog has it
    if link.send(&command).is_ok() {
        link.disarm();
    }
}

fn next_seq(seq: u16) -> u16 {
    match seq.wrapping_add(1) {
        0 => 1,
        next => next,
    }
}

fn beat_until(thread: &mut ServoThread, beat: &mut Beat, stop: &AtomicBool) -> Ending {
    let mut deadline = now_ns() + PERIOD_NS;
    loop {
        sleep_until(deadline);
        if stop.load(Ordering::Relaxed) {
            return Ending::Stopped;
        }
        let started = now_ns();
        let late_ns = started.saturating_sub(deadline);
        // never piles up: periods that are over are skipped, and counted
        let skipped = late_ns / PERIOD_NS;
        let timing = Timing {
            started,
            late_ns,
            skipped,
        };
        if let Err(ending) = one_beat(thread, beat, &timing, &now_ns) {
            return ending;
        }
        deadline += (skipped + 1) * PERIOD_NS;
    }
}

/// The device's clock is the master: a tick when a state has come, or half a period after it should have, as
/// hold and ramp go by ticks.
fn follow_until(thread: &mut ServoThread, beat: &mut Beat, stop: &AtomicBool) -> Ending {
    const HALF: u64 = PERIOD_NS / 2;
    let mut due = now_ns() + PERIOD_NS;
    let mut last = 0;
    loop {
        // states that come in a burst make one tick in half a period
        sleep_until(last + HALF);
        thread.link.wait(due + HALF);
        if stop.load(Ordering::Relaxed) {
            return Ending::Stopped;
        }
        let started = now_ns();
        let came = started < due + HALF;
        let late_ns = started.saturating_sub(if came { due } else { due + HALF });
        let skipped = late_ns / PERIOD_NS;
        let timing = Timing {
            started,
            late_ns,
            skipped,
        };
        if let Err(ending) = one_beat(thread, beat, &timing, &now_ns) {
            return ending;
        }
        last = started;
        due = if came {
            started + PERIOD_NS
        } else {
            due + (skipped + 1) * PERIOD_NS
        };
    }
}

/// When a tick began.
pub(crate) struct Timing {
    /// On the loop's clock, ns.
    pub(crate) started: u64,
    /// After its own deadline, ns; whole periods of it were skipped.
    pub(crate) late_ns: u64,
    /// How many.
    pub(crate) skipped: u64,
}

impl Beat {
    /// Before the first tick, at `now` ns.
    pub(crate) fn new(now: u64) -> Self {
        Self {
            tick: 0,
            command_seq: 0,
            last_ack: 0,
            last_state: None,
            last_state_ns: now,
            sent_ns: [0; 256],
            disarmed_run: 0,
        }
    }

    // A drive that was restarted, or disarmed for good, needs a new start.
    fn watch_arming(&mut self, drive: DriveState) -> Result<(), Ending> {
        if matches!(drive, DriveState::Boot | DriveState::Unhomed) {
            return Err(Ending::Restarted);
        }
        let disarmed = drive == DriveState::Homed;
        self.disarmed_run = if disarmed { self.disarmed_run + 1 } else { 0 };
        if self.disarmed_run >= DISARMED_RUN {
            return Err(Ending::Disarmed);
        }
        Ok(())
    }

    /// Counts commands on from `seq`.
    pub(crate) fn counting_from(mut self, seq: u16) -> Self {
        self.command_seq = seq;
        self
    }
}

/// One tick: the newest state in, one command out, a record. All that is timed takes `clock` (ns): the
/// monotonic one in a session, a virtual one in lockstep; none of it changes what is sent.
pub(crate) fn one_beat(
    thread: &mut ServoThread,
    beat: &mut Beat,
    timing: &Timing,
    clock: &dyn Fn() -> u64,
) -> Result<(), Ending> {
    let started = timing.started;
    let fresh = thread.link.poll().map_err(Ending::Link)?;
    let polled = clock();
    let roundtrip_ns = fresh.and_then(|state| acknowledge(beat, &state, started));
    if started.saturating_sub(beat.last_state_ns) > LOST_AFTER_NS {
        return Err(Ending::Silent);
    }
    let (requests, count) = take_requests(&mut thread.requests);
    if let Some(state) = fresh {
        beat.watch_arming(state.drive)?;
    }
    let sample = fresh.map(|state| sample_of(&state, beat.command_seq));
    let output = thread.servo.tick(sample.as_ref(), &requests[..count]);
    if thread.panic_at_tick == Some(beat.tick) {
        induced_panic();
    }
    let computed = clock();
    let sent = send(thread, beat, &output, computed);
    let tick = TickRecord {
        tick: beat.tick,
        wake_ns: timing.late_ns,
        duration_ns: 0,
        read_ns: polled.saturating_sub(started),
        compute_ns: computed.saturating_sub(polled),
        roundtrip_ns,
        skipped: timing.skipped,
        state: fresh
            .filter(|_| output.fresh)
            .map(|s| (s.seq, s.time_micros)),
        stylus_in_base: output.stylus_in_base,
        bone_from_device: output.bone_from_device,
        bone_from_tool: output.bone_from_tool,
        force_n: output.force_n,
        felt: Felt::of(&output, &thread.servo),
        tool: output.tool,
        flags: Flags::of(&output),
        removed_by_class: output.removed_by_class,
        epoch: output.epoch,
        checkpoints: output.checkpoints,
        revision: begun(&thread.servo),
        drive: beat.last_state.map(|s| s.drive),
        trips: beat.last_state.map_or(0, |s| s.trips),
        guards: thread.servo.guards(),
        link: thread.link.stats(),
        ring_overflows: thread.resync.overflows(),
    };
    // what was carved is told even where the command did not go out
    let since = || clock().saturating_sub(started);
    publish(thread, &output, tick, &since);
    let input = fresh.zip(sample);
    record(thread, beat, timing, input, &requests[..count], &output);
    beat.tick += 1;
    sent
}

/// Hands the tick's inputs, and what came out, to the recorder.
fn record(
    thread: &mut ServoThread,
    beat: &Beat,
    timing: &Timing,
    input: Option<(StateFrame, Sample)>,
    requests: &[Request],
    output: &TickOutput,
) {
    let Some(recording) = &mut thread.recording else {
        return;
    };
    let mut kept = [Request::Reset; MAX_REQUESTS];
    kept[..requests.len()].copy_from_slice(requests);
    recording.push(Recorded {
        tick: beat.tick,
        started_ns: timing.started,
        late_ns: timing.late_ns,
        skipped: timing.skipped,
        lost: 0,
        reconnected: false,
        sample: input.map(|(state, sample)| sample_in_file(&sample, state.seq)),
        requests: kept,
        request_count: requests.len(),
        outcome: outcome(output, &thread.servo),
        link: link_in_file(beat.last_state.as_ref(), thread.link.stats()),
    });
}

/// Steps that began since the reset, the pending one included.
pub(super) fn begun(servo: &Servo) -> u64 {
    servo.cut().revision() + u64::from(servo.carving())
}

/// At most [`MAX_REQUESTS`]; the rest waits for the next tick.
fn take_requests(ring: &mut Consumer<Request>) -> ([Request; MAX_REQUESTS], usize) {
    let mut requests = [Request::Pause(false); MAX_REQUESTS];
    let mut count = 0;
    while count < MAX_REQUESTS {
        let Ok(request) = ring.pop() else {
            break;
        };
        requests[count] = request;
        count += 1;
    }
    (requests, count)
}

#[expect(
    clippy::panic,
    reason = "asked for on the command line, to prove that the motors stop"
)]
fn induced_panic() {
    panic!("induced by --panic-at-tick");
}

fn acknowledge(beat: &mut Beat, state: &StateFrame, now: u64) -> Option<u64> {
    beat.last_state = Some(*state);
    beat.last_state_ns = now;
    if state.ack == beat.last_ack {
        return None;
    }
    beat.last_ack = state.ack;
    let sent = beat.sent_ns[usize::from(state.ack & 0xff)];
    // an acknowledgement of more than 255 commands ago would name the wrong one
    let recent = beat.command_seq.wrapping_sub(state.ack) < 255;
    (recent && sent != 0).then(|| now.saturating_sub(sent))
}

/// `last_seq`: of the newest command that was sent, one tick ago.
fn sample_of(state: &StateFrame, last_seq: u16) -> Sample {
    let behind = last_seq.wrapping_sub(state.ack);
    let ack_age = match (state.ack, u8::try_from(behind)) {
        (1.., Ok(behind)) => behind.saturating_add(1),
        _ => 0,
    };
    Sample {
        time_micros: state.time_micros,
        encoders: state.encoders,
        gimbal: state.gimbal,
        buttons: state.switches & (switch::BUTTON_1 | switch::BUTTON_2),
        drive_active: matches!(state.drive, DriveState::Active | DriveState::Hold),
        docked: state.switches & switch::DOCKED != 0,
        applied: state.applied,
        ack_age,
    }
}

fn send(
    thread: &mut ServoThread,
    beat: &mut Beat,
    output: &TickOutput,
    now: u64,
) -> Result<(), Ending> {
    beat.command_seq = next_seq(beat.command_seq);
    beat.sent_ns[usize::from(beat.command_seq & 0xff)] = now;
    let command = CommandFrame {
        seq: beat.command_seq,
        state_seq: beat.last_state.map_or(0, |s| s.seq),
        torque: output.torque,
        enable: true,
    };
    thread.link.send(&command).map_err(Ending::Link)
}

/// Hands the tick to the publisher. A full ring stops nothing: what was carved is remembered by
/// brick and copied later, a few parts a tick.
fn publish(
    thread: &mut ServoThread,
    output: &TickOutput,
    mut tick: TickRecord,
    since_start: &dyn Fn() -> u64,
) {
    let (records, resync, servo) = (&mut thread.records, &mut thread.resync, &thread.servo);
    for event in output.events.iter() {
        resync.follow(event, servo, records);
    }
    for step in &output.carved[..output.carved_len] {
        let record = Record::Carved {
            tick: tick.tick,
            step: *step,
        };
        // the cut is a minimum: steps and copies may mix; only a reset that is owed goes first
        if resync.owes_reset() || records.push(record).is_err() {
            resync.mark(servo, step);
        }
    }
    resync.copy_some(servo, output, records);
    tick.duration_ns = since_start();
    if records.push(Record::Tick(tick)).is_err() {
        resync.count_lost_tick();
    }
}

const _: () = assert!(COPY_VALUES * 8 == osteon_sim_core::grid::BRICK_VOXELS);
