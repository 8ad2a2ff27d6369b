//! Intrinsic time of an event: the least of several replays of the same deterministic events on one
//! core. What the machine does beside (other processes, interrupts, the hypervisor) can only add, so the
//! least is the program's own; the raw samples are kept beside it.
#![expect(
    clippy::cast_possible_truncation,
    reason = "durations of an event in nanoseconds, far below 2^64; event numbers below 2^32"
)]

use std::time::Instant;

/// Fewest replays of a report.
pub const REPLAYS: usize = 3;

/// Something that can be replayed from the same start.
pub trait Replay {
    /// Back to the start.
    fn reset(&mut self);
    /// Event number `n`; true where it changed something. Only this is timed.
    fn event(&mut self, n: usize) -> bool;
}

/// One subject's events in a run.
#[derive(Debug, Clone, Default)]
pub struct Timing {
    /// Numbers of the events that were run, ascending.
    pub events: Vec<u32>,
    /// Least time of each over the replays, ns.
    pub best_ns: Vec<u64>,
    /// Whether the event changed something, in the last replay.
    pub changed: Vec<bool>,
    /// All samples of all replays, ns.
    pub raw_ns: Vec<u64>,
}

/// Order statistics of a set of times, µs. All NaN where there is no sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiles {
    /// Samples.
    pub count: usize,
    /// Median.
    pub p50_us: f64,
    /// 99th percentile.
    pub p99_us: f64,
    /// Largest.
    pub max_us: f64,
    /// Mean: never shown alone.
    pub mean_us: f64,
}

impl Quantiles {
    /// Of samples in nanoseconds; nearest rank.
    pub fn of(samples_ns: impl Iterator<Item = u64>) -> Self {
        let mut sorted: Vec<u64> = samples_ns.collect();
        sorted.sort_unstable();
        let at = |permille: usize| {
            let rank = (sorted.len() * permille).div_ceil(1000).max(1);
            sorted
                .get(rank - 1)
                .map_or(f64::NAN, |&ns| ns as f64 * 1e-3)
        };
        let sum: u64 = sorted.iter().sum();
        Self {
            count: sorted.len(),
            p50_us: at(500),
            p99_us: at(990),
            max_us: at(1000),
            mean_us: sum as f64 * 1e-3 / sorted.len() as f64,
        }
    }
}

impl Timing {
    /// Over all events.
    pub fn all(&self) -> Quantiles {
        Quantiles::of(self.best_ns.iter().copied())
    }

    /// Over the *contact events*: those that changed something.
    pub fn contact(&self) -> Quantiles {
        let both = self.best_ns.iter().zip(&self.changed);
        Quantiles::of(both.filter(|(_, changed)| **changed).map(|(ns, _)| *ns))
    }

    /// Over all samples of all replays, the machine's noise included.
    pub fn raw(&self) -> Quantiles {
        Quantiles::of(self.raw_ns.iter().copied())
    }

    /// This mean over `other`'s, over the events that both ran; `None` without such events.
    pub fn mean_over(&self, other: &Self) -> Option<f64> {
        let (mut mine, mut theirs, mut at) = (0u64, 0u64, 0);
        for (n, event) in self.events.iter().enumerate() {
            while other.events.get(at).is_some_and(|e| e < event) {
                at += 1;
            }
            if other.events.get(at) == Some(event) {
                mine += self.best_ns[n];
                theirs += other.best_ns[at];
            }
        }
        (theirs > 0).then(|| mine as f64 / theirs as f64)
    }

    /// Takes one replay in: times, and whether each event changed something.
    fn merge(&mut self, times_ns: &[u64], changed: &[bool]) {
        self.raw_ns.extend_from_slice(times_ns);
        if self.best_ns.is_empty() {
            self.best_ns = times_ns.to_vec();
        }
        for (best, &ns) in self.best_ns.iter_mut().zip(times_ns) {
            *best = (*best).min(ns);
        }
        self.changed = changed.to_vec();
    }
}

/// A subject of a run: what is replayed, and which events.
pub struct Subject<'a> {
    /// What is replayed.
    pub replay: &'a mut dyn Replay,
    /// Events of the whole trajectory.
    pub events: usize,
    /// Every how many events one is run; 1 = all.
    pub stride: usize,
}

impl std::fmt::Debug for Subject<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "every {} of {} events", self.stride, self.events)
    }
}

