//! The bytes of a session file's messages, written down by hand from `WIRE.md`, part 3.
#![expect(
    clippy::unwrap_used,
    reason = "a helper that fails is a test that fails"
)]

use osteon_protocol::ipc::{Digest, WirePose};
use osteon_protocol::session::{
    Device, InputFile, Link, Mark, Outcome, Request, Sample, SceneSource, Setup, Tick, decode,
    encode,
};
use proptest::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fmt::Debug;

const F64_1: [u8; 8] = [0, 0, 0, 0, 0, 0, 0xF0, 0x3F];
const F64_2: [u8; 8] = [0, 0, 0, 0, 0, 0, 0x00, 0x40];
const F64_3: [u8; 8] = [0, 0, 0, 0, 0, 0, 0x08, 0x40];
const POSE: WirePose = WirePose {
    rotation: [0.0, 0.0, 0.0, 1.0],
    translation_mm: [1.0, 2.0, 3.0],
};

fn pose_bytes() -> Vec<u8> {
    [[0; 8], [0; 8], [0; 8], F64_1, F64_1, F64_2, F64_3].concat()
}

/// Both ways.
fn holds<T: Serialize + DeserializeOwned + PartialEq + Debug>(message: &T, bytes: &[&[u8]]) {
    let bytes = bytes.concat();
    let mut made = vec![1, 2, 3];
    encode(message, &mut made).unwrap();
    assert_eq!(made, bytes, "{message:?}");
    assert_eq!(decode::<T>(&bytes).as_ref(), Ok(message));
    assert!(
        decode::<T>(&[&bytes[..], &[0]].concat()).is_err(),
        "a byte is left over"
    );
    assert!(
        decode::<T>(&bytes[..bytes.len() - 1]).is_err(),
        "a byte is missing"
    );
}

#[test]
fn setup() {
    let setup = Setup {
        version: 1,
        software: "o".into(),
        began_unix_ns: 300,
        scene: SceneSource {
            bone: Some("b".into()),
            labels: None,
            keep: vec![1, 2],
            pose: None,
            threshold_hu: 1.0,
            voxel_mm: Some(1.0),
            seed: 5,
            scene: None,
        },
        tools: None,
        files: vec![InputFile {
            role: "bone".into(),
            path: "b".into(),
            bytes: 128,
            xxh3: "0f".into(),
        }],
        bone_hash: u64::MAX,
        tool_hashes: vec![("d".into(), 1)],
        feel: vec![("k".into(), 2.0)],
        tick_s: 1.0,
        force_limit_n: 3.0,
        bone_from_base: POSE,
        bone_from_plan: POSE,
        device: Device {
            link: "l".into(),
            arm: "a".into(),
            counts_per_rev: 300,
            gimbal_counts_per_rev: 2,
            dac_max: -1,
            nmm_per_count: 2.0,
        },
    };
    holds(
        &setup,
        &[
            &[1, 1, b'o', 0xAC, 0x02],
            &[1, 1, b'b', 0, 2, 1, 2, 0],
            &[0, 0, 0x80, 0x3F, 1],
            &F64_1,
            &[5, 0, 0, 1, 4],
            b"bone",
            &[1, b'b', 0x80, 0x01, 2, b'0', b'f'],
            &[0xFF; 9],
            &[0x01, 1, 1, b'd', 1, 1, 1, b'k'],
            &[F64_2, F64_1, F64_3].concat(),
            &pose_bytes(),
            &pose_bytes(),
            &[1, b'l', 1, b'a', 0xAC, 0x02, 2, 1],
            &F64_2,
        ],
    );
}

const SAMPLE: Sample = Sample {
    seq: 300,
    time_micros: 1,
    encoders: [1, -1, 64],
    gimbal: [0, -2, 2],
    buttons: 3,
    drive_active: true,
    docked: false,
    applied: [-1, 0, 1],
    ack_age: 2,
};

const OUTCOME: Outcome = Outcome {
    torque: [1, -1, 0],
    bone_from_tool: POSE,
    bone_from_device: POSE,
    force_n: [1.0, 2.0, 3.0],
    physical_force_n: [3.0, 2.0, 1.0],
    spindle_rad_s: 1.0,
    spindle_nmm: 2.0,
    energy_mj: 3.0,
    removed_by_class: [0, 1, -1, 64, 0, 0, 0, 0],
    epoch: 128,
    revision: 129,
    work: 5,
    tool: 1,
    checkpoints: 2,
    flags: 64,
};

#[test]
fn tick() {
    let tick = Tick {
        tick: 7,
        started_ns: 300,
        late_ns: 2,
        skipped: 1,
        sample: Some(SAMPLE),
        requests: vec![
            Request::SelectTool(3),
            Request::MotionScale(2.0),
            Request::Undo,
        ],
        outcome: OUTCOME,
        link: Link {
            drive: 4,
            faults: 300,
            trips: 9,
            frames: 1,
            crc_errors: 2,
            gaps: 3,
            stale: 4,
            dropped_commands: 5,
        },
    };
    holds(
        &tick,
        &[
            &[7, 0xAC, 0x02, 2, 1],
            &[
                1, 0xAC, 0x02, 1, 2, 1, 0x80, 0x01, 0, 3, 4, 3, 1, 0, 1, 0, 2, 2,
            ],
            &[3, 0, 3, 5],
            &F64_2,
            &[8],
            &[2, 1, 0],
            &pose_bytes(),
            &pose_bytes(),
            &[F64_1, F64_2, F64_3, F64_3, F64_2, F64_1].concat(),
            &[F64_1, F64_2, F64_3].concat(),
            &[0, 2, 1, 0x80, 0x01, 0, 0, 0, 0],
            &[0x80, 0x01, 0x81, 0x01, 5, 1, 2, 64],
            &[4, 0xAC, 0x02, 9, 1, 2, 3, 4, 5],
        ],
    );
}

#[test]
fn marks() {
    let digest = Digest {
        epoch: 1,
        revision: 2,
        hash: 300,
        changed_chunks: 3,
    };
    let bytes = [1, 2, 0xAC, 0x02, 3];
    holds(&Mark::Digest { ticks: 5, digest }, &[&[0, 5], &bytes]);
    holds(
        &Mark::Lost {
            first: 300,
            count: 1,
        },
        &[&[1, 0xAC, 0x02, 1]],
    );
    let end = |digest| Mark::End {
        ticks: 5,
        digest,
        reason: "e".into(),
    };
    holds(&end(Some(digest)), &[&[2, 5, 1], &bytes, &[1, b'e']]);
    holds(&end(None), &[&[2, 5, 0, 1, b'e']]);
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let sizes = (
            decode::<Setup>(&bytes).map_or(0, |s| s.feel.len() + s.files.len()),
            decode::<Tick>(&bytes).map_or(0, |t| t.requests.len()),
        );
        // a list is never longer than the bytes that it came from
        prop_assert!(sizes.0 <= bytes.len() && sizes.1 <= bytes.len());
        drop(decode::<Mark>(&bytes));
    }
}
