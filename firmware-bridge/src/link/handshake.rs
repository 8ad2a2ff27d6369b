//! The start of a session on the device link: hello, home, arm.
//!
//! Runs before the servo loop begins, so it may wait; every wait has an end and its own error. The steps
//! ([`Greeting`], [`Arming`]) know no clock and no cable: a link drives them in real time, the lockstep bench
//! on its own clock.

use super::error::hex;
use super::inbox::Arrivals;
use super::open::{OpenLink, drive_name};
use super::{DeviceInfo, LinkError};
use crate::rt::now_ns;
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

/// What to do next at the start of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step<T> {
    /// Look again.
    Wait,
    /// Send this.
    Tell(HostMessage),
    /// It is done.
    Done(T),
}

/// A request that is repeated until it is answered, and the time since its stage began. Times are ns of any
/// clock.
#[derive(Debug, Clone, Copy, Default)]
struct Patience {
    began: Option<u64>,
    asked: Option<u64>,
}

impl Patience {
    fn is_over(&mut self, now: u64, limit: Duration) -> bool {
        let began = *self.began.get_or_insert(now);
        u128::from(now.saturating_sub(began)) >= limit.as_nanos()
    }

    /// Whether to ask (again).
    fn ask(&mut self, now: u64) -> bool {
        let since = |at| u128::from(now.saturating_sub(at));
        let due = self.asked.is_none_or(|at| since(at) >= REPEAT.as_nanos());
        if due {
            self.asked = Some(now);
        }
        due
    }
}

/// The first half: who is there?
#[derive(Debug)]
pub(crate) struct Greeting {
    link: Arc<str>,
    patience: Patience,
    seen: Seen,
}

impl Greeting {
    pub(crate) fn new(link: Arc<str>) -> Self {
        Self {
            link,
            patience: Patience::default(),
            seen: Seen::default(),
        }
    }

    /// One look: `arrivals` were sorted out of `bytes`.
    pub(crate) fn step(
        &mut self,
        now: u64,
        arrivals: &Arrivals,
        bytes: &[u8],
    ) -> Result<Step<DeviceHello>, LinkError> {
        self.seen.note(arrivals, bytes);
        let link = || Arc::clone(&self.link);
        if let Some((version, schema)) = arrivals.foreign_hello {
            check_version(link(), version, schema)?;
        }
        if let Some(hello) = arrivals.hello {
            check_version(link(), hello.version, hello.schema)?;
            if hello.model != OMNI_MODEL {
                return Err(LinkError::UnknownModel {
                    link: link(),
                    model: hello.model.into(),
                    known: "model 1 (Omni-class arm)",
                });
            }
            check_numbers(&hello).map_err(|what| LinkError::BadHello { link: link(), what })?;
            return Ok(Step::Done(hello));
        }
        if self.patience.is_over(now, ANSWER) {
            return Err(self.seen.no_answer(link()));
        }
        Ok(if self.patience.ask(now) {
            Step::Tell(HostMessage::HelloRequest {
                version: DEVICE_VERSION,
                schema: DEVICE_SCHEMA,
            })
        } else {
            Step::Wait
        })
    }
}

/// Where the second half stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Stream,
    Boot,
    Disarm,
    Home,
    Arm,
}

/// The second half: waits for the end of the self-test, ends what an earlier session left, homes (the stylus
/// must be in its dock) and arms in two steps. Commands follow within a second, or the device disarms
/// itself.
#[derive(Debug)]
pub(crate) struct Arming {
    link: Arc<str>,
    stage: Stage,
    patience: Patience,
    last: Option<StateFrame>,
}

impl Arming {
    pub(crate) fn new(link: Arc<str>) -> Self {
        Self {
            link,
            stage: Stage::Stream,
            patience: Patience::default(),
            last: None,
        }
    }

    /// One look; done when the drive is armed.
    pub(crate) fn step(&mut self, now: u64, arrivals: &Arrivals) -> Result<Step<()>, LinkError> {
        if let Some(state) = arrivals.state {
            self.last = Some(state);
            if self.advance(&state)? {
                return Ok(Step::Done(()));
            }
        }
        if let (Stage::Arm, Some(nonce)) = (self.stage, arrivals.nonce) {
            return Ok(Step::Tell(HostMessage::ArmConfirm { nonce }));
        }
        let (request, what, limit) = match self.stage {
            Stage::Stream => (None, "stream", ANSWER),
            Stage::Boot => (None, "finish its self-test", BOOT),
            Stage::Disarm => (Some(HostMessage::Disarm), "disarm", ANSWER),
            Stage::Home => (Some(HostMessage::Home), "home", ANSWER),
            // a lost message begins it anew with a new nonce
            Stage::Arm => (Some(HostMessage::Arm), "arm", ANSWER),
        };
        if self.patience.is_over(now, limit) {
            return Err(self.stuck(what, limit));
        }
        Ok(match request {
            Some(request) if self.patience.ask(now) => Step::Tell(request),
            _ => Step::Wait,
        })
    }

