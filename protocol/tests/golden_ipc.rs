//! The bytes of every viewer message, written down by hand from `WIRE.md`. A change that moves a
//! byte fails here: then the version goes up, and `WIRE.md` changes in the same commit.
#![expect(
    clippy::unwrap_used,
    reason = "a helper that fails is a test that fails"
)]

use osteon_protocol::ipc::{
    BonePiece, Bricks, Command, ControlState, Digest, FromViewer, GuardCount, Health, IPC_VERSION,
    Join, PoseUpdate, RemovalEvent, Resume, Role, Scene, ToViewer, ToolInfo, ViewerInfo, Welcome,
    WirePose, capability,
};
use osteon_protocol::ipc_frame::{HEADER_BYTES, Message, StreamDecoder, encode_into};
use std::fmt::Debug;

// IEEE 754, little endian: sign, 11 (8) bits of exponent, 52 (23) bits of fraction.
const F64_0: [u8; 8] = [0; 8];
const F64_1: [u8; 8] = [0, 0, 0, 0, 0, 0, 0xF0, 0x3F];
const F64_2: [u8; 8] = [0, 0, 0, 0, 0, 0, 0x00, 0x40];
const F64_3: [u8; 8] = [0, 0, 0, 0, 0, 0, 0x08, 0x40];
const F64_HALF: [u8; 8] = [0, 0, 0, 0, 0, 0, 0xE0, 0x3F];
const F32_0: [u8; 4] = [0; 4];
const F32_1: [u8; 4] = [0, 0, 0x80, 0x3F];
const F32_2: [u8; 4] = [0, 0, 0x00, 0x40];
const F32_MINUS_2: [u8; 4] = [0, 0, 0x00, 0xC0];

/// No rotation, moved by (1, 2, 3) mm.
const POSE: WirePose = WirePose {
    rotation: [0.0, 0.0, 0.0, 1.0],
    translation_mm: [1.0, 2.0, 3.0],
};

fn pose_bytes() -> Vec<u8> {
    [F64_0, F64_0, F64_0, F64_1, F64_1, F64_2, F64_3].concat()
}

/// Both ways: the message makes these bytes, and these bytes make the message.
fn holds<T: Message + PartialEq + Debug>(message: &T, payload: &[&[u8]]) {
    let payload = payload.concat();
    let mut framed = Vec::new();
    encode_into(message, &mut framed).unwrap();
    assert_eq!(&framed[HEADER_BYTES..], payload, "{message:?}");
    let length = u32::try_from(payload.len()).unwrap();
    assert_eq!(framed[..4], length.to_le_bytes());
    let mut decoder = StreamDecoder::new();
    decoder.push(&framed);
    assert_eq!(decoder.next::<T>().unwrap().as_ref(), Some(message));
    assert_eq!(decoder.next::<T>(), Ok(None));
}

