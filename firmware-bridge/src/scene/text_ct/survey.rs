//! The first reading of a text CT: every line is checked, the different positions of each axis are
//! gathered, and the lattice follows from them.

use super::Problem;
use super::blocks::Text;
use super::lattice::{MAX_OFF, Planes, planes};
use super::line::{AXES, Entry};
use glam::DVec3;
use osteon_sim_core::grid::{Grid, MAX_DIM};
use std::collections::BTreeMap;

/// Most different values of one axis: room for planes whose digits vary in the last place.
const MAX_VALUES: usize = 16 * MAX_DIM;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_by_their_keys() {
        let values = [-1e5, -0.32, -1e-300, 0.0, 1e-300, 0.3, 7.0, 1e5];
        let keys = values.map(sorting_key);
        assert!(keys.is_sorted_by(|a, b| a < b), "{keys:?}");
    }
}
