//! Taps and impacts: cases 4 and 5.

use super::super::bench::Bench;
use super::super::hand::Hand;
use super::super::press::meet;
use super::super::setup::{Slab, Spec, ball};
use super::super::trace::{force_step_n, force_swing_n, peak_force_n};
use super::{Case, Worst};
use glam::DVec3;
use osteon_sim_core::tool::Tool;
use rayon::prelude::*;
use serde::Serialize;

/// Speeds of the taps, mm/s.
const SPEEDS: [f64; 4] = [100.0, 300.0, 500.0, 1000.0];
/// Weights on the bare device, kg: 45 g and 245 g in all.
const WEIGHTS: [f64; 2] = [0.0, 0.2];
/// A device that is this far away and goes on is caught, mm.
const CAUGHT_MM: f64 = 15.0;

/// What a tap did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tap {
    /// All that moves, kg.
    pub mass_kg: f64,
    /// From a sample to its command in force.
    pub delay_ticks: usize,
    /// Speed at the face, mm/s.
    pub entry_mm_s: f64,
    /// Largest speed away from the face afterwards, mm/s.
    pub rebound_mm_s: f64,
    /// Deepest place of the device below the face, mm.
    pub deepest_mm: f64,
    /// Largest force of the motors, N.
    pub peak_n: f64,
    /// Largest change of it in a tick, N.
    pub step_n: f64,
    /// Energy that the motors took from the device, mJ; negative: they gave some.
    pub absorbed_mj: f64,
    /// How the force swings from half a second after the touch on, N.
    pub late_swing_n: f64,
    /// Lowest place of the proxy against the face, mm (negative: inside).
    pub proxy_lowest_mm: f64,
    /// Highest place of the proxy while the device was below the face, mm.
    pub proxy_highest_mm: f64,
    /// Farthest of the proxy from the device once that is out again, mm.
    pub proxy_away_mm: f64,
}

/// A tap at `speed_mm_s` of a device with a weight on it and nothing that pushes.
pub fn tap(spec: &Spec, weight_kg: f64, delay_ticks: usize, speed_mm_s: f64) -> Tap {
    let spec = spec.clone().with(Hand::weight(weight_kg), delay_ticks);
    let mut bench = Bench::new(&spec);
    bench.run_in();
    meet(&mut bench, speed_mm_s);
    for _ in 0..1500 {
        bench.tick();
        let (place, speed) = (bench.plant.position_mm.z, bench.plant.velocity_mm_s.z);
        if place > CAUGHT_MM && speed > 0.0 {
            break;
        }
    }
    judge(&bench, spec.plant.mass_kg + weight_kg, delay_ticks)
}

fn judge(bench: &Bench, mass_kg: f64, delay_ticks: usize) -> Tap {
    let records = &bench.trace.records;
    let touched = records.iter().position(|r| r.position_mm.z < 0.0);
    let touched = touched.unwrap_or(records.len().saturating_sub(1));
    let entry = records.get(touched).map_or(0.0, |r| -r.velocity_mm_s.z);
    let after = &records[touched..];
    let inside = || after.iter().filter(|r| r.position_mm.z < 0.0);
    let deepest = inside().map(|r| -r.position_mm.z).fold(0.0, f64::max);
    let turn = after.iter().position(|r| r.velocity_mm_s.z > 0.0);
    let out = &after[turn.unwrap_or(after.len())..];
    let out = out.iter().filter(|r| r.position_mm.z > 0.2);
    let start = after.first().map_or(0.0, |r| r.time_s);
    Tap {
        mass_kg,
        delay_ticks,
        entry_mm_s: entry,
        rebound_mm_s: after.iter().map(|r| r.velocity_mm_s.z).fold(0.0, f64::max),
        deepest_mm: deepest,
        peak_n: peak_force_n(after),
        step_n: force_step_n(after),
        absorbed_mj: bench.plant.absorbed_mj,
        late_swing_n: force_swing_n(bench.trace.between(start + 0.5, f64::INFINITY)),
        proxy_lowest_mm: after.iter().map(|r| r.proxy_mm.z).fold(0.0, f64::min),
        proxy_highest_mm: inside().map(|r| r.proxy_mm.z).fold(f64::MIN, f64::max),
        proxy_away_mm: out
            .map(|r| (r.proxy_mm - r.position_mm).length())
            .fold(0.0, f64::max),
    }
}

