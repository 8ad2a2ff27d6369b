//! The whole process loop over a real pty. Only logic is asserted, in the device's own time: the
//! machine that runs this may stop either side for a while.

use super::*;
use osteon_protocol::device::DeviceMessage;
use osteon_protocol::device::{CommandFrame, DeviceHello, DriveState, StateFrame, switch};
use osteon_protocol::frame::encode;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A host with its own frame reader on the link's far end.
struct Host {
    port: File,
    reader: FrameReader,
    hello: Option<DeviceHello>,
    nonce: Option<u32>,
    state: Option<StateFrame>,
    frames: u32,
    bad: u32,
    seq: u16,
}

impl Host {
    fn open(link: &Path) -> Self {
        let started = Instant::now();
        let port = loop {
            // Linux's O_NONBLOCK; the link appears when the device is ready.
            let opened = File::options()
                .read(true)
                .write(true)
                .custom_flags(0o4000)
                .open(link);
            match opened {
                Ok(port) => break port,
                Err(error) => assert!(started.elapsed().as_secs() < 10, "{error}"),
            }
            std::thread::sleep(Duration::from_millis(5));
        };
        Self {
            port,
            reader: FrameReader::new(),
            hello: None,
            nonce: None,
            state: None,
            frames: 0,
            bad: 0,
            seq: 0,
        }
    }

    fn read(&mut self) {
        let mut bytes = [0; 4096];
        let count = self.port.read(&mut bytes).unwrap_or(0);
        for &byte in &bytes[..count] {
            match self.reader.push::<DeviceMessage>(byte) {
                Some(Ok(DeviceMessage::Hello(hello))) => self.hello = Some(hello),
                Some(Ok(DeviceMessage::Challenge { nonce })) => self.nonce = Some(nonce),
                Some(Ok(DeviceMessage::State(state))) => {
                    self.frames += 1;
                    self.state = Some(state);
                }
                Some(Err(_)) => self.bad += 1,
                None => {}
            }
        }
    }

    fn tell(&mut self, message: HostMessage) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(&message, &mut buffer).unwrap();
        self.port.write_all(frame).unwrap();
    }

    /// Repeats `message` until `done`, at most 10 s.
    fn tell_until(&mut self, message: HostMessage, done: impl Fn(&Self) -> bool) {
        let started = Instant::now();
        while !done(self) {
            assert!(started.elapsed().as_secs() < 10, "no effect: {message:?}");
            self.tell(message);
            for _ in 0..20 {
                std::thread::sleep(Duration::from_millis(1));
                self.read();
            }
        }
    }

    fn drive(&self) -> Option<DriveState> {
        self.state.map(|state| state.drive)
    }

    fn session(&mut self) {
        let ask = HostMessage::HelloRequest {
            version: 1,
            schema: 2,
        };
        self.tell_until(ask, |host| host.hello.is_some());
        self.tell_until(HostMessage::Home, |host| {
            host.drive() == Some(DriveState::Homed)
        });
        self.tell_until(HostMessage::Arm, |host| host.nonce.is_some());
        let nonce = self.nonce.unwrap();
        self.tell(HostMessage::ArmConfirm { nonce });
        self.wait_for(DriveState::Armed);
    }

    fn wait_for(&mut self, drive: DriveState) {
        let started = Instant::now();
        while self.drive() != Some(drive) {
            assert!(started.elapsed().as_secs() < 10, "still {:?}", self.state);
            std::thread::sleep(Duration::from_millis(1));
            self.read();
        }
    }

    /// One command each millisecond until `done`, at most 20 s.
    fn command_until(&mut self, torque: [i16; 3], done: impl Fn(&Self) -> bool) {
        let started = Instant::now();
        let mut deadline = rt::now_ns();
        while !done(self) {
            assert!(started.elapsed().as_secs() < 20, "still {:?}", self.state);
            self.seq = self.seq.wrapping_add(1).max(1);
            self.tell(HostMessage::Command(CommandFrame {
                seq: self.seq,
                state_seq: self.state.map_or(0, |state| state.seq),
                torque,
                enable: true,
            }));
            deadline += PERIOD_NS;
            rt::sleep_until(deadline);
            self.read();
        }
    }
}

