//! Open Phantom-class controllers (hfab): text lines on a serial port, one answer for each command.
//!
//! The format has no checksum, no sequence number and no arming, and its firmware keeps the last current
//! for 100 ms when the host falls silent. So here: one command under way at a time (the firmware refuses
//! two), a strict reader, counts that no arm can make are refused, and the way out sends zeros until one is
//! answered. What a killed host leaves behind is the firmware's 100 ms: the limits of `WIRE.md` (hold 5 ms,
//! zero at 20 ms) do not hold for these devices, and no program on the host can change that.

use super::cable::Cable as _;
use super::open::BAUD;
use super::port::SerialPort;
use super::relay::{Relay, Source};
use super::{Clocks, DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use osteon_protocol::device::{CommandFrame, DriveState, StateFrame};
use osteon_protocol::frame::FrameReader;
use osteon_protocol::hfab::{HfabState, LineReader, MAX_LINE, error, write_line};
use osteon_sim_core::arm::{Phantom, VINTAGE, WOODEN};
use rustix::io::Errno;
use std::fmt::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Longest wait for the first answer.
const ANSWER: Duration = Duration::from_secs(2);
/// An answer that has not come by then is lost: the next command may go, ns.
const LOST_NS: u64 = 5_000_000;
/// Pause between two tries at the start and at the end.
const PAUSE: Duration = Duration::from_millis(2);
/// Tries to have a zero answered at the end: 20 ms.
const ZERO_TRIES: u32 = 10;
/// Most bytes that one look takes: a second of lines is less.
const LOOK_BYTES: usize = 4096;
/// A session begins in the home pose, where the calibration button sets counts to zero: so far from it
/// an arm is taken for uncalibrated, counts.
const HOME_COUNTS: i32 = 400;
/// A joint at 10 rad/s is faster than any hand: the largest step of a joint, rad/s.
const FASTEST_RAD_S: f64 = 10.0;
/// Steps that are too large in a row, after which the new place is believed.
const BELIEVE_AFTER: u32 = 5;
/// No encoder of these arms can count further: one and a half turns of its joint.
const MOST_TURNS: f64 = 1.5;

/// A device behind an hfab controller.
#[derive(Debug)]
pub struct HfabLink {
    name: Arc<str>,
    info: DeviceInfo,
    port: Arc<SerialPort>,
    flight: Arc<Flight>,
    source: Option<Box<HfabSource>>,
    relay: Option<Relay>,
    sent_ns: u64,
    dropped_commands: u64,
    torque: bool,
}

/// The command under way, shared by who sends and who hears: 0 = none, else its number and currents.
#[derive(Debug, Default)]
struct Flight(AtomicU64);

impl Flight {
    fn is_free(&self) -> bool {
        self.0.load(Ordering::Acquire) == 0
    }

    fn take_off(&self, command: CommandFrame) {
        let [a, b, c] = command.torque.map(|t| u64::from(t.cast_unsigned()));
        let word = u64::from(command.seq.max(1)) | a << 16 | b << 32 | c << 48;
        self.0.store(word, Ordering::Release);
    }

    /// Number and currents of the command that has landed.
    fn land(&self) -> (u16, [i16; 3]) {
        let word = self.0.swap(0, Ordering::AcqRel);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "one of four words of 16 bits"
        )]
        let part = |n: u32| (word >> (16 * n)) as u16;
        (part(0), [1, 2, 3].map(|n| part(n).cast_signed()))
    }
}

/// Makes states out of lines.
#[derive(Debug)]
struct HfabSource {
    name: Arc<str>,
    port: Arc<SerialPort>,
    flight: Arc<Flight>,
    reader: LineReader<8>,
    input: [u8; LOOK_BYTES],
    arm: &'static Phantom,
    model: i32,
    seq: u16,
    ack: u16,
    applied: [i16; 3],
    refused: u8,
    last: Option<([i32; 3], u64)>,
    wild: u32,
    stats: LinkStats,
}

