//! The device framing under damage: whatever arrives, nothing panics, no damaged frame is taken
//! for a message, and the next whole one is read.
#![expect(
    clippy::unwrap_used,
    reason = "a helper that fails is a test that fails"
)]

use osteon_protocol::crc32c::crc32c;
use osteon_protocol::device::{CommandFrame, DeviceMessage, DriveState, HostMessage, StateFrame};
use osteon_protocol::frame::{
    self, COMMAND_FRAME_BYTES, FrameError, FrameReader, MAX_FRAME, STATE_FRAME_BYTES, is_newer,
};
use proptest::prelude::*;
use serde::{Serialize, de::DeserializeOwned};

fn framed<T: Serialize>(message: &T) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    frame::encode(message, &mut out).unwrap().to_vec()
}

/// An independent, plain statement of the framing: cut the body at its zeros, write each piece
/// behind its length plus one.
fn wrap(payload: &[u8]) -> Vec<u8> {
    let mut body = payload.to_vec();
    body.extend(crc32c(payload).to_le_bytes());
    let mut out = Vec::new();
    for piece in body.split(|byte| *byte == 0) {
        out.push(u8::try_from(piece.len() + 1).unwrap());
        out.extend(piece);
    }
    out.push(0);
    out
}

fn read<T: DeserializeOwned>(reader: &mut FrameReader, bytes: &[u8]) -> Vec<Result<T, FrameError>> {
    bytes.iter().filter_map(|byte| reader.push(*byte)).collect()
}

fn read_new<T: DeserializeOwned>(bytes: &[u8]) -> Vec<Result<T, FrameError>> {
    read(&mut FrameReader::new(), bytes)
}

fn drives() -> impl Strategy<Value = DriveState> {
    prop_oneof![
        Just(DriveState::Boot),
        Just(DriveState::Armed),
        Just(DriveState::Active),
        Just(DriveState::Fault),
    ]
}

prop_compose! {
    fn states()(
        (seq, ack, faults) in any::<(u16, u16, u16)>(),
        time_micros in any::<u32>(),
        encoders in any::<[i32; 3]>(),
        (gimbal, applied) in any::<([i16; 3], [i16; 3])>(),
        temperature in any::<[i8; 3]>(),
        drive in drives(),
        (switches, crc_errors, refused, trips) in any::<(u8, u8, u8, u8)>(),
    ) -> DeviceMessage {
        DeviceMessage::State(StateFrame {
            seq, time_micros, encoders, gimbal, switches, drive, faults, applied, temperature, ack,
            crc_errors, refused, trips,
        })
    }
}

prop_compose! {
    fn commands()(
        (seq, state_seq) in any::<(u16, u16)>(),
        torque in any::<[i16; 3]>(),
        enable in any::<bool>(),
    ) -> HostMessage {
        HostMessage::Command(CommandFrame { seq, state_seq, torque, enable })
    }
}

proptest! {
    #[test]
    fn streaming_frames_have_one_size_and_come_back(state in states(), command in commands()) {
        let bytes = framed(&state);
        prop_assert_eq!(bytes.len(), STATE_FRAME_BYTES);
        prop_assert_eq!(bytes.iter().position(|b| *b == 0), Some(STATE_FRAME_BYTES - 1));
        prop_assert_eq!(read_new(&bytes), vec![Ok(state)]);
        let bytes = framed(&command);
        prop_assert_eq!(bytes.len(), COMMAND_FRAME_BYTES);
        prop_assert_eq!(bytes.iter().position(|b| *b == 0), Some(COMMAND_FRAME_BYTES - 1));
        prop_assert_eq!(read_new(&bytes), vec![Ok(command)]);
    }

    #[test]
    fn the_framing_equals_its_plain_statement(payload in prop::collection::vec(0_u8..4, 1..=57)) {
        // A tuple of bytes is its own postcard payload; arrays stop at 32.
        let mut out = [0; MAX_FRAME];
        let encoded = frame::encode(&Raw(&payload), &mut out).unwrap();
        prop_assert_eq!(encoded, wrap(&payload));
        let mut reader = FrameReader::new();
        let (last, before) = encoded.split_last().unwrap();
        for byte in before {
            prop_assert_eq!(reader.push_raw(*byte), None);
        }
        prop_assert_eq!(reader.push_raw(*last), Some(Ok(payload.as_slice())));
    }

    #[test]
    fn every_single_bit_flip_is_refused(state in states(), next in states()) {
        let good = framed(&state);
        let after = framed(&next);
        for bit in 0..good.len() * 8 {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            // A flipped delimiter joins the frame to the one behind it, which is lost as well.
            bytes.extend(&after);
            bytes.extend(&after);
            let outcomes = read_new::<DeviceMessage>(&bytes);
            let accepted: Vec<_> = outcomes.iter().flatten().collect();
            prop_assert!(accepted.iter().all(|message| **message == next), "bit {}", bit);
            let in_delimiter = bit / 8 == good.len() - 1;
            prop_assert_eq!(accepted.len(), if in_delimiter { 1 } else { 2 }, "bit {}", bit);
            prop_assert!(outcomes.iter().any(Result::is_err), "bit {}", bit);
        }
    }

    #[test]
    fn every_truncation_is_refused(state in states()) {
        let good = framed(&state);
        for length in 1..good.len() - 1 {
            let mut bytes = good[..length].to_vec();
            bytes.push(0);
            let outcomes = read_new::<DeviceMessage>(&bytes);
            prop_assert_eq!(outcomes.len(), 1);
            prop_assert!(outcomes[0].is_err(), "the first {} bytes", length);
        }
        // Without its delimiter it is not over yet.
        prop_assert!(read_new::<DeviceMessage>(&good[..good.len() - 1]).is_empty());
    }

    #[test]
    fn frames_in_a_row_all_come_back(states in prop::collection::vec(states(), 0..20)) {
        let bytes: Vec<u8> = states.iter().flat_map(framed).collect();
        let expected: Vec<_> = states.into_iter().map(Ok).collect();
        prop_assert_eq!(read_new(&bytes), expected);
    }

    #[test]
    fn random_bytes_never_panic_and_never_spoil_the_next_frame(
        garbage in prop::collection::vec(any::<u8>(), 0..1000),
        state in states(),
    ) {
        let mut reader = FrameReader::new();
        for outcome in read::<DeviceMessage>(&mut reader, &garbage) {
            prop_assert!(outcome.is_err(), "{:?} out of noise", outcome);
        }
        read::<DeviceMessage>(&mut reader, &[0]);
        prop_assert_eq!(read(&mut reader, &framed(&state)), vec![Ok(state)]);
    }

    #[test]
    fn random_payloads_with_a_right_crc_never_panic(
        payload in prop::collection::vec(any::<u8>(), 0..57),
    ) {
        let bytes = wrap(&payload);
        for outcome in read_new::<DeviceMessage>(&bytes) {
            prop_assert!(outcome.is_ok() || outcome == Err(FrameError::Message));
        }
        for outcome in read_new::<HostMessage>(&bytes) {
            prop_assert!(outcome.is_ok() || outcome == Err(FrameError::Message));
        }
    }

    #[test]
    fn newer_is_within_half_the_circle(seq: u16, ahead in 1_u16..0x8000) {
        prop_assert!(is_newer(seq.wrapping_add(ahead), seq));
        prop_assert!(!is_newer(seq, seq.wrapping_add(ahead)));
        prop_assert!(!is_newer(seq, seq));
    }
}

