//! Every kind of link against a device of its own, through the same behaviours.
//!
//! Logic alone: real time is the system's, so what must happen may take a while, but must happen, and what
//! must not happen never may. The limits in milliseconds are asserted in lockstep ([`crate::bench`]).
//! Where no HID device is, its reports run over a socket of packets. Torques are compared with the plant's own, by numbers that stand in `rigs.rs` and not in the link.

mod rigs;

use crate::link::{DeviceLink, LinkError};
use crate::rt::{now_ns, sleep_until};
use osteon_protocol::device::{CommandFrame, DriveState, StateFrame};
use rigs::Rig;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

const MS: u64 = 1_000_000;
/// A torque that is there, and one that is none, as shares of the commanded one.
const THERE: std::ops::Range<f64> = 0.97..1.03;
const NONE: f64 = 1e-3;

/// One device at a time: two cores have no room for two loops.
fn one_at_a_time() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A host that does as the servo thread does, without a servo.
struct Host {
    link: Box<dyn DeviceLink>,
    seq: u16,
    newest: Option<StateFrame>,
    states: u32,
}

impl Host {
    /// Opens, prepares, starts: what every link must be able to do.
    fn start(rig: &dyn Rig) -> Self {
        let mut link = rig.open().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(link.describe(), rig.name());
        let scale = link.info().scale;
        assert!(scale.dac_max > 0 && scale.counts_per_rev > 0 && scale.nmm_per_count > 0.0);
        assert!(!link.info().model.is_empty() && link.info().period_micros > 0);
        link.prepare().unwrap_or_else(|e| panic!("{e}"));
        link.start().unwrap_or_else(|e| panic!("{e}"));
        Self {
            link,
            seq: 0,
            newest: None,
            states: 0,
        }
    }

    fn command(&mut self, torque: [i16; 3]) -> CommandFrame {
        self.seq += 1;
        CommandFrame {
            seq: self.seq,
            state_seq: self.newest.map_or(0, |s| s.seq),
            torque,
            enable: true,
        }
    }

    fn look(&mut self) -> Result<(), LinkError> {
        if let Some(state) = self.link.poll()? {
            self.newest = Some(state);
            self.states += 1;
        }
        Ok(())
    }

    /// One command a millisecond.
    fn drive(&mut self, torque: [i16; 3], ms: u64) -> Result<(), LinkError> {
        let mut deadline = now_ns();
        for _ in 0..ms {
            deadline = (deadline + MS).max(now_ns());
            sleep_until(deadline);
            self.look()?;
            let command = self.command(torque);
            self.link.send(&command)?;
        }
        Ok(())
    }

    /// Drives until `done`, at most 10 s.
    fn until(&mut self, what: &str, torque: [i16; 3], done: impl Fn(&Self) -> bool) {
        let began = Instant::now();
        while !done(self) {
            assert!(began.elapsed().as_secs() < 10, "{what}: {:?}", self.newest);
            self.drive(torque, 1).unwrap_or_else(|e| panic!("{e}"));
        }
    }
}

fn refusal<T>(outcome: Result<T, LinkError>) -> LinkError {
    outcome.err().expect("a refusal")
}

/// Share of the expected torque that the plant shows, by the worst joint.
fn share(shown: [f64; 3], expected: [f64; 3]) -> f64 {
    let shares = (0..3).map(|n| shown[n] / expected[n]);
    shares
        .max_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs()))
        .unwrap()
}

fn is_zero(shown: [f64; 3], expected: [f64; 3]) -> bool {
    (0..3).all(|n| (shown[n] / expected[n]).abs() < NONE)
}

/// Waits until the plant shows no torque, and sees that it stays so.
fn goes_to_zero(rig: &dyn Rig, what: &str, expected: [f64; 3]) {
    let began = Instant::now();
    while !is_zero(rig.torque(), expected) {
        assert!(began.elapsed().as_secs() < 10, "{what}: {:?}", rig.torque());
        std::thread::sleep(Duration::from_millis(5));
    }
    for _ in 0..15 {
        std::thread::sleep(Duration::from_millis(10));
        assert!(is_zero(rig.torque(), expected), "{what}: it came back");
    }
}

