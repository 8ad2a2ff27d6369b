//! The same prescribed push at other rates of the loop.

use super::device::FINE;
use super::guided::Guided;
use super::setup::{Slab, Spec};
use glam::DVec3;
use osteon_sim_core::tool::Tool;
use rayon::prelude::*;
use serde::Serialize;

/// Rates, Hz.
pub const RATES_HZ: [u32; 5] = [250, 500, 1000, 2000, 4000];
/// Push at a real tool, N, and for how long, s.
const PUSH_N: f64 = 10.0;
const SECONDS: f64 = 0.5;

/// What a rate removed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RateRow {
    /// The loop's rate.
    pub hz: u32,
    /// Removed, mm³.
    pub removed_mm3: f64,
    /// Over what 1 kHz removed, less 1.
    pub rel_to_1khz: f64,
}

fn removed_mm3(hz: u32) -> f64 {
    let slab = Slab {
        extent_mm: DVec3::new(16.0, 16.0, 24.0),
        density: 0.45,
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(vec![Tool::peg_drill()]));
    spec.scale = FINE;
    spec.feel.tick_s = 1.0 / f64::from(hz);
    let mut guided = Guided::new(&spec, DVec3::Z * 8.0, true);
    guided.glide(DVec3::ZERO, 40.0);
    guided.push_up_to(PUSH_N * spec.feel.force_scale, 0.1);
    guided.push_for(PUSH_N * spec.feel.force_scale, SECONDS);
    guided.removed_mm3()
}

/// The drill under the same push for the same time at every rate.
pub fn rate_rows() -> Vec<RateRow> {
    let volumes: Vec<f64> = RATES_HZ.into_par_iter().map(removed_mm3).collect();
    let at_1khz = RATES_HZ.iter().zip(&volumes).find(|(hz, _)| **hz == 1000);
    let at_1khz = at_1khz.map_or(f64::NAN, |(_, v)| *v);
    let row = |(&hz, &removed_mm3): (&u32, &f64)| RateRow {
        hz,
        removed_mm3,
        rel_to_1khz: removed_mm3 / at_1khz - 1.0,
    };
    RATES_HZ.iter().zip(&volumes).map(row).collect()
}
