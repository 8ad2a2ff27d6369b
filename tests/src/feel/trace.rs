//! What a run left behind, and the measures on it.

use glam::DVec3;

/// The loop at the beginning of a tick, base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// Device time, s.
    pub time_s: f64,
    /// True place of the stylus, mm.
    pub position_mm: DVec3,
    /// True velocity, mm/s.
    pub velocity_mm_s: DVec3,
    /// Force of the motors at the stylus from this tick on, N.
    pub force_n: DVec3,
    /// Force that the servo asked for in this tick, N.
    pub asked_n: DVec3,
    /// Where the proxy is, mm.
    pub proxy_mm: DVec3,
    /// Energy that went from the plant into the motors so far, mJ; negative: the loop gave energy.
    pub absorbed_mj: f64,
}

/// The records of a run, one a tick.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    /// In order of time.
    pub records: Vec<Record>,
}

impl Trace {
    /// The records of the last `seconds`.
    pub fn last(&self, seconds: f64) -> &[Record] {
        let end = self.records.last().map_or(0.0, |r| r.time_s);
        self.between(end - seconds, f64::INFINITY)
    }

    /// The records from one time to another, s.
    pub fn between(&self, from_s: f64, to_s: f64) -> &[Record] {
        let start = self.records.partition_point(|r| r.time_s <= from_s);
        let end = self.records.partition_point(|r| r.time_s <= to_s);
        &self.records[start.min(end)..end]
    }

    /// Forgets what was so far.
    pub fn clear(&mut self) {
        self.records.clear();
    }

    /// The least of the energy account relative to its beginning, mJ.
    pub fn least_absorbed_mj(&self) -> f64 {
        let first = self.records.first().map_or(0.0, |r| r.absorbed_mj);
        let least = self.records.iter().map(|r| r.absorbed_mj);
        least.fold(first, f64::min) - first
    }
}

/// Peak to peak of a vector, the largest of its three components.
pub fn peak_to_peak(records: &[Record], of: impl Fn(&Record) -> DVec3) -> f64 {
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for record in records {
        lo = lo.min(of(record));
        hi = hi.max(of(record));
    }
    if records.is_empty() {
        0.0
    } else {
        (hi - lo).max_element()
    }
}

/// Peak to peak of the place, mm.
pub fn swing_mm(records: &[Record]) -> f64 {
    peak_to_peak(records, |r| r.position_mm)
}

/// Peak to peak of the motors' force, N.
pub fn force_swing_n(records: &[Record]) -> f64 {
    peak_to_peak(records, |r| r.force_n)
}

/// Largest change of the motors' force from one tick to the next, N.
pub fn force_step_n(records: &[Record]) -> f64 {
    let steps = records.windows(2);
    steps
        .map(|w| (w[1].force_n - w[0].force_n).length())
        .fold(0.0, f64::max)
}

/// Largest force of the motors, N.
pub fn peak_force_n(records: &[Record]) -> f64 {
    let forces = records.iter().map(|r| r.force_n.length());
    forces.fold(0.0, f64::max)
}

/// Root mean square of the motors' force, N.
pub fn rms_force_n(records: &[Record]) -> f64 {
    let squares: f64 = records.iter().map(|r| r.force_n.length_squared()).sum();
    (squares / records.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(time_s: f64, x: f64) -> Record {
        Record {
            time_s,
            position_mm: DVec3::X * x,
            velocity_mm_s: DVec3::ZERO,
            force_n: DVec3::Y * x,
            asked_n: DVec3::ZERO,
            proxy_mm: DVec3::ZERO,
            absorbed_mj: -x,
        }
    }

    #[test]
    fn windows_and_measures_are_what_they_say() {
        let xs = [0.0, 3.0, -1.0, 2.0, 2.0];
        let records = (0u32..).zip(xs).map(|(n, x)| record(f64::from(n), x));
        let trace = Trace {
            records: records.collect(),
        };
        assert_eq!(trace.last(2.0).len(), 2);
        assert_eq!(trace.between(0.0, 2.0).len(), 2);
        assert!((swing_mm(&trace.records) - 4.0).abs() < 1e-12);
        assert!((force_step_n(&trace.records) - 4.0).abs() < 1e-12);
        assert!((peak_force_n(&trace.records) - 3.0).abs() < 1e-12);
        assert!((trace.least_absorbed_mj() + 3.0).abs() < 1e-12);
        assert!((rms_force_n(&trace.records) - (18.0f64 / 5.0).sqrt()).abs() < 1e-12);
    }
}
