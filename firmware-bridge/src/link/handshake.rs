//! The start of a session on the device link: hello, home, arm.
//!
//! Runs before the servo loop begins, so it may wait; every wait has an end and its own error.

use super::error::hex;
use super::inbox::Arrivals;
use super::open::{OpenLink, drive_name};
use super::{DeviceInfo, LinkError};
use osteon_protocol::device::{
    DEVICE_SCHEMA, DEVICE_VERSION, DeviceHello, DriveState, HostMessage, StateFrame, fault, switch,
};
use osteon_protocol::hfab::LineReader;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest wait for an answer.
const ANSWER: Duration = Duration::from_secs(2);
/// Longest wait for the end of the device's self-test.
const BOOT: Duration = Duration::from_secs(10);
/// A request without an answer is repeated so often.
const REPEAT: Duration = Duration::from_millis(100);
/// Pause between two looks at the cable.
const LOOK: Duration = Duration::from_millis(1);
/// Bytes of a foreign protocol that an error message shows.
const SHOWN_BYTES: usize = 16;
/// The one kinematic model that this program knows.
const OMNI_MODEL: u16 = 1;

impl OpenLink {
    /// Asks who is there until an answer comes, and checks it.
    pub(super) fn shake_hands(&mut self) -> Result<(), LinkError> {
        let request = HostMessage::HelloRequest {
            version: DEVICE_VERSION,
            schema: DEVICE_SCHEMA,
        };
        let mut asked: Option<Instant> = None;
        let mut seen = Seen::default();
        let began = Instant::now();
        while began.elapsed() < ANSWER {
            if asked.is_none_or(|at| at.elapsed() >= REPEAT) {
                self.transmit(request)?;
                asked = Some(Instant::now());
            }
            let arrivals = self.receive()?;
            seen.note(&arrivals, self.input(arrivals.bytes));
            if let Some((version, schema)) = arrivals.foreign_hello {
                return self.check_version(version, schema);
            }
            if let Some(hello) = arrivals.hello {
                self.check_version(hello.version, hello.schema)?;
                if hello.model != OMNI_MODEL {
                    return Err(LinkError::UnknownModel {
                        link: Arc::clone(&self.name),
                        model: hello.model.into(),
                        known: "model 1 (Omni-class arm)",
                    });
                }
                check_numbers(&hello).map_err(|what| LinkError::BadHello {
                    link: Arc::clone(&self.name),
                    what,
                })?;
                self.info = DeviceInfo::omni(&hello);
                self.reset_stats();
                return Ok(());
            }
            std::thread::sleep(LOOK);
        }
        Err(self.no_answer(&seen))
    }

    fn check_version(&self, version: u16, schema: u32) -> Result<(), LinkError> {
        let link = Arc::clone(&self.name);
        if version != DEVICE_VERSION {
            return Err(LinkError::Version {
                link,
                device: version,
                host: DEVICE_VERSION,
            });
        }
        if schema != DEVICE_SCHEMA {
            return Err(LinkError::Schema {
                link,
                device: schema,
                host: DEVICE_SCHEMA,
            });
        }
        Ok(())
    }

    fn no_answer(&self, seen: &Seen) -> LinkError {
        let link = Arc::clone(&self.name);
        if seen.valid > 0 {
            return LinkError::NoHello { link };
        }
        if seen.count == 0 {
            return LinkError::Silent {
                link,
                seconds: ANSWER.as_secs(),
            };
        }
        let first_bytes = seen.hex();
        if seen.hfab_lines > 0 {
            let instead = link.replacen("open:", "hfab:", 1);
            let speaks = "the text protocol of hfab controllers";
            return LinkError::WrongKind {
                link,
                speaks,
                instead,
            };
        }
        if seen.text * 10 < seen.all * 9 {
            return LinkError::WrongBaud { link, first_bytes };
        }
        LinkError::Foreign { link, first_bytes }
    }

    /// Brings the drive to Armed: waits for the end of the self-test, ends what an earlier session
    /// left, homes (the stylus must be in its dock) and arms in two steps. Commands follow within
    /// a second, or the device disarms itself.
    pub(super) fn home_and_arm(&mut self) -> Result<(), LinkError> {
        let boot_over = |state: &StateFrame| state.drive != DriveState::Boot;
        self.wait_for("stream", ANSWER, None, |_| true)?;
        let mut state = self.wait_for("finish its self-test", BOOT, None, boot_over)?;
        if !matches!(state.drive, DriveState::Unhomed | DriveState::Homed) {
            let motors_off =
                |s: &StateFrame| matches!(s.drive, DriveState::Unhomed | DriveState::Homed);
            let disarm = Some(HostMessage::Disarm);
            state = self.wait_for("disarm", ANSWER, disarm, motors_off)?;
        }
        if state.drive == DriveState::Unhomed {
            if state.switches & switch::DOCKED == 0 {
                return Err(LinkError::NotDocked {
                    link: Arc::clone(&self.name),
                });
            }
            let homed = |s: &StateFrame| s.drive == DriveState::Homed;
            self.wait_for("home", ANSWER, Some(HostMessage::Home), homed)?;
        }
        self.arm()?;
        self.armed = true;
        Ok(())
    }

