//! Servo tick and device link allocate nothing, once they run.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]
#![expect(
    unsafe_code,
    reason = "an allocator that counts can only be written so"
)]

use glam::{DQuat, DVec3};
use osteon_firmware_bridge::link::{DeviceLink as _, OpenLink};
use osteon_firmware_bridge::scene::{SceneArgs, load};
use osteon_protocol::device::{CommandFrame, DriveState};
use osteon_sim_core::arm::Arm;
use osteon_sim_core::chain::Guard;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::omni;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{CutEvent, DeviceScale, Request, Sample, Servo, ServoSetup};
use osteon_sim_core::tool::Tool;
use osteon_tests::{fake, one_at_a_time};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

fn count() {
    // no destructor and no lazy start: safe inside an allocator
    COUNT.with(|c| c.set(c.get() + 1));
}

// SAFETY: every call goes to the system's allocator unchanged; counting touches one plain cell.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const DEVICE: DeviceScale = DeviceScale {
    arm: Arm::Omni,
    counts_per_rev: 15_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    nmm_per_count: 0.215,
};

#[expect(clippy::cast_possible_truncation, reason = "counts of a small angle")]
fn sample(tick: u32, z: f64) -> Sample {
    let t = omni::inverse(DVec3::new(0.0, 0.0, z)).expect("in reach");
    let gimbal = omni::gimbal_for(t, DQuat::IDENTITY).expect("a pose");
    let turn = std::f64::consts::TAU;
    Sample {
        time_micros: tick * 1000,
        encoders: ((t - omni::DOCK) * (15_000.0 / turn))
            .to_array()
            .map(|v| v.floor() as i32),
        gimbal: (gimbal * (16_384.0 / turn))
            .to_array()
            .map(|v| v.round() as i16),
        buttons: 0,
        drive_active: true,
        docked: false,
        applied: [0; 3],
        ack_age: 0,
    }
}

#[test]
fn the_counter_counts() {
    let before = COUNT.with(Cell::get);
    drop(std::hint::black_box(Box::new(5)));
    assert_eq!(COUNT.with(Cell::get) - before, 2);
    let mut grows = std::hint::black_box(vec![0u8]);
    let before = COUNT.with(Cell::get);
    grows.reserve_exact(1_000_000);
    assert!(COUNT.with(Cell::get) > before, "a growing vector is seen");
    let before = COUNT.with(Cell::get);
    drop(std::hint::black_box(vec![0u8; 1_000_000]));
    assert_eq!(COUNT.with(Cell::get) - before, 2, "zeroed memory is seen");
}

#[test]
fn a_tick_allocates_nothing_whatever_it_does() {
    let args = SceneArgs {
        voxel_mm: Some(1.0),
        ..SceneArgs::default()
    };
    let scene = load(&args, &mut |_, _| {}).expect("the phantom");
    let setup = ServoSetup {
        bone_from_base: bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()),
        bone: scene.bone,
        tools: Tool::standard_set(),
        bone_from_plan: scene.bone_from_plan,
        device: DEVICE,
        force_limit_n: 3.3,
        feel: Feel::default(),
    };
    let mut servo = Servo::new(setup).expect("tools");
    let before = COUNT.with(Cell::get);
    let (mut carved, mut undone) = ([0usize; 2], 0);
    for tick in 1..9000u32 {
        // down and up again, a new tool, checkpoints, undos, a reset, missing samples, a broken encoder
        let phase = f64::from(tick % 4000) / 1000.0;
        let z = 15.0 - 12.0 * phase.min(4.0 - phase);
        let requests: &[Request] = match tick {
            1100 => &[Request::Spindle(true)],
            4000 => &[Request::SelectTool(1)],
            2500 | 3000 | 5000 | 5500 => &[Request::Checkpoint],
            3500 | 6000 | 6001 => &[Request::Undo],
            7500 => &[Request::Reset, Request::Pause(true), Request::Pause(false)],
            _ => &[],
        };
        let z = if tick % 977 == 0 { z + 40.0 } else { z };
        let input = sample(tick, z);
        let output = servo.tick((tick % 50 != 0).then_some(&input), requests);
        carved[usize::from(output.tool)] += output.carved_len;
        let undo = |e| matches!(e, CutEvent::Undone { .. });
        undone += output.events.iter().filter(|e| undo(*e)).count();
    }
    let allocations = COUNT.with(Cell::get) - before;
    assert!(
        carved[0] > 100 && carved[1] > 100,
        "both tools cut: {carved:?}"
    );
    assert!(servo.guards().of(Guard::Implausible) > 0);
    assert_eq!(undone, 3);
    assert_eq!(allocations, 0);
}

/// What a servo thread does with its cable, 1500 times; states heard, whether the drive was active.
fn talk(link: &mut OpenLink, seq: &mut u16) -> (u32, bool) {
    let (mut heard, mut active) = (0, false);
    for _ in 0..1500 {
        std::thread::sleep(Duration::from_millis(1));
        let state = link.poll().expect("a device");
        if let Some(state) = state {
            heard += 1;
            active |= state.drive == DriveState::Active;
        }
        *seq += 1;
        let command = CommandFrame {
            seq: *seq,
            state_seq: state.map_or(0, |s| s.seq),
            torque: [1, -1, 0],
            enable: true,
        };
        link.send(&command).expect("a device");
    }
    (heard, active)
}

#[test]
fn the_link_allocates_nothing_whoever_reads_the_cable() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let _device = fake(env!("CARGO_BIN_EXE_osteon"), dir.path(), None);
    let path = dir.path().join("omni");
    let mut link = OpenLink::open(path.to_str().expect("text")).expect("a device");
    link.prepare().expect("armed");
    let mut seq = 0;
    // this thread reads and checks every byte itself
    let before = COUNT.with(Cell::get);
    let (heard, active) = talk(&mut link, &mut seq);
    assert_eq!(COUNT.with(Cell::get), before);
    assert!(active && heard > 300, "{heard} states");
    // and with the relay, as in a session
    link.start().expect("a thread");
    let before = COUNT.with(Cell::get);
    let (heard, _) = talk(&mut link, &mut seq);
    assert_eq!(COUNT.with(Cell::get), before);
    assert!(heard > 300, "{heard} states");
    assert_eq!(link.stats().crc_errors, 0);
}
