//! How the session went: time, path, smoothness, force, overshoot, wobble.

use super::Metric;
use super::smooth::{ldlj, sparc, velocities};
use super::trace::{SessionTrace, TICK_S, TraceTick};
use crate::pose::Pose;
use crate::tissue::Tissue;
use glam::DVec3;

/// Newly removed bone below which a tick does not cut, mm³.
const CUTTING_MM3: f64 = 1e-6;
/// Soft bone removed after the plate before it counts as broken through, mm³.
const THROUGH_MM3: f64 = 1.0;
/// After a breakthrough the overshoot is looked for so long, s.
const OVERSHOOT_S: f64 = 0.5;

/// When something happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Seconds since the first tick.
    pub at_s: f64,
    /// What.
    pub what: String,
}

/// A tool that broke through the plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Breakthrough {
    /// Seconds since the first tick.
    pub at_s: f64,
    /// Way of the tip along the plan's axis after it, mm.
    pub overshoot_mm: f64,
}

/// Metrics of a session's course. `force_limit_n` is a real tool's force above which time is counted.
#[expect(clippy::too_many_lines, reason = "a list")]
pub fn metrics(trace: &SessionTrace, bone_from_plan: &Pose, force_limit_n: f64) -> Vec<Metric> {
    let ticks = &trace.ticks;
    let Some((first, last)) = ticks.first().zip(ticks.last()) else {
        return vec![Metric::missing(
            "time_total",
            "s",
            "the session has no tick",
        )];
    };
    let uses = trace.uses();
    let spindle = ticks.iter().filter(|t| t.spindle_on).count();
    let contact = ticks.iter().filter(|t| t.physical_n > 0.0).count();
    let cutting = cutting(ticks).count();
    let seconds = |count: usize| count as f64 * TICK_S;
    let mut all = vec![
        Metric::new(
            "time_total",
            trace.seconds(last.tick) + TICK_S,
            "s",
            "first tick to last",
        ),
        Metric::new(
            "time_spindle_on",
            seconds(spindle),
            "s",
            "spindle switched on",
        ),
        Metric::new(
            "time_in_contact",
            seconds(contact),
            "s",
            "a force acts on the tool",
        ),
        Metric::new(
            "time_cutting",
            seconds(cutting),
            "s",
            "bone is being removed",
        ),
        Metric::new(
            "contacts",
            contacts(ticks) as f64,
            "",
            "times that contact began",
        ),
        Metric::new(
            "removed",
            last.removed() - first.removed(),
            "mm³",
            "bone removed in all",
        ),
    ];
    all.extend(path(&uses));
    all.extend(smoothness(&uses));
    all.extend(force(ticks, force_limit_n));
    all.push(match breakthrough(trace, bone_from_plan) {
        Some(b) => Metric::new(
            "overshoot",
            b.overshoot_mm,
            "mm",
            "largest way along the plan's axis within 0.5 s after the plate was broken through",
        ),
        None => Metric::missing("overshoot", "mm", "the plate was not broken through"),
    });
    all.push(match wobble_deg(&uses) {
        Some(deg) => Metric::new(
            "wobble",
            deg,
            "°",
            "root mean square angle of the tool's axis to its mean while cutting, worst tool",
        ),
        None => Metric::missing("wobble", "°", "nothing was cut"),
    });
    all
}

/// Ticks in which bone was removed.
fn cutting(ticks: &[TraceTick]) -> impl Iterator<Item = &TraceTick> {
    ticks
        .windows(2)
        .filter(|w| w[1].removed() > w[0].removed() + CUTTING_MM3)
        .map(|w| &w[1])
}

fn contacts(ticks: &[TraceTick]) -> usize {
    let begins = |w: &&[TraceTick]| w[0].physical_n <= 0.0 && w[1].physical_n > 0.0;
    ticks.windows(2).filter(begins).count()
}

/// Length of the tip's way while tools were in use, and the share of it that a straight way would need.
fn path(uses: &[(u8, &[TraceTick])]) -> [Metric; 2] {
    let (mut way, mut straight) = (0.0, 0.0);
    for (_, ticks) in uses {
        way += ticks
            .windows(2)
            .map(|w| w[0].tip().distance(w[1].tip()))
            .sum::<f64>();
        let start = ticks.first().map_or(DVec3::ZERO, TraceTick::tip);
        let far = ticks.iter().map(|t| t.tip().distance(start));
        straight += far.fold(0.0, f64::max);
    }
    let economy = if way > 0.0 {
        Metric::new(
            "path_economy",
            straight / way,
            "",
            "straight way from first cut to farthest point over the way gone, all tools",
        )
    } else {
        Metric::missing("path_economy", "", "nothing was cut")
    };
    [
        Metric::new(
            "path_length",
            way,
            "mm",
            "way of the tip from each tool's first cut to its last",
        ),
        economy,
    ]
}