    /// Waits until a state satisfies `done`, repeating `request`.
    fn wait_for(
        &mut self,
        step: &'static str,
        limit: Duration,
        request: Option<HostMessage>,
        done: impl Fn(&StateFrame) -> bool,
    ) -> Result<StateFrame, LinkError> {
        let began = Instant::now();
        let mut asked: Option<Instant> = None;
        let mut last = None;
        while began.elapsed() < limit {
            let arrivals = self.receive()?;
            if let Some(state) = arrivals.state {
                last = Some(state);
                if done(&state) {
                    return Ok(state);
                }
            }
            if asked.is_none_or(|at| at.elapsed() >= REPEAT) {
                if let Some(request) = request {
                    self.transmit(request)?;
                }
                asked = Some(Instant::now());
            }
            std::thread::sleep(LOOK);
        }
        Err(self.stuck(step, last.as_ref(), limit))
    }

    /// Arm, take the nonce, give it back, see the drive Armed. A lost message begins it anew with
    /// a new nonce.
    fn arm(&mut self) -> Result<(), LinkError> {
        let began = Instant::now();
        let mut asked: Option<Instant> = None;
        let mut last = None;
        while began.elapsed() < ANSWER {
            if asked.is_none_or(|at| at.elapsed() >= REPEAT) {
                self.transmit(HostMessage::Arm)?;
                asked = Some(Instant::now());
            }
            let arrivals = self.receive()?;
            if let Some(nonce) = arrivals.nonce {
                self.transmit(HostMessage::ArmConfirm { nonce })?;
            }
            last = arrivals.state.or(last);
            if last.is_some_and(|state| state.drive == DriveState::Armed) {
                return Ok(());
            }
            std::thread::sleep(LOOK);
        }
        Err(self.stuck("arm", last.as_ref(), ANSWER))
    }

    fn stuck(&self, step: &'static str, last: Option<&StateFrame>, limit: Duration) -> LinkError {
        let link = Arc::clone(&self.name);
        match last {
            None => LinkError::Silent {
                link,
                seconds: limit.as_secs(),
            },
            Some(state)
                if state.drive == DriveState::Fault && state.faults & fault::E_STOP != 0 =>
            {
                LinkError::EStop { link }
            }
            Some(state) if state.drive == DriveState::Fault => LinkError::Fault {
                link,
                faults: fault_names(state.faults),
            },
            Some(state) => LinkError::Stuck {
                link,
                state: drive_name(state.drive).to_owned(),
                step,
            },
        }
    }
}

/// What came before an answer, for the error message when none comes.
#[derive(Debug, Default)]
struct Seen {
    first: [u8; SHOWN_BYTES],
    // bytes of `first` that are set; in 0..=SHOWN_BYTES
    count: usize,
    valid: u32,
    // bytes in all, and those that a text has
    all: u64,
    text: u64,
    hfab: LineReader<8>,
    hfab_lines: u32,
}

impl Seen {
    fn note(&mut self, arrivals: &Arrivals, bytes: &[u8]) {
        self.valid = self.valid.saturating_add(arrivals.valid);
        for &byte in bytes {
            if let Some(slot) = self.first.get_mut(self.count) {
                *slot = byte;
                self.count += 1;
            }
            self.all += 1;
            let text = byte.is_ascii_graphic() || byte.is_ascii_whitespace();
            self.text += u64::from(text);
            let line = self.hfab.push(byte);
            self.hfab_lines += u32::from(matches!(line, Some(Ok(_))));
        }
    }

    fn hex(&self) -> String {
        hex(&self.first[..self.count])
    }
}

/// Refuses numbers that the host would divide by or trust: names the field and its value.
fn check_numbers(hello: &DeviceHello) -> Result<(), String> {
    let fields = [
        (
            hello.counts_per_rev > 0,
            "counts_per_rev",
            u64::from(hello.counts_per_rev),
        ),
        (
            hello.gimbal_counts_per_rev > 0,
            "gimbal_counts_per_rev",
            u64::from(hello.gimbal_counts_per_rev),
        ),
        (
            hello.dac_max > 0,
            "dac_max",
            u64::from(hello.dac_max.unsigned_abs()),
        ),
        (
            hello.micro_nm_per_count > 0,
            "micro_nm_per_count",
            u64::from(hello.micro_nm_per_count),
        ),
        (
            (100..=10_000).contains(&hello.period_micros),
            "period_micros",
            u64::from(hello.period_micros),
        ),
    ];
    match fields.iter().find(|(usable, ..)| !usable) {
        Some((_, field, value)) => Err(format!("{field} ({value})")),
        None => Ok(()),
    }
}

pub(super) fn fault_names(faults: u16) -> String {
    let names: Vec<_> = [
        (fault::OVER_TEMPERATURE, "motor too hot"),
        (fault::E_STOP, "emergency stop open"),
        (fault::TORQUE_LIMIT, "torque above the limit"),
        (fault::SLEW_LIMIT, "torque slewed"),
        (fault::JOINT_LIMIT, "joint at its stop"),
        (fault::SELF_TEST, "self-test failed"),
        (fault::WATCHDOG, "commands missing"),
    ]
    .into_iter()
    .filter(|(bit, _)| faults & bit != 0)
    .map(|(_, name)| name)
    .collect();
    if names.is_empty() {
        format!("unknown (bits {faults:04x})")
    } else {
        names.join(", ")
    }
}