/// The truth file's rows by device time in ms: (drive, motors on, torque N·mm, x, segment).
fn truth_rows(path: &Path) -> BTreeMap<u64, (String, bool, f64, f64, i32)> {
    let text = std::fs::read_to_string(path).unwrap();
    let rows = text.lines().skip(1).map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |n: usize| cells[n].parse::<f64>().unwrap();
        let torque = (7..10).map(|n| number(n).powi(2)).sum::<f64>().sqrt();
        let micros: u64 = cells[0].parse().unwrap();
        let row = (
            cells[5].to_owned(),
            cells[6] == "1",
            torque,
            number(2),
            cells[13].parse().unwrap(),
        );
        (micros / 1000, row)
    });
    rows.collect()
}

fn spawn(args: FakeArgs, stop: &Arc<AtomicBool>) -> JoinHandle<anyhow::Result<()>> {
    let stop = Arc::clone(stop);
    std::thread::Builder::new()
        .name("fake-omni".to_owned())
        .spawn(move || serve(&args, &stop, &mut std::io::sink()).map(drop))
        .unwrap()
}

const STROKE: &str = r#"{"segments": [{"name": "out", "goal_mm": [0, -60, -60],
    "axis": [0, 0, 1], "speed_mm_s": 60, "max_push_n": 2, "timeout_s": 5, "press": 1}]}"#;

#[test]
fn a_session_over_the_pty_from_hello_to_trip_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let stroke = dir.path().join("stroke.json");
    std::fs::write(&stroke, STROKE).unwrap();
    let args = FakeArgs {
        link: Some(dir.path().join("link")),
        stroke: Some(stroke),
        truth: Some(dir.path().join("truth.csv")),
        seconds: Some(60.0),
        fault: Vec::new(),
        hold: Hold::default(),
        seed: 5,
        die_with_parent: false,
    };
    let stop = Arc::new(AtomicBool::new(false));
    let device = spawn(args.clone(), &stop);
    let mut host = Host::open(&args.link_path());
    host.session();
    assert!(host.state.is_some_and(|s| s.switches & switch::DOCKED != 0));

    // The hand takes the stylus out, and a torque on the waist bends its spring.
    host.command_until([0; 3], |host| {
        host.state.is_some_and(|s| s.switches & switch::DOCKED == 0)
    });
    host.command_until([400, 0, 0], |host| {
        host.state
            .is_some_and(|s| s.applied == [400, 0, 0] && s.time_micros > 2_500_000)
    });
    host.port.write_all(b"\x05noise\x00").unwrap();
    // Silence.
    host.wait_for(DriveState::Tripped);
    let errors = host.state.map(|s| s.crc_errors);
    assert_eq!(errors, Some(1));
    host.command_until([400, 0, 0], |host| host.drive() == Some(DriveState::Active));
    host.command_until([400, 0, 0], |host| {
        host.state.is_some_and(|s| s.applied == [400, 0, 0])
    });
    host.tell(HostMessage::Disarm);
    host.wait_for(DriveState::Homed);
    assert_eq!(host.bad, 0, "the device's frames came damaged");

    stop.store(true, Ordering::Relaxed);
    device.join().unwrap().unwrap();
    assert!(std::fs::symlink_metadata(args.link_path()).is_err());
    check_truth(&truth_rows(args.truth.as_deref().unwrap()));
}