/// Bytes that serialize to themselves, without a length in front.
struct Raw<'a>(&'a [u8]);

impl Serialize for Raw<'_> {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeTuple as _;
        let mut tuple = to.serialize_tuple(self.0.len())?;
        for byte in self.0 {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

#[test]
fn the_largest_message_fills_the_largest_frame_and_one_more_byte_is_refused() {
    let mut out = [0; MAX_FRAME];
    assert_eq!(
        frame::encode(&Raw(&[7; 57]), &mut out).unwrap().len(),
        MAX_FRAME
    );
    assert_eq!(
        frame::encode(&Raw(&[7; 58]), &mut out),
        Err(FrameError::TooLong)
    );
}

#[test]
fn the_tail_of_an_over_long_frame_is_not_a_message() {
    let good = framed(&HostMessage::Arm);
    for noise in 0..200 {
        let mut bytes = vec![0x33; noise];
        bytes.extend(&good);
        let outcomes = read_new::<HostMessage>(&bytes);
        assert_eq!(outcomes.len(), 1);
        if noise == 0 {
            assert_eq!(outcomes[0], Ok(HostMessage::Arm));
        } else {
            assert!(outcomes[0].is_err(), "{noise} bytes of noise in front");
        }
        if noise + good.len() > MAX_FRAME {
            assert_eq!(outcomes[0], Err(FrameError::TooLong), "{noise}");
        }
    }
}

#[test]
fn left_over_bytes_and_unknown_messages_are_refused() {
    // Arm is the one byte 3.
    assert_eq!(read_new(&wrap(&[3])), vec![Ok(HostMessage::Arm)]);
    let refused = vec![Err::<HostMessage, _>(FrameError::Message)];
    assert_eq!(read_new(&wrap(&[3, 0])), refused);
    assert_eq!(read_new(&wrap(&[6])), refused);
    assert_eq!(read_new(&wrap(&[])), refused);
    // A bool is 0 or 1.
    let mut command = vec![1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
    assert!(read_new::<HostMessage>(&wrap(&command))[0].is_ok());
    command[11] = 2;
    assert_eq!(read_new(&wrap(&command)), refused);
}

#[test]
fn empty_lines_say_nothing() {
    assert!(read_new::<HostMessage>(&[0; 100]).is_empty());
}

/// A bounded run of `examples/damage.rs`: no damaged command is read as another one.
#[test]
fn damaged_commands_are_never_another_message() {
    let mut random = 7_u64;
    let mut next = move || {
        // xorshift
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        random
    };
    let (mut read_as_another, mut tried) = (0, 0);
    for _ in 0..200_000 {
        let torque = [(); 3].map(|()| i16::from_le_bytes([next().to_le_bytes()[0], 3]));
        let message = HostMessage::Command(CommandFrame {
            seq: 1 + (next() & 0x7fff) as u16,
            state_seq: (next() & 0xffff) as u16,
            torque,
            enable: true,
        });
        let mut bytes = framed(&message);
        for _ in 0..=(next() % 8) {
            let bit = usize::from((next() & 0xffff) as u16) % (bytes.len() * 8);
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        bytes.push(0);
        tried += 1;
        let read = read_new::<HostMessage>(&bytes);
        read_as_another += read.iter().flatten().filter(|m| **m != message).count();
    }
    assert_eq!((read_as_another, tried), (0, 200_000));
}
