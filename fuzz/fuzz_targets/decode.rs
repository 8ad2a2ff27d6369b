//! Every decoder of the device link, on any bytes. What is read must come out of an encoder again.
#![no_main]

use libfuzzer_sys::fuzz_target;
use osteon_protocol::device::{DeviceMessage, HostMessage};
use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};
use osteon_protocol::hfab::{LineReader, MAX_LINE, write_line};
use osteon_protocol::omni_raw::{RawCommand, RawState};

fuzz_target!(|bytes: &[u8]| {
    let (mut host, mut device) = (FrameReader::new(), FrameReader::new());
    let (mut commands, mut states) = (LineReader::<3>::new(), LineReader::<8>::new());
    let mut frame = [0; MAX_FRAME];
    let mut line = [0; MAX_LINE];
    for &byte in bytes {
        if let Some(Ok(message)) = host.push::<HostMessage>(byte) {
            assert!(encode(&message, &mut frame).is_ok());
        }
        if let Some(Ok(message)) = device.push::<DeviceMessage>(byte) {
            assert!(encode(&message, &mut frame).is_ok());
        }
        if let Some(Ok(numbers)) = commands.push(byte) {
            assert_eq!(write_line(&numbers, &mut line).last(), Some(&b'\n'));
        }
        if let Some(Ok(numbers)) = states.push(byte) {
            assert_eq!(write_line(&numbers, &mut line).last(), Some(&b'\n'));
        }
    }
    if let Some(state) = RawState::decode(bytes) {
        assert_eq!(RawState::decode(&state.encode()), Some(state));
    }
    if let Some(command) = RawCommand::decode(bytes) {
        assert_eq!(RawCommand::decode(&command.encode()), Some(command));
    }
});
