//! Opening, the handshake, homing and arming, and each way they can be refused.

use super::{HELLO, Peer, command, device, polite, state};
use crate::link::{DeviceInfo, DeviceLink as _, LinkError, OpenLink};
use osteon_protocol::device::{DeviceHello, DeviceMessage, DriveState, HostMessage, fault, switch};
use osteon_protocol::frame::{self, MAX_FRAME};
use std::time::{Duration, Instant};

#[test]
fn a_session_goes_from_boot_to_active_and_ends_disarmed() {
    let peer = Peer::start(device(DriveState::Boot, switch::DOCKED));
    let mut link = OpenLink::open(&peer.path).unwrap();
    assert_eq!(*link.info(), DeviceInfo::omni(&HELLO));
    assert_eq!(link.describe(), format!("open:{}", peer.path));
    link.prepare().unwrap();
    let began = Instant::now();
    for seq in 1.. {
        link.send(&command(seq)).unwrap();
        let state = link.poll().unwrap();
        if state.is_some_and(|s| s.drive == DriveState::Active) {
            break;
        }
        assert!(began.elapsed() < Duration::from_secs(5), "never active");
        std::thread::sleep(Duration::from_millis(1));
    }
    let stats = link.stats();
    assert!(stats.frames > 20, "{stats:?}");
    assert_eq!((stats.crc_errors, stats.gaps, stats.stale), (0, 0, 0));
    drop(link);
    let (_, mut heard) = peer.end();
    heard.retain(|m| !matches!(m, HostMessage::HelloRequest { .. }));
    let commands = heard
        .iter()
        .filter(|m| matches!(m, HostMessage::Command(_)));
    assert!(commands.count() >= 1);
    assert!(heard.contains(&HostMessage::Command(command(1))));
    heard.retain(|m| !matches!(m, HostMessage::Command(_)));
    heard.dedup();
    let confirm = HostMessage::ArmConfirm { nonce: 0xDEAD_BEEF };
    assert_eq!(
        heard,
        [
            HostMessage::Home,
            HostMessage::Arm,
            confirm,
            HostMessage::Disarm
        ]
    );
}

#[test]
fn what_an_earlier_session_left_is_disarmed_first() {
    for left in [DriveState::Active, DriveState::Tripped, DriveState::Fault] {
        let peer = Peer::start(device(left, 0));
        let mut link = OpenLink::open(&peer.path).unwrap();
        link.prepare().unwrap();
        let (_, heard) = peer.end();
        let first = heard
            .iter()
            .find(|m| !matches!(m, HostMessage::HelloRequest { .. }));
        assert_eq!(first, Some(&HostMessage::Disarm), "{left:?}");
    }
}

#[test]
fn an_absent_port_is_named_with_a_remedy() {
    let error = OpenLink::open("/dev/osteon-no-such-port").unwrap_err();
    let line = error.to_string();
    assert!(matches!(error, LinkError::NoPort { .. }), "{line}");
    let begin = "device open:/dev/osteon-no-such-port: no such port; available: ";
    assert!(line.starts_with(begin), "{line}");
    assert!(line.ends_with("start one with 'osteon fake-omni' or give --device"));
    assert!(!line.contains('\n'));
}

#[test]
fn what_is_no_serial_port_is_refused() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let directory = tempfile::tempdir().unwrap();
    let inside = file.path().join("port");
    for path in [file.path(), directory.path(), inside.as_path()] {
        let error = OpenLink::open(path.to_str().unwrap()).unwrap_err();
        assert!(matches!(error, LinkError::NotSerial { .. }), "{error}");
    }
    assert!(OpenLink::open("").is_err());
    assert!(OpenLink::open("a\0b").is_err());
}

#[test]
fn a_second_program_on_the_port_is_refused_and_the_first_goes_on() {
    let peer = Peer::start(device(DriveState::Unhomed, switch::DOCKED));
    let mut first = OpenLink::open(&peer.path).unwrap();
    let error = OpenLink::open(&peer.path).unwrap_err();
    assert!(matches!(error, LinkError::Busy { .. }), "{error}");
    assert!(error.to_string().contains("another program"), "{error}");
    first.prepare().unwrap();
    drop(first);
    OpenLink::open(&peer.path).expect("free again");
}

