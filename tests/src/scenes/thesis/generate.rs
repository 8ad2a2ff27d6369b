//! The five stand-ins: a scalar field each, and the level that makes the right number of voxels
//! active.

use super::noise::Noise;
use super::{ACTIVE_HU, Object, StandIn};
use glam::DVec3;
use osteon_firmware_bridge::scene::phantom::{BOX, shape::Scapula};
use osteon_sim_core::grid::Grid;
use rayon::prelude::*;

/// Where there is no material whatever the level.
const NOTHING: f32 = f32::NEG_INFINITY;
/// Densest voxel of a stand-in, HU.
const MOST_HU: f32 = 1500.0;

pub(super) fn stand_in(object: Object, seed: u64) -> StandIn {
    let grid = object.grid();
    // the weight of the second sheet turns walls into rods; HU that a unit of the field is worth
    let (field, hu_per_unit) = match object {
        Object::CellularFoam => (porous(&grid, 12.0, 0.15, seed), 8e4),
        Object::TrabecularCore1 | Object::TrabecularCore2 => (porous(&grid, 9.0, 0.6, seed), 4e4),
        Object::Scapula => (scapula(&grid, whole_bone), 700.0),
        Object::Glenoid => (scapula(&grid, joint), 700.0),
    };
    let level = level(&field, object.theirs().active);
    let density_hu = field
        .par_iter()
        .map(|&v| density(v - level, hu_per_unit))
        .collect();
    StandIn { grid, density_hu }
}

/// Density at a height above the level: at least [`ACTIVE_HU`] where it is not below.
fn density(above: f32, hu_per_unit: f32) -> i16 {
    let least = f32::from(ACTIVE_HU);
    let hu = if above >= 0.0 {
        (least + above * hu_per_unit).min(MOST_HU)
    } else {
        (least - 1.0 + above * hu_per_unit).max(0.0)
    };
    #[expect(clippy::cast_possible_truncation, reason = "from 0 to MOST_HU")]
    let hu = hu as i16;
    hu
}

/// The level that `count` voxels reach.
fn level(field: &[f32], count: usize) -> f32 {
    let mut values: Vec<f32> = field.iter().copied().filter(|&v| v > NOTHING).collect();
    let at = values.len().saturating_sub(count.max(1));
    let (_, level, _) = values.select_nth_unstable_by(at, f32::total_cmp);
    *level
}

/// Walls and rods in a cylinder along z: highest on the zero surface of one noise, and, with
/// `rods` above 0, there where that of another noise crosses it. Knots lie `step` voxels apart.
fn porous(grid: &Grid, step: f32, rods: f32, seed: u64) -> Vec<f32> {
    let mut field = vec![0.0; grid.len()];
    Noise::new(grid.dims, step, seed).each(&mut field, |v, noise| *v = -noise * noise);
    Noise::new(grid.dims, step, !seed).each(&mut field, |v, noise| *v -= rods * noise * noise);
    let [nx, ny, _] = grid.dims;
    let radius = 0.5 * nx.min(ny) as f32;
    let off = |n: usize, count: usize| ((n as f32 + 0.5 - 0.5 * count as f32) / radius).powi(2);
    field
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, line)| {
            let y = off(row % ny, ny);
            for (i, v) in line.iter_mut().enumerate() {
                if off(i, nx) + y > 1.0 {
                    *v = NOTHING;
                }
            }
        });
    field
}

/// The built-in scapula; `phantom_from_unit` takes a place in the grid, each axis from 0 to 1, to
/// the phantom's frame.
fn scapula(grid: &Grid, phantom_from_unit: fn(DVec3) -> DVec3) -> Vec<f32> {
    let shape = Scapula::default();
    let last = DVec3::from_array(grid.dims.map(|n| (n - 1) as f64));
    let [nx, ny, nz] = grid.dims;
    (0..nx * ny * nz)
        .into_par_iter()
        .map(|at| {
            let voxel = [at % nx, at / nx % ny, at / (nx * ny)].map(|n| n as f64);
            let p = phantom_from_unit(DVec3::from_array(voxel) / last);
            #[expect(clippy::cast_possible_truncation, reason = "lengths of some 100 mm")]
            let v = shape.value(p) as f32;
            v
        })
        .collect()
}

/// The phantom's box, stretched to the grid: x lateral, y anterior, z superior.
fn whole_bone(unit: DVec3) -> DVec3 {
    let (lo, hi) = BOX;
    lo + (hi - lo) * DVec3::new(unit.y, unit.z, unit.x)
}

/// A box of 23 × 38 × 41 mm about the joint face, the same axes.
fn joint(unit: DVec3) -> DVec3 {
    const LO: DVec3 = DVec3::new(-19.0, -20.5, -19.0);
    const SIZE: DVec3 = DVec3::new(38.0, 41.0, 23.0);
    LO + SIZE * DVec3::new(unit.y, unit.z, unit.x)
}
