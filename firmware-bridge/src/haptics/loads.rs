//! Largest loads of a session, and the ticks in which something was at its limit.

use super::record::TickRecord;
use osteon_sim_core::chain::{Guard, GuardCounts};
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// A spindle that turns under a load with less than this share of its speed has stalled.
const STALL_SHARE: f64 = 0.1;

/// What the force loop bore over a session.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Loads {
    /// Largest force at the stylus, N.
    pub peak_force_n: f64,
    /// Largest force at a real tool, N: before guards and ramps.
    pub peak_physical_force_n: f64,
    /// Ticks in which a real tool would have met more than the stylus may show.
    pub saturated_ticks: u64,
    /// Largest vibration in the force at the stylus, N.
    pub peak_vibration_n: f64,
    /// Largest torque that held or turned a real tool in the bone, N·mm. Three motors cannot show it.
    pub peak_holding_torque_nmm: f64,
    /// Largest torque of the cut about the spindle, N·mm at a real tool.
    pub peak_spindle_nmm: f64,
    /// Largest share of what the spindle's motor has.
    pub peak_spindle_load: f64,
    /// Ticks in which the spindle was below a tenth of its speed under a load.
    pub stalled_ticks: u64,
    /// Ticks with the clutch held.
    pub clutched_ticks: u64,
    /// Lowest account of the passivity observer, mJ; negative where the loop had made energy.
    pub least_energy_mj: f64,
}

impl Loads {
    /// Takes one tick into account. `rpm`: the tool's speed without a load, turns a minute.
    pub(crate) fn add(&mut self, tick: &TickRecord, rpm: f64) {
        let felt = &tick.felt;
        for (peak, value) in [
            (&mut self.peak_force_n, tick.force_n.length()),
            (&mut self.peak_physical_force_n, felt.physical_force_n),
            (&mut self.peak_vibration_n, felt.vibration_n),
            (&mut self.peak_holding_torque_nmm, felt.holding_torque_nmm),
            (&mut self.peak_spindle_nmm, felt.spindle_nmm),
            (&mut self.peak_spindle_load, felt.spindle_load),
        ] {
            *peak = peak.max(value);
        }
        self.least_energy_mj = self.least_energy_mj.min(felt.energy_mj);
        let turning = felt.spindle_rad_s * 60.0 / TAU;
        let stalled =
            tick.flags.spindle_on && felt.spindle_load > 0.0 && turning < STALL_SHARE * rpm;
        for (count, happened) in [
            (&mut self.saturated_ticks, tick.flags.saturated),
            (&mut self.stalled_ticks, stalled),
            (&mut self.clutched_ticks, tick.flags.clutched),
        ] {
            *count += u64::from(happened);
        }
    }
}

/// What one guard had to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct GuardReport {
    /// Ticks in which it intervened.
    pub count: u64,
    /// The last of them, from 1; absent where it never did.
    pub last_tick: Option<u64>,
}

/// All guards by their names, with underscores.
pub(crate) fn by_guard(counts: &GuardCounts) -> BTreeMap<String, GuardReport> {
    let of = |guard: Guard| GuardReport {
        count: counts.of(guard),
        last_tick: counts.last(guard),
    };
    Guard::ALL
        .iter()
        .map(|guard| (guard.name().replace(' ', "_"), of(*guard)))
        .collect()
}