/// Replays all subjects `replays` times, round robin: the same noise meets each of them. The state of
/// the last replay is left standing, so that the error of the run that was timed can be measured.
pub fn interleaved(subjects: &mut [Subject<'_>], replays: usize) -> Vec<Timing> {
    let numbers = |s: &Subject<'_>| -> Vec<u32> {
        let stride = s.stride.max(1);
        // the last event always belongs to it: the trajectory's end is reached
        (0..s.events)
            .rev()
            .step_by(stride)
            .map(|n| n as u32)
            .collect::<Vec<_>>()
            .into_iter()
            .rev()
            .collect()
    };
    let mut timings: Vec<Timing> = subjects
        .iter()
        .map(|s| Timing {
            events: numbers(s),
            ..Timing::default()
        })
        .collect();
    for _ in 0..replays.max(1) {
        for (subject, timing) in subjects.iter_mut().zip(&mut timings) {
            subject.replay.reset();
            let mut times = Vec::with_capacity(timing.events.len());
            let mut changed = Vec::with_capacity(timing.events.len());
            for &n in &timing.events {
                let start = Instant::now();
                let hit = subject.replay.event(n as usize);
                times.push(start.elapsed().as_nanos() as u64);
                changed.push(hit);
            }
            timing.merge(&times, &changed);
        }
    }
    timings
}

/// Cost of reading the clock twice, ns: the median of many. It is in every time; nothing is
/// subtracted.
pub fn timer_cost_ns() -> f64 {
    let samples = (0..10_001).map(|_| Instant::now().elapsed().as_nanos() as u64);
    Quantiles::of(samples).p50_us * 1e3
}

/// Pins this thread to the last core it may run on; which, or why not. Threads that it starts later
/// inherit it: start thread pools first.
pub fn pin() -> Result<usize, String> {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
    let allowed = sched_getaffinity(None).map_err(|e| format!("not pinned: {e}"))?;
    let core = (0..CpuSet::MAX_CPU)
        .rev()
        .find(|&core| allowed.is_set(core))
        .ok_or("not pinned: no core is allowed")?;
    let mut one = CpuSet::new();
    one.set(core);
    sched_setaffinity(None, &one).map_err(|e| format!("not pinned: {e}"))?;
    Ok(core)
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "whole microseconds")]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_ranks() {
        let q = Quantiles::of((1..=1000).map(|n| n * 1000).rev());
        assert_eq!((q.p50_us, q.p99_us, q.max_us), (500.0, 990.0, 1000.0));
        assert!((q.mean_us - 500.5).abs() < 1e-9);
        assert_eq!(Quantiles::of([7000u64].into_iter()).p99_us, 7.0);
        let none = Quantiles::of(std::iter::empty());
        assert!(none.count == 0 && none.p50_us.is_nan() && none.mean_us.is_nan());
    }

    #[test]
    fn the_least_of_planted_times_is_kept_and_the_raw_ones_beside() {
        let mut timing = Timing {
            events: vec![0, 1, 2],
            ..Timing::default()
        };
        timing.merge(&[5000, 9000, 1000], &[true, false, true]);
        timing.merge(&[6000, 2000, 1000], &[true, false, true]);
        timing.merge(&[4000, 3000, 8000], &[true, false, true]);
        assert_eq!(timing.best_ns, [4000, 2000, 1000]);
        assert_eq!(timing.raw().count, 9);
        assert_eq!(timing.raw().max_us, 9.0);
        assert_eq!(timing.contact().count, 2);
        assert_eq!(timing.contact().max_us, 4.0);
        assert_eq!(timing.all().p50_us, 2.0);
    }

    #[test]
    fn ratios_are_over_the_events_that_both_ran() {
        let of = |events: &[u32], best: &[u64]| Timing {
            events: events.to_vec(),
            best_ns: best.to_vec(),
            ..Timing::default()
        };
        let slow = of(&[1, 3, 9], &[100, 300, 700]);
        let fast = of(&[0, 1, 2, 3], &[7, 10, 7, 30]);
        assert_eq!(slow.mean_over(&fast), Some(10.0));
        assert_eq!(slow.mean_over(&of(&[2], &[5])), None);
    }

    #[test]
    fn a_coarser_stride_is_part_of_a_finer_one() {
        let mut counters = [0, 1].map(|_| Counter {
            resets: 0,
            seen: Vec::new(),
        });
        let [a, b] = &mut counters;
        let mut subjects = [(a, 8), (b, 2)].map(|(replay, stride)| Subject {
            replay,
            events: 101,
            stride,
        });
        let timings = interleaved(&mut subjects, 1);
        let fine = &timings[1].events;
        assert!(timings[0].events.iter().all(|n| fine.contains(n)));
    }

    struct Counter {
        resets: usize,
        seen: Vec<usize>,
    }

    impl Replay for Counter {
        fn reset(&mut self) {
            self.resets += 1;
            self.seen.clear();
        }
        fn event(&mut self, n: usize) -> bool {
            self.seen.push(n);
            n.is_multiple_of(2)
        }
    }

    #[test]
    fn every_replay_starts_anew_and_ends_with_the_last_event() {
        let mut counter = Counter {
            resets: 0,
            seen: Vec::new(),
        };
        let mut subjects = [Subject {
            replay: &mut counter,
            events: 10,
            stride: 4,
        }];
        let timing = interleaved(&mut subjects, 3).remove(0);
        assert_eq!(counter.resets, 3);
        assert_eq!(counter.seen, [1, 5, 9]);
        assert_eq!(timing.events, [1, 5, 9]);
        assert_eq!(timing.raw_ns.len(), 9);
    }
}
