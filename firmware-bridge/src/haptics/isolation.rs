//! A session whose inputs do not depend on the clock, with the real publisher and real viewers at it:
//! whatever they do, torques and bone must be those of a session without any.
//!
//! For the report on isolation; the product never runs it.

use super::opening::Session;
use super::outset::Outset;
use super::publisher::{Publisher, wire_digest};
use super::record::Record;
use super::rehearsal::{HELLO, Scripted, Sent, scene_and_servo};
use super::resync::Resync;
use super::servo_loop::{Beat, ServoThread, Timing, one_beat};
use super::socket;
use super::viewers::Viewers;
use crate::link::DeviceInfo;
use anyhow::{Context as _, Result};
use osteon_protocol::ipc::Digest;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::servo::Request;
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, RingBuffer};
use std::cell::Cell;
use std::path::Path;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// Ticks between two visits of the publisher, as in a session.
const TICKS_PER_VISIT: u32 = 4;
/// Between the last tick and the question for the last digests.
const SENSES: Duration = Duration::from_millis(1500);
/// Longest wait for the viewers' last digests.
const LAST_WORD: Duration = Duration::from_secs(8);
/// Records of the ring.
const RING: usize = 16_384;

/// What a session came to.
#[derive(Debug)]
pub struct Played {
    /// Torques of every command.
    pub torques: Vec<[i16; 3]>,
    /// Digest of the servo's cut.
    pub digest: Digest,
    /// The same of the publisher's mirror.
    pub mirror_digest: Digest,
    /// What viewers answered.
    pub answers: Vec<Digest>,
    /// Every step that was carved.
    pub steps: Vec<CarveStep>,
    /// Most bytes held for viewers at one time.
    pub peak_bytes: usize,
    /// Most bytes that so many viewers could have made it hold.
    pub bound_bytes: usize,
    bone: Arc<Bone>,
    tools: Vec<Tool>,
}

impl Played {
    /// Carved steps whose effect is missing from a viewer's final cut: carving them again changes it.
    pub fn missing(&self, mut cut: Cut) -> usize {
        let mut missing = 0;
        for step in &self.steps {
            let mut changed = false;
            let tool = &self.tools[usize::from(step.tool)];
            carve(&self.bone, &mut cut, tool, step, &mut |_, _| changed = true);
            missing += usize::from(changed);
        }
        missing
    }
}

struct Rig {
    thread: ServoThread,
    beat: Beat,
    records: Consumer<Record>,
    publisher: Publisher,
    steps: Vec<CarveStep>,
    // virtual, ns
    now: Cell<u64>,
}

/// Plays so many ticks with viewers at `socket`, at the speed of a session; `ready` is called once they
/// can connect, `over` after the last tick: then they have `SENSES` to come to theirs.
pub fn play(
    ticks: u32,
    socket: &Path,
    ready: impl FnOnce(),
    over: impl FnOnce(),
) -> Result<Played> {
    let (mut rig, sent) = rig(socket)?;
    ready();
    let began = Instant::now();
    for tick in 0..ticks {
        rig.beat()?;
        if (tick + 1) % TICKS_PER_VISIT == 0 {
            rig.publish(None);
            let due = Duration::from_millis(u64::from(tick) + 1);
            std::thread::sleep(due.saturating_sub(began.elapsed()));
        }
    }
    rig.thread.servo.finish_carving();
    over();
    let until = Instant::now() + SENSES;
    while Instant::now() < until {
        rig.publish(None);
        std::thread::sleep(Duration::from_millis(4));
    }
    let digest = wire_digest(rig.thread.servo.cut().digest(rig.thread.servo.bone()));
    let mirror = &rig.publisher.mirror;
    let mirror_digest = wire_digest(mirror.cut.digest(&mirror.bone));
    let until = Instant::now() + LAST_WORD;
    while Instant::now() < until {
        rig.publish(Some(mirror_digest));
        if rig.publisher.viewers.all_answered() {
            break;
        }
        std::thread::sleep(Duration::from_millis(4));
    }
    let answers = rig.publisher.viewers.reports().map(|r| r.digest).collect();
    rig.publisher.viewers.farewell("played to its end");
    let counts = rig.publisher.viewers.counts;
    let torques = sent.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let bone = Arc::clone(&rig.publisher.mirror.bone);
    Ok(Played {
        torques,
        digest,
        mirror_digest,
        answers,
        steps: rig.steps,
        peak_bytes: counts.peak_bytes,
        bound_bytes: Viewers::most_held(bone.chunk_count(), counts.most),
        bone,
        tools: Tool::standard_set(),
    })
}

impl Rig {
    fn beat(&mut self) -> Result<()> {
        let started = self.now.get() + 1_000_000;
        self.now.set(started);
        let timing = Timing {
            started,
            late_ns: 0,
            skipped: 0,
        };
        let now = &self.now;
        one_beat(&mut self.thread, &mut self.beat, &timing, &|| now.get())
            .map_err(|ending| anyhow::anyhow!("the scripted session ended: {ending:?}"))
    }

    fn publish(&mut self, last: Option<Digest>) {
        while let Ok(record) = self.records.pop() {
            if let Record::Carved { step, .. } = &record {
                self.steps.push(*step);
            }
            self.publisher.take(&record);
        }
        self.publisher.visit(last);
    }
}

fn rig(path: &Path) -> Result<(Rig, Sent)> {
    let (scene, servo) = scene_and_servo();
    let tools = Tool::standard_set();
    let feel = Feel::default();
    let (record_in, records) = RingBuffer::new(RING);
    let (mut requests, request_out) = RingBuffer::new(8);
    requests.push(Request::Spindle(true)).context("no room")?;
    requests.push(Request::SelectTool(1)).context("no room")?;
    let sent = Sent::default();
    let session = Session {
        tools: &tools,
        scene: &scene,
        feel: &feel,
    };
    // the servo does not read the publisher's requests, so nobody's wish changes the session
    let (publisher, _) =
        Outset::default().publisher(&session, socket::listen(path)?, 3.3, "scripted");
    let rig = Rig {
        thread: ServoThread {
            servo,
            link: Box::new(Scripted {
                info: DeviceInfo::omni(&HELLO),
                seq: 0,
                sent: Arc::clone(&sent),
            }),
            records: record_in,
            requests: request_out,
            resync: Resync::new(&scene.bone, tools),
            recording: None,
            panic_at_tick: None,
        },
        beat: Beat::new(0),
        records,
        publisher,
        steps: Vec::new(),
        now: Cell::new(0),
    };
    Ok((rig, sent))
}