/// The arm of a model number.
fn arm_of(model: i32) -> Option<&'static Phantom> {
    match model {
        2 => Some(&VINTAGE),
        3 => Some(&WOODEN),
        _ => None,
    }
}

impl HfabLink {
    /// Opens the port, wakes the device with zeros and learns its model. Takes at most 2 s.
    pub fn open(path: &str, name: Arc<str>) -> Result<Self, LinkError> {
        let port = Arc::new(SerialPort::open(path, BAUD, &name)?);
        let first = wake(&port, &name)?;
        let Some(arm) = arm_of(first.model) else {
            return Err(LinkError::UnknownModel {
                link: name,
                model: first.model,
                known: "2 (vintage Phantom) and 3 (WoodenHaptics); model 1 (Polhem) has another linkage",
            });
        };
        let flight = Arc::new(Flight::default());
        let source = HfabSource {
            name: Arc::clone(&name),
            port: Arc::clone(&port),
            flight: Arc::clone(&flight),
            reader: LineReader::new(),
            input: [0; LOOK_BYTES],
            arm,
            model: first.model,
            seq: 0,
            ack: 0,
            applied: [0; 3],
            refused: 0,
            last: None,
            wild: 0,
            stats: LinkStats::default(),
        };
        Ok(Self {
            name,
            info: DeviceInfo {
                model: arm.name.to_owned(),
                serial: String::new(),
                firmware: format!("hfab model {}", first.model),
                scale: arm.scale(),
                period_micros: 1000,
            },
            port,
            flight,
            source: Some(Box::new(source)),
            relay: None,
            sent_ns: 0,
            dropped_commands: 0,
            torque: false,
        })
    }

    fn gone(&self, errno: Errno) -> LinkError {
        LinkError::Gone {
            link: Arc::clone(&self.name),
            errno,
        }
    }

    /// Sends a line of currents; false = the cable is full.
    fn transmit(&mut self, command: CommandFrame) -> Result<bool, LinkError> {
        let mut line = [0; MAX_LINE];
        let line = write_line(&command.torque.map(i32::from), &mut line);
        self.flight.take_off(command);
        self.sent_ns = now_ns();
        // a line of 24 bytes at most is taken whole or not at all, or the device refuses the torn one
        let sent = self.port.write(line).map_err(|e| self.gone(e))?;
        if sent == 0 {
            self.flight.land();
        }
        Ok(sent == line.len())
    }

    /// The cable is free, or the answer to the last command is lost.
    fn may_send(&self) -> bool {
        self.flight.is_free() || now_ns().saturating_sub(self.sent_ns) > LOST_NS
    }

    /// Sends zeros until one is answered, 20 ms at most.
    fn zero(&mut self) -> Result<(), LinkError> {
        let mut sent = false;
        for _ in 0..ZERO_TRIES {
            if self.may_send() {
                sent |= self.transmit(STILL)?;
            }
            std::thread::sleep(PAUSE);
            if let Some(source) = &mut self.source {
                source.hear()?;
            }
            if sent && self.flight.is_free() {
                break;
            }
        }
        self.torque = false;
        Ok(())
    }
}

/// A command of no current.
const STILL: CommandFrame = CommandFrame {
    seq: 1,
    state_seq: 0,
    torque: [0; 3],
    enable: false,
};

