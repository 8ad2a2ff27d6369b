//! What comes over the wires: cases 17, 18 and 39.

use super::super::bench::Bench;
use super::super::device::OMNI;
use super::super::hand::Hand;
use super::super::press;
use super::super::setup::{Scene, Slab, Spec, ball};
use super::Case;
use super::odd::{Random, bits, carved, oddities, sample, way};
use glam::{DQuat, DVec3};
use osteon_protocol::device::{DeviceMessage, DriveState, StateFrame};
use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};
use osteon_protocol::ipc::{PoseUpdate, ToViewer, WirePose};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into};
use osteon_sim_core::carve::CarveStep;
use osteon_sim_core::chain::Guard;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Request, Sample, Servo, TickOutput};

/// Frames of noise.
const NOISE: u32 = 1_000_000;
/// Frames whose CRC is right and whose numbers are anything.
const ANY: u32 = 20_000;

/// Bytes of noise, frame after frame: messages that came out of them.
fn noise(random: &mut Random) -> u32 {
    let mut reader = FrameReader::new();
    let mut taken = 0;
    for _ in 0..NOISE {
        let length = 1 + random.below(MAX_FRAME - 1);
        let mut word = 0;
        for n in 0..length {
            if n % 8 == 0 {
                word = random.next();
            }
            let byte = (word >> (8 * (n % 8)) & 0xff) as u8;
            // the delimiter ends a frame early: noise has it, too
            taken += u32::from(matches!(reader.push::<DeviceMessage>(byte), Some(Ok(_))));
        }
        taken += u32::from(matches!(reader.push::<DeviceMessage>(0), Some(Ok(_))));
    }
    taken
}

/// A state of any numbers, near a place or anywhere.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "any bits will do"
)]
fn any_state(random: &mut Random, near: &Sample) -> StateFrame {
    let close = random.below(3) > 0;
    let encoders = near.encoders.map(|n| {
        if close {
            n + random.below(7) as i32 - 3
        } else {
            random.next() as i32
        }
    });
    StateFrame {
        seq: random.next() as u16,
        time_micros: if close {
            near.time_micros
        } else {
            random.next() as u32
        },
        encoders,
        gimbal: [(); 3].map(|()| random.next() as i16),
        switches: random.next() as u8,
        drive: DriveState::Active,
        faults: random.next() as u16,
        applied: [(); 3].map(|()| random.next() as i16),
        temperature: [(); 3].map(|()| random.next() as i8),
        ack: random.next() as u16,
        crc_errors: random.next() as u8,
        refused: random.next() as u8,
        trips: random.next() as u8,
    }
}

fn sample_of(state: &StateFrame, ack_age: u8) -> Sample {
    Sample {
        time_micros: state.time_micros,
        encoders: state.encoders,
        gimbal: state.gimbal,
        buttons: state.switches & 3,
        drive_active: true,
        docked: state.switches & 4 != 0,
        applied: state.applied,
        ack_age,
    }
}

fn sound(output: &TickOutput) -> bool {
    output.force_n.is_finite()
        && output.bone_from_tool.is_valid()
        && output.bone_from_device.is_valid()
        && output.energy_mj.is_finite()
        && output.spindle_nmm.is_finite()
        && output.residual_n.is_finite()
        && output.force_n.length() <= 3.3 + 1e-9
        && output.torque.iter().all(|t| t.abs() <= OMNI.dac_max)
}

/// Any state through the decoder into a servo that presses: outputs that are not sound, values of its
/// state that are no numbers, samples that it refused.
fn any_states(random: &mut Random) -> (u32, usize, u64) {
    let slab = Slab {
        extent_mm: DVec3::splat(12.0),
        ..Slab::default()
    };
    let spec = Spec::at(slab.scene(vec![ball(3.0)]));
    let mut servo = spec.servo();
    let mut reader = FrameReader::new();
    let (mut unsound, mut odd) = (0, 0);
    for n in 0..ANY {
        let near = sample(way(0.5, n % 3000), DQuat::IDENTITY, n.wrapping_mul(1000));
        let state = any_state(random, &near);
        let mut out = [0; MAX_FRAME];
        let bytes = encode(&DeviceMessage::State(state), &mut out).expect("a frame");
        for &byte in bytes {
            if let Some(Ok(DeviceMessage::State(state))) = reader.push(byte) {
                let age = (random.next() & 0xff) as u8;
                let output = servo.tick(Some(&sample_of(&state, age)), &[]);
                unsound += u32::from(!sound(&output));
            }
        }
        if n % (ANY / 10) == 0 {
            odd += oddities(&servo).not_finite;
        }
    }
    (unsound, odd, servo.guards().of(Guard::Implausible))
}

