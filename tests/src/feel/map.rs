//! The stiffness map: the stiffest coupling that a press bears, and how much a stiffer one swings.
//!
//! Laws beside it, with T the tick and D the delay: Colgate and Schenkel's b > K T/2 for a loop
//! without delay, and b + B > K (T/2 + D) with delay D and damping B of the servo's own. Both are
//! for a linear loop: Coulomb friction and quantisation are what lifts or lowers the measured limit.

use super::bench::Bench;
use super::hand::Hand;
use super::plant::PlantSpec;
use super::press;
use super::setup::Spec;
use super::trace::{Record, swing_mm};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

/// Range of the search for a press, N/mm: below it the press goes deeper than the workspace.
pub const PRESS_RANGE: [f64; 2] = [0.04, 6.0];
/// Range of the search for a small swing, N/mm.
const SWING_RANGE: [f64; 2] = [0.01, 6.0];
/// Steady push under a small swing, N: deep enough to stay in contact.
const SWING_PUSH_N: f64 = 0.4;
/// Ratio of the search's first steps.
const STRIDE: f64 = 1.5;
/// Halvings in the logarithm after them: 1 %.
const HALVINGS: u32 = 5;
/// Longest time that a press is given to settle, s.
const PRESS_S: f64 = 10.0;
/// Tick, s.
const TICK_S: f64 = 1e-3;

/// One place of the map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapRow {
    /// Who holds the device.
    pub hand: &'static str,
    /// From a sample to its command in force.
    pub delay_ticks: usize,
    /// Whether the guards are on.
    pub guard: bool,
    /// Stiffest coupling whose press settles, N/m; the search's upper end where that settles too.
    pub k_max_n_per_m: f64,
    /// (b + B) / (T/2 + D), N/m.
    pub law_n_per_m: f64,
    /// Colgate's 2 b / T, N/m, which knows no delay.
    pub colgate_n_per_m: f64,
}

/// How much a press swings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SwingRow {
    /// From a sample to its command in force.
    pub delay_ticks: usize,
    /// Whether the guards are on.
    pub guard: bool,
    /// Stiffness of the coupling, N/m.
    pub stiffness_n_per_m: f64,
    /// Peak to peak of the place in the last second, mm.
    pub swing_mm: f64,
    /// Least of the energy account, mJ.
    pub least_absorbed_mj: f64,
}

/// The stiffness limit of the law, N/m, for damping in N·s/m.
pub fn delay_law_n_per_m(damping: f64, delay_ticks: usize) -> f64 {
    damping / (TICK_S * (0.5 + delay_ticks as f64))
}

/// The value in a range up to which `holds`, from the first one of the search's steps that holds on; 0
/// where none does.
pub fn largest([first, last]: [f64; 2], holds: impl Fn(f64) -> bool) -> f64 {
    let mut lo = None;
    let mut hi = first;
    loop {
        let held = holds(hi);
        if held && hi >= last {
            return hi;
        }
        if !held && let Some(lo) = lo {
            return refined(lo, hi, holds);
        }
        if !held && hi >= last {
            return 0.0;
        }
        lo = held.then_some(hi);
        hi = (hi * STRIDE).min(last);
    }
}

fn refined(mut lo: f64, mut hi: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = (lo * hi).sqrt();
        if holds(middle) {
            lo = middle;
        } else {
            hi = middle;
        }
    }
    lo
}

/// Places of the map: hand, delay, guard.
fn places() -> Vec<(Hand, usize, bool)> {
    let mut all = Vec::new();
    for hand in Hand::ALL {
        for delay in 0..=3 {
            all.extend([false, true].map(|guard| (hand, delay, guard)));
        }
    }
    all
}

