//! A wrist of potentiometers: from raw readings to gimbal angles, as data of a model.

use glam::DVec3;

/// Points of a calibration table.
pub const TABLE_POINTS: usize = 17;

/// What a host knows of a wrist's potentiometers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PotWrist {
    /// Angle of each whole track, rad; a negative one is wired the other way round.
    pub span_rad: [f64; 3],
    /// Share of the track that is read at equal steps of the true angle, first to last; rising. `None`: taken
    /// for linear.
    pub table: Option<[[f64; TABLE_POINTS]; 3]>,
}

impl PotWrist {
    /// The stock Omni's, taken for linear: spans of `ytsutano/raw_omni` (`raw_omni_driver.cpp`). Its data
    /// sheet promises ±5 % of linearity.
    pub const OMNI: Self = Self {
        span_rad: [5.48, -5.28, 4.76],
        table: None,
    };

    /// Gimbal angles (yaw, pitch, roll), rad, from both ends of each track; zero where a track reads nothing
    /// at both ends.
    pub fn angles(&self, pots: [u16; 3], inverse_pots: [u16; 3]) -> DVec3 {
        DVec3::from_array(core::array::from_fn(|axis| {
            let (a, b) = (f64::from(pots[axis]), f64::from(inverse_pots[axis]));
            let share = if a + b > 0.0 { a / (a + b) } else { 0.5 };
            let place = match &self.table {
                Some(table) => inverse(&table[axis], share),
                None => share,
            };
            self.span_rad[axis] * (place - 0.5)
        }))
    }
}

/// Where in [0, 1] a rising table of equal steps has this value.
fn inverse(table: &[f64; TABLE_POINTS], value: f64) -> f64 {
    let step = 1.0 / (TABLE_POINTS - 1) as f64;
    let upper = table
        .partition_point(|&v| v < value)
        .clamp(1, TABLE_POINTS - 1);
    let (lo, hi) = (table[upper - 1], table[upper]);
    let part = if hi > lo {
        (value - lo) / (hi - lo)
    } else {
        0.0
    };
    ((upper - 1) as f64 + part) * step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_zero_and_the_ends_are_half_the_span() {
        let wrist = PotWrist::OMNI;
        assert_eq!(wrist.angles([500; 3], [500; 3]), DVec3::ZERO);
        let end = wrist.angles([1000; 3], [0; 3]);
        assert!((end - DVec3::new(2.74, -2.64, 2.38)).length() < 1e-12);
        assert_eq!(wrist.angles([0; 3], [0; 3]), DVec3::ZERO);
    }

    #[test]
    fn a_table_undoes_the_curve_that_it_was_taken_from() {
        let curve = |u: f64| u + 0.04 * libm::sin(core::f64::consts::TAU * u);
        let table = core::array::from_fn(|n| curve(n as f64 / 16.0));
        for n in 0..=100 {
            let u = f64::from(n) / 100.0;
            assert!((inverse(&table, curve(u)) - u).abs() < 0.002, "{u}");
        }
    }
}