/// Taps with both weights at all speeds and 0 to 2 ticks of delay.
pub fn all_taps(spec: &Spec) -> Vec<Tap> {
    let mut all = Vec::new();
    for weight in WEIGHTS {
        for delay in 0..=2 {
            all.extend(SPEEDS.iter().map(|&speed| (weight, delay, speed)));
        }
    }
    all.into_par_iter()
        .map(|(weight, delay, speed)| tap(spec, weight, delay, speed))
        .collect()
}

fn words(tap: &Tap) -> String {
    format!(
        "{:.0} g at {:.2} m/s, {} ticks",
        tap.mass_kg * 1e3,
        tap.entry_mm_s * 1e-3,
        tap.delay_ticks
    )
}

/// Case 4.
pub(super) fn taps() -> Case {
    let (mut rebound, mut peak, mut late) = (Worst::default(), Worst::default(), Worst::default());
    for tap in all_taps(&Spec::flat()) {
        rebound.note(tap.rebound_mm_s / tap.entry_mm_s, || words(&tap));
        peak.note(tap.peak_n, || words(&tap));
        late.note(tap.late_swing_n, || words(&tap));
    }
    Case {
        id: 4,
        name: "Taps",
        criterion: "45 g and 245 g at 0.1, 0.3, 0.5 and 1 m/s, 0 to 2 ticks of delay, nothing pushing: rebound ≤ \
                    entry speed; force ≤ 3.3 N (and 3 steps of the converter); from 0.5 s after the touch on the \
                    force swings ≤ 0.05 N"
            .to_owned(),
        measured: format!(
            "rebound/entry {}; {}; late {}",
            rebound.words(""),
            peak.words("N"),
            late.words("N")
        ),
        pass: rebound.value <= 1.0 && peak.value <= 3.305 && late.value <= 0.05,
    }
}

/// Case 5.
pub(super) fn saturated() -> Case {
    let mut tools = Tool::standard_set();
    tools.push(ball(3.0));
    let taps: Vec<(String, Tap)> = tools
        .into_par_iter()
        .map(|tool| {
            let id = tool.id.clone();
            let extent_mm = DVec3::new(44.0, 44.0, 16.0);
            let slab = Slab {
                extent_mm,
                ..Slab::default()
            };
            let spec = Spec::at(slab.scene(vec![tool]));
            (id, tap(&spec, 0.2, 1, 1000.0))
        })
        .collect();
    let (mut off, mut away) = (Worst::default(), Worst::default());
    let mut deepest = f64::MAX;
    for (id, tap) in &taps {
        let range = [tap.proxy_lowest_mm, tap.proxy_highest_mm];
        let farthest = range.into_iter().map(f64::abs).fold(0.0, f64::max);
        off.note(farthest, || {
            format!("{id}, {:.4} to {:.4}", range[0], range[1])
        });
        away.note(tap.proxy_away_mm, || id.clone());
        deepest = deepest.min(tap.deepest_mm);
    }
    Case {
        id: 5,
        name: "Saturated impact",
        criterion: "245 g at 1 m/s, three tools: while the device is deep inside (more than the limit's 6.6 mm) the \
                    proxy stays within 0.05 mm of the face; outside again it is with the device (within 0.06 mm, the \
                    encoders' step)"
            .to_owned(),
        measured: format!(
            "device {deepest:.1} mm inside or more; proxy {} off the face; outside {}",
            off.words("mm"),
            away.words("mm")
        ),
        pass: deepest > 6.6 && off.value <= 0.05 && away.value <= 0.06,
    }
}
