//! The planes of one axis of a lattice, from the positions on it: the thesis's Alg. 2.3, with the
//! spacing found and not given.

use super::Problem;
use osteon_sim_core::grid::MAX_DIM;

/// Farthest a position may lie off its plane, voxels: rounding to few decimals does this.
pub(super) const MAX_OFF: f64 = 0.1;

/// Planes along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Planes {
    pub(super) origin: f64,
    pub(super) spacing: f64,
    pub(super) count: usize,
}

/// The planes on which all values of an axis lie; `values` ascend, each with its first line.
pub(super) fn planes(axis: char, values: &[(f64, u64)]) -> Result<Planes, Problem> {
    let (Some(&low), Some(&high)) = (values.first(), values.last()) else {
        return Err(Problem::Empty);
    };
    let (spacing, near) = spacing(values).ok_or(Problem::Flat { axis, value: low.0 })?;
    if !(0.01..=20.0).contains(&spacing) {
        return Err(Problem::Spacing { axis, spacing });
    }
    let planes = |spacing: f64| ((high.0 - low.0) / spacing).round() + 1.0;
    // before the fit, on which a stray far away would have the greatest weight, and after it
    let long = |spacing: f64| long(axis, [low, high], planes(spacing), spacing);
    long(spacing)?;
    let fitted = fit(values, near, spacing);
    long(fitted.spacing)?;
    let stray = values
        .iter()
        .map(|&(value, line)| (value, line, fitted.off(value)))
        .filter(|&(_, _, off)| off > MAX_OFF)
        .min_by_key(|&(_, line, _)| line);
    if let Some((value, line, off)) = stray {
        let spacing = fitted.spacing;
        return Err(Problem::Irregular {
            axis,
            line,
            value,
            spacing,
            off,
        });
    }
    Ok(fitted)
}

/// Refuses an axis with more planes than a lattice can have.
fn long(axis: char, ends: [(f64, u64); 2], planes: f64, spacing: f64) -> Result<(), Problem> {
    if planes <= MAX_DIM as f64 {
        return Ok(());
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positions are within 100 m, spacings from about 0.01 mm"
    )]
    let count = planes as u64;
    let [(low, low_line), (high, high_line)] = ends;
    Err(Problem::Long {
        axis,
        low,
        low_line,
        high,
        high_line,
        count,
        spacing,
    })
}

/// The step that most neighbouring values make, and a value that has such a step; `None` where all
/// lie on one plane. Neither twins (one plane, two spellings) nor gaps nor a few strays sway it.
fn spacing(values: &[(f64, u64)]) -> Option<(f64, f64)> {
    let mut steps: Vec<(f64, f64)> = values
        .windows(2)
        .map(|pair| (pair[1].0 - pair[0].0, pair[0].0))
        .collect();
    let quantile = |steps: &[(f64, f64)], numerator: usize, denominator: usize| {
        let mut sorted: Vec<f64> = steps.iter().map(|&(step, _)| step).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        sorted.get(last * numerator / denominator).copied()
    };
    // up to nine spellings a plane leave one step in ten between planes
    let twin = 0.05 * quantile(&steps, 9, 10)?;
    steps.retain(|&(step, _)| step > twin);
    // the lower middle: of one true and one stray step the shorter
    let middle = quantile(&steps, 1, 2)?;
    let alike: Vec<(f64, f64)> = steps
        .into_iter()
        .filter(|(step, _)| (0.75..=1.25).contains(&(step / middle)))
        .collect();
    let mean = alike.iter().map(|&(step, _)| step).sum::<f64>() / alike.len() as f64;
    Some((mean, alike[alike.len() / 2].1))
}

/// Straight line through the positions over their plane numbers, strays left out. `near` is a
/// position on a plane.
fn fit(values: &[(f64, u64)], near: f64, spacing: f64) -> Planes {
    let numbered: Vec<(f64, f64)> = values
        .iter()
        .map(|&(value, _)| (((value - near) / spacing).round(), value))
        .filter(|&(n, value)| ((value - near) / spacing - n).abs() <= 2.0 * MAX_OFF)
        .collect();
    let count = numbered.len().max(1) as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| numbered.iter().map(f).sum::<f64>() / count;
    let (n_mean, v_mean) = (mean(|p| p.0), mean(|p| p.1));
    let (mut over, mut under) = (0.0, 0.0);
    for &(n, value) in &numbered {
        over += (n - n_mean) * (value - v_mean);
        under += (n - n_mean) * (n - n_mean);
    }
    let slope = if under > 0.0 { over / under } else { spacing };
    let squares = numbered
        .iter()
        .map(|&(n, value)| (value - v_mean - (n - n_mean) * slope).powi(2));
    let rounding = (squares.sum::<f64>() / count).sqrt().max(1e-9 * slope);
    let (low, high) = (values[0].0, values[values.len() - 1].0);
    let last = ((high - low) / slope).round();
    let spacing = shortest(slope, rounding / last.max(1.0));
    let first = ((low - near) / spacing).round();
    let at_first = v_mean + (first - n_mean) * spacing;
    // a position as the file spells it, if it lies there
    let origin = if (low - at_first).abs() <= 2.0 * rounding {
        low
    } else {
        at_first
    };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the caller has bounded it"
    )]
    let count = last as usize + 1;
    Planes {
        origin,
        spacing,
        count,
    }
}

