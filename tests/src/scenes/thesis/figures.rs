//! The figures of Tables 3.1 and 3.2 for a stand-in, counted.

use super::{ACTIVE_HU, StandIn};
use osteon_firmware_bridge::scene::SceneError;
use osteon_firmware_bridge::scene::resample;
use osteon_sim_core::grid::Grid;
use rayon::prelude::*;

/// Chunks of one size over a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chunks {
    /// Voxels along a chunk's edge.
    pub edge: usize,
    /// Chunks along x, y, z.
    pub dims: [usize; 3],
    /// Chunks with an active voxel.
    pub active: usize,
}

/// What can be counted about a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Spacing, mm.
    pub spacing_mm: [f64; 3],
    /// Voxels.
    pub voxels: usize,
    /// Voxels of at least [`ACTIVE_HU`].
    pub active: usize,
    /// Bytes of the dense grid at 2 B a voxel.
    pub dense_bytes: usize,
    /// Chunks of 16³, 32³ and 64³.
    pub chunks: [Chunks; 3],
}

impl Chunks {
    /// Chunks in all.
    pub fn total(&self) -> usize {
        self.dims.iter().product()
    }

    /// Bytes of the active chunks at 2 B a voxel.
    pub fn active_bytes(&self) -> usize {
        self.active * self.edge.pow(3) * 2
    }
}

impl Figures {
    /// Active voxels of all voxels.
    pub fn active_ratio(&self) -> f64 {
        self.active as f64 / self.voxels as f64
    }
}

/// Counts a volume.
pub fn figures(volume: &StandIn) -> Figures {
    let grid = &volume.grid;
    let is_active = |hu: &&i16| **hu >= ACTIVE_HU;
    Figures {
        dims: grid.dims,
        spacing_mm: grid.spacing_mm.to_array(),
        voxels: grid.len(),
        active: volume.density_hu.par_iter().filter(is_active).count(),
        dense_bytes: grid.len() * 2,
        chunks: [16, 32, 64].map(|edge| chunks(volume, edge)),
    }
}

fn chunks(volume: &StandIn, edge: usize) -> Chunks {
    let grid: &Grid = &volume.grid;
    let dims = grid.dims.map(|n| n.div_ceil(edge));
    let holds = |n: &usize| {
        let chunk = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
        let lo = chunk.map(|c| c * edge);
        let hi: [usize; 3] = core::array::from_fn(|a| (lo[a] + edge).min(grid.dims[a]));
        (lo[2]..hi[2]).any(|k| {
            (lo[1]..hi[1]).any(|j| {
                let row = grid.dense_index(0, j, k);
                volume.density_hu[row + lo[0]..row + hi[0]]
                    .iter()
                    .any(|&hu| hu >= ACTIVE_HU)
            })
        })
    };
    let active = (0..dims.iter().product())
        .into_par_iter()
        .filter(holds)
        .count();
    Chunks { edge, dims, active }
}

/// The volume on cubes of its x spacing (the thesis's Alg. 2.5), by this program's one way to
/// resample; a volume of cubes as it is.
pub fn cubes(volume: &StandIn) -> Result<StandIn, SceneError> {
    let edge = volume.grid.spacing_mm.x;
    if (volume.grid.spacing_mm - edge).abs().max_element() < 1e-9 {
        return Ok(volume.clone());
    }
    let grid = resample::resampled_grid(&volume.grid, edge)?;
    let hu: Vec<f32> = volume
        .density_hu
        .par_iter()
        .map(|&v| f32::from(v))
        .collect();
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the cubic may overshoot; the cast saturates"
    )]
    let density_hu = resample::cubic(&volume.grid, &hu, &grid)
        .into_par_iter()
        .map(|v| v.round() as i16)
        .collect();
    Ok(StandIn { grid, density_hu })
}