fn smoothness(uses: &[(u8, &[TraceTick])]) -> [Metric; 2] {
    let worst = |measure: fn(&[DVec3]) -> Option<f64>| {
        uses.iter()
            .filter_map(|(_, ticks)| {
                let tips: Vec<DVec3> = ticks.iter().map(TraceTick::tip).collect();
                measure(&velocities(&tips))
            })
            .reduce(f64::min)
    };
    let metric = |name, value: Option<f64>, note| match value {
        Some(v) => Metric::new(name, v, "", note),
        None => Metric::missing(name, "", "no use of a tool is long enough"),
    };
    [
        metric(
            "ldlj",
            worst(ldlj),
            "log dimensionless jerk of the tip while a tool cuts, worst tool; nearer to 0 is smoother",
        ),
        metric(
            "sparc",
            worst(sparc),
            "spectral arc length of the tip's speed while a tool cuts, worst tool; nearer to 0 is smoother",
        ),
    ]
}

/// Forces at a real tool.
fn force(ticks: &[TraceTick], limit_n: f64) -> [Metric; 4] {
    let mut forces: Vec<f64> = ticks
        .iter()
        .map(|t| t.physical_n)
        .filter(|f| *f > 0.0)
        .collect();
    forces.sort_unstable_by(f64::total_cmp);
    let sum: f64 = forces.iter().sum();
    let above = forces.len() - forces.partition_point(|f| *f <= limit_n);
    let quantile = |q: f64| {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a length"
        )]
        let at = (q * forces.len() as f64) as usize;
        forces
            .get(at.min(forces.len().saturating_sub(1)))
            .copied()
            .unwrap_or(0.0)
    };
    [
        Metric::new(
            "force_peak",
            quantile(1.0),
            "N",
            "largest force at a real tool",
        ),
        Metric::new(
            "force_p99",
            quantile(0.99),
            "N",
            "99th percentile of the force at a real tool in contact",
        ),
        Metric::new(
            "impulse",
            sum * TICK_S,
            "N·s",
            "force at a real tool times time",
        ),
        Metric::new(
            "time_over_limit",
            above as f64 * TICK_S,
            "s",
            "force at a real tool above the limit",
        ),
    ]
}

/// The first time that a tool, having cut the plate, goes on into soft bone.
pub fn breakthrough(trace: &SessionTrace, bone_from_plan: &Pose) -> Option<Breakthrough> {
    let plan_from_bone = bone_from_plan.inverse();
    let height = |t: &TraceTick| plan_from_bone.point(t.tip()).z;
    let class = |t: &TraceTick, tissue: Tissue| t.removed_mm3[tissue as usize];
    trace.uses().into_iter().find_map(|(_, ticks)| {
        let start = ticks.first()?;
        let through = |t: &TraceTick| {
            class(t, Tissue::Subchondral) > class(start, Tissue::Subchondral) + THROUGH_MM3
                && class(t, Tissue::Cancellous) > class(start, Tissue::Cancellous) + THROUGH_MM3
        };
        let at = ticks.iter().position(through)?;
        let begun = &ticks[at];
        let from = height(begun);
        let until = trace.seconds(begun.tick) + OVERSHOOT_S;
        let lowest = ticks[at..]
            .iter()
            .take_while(|t| trace.seconds(t.tick) <= until)
            .map(height)
            .fold(from, f64::min);
        Some(Breakthrough {
            at_s: trace.seconds(begun.tick),
            overshoot_mm: from - lowest,
        })
    })
}

/// Root mean square angle to the mean axis while cutting, degrees, of the worst tool.
fn wobble_deg(uses: &[(u8, &[TraceTick])]) -> Option<f64> {
    uses.iter()
        .filter_map(|(_, ticks)| {
            let axes: Vec<DVec3> = cutting(ticks).map(TraceTick::axis).collect();
            let mean = axes.iter().sum::<DVec3>().try_normalize()?;
            let angle = |a: &DVec3| libm::atan2(a.cross(mean).length(), a.dot(mean));
            let squares: f64 = axes.iter().map(|a| angle(a).powi(2)).sum();
            Some((squares / axes.len() as f64).sqrt().to_degrees())
        })
        .reduce(f64::max)
}

/// What happened when, for plots: tools taken, contact, the plate broken through.
pub fn events(trace: &SessionTrace, bone_from_plan: &Pose) -> Vec<Event> {
    let mut all = Vec::new();
    for (tool, ticks) in trace.uses() {
        let name = trace
            .tools
            .get(usize::from(tool))
            .map_or_else(|| format!("tool {tool}"), |t| t.1.clone());
        for (tick, what) in [(ticks.first(), "begins to cut"), (ticks.last(), "last cut")] {
            if let Some(t) = tick {
                all.push(Event {
                    at_s: trace.seconds(t.tick),
                    what: format!("{name} {what}"),
                });
            }
        }
    }
    if let Some(b) = breakthrough(trace, bone_from_plan) {
        all.push(Event {
            at_s: b.at_s,
            what: "plate broken through".to_owned(),
        });
    }
    all.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    all
}
