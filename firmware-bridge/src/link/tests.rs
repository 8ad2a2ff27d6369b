//! The link against a scripted peer at the other end of a real pseudo-terminal.

mod conformance;
mod start;
mod stream;

use super::{DeviceLink as _, OpenLink};
use osteon_protocol::device::{
    CommandFrame, DEVICE_SCHEMA, DEVICE_VERSION, DeviceHello, DeviceMessage, DriveState,
    HostMessage, StateFrame, switch,
};
use osteon_protocol::frame::{self, FrameReader, MAX_FRAME};
use rustix::fs::{Mode, OFlags};
use rustix::pty::OpenptFlags;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const HELLO: DeviceHello = DeviceHello {
    version: DEVICE_VERSION,
    schema: DEVICE_SCHEMA,
    model: 1,
    serial: 42,
    counts_per_rev: 15_000,
    gimbal_counts_per_rev: 16_384,
    dac_max: 2047,
    micro_nm_per_count: 215,
    period_micros: 1000,
};

fn state(seq: u16, drive: DriveState) -> StateFrame {
    StateFrame {
        seq,
        time_micros: u32::from(seq) * 1000,
        encoders: [i32::from(seq), -2, 3],
        gimbal: [4, -5, 6],
        switches: switch::DOCKED,
        drive,
        faults: 0,
        applied: [0; 3],
        temperature: [25; 3],
        ack: 0,
        crc_errors: 0,
        refused: 0,
        trips: 0,
    }
}

fn framed(message: &DeviceMessage) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    frame::encode(message, &mut out).unwrap().to_vec()
}

/// The master side of a pseudo-terminal. It keeps the slave open itself, so that a host that
/// leaves causes no hang-up here.
struct Master {
    fd: OwnedFd,
    path: String,
    _slave: OwnedFd,
}

impl Master {
    fn new() -> Self {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let fd = rustix::pty::openpt(flags).unwrap();
        rustix::pty::grantpt(&fd).unwrap();
        rustix::pty::unlockpt(&fd).unwrap();
        rustix::fs::fcntl_setfl(&fd, OFlags::NONBLOCK).unwrap();
        let path = rustix::pty::ptsname(&fd, Vec::new()).unwrap();
        let path = path.into_string().unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let slave = rustix::fs::open(path.as_str(), flags, Mode::empty()).unwrap();
        let mut raw = rustix::termios::tcgetattr(&slave).unwrap();
        raw.make_raw();
        let now = rustix::termios::OptionalActions::Now;
        rustix::termios::tcsetattr(&slave, now, &raw).unwrap();
        Self {
            fd,
            path,
            _slave: slave,
        }
    }

    fn write(&self, bytes: &[u8]) {
        let written = rustix::io::write(&self.fd, bytes).unwrap();
        assert_eq!(written, bytes.len(), "the test's own cable is full");
    }

    fn send(&self, message: &DeviceMessage) {
        self.write(&framed(message));
    }

    fn read(&self) -> Vec<u8> {
        let mut buffer = [0; 4096];
        match rustix::io::read(&self.fd, &mut buffer) {
            Ok(count) => buffer[..count].to_vec(),
            Err(rustix::io::Errno::AGAIN) => Vec::new(),
            Err(errno) => panic!("master: {errno}"),
        }
    }
}

/// A thread that plays a device by a script until it is dropped.
struct Peer {
    path: String,
    stop: Arc<AtomicBool>,
    heard: Receiver<HostMessage>,
    thread: Option<JoinHandle<Master>>,
}

/// What the script does in each millisecond with what it heard.
type Script = Box<dyn FnMut(&Master, &[HostMessage]) + Send>;

impl Peer {
    fn start(mut script: Script) -> Self {
        let master = Master::new();
        let path = master.path.clone();
        let stop = Arc::new(AtomicBool::new(false));
        let (say, heard) = sync_channel(100_000);
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("scripted device".into())
            .spawn(move || {
                let mut reader = FrameReader::new();
                while !stopped.load(Ordering::Relaxed) {
                    let messages = hear(&master, &mut reader, &say);
                    script(&master, &messages);
                    std::thread::sleep(Duration::from_millis(1));
                }
                // Nothing that was sent before the end is lost to the test.
                hear(&master, &mut reader, &say);
                master
            })
            .unwrap();
        Self {
            path,
            stop,
            heard,
            thread: Some(thread),
        }
    }

    /// Ends the script and gives the master side and all that was heard.
    fn end(mut self) -> (Master, Vec<HostMessage>) {
        self.stop.store(true, Ordering::Relaxed);
        let master = self.thread.take().unwrap().join().unwrap();
        (master, self.heard.try_iter().collect())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn hear(
    master: &Master,
    reader: &mut FrameReader,
    say: &SyncSender<HostMessage>,
) -> Vec<HostMessage> {
    let bytes = master.read();
    let messages: Vec<HostMessage> = bytes
        .iter()
        .filter_map(|byte| reader.push(*byte))
        .map(|outcome| outcome.expect("the host sends whole frames only"))
        .collect();
    for message in &messages {
        say.try_send(*message).unwrap();
    }
    messages
}

/// A well-behaved device that begins in `drive`.
fn device(mut drive: DriveState, switches: u8) -> Script {
    let mut seq = 65_500_u16;
    let mut boot_left = 20;
    Box::new(move |master, messages| {
        for message in messages {
            drive = match (*message, drive) {
                (HostMessage::HelloRequest { .. }, _) => {
                    master.send(&DeviceMessage::Hello(HELLO));
                    drive
                }
                (HostMessage::Home, DriveState::Unhomed) | (HostMessage::Disarm, _) => {
                    DriveState::Homed
                }
                (HostMessage::Arm, DriveState::Homed) => {
                    master.send(&DeviceMessage::Challenge { nonce: 0xDEAD_BEEF });
                    drive
                }
                (HostMessage::ArmConfirm { nonce: 0xDEAD_BEEF }, _) => DriveState::Armed,
                (HostMessage::Command(_), DriveState::Armed) => DriveState::Active,
                _ => drive,
            };
        }
        if drive == DriveState::Boot {
            boot_left -= 1;
            if boot_left == 0 {
                drive = DriveState::Unhomed;
            }
        }
        seq = seq.wrapping_add(1);
        let mut frame = state(seq, drive);
        frame.switches = switches;
        master.send(&DeviceMessage::State(frame));
    })
}

/// Answers the hello and then says nothing of itself.
fn polite() -> Script {
    Box::new(|master, messages| {
        let asked = |m: &HostMessage| matches!(m, HostMessage::HelloRequest { .. });
        if messages.iter().any(asked) {
            master.send(&DeviceMessage::Hello(HELLO));
        }
    })
}

/// A link and the master side behind it, past the hello.
fn linked() -> (OpenLink, Master) {
    let peer = Peer::start(polite());
    let link = OpenLink::open(&peer.path).unwrap();
    let (master, _) = peer.end();
    (link, master)
}

fn poll_until(link: &mut OpenLink, seq: u16) -> StateFrame {
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(5) {
        if let Some(state) = link.poll().unwrap() {
            assert_eq!(state.seq, seq);
            return state;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("state {seq} never came: {:?}", link.stats());
}

fn command(seq: u16) -> CommandFrame {
    CommandFrame {
        seq,
        state_seq: 7,
        torque: [100, -200, 300],
        enable: true,
    }
}
