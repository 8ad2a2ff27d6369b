//! The bytes of every message, written down by hand from `WIRE.md`. A change that moves a byte
//! fails here: then the version goes up, and `WIRE.md` changes in the same commit.
//!
//! The whole frames were computed by a separate program from the definitions of COBS and CRC-32C.
#![expect(
    clippy::unwrap_used,
    reason = "a helper that fails is a test that fails"
)]

use osteon_protocol::device::{
    CommandFrame, DEVICE_SCHEMA, DEVICE_VERSION, DeviceHello, DeviceMessage, DriveState,
    HostMessage, StateFrame,
};
use osteon_protocol::frame::{
    self, COMMAND_FRAME_BYTES, FrameReader, MAX_FRAME, STATE_FRAME_BYTES,
};
use serde::{Serialize, de::DeserializeOwned};
use std::fmt::Debug;

const HELLO: DeviceHello = DeviceHello {
    version: 1,
    schema: 0x252D_E128,
    model: 1,
    serial: 42,
    counts_per_rev: 15_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    micro_nm_per_count: 215,
    period_micros: 1000,
};

const STATE: StateFrame = StateFrame {
    seq: 300,
    time_micros: 1_000_000,
    encoders: [1000, -2000, 70_000],
    gimbal: [100, -200, 4096],
    switches: 5,
    drive: DriveState::Active,
    faults: 8,
    applied: [10, -20, 2047],
    temperature: [25, 30, -5],
    ack: 299,
    crc_errors: 1,
    refused: 2,
    trips: 3,
};

const COMMAND: CommandFrame = CommandFrame {
    seq: 300,
    state_seq: 299,
    torque: [10, -20, 300],
    enable: true,
};

const WIRE_MD: &str = include_str!("../../WIRE.md");

fn hex(bytes: &[u8]) -> String {
    let bytes: Vec<_> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    bytes.join(" ")
}

/// Both ways, and in the document's worked example: the message makes these bytes, and these bytes make the message.
fn holds<T>(message: &T, payload: &[&[u8]], framed: &[u8])
where
    T: Serialize + DeserializeOwned + PartialEq + Debug,
{
    let payload = payload.concat();
    let mut out = [0; MAX_FRAME];
    assert_eq!(
        frame::encode(message, &mut out).unwrap(),
        framed,
        "{message:?}"
    );
    assert_eq!(&frame::message::<T>(&payload).unwrap(), message);
    for bytes in [payload.as_slice(), framed] {
        let shown = format!("`{}`", hex(bytes));
        assert!(WIRE_MD.contains(&shown), "not in WIRE.md: {shown}");
    }
    let mut reader = FrameReader::new();
    let (last, before) = framed.split_last().unwrap();
    for byte in before {
        assert_eq!(reader.push_raw(*byte), None);
    }
    assert_eq!(reader.push_raw(*last), Some(Ok(payload.as_slice())));
}

#[test]
fn version_and_layout_are_the_written_ones() {
    assert_eq!((DEVICE_VERSION, DEVICE_SCHEMA), (1, 0x252D_E128));
}

#[test]
fn hello_request() {
    holds(
        &HostMessage::HelloRequest {
            version: 1,
            schema: 0x252D_E128,
        },
        &[&[0], &[1, 0], &[0x28, 0xE1, 0x2D, 0x25]],
        &[
            0x01, 0x02, 0x01, 0x09, 0x28, 0xE1, 0x2D, 0x25, 0x3A, 0xAB, 0xD3, 0xD7, 0x00,
        ],
    );
}

#[test]
fn hello() {
    holds(
        &DeviceMessage::Hello(HELLO),
        &[
            &[0],
            &[1, 0],                   // version
            &[0x28, 0xE1, 0x2D, 0x25], // schema
            &[1, 0],                   // model
            &[42, 0, 0, 0],            // serial
            &[0x98, 0x3A, 0, 0],       // 15000 = 0x3A98
            &[0x00, 0x40],             // 16384 = 0x4000
            &[0xFF, 0x07],             // 2047
            &[215, 0],
            &[0xE8, 0x03], // 1000
        ],
        &[
            0x01, 0x02, 0x01, 0x06, 0x28, 0xE1, 0x2D, 0x25, 0x01, 0x02, 0x2A, 0x01, 0x01, 0x03,
            0x98, 0x3A, 0x01, 0x01, 0x05, 0x40, 0xFF, 0x07, 0xD7, 0x07, 0xE8, 0x03, 0x69, 0x39,
            0x09, 0xEF, 0x00,
        ],
    );
}