/// Poses that are none.
fn no_poses() -> [Pose; 6] {
    let good = Pose::IDENTITY;
    [
        Pose::new(DQuat::IDENTITY, DVec3::NAN),
        Pose::new(DQuat::IDENTITY, DVec3::splat(f64::INFINITY)),
        Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO),
        Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.1, 1.0), DVec3::ZERO),
        Pose::new(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), DVec3::ZERO),
        Pose::new(
            DQuat::from_xyzw(0.0, f64::INFINITY, 0.0, 0.0),
            good.translation,
        ),
    ]
}

/// Poses that are none and were taken: by the viewers' wire, by carving.
fn taken_poses() -> [usize; 2] {
    let scene = Slab::default().scene(vec![ball(3.0)]);
    let wire = |p: &Pose| WirePose {
        rotation: p.rotation.to_array(),
        translation_mm: p.translation.to_array(),
    };
    let over_the_wire = |p: &Pose| {
        let update = PoseUpdate {
            tick: 1,
            tool: 0,
            spindle_on: false,
            paused: false,
            clutched: false,
            saturated: false,
            bone_from_tool: wire(p),
            bone_from_device: wire(&Pose::IDENTITY),
            force_n: [0.0; 3],
            physical_force_n: 0.0,
            vibration_n: 0.0,
            spindle_rpm: 0.0,
            spindle_nmm: 0.0,
            spindle_load: 0.0,
            motion_scale: 1.0,
            depth_mm: 0.0,
            removed_mm3: 0.0,
            checkpoints: 0,
        };
        let mut bytes = Vec::new();
        if encode_into(&ToViewer::Pose(update), &mut bytes).is_err() {
            return false;
        }
        let mut decoder = StreamDecoder::new();
        decoder.push(&bytes);
        matches!(decoder.next::<ToViewer>(), Ok(Some(_)))
    };
    let carves = |p: &Pose| {
        let step = CarveStep {
            tool: 0,
            before: scene.bone_from_base,
            after: *p,
        };
        carved(&scene.bone, &scene.tools[0], &[step])
            .totals()
            .units()
            != 0
    };
    // control: the same path takes a pose
    let control = over_the_wire(&Pose::IDENTITY) && carves(&scene.bone_from_base);
    let count = |f: &dyn Fn(&Pose) -> bool| no_poses().iter().filter(|p| f(p)).count();
    if control {
        [count(&over_the_wire), count(&carves)]
    } else {
        [usize::MAX; 2]
    }
}

/// A press into which wild samples come: ticks until the force is zero.
fn ticks_to_zero(random: &mut Random) -> usize {
    let bench = press::pressed(&Spec::flat().with(Hand::GRIP, 1), 1.0);
    let Some(servo) = bench.servo() else {
        return usize::MAX;
    };
    let mut servo: Servo = servo.clone();
    let last = bench.device.time_s() * 1e6;
    let forces: Vec<f64> = (1..=60u32)
        .map(|n| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "seconds as µs, and any bits"
            )]
            let (time_micros, encoders) = (
                last as u32 + n * 1000,
                [(); 3].map(|()| random.next() as i32),
            );
            let wild = Sample {
                encoders,
                ..sample(DVec3::ZERO, DQuat::IDENTITY, time_micros)
            };
            servo.tick(Some(&wild), &[]).force_n.length()
        })
        .collect();
    forces.iter().rposition(|f| *f > 0.0).map_or(0, |at| at + 1)
}

/// Case 17.
pub(super) fn no_numbers() -> Case {
    let mut random = Random(17);
    let taken = noise(&mut random);
    let (unsound, odd, refused) = any_states(&mut random);
    let [wire, carve] = taken_poses();
    let ticks = ticks_to_zero(&mut random);
    Case {
        id: 17,
        name: "No numbers",
        criterion: "1,000,000 frames of random bytes: no message. The device's wire has integers alone, so 20,000 frames with a right \
                    CRC and any numbers: force and poses stay finite and within their limits, refusals are counted, no value of the servo's \
                    state is ever NaN or infinite. Poses with NaN, inf, a zero or a stretched quaternion: refused by the viewers' wire and \
                    by carving. Wild samples in a press: the force is gone within 20 ticks"
            .to_owned(),
        measured: format!(
            "{taken} messages from noise; {unsound} ticks unsound, {odd} values no number, {refused} refused; poses taken: {wire} by the \
             wire, {carve} by carving; force gone after {ticks} ticks"
        ),
        // a 32-bit CRC lets one in four thousand million through
        pass: taken == 0 && unsound == 0 && odd == 0 && refused > 1000 && wire == 0 && carve == 0 && ticks <= 20,
    }
}

/// Torque and force of every tick, and the cut's bits.
type Felt = (Vec<([i16; 3], DVec3)>, Vec<Option<u64>>);

/// A cut 0.8 mm deep along the face.
fn cut_with(scene: Scene, shift: impl Fn(&mut Sample)) -> Felt {
    let spec = Spec::at(scene);
    let mut servo = spec.servo();
    let felt = (0..2600u32)
        .map(|tick| {
            let requests = [Request::Spindle(tick >= 1800)];
            let lean = DQuat::from_rotation_x(0.2);
            let mut sample = sample(way(0.8, tick), lean, tick * 1000);
            shift(&mut sample);
            let output = servo.tick(Some(&sample), &requests);
            (output.torque, output.force_n)
        })
        .collect();
    servo.finish_carving();
    (felt, bits(servo.bone(), servo.cut()))
}

