//! Counters and latency quantiles of a session, kept by the publisher.

use super::loads::Loads;
use super::record::TickRecord;
use crate::fake::truth::drive_name;
use hdrhistogram::Histogram;
use osteon_protocol::device::DriveState;
use osteon_protocol::ipc::{GuardCount, Health};
use osteon_sim_core::chain::{Guard, GuardCounts};
use osteon_sim_core::tool::Tool;
use serde::Serialize;

/// A tick is late when it starts more than this after its deadline, ns.
pub const LATE_NS: u64 = 500_000;

/// Quantiles of a latency, µs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99 %.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

/// Values from 1 ns to 60 s with three significant digits; anything longer counts as 60 s.
#[derive(Debug)]
pub(crate) struct Latency {
    histogram: Option<Histogram<u64>>,
}

const LONGEST_NS: u64 = 60_000_000_000;

impl Latency {
    fn new() -> Self {
        Self {
            histogram: Histogram::new_with_bounds(1, LONGEST_NS, 3).ok(),
        }
    }

    fn record(&mut self, ns: u64) {
        if let Some(h) = &mut self.histogram {
            h.saturating_record(ns.clamp(1, LONGEST_NS));
        }
    }

    pub(crate) fn quantiles(&self) -> Quantiles {
        let Some(h) = self.histogram.as_ref().filter(|h| !h.is_empty()) else {
            return Quantiles::default();
        };
        let micros = |ns: u64| ns as f64 * 1e-3;
        Quantiles {
            p50: micros(h.value_at_quantile(0.5)),
            p99: micros(h.value_at_quantile(0.99)),
            p999: micros(h.value_at_quantile(0.999)),
            max: micros(h.max()),
        }
    }
}

/// Everything counted over a session.
#[derive(Debug)]
pub(crate) struct Stats {
    pub ticks: u64,
    pub late_ticks: u64,
    pub late_per_second: Vec<u64>,
    pub skipped_periods: u64,
    pub wake: Latency,
    pub tick: Latency,
    pub read: Latency,
    pub compute: Latency,
    pub roundtrip: Latency,
    pub loads: Loads,
    pub samples_used: u64,
    pub last: Option<TickRecord>,
    // of each tool without a load
    rpm: Vec<f64>,
    // watchdog trips at the first state, so that earlier sessions do not count
    first_trips: Option<u8>,
}

impl Stats {
    pub(crate) fn new(tools: &[Tool]) -> Self {
        Self {
            ticks: 0,
            late_ticks: 0,
            late_per_second: Vec::new(),
            skipped_periods: 0,
            wake: Latency::new(),
            tick: Latency::new(),
            read: Latency::new(),
            compute: Latency::new(),
            roundtrip: Latency::new(),
            loads: Loads::default(),
            rpm: tools.iter().map(|t| t.rpm).collect(),
            samples_used: 0,
            last: None,
            first_trips: None,
        }
    }

    /// Takes one tick into account. Seconds are counted in periods of the servo, skipped ones
    /// included, so that a stall shows in its own second.
    pub(crate) fn add(&mut self, tick: &TickRecord) {
        // records may have been lost to a full ring, ticks not
        self.ticks = tick.tick + 1;
        self.skipped_periods += tick.skipped;
        let second = ((self.ticks + self.skipped_periods - 1) / 1000) as usize;
        if self.late_per_second.len() <= second {
            self.late_per_second.resize(second + 1, 0);
        }
        if tick.wake_ns > LATE_NS {
            self.late_ticks += 1;
            self.late_per_second[second] += 1;
        }
        self.wake.record(tick.wake_ns);
        self.tick.record(tick.duration_ns);
        self.read.record(tick.read_ns);
        self.compute.record(tick.compute_ns);
        if let Some(ns) = tick.roundtrip_ns {
            self.roundtrip.record(ns);
        }
        self.samples_used += u64::from(tick.state.is_some());
        let rpm = self.rpm.get(usize::from(tick.tool));
        self.loads.add(tick, rpm.copied().unwrap_or(0.0));
        if tick.drive.is_some() && self.first_trips.is_none() {
            self.first_trips = Some(tick.trips);
        }
        self.last = Some(*tick);
    }

    /// Watchdog trips of the device during this session (the device counts modulo 256).
    pub(crate) fn trips(&self) -> u64 {
        let last = self.last.map_or(0, |t| t.trips);
        u64::from(last.wrapping_sub(self.first_trips.unwrap_or(last)))
    }

    /// The message for viewers.
    pub(crate) fn health(&self, link: &str) -> Health {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "microseconds for the screen"
        )]
        let four = |l: &Latency| {
            let q = l.quantiles();
            [q.p50, q.p99, q.p999, q.max].map(|v| v as f32)
        };
        let last = self.last.as_ref();
        Health {
            ticks: self.ticks,
            late_ticks: self.late_ticks,
            wake_micros: four(&self.wake),
            tick_micros: four(&self.tick),
            roundtrip_micros: four(&self.roundtrip),
            drive: last
                .and_then(|t| t.drive)
                .map_or_else(|| "no device".to_owned(), |d| drive_name(d).to_owned()),
            link: link.to_owned(),
            frames: last.map_or(0, |t| t.link.frames),
            crc_errors: last.map_or(0, |t| t.link.crc_errors),
            gaps: last.map_or(0, |t| t.link.gaps),
            watchdog_trips: self.trips(),
            guard_events: last.map_or(0, |t| t.guards.total()),
            guards: last.map(|t| guards(&t.guards)).unwrap_or_default(),
            note: last.map(note).unwrap_or_default(),
        }
    }
}

fn guards(counts: &GuardCounts) -> Vec<GuardCount> {
    let of = |guard: &Guard| GuardCount {
        name: guard.name().to_owned(),
        count: counts.of(*guard),
        last_tick: counts.last(*guard).unwrap_or(0),
    };
    Guard::ALL.iter().map(of).collect()
}

/// Why there is no force, in words for the person at the stylus.
fn note(tick: &TickRecord) -> String {
    let text = if tick.flags.paused {
        "paused: no force, no cutting"
    } else if tick.flags.clutched {
        "the clutch is held: the tool waits until it is let go"
    } else if tick.flags.embedded {
        "the tool is inside bone: pull it out to feel it again"
    } else if tick.flags.waiting {
        "bring the tool in front of the joint"
    } else {
        match tick.drive {
            Some(DriveState::Active | DriveState::Hold) => "",
            Some(DriveState::Tripped) => "the device's watchdog tripped; it re-arms by itself",
            Some(DriveState::Fault) => "the device has a fault: motors off",
            _ => "the device is not active",
        }
    };
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_planted_distribution() {
        let mut latency = Latency::new();
        for n in 1..=1000u64 {
            latency.record(n * 1000);
        }
        let q = latency.quantiles();
        for (got, truth) in [
            (q.p50, 500.0),
            (q.p99, 990.0),
            (q.p999, 999.0),
            (q.max, 1000.0),
        ] {
            assert!((got / truth - 1.0).abs() < 2e-3, "{got} {truth}");
        }
        assert_eq!(Latency::new().quantiles(), Quantiles::default());
    }
}