/// Sends zeros until lines come back.
fn wake(port: &SerialPort, name: &Arc<str>) -> Result<HfabState, LinkError> {
    let gone = |errno| LinkError::Gone {
        link: Arc::clone(name),
        errno,
    };
    let mut reader = LineReader::<8>::new();
    let mut frames = FrameReader::new();
    let (mut shown, mut open_frames) = (Vec::new(), 0);
    let mut line = [0; MAX_LINE];
    let zeros = write_line(&[0; 3], &mut line);
    let began = Instant::now();
    let mut asked: Option<Instant> = None;
    while began.elapsed() < ANSWER {
        if asked.is_none_or(|at| at.elapsed() > Duration::from_millis(50)) {
            port.write(zeros).map_err(gone)?;
            asked = Some(Instant::now());
        }
        let mut input = [0; 1024];
        let count = port.read(&mut input).map_err(gone)?;
        shown.extend(
            input[..count]
                .iter()
                .copied()
                .take(16 - shown.len().min(16)),
        );
        for &byte in &input[..count] {
            open_frames += u32::from(matches!(frames.push_raw(byte), Some(Ok(_))));
            // an answer to a half-eaten command names the error, and comes again without it
            if let Some(Ok(numbers)) = reader.push(byte) {
                let state = HfabState::new(numbers);
                if state.error & error::REFUSED == 0 {
                    return Ok(state);
                }
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let link = Arc::clone(name);
    Err(match (open_frames, shown.is_empty()) {
        (1.., _) => LinkError::WrongKind {
            speaks: "Osteon's open protocol",
            instead: link.replacen("hfab:", "open:", 1),
            link,
        },
        (0, true) => LinkError::Silent {
            link,
            seconds: ANSWER.as_secs(),
        },
        (0, false) => LinkError::Foreign {
            link,
            first_bytes: hex(&shown),
        },
    })
}

fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for (n, byte) in bytes.iter().enumerate() {
        let space = if n == 0 { "" } else { " " };
        // Writing to a string cannot fail.
        write!(text, "{space}{byte:02x}").unwrap_or_default();
    }
    text
}

impl HfabSource {
    /// Takes the lines that have come; the newest believed state.
    fn hear(&mut self) -> Result<Option<StateFrame>, LinkError> {
        let count = self
            .port
            .read(&mut self.input)
            .map_err(|errno| LinkError::Gone {
                link: Arc::clone(&self.name),
                errno,
            })?;
        let mut newest = None;
        for n in 0..count {
            match self.reader.push(self.input[n]) {
                None => {}
                Some(Err(_)) => self.stats.crc_errors += 1,
                Some(Ok(numbers)) => {
                    newest = self.believe(&HfabState::new(numbers)).or(newest);
                }
            }
        }
        Ok(newest)
    }

    fn believe(&mut self, line: &HfabState) -> Option<StateFrame> {
        let (seq, currents) = self.flight.land();
        if line.error & error::REFUSED != 0 {
            // the device did not read its encoders for this answer, and flows on with the old current
            self.refused = self.refused.wrapping_add(1);
            return None;
        }
        if !self.is_plausible(line) {
            self.stats.crc_errors += 1;
            return None;
        }
        if seq != 0 {
            (self.ack, self.applied) = (seq, currents);
        }
        self.seq = self.seq.wrapping_add(1);
        self.stats.frames += 1;
        Some(self.state(line))
    }

    /// What no arm can say is a damaged line: another model, a count beyond the stops, a joint faster
    /// than any hand.
    fn is_plausible(&mut self, line: &HfabState) -> bool {
        let [e0, e1, e2, ..] = line.encoders;
        let (counts, now) = ([e0, e1, e2], now_ns());
        let per_rev = f64::from(self.arm.counts_per_rev);
        let within = |n: usize| {
            let turns = f64::from(counts[n]) / per_rev / self.arm.gear[n];
            turns.abs() < MOST_TURNS
        };
        if line.model != self.model || !(0..3).all(within) {
            return false;
        }
        if let Some((before, then)) = self.last {
            let seconds = (now.saturating_sub(then) as f64 * 1e-9).max(1e-3);
            let most = |n: usize| {
                FASTEST_RAD_S * seconds / core::f64::consts::TAU * per_rev * self.arm.gear[n].abs()
                    + 2.0
            };
            let step = |n: usize| (f64::from(counts[n]) - f64::from(before[n])).abs();
            if (0..3).any(|n| step(n) > most(n)) && self.wild < BELIEVE_AFTER {
                self.wild += 1;
                return false;
            }
        }
        self.wild = 0;
        self.last = Some((counts, now));
        true
    }

    fn state(&self, line: &HfabState) -> StateFrame {
        let [e0, e1, e2, g0, g1, g2] = line.encoders;
        let turn = i32::from(self.arm.gimbal_counts_per_rev);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "within one turn of at most 65,535 counts"
        )]
        let gimbal = [g0, g1, g2].map(|g| ((g + turn / 2).rem_euclid(turn) - turn / 2) as i16);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "microseconds wrap by design"
        )]
        let time_micros = (now_ns() / 1000) as u32;
        StateFrame {
            seq: self.seq,
            time_micros,
            encoders: [e0, e1, e2],
            gimbal,
            switches: 0,
            drive: DriveState::Active,
            faults: 0,
            applied: self.applied,
            temperature: [0; 3],
            ack: self.ack,
            crc_errors: 0,
            refused: self.refused,
            trips: 0,
        }
    }
}