/// The number with the fewest decimals within `tolerance` of `value`: what a spacing was before its
/// positions were rounded to the digits of a text.
fn shortest(value: f64, tolerance: f64) -> f64 {
    let rounded = |decimals: i32| {
        let scale = 10_f64.powi(decimals);
        (value * scale).round() / scale
    };
    (0..=9)
        .map(rounded)
        .find(|r| (r - value).abs() <= tolerance)
        .unwrap_or(value)
}

impl Planes {
    /// Distance to the nearest plane, voxels.
    fn off(&self, value: f64) -> f64 {
        let q = (value - self.origin) / self.spacing;
        (q - q.round()).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f64]) -> Result<Planes, Problem> {
        let mut values: Vec<(f64, u64)> = values.iter().copied().zip(1..).collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        planes('x', &values)
    }

    fn expected(origin: f64, spacing: f64, count: usize) -> Planes {
        Planes {
            origin,
            spacing,
            count,
        }
    }

    #[test]
    fn planes_are_found_behind_rounding_twins_and_gaps() {
        let exact: Vec<f64> = (0..300).map(|n| -70.5 + f64::from(n) * 0.47).collect();
        assert_eq!(of(&exact).expect("planes"), expected(-70.5, 0.47, 300));
        // two decimals of 0.3125
        let rounded: Vec<f64> = (0..200)
            .map(|n| (f64::from(n) * 31.25).round() / 100.0)
            .collect();
        assert_eq!(of(&rounded).expect("planes"), expected(0.0, 0.3125, 200));
        // every plane spelt twice, as single precision does
        let twins: Vec<f64> = exact
            .iter()
            .flat_map(|&v| [v, v + 3e-6 * (v * 7.0).sin()])
            .collect();
        let found = of(&twins).expect("planes");
        assert_eq!((found.spacing, found.count), (0.47, 300));
        // two pieces, far apart
        let pieces: Vec<f64> = (0..20)
            .chain(900..930)
            .map(|n| f64::from(n) * 0.8)
            .collect();
        assert_eq!(of(&pieces).expect("planes"), expected(0.0, 0.8, 930));
        assert_eq!(of(&[5.0, 6.5]).expect("planes"), expected(5.0, 1.5, 2));
    }

    #[test]
    fn what_is_no_lattice_is_refused_with_its_line() {
        let mut values: Vec<f64> = (0..100).map(f64::from).collect();
        values.push(41.5);
        let problem = of(&values).expect_err("a stray").to_string();
        assert!(
            problem.starts_with("line 101: x = 41.5 lies 0.50 of a voxel"),
            "{problem}"
        );
        // a stray at the front must not make all others the strays
        values[100] = -7.3;
        let problem = of(&values).expect_err("a stray").to_string();
        assert!(
            problem.starts_with("line 101: x = -7.3 lies 0.30"),
            "{problem}"
        );
        values[100] = 90_000.0;
        let problem = of(&values).expect_err("too long").to_string();
        assert!(
            problem.contains("x runs from 0 (line 1) to 90000 (line 101): 90001 voxels of 1 mm"),
            "{problem}"
        );
        // 0.47 up to 20, then 1.0
        let two: Vec<f64> = (0..40)
            .map(|n| f64::from(n) * 0.47)
            .chain((1..9).map(|n| 18.33 + f64::from(n) * 1.0))
            .collect();
        let problem = of(&two).expect_err("two spacings").to_string();
        assert!(problem.starts_with("line 41: x = 19.33"), "{problem}");
        assert!(matches!(of(&[3.0]), Err(Problem::Flat { .. })));
        assert!(matches!(
            of(&[0.0, 32.0, 64.0]),
            Err(Problem::Spacing { .. })
        ));
        assert!(matches!(of(&[0.0, 0.001]), Err(Problem::Spacing { .. })));
    }
}
