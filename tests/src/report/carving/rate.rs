//! Collision rate against lag: how far the tool is inside bone that was not removed yet.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a period of 1 to 20 ms"
)]

use super::Output;
use super::lineup::{self, Kit};
use crate::measure::surface::{on_outline, solid_mm};
use crate::report::carver::Carver;
use crate::report::plot::{Plot, Point};
use crate::report::table::{Table, percent, short};
use crate::scenes::bones::{self, BuiltBone};
use crate::scenes::press;
use anyhow::Result;
use glam::DVec3;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::time::Instant;

/// Rates, Hz.
const RATES: [f64; 6] = [50.0, 100.0, 200.0, 333.0, 500.0, 1000.0];

/// Part of the reamer's surface that is taken as its face, from the apex on: up to a radius of 16 mm.
const FACE: f64 = 0.48;

/// What one rate costs and how far it lags.
struct Lag {
    worst_us: f64,
    // share of one core in the worst second
    share: f64,
    mean_um: f64,
    max_um: f64,
}

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Collision rate and lag");
    let h = if out.effort.quick { 1.2 } else { 0.47 };
    let built = bones::scapula(h, super::speed::SCALE)?;
    out.note_bone("scapula", &built);
    let kit = Kit::new(Tool::glenoid_reamer())?;
    let mut table = Table::new(
        "rate",
        "Carving at 50 to 1000 Hz",
        "The reamer pressed into the glenoid at 1, 2 and 5 mm/s; *lag*: at every millisecond of feed, the deepest point of \
         the tool's face (its rim left out) in bone that still stands (stored distances end at the band). The thesis carves at 333 Hz. Force comes from the tool's elements \
         and the material field, not from what was removed, so lag shows as bone that is drawn or felt late, not as force.",
        &[
            "rate Hz",
            "worst event µs",
            "share of a core",
            "lag mean µm",
            "lag max µm",
        ],
    );
    let mut plot = Plot::new(
        "rate",
        "Lag against the share of a core, over the collision rate",
        "From left to right 50, 100, 200, 333, 500 and 1000 Hz; one core.",
        ["share of a core, %", "largest lag, µm"],
    );
    for rate in RATES {
        let lag = lag(out, &built, &kit, rate);
        plot.series("osteon, reamer press")
            .push(Point::at(100.0 * lag.share, lag.max_um));
        table.push([
            short(Some(rate)),
            short(Some(lag.worst_us)),
            percent(Some(lag.share)),
            short(Some(lag.mean_um)),
            short(Some(lag.max_um)),
        ]);
    }
    out.plot(&plot)?;
    out.table(&table)
}

/// Carves the press with a period of 1/rate while the tool moves every millisecond.
fn lag(out: &Output, built: &BuiltBone, kit: &Kit, rate: f64) -> Lag {
    // 2.5 s of feed, after which the tool dwells
    let way = press::reamer_press().placed(&built.bone_from_plan);
    let feed = &way.poses[..2501];
    let period = (1000.0 / rate).round() as usize;
    let points = face(&kit.tool);
    let mut best: Vec<f64> = Vec::new();
    let (mut sum, mut max, mut count) = (0.0, 0.0f64, 0.0);
    let mut carvers = lineup::ours(&built.bone, kit);
    let Some(carver) = carvers.first_mut() else {
        return Lag {
            worst_us: f64::NAN,
            share: f64::NAN,
            mean_um: f64::NAN,
            max_um: f64::NAN,
        };
    };
    for replay in 0..out.effort.replays {
        carver.reset();
        let mut event = 0;
        let mut last = 0;
        for n in 1..feed.len() {
            let due = n.is_multiple_of(period);
            if due {
                let start = Instant::now();
                carver.event(&feed[last], &feed[n]);
                let us = 1e6 * start.elapsed().as_secs_f64();
                last = n;
                if replay == 0 {
                    best.push(us);
                } else {
                    best[event] = best[event].min(us);
                }
                event += 1;
            }
            // just before the next event the lag is largest
            let before = (n + 1).is_multiple_of(period);
            if replay == 0 && before && n + 1 < feed.len() {
                let deepest = deepest(carver.as_ref(), built, &feed[n + 1], &points);
                sum += deepest;
                count += 1.0;
                max = max.max(deepest);
            }
        }
    }
    Lag {
        worst_us: best.iter().copied().fold(0.0, f64::max),
        share: best.iter().sum::<f64>() * 1e-6 / ((feed.len() - 1) as f64 * 1e-3),
        mean_um: 1e3 * sum / count,
        max_um: 1e3 * max,
    }
}

/// Points of the tool's face, in its frame; its rim, where the field itself is rounded, is left out.
fn face(tool: &Tool) -> Vec<DVec3> {
    (0..200)
        .filter_map(|n| {
            let n = f64::from(n);
            on_outline(
                &tool.shape,
                FACE * (n + 0.5) / 200.0,
                (n * 0.618_033_988_75).fract(),
            )
        })
        .map(|(p, _)| p)
        .collect()
}

/// Depth of the deepest of the tool's points in bone that still stands, mm; not below 0.
fn deepest(carver: &dyn Carver, built: &BuiltBone, at: &Pose, points: &[DVec3]) -> f64 {
    points
        .iter()
        .map(|&q| {
            let p = at.point(q);
            solid_mm(&built.bone, p).min(f64::from(carver.cut_mm(p)))
        })
        .fold(0.0, f64::max)
}
