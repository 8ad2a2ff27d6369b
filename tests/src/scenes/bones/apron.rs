//! A chunk's values with one voxel around it.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 as in every field"
)]

use super::Body;
use glam::DVec3;
use osteon_sim_core::grid::{BRICK, CHUNK, Grid};

/// Edge of a chunk with its one-voxel apron.
pub(super) const APRON: usize = CHUNK + 2;

/// Place of a value in [`Apron::values`]; 1 is the chunk's first voxel.
pub(super) fn apron_index([x, y, z]: [usize; 3]) -> usize {
    (z * APRON + y) * APRON + x
}

/// The body's values in a chunk and its apron, made brick by brick as they are needed. NaN: not in the
/// lattice, or not made yet.
pub(super) struct Apron<'a, B> {
    pub(super) grid: &'a Grid,
    pub(super) body: &'a B,
    coord: [u16; 3],
    pub(super) values: Vec<f32>,
}

impl<'a, B: Body> Apron<'a, B> {
    pub(super) fn new(grid: &'a Grid, body: &'a B, coord: [u16; 3]) -> Self {
        Self {
            grid,
            body,
            coord,
            values: vec![f32::NAN; APRON * APRON * APRON],
        }
    }

    /// Bone-frame position of a place in the apron's own coordinates (1 is the chunk's first voxel).
    pub(super) fn centre(&self, at: [usize; 3]) -> DVec3 {
        let lo = self.coord.map(|c| usize::from(c) * CHUNK);
        // signed: the lattice's first apron lies at -1
        let index: [f64; 3] = std::array::from_fn(|a| (lo[a] + at[a]) as f64 - 1.0);
        DVec3::from_array(index) * self.grid.spacing_mm
    }

    fn in_lattice(&self, at: [usize; 3]) -> bool {
        (0..3).all(|a| {
            let v = usize::from(self.coord[a]) * CHUNK + at[a];
            (1..=self.grid.dims[a]).contains(&v)
        })
    }

    /// Makes the values of a brick and its apron; whether one of them is inside the band.
    pub(super) fn fill(&mut self, brick: [usize; 3]) -> bool {
        let h = self.grid.spacing_mm;
        let band = self.grid.band_mm();
        let middle = self.centre(brick.map(|n| n + 1)) + h * (0.5 * (BRICK - 1) as f64);
        let value = self.body.value(middle);
        let reach = self.body.lipschitz() * 0.5 * (BRICK + 1) as f64 * h.length();
        if value < -reach - self.body.lipschitz() * band {
            return false;
        }
        // deep inside: the distance is saturated and the tissue does not depend on it
        let deep = value > reach + (self.body.lipschitz() * band).max(self.body.layers_mm());
        let mut near = false;
        for z in brick[2]..brick[2] + BRICK + 2 {
            for y in brick[1]..brick[1] + BRICK + 2 {
                for x in brick[0]..brick[0] + BRICK + 2 {
                    let at = [x, y, z];
                    if !self.in_lattice(at) {
                        continue;
                    }
                    let i = apron_index(at);
                    if self.values[i].is_nan() {
                        let v = if deep {
                            value - reach
                        } else {
                            self.body.value(self.centre(at))
                        };
                        self.values[i] = v as f32;
                    }
                    near |= self.values[i] > -band as f32;
                }
            }
        }
        near
    }
}
