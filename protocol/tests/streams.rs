//! The viewer framing under damage: whatever arrives, nothing panics, nothing out of range gets
//! through, and an error is final.
#![expect(
    clippy::unwrap_used,
    reason = "a helper that fails is a test that fails"
)]

use osteon_protocol::crc32c::crc32c;
use osteon_protocol::ipc::{
    BonePiece, Bricks, Command, FromViewer, GuardCount, Health, Join, MAX_BRICKS, MAX_GUARDS,
    MAX_PAYLOAD, PoseUpdate, RemovalEvent, Role, Scene, ToViewer, ToolInfo, WirePose,
};
use osteon_protocol::ipc_frame::{
    HEADER_BYTES, IpcError, MAX_BUFFERED, MAX_TEXT, Message, StreamDecoder, clip, encode_into,
    unpack_bricks, unpack_piece,
};
use proptest::prelude::*;

const POSE: WirePose = WirePose {
    rotation: [0.0, 0.0, 0.0, 1.0],
    translation_mm: [1.0, 2.0, 3.0],
};

fn framed<T: Message>(message: &T) -> Vec<u8> {
    let mut out = Vec::new();
    encode_into(message, &mut out).unwrap();
    out
}

fn wrap(payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap();
    let mut out = length.to_le_bytes().to_vec();
    out.extend(crc32c(payload).to_le_bytes());
    out.extend(payload);
    out
}

fn decode(bytes: &[u8]) -> Result<Option<ToViewer>, IpcError> {
    let mut decoder = StreamDecoder::new();
    decoder.push(bytes);
    decoder.next()
}

fn scene() -> Scene {
    Scene {
        source: "a bone".into(),
        dims: [64, 32, 33],
        spacing_mm: [0.5, 0.5, 1.0],
        lps_from_bone: POSE,
        bone_from_plan: POSE,
        chunks: 4,
        solid_mm3: 100.0,
        tools: vec![ToolInfo {
            name: "reamer".into(),
            id: "reamer".into(),
            outline_mm: vec![[0.0, 0.0], [18.0, 5.0]],
            rpm: 1000.0,
        }],
        force_limit_n: 3.3,
        force_scale: 0.03,
    }
}

fn removal() -> RemovalEvent {
    RemovalEvent {
        tick: 1,
        epoch: 0,
        revision: 1,
        tool: 0,
        bone_from_tool_before: POSE,
        bone_from_tool_after: POSE,
        removed_mm3_by_class: [0.0; 8],
    }
}

fn update() -> PoseUpdate {
    PoseUpdate {
        tick: 1,
        tool: 0,
        spindle_on: true,
        paused: false,
        clutched: false,
        saturated: false,
        bone_from_tool: POSE,
        bone_from_device: POSE,
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
    }
}

fn health() -> Health {
    Health {
        ticks: 1,
        late_ticks: 0,
        wake_micros: [0.0; 4],
        tick_micros: [0.0; 4],
        roundtrip_micros: [0.0; 4],
        drive: "active".into(),
        link: "open:/dev/x".into(),
        frames: 1,
        crc_errors: 0,
        gaps: 0,
        watchdog_trips: 0,
        guard_events: 7,
        guards: vec![GuardCount {
            name: "slew".into(),
            count: 7,
            last_tick: 1,
        }],
        note: String::new(),
    }
}

fn messages() -> impl Strategy<Value = ToViewer> {
    prop_oneof![
        any::<u16>().prop_map(|version| ToViewer::Hello { version }),
        any::<u32>().prop_map(|epoch| ToViewer::Reset { epoch }),
        (any::<u32>(), 0.0..1e9).prop_map(|(epoch, mm3)| ToViewer::Undone {
            epoch,
            removed_mm3_by_class: [mm3; 8],
        }),
        ".{0,40}".prop_map(|reason| ToViewer::Bye { reason }),
        any::<(u64, bool)>().prop_map(|(tick, paused)| ToViewer::Pose(PoseUpdate {
            tick,
            paused,
            ..update()
        })),
        (0_usize..9).prop_map(|n| ToViewer::Removals(vec![removal(); n])),
        (any::<u64>(), prop::collection::vec(any::<u8>(), 0..300)).prop_map(|(bony, lz4)| {
            ToViewer::BonePiece(BonePiece {
                chunk: 0,
                coord: [0, 1, 2],
                bony,
                lz4,
            })
        }),
        Just(ToViewer::Scene(Box::new(scene()))),
        Just(ToViewer::Health(Box::new(health()))),
    ]
}

