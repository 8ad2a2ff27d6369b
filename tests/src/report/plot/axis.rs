//! Axes: logarithmic or linear.
#![expect(
    clippy::cast_possible_truncation,
    reason = "pixels, decades between -12 and 12, and a few ticks"
)]

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// How an axis runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Decades; only values above 0 can be drawn.
    Log,
    /// Even steps.
    Linear,
}

impl Scale {
    /// Whether a value has a place on the axis.
    pub(super) fn holds(self, v: f64) -> bool {
        v.is_finite() && (self == Self::Linear || v > 0.0)
    }

    /// The range of an axis that shows these values, with some air.
    pub(super) fn range(self, values: impl Iterator<Item = f64>) -> Range<f64> {
        let (lo, hi) = values
            .filter(|v| self.holds(*v))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| {
                (lo.min(v), hi.max(v))
            });
        match self {
            Self::Log if lo > hi => 0.1..10.0,
            Self::Linear if lo > hi => 0.0..1.0,
            Self::Log => {
                // never less than half a decade, or there would be hardly a tick
                let air = (1.8 / (hi / lo).sqrt()).max(1.2);
                lo / air..hi * air
            }
            Self::Linear => {
                let least = if hi > lo { 0.0 } else { 0.1 * hi.abs() + 1e-9 };
                let air = (0.06 * (hi - lo)).max(least);
                // an axis that begins at zero ends there
                let start = if (0.0..0.3 * hi).contains(&lo) {
                    0.0
                } else {
                    lo - air
                };
                start..hi + air
            }
        }
    }

    /// The point at a share of a range.
    pub(super) fn between(self, range: &Range<f64>, share: f64) -> f64 {
        match self {
            Self::Log => range.start * (range.end / range.start).powf(share),
            Self::Linear => range.start + share * (range.end - range.start),
        }
    }
}

/// An axis with ticks at round numbers.
#[derive(Debug, Clone)]
pub(super) struct Axis {
    pub(super) scale: Scale,
    pub(super) range: Range<f64>,
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let (lo, hi) = (self.range.start, self.range.end);
        let t = match self.scale {
            Scale::Log => (value.ln() - lo.ln()) / (hi.ln() - lo.ln()),
            Scale::Linear => (value - lo) / (hi - lo),
        };
        (f64::from(limit.0) + t * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        let ticks = match self.scale {
            Scale::Log => decades(&self.range),
            Scale::Linear => steps(&self.range),
        };
        let inside = ticks.into_iter().filter(|t| self.range.contains(t));
        inside.collect()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Axis {
    fn format(value: &f64) -> String {
        tick(*value)
    }
}

/// Round numbers on decades: the more decades, the fewer.
fn decades(range: &Range<f64>) -> Vec<f64> {
    let (lo, hi) = (range.start.log10(), range.end.log10());
    let digits: &[f64] = match hi - lo {
        d if d < 0.8 => &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0],
        d if d < 1.6 => &[1.0, 2.0, 3.0, 5.0, 7.0],
        d if d < 3.2 => &[1.0, 2.0, 5.0],
        _ => &[1.0],
    };
    (lo.floor() as i32..=hi.ceil() as i32)
        .flat_map(|decade| digits.iter().map(move |d| d * 10f64.powi(decade)))
        .collect()
}

/// Five to ten even steps of 1, 2 or 5 times a power of ten.
fn steps(range: &Range<f64>) -> Vec<f64> {
    let rough = (range.end - range.start) / 5.0;
    if !(rough.is_finite() && rough > 0.0) {
        return Vec::new();
    }
    let decade = 10f64.powi(rough.log10().floor() as i32);
    let step = [5.0, 2.0, 1.0]
        .map(|d| d * decade)
        .into_iter()
        .find(|s| *s <= rough)
        .unwrap_or(decade);
    let first = (range.start / step).ceil() as i64;
    let last = (range.end / step).floor() as i64;
    (first..=last).map(|n| n as f64 * step).collect()
}

/// A tick's label: plain where it is short.
fn tick(v: f64) -> String {
    if v == 0.0 {
        return "0".to_owned();
    }
    if v < 0.0 {
        return format!("-{}", tick(-v));
    }
    if !(1e-3..1e5).contains(&v) {
        return format!("{v:.0e}");
    }
    // two digits, whatever rounding left behind them
    let digits = (1.0 - v.log10().floor()).max(0.0);
    #[expect(clippy::cast_sign_loss, reason = "not below 0")]
    let digits = digits as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::{Scale, steps, tick};

    #[test]
    fn ticks_are_short() {
        let ticks = [
            2.0 * 0.1,
            0.099_999_999_999,
            0.005,
            1.5,
            20.0,
            50_000.0,
            2e-5,
        ];
        let texts = ticks.map(tick);
        assert_eq!(texts, ["0.2", "0.1", "0.005", "1.5", "20", "50000", "2e-5"]);
        assert_eq!([0.0, -0.5].map(tick), ["0", "-0.5"]);
    }

    #[test]
    fn a_linear_axis_has_round_steps_and_air() {
        let range = Scale::Linear.range([0.0, 7.0, f64::NAN].into_iter());
        assert!(range.start.abs() < 1e-12);
        assert!(range.end > 7.0 && range.end < 8.0, "{range:?}");
        assert_eq!(steps(&range), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        assert_eq!(
            steps(&(-0.02..0.035)),
            [-0.02, -0.01, 0.0, 0.01, 0.02, 0.03]
        );
        let flat = Scale::Linear.range([3.0, 3.0].into_iter());
        assert!(flat.start < 3.0 && flat.end > 3.0);
    }
}
