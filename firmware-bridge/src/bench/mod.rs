//! Hardware in the loop without hardware and without a clock: device, cable and host in lockstep.
//!
//! The same bytes as on a real cable, the real firmware ([`osteon_protocol::firmware`]), the real sorting of
//! frames, the real beat of the servo thread; the plant's clock is the only one. A session runs as fast as the
//! machine can, and the same seed gives the same bits. [`trial`] measures what a fault does to the plant.

mod host;
mod junit;
pub mod pose;
mod script;
pub mod trial;
pub mod world;

pub use script::{BenchArgs, run};

use crate::fake::faults::{CATALOGUE, Planned};
use rayon::prelude::*;
use serde::Serialize;
use trial::{Bases, Outcome};
use world::Lab;

/// One fault in one direction over its seeds.
#[derive(Debug, Clone, Serialize)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent facts, as the report names them"
)]
pub struct Row {
    /// Name of the fault.
    pub fault: &'static str,
    /// Its direction.
    pub direction: String,
    /// A session must go on with it.
    pub benign: bool,
    /// Sessions played.
    pub seeds: u64,
    /// Longest time to zero torque, ms; null where the session must not stop, or one never came to zero.
    pub zero_torque_ms_max: Option<f64>,
    /// Most work that the motors did on the arm, J.
    pub joules_max: f64,
    /// No torque rose faster than the drive's slew limit.
    pub slew_ok: bool,
    /// Largest share of the slew limit that was used.
    pub slew_share_max: f64,
    /// Every session went on, or stands in a named fault.
    pub recovered_or_named: bool,
    /// Sessions that went on.
    pub went_on: u64,
    /// The named fault of those that did not.
    pub named: String,
    /// Commands that were applied although they were broken, old or nobody's.
    pub wrongly_applied: u32,
    /// All that is asked of it holds with every seed.
    pub pass: bool,
}

impl Row {
    fn of(planned: Planned, all: &[Outcome]) -> Self {
        let benign = planned.entry().benign;
        let worst = |f: &dyn Fn(&Outcome) -> f64| all.iter().map(f).fold(0.0, f64::max);
        let zeros: Option<Vec<f64>> = all.iter().map(|o| o.zero_ms).collect();
        let zero = zeros.map(|z| z.into_iter().fold(0.0, f64::max));
        let named = all.iter().find_map(|o| o.named.clone());
        let slew_share_max = worst(&|o| o.slew_share);
        Self {
            fault: planned.entry().name,
            direction: planned.direction.to_string(),
            benign,
            seeds: all.len() as u64,
            zero_torque_ms_max: if benign { None } else { zero },
            joules_max: worst(&|o| o.joules),
            slew_ok: slew_share_max <= 1.0 + 1e-9,
            slew_share_max,
            recovered_or_named: all.iter().all(|o| o.went_on || o.named.is_some()),
            went_on: all.iter().filter(|o| o.went_on).count() as u64,
            named: named.unwrap_or_default(),
            wrongly_applied: all.iter().map(|o| o.wrongly_applied).sum(),
            pass: !all.is_empty() && all.iter().all(|o| o.passes(planned)),
        }
    }
}

/// Plays every fault of the catalogue in each of its directions with `seeds` seeds.
pub fn all_rows(seeds: u64, progress: &mut dyn FnMut(&str, f32)) -> anyhow::Result<Vec<Row>> {
    let lab = Lab::new()?;
    let bases = Bases::new(&lab)?;
    let plans: Vec<Planned> = CATALOGUE
        .iter()
        .flat_map(|entry| {
            entry.directions.iter().map(|&direction| Planned {
                fault: entry.fault,
                direction,
                at_s: 0.0,
            })
        })
        .collect();
    let mut rows = Vec::new();
    for (n, &planned) in plans.iter().enumerate() {
        progress(planned.entry().name, n as f32 / plans.len() as f32);
        let all: anyhow::Result<Vec<Outcome>> = (0..seeds)
            .into_par_iter()
            .map(|seed| trial::play(&lab, &bases, planned, seed))
            .collect();
        rows.push(Row::of(planned, &all?));
    }
    Ok(rows)
}
