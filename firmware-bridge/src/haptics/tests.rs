//! The servo's border to the publisher, with a scripted cable and a small ring.

use super::mirror::Mirror;
use super::record::Record;
use super::resync::Resync;
use super::servo_loop::{Beat, ServoThread, Timing, one_beat};
use crate::link::{DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use crate::scene::{Scene, SceneArgs, load};
use glam::{DQuat, DVec3};
use osteon_protocol::device::{CommandFrame, DeviceHello, DriveState, StateFrame};
use osteon_sim_core::contact::ContactConfig;
use osteon_sim_core::omni;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{DeviceScale, Request, Servo, ServoSetup};
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;

const HELLO: DeviceHello = DeviceHello {
    version: 1,
    schema: 0,
    model: 1,
    serial: 1,
    counts_per_rev: 15_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    micro_nm_per_count: 215,
    period_micros: 1000,
};

/// A cable whose device goes up and down the planned axis.
struct Scripted {
    seq: u16,
}

impl Scripted {
    /// Height over the plan, mm: from 15 down to 5 mm below it and up again, every 8 s.
    fn height(&self) -> f64 {
        let phase = f64::from(self.seq % 8000) / 1000.0;
        15.0 - 5.0 * phase.min(8.0 - phase)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "counts of small angles")]
fn state(seq: u16, z: f64) -> StateFrame {
    let t = omni::inverse(DVec3::new(0.0, 0.0, z)).expect("in reach");
    let gimbal = omni::gimbal_for(t, DQuat::IDENTITY).expect("a pose");
    let per_rad = |counts: f64| counts / std::f64::consts::TAU;
    StateFrame {
        seq,
        time_micros: u32::from(seq) * 1000,
        encoders: ((t - omni::DOCK) * per_rad(15_000.0))
            .to_array()
            .map(|v| v.floor() as i32),
        gimbal: (gimbal * per_rad(16_384.0))
            .to_array()
            .map(|v| v.round() as i16),
        switches: 0,
        drive: DriveState::Active,
        faults: 0,
        applied: [0; 3],
        temperature: [25; 3],
        ack: 0,
        crc_errors: 0,
        refused: 0,
        trips: 0,
    }
}

impl DeviceLink for Scripted {
    fn info(&self) -> &DeviceHello {
        &HELLO
    }
    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        self.seq += 1;
        Ok(Some(state(self.seq, self.height())))
    }
    fn send(&mut self, _command: &CommandFrame) -> Result<(), LinkError> {
        Ok(())
    }
    fn disarm(&mut self) {}
    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
    fn describe(&self) -> String {
        "scripted".to_owned()
    }
}

/// Servo and publisher's mirror with a ring of `capacity` records between them.
struct Pair {
    thread: ServoThread,
    beat: Beat,
    records: Consumer<Record>,
    requests: Producer<Request>,
    mirror: Mirror,
}