proptest! {
    #[test]
    fn messages_come_back_however_the_stream_is_cut(
        sent in prop::collection::vec(messages(), 0..12),
        cut in 1_usize..700,
    ) {
        let bytes: Vec<u8> = sent.iter().flat_map(framed).collect();
        let mut decoder = StreamDecoder::new();
        let mut got = Vec::new();
        for piece in bytes.chunks(cut) {
            decoder.push(piece);
            while let Some(message) = decoder.next::<ToViewer>()? {
                got.push(message);
            }
        }
        prop_assert_eq!(got, sent);
    }

    #[test]
    fn every_single_bit_flip_is_refused(sent in messages()) {
        let good = framed(&sent);
        for bit in 0..good.len() * 8 {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let outcome = decode(&bytes);
            // A length that grew waits for bytes that belong to the next message.
            let grew = bit < 32 && bytes[bit / 8] > good[bit / 8];
            prop_assert!(outcome.is_err() || (grew && outcome == Ok(None)), "bit {}", bit);
            if grew {
                bytes.resize(2 * MAX_PAYLOAD, 0x5A);
                prop_assert!(decode(&bytes).is_err(), "bit {}", bit);
            }
        }
    }

    #[test]
    fn a_truncated_message_is_not_a_message(sent in messages()) {
        let good = framed(&sent);
        for length in 0..good.len() {
            prop_assert_eq!(decode(&good[..length]), Ok(None));
        }
    }

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut decoder = StreamDecoder::new();
        for piece in bytes.chunks(7) {
            decoder.push(piece);
            let outcome = decoder.next::<FromViewer>();
            prop_assert!(!matches!(outcome, Ok(Some(_))), "{:?} out of noise", outcome);
        }
    }

    #[test]
    fn random_payloads_with_a_right_crc_never_panic(
        tag in 0_u8..16,
        rest in prop::collection::vec(any::<u8>(), 0..400),
    ) {
        let payload = [&[tag], rest.as_slice()].concat();
        if let Ok(Some(message)) = decode(&wrap(&payload)) {
            prop_assert_eq!(message.validate(), Ok(()));
            match message {
                ToViewer::BonePiece(piece) => { unpack_piece(&piece).ok(); }
                ToViewer::Bricks(bricks) => { unpack_bricks(&bricks).ok(); }
                _ => {}
            }
        }
        let mut decoder = StreamDecoder::new();
        decoder.push(&wrap(&payload));
        if let Ok(Some(message)) = decoder.next::<FromViewer>() {
            prop_assert_eq!(message.validate(), Ok(()));
        }
    }

    #[test]
    fn random_blocks_never_panic(lz4 in prop::collection::vec(any::<u8>(), 0..600), n in 0_usize..9) {
        let piece = BonePiece { chunk: 0, coord: [0; 3], bony: 0, lz4: lz4.clone() };
        prop_assert!(unpack_piece(&piece).is_err(), "600 bytes are too few for a chunk");
        let bricks = Bricks { epoch: 0, revision: 0, ids: vec![(0, 0); n], lz4 };
        if let Ok(values) = unpack_bricks(&bricks) {
            prop_assert_eq!(values.len(), n * 512);
        }
    }
}

#[test]
fn a_length_above_the_limit_is_refused_before_a_byte_of_it_comes() {
    let announced = u32::try_from(MAX_PAYLOAD + 1).unwrap();
    assert_eq!(decode(&announced.to_le_bytes()), Err(IpcError::TooLong));
    assert_eq!(decode(&[0xFF; 4]), Err(IpcError::TooLong));
    let largest = u32::try_from(MAX_PAYLOAD).unwrap();
    assert_eq!(decode(&largest.to_le_bytes()), Ok(None));
}

#[test]
fn a_list_that_announces_more_than_there_is_is_refused() {
    // Removals of 2^32 - 1 events in a payload of six bytes; a text of as many bytes.
    assert_eq!(
        decode(&wrap(&[5, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F])),
        Err(IpcError::Message)
    );
    assert_eq!(
        decode(&wrap(&[10, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F])),
        Err(IpcError::Message)
    );
}

#[test]
fn a_bounded_decoder_takes_no_longer_message() {
    let name = "x".repeat(200);
    let hello = framed(&FromViewer::Hello { version: 1, name });
    let payload = hello.len() - HEADER_BYTES;
    let mut decoder = StreamDecoder::bounded(payload);
    decoder.push(&hello);
    assert!(decoder.next::<FromViewer>().is_ok_and(|m| m.is_some()));
    let mut decoder = StreamDecoder::bounded(payload - 1);
    decoder.push(&hello[..4]);
    let outcome = decoder.next::<FromViewer>();
    assert_eq!(outcome, Err(IpcError::TooLong), "before a byte of it comes");
}

