//! A logarithmic axis.
#![expect(
    clippy::cast_possible_truncation,
    reason = "pixels, and decades between -12 and 12"
)]

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// A logarithmic axis with ticks at round numbers: the more decades, the fewer.
#[derive(Debug, Clone)]
pub(super) struct Decades(pub(super) Range<f64>);

impl From<Range<f64>> for Decades {
    fn from(range: Range<f64>) -> Self {
        Self(range)
    }
}

impl Ranged for Decades {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let (lo, hi) = (self.0.start.ln(), self.0.end.ln());
        let t = (value.ln() - lo) / (hi - lo);
        (f64::from(limit.0) + t * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        let (lo, hi) = (self.0.start.log10(), self.0.end.log10());
        let digits: &[f64] = match hi - lo {
            d if d < 0.8 => &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0],
            d if d < 1.6 => &[1.0, 2.0, 3.0, 5.0, 7.0],
            d if d < 3.2 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        (lo.floor() as i32..=hi.ceil() as i32)
            .flat_map(|decade| digits.iter().map(move |d| d * 10f64.powi(decade)))
            .filter(|t| self.0.contains(t))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.0.clone()
    }
}

impl ValueFormatter<f64> for Decades {
    fn format(value: &f64) -> String {
        tick(*value)
    }
}

/// A tick's label: plain where it is short.
fn tick(v: f64) -> String {
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
    use super::tick;

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
    }
}