/// Case 18.
pub(super) fn same_pose() -> Case {
    let scene = || Slab::default().scene(vec![ball(3.0)]);
    let reference = cut_with(scene(), |_| {});
    let peak = reference
        .0
        .iter()
        .map(|(_, f)| f.length())
        .fold(0.0, f64::max);
    let mut turned = scene();
    turned.bone_from_base.rotation = -turned.bone_from_base.rotation;
    let sign = cut_with(turned, |_| {}) == reference;
    let revolution = i16::try_from(OMNI.gimbal_counts_per_rev).unwrap_or(0);
    let round = |by: [i16; 3]| {
        cut_with(scene(), |s| {
            for (count, n) in s.gimbal.iter_mut().zip(by) {
                *count += n * revolution;
            }
        }) == reference
    };
    let wraps = [[1, 0, 0], [0, 1, -1], [-1, -1, 1]].into_iter().all(round);
    // a step between two poses whose quaternions differ in sign is no turn
    let middle = scene().bone_from_base;
    let still = CarveStep {
        tool: 0,
        before: middle,
        after: middle,
    };
    let flipped = CarveStep {
        before: Pose::new(-middle.rotation, middle.translation),
        ..still
    };
    let carve = |step| bits(&scene().bone, &carved(&scene().bone, &ball(3.0), &[step]));
    let steps = carve(still) == carve(flipped);
    Case {
        id: 18,
        name: "The same pose in other numbers",
        criterion: "a press and a cut along the face with the registration as q and as −q, with each gimbal count a turn up or down, and a \
                    step from −q to q: the same torques, forces and cut bit for bit. (The joints' encoders count from the dock and have no \
                    wrap within 2³¹; the device clock's is in case 34.)"
            .to_owned(),
        measured: format!(
            "peak force {peak:.2} N; equal: −q {sign}, turns {wraps}, step {steps}"
        ),
        pass: sign && wraps && steps && peak > 0.3,
    }
}

/// Case 39.
pub(super) fn time_back() -> Case {
    let spec = Spec::flat();
    let (mut told, mut silent) = (spec.servo(), spec.servo());
    let (mut fresh, mut differ, mut extra, mut carved) = (0u32, 0u32, 0u64, 0);
    for tick in 0..3000u32 {
        let start = [Request::Spindle(true)];
        let requests = if tick == 0 { &start[..] } else { &[] };
        let now = sample(way(0.8, tick), DQuat::IDENTITY, 10_000 + tick * 1000);
        let mut both = |sample: Option<&Sample>, requests: &[Request], bad: bool| {
            let a = told.tick(sample, requests);
            let b = silent.tick(sample.filter(|_| !bad), requests);
            fresh += u32::from(bad && a.fresh);
            carved += if bad { a.carved_len } else { 0 };
            differ += u32::from(
                a.torque != b.torque
                    || a.force_n != b.force_n
                    || a.removed_by_class != b.removed_by_class,
            );
        };
        both(Some(&now), requests, false);
        if tick % 50 == 49 {
            // the same time again, elsewhere; and times that lie in the past
            let mut back = sample(
                way(0.8, tick) + DVec3::X * 0.05,
                DQuat::IDENTITY,
                now.time_micros,
            );
            both(Some(&back), &[], true);
            for micros in [1, 1000, 9000] {
                back.time_micros = now.time_micros - micros;
                both(Some(&back), &[], true);
            }
            extra += 4;
        }
    }
    let counted = told.guards().of(Guard::Implausible);
    let equal = bits(told.bone(), told.cut()) == bits(silent.bone(), silent.cut());
    Case {
        id: 39,
        name: "Time that stands or runs back",
        criterion: "in a cut, samples with the time of the one before, and with earlier ones: all refused and counted, nothing carved, and \
                    every torque, force and volume as though no sample had come, bit for bit"
            .to_owned(),
        measured: format!(
            "{counted} of {extra} counted, {fresh} believed, {carved} steps carved in them, {differ} ticks differ"
        ),
        pass: counted == extra && fresh == 0 && carved == 0 && differ == 0 && equal,
    }
}

/// A bench's inputs and outputs with the device clock shifted; see case 34.
pub(super) fn kept_cut() -> (Spec, Bench) {
    let spec = Spec::flat().with(Hand::GRIP, 1);
    let mut bench = Bench::new(&spec);
    bench.kept = Some(Vec::new());
    bench.run_in();
    press::meet(&mut bench, 100.0);
    press::push(&mut bench, 0.9, 0.5, 100.0);
    bench.run(1.0);
    bench.requests.push(Request::Spindle(true));
    bench.run(2.0);
    (spec, bench)
}
