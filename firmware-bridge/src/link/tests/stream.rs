//! The stream of states and commands, whole and damaged.

use super::{command, framed, linked, poll_until, state};
use crate::link::{DeviceLink as _, LinkError};
use osteon_protocol::device::{DeviceMessage, DriveState, HostMessage};
use osteon_protocol::frame::FrameReader;
use std::time::{Duration, Instant};

#[test]
fn the_newest_state_wins_and_old_ones_are_refused() {
    let (mut link, master) = linked();
    let burst: Vec<u8> = [10, 11, 12, 12, 9, 14]
        .into_iter()
        .flat_map(|seq| framed(&DeviceMessage::State(state(seq, DriveState::Homed))))
        .collect();
    master.write(&burst);
    let newest = poll_until(&mut link, 14);
    assert_eq!(newest, state(14, DriveState::Homed));
    let stats = link.stats();
    assert_eq!((stats.frames, stats.stale, stats.gaps), (4, 2, 1));
    assert_eq!(link.poll().unwrap(), None, "nothing newer came");
}

#[test]
fn damaged_frames_are_counted_and_the_stream_goes_on() {
    let (mut link, master) = linked();
    let good = |seq| framed(&DeviceMessage::State(state(seq, DriveState::Homed)));
    let mut flipped = good(2);
    flipped[20] ^= 0x10;
    let torn = &good(3)[..30];
    let stream = [
        good(1),
        flipped,
        // A torn frame runs into the next one and takes it along.
        torn.to_vec(),
        good(4),
        vec![0x55; 200],
        vec![0, 0, 0],
        good(5),
    ]
    .concat();
    master.write(&stream);
    poll_until(&mut link, 5);
    let stats = link.stats();
    assert_eq!((stats.frames, stats.crc_errors, stats.gaps), (2, 3, 3));
}

#[test]
fn a_device_that_counts_anew_is_reported() {
    let (mut link, master) = linked();
    master.send(&DeviceMessage::State(state(5000, DriveState::Active)));
    poll_until(&mut link, 5000);
    let mut outcome = Ok(None);
    for seq in 1..=150 {
        master.send(&DeviceMessage::State(state(seq, DriveState::Boot)));
        std::thread::sleep(Duration::from_millis(1));
        outcome = link.poll();
        if outcome.is_err() {
            break;
        }
        assert_eq!(outcome, Ok(None), "state {seq} was taken for a new one");
    }
    let error = outcome.unwrap_err();
    assert!(matches!(error, LinkError::Restarted { .. }), "{error}");
}

#[test]
fn a_device_that_stops_reading_never_blocks_the_host() {
    let (mut link, master) = linked();
    let mut slowest = Duration::ZERO;
    for seq in 1..=5000 {
        let began = Instant::now();
        link.send(&command(seq)).unwrap();
        slowest = slowest.max(began.elapsed());
    }
    let dropped = link.stats().dropped_commands;
    assert!(dropped > 1000, "the cable took all: {dropped} dropped");
    // A blocking write would wait for ever; the bound only allows for a busy machine.
    assert!(slowest < Duration::from_secs(2), "{slowest:?}");
    // What did get through is whole and in order, also after the cable clears.
    let mut reader = FrameReader::new();
    let mut last = 0;
    let mut got = 0_u64;
    for seq in 5001..=5200 {
        for byte in master.read() {
            match reader.push(byte) {
                Some(Ok(HostMessage::Command(command))) => {
                    assert!(command.seq > last, "{} after {last}", command.seq);
                    last = command.seq;
                    got += 1;
                }
                Some(Ok(HostMessage::HelloRequest { .. })) | None => {}
                other => panic!("{other:?}"),
            }
        }
        link.send(&command(seq)).unwrap();
        std::thread::sleep(Duration::from_micros(200));
    }
    assert!(last > 5000, "commands flow again: {last}");
    assert!(got > 200, "{got}");
}

#[test]
fn a_port_that_vanishes_is_reported_by_name() {
    let (mut link, master) = linked();
    let path = master.path.clone();
    drop(master);
    let error = link.poll().unwrap_err();
    assert!(matches!(error, LinkError::Gone { .. }), "{error}");
    assert!(error.to_string().contains(&path), "{error}");
    assert!(link.send(&command(1)).is_err());
    link.disarm();
}
