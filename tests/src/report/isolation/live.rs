//! Times of the force loop of a real session, viewer after viewer in turns.

use super::attach::{Kind, Where, attach};
use super::{IsolationArgs, Row};
use crate::{Running, stroke, until};
use anyhow::{Context as _, Result, ensure};
use osteon_firmware_bridge::haptics::isolation::Played;
use osteon_firmware_bridge::rt::now_ns;
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// A viewer's first moments are left out, ns.
const SETTLE_NS: u64 = 500_000_000;
/// The publisher writes a tick down when it comes by, so much later at most, ns.
const LAG_NS: u64 = 50_000_000;

/// Quantiles of a time, µs.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Times {
    /// Median.
    pub p50: f64,
    /// 99 %.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

impl Times {
    /// Of times in ns.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a rank within the list"
    )]
    fn of(mut ns: Vec<u64>) -> Self {
        ns.sort_unstable();
        let at = |share: f64| {
            let rank = (share * ns.len() as f64).ceil() as usize;
            let value = ns.get(rank.saturating_sub(1)).or(ns.last());
            value.map_or(0.0, |v| *v as f64 * 1e-3)
        };
        Self {
            p50: at(0.5),
            p99: at(0.99),
            p999: at(0.999),
            max: at(1.0),
        }
    }
}

/// One tick: when it was written down, its delay and duration, ns, and periods skipped before it.
type Tick = [u64; 4];

/// All ticks of the session, and who was there when.
#[derive(Debug)]
pub struct Measured {
    ticks: Vec<Tick>,
    turns: Vec<(Kind, [u64; 2])>,
}

/// Runs the session.
pub fn session(
    args: &IsolationArgs,
    osteon: &Path,
    folder: &Path,
    progress: &mut dyn FnMut(f32),
) -> Result<Measured> {
    let at = Where {
        socket: folder.join("live/haptics.sock"),
        osteon: osteon.to_owned(),
        folder: folder.to_owned(),
        inside: false,
    };
    let log = folder.join("timing.csv");
    let device = format!("sim:{}", stroke::peck(folder).display());
    let (socket, log_text) = (at.socket.display().to_string(), log.display().to_string());
    let haptics = [
        "haptics",
        "--device",
        &device,
        "--socket",
        &socket,
        "--voxel-mm",
        "1",
        "--timing-log",
        &log_text,
    ];
    let mut haptics = Running::start(&osteon.display().to_string(), &haptics, folder, "haptics");
    until("the servo", Duration::from_mins(2), || {
        std::fs::read_to_string(folder.join("haptics.out")).is_ok_and(|t| t.contains("1 kHz"))
    });
    let mut turns = Vec::new();
    let all = args.rounds * Kind::ALL.len() as u64;
    for round in 0..args.rounds {
        for (n, kind) in Kind::ALL.into_iter().enumerate() {
            let done = round * Kind::ALL.len() as u64 + n as u64;
            progress(done as f32 / all as f32);
            let viewer = attach(kind, &at)?;
            let began = now_ns() + SETTLE_NS;
            std::thread::sleep(Duration::from_nanos(SETTLE_NS) + Duration::from_secs(args.seconds));
            turns.push((kind, [began + LAG_NS, now_ns()]));
            viewer.join();
        }
    }
    haptics.signal(rustix::process::Signal::TERM);
    let ended = haptics.wait(Duration::from_secs(30));
    let errors = std::fs::read_to_string(folder.join("haptics.err")).unwrap_or_default();
    ensure!(ended.success(), "the session ended with an error: {errors}");
    let ticks = read(&log)?;
    Ok(Measured { ticks, turns })
}

fn read(log: &Path) -> Result<Vec<Tick>> {
    let text =
        std::fs::read_to_string(log).with_context(|| format!("reading {}", log.display()))?;
    let tick = |line: &str| {
        let mut cells = line.split(',').map(str::parse::<u64>);
        let mut next = || cells.next().and_then(Result::ok);
        Some([next()?, next()?, next()?, next()?])
    };
    text.lines()
        .skip(1)
        .map(|line| tick(line).with_context(|| format!("{}: '{line}'", log.display())))
        .collect()
}

impl Measured {
    fn ticks_of(&self, kind: Kind) -> Vec<Tick> {
        let turns = self.turns.iter().filter(|(k, _)| *k == kind);
        turns
            .flat_map(|(_, [from, to])| {
                let begin = self.ticks.partition_point(|t| t[0] < *from);
                let end = self.ticks.partition_point(|t| t[0] < *to);
                self.ticks[begin..end.max(begin)].iter().copied()
            })
            .collect()
    }

    fn times(&self, kind: Kind) -> (Times, Times, usize, u64) {
        let ticks = self.ticks_of(kind);
        let wake = Times::of(ticks.iter().map(|t| t[1]).collect());
        let tick = Times::of(ticks.iter().map(|t| t[2]).collect());
        (wake, tick, ticks.len(), ticks.iter().map(|t| t[3]).sum())
    }

    /// The row of a kind, with what the scripted session beside it came to.
    pub fn row(&self, kind: Kind, played: &Played) -> Row {
        let (alone_wake, alone_tick, ..) = self.times(Kind::Alone);
        let (wake_us, tick_us, ticks, skipped) = self.times(kind);
        let equal =
            !played.answers.is_empty() && played.answers.iter().all(|d| *d == played.digest);
        Row {
            viewer: kind.name(),
            ratio_tick_p999: tick_us.p999 / alone_tick.p999,
            ratio_wake_p999: wake_us.p999 / alone_wake.p999,
            wake_us,
            tick_us,
            ticks,
            skipped,
            removals_lost: 0,
            digest_equal: kind.answers().then_some(equal),
            publisher_peak_bytes: played.peak_bytes,
            publisher_bound_bytes: played.bound_bytes,
            force_bits_equal: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_planted_times() {
        let times = Times::of((1..=1000).rev().map(|n| n * 1000).collect());
        let found = [times.p50, times.p99, times.p999, times.max];
        for (found, planted) in found.into_iter().zip([500.0, 990.0, 999.0, 1000.0]) {
            assert!((found - planted).abs() < 1e-9, "{found} {planted}");
        }
    }

    #[test]
    fn ticks_go_to_the_viewer_that_was_there() {
        let measured = Measured {
            ticks: (0..100).map(|n| [n, n, 2 * n, 0]).collect(),
            turns: vec![
                (Kind::Alone, [0, 10]),
                (Kind::Healthy, [20, 30]),
                (Kind::Alone, [90, 200]),
            ],
        };
        assert_eq!(measured.ticks_of(Kind::Alone).len(), 20);
        let (wake, tick, count, _) = measured.times(Kind::Healthy);
        assert_eq!(count, 10);
        assert!((wake.max - 0.029).abs() < 1e-12 && (tick.max - 0.058).abs() < 1e-12);
    }
}