#[test]
fn a_silent_port_is_refused_after_two_seconds() {
    let peer = Peer::start(Box::new(|_, _| ()));
    let began = Instant::now();
    let error = OpenLink::open(&peer.path).unwrap_err();
    let took = began.elapsed();
    assert!(matches!(error, LinkError::Silent { .. }), "{error}");
    assert!(took >= Duration::from_secs(2), "{took:?}");
    let (_, heard) = peer.end();
    assert!(heard.len() >= 5, "the hello was repeated: {}", heard.len());
}

#[test]
fn a_foreign_protocol_is_shown_in_hexadecimal() {
    let peer = Peer::start(Box::new(|master, _| master.write(b"[2,10,-4]\n")));
    let error = OpenLink::open(&peer.path).unwrap_err();
    let LinkError::Foreign { first_bytes, .. } = &error else {
        panic!("{error}");
    };
    // A flush may cut the first line; ten bytes on it repeats.
    let line = "5b 32 2c 31 30 2c 2d 34 5d 0a ".repeat(3);
    assert_eq!(first_bytes.split(' ').count(), 16);
    assert!(line.contains(first_bytes.as_str()), "{first_bytes}");
}

#[test]
fn a_stream_without_a_hello_is_told_from_a_foreign_protocol() {
    let mut seq = 0_u16;
    let peer = Peer::start(Box::new(move |master, _| {
        seq += 1;
        master.send(&DeviceMessage::State(state(seq, DriveState::Homed)));
    }));
    let error = OpenLink::open(&peer.path).unwrap_err();
    assert!(matches!(error, LinkError::NoHello { .. }), "{error}");
}

#[test]
fn another_version_and_another_layout_are_named() {
    let answer = |hello: DeviceHello| {
        let peer = Peer::start(Box::new(move |master, messages| {
            if !messages.is_empty() {
                master.send(&DeviceMessage::Hello(hello));
            }
        }));
        OpenLink::open(&peer.path).unwrap_err()
    };
    let mut hello = HELLO;
    hello.version = 9;
    let error = answer(hello);
    assert!(error.to_string().contains("speaks version 9"), "{error}");
    hello = HELLO;
    hello.schema = 0x0BAD_F00D;
    let error = answer(hello);
    assert!(error.to_string().contains("schema 0badf00d"), "{error}");
    hello = HELLO;
    hello.counts_per_rev = 0;
    let error = answer(hello);
    assert!(error.to_string().contains("counts_per_rev (0)"), "{error}");
    hello = HELLO;
    hello.dac_max = -1;
    assert!(matches!(answer(hello), LinkError::BadHello { .. }));
}

#[test]
fn the_version_of_a_longer_hello_is_still_read() {
    // A future hello: the same tag and first two fields, then what nobody here knows.
    let future = (0_u8, 2_u8, 0_u8, [0x78_u8, 0x56, 0x34, 0x12], [0xEE_u8; 30]);
    let mut out = [0; MAX_FRAME];
    let bytes = frame::encode(&future, &mut out).unwrap().to_vec();
    let peer = Peer::start(Box::new(move |master, messages| {
        if !messages.is_empty() {
            master.write(&bytes);
        }
    }));
    let error = OpenLink::open(&peer.path).unwrap_err();
    assert!(
        matches!(error, LinkError::Version { device: 2, .. }),
        "{error}"
    );
}

#[test]
fn homing_outside_the_dock_is_refused() {
    let peer = Peer::start(device(DriveState::Unhomed, 0));
    let mut link = OpenLink::open(&peer.path).unwrap();
    let error = link.prepare().unwrap_err();
    assert!(matches!(error, LinkError::NotDocked { .. }), "{error}");
    let (_, heard) = peer.end();
    assert!(!heard.contains(&HostMessage::Home));
}

#[test]
fn a_fault_that_stays_is_named() {
    let peer = Peer::start({
        let mut hello = polite();
        let mut seq = 0_u16;
        Box::new(move |master, messages| {
            hello(master, messages);
            seq += 1;
            let mut frame = state(seq, DriveState::Fault);
            frame.faults = fault::SELF_TEST | fault::OVER_TEMPERATURE;
            master.send(&DeviceMessage::State(frame));
        })
    });
    let mut link = OpenLink::open(&peer.path).unwrap();
    let error = link.prepare().unwrap_err().to_string();
    assert!(error.contains("motor too hot, self-test failed"), "{error}");
}

#[test]
fn a_device_that_does_not_stream_is_silent() {
    let peer = Peer::start(polite());
    let mut link = OpenLink::open(&peer.path).unwrap();
    let error = link.prepare().unwrap_err();
    assert!(
        matches!(error, LinkError::Silent { seconds: 2, .. }),
        "{error}"
    );
}