#[test]
fn whole_frames_are_the_written_ones() {
    // Length, CRC-32C and payload; the CRCs were computed by a separate program.
    let mut framed = Vec::new();
    let name = "test".to_owned();
    encode_into(&FromViewer::Hello { version: 4, name }, &mut framed).unwrap();
    let hello = [
        7, 0, 0, 0, 0xAD, 0xDA, 0x49, 0x27, 0, 4, 4, b't', b'e', b's', b't',
    ];
    assert_eq!(framed, hello);
    framed.clear();
    encode_into(&FromViewer::Command(Command::SelectTool(1)), &mut framed).unwrap();
    assert_eq!(framed, [3, 0, 0, 0, 0x07, 0xB2, 0x4E, 0x37, 1, 0, 1]);
    framed.clear();
    encode_into(
        &FromViewer::Command(Command::MotionScale(1500)),
        &mut framed,
    )
    .unwrap();
    assert_eq!(
        framed,
        [4, 0, 0, 0, 0x4B, 0xD3, 0x95, 0x35, 1, 6, 0xDC, 0x0B]
    );
    framed.clear();
    encode_into(&ToViewer::Hello { version: 4 }, &mut framed).unwrap();
    assert_eq!(framed, [2, 0, 0, 0, 0xCD, 0xE0, 0xFB, 0x36, 0, 4]);
    framed.clear();
    let join = Join {
        role: Role::Trainer,
        capabilities: capability::ALL,
        pose_hz: 60,
        resume: None,
    };
    encode_into(&FromViewer::Join(join), &mut framed).unwrap();
    assert_eq!(
        framed,
        [
            0x05, 0x00, 0x00, 0x00, 0xB8, 0xFB, 0xD7, 0x7F, 0x03, 0x01, 0x1F, 0x3C, 0x00
        ]
    );
    framed.clear();
    encode_into(&FromViewer::Command(Command::AskControl), &mut framed).unwrap();
    assert_eq!(
        framed,
        [0x02, 0x00, 0x00, 0x00, 0x9D, 0xC7, 0x21, 0x89, 0x01, 0x0A]
    );
    let document = include_str!("../../WIRE.md");
    for shown in [
        "`07 00 00 00 ad da 49 27 00 04 04 74 65 73 74`",
        "`02 00 00 00 cd e0 fb 36 00 04`",
        "`03 00 00 00 07 b2 4e 37 01 00 01`",
        "`04 00 00 00 4b d3 95 35 01 06 dc 0b`",
        "`05 00 00 00 b8 fb d7 7f 03 01 1f 3c 00`",
        "`02 00 00 00 9d c7 21 89 01 0a`",
    ] {
        assert!(document.contains(shown), "not in WIRE.md: {shown}");
    }
}

#[test]
fn beginning_and_end() {
    assert_eq!(IPC_VERSION, 4);
    holds(&ToViewer::Hello { version: 300 }, &[&[0], &[0xAC, 0x02]]);
    let reason = "no".to_owned();
    holds(&ToViewer::Refused { reason }, &[&[1], &[2], b"no"]);
    holds(&ToViewer::Reset { epoch: 128 }, &[&[9], &[0x80, 0x01]]);
    let reason = "end".to_owned();
    holds(&ToViewer::Bye { reason }, &[&[10], &[3], b"end"]);
    let volumes = [F64_0, F64_HALF, F64_1, F64_2, F64_3, F64_0, F64_0, F64_0];
    let undone = ToViewer::Undone {
        epoch: 300,
        removed_mm3_by_class: [0.0, 0.5, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0],
    };
    holds(&undone, &[&[11], &[0xAC, 0x02], &volumes.concat()]);
}

#[test]
fn scene() {
    let tool = ToolInfo {
        name: "Drill".into(),
        id: "d".into(),
        outline_mm: vec![[0.0, 1.0], [2.0, -2.0]],
        rpm: 2.0,
    };
    let scene = Scene {
        source: "CT".into(),
        dims: [200, 32, 1],
        spacing_mm: [0.5, 1.0, 2.0],
        lps_from_bone: POSE,
        bone_from_plan: POSE,
        chunks: 7,
        solid_mm3: 3.0,
        tools: vec![tool],
        force_limit_n: 2.0,
        force_scale: 0.5,
    };
    holds(
        &ToViewer::Scene(Box::new(scene)),
        &[
            &[2],
            &[2],
            b"CT",
            &[0xC8, 0x01, 32, 1], // 200, 32, 1
            &[F64_HALF, F64_1, F64_2].concat(),
            &pose_bytes(),
            &pose_bytes(),
            &[7],
            &F64_3,
            &[1], // one tool
            &[5],
            b"Drill",
            &[1],
            b"d",
            &[2], // two points
            &[F32_0, F32_1, F32_2, F32_MINUS_2].concat(),
            &F32_2,
            &[F64_2, F64_HALF].concat(),
        ],
    );
}

#[test]
fn bone_piece() {
    let piece = BonePiece {
        chunk: 300,
        coord: [1, 2, 127],
        bony: 1 << 63,
        lz4: vec![0xAA, 0xBB, 0xCC],
    };
    holds(
        &ToViewer::BonePiece(piece),
        &[
            &[3],
            &[0xAC, 0x02],
            &[1, 2, 127],
            // Nine groups of seven zero bits, then bit 63.
            &[0x80; 9],
            &[0x01],
            &[3],
            &[0xAA, 0xBB, 0xCC],
        ],
    );
}