/// A session from its start to a second one, on any kind.
fn conform(rig: &mut dyn Rig) {
    let _turn = one_at_a_time();
    let (torque, expected) = (rig.command(), rig.expected());
    let mut host = Host::start(rig);

    samples_arrive(&mut host);

    host.until("a command takes effect on the plant", torque, |_| {
        THERE.contains(&share(rig.torque(), expected))
    });
    host.until("it is acknowledged, and told as applied", torque, |host| {
        let told = |s: StateFrame| s.applied == torque && host.seq.wrapping_sub(s.ack) < 200;
        host.newest.is_some_and(told)
    });

    stale_commands_have_no_effect(&mut host, rig);

    // the host falls silent, hears on
    let silent = Instant::now();
    while silent.elapsed() < Duration::from_millis(300) {
        host.look().unwrap_or_else(|e| panic!("{e}"));
        std::thread::sleep(Duration::from_millis(1));
    }
    goes_to_zero(rig, "silence", expected);
    host.until("the force comes back after a silence", torque, |_| {
        THERE.contains(&share(rig.torque(), expected))
    });

    drop(host);
    goes_to_zero(rig, "close", expected);
    rig.home();
    let mut again = Host::start(rig);
    again.until("a second session", torque, |_| {
        THERE.contains(&share(rig.torque(), expected))
    });
    again.link.disarm();
    goes_to_zero(rig, "disarm", expected);
}

fn samples_arrive(host: &mut Host) {
    host.drive([0; 3], 50).unwrap_or_else(|e| panic!("{e}"));
    let (before, states) = (host.newest, host.states);
    host.until("samples arrive", [0; 3], |host| host.states >= states + 100);
    let (before, after) = (before.unwrap(), host.newest.unwrap());
    assert!(osteon_protocol::frame::is_newer(after.seq, before.seq));
    assert_ne!(after.time_micros, before.time_micros);
    assert_eq!(after.applied, [0; 3]);
    assert!(
        matches!(after.drive, DriveState::Active | DriveState::Hold),
        "{after:?}"
    );
    let stats = host.link.stats();
    assert!(stats.frames >= 100, "{stats:?}");
    assert_eq!((stats.crc_errors, stats.stale), (0, 0), "{stats:?}");
    // a wait ends with a sample, or at its deadline
    let began = now_ns();
    host.link.wait(began + 2_000 * MS);
    let woke = now_ns() - began;
    assert!(woke < 1_500 * MS, "{woke} ns");
}

/// Each good command is followed by an old one that wants the opposite.
fn stale_commands_have_no_effect(host: &mut Host, rig: &dyn Rig) {
    let (torque, expected) = (rig.command(), rig.expected());
    let opposite = torque.map(|t| -t);
    let mark = rig.mark();
    let never = |shown: [f64; 3]| {
        assert!((0..3).all(|n| shown[n] / expected[n] > -NONE), "{shown:?}");
    };
    for _ in 0..200 {
        host.drive(torque, 1).unwrap_or_else(|e| panic!("{e}"));
        let old = CommandFrame {
            seq: host.seq - 1,
            ..host.command(opposite)
        };
        host.seq -= 1;
        host.link.send(&old).unwrap_or_else(|e| panic!("{e}"));
        never(rig.torque());
    }
    std::thread::sleep(Duration::from_millis(100));
    rig.since(mark).into_iter().for_each(never);
    host.until("it goes on", torque, |_| {
        THERE.contains(&share(rig.torque(), expected))
    });
}

