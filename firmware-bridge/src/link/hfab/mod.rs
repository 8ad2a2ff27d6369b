//! Open Phantom-class controllers (hfab): text lines on a serial port, one answer for each command.
//!
//! The format has no checksum, no sequence number and no arming, and its firmware keeps the last current
//! for 100 ms when the host falls silent. So here: one command under way at a time (the firmware refuses
//! two), a strict reader, counts that no arm can make are refused, and the way out sends zeros until one is
//! answered. What a killed host leaves behind is the firmware's 100 ms: the limits of `WIRE.md` (hold 5 ms,
//! zero at 20 ms) do not hold for these devices, and no program on the host can change that.

mod source;

use super::cable::Cable as _;
use super::error::hex;
use super::open::BAUD;
use super::order::Order;
use super::port::SerialPort;
use super::relay::Relay;
use super::{Clocks, DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use osteon_protocol::device::{CommandFrame, StateFrame};
use osteon_protocol::frame::FrameReader;
use osteon_protocol::hfab::{HfabState, LineReader, MAX_LINE, error, write_line};
use osteon_sim_core::arm::{Phantom, VINTAGE, WOODEN};
use rustix::io::Errno;
use source::{Flight, HfabSource};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest wait for the first answer.
const ANSWER: Duration = Duration::from_secs(2);
/// An answer that has not come by then is lost: the next command may go, ns.
const LOST_NS: u64 = 5_000_000;
/// Pause between two tries at the start and at the end.
const PAUSE: Duration = Duration::from_millis(2);
/// Tries to have a zero answered at the end: 20 ms.
const ZERO_TRIES: u32 = 10;
/// A session begins in the home pose, where the calibration button sets counts to zero: so far from it
/// an arm is taken for uncalibrated, counts.
const HOME_COUNTS: i32 = 400;

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
    order: Order,
    torque: bool,
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
        let source = HfabSource::new((&name, &port, &flight), (first.model, arm));
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
            order: Order::default(),
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

impl DeviceLink for HfabLink {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// The start sends nothing but zeros.
    fn look(&mut self) -> Result<String, LinkError> {
        self.prepare().map(|()| "in its home pose".to_owned())
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
        if !self.order.admits(command) || !self.may_send() || !self.transmit(command)? {
            self.dropped_commands += 1;
        }
        Ok(())
    }

    fn disarm(&mut self) {
        // a port that is gone, or a device that does not answer: its own watchdog has it in 100 ms
        let _answered = self.zero();
    }

    fn stats(&self) -> LinkStats {
        let direct = self.source.as_ref().map(|s| s.counts());
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