#[test]
fn an_error_is_final() {
    let mut decoder = StreamDecoder::new();
    let good = framed(&ToViewer::Hello { version: 1 });
    let mut bad = good.clone();
    bad[8] ^= 1;
    decoder.push(&bad);
    assert_eq!(decoder.next::<ToViewer>(), Err(IpcError::Crc));
    decoder.push(&good);
    assert_eq!(decoder.next::<ToViewer>(), Err(IpcError::Crc));
}

#[test]
fn left_over_bytes_are_refused() {
    assert!(decode(&wrap(&[0, 1])).is_ok());
    assert_eq!(decode(&wrap(&[0, 1, 0])), Err(IpcError::Message));
    assert_eq!(decode(&wrap(&[15])), Err(IpcError::Message));
    assert_eq!(decode(&wrap(&[])), Err(IpcError::Message));
}

#[test]
fn a_reader_that_never_takes_messages_out_is_bounded() {
    let mut decoder = StreamDecoder::new();
    let hello = framed(&ToViewer::Hello { version: 1 });
    let flood = hello.repeat(MAX_BUFFERED / hello.len() + 1);
    for piece in flood.chunks(65_536) {
        decoder.push(piece);
    }
    assert_eq!(decoder.next::<ToViewer>(), Err(IpcError::Overrun));
}

#[test]
fn the_largest_message_passes_and_a_larger_one_is_refused_by_the_sender() {
    let piece = |bytes| {
        ToViewer::BonePiece(BonePiece {
            chunk: 0,
            coord: [0; 3],
            bony: 0,
            lz4: vec![7; bytes],
        })
    };
    // Tag, chunk, coord, bony: 6 bytes; the length of the block: 3.
    let largest = piece(MAX_PAYLOAD - 9);
    let bytes = framed(&largest);
    assert_eq!(bytes.len(), HEADER_BYTES + MAX_PAYLOAD);
    assert_eq!(decode(&bytes), Ok(Some(largest)));
    let mut out = vec![1, 2, 3];
    let refused = encode_into(&piece(MAX_PAYLOAD - 8), &mut out);
    assert_eq!(refused, Err(IpcError::TooLong));
    assert_eq!(out, [1, 2, 3], "nothing of a refused message stays");
}

fn refuses<T: Message>(field: &'static str, message: &T) {
    let mut decoder = StreamDecoder::new();
    decoder.push(&framed(message));
    let outcome = decoder.next::<T>().err();
    assert_eq!(outcome, Some(IpcError::Range(field)));
}