    /// Takes the stages that `state` ends; true where it was the last.
    fn advance(&mut self, state: &StateFrame) -> Result<bool, LinkError> {
        use DriveState::{Armed, Boot, Homed, Unhomed};
        loop {
            let next = match (self.stage, state.drive) {
                (Stage::Stream, _) => Stage::Boot,
                (Stage::Boot | Stage::Disarm | Stage::Home, Homed) => Stage::Arm,
                (Stage::Boot | Stage::Disarm, Unhomed) => {
                    if state.switches & switch::DOCKED == 0 {
                        return Err(LinkError::NotDocked {
                            link: Arc::clone(&self.link),
                        });
                    }
                    Stage::Home
                }
                (Stage::Boot, drive) if drive != Boot => Stage::Disarm,
                (Stage::Arm, Armed) => return Ok(true),
                _ => return Ok(false),
            };
            (self.stage, self.patience) = (next, Patience::default());
        }
    }

    fn stuck(&self, step: &'static str, limit: Duration) -> LinkError {
        let link = Arc::clone(&self.link);
        match &self.last {
            None => LinkError::Silent {
                link,
                seconds: limit.as_secs(),
            },
            Some(state) => fault_of(state, &link).unwrap_or_else(|| LinkError::Stuck {
                link,
                state: drive_name(state.drive).to_owned(),
                step,
            }),
        }
    }
}

/// The error of a drive that stands in a fault.
pub(super) fn fault_of(state: &StateFrame, link: &Arc<str>) -> Option<LinkError> {
    let link = Arc::clone(link);
    match state.drive {
        DriveState::Fault if state.faults & fault::E_STOP != 0 => Some(LinkError::EStop { link }),
        DriveState::Fault => Some(LinkError::Fault {
            link,
            faults: fault_names(state.faults),
        }),
        _ => None,
    }
}

fn check_version(link: Arc<str>, version: u16, schema: u32) -> Result<(), LinkError> {
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

impl OpenLink {
    /// Asks who is there until an answer comes, and checks it.
    pub(super) fn shake_hands(&mut self) -> Result<(), LinkError> {
        let mut greeting = Greeting::new(Arc::clone(&self.name));
        loop {
            let arrivals = self.receive()?;
            match greeting.step(now_ns(), &arrivals, self.input(arrivals.bytes))? {
                Step::Tell(request) => {
                    self.transmit(request)?;
                }
                Step::Wait => std::thread::sleep(LOOK),
                Step::Done(hello) => {
                    self.info = DeviceInfo::omni(&hello);
                    self.reset_stats();
                    return Ok(());
                }
            }
        }
    }

    /// Brings the drive to Armed.
    pub(super) fn home_and_arm(&mut self) -> Result<(), LinkError> {
        let mut arming = Arming::new(Arc::clone(&self.name));
        loop {
            let arrivals = self.receive()?;
            match arming.step(now_ns(), &arrivals)? {
                Step::Tell(message) => {
                    self.transmit(message)?;
                }
                Step::Wait => std::thread::sleep(LOOK),
                Step::Done(()) => {
                    self.armed = true;
                    return Ok(());
                }
            }
        }
    }

    /// In which state the drive is, without a change of it; what keeps it from a session is an error.
    pub(super) fn look_at_drive(&mut self) -> Result<String, LinkError> {
        let began = Instant::now();
        let mut last = None;
        while began.elapsed() < BOOT && last.is_none_or(|s: StateFrame| s.drive == DriveState::Boot)
        {
            last = self.receive()?.state.or(last);
            if last.is_none() && began.elapsed() >= ANSWER {
                break;
            }
            std::thread::sleep(LOOK);
        }
        let link = || Arc::clone(&self.name);
        let Some(state) = last else {
            return Err(LinkError::Silent {
                link: link(),
                seconds: ANSWER.as_secs(),
            });
        };
        let docked = state.switches & switch::DOCKED != 0;
        match fault_of(&state, &self.name) {
            Some(error) => Err(error),
            None if state.drive == DriveState::Unhomed && !docked => {
                Err(LinkError::NotDocked { link: link() })
            }
            None => Ok(format!(
                "{}, {}",
                drive_name(state.drive),
                if docked {
                    "in its dock"
                } else {
                    "out of its dock"
                }
            )),
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

    fn no_answer(&self, link: Arc<str>) -> LinkError {
        if self.valid > 0 {
            return LinkError::NoHello { link };
        }
        if self.count == 0 {
            return LinkError::Silent {
                link,
                seconds: ANSWER.as_secs(),
            };
        }
        let first_bytes = hex(&self.first[..self.count]);
        if self.hfab_lines > 0 {
            let instead = link.replacen("open:", "hfab:", 1);
            let speaks = "the text protocol of hfab controllers";
            return LinkError::WrongKind {
                link,
                speaks,
                instead,
            };
        }
        if self.text * 10 < self.all * 9 {
            return LinkError::WrongBaud { link, first_bytes };
        }
        LinkError::Foreign { link, first_bytes }
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
