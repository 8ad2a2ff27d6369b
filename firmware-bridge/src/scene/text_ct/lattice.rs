//! From the positions of a text CT to its lattice (the thesis's Alg. 2.3, with the spacing found
//! and not given).

use super::Problem;
use super::blocks::Text;
use super::line::{AXES, Entry};
use glam::DVec3;
use osteon_sim_core::grid::{Grid, MAX_DIM};
use std::collections::BTreeMap;

/// Most different values of one axis: room for planes whose digits vary in the last place.
const MAX_VALUES: usize = 16 * MAX_DIM;
/// Farthest a position may lie off its plane, voxels: rounding to few decimals does this.
const MAX_OFF: f64 = 0.1;
/// Slots of a block's memory of values that it has met.
const SLOTS: usize = 1 << 12;
/// A slot that holds nothing: the bits of a NaN.
const VACANT: u64 = u64::MAX;

/// The lattice of a text CT, by its first reading.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    grid: Grid,
    origin_mm: DVec3,
    voxels: usize,
}

/// Different values of one axis, each with the first line that has it.
#[derive(Debug)]
struct Met {
    slots: Vec<u64>,
    found: Vec<(f64, u32)>,
}

#[derive(Debug)]
struct Block {
    axes: [Met; 3],
    voxels: usize,
}

/// Planes along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Planes {
    origin: f64,
    spacing: f64,
    count: usize,
}

impl Default for Block {
    fn default() -> Self {
        let met = || Met {
            slots: vec![VACANT; SLOTS],
            found: Vec::new(),
        };
        Self {
            axes: [met(), met(), met()],
            voxels: 0,
        }
    }
}

impl Met {
    /// Two values may drive each other out of a slot and be found again: a few more to sort, no
    /// harm.
    fn meet(&mut self, value: f64, line: u32) {
        // -0 and 0 are one plane
        let value = value + 0.0;
        let bits = value.to_bits();
        // twelve bits are left
        let slot = (bits.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 52) as usize;
        if self.slots[slot] != bits {
            self.slots[slot] = bits;
            self.found.push((value, line));
        }
    }
}

impl Survey {
    /// Voxels along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.grid.dims
    }

    /// Dimensions and spacing, mm.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Centre of voxel (0, 0, 0), mm, in the file's frame.
    pub fn origin_mm(&self) -> DVec3 {
        self.origin_mm
    }

    /// Voxels that the file has.
    pub fn voxels(&self) -> usize {
        self.voxels
    }

    /// The voxel at a position; `None` where there is none, as the first reading would have said.
    pub(super) fn voxel(&self, at: DVec3) -> Option<usize> {
        let q = (at - self.origin_mm) / self.grid.spacing_mm;
        let nearest = q.round();
        let last = DVec3::from_array(self.grid.dims.map(|n| (n - 1) as f64));
        // two roundings of the same quotient: a hair more than at the first reading
        let on_plane = (q - nearest).abs().max_element() <= MAX_OFF + 1e-9;
        if !on_plane || nearest.cmplt(DVec3::ZERO).any() || nearest.cmpgt(last).any() {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "inside the lattice"
        )]
        let [i, j, k] = nearest.to_array().map(|n| n as usize);
        Some(self.grid.dense_index(i, j, k))
    }
}

/// The first reading.
pub(super) fn survey(text: &Text, progress: &mut dyn FnMut(f32)) -> Result<Survey, Problem> {
    let mut voxels = 0;
    let mut axes = [const { BTreeMap::new() }; 3];
    let visit = |block: &mut Block, line: u32, entry: &Entry| {
        block.voxels += 1;
        for (met, value) in block.axes.iter_mut().zip(entry.at.to_array()) {
            met.meet(value, line);
        }
    };
    let merge = |first: u64, block: Block| {
        voxels += block.voxels;
        for ((values, met), axis) in axes.iter_mut().zip(block.axes).zip(AXES) {
            join(values, met, first, axis)?;
        }
        Ok(())
    };
    text.scan(visit, merge, progress)?;
    if voxels == 0 {
        return Err(Problem::Empty);
    }
    let planes: Vec<Planes> = axes
        .into_iter()
        .zip(AXES)
        .map(|(values, axis)| {
            let values: Vec<(f64, u64)> = values.into_values().collect();
            planes(axis, &values)
        })
        .collect::<Result<_, _>>()?;
    let column = |f: fn(&Planes) -> f64| DVec3::new(f(&planes[0]), f(&planes[1]), f(&planes[2]));
    Ok(Survey {
        grid: Grid {
            dims: [planes[0].count, planes[1].count, planes[2].count],
            spacing_mm: column(|p| p.spacing),
        },
        origin_mm: column(|p| p.origin),
        voxels,
    })
}

/// Adds what a block met to the values so far, which are keyed so that they sort as numbers do.
fn join(
    values: &mut BTreeMap<i64, (f64, u64)>,
    met: Met,
    first_line: u64,
    axis: char,
) -> Result<(), Problem> {
    for (value, line) in met.found {
        let line = first_line + u64::from(line);
        values.entry(sorting_key(value)).or_insert((value, line));
        if values.len() > MAX_VALUES {
            let count = values.len();
            return Err(Problem::Scattered { axis, line, count });
        }
    }
    Ok(())
}

/// Integers in the order of the finite numbers.
fn sorting_key(value: f64) -> i64 {
    let bits = value.to_bits().cast_signed();
    if bits < 0 { i64::MIN - bits } else { bits }
}

/// The planes on which all values of an axis lie; `values` ascend, each with its first line.
fn planes(axis: char, values: &[(f64, u64)]) -> Result<Planes, Problem> {
    let (Some(&low), Some(&high)) = (values.first(), values.last()) else {
        return Err(Problem::Empty);
    };
    let (spacing, near) = spacing(values).ok_or(Problem::Flat { axis, value: low.0 })?;
    if !(0.01..=20.0).contains(&spacing) {
        return Err(Problem::Spacing { axis, spacing });
    }
    let count = ((high.0 - low.0) / spacing).round() + 1.0;
    if count > MAX_DIM as f64 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "positions are within 100 m, spacings from 0.01 mm"
        )]
        let count = count as u64;
        let ((low, low_line), (high, high_line)) = (low, high);
        return Err(Problem::Long {
            axis,
            low,
            low_line,
            high,
            high_line,
            count,
            spacing,
        });
    }
    let fitted = fit(values, near, spacing);
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
    fn numbers_sort_by_their_keys() {
        let values = [-1e5, -0.32, -1e-300, 0.0, 1e-300, 0.3, 7.0, 1e5];
        let keys = values.map(sorting_key);
        assert!(keys.is_sorted_by(|a, b| a < b), "{keys:?}");
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
