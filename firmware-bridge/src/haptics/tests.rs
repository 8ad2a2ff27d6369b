//! The servo's border to the publisher, with a scripted cable and a small ring.

use super::mirror::Mirror;
use super::publisher::forward;
use super::record::{Record, TickRecord};
use super::resync::Resync;
use super::servo_loop::{Beat, ServoThread, Timing, one_beat};
use super::stats::Stats;
use crate::link::{DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use crate::scene::{Scene, SceneArgs, load};
use glam::{DQuat, DVec3};
use osteon_protocol::device::{CommandFrame, DeviceHello, DriveState, StateFrame};
use osteon_protocol::ipc::Command;
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::chain::GUARDS;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::omni;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{Request, Servo, ServoSetup};
use osteon_sim_core::tissue::{Tissue, hu_of_density};
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;

pub(crate) const HELLO: DeviceHello = DeviceHello {
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
    info: DeviceInfo,
    seq: u16,
    /// Height over the plan, mm, at a state's number.
    height: fn(u16) -> f64,
}

/// From 15 down to 5 mm below the plan and up again, every 8 s.
fn slowly(seq: u16) -> f64 {
    let phase = f64::from(seq % 8000) / 1000.0;
    15.0 - 5.0 * phase.min(8.0 - phase)
}

/// Above the bone until the spindle turns, then 15 mm down in 50 ms, and after 150 ms up again.
fn in_a_hurry(seq: u16) -> f64 {
    let ms = f64::from(seq % 1000);
    7.0 - 0.3 * (ms - 500.0).min(800.0 - ms).clamp(0.0, 50.0)
}

/// In the air: at rest but for 2 mm down from state 200 on, and 1 mm more from 600 on.
fn in_two_steps(seq: u16) -> f64 {
    let way = |from: u16, most: u16| f64::from(seq.saturating_sub(from).min(most)) * 0.01;
    14.0 - way(200, 200) - way(600, 100)
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
    fn info(&self) -> &DeviceInfo {
        &self.info
    }
    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        self.seq += 1;
        Ok(Some(state(self.seq, (self.height)(self.seq))))
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

/// Half a space of soft bone below z = 6.1 mm.
#[expect(clippy::cast_possible_truncation, reason = "densities and millimetres")]
fn fine_slab() -> Arc<Bone> {
    let grid = Grid::new([287, 287, 54], DVec3::splat(0.15)).expect("a lattice");
    let layer = 287 * 287;
    let solid: Vec<f32> = (0..grid.len())
        .map(|n| 6.1 - 0.15 * (n / layer) as f32)
        .collect();
    let dense = DenseBone {
        density_hu: &vec![hu_of_density(0.1).round() as i16; grid.len()],
        solid_mm: &solid,
        class: &vec![Tissue::Cancellous as u8; grid.len()],
        label: &vec![1; grid.len()],
    };
    Arc::new(Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone"))
}

/// A servo of the standard tools.
pub(crate) fn setup_of(
    bone: &Arc<Bone>,
    [bone_from_base, bone_from_plan]: [Pose; 2],
) -> ServoSetup {
    ServoSetup {
        bone: Arc::clone(bone),
        tools: Tool::standard_set(),
        bone_from_base,
        bone_from_plan,
        device: DeviceInfo::omni(&HELLO).scale,
        force_limit_n: 3.3,
        feel: Feel::default(),
    }
}

/// Servo and publisher's mirror with a ring of `capacity` records between them.
pub(crate) struct Pair {
    pub(crate) thread: ServoThread,
    beat: Beat,
    records: Consumer<Record>,
    pub(crate) requests: Producer<Request>,
    pub(crate) mirror: Mirror,
}

impl Pair {
    pub(crate) fn new(capacity: usize) -> Self {
        Self::over_phantom(capacity, slowly)
    }

    pub(crate) fn over_phantom(capacity: usize, height: fn(u16) -> f64) -> Self {
        let args = SceneArgs {
            voxel_mm: Some(1.2),
            ..SceneArgs::default()
        };
        let scene: Scene = load(&args, &mut |_, _| {}).expect("the phantom");
        let bone_from_base = bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone());
        let poses = [bone_from_base, scene.bone_from_plan];
        Self::with(capacity, (scene.bone, poses), height)
    }

    /// A reamer in soft bone of fine voxels: more work than a tick's budget.
    fn over_budget(capacity: usize) -> Self {
        let place = Pose::new(DQuat::IDENTITY, DVec3::new(21.0, 21.0, 6.1));
        let mut pair = Self::with(capacity, (fine_slab(), [place, place]), in_a_hurry);
        pair.requests.push(Request::SelectTool(1)).expect("room");
        pair
    }

    fn with(
        capacity: usize,
        (bone, [bone_from_base, bone_from_plan]): (Arc<Bone>, [Pose; 2]),
        height: fn(u16) -> f64,
    ) -> Self {
        let tools = Tool::standard_set();
        let setup = setup_of(&bone, [bone_from_base, bone_from_plan]);
        let servo = Servo::new(setup).expect("tools");
        let (record_in, records) = RingBuffer::new(capacity);
        let (mut requests, request_out) = RingBuffer::new(64);
        requests.push(Request::Spindle(true)).expect("room");
        Self {
            thread: ServoThread {
                servo,
                link: Box::new(Scripted {
                    info: DeviceInfo::omni(&HELLO),
                    seq: 0,
                    height,
                }),
                records: record_in,
                requests: request_out,
                resync: Resync::new(&bone, tools.clone()),
                recording: None,
                panic_at_tick: None,
            },
            beat: Beat::new(now_ns()),
            records,
            requests,
            mirror: Mirror::new(bone, tools),
        }
    }

    /// One tick that begins at `now` ns.
    pub(crate) fn beat_at(&mut self, now: u64) {
        let timing = Timing {
            started: now,
            late_ns: 0,
            skipped: 0,
        };
        one_beat(&mut self.thread, &mut self.beat, &timing, &|| now).expect("a tick");
    }

    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            let timing = Timing {
                started: now_ns(),
                late_ns: 0,
                skipped: 0,
            };
            one_beat(&mut self.thread, &mut self.beat, &timing, &now_ns).expect("a tick");
        }
    }

    /// Takes at most `count` records out of the ring.
    pub(crate) fn drain(&mut self, count: usize) {
        for _ in 0..count {
            let Ok(record) = self.records.pop() else {
                return;
            };
            self.mirror.apply(&record, &mut |_, _| {});
        }
    }

    /// Runs, and gives the last tick's record.
    fn run_and_look(&mut self, ticks: u32) -> TickRecord {
        self.run(ticks);
        let mut last = None;
        while let Ok(record) = self.records.pop() {
            if let Record::Tick(tick) = record {
                last = Some(tick);
            }
        }
        last.expect("a tick")
    }

    /// As a viewer's wish comes.
    fn wish(&mut self, command: Command) {
        let mut dropped = 0;
        assert!(!forward(command, &mut self.requests, &mut dropped));
        assert_eq!(dropped, 0);
    }

    /// Runs until a step is pending at the end of a tick.
    fn run_until_carving(&mut self) {
        for _ in 0..2000 {
            if self.thread.servo.carving() {
                return;
            }
            self.run(1);
        }
        panic!("no step was carried over");
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

#[test]
fn a_servo_that_stops_with_a_pending_step_ends_with_the_same_bits() {
    let mut pair = Pair::over_budget(4096);
    pair.run_until_carving();
    // a reset drops the step: the mirror has seen it, and the reset after it
    pair.requests.push(Request::Reset).expect("room");
    pair.run(1);
    assert!(!pair.thread.servo.carving());
    pair.drain(usize::MAX);
    assert_eq!(pair.mirror.cut.epoch(), 1);
    assert_eq!(pair.mirror.cut.revision(), 0);
    pair.run_until_carving();
    pair.drain(usize::MAX);
    assert_eq!(pair.thread.resync.overflows(), 0);
    let begun = pair.thread.servo.cut().revision() + 1;
    assert_eq!(pair.mirror.cut.revision(), begun, "the mirror is ahead");
    pair.thread.servo.finish_carving();
    pair.assert_equal();
}

#[test]
fn a_lost_step_that_is_pending_is_copied_when_it_is_whole() {
    // the publisher sleeps through the first cut; the ring is full when the second begins
    let mut pair = Pair::over_budget(1100);
    pair.run(1500);
    pair.run_until_carving();
    assert!(pair.thread.resync.is_behind());
    pair.drain(usize::MAX);
    // no sample, so the lost step stays pending: there is room, and yet nothing is copied
    let ServoThread {
        servo,
        records,
        resync,
        ..
    } = &mut pair.thread;
    let output = servo.tick(None, &[]);
    assert!(servo.carving());
    resync.copy_some(servo, &output, records);
    assert!(pair.records.is_empty(), "half a step was copied");
    // copies and carving go on side by side, over several cuts
    let mut beside = 0;
    for _ in 0..12_000 {
        pair.run(1);
        beside += u32::from(pair.thread.servo.carving());
        pair.drain(usize::MAX);
        if !pair.thread.resync.is_behind() {
            break;
        }
    }
    assert!(beside > 5, "{beside}");
    assert!(!pair.thread.resync.is_behind(), "all was copied");
    pair.thread.servo.finish_carving();
    pair.assert_equal();
}

mod feel;
mod undo;