#[test]
fn homing_and_arming() {
    holds(
        &HostMessage::Home,
        &[&[2]],
        &[0x06, 0x02, 0xA6, 0x23, 0x46, 0xB3, 0x00],
    );
    holds(
        &HostMessage::Arm,
        &[&[3]],
        &[0x06, 0x03, 0xA5, 0xA0, 0x2D, 0x41, 0x00],
    );
    let nonce = 0x1234_5678;
    holds(
        &DeviceMessage::Challenge { nonce },
        &[&[2], &[0x78, 0x56, 0x34, 0x12]],
        &[
            0x0A, 0x02, 0x78, 0x56, 0x34, 0x12, 0x59, 0xFF, 0x24, 0xCF, 0x00,
        ],
    );
    holds(
        &HostMessage::ArmConfirm { nonce },
        &[&[4], &[0x78, 0x56, 0x34, 0x12]],
        &[
            0x0A, 0x04, 0x78, 0x56, 0x34, 0x12, 0xB1, 0x9E, 0x43, 0x5F, 0x00,
        ],
    );
    holds(
        &HostMessage::Disarm,
        &[&[5]],
        &[0x06, 0x05, 0x4D, 0x47, 0x8C, 0x67, 0x00],
    );
}

#[test]
fn state() {
    let framed = [
        0x07, 0x01, 0x2C, 0x01, 0x40, 0x42, 0x0F, 0x03, 0xE8, 0x03, 0x01, 0x08, 0x30, 0xF8, 0xFF,
        0xFF, 0x70, 0x11, 0x01, 0x02, 0x64, 0x03, 0x38, 0xFF, 0x05, 0x10, 0x05, 0x04, 0x08, 0x02,
        0x0A, 0x11, 0xEC, 0xFF, 0xFF, 0x07, 0x19, 0x1E, 0xFB, 0x2B, 0x01, 0x01, 0x02, 0x03, 0xB5,
        0xA3, 0x50, 0xDB, 0x00,
    ];
    assert_eq!(framed.len(), STATE_FRAME_BYTES);
    holds(
        &DeviceMessage::State(STATE),
        &[
            &[1],
            &[0x2C, 0x01],             // 300
            &[0x40, 0x42, 0x0F, 0x00], // 1 000 000 = 0xF4240
            &[0xE8, 0x03, 0x00, 0x00], // 1000
            &[0x30, 0xF8, 0xFF, 0xFF], // -2000 = 0xFFFFF830
            &[0x70, 0x11, 0x01, 0x00], // 70 000 = 0x11170
            &[0x64, 0x00],             // 100
            &[0x38, 0xFF],             // -200 = 0xFF38
            &[0x00, 0x10],             // 4096
            &[5],                      // button 1 and docked
            &[4],                      // Active
            &[8, 0],                   // slewed
            &[0x0A, 0x00],             // 10
            &[0xEC, 0xFF],             // -20
            &[0xFF, 0x07],             // 2047
            &[25, 30, 0xFB],           // -5 = 0xFB
            &[0x2B, 0x01],             // 299
            &[1],
            &[2],
            &[3],
        ],
        &framed,
    );
}

#[test]
fn command() {
    let framed = [
        0x07, 0x01, 0x2C, 0x01, 0x2B, 0x01, 0x0A, 0x0A, 0xEC, 0xFF, 0x2C, 0x01, 0x01, 0xAD, 0x1A,
        0xE3, 0xE5, 0x00,
    ];
    assert_eq!(framed.len(), COMMAND_FRAME_BYTES);
    holds(
        &HostMessage::Command(COMMAND),
        &[
            &[1],
            &[0x2C, 0x01], // 300
            &[0x2B, 0x01], // 299
            &[0x0A, 0x00], // 10
            &[0xEC, 0xFF], // -20
            &[0x2C, 0x01], // 300
            &[1],
        ],
        &framed,
    );
}

#[test]
fn drive_states_keep_their_numbers() {
    let states = [
        DriveState::Boot,
        DriveState::Unhomed,
        DriveState::Homed,
        DriveState::Armed,
        DriveState::Active,
        DriveState::Hold,
        DriveState::Tripped,
        DriveState::Fault,
    ];
    for (number, drive) in (0_u8..).zip(states) {
        assert_eq!(frame::message::<DriveState>(&[number]), Ok(drive));
    }
    assert!(frame::message::<DriveState>(&[8]).is_err());
}