impl Pair {
    fn new(capacity: usize) -> Self {
        let args = SceneArgs {
            voxel_mm: Some(1.2),
            ..SceneArgs::default()
        };
        let scene: Scene = load(&args, &mut |_, _| {}).expect("the phantom");
        let tools = Tool::standard_set();
        let servo = Servo::new(ServoSetup {
            bone: Arc::clone(&scene.bone),
            tools: tools.clone(),
            bone_from_base: bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()),
            bone_from_plan: scene.bone_from_plan,
            device: DeviceScale {
                counts_per_rev: 15_000,
                gimbal_counts_per_rev: 16_384,
                dac_max: 2047,
                nmm_per_count: 0.215,
            },
            force_limit_n: 3.3,
            contact: ContactConfig::default(),
        })
        .expect("tools");
        let (record_in, records) = RingBuffer::new(capacity);
        let (mut requests, request_out) = RingBuffer::new(64);
        requests.push(Request::Spindle(true)).expect("room");
        Self {
            thread: ServoThread {
                servo,
                link: Box::new(Scripted { seq: 0 }),
                records: record_in,
                requests: request_out,
                resync: Resync::new(&scene.bone, tools.clone()),
                panic_at_tick: None,
            },
            beat: Beat::new(),
            records,
            requests,
            mirror: Mirror::new(scene.bone, tools),
        }
    }

    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            let timing = Timing {
                started: now_ns(),
                late_ns: 0,
                skipped: 0,
            };
            one_beat(&mut self.thread, &mut self.beat, &timing).expect("a tick");
        }
    }

    /// Takes at most `count` records out of the ring.
    fn drain(&mut self, count: usize) {
        for _ in 0..count {
            let Ok(record) = self.records.pop() else {
                return;
            };
            self.mirror.apply(&record, &mut |_, _| {});
        }
    }

    fn assert_equal(&self) {
        let bone = self.thread.servo.bone();
        let (servo, mirror) = (self.thread.servo.cut(), &self.mirror.cut);
        assert_eq!(servo.digest(bone), mirror.digest(bone));
        assert_eq!(servo.totals().by_class, mirror.totals().by_class);
        assert_eq!(servo.totals().by_label, mirror.totals().by_label);
        assert!(servo.digest(bone).changed_chunks > 0);
    }
}

#[test]
fn a_mirror_that_keeps_up_has_the_same_bits() {
    let mut pair = Pair::new(4096);
    for _ in 0..40 {
        pair.run(100);
        pair.drain(usize::MAX);
    }
    assert_eq!(pair.thread.resync.overflows(), 0);
    pair.assert_equal();
}

#[test]
fn a_full_ring_is_recovered_from_brick_by_brick() {
    // the publisher sleeps through the cut, then wakes up slowly while the servo goes on
    let mut pair = Pair::new(2048);
    pair.run(3800);
    assert!(pair.thread.resync.overflows() > 0, "the ring was full");
    assert!(pair.thread.resync.is_behind());
    for _ in 0..400 {
        pair.drain(64);
        pair.run(10);
    }
    pair.drain(usize::MAX);
    assert!(!pair.thread.resync.is_behind(), "all was copied");
    pair.assert_equal();
}

#[test]
fn a_mirror_catches_up_while_the_tool_keeps_cutting() {
    let mut pair = Pair::new(2048);
    pair.run(3000);
    assert!(pair.thread.resync.is_behind());
    // the descent goes on until tick 4000: all is copied before it ends
    for _ in 0..90 {
        pair.drain(usize::MAX);
        pair.run(10);
    }
    pair.drain(usize::MAX);
    assert!(!pair.thread.resync.is_behind());
    let carved = pair.thread.servo.cut().revision();
    pair.run(5);
    assert!(pair.thread.servo.cut().revision() > carved, "still cutting");
    pair.drain(usize::MAX);
    pair.assert_equal();
}

#[test]
fn resets_that_find_the_ring_full_are_not_lost() {
    let mut pair = Pair::new(2048);
    pair.run(3800);
    pair.requests.push(Request::Reset).expect("room");
    pair.run(50);
    pair.requests.push(Request::Reset).expect("room");
    // out of the bone, and a second cut
    pair.run(4300);
    assert_eq!(pair.thread.servo.cut().epoch(), 2);
    for _ in 0..500 {
        pair.drain(64);
        pair.run(10);
    }
    pair.drain(usize::MAX);
    assert_eq!(pair.mirror.cut.epoch(), 2);
    pair.assert_equal();
}

#[test]
fn a_servo_that_stops_in_debt_is_caught_up_with() {
    let mut pair = Pair::new(2048);
    pair.run(3800);
    pair.drain(usize::MAX);
    assert!(pair.thread.resync.is_behind());
    let truth = pair.thread.servo.cut().clone();
    pair.mirror.catch_up(&truth, 0, &mut |_, _| {});
    pair.assert_equal();
}