/// The cable breaks under load: the error has a name, the plant no torque, and a new link works.
fn survives_a_pulled_plug(rig: &mut dyn Rig) {
    let _turn = one_at_a_time();
    let (torque, expected) = (rig.command(), rig.expected());
    let mut host = Host::start(rig);
    host.until("the force is there", torque, |_| {
        THERE.contains(&share(rig.torque(), expected))
    });
    rig.unplug();
    let began = Instant::now();
    let error = loop {
        assert!(began.elapsed().as_secs() < 10, "nobody noticed");
        if let Err(error) = host.drive(torque, 1) {
            break error;
        }
    };
    rig.is_the_error(&error);
    let line = error.to_string();
    assert!(
        line.starts_with(&format!("device {}: ", rig.name())),
        "{line}"
    );
    assert!(!line.contains('\n') && line.contains("; "), "{line}");
    goes_to_zero(rig, "a pulled plug", expected);
    drop(host);
    rig.plug_in();
    rig.home();
    let mut again = Host::start(rig);
    again.until("the force after the plug is back", torque, |_| {
        THERE.contains(&share(rig.torque(), expected))
    });
}

macro_rules! kinds {
    ($($kind:ident: $behaviour:ident, $rig:expr;)*) => {$(
        #[test]
        fn $kind() {
            $behaviour(&mut $rig);
        }
    )*};
}

kinds! {
    open_conforms: conform, rigs::Fake::open();
    open_unplugged: survives_a_pulled_plug, rigs::Fake::open().unplugged_later();
    packet_conforms: conform, rigs::Fake::packet();
    packet_unplugged: survives_a_pulled_plug, rigs::Fake::packet().unplugged_later();
    hfab_vintage_conforms: conform, rigs::Fake::hfab(2);
    hfab_wooden_conforms: conform, rigs::Fake::hfab(3);
    hfab_unplugged: survives_a_pulled_plug, rigs::Fake::hfab(3).unplugged_later();
    openhaptics_conforms: conform, rigs::Mock::new();
    openhaptics_unplugged: survives_a_pulled_plug, rigs::Mock::new();
    // a simulated device in the process has no plug
    sim_conforms: conform, rigs::Sim::default();
}

/// What a device is not ready for is refused with its own error, and a remedy.
#[test]
fn refusals_have_their_names() {
    let _turn = one_at_a_time();
    let refused = |rig: &dyn Rig| refusal(rig.open().and_then(|mut link| link.prepare()));
    for rig in [rigs::Fake::open(), rigs::Fake::packet()] {
        let first = Host::start(&rig);
        let error = refusal(rig.open());
        assert!(matches!(error, LinkError::Busy { .. }), "{error}");
        drop(first);
        rig.restart(&["e-stop@0"]);
        std::thread::sleep(Duration::from_millis(300));
        assert!(matches!(refused(&rig), LinkError::EStop { .. }));
        rig.restart(&["self-test@0"]);
        std::thread::sleep(Duration::from_millis(300));
        let error = refused(&rig);
        assert!(matches!(error, LinkError::Fault { .. }), "{error}");
    }
    // an arm that was moved out of its home pose
    let mut rig = rigs::Fake::hfab(3);
    let mut host = Host::start(&rig);
    host.drive([100, 0, 0], 500).unwrap();
    let error = refusal(rig.open());
    assert!(matches!(error, LinkError::Busy { .. }), "{error}");
    drop(host);
    let error = refused(&rig);
    assert!(matches!(error, LinkError::Uncalibrated { .. }), "{error}");
    rig.home();
    drop(Host::start(&rig));
    // protocols that were taken for each other
    let open_as_hfab = refusal(rig.open_as("open:"));
    assert!(
        matches!(open_as_hfab, LinkError::WrongKind { .. }),
        "{open_as_hfab}"
    );
    let hfab_as_open = refusal(rigs::Fake::open().open_as("hfab:"));
    assert!(
        matches!(hfab_as_open, LinkError::WrongKind { .. }),
        "{hfab_as_open}"
    );
    let mock = rigs::Mock::new();
    rigs::Mock::needs_a_hand();
    let error = refused(&mock);
    assert!(matches!(error, LinkError::Uncalibrated { .. }), "{error}");
    let nothing = crate::link::hid_found();
    let missing = "hid:f055:0001".parse().unwrap();
    let error = refusal(crate::link::open(&missing));
    assert!(
        matches!(error, LinkError::NoHid { .. }),
        "{error}, {nothing:?}"
    );
}
