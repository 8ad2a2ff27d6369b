//! The servo thread's beat without a clock: a scripted cable, and a publisher that keeps up or does not.
//!
//! For measuring what a viewer that hangs does to the loop; the product never runs it.

use super::mirror::Mirror;
use super::record::Record;
use super::resync::Resync;
use super::servo_loop::{Beat, ServoThread, Timing, one_beat};
use crate::link::{DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use crate::scene::{Scene, SceneArgs, load};
use glam::{DQuat, DVec3};
use osteon_protocol::device::{CommandFrame, DeviceHello, DriveState, StateFrame};
use osteon_sim_core::arm::Arm;
use osteon_sim_core::cut::CutDigest;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::omni;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{DeviceScale, Request, Servo, ServoSetup};
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, RingBuffer};
use std::sync::{Arc, Mutex, PoisonError};

pub(super) const HELLO: DeviceHello = DeviceHello {
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

/// Records of the ring: few, so that a stalled publisher is felt soon.
const RING: usize = 1500;

/// How the publisher takes records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Viewer {
    /// At once.
    Prompt,
    /// Not at all for so many ticks from tick 2000 on, then at once.
    Stalled {
        /// Ticks.
        ticks: u32,
    },
    /// Never again from a tick on.
    Killed {
        /// From which.
        at_tick: u32,
    },
    /// The ring is never drained to more than half.
    Slow,
}

/// What a rehearsal made.
#[derive(Debug, Clone, PartialEq)]
pub struct Rehearsal {
    /// Torques of every command sent.
    pub torques: Vec<[i16; 3]>,
    /// The servo's cut.
    pub digest: CutDigest,
    /// Whether the publisher's mirror has the same bits and account in the end.
    pub mirror_equal: bool,
    /// Records that found the ring full.
    pub lost: u64,
    /// Occupancy units removed.
    pub removed: i64,
}

pub(super) type Sent = Arc<Mutex<Vec<[i16; 3]>>>;

/// A device that goes up and down the planned axis, 15 to −5 mm, every 8 s.
pub(super) struct Scripted {
    pub(super) info: DeviceInfo,
    pub(super) seq: u16,
    pub(super) sent: Sent,
}

#[expect(clippy::cast_possible_truncation, reason = "counts of small angles")]
fn state(seq: u16) -> Option<StateFrame> {
    let phase = f64::from(seq % 8000) / 1000.0;
    let t = omni::inverse(DVec3::Z * (15.0 - 5.0 * phase.min(8.0 - phase)))?;
    let gimbal = omni::gimbal_for(t, DQuat::IDENTITY)?;
    let per_rad = |counts: f64| counts / core::f64::consts::TAU;
    Some(StateFrame {
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
    })
}

impl DeviceLink for Scripted {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }
    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        self.seq += 1;
        Ok(state(self.seq))
    }
    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        let mut sent = self.sent.lock().unwrap_or_else(PoisonError::into_inner);
        sent.push(command.torque);
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

fn drain(records: &mut Consumer<Record>, mirror: &mut Mirror, keep: usize) {
    while records.slots() > keep {
        let Ok(record) = records.pop() else {
            return;
        };
        mirror.apply(&record, &mut |_, _| {});
    }
}

/// Records that the publisher leaves in the ring at a tick.
fn left(viewer: Viewer, tick: u32) -> usize {
    match viewer {
        Viewer::Stalled { ticks } if (2000..2000 + ticks).contains(&tick) => RING,
        Viewer::Killed { at_tick } if tick >= at_tick => RING,
        Viewer::Slow => RING - 1,
        _ => 0,
    }
}

#[expect(clippy::expect_used, reason = "no input can make it fail")]
pub(super) fn scene_and_servo() -> (Scene, Servo) {
    let args = SceneArgs {
        voxel_mm: Some(1.2),
        ..SceneArgs::default()
    };
    let scene = load(&args, &mut |_, _| {}).expect("the phantom");
    let setup = ServoSetup {
        bone: Arc::clone(&scene.bone),
        tools: Tool::standard_set(),
        bone_from_base: bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()),
        bone_from_plan: scene.bone_from_plan,
        device: DeviceScale {
            arm: Arm::Omni,
            counts_per_rev: HELLO.counts_per_rev,
            gimbal_counts_per_rev: HELLO.gimbal_counts_per_rev,
            dac_max: 2047,
            nmm_per_count: 0.215,
        },
        force_limit_n: 3.3,
        feel: Feel::default(),
    };
    let servo = Servo::new(setup).expect("tools");
    (scene, servo)
}

/// Runs the servo thread's beats in the built-in phantom, at most 60,000 of them, as fast as they go.
///
/// # Panics
///
/// Where the phantom cannot be made, or a beat fails: neither needs anything from outside.
#[expect(clippy::expect_used, reason = "no input can make it fail")]
pub fn rehearse(ticks: u32, viewer: Viewer) -> Rehearsal {
    let (scene, servo) = scene_and_servo();
    let tools = Tool::standard_set();
    let (record_in, mut records) = RingBuffer::new(RING);
    let (mut requests, request_out) = RingBuffer::new(8);
    requests.push(Request::Spindle(true)).expect("room");
    let sent = Sent::default();
    let link = Scripted {
        info: DeviceInfo::omni(&HELLO),
        seq: 0,
        sent: Arc::clone(&sent),
    };
    let mut thread = ServoThread {
        servo,
        link: Box::new(link),
        records: record_in,
        requests: request_out,
        resync: Resync::new(&scene.bone, tools.clone()),
        recording: None,
        panic_at_tick: None,
    };
    let (mut beat, mut mirror) = (
        Beat::new(now_ns()),
        Mirror::new(Arc::clone(&scene.bone), tools),
    );
    for tick in 0..ticks.min(60_000) {
        let timing = Timing {
            started: now_ns(),
            late_ns: 0,
            skipped: 0,
        };
        assert!(
            one_beat(&mut thread, &mut beat, &timing, &now_ns).is_ok(),
            "a beat"
        );
        drain(&mut records, &mut mirror, left(viewer, tick));
    }
    thread.servo.finish_carving();
    drain(&mut records, &mut mirror, 0);
    let servo = &thread.servo;
    if thread.resync.is_behind() {
        mirror.catch_up(servo.cut(), 0, &mut |_, _| {});
    }
    let (cut, bone) = (servo.cut(), servo.bone());
    let torques = sent.lock().unwrap_or_else(PoisonError::into_inner).clone();
    Rehearsal {
        torques,
        digest: cut.digest(bone),
        mirror_equal: cut.digest(bone).hash == mirror.cut.digest(bone).hash
            && cut.totals().by_class == mirror.cut.totals().by_class,
        lost: thread.resync.overflows(),
        removed: cut.totals().units(),
    }
}