/// One place of the map on a specification.
pub fn place(base: &Spec, hand: Hand, delay_ticks: usize, guard: bool) -> MapRow {
    let spec = base.clone().with(hand, delay_ticks).guarded(guard);
    let k_max = largest(PRESS_RANGE, |k| {
        press::settled(&press::pressed(&spec.clone().stiff(k), PRESS_S))
    });
    let own = spec.plant.viscous_n_s_per_m + hand.damping_n_s_per_m;
    let added = spec.feel.guard.damping_n_s_per_mm * 1e3;
    MapRow {
        hand: hand.name,
        delay_ticks,
        guard,
        k_max_n_per_m: k_max * 1e3,
        law_n_per_m: delay_law_n_per_m(own + added, delay_ticks),
        colgate_n_per_m: 2.0 * own / TICK_S,
    }
}

/// The map of the typical device on a flat, hard slab.
pub fn stiffness_map() -> Vec<MapRow> {
    let base = Spec::flat();
    let all = places();
    all.into_par_iter()
        .map(|(hand, delay, guard)| place(&base, hand, delay, guard))
        .collect()
}

/// Swing of the press without a hand against stiffness (N/mm), for every delay.
pub fn swings(stiffnesses: &[f64]) -> Vec<SwingRow> {
    let base = Spec::flat();
    let mut all = Vec::new();
    for delay in 0..=3 {
        for guard in [false, true] {
            all.extend(stiffnesses.iter().map(|&k| (delay, guard, k)));
        }
    }
    all.into_par_iter()
        .map(|(delay_ticks, guard, k)| {
            let spec = base.clone().with(Hand::NONE, delay_ticks).guarded(guard);
            let bench = press::pressed(&spec.stiff(k), PRESS_S);
            SwingRow {
                delay_ticks,
                guard,
                stiffness_n_per_m: k * 1e3,
                swing_mm: swing_mm(bench.trace.last(1.0)),
                least_absorbed_mj: bench.trace.least_absorbed_mj(),
            }
        })
        .collect()
}

/// The stiffness, N/m, at which a small swing about the press begins to grow, without Coulomb
/// friction and quantisation; `make` gives the loop of a specification.
pub fn onset_n_per_m(base: &Spec, make: impl Fn(&Spec) -> Bench) -> f64 {
    1e3 * largest(SWING_RANGE, |k| decays(base, k, &make))
}

/// Whether a small swing about the press is smaller three seconds later.
fn decays(base: &Spec, stiffness_n_per_mm: f64, make: impl Fn(&Spec) -> Bench) -> bool {
    let spec = base.clone().stiff(stiffness_n_per_mm);
    let mut bench = make(&spec);
    let depth = SWING_PUSH_N / stiffness_n_per_mm;
    bench.run_in();
    bench.glide(DVec3::Z * -depth, 100.0);
    bench.rest(0.1);
    bench.pull.push_n = DVec3::Z * -SWING_PUSH_N;
    // a tenth of the depth, so that contact is never lost
    let omega = (stiffness_n_per_mm * 1e3 / spec.plant.mass_kg).sqrt();
    bench.plant.velocity_mm_s = DVec3::Z * (0.1 * depth * omega);
    bench.trace.clear();
    let start = bench.device.time_s();
    bench.run(4.5);
    let early = spread(bench.trace.between(start + 0.5, start + 1.5));
    let late = spread(bench.trace.between(start + 3.5, start + 4.5));
    // a swing that is gone leaves rounding, which neither grows nor decays
    late < 1e-4 * depth || (late < early && late < 0.1 * depth)
}

/// Standard deviation of the height, mm.
fn spread(records: &[Record]) -> f64 {
    let count = records.len().max(1) as f64;
    let mean = records.iter().map(|r| r.position_mm.z).sum::<f64>() / count;
    let square = |r: &Record| (r.position_mm.z - mean) * (r.position_mm.z - mean);
    (records.iter().map(square).sum::<f64>() / count).sqrt()
}

/// The linear device for [`onset_n_per_m`]: fine encoders, `viscous` N·s/m, no Coulomb friction.
pub fn linear(viscous: f64, delay_ticks: usize) -> Spec {
    let mut spec = Spec::flat().with(Hand::NONE, delay_ticks);
    spec.plant = PlantSpec::linear(viscous);
    spec.scale = super::device::FINE;
    spec
}
