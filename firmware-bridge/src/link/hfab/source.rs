//! What the lines of the device say, as far as it can be believed.

use super::super::cable::Cable as _;
use super::super::relay::Source;
use super::super::{LinkError, LinkStats};
use super::SerialPort;
use crate::rt::now_ns;
use osteon_protocol::device::{CommandFrame, DriveState, StateFrame};
use osteon_protocol::hfab::{HfabState, LineReader, error};
use osteon_sim_core::arm::Phantom;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Most bytes that one look takes: a second of lines is less.
const LOOK_BYTES: usize = 4096;
/// A joint at 10 rad/s is faster than any hand: the largest step of a joint, rad/s.
const FASTEST_RAD_S: f64 = 10.0;
/// Steps that are too large in a row, after which the new place is believed.
const BELIEVE_AFTER: u32 = 5;
/// No encoder of these arms can count further: one and a half turns of its joint.
const MOST_TURNS: f64 = 1.5;

/// The command under way, shared by who sends and who hears: 0 = none, else its number and currents.
#[derive(Debug, Default)]
pub(super) struct Flight(AtomicU64);

impl Flight {
    pub(super) fn is_free(&self) -> bool {
        self.0.load(Ordering::Acquire) == 0
    }

    pub(super) fn take_off(&self, command: CommandFrame) {
        let [a, b, c] = command.torque.map(|t| u64::from(t.cast_unsigned()));
        let word = u64::from(command.seq.max(1)) | a << 16 | b << 32 | c << 48;
        self.0.store(word, Ordering::Release);
    }

    /// Number and currents of the command that has landed.
    pub(super) fn land(&self) -> (u16, [i16; 3]) {
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
pub(super) struct HfabSource {
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

impl HfabSource {
    /// Hears the device of this model behind `port`.
    pub(super) fn new(
        (name, port, flight): (&Arc<str>, &Arc<SerialPort>, &Arc<Flight>),
        (model, arm): (i32, &'static Phantom),
    ) -> Self {
        Self {
            name: Arc::clone(name),
            port: Arc::clone(port),
            flight: Arc::clone(flight),
            reader: LineReader::new(),
            input: [0; LOOK_BYTES],
            arm,
            model,
            seq: 0,
            ack: 0,
            applied: [0; 3],
            refused: 0,
            last: None,
            wild: 0,
            stats: LinkStats::default(),
        }
    }

    /// Counters.
    pub(super) fn counts(&self) -> LinkStats {
        self.stats
    }

    /// Takes the lines that have come; the newest believed state.
    pub(super) fn hear(&mut self) -> Result<Option<StateFrame>, LinkError> {
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