#[test]
fn pose() {
    let update = PoseUpdate {
        tick: 1000,
        tool: 1,
        spindle_on: true,
        paused: false,
        clutched: true,
        saturated: true,
        bone_from_tool: POSE,
        bone_from_device: POSE,
        force_n: [0.0, 1.0, -2.0],
        physical_force_n: 2.0,
        vibration_n: 0.0,
        spindle_rpm: 2.0,
        spindle_nmm: 1.0,
        spindle_load: 0.0,
        motion_scale: 1.0,
        depth_mm: 1.0,
        removed_mm3: 0.5,
        checkpoints: 3,
    };
    holds(
        &ToViewer::Pose(update),
        &[
            &[4],
            &[0xE8, 0x07], // 1000
            &[1, 1, 0, 1, 1],
            &pose_bytes(),
            &pose_bytes(),
            &[F32_0, F32_1, F32_MINUS_2, F32_2].concat(),
            // vibration, speed, torque, load, scale, depth
            &[F32_0, F32_2, F32_1, F32_0, F32_1, F32_1].concat(),
            &F64_HALF,
            &[3],
        ],
    );
}

#[test]
fn removals() {
    let event = RemovalEvent {
        tick: 5,
        epoch: 1,
        revision: 200,
        tool: 7,
        bone_from_tool_before: POSE,
        bone_from_tool_after: POSE,
        removed_mm3_by_class: [0.0, 0.5, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0],
    };
    let volumes = [F64_0, F64_HALF, F64_1, F64_2, F64_3, F64_0, F64_0, F64_0];
    holds(
        &ToViewer::Removals(vec![event]),
        &[
            &[5],
            &[1],
            &[5, 1],
            &[0xC8, 0x01],
            &[7],
            &pose_bytes(),
            &pose_bytes(),
            &volumes.concat(),
        ],
    );
}

#[test]
fn bricks() {
    let bricks = Bricks {
        epoch: 2,
        revision: 3,
        ids: vec![(4, 63), (129, 0)],
        lz4: vec![1, 2],
    };
    holds(
        &ToViewer::Bricks(bricks),
        &[
            &[6],
            &[2, 3],
            &[2],
            &[4, 63],
            &[0x81, 0x01, 0],
            &[2],
            &[1, 2],
        ],
    );
}

#[test]
fn digests() {
    let digest = Digest {
        epoch: 1,
        revision: 2,
        hash: u64::MAX,
        changed_chunks: 3,
    };
    // Nine groups of seven one bits, then bit 63.
    let bytes = [&[1, 2][..], &[0xFF; 9], &[0x01], &[3]].concat();
    holds(&ToViewer::Digest(digest), &[&[7], &bytes]);
    let answer = FromViewer::Digest {
        digest,
        frames_rendered: 60,
        updates: 128,
        resyncs: 1,
    };
    holds(&answer, &[&[2], &bytes, &[60], &[0x80, 0x01], &[1]]);
}

#[test]
fn health() {
    let health = Health {
        ticks: 1000,
        late_ticks: 1,
        wake_micros: [0.0, 1.0, 2.0, 2.0],
        tick_micros: [1.0; 4],
        roundtrip_micros: [2.0; 4],
        drive: "active".into(),
        link: "open:/x".into(),
        frames: 2,
        crc_errors: 3,
        gaps: 4,
        watchdog_trips: 5,
        guard_events: 300,
        guards: vec![
            GuardCount {
                name: "clamp".into(),
                count: 300,
                last_tick: 1000,
            },
            GuardCount {
                name: "hold".into(),
                count: 0,
                last_tick: 0,
            },
        ],
        note: String::new(),
    };
    holds(
        &ToViewer::Health(Box::new(health)),
        &[
            &[8],
            &[0xE8, 0x07],
            &[1],
            &[F32_0, F32_1, F32_2, F32_2].concat(),
            &[F32_1; 4].concat(),
            &[F32_2; 4].concat(),
            &[6],
            b"active",
            &[7],
            b"open:/x",
            &[2, 3, 4, 5],
            &[0xAC, 0x02],
            &[2], // two guards
            &[5],
            b"clamp",
            &[0xAC, 0x02, 0xE8, 0x07], // 300, 1000
            &[4],
            b"hold",
            &[0, 0],
            &[0],
        ],
    );
}