/// One change to a good pose, and the field that must be named for it.
type SpoilPose = (&'static str, fn(&mut PoseUpdate));

/// One change to a good scene, and the field that must be named for it.
type Spoil = (&'static str, fn(&mut Scene));

#[test]
fn a_scene_out_of_range_is_refused_by_name() {
    assert_eq!(ToViewer::Scene(Box::new(scene())).validate(), Ok(()));
    let spoils: [Spoil; 18] = [
        ("voxel count", |s| s.dims[1] = 0),
        ("voxel count", |s| s.dims[2] = 4097),
        ("voxel spacing", |s| s.spacing_mm[0] = 0.0),
        ("voxel spacing", |s| s.spacing_mm[1] = -1.0),
        ("voxel spacing", |s| s.spacing_mm[2] = f64::NAN),
        ("voxel spacing", |s| s.spacing_mm[2] = f64::INFINITY),
        ("chunk count", |s| s.chunks = 5),
        ("patient pose", |s| {
            s.lps_from_bone.translation_mm[0] = f64::NAN;
        }),
        ("planned pose", |s| s.bone_from_plan.rotation = [0.0; 4]),
        ("solid volume", |s| s.solid_mm3 = -1.0),
        ("force limit", |s| s.force_limit_n = f64::INFINITY),
        ("force scale", |s| s.force_scale = f64::NAN),
        ("tool speed", |s| s.tools[0].rpm = -1.0),
        ("tool count", |s| s.tools = vec![s.tools[0].clone(); 9]),
        ("tool name", |s| s.tools[0].name = "x".repeat(201)),
        ("tool outline length", |s| {
            s.tools[0].outline_mm = vec![[0.0; 2]; 257];
        }),
        ("tool outline", |s| s.tools[0].outline_mm[1][0] = f32::NAN),
        ("bone source", |s| s.source = "x".repeat(MAX_TEXT + 1)),
    ];
    for (field, spoil) in spoils {
        let mut bad = scene();
        spoil(&mut bad);
        refuses(field, &ToViewer::Scene(Box::new(bad)));
    }
}

#[test]
fn other_messages_out_of_range_are_refused_by_name() {
    let mut bad = update();
    bad.tool = 8;
    refuses("tool index", &ToViewer::Pose(bad));
    bad = update();
    bad.force_n[2] = f32::NAN;
    refuses("force", &ToViewer::Pose(bad));
    bad = update();
    bad.bone_from_device.translation_mm[1] = f64::INFINITY;
    refuses("device pose", &ToViewer::Pose(bad));
    let spoils: [SpoilPose; 7] = [
        ("force", |p| p.physical_force_n = f32::INFINITY),
        ("vibration", |p| p.vibration_n = -0.1),
        ("spindle speed", |p| p.spindle_rpm = f32::NAN),
        ("spindle torque", |p| p.spindle_nmm = f32::NEG_INFINITY),
        ("spindle load", |p| p.spindle_load = 1.01),
        ("spindle load", |p| p.spindle_load = f32::NAN),
        ("motion scale", |p| p.motion_scale = -1.0),
    ];
    for (field, spoil) in spoils {
        let mut bad = update();
        spoil(&mut bad);
        refuses(field, &ToViewer::Pose(bad));
    }
}

#[test]
fn updates_health_and_joins_out_of_range_are_refused_by_name() {
    let mut cut = removal();
    cut.removed_mm3_by_class[3] = f64::NAN;
    refuses("removed volume", &ToViewer::Removals(vec![removal(), cut]));
    let many = Bricks {
        epoch: 0,
        revision: 0,
        ids: vec![(0, 0); MAX_BRICKS + 1],
        lz4: Vec::new(),
    };
    refuses("number of bricks", &ToViewer::Bricks(many.clone()));
    let one = Bricks {
        ids: vec![(0, 64)],
        ..many
    };
    refuses("brick index", &ToViewer::Bricks(one));
    let piece = BonePiece {
        chunk: 0,
        coord: [0, 128, 0],
        bony: 0,
        lz4: Vec::new(),
    };
    refuses("chunk coordinate", &ToViewer::BonePiece(piece));
    let mut ill = health();
    ill.tick_micros[3] = f32::INFINITY;
    refuses("latency", &ToViewer::Health(Box::new(ill)));
    ill = health();
    ill.guards = vec![ill.guards[0].clone(); MAX_GUARDS + 1];
    refuses("number of guards", &ToViewer::Health(Box::new(ill)));
    ill = health();
    ill.guards[0].name = "x".repeat(201);
    refuses("guard name", &ToViewer::Health(Box::new(ill)));
    let name = "x".repeat(201);
    refuses("viewer name", &FromViewer::Hello { version: 1, name });
    for pose_hz in [0, 251] {
        let join = Join {
            role: Role::Trainee,
            capabilities: u32::MAX,
            pose_hz,
            resume: None,
        };
        refuses("pose rate", &FromViewer::Join(join));
    }
    refuses("viewer number", &FromViewer::Command(Command::HandOver(0)));
    let tool = FromViewer::Command(Command::SelectTool(8));
    refuses("tool index", &tool);
}

#[test]
fn commands_out_of_range_are_refused_by_name() {
    for milli in [0, 199, 5001, u16::MAX] {
        let scale = FromViewer::Command(Command::MotionScale(milli));
        refuses("motion scale", &scale);
    }
    for milli in [i16::MIN, -3143, 3143, i16::MAX] {
        let turn = FromViewer::Command(Command::TurnWorkspace(milli));
        refuses("turn of the workspace", &turn);
    }
    let good = [
        Command::Clutch(true),
        Command::MotionScale(200),
        Command::MotionScale(5000),
        Command::TurnWorkspace(-3142),
        Command::TurnWorkspace(3142),
    ];
    for command in good {
        let message = FromViewer::Command(command);
        let mut decoder = StreamDecoder::new();
        decoder.push(&framed(&message));
        assert_eq!(decoder.next::<FromViewer>(), Ok(Some(message)));
    }
}

#[test]
fn a_text_is_clipped_between_characters() {
    assert_eq!(clip("short"), "short");
    let long = format!("x{}", "é".repeat(MAX_TEXT));
    let clipped = clip(&long);
    assert_eq!(clipped.len(), MAX_TEXT - 1, "an é is two bytes");
    assert!(long.starts_with(clipped));
}