impl Source for HfabSource {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn wait(&self, limit: Duration) {
        self.port.wait(limit);
    }

    fn newest(&mut self) -> Result<Option<StateFrame>, LinkError> {
        self.hear()
    }

    fn stats(&self) -> LinkStats {
        self.stats
    }
}

impl DeviceLink for HfabLink {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn prepare(&mut self) -> Result<(), LinkError> {
        let began = Instant::now();
        while began.elapsed() < ANSWER {
            self.transmit(STILL)?;
            std::thread::sleep(PAUSE);
            let Some(source) = &mut self.source else {
                return Ok(());
            };
            if let Some(state) = source.hear()? {
                if state.encoders.iter().any(|n| n.abs() > HOME_COUNTS) {
                    return Err(LinkError::Uncalibrated {
                        link: Arc::clone(&self.name),
                        remedy: "hold the arm in its home pose, press its calibration button and start again"
                            .to_owned(),
                    });
                }
                return Ok(());
            }
        }
        Err(LinkError::Silent {
            link: Arc::clone(&self.name),
            seconds: ANSWER.as_secs(),
        })
    }

    fn start(&mut self) -> Result<(), LinkError> {
        if let Some(source) = self.source.take() {
            self.relay = Some(Relay::start(*source)?);
        }
        Ok(())
    }

    fn wait(&mut self, deadline_ns: u64) {
        if let Some(relay) = &mut self.relay {
            relay.wait(deadline_ns);
        } else {
            let left = deadline_ns.saturating_sub(now_ns());
            self.port.wait(Duration::from_nanos(left));
        }
    }

    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        match (&mut self.relay, &mut self.source) {
            (Some(relay), _) => relay.poll(),
            (None, Some(source)) => source.hear(),
            (None, None) => Ok(None),
        }
    }

    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        let most = self.info.scale.dac_max;
        let within = command.torque.map(|t| t.clamp(-most, most));
        let torque = if command.enable { within } else { [0; 3] };
        self.torque |= torque != [0; 3];
        let command = CommandFrame { torque, ..*command };
        if !self.may_send() || !self.transmit(command)? {
            self.dropped_commands += 1;
        }
        Ok(())
    }

    fn disarm(&mut self) {
        // a port that is gone, or a device that does not answer: its own watchdog has it in 100 ms
        let _answered = self.zero();
    }

    fn stats(&self) -> LinkStats {
        let direct = self.source.as_ref().map(|s| s.stats);
        let heard = self.relay.as_ref().map(Relay::stats).or(direct);
        LinkStats {
            dropped_commands: self.dropped_commands,
            ..heard.unwrap_or_default()
        }
    }

    fn describe(&self) -> String {
        self.name.to_string()
    }

    fn clock(&self) -> Clocks {
        Clocks::HostOnly
    }
}

impl Drop for HfabLink {
    fn drop(&mut self) {
        if self.torque {
            self.disarm();
        }
    }
}