fn check_truth(rows: &BTreeMap<u64, (String, bool, f64, f64, i32)>) {
    let millis: Vec<u64> = rows.keys().copied().collect();
    assert!(millis.windows(2).all(|w| w[1] == w[0] + 1), "missing lines");
    assert_eq!(millis[0], 1);
    // 400 counts are 86 N·mm; 86 N·mm on the hand's 0.4 N/mm are millimetres to the left.
    let strongest = rows.values().map(|r| r.2).fold(0.0, f64::max);
    assert!((strongest - 86.0).abs() < 1.0, "{strongest} N·mm");
    let leftmost = rows.values().map(|r| r.3).fold(0.0, f64::min);
    assert!(leftmost < -1.0, "x = {leftmost} mm");
    // A machine that starves the host may trip the drive once more: each trip must hold.
    let changes = rows.iter().zip(rows.values().skip(1));
    let trips: Vec<u64> = changes
        .filter(|((_, before), after)| before.0 != "tripped" && after.0 == "tripped")
        .map(|((ms, _), _)| ms + 1)
        .collect();
    assert!(!trips.is_empty());
    let mut held = 0.0_f64;
    for trip in trips {
        // Silence: held from 3 ms on, ramped down by 19 ms, nothing from 20 ms on.
        for ms in trip - 17..trip {
            assert_eq!(
                (rows[&ms].0.as_str(), rows[&ms].1),
                ("hold", true),
                "{ms}, {trip}"
            );
        }
        let first = rows[&(trip - 17)].2;
        held = held.max(first);
        assert!(rows[&(trip - 16)].2 > first - 1.0 && rows[&(trip - 1)].2 <= 0.2 * first);
        for (ms, row) in rows.range(trip..trip + 50) {
            assert_eq!((row.2, row.1), (0.0, false), "{ms} ms, trip at {trip}");
        }
        let back = rows.range(trip..).find(|(_, r)| r.0 == "active");
        assert!(back.is_some_and(|(ms, _)| *ms >= trip + 50));
    }
    assert!(held > 80.0, "{held} N·mm held at most");
    let last = rows.values().last().unwrap();
    assert_eq!((last.0.as_str(), last.2, last.1), ("homed", 0.0, false));
}

#[test]
fn a_host_that_does_not_read_costs_frames_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let args = FakeArgs {
        link: Some(dir.path().join("link")),
        stroke: None,
        truth: Some(dir.path().join("truth.csv")),
        seconds: Some(1.5),
        fault: Vec::new(),
        hold: Hold::default(),
        seed: 6,
        die_with_parent: false,
    };
    let device = spawn(args.clone(), &Arc::new(AtomicBool::new(false)));
    let host = Host::open(&args.link_path());
    device.join().unwrap().unwrap();
    // 1500 frames of 49 bytes do not fit the cable; the device's time went on all the same.
    let rows = truth_rows(args.truth.as_deref().unwrap());
    assert_eq!(rows.len(), 1500);
    assert!(rows.values().all(|r| r.2 == 0.0 && r.4 == -1));
    drop(host);
}

#[test]
fn the_haptics_process_link_drives_it_and_a_second_host_takes_over() {
    use crate::link::{DeviceLink as _, OpenLink};
    let dir = tempfile::tempdir().unwrap();
    let stroke = dir.path().join("stroke.json");
    std::fs::write(&stroke, STROKE).unwrap();
    let args = FakeArgs {
        link: Some(dir.path().join("link")),
        stroke: Some(stroke),
        truth: Some(dir.path().join("truth.csv")),
        seconds: Some(60.0),
        fault: Vec::new(),
        hold: Hold::default(),
        seed: 8,
        die_with_parent: false,
    };
    let stop = Arc::new(AtomicBool::new(false));
    let device = spawn(args.clone(), &stop);
    drop(Host::open(&args.link_path()));
    for round in 0..2 {
        let mut link = OpenLink::open(args.link_path().to_str().unwrap()).unwrap();
        assert_eq!(link.info().serial, "8");
        link.prepare().unwrap();
        let mut newest = None;
        let mut deadline = rt::now_ns();
        for seq in 1..=400 {
            newest = link.poll().unwrap().or(newest);
            let command = CommandFrame {
                seq,
                state_seq: newest.map_or(0, |s: StateFrame| s.seq),
                torque: [100, 0, 0],
                enable: true,
            };
            link.send(&command).unwrap();
            deadline += PERIOD_NS;
            rt::sleep_until(deadline);
        }
        let state = newest.unwrap();
        assert!(state.ack > 300, "round {round}: {state:?}");
        assert_eq!(state.crc_errors, 0, "round {round}");
        assert_eq!(link.stats().crc_errors, 0, "round {round}");
    }
    std::thread::sleep(Duration::from_millis(100));
    stop.store(true, Ordering::Relaxed);
    device.join().unwrap().unwrap();
    let rows = truth_rows(args.truth.as_deref().unwrap());
    let strongest = rows.values().map(|r| r.2).fold(0.0, f64::max);
    assert!((strongest - 21.5).abs() < 0.1, "{strongest} N·mm");
    // The second host finds the stylus out of its dock, but homed: it needs no dock.
    assert!(rows.values().last().unwrap().2.abs() < 1e-9);
}