#[test]
fn viewer_hello_and_commands() {
    let name = "me".to_owned();
    let hello = FromViewer::Hello { version: 1, name };
    holds(&hello, &[&[0], &[1], &[2], b"me"]);
    holds(&FromViewer::Command(Command::SelectTool(3)), &[&[1, 0, 3]]);
    holds(&FromViewer::Command(Command::Spindle(true)), &[&[1, 1, 1]]);
    holds(&FromViewer::Command(Command::Pause(false)), &[&[1, 2, 0]]);
    holds(&FromViewer::Command(Command::Reset), &[&[1, 3]]);
    holds(&FromViewer::Command(Command::Stop), &[&[1, 4]]);
    holds(&FromViewer::Command(Command::Clutch(true)), &[&[1, 5, 1]]);
    let scale = Command::MotionScale(1500);
    holds(&FromViewer::Command(scale), &[&[1, 6, 0xDC, 0x0B]]);
    // zigzag: 2n for n ≥ 0, −2n − 1 below
    let turn = |milli| FromViewer::Command(Command::TurnWorkspace(milli));
    holds(&turn(262), &[&[1, 7, 0x8C, 0x04]]);
    holds(&turn(-262), &[&[1, 7, 0x8B, 0x04]]);
    holds(&FromViewer::Command(Command::Checkpoint), &[&[1, 8]]);
    holds(&FromViewer::Command(Command::Undo), &[&[1, 9]]);
}

#[test]
fn joining_and_resuming() {
    let mut join = Join {
        role: Role::Projector,
        capabilities: 300,
        pose_hz: 1,
        resume: None,
    };
    holds(
        &FromViewer::Join(join),
        &[&[3], &[2], &[0xAC, 0x02], &[1], &[0]],
    );
    join.role = Role::Trainee;
    join.resume = Some(Resume {
        session: 300,
        seat: u64::MAX,
        pieces: 128,
        batches: 1,
        epoch: 2,
    });
    // nine groups of seven one bits, then bit 63
    let most = [&[0xFF; 9][..], &[0x01]].concat();
    holds(
        &FromViewer::Join(join),
        &[
            &[3, 0, 0xAC, 0x02, 1, 1],
            &[0xAC, 0x02],
            &most,
            &[0x80, 0x01, 1, 2],
        ],
    );
    let welcome = Welcome {
        session: 1,
        seat: u64::MAX,
        number: 3,
        granted: 31,
        resumed: true,
    };
    holds(&ToViewer::Welcome(welcome), &[&[12, 1], &most, &[3, 31, 1]]);
}

#[test]
fn control() {
    let viewer = ViewerInfo {
        number: 3,
        role: Role::Trainer,
        present: true,
        name: "me".into(),
    };
    let mut state = ControlState {
        holder: Some(300),
        asking: None,
        viewers: vec![viewer],
    };
    let here = [&[1, 3, 1, 1, 2][..], b"me"].concat();
    holds(
        &ToViewer::Control(state.clone()),
        &[&[13], &[1, 0xAC, 0x02], &[0], &here],
    );
    state.holder = None;
    state.asking = Some(2);
    state.viewers.clear();
    holds(&ToViewer::Control(state), &[&[13, 0, 1, 2, 0]]);
    let reason = "no".to_owned();
    holds(&ToViewer::Denied { reason }, &[&[14, 2], b"no"]);
    holds(&FromViewer::Command(Command::AskControl), &[&[1, 10]]);
    let hand_over = Command::HandOver(300);
    holds(&FromViewer::Command(hand_over), &[&[1, 11, 0xAC, 0x02]]);
}
