//! Bones for the reports, built chunk by chunk on all cores: the dense lattice is never held.
//!
//! The built-in scapula is an implicit function that is only *about* a distance: its gradient's length
//! lies between about 0.8 and 1.2 near the surface. It is used as it is: the zero set, which is what is
//! carved and measured, is the same, and sub-voxel smooth.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "chunk coordinates are below 4096 / 32; lattices of at most 4096 voxels an edge; f64 becomes f32 as in every field"
)]

mod apron;

use anyhow::{Context as _, Result, ensure};
use apron::{APRON, Apron, apron_index};
use glam::{DQuat, DVec3};
use osteon_firmware_bridge::scene::phantom::shape::{LIPSCHITZ, Scapula};
use osteon_firmware_bridge::scene::phantom::{BOX, CARTILAGE_MM, PLATE_MM, SHELL_MM};
use osteon_sim_core::bone::{Bone, ChunkData};
use osteon_sim_core::grid::{BRICK, CHUNK, CHUNK_VOXELS, Grid, brick_origin, voxel_in_chunk};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::{Tissue, hu_of_density};
use rayon::prelude::*;
use std::time::Instant;

/// Chunks that are in flight before they are put into the bone.
const BATCH: usize = 256;

/// A body as a distance-like function.
pub trait Body: Sync {
    /// Distance-like value, mm, positive inside, at a point of the bone frame.
    fn value(&self, p: DVec3) -> f64;
    /// Upper bound of the value's gradient.
    fn lipschitz(&self) -> f64;
    /// Tissue at a point inside, whose value is `value` (above [`Self::layers_mm`] it may be a lower
    /// bound instead).
    fn tissue(&self, p: DVec3, value: f64) -> Tissue;
    /// Depth in units of the value below which tissue no longer depends on it.
    fn layers_mm(&self) -> f64;
}

/// A bone for a report.
#[derive(Debug)]
pub struct BuiltBone {
    /// The bone.
    pub bone: Bone,
    /// Where the plan lies: origin on the surface, z outward.
    pub bone_from_plan: Pose,
    /// Voxels whose centre is inside.
    pub solid_voxels: usize,
    /// How long it took.
    pub seconds: f64,
}

/// The built-in scapula, enlarged by `scale`, in the bone frame of its lattice.
#[derive(Debug)]
pub struct ScaledScapula {
    shape: Scapula,
    scale: f64,
}

impl Body for ScaledScapula {
    fn value(&self, p: DVec3) -> f64 {
        self.shape.value(self.in_phantom(p)) * self.scale
    }

    fn lipschitz(&self) -> f64 {
        LIPSCHITZ
    }

    fn tissue(&self, p: DVec3, value: f64) -> Tissue {
        if let Some(depth) = self.shape.depth_under_face(self.in_phantom(p)) {
            if depth < CARTILAGE_MM {
                return Tissue::Cartilage;
            }
            if depth < CARTILAGE_MM + PLATE_MM {
                return Tissue::Subchondral;
            }
        }
        if value < SHELL_MM * self.scale {
            return Tissue::Cortical;
        }
        Tissue::Cancellous
    }

    fn layers_mm(&self) -> f64 {
        SHELL_MM * self.scale
    }
}

impl ScaledScapula {
    /// The scapula at `scale` times its natural size.
    pub fn new(scale: f64) -> Self {
        Self {
            shape: Scapula::default(),
            scale,
        }
    }

    fn in_phantom(&self, p: DVec3) -> DVec3 {
        BOX.0 + p / self.scale
    }
}

/// A flat plate: bone between `top - thickness` and `top`.
#[derive(Debug)]
pub struct Plate {
    /// Height of its upper face, mm.
    pub top: f64,
    /// Its thickness, mm.
    pub thickness: f64,
}

impl Body for Plate {
    fn value(&self, p: DVec3) -> f64 {
        (self.top - p.z).min(p.z - self.top + self.thickness)
    }

    fn lipschitz(&self) -> f64 {
        1.0
    }

    fn tissue(&self, p: DVec3, _value: f64) -> Tissue {
        match self.top - p.z {
            d if d < 1.8 => Tissue::Cartilage,
            d if d < 3.8 => Tissue::Subchondral,
            _ => Tissue::Cancellous,
        }
    }

    fn layers_mm(&self) -> f64 {
        0.0
    }
}

/// The built-in scapula with voxels of `voxel_mm`, enlarged by `scale`.
pub fn scapula(voxel_mm: f64, scale: f64) -> Result<BuiltBone> {
    let extent = (BOX.1 - BOX.0) * scale;
    let dims = (extent / voxel_mm)
        .ceil()
        .to_array()
        .map(|n| n as usize + 1);
    let grid = Grid::new(dims, DVec3::splat(voxel_mm)).context("the scapula's lattice")?;
    let plan = Pose::new(DQuat::IDENTITY, -BOX.0 * scale);
    build(grid, plan, &ScaledScapula::new(scale))
}

/// A flat plate of `extent` mm in a lattice of `spacing`, its face 4 mm below the lattice's upper side
/// and off the lattice; the plan lies in the middle of the face.
pub fn block(extent: DVec3, spacing: DVec3) -> Result<BuiltBone> {
    let dims = (extent / spacing).to_array().map(|n| n as usize + 1);
    let grid = Grid::new(dims, spacing).context("the block's lattice")?;
    let top = extent.z - 4.1 + 0.13 * spacing.z;
    let middle = DVec3::new(0.5 * extent.x + 0.07, 0.5 * extent.y - 0.11, top);
    let body = Plate {
        top,
        thickness: 1e4,
    };
    build(grid, Pose::new(DQuat::IDENTITY, middle), &body)
}

/// Builds a bone of a body. Chunks that the body's bound on the gradient proves empty are skipped.
pub fn build(grid: Grid, bone_from_plan: Pose, body: &impl Body) -> Result<BuiltBone> {
    let start = Instant::now();
    let [cx, cy, cz] = grid.chunk_dims();
    let coords: Vec<[u16; 3]> = (0..cz)
        .flat_map(|z| (0..cy).flat_map(move |y| (0..cx).map(move |x| [x, y, z].map(|n| n as u16))))
        .collect();
    let coords: Vec<[u16; 3]> = coords
        .into_par_iter()
        .filter(|&c| may_hold_bone(&grid, body, c))
        .collect();
    let mut bone = Bone::new(grid, Pose::IDENTITY);
    let mut solid_voxels = 0;
    for batch in coords.chunks(BATCH) {
        let chunks: Vec<Option<Chunk>> = batch
            .par_iter()
            .map(|&c| Chunk::new(&grid, body, c))
            .collect();
        for (&coord, chunk) in batch.iter().zip(chunks) {
            if let Some(chunk) = chunk {
                solid_voxels += chunk.solid_voxels();
                bone.push_chunk(coord, chunk.bony, &chunk.data())
                    .context("a chunk of a bone")?;
            }
        }
    }
    ensure!(solid_voxels > 0, "no voxel of the bone is solid");
    // as when a session loads a bone
    bone.index_lines();
    Ok(BuiltBone {
        bone,
        bone_from_plan,
        solid_voxels,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// False where the gradient's bound proves that chunk and apron are outside the band.
fn may_hold_bone(grid: &Grid, body: &impl Body, coord: [u16; 3]) -> bool {
    let h = grid.spacing_mm;
    let half = 0.5 * (APRON - 1) as f64;
    let middle = origin(grid, coord) + h * (0.5 * (CHUNK - 1) as f64);
    body.value(middle) > -body.lipschitz() * (half * h.length() + grid.band_mm())
}

fn origin(grid: &Grid, coord: [u16; 3]) -> DVec3 {
    let [x, y, z] = coord.map(|c| usize::from(c) * CHUNK);
    grid.centre(x, y, z)
}

/// One chunk's arrays while it is being made.
struct Chunk {
    density_hu: Vec<i16>,
    solid: Vec<i16>,
    class: Vec<u8>,
    label: Vec<u8>,
    bony: u64,
}

impl Chunk {
    /// `None` where the chunk is empty: no voxel of it or of its apron is inside the band.
    fn new(grid: &Grid, body: &impl Body, coord: [u16; 3]) -> Option<Self> {
        let mut made = Self {
            density_hu: vec![-1000; CHUNK_VOXELS],
            solid: vec![-i16::MAX; CHUNK_VOXELS],
            class: vec![0; CHUNK_VOXELS],
            label: vec![0; CHUNK_VOXELS],
            bony: 0,
        };
        let mut apron = Apron::new(grid, body, coord);
        for brick in 0..64 {
            let near = apron.fill(brick_origin(brick));
            made.bony |= u64::from(near) << brick;
            if near {
                made.brick(&apron, brick_origin(brick));
            }
        }
        (made.bony != 0).then_some(made)
    }

    fn brick(&mut self, apron: &Apron<'_, impl Body>, at: [usize; 3]) {
        let band = apron.grid.band_mm() as f32;
        for z in at[2]..at[2] + BRICK {
            for y in at[1]..at[1] + BRICK {
                for x in at[0]..at[0] + BRICK {
                    let value = apron.values[apron_index([x + 1, y + 1, z + 1])];
                    // no voxel of the lattice, or out of reach of every cell on the surface
                    if value.is_nan() || value <= -band {
                        continue;
                    }
                    let voxel = voxel_in_chunk(x, y, z);
                    let p = apron.centre([x + 1, y + 1, z + 1]);
                    let tissue = apron.body.tissue(p, f64::from(value));
                    self.solid[voxel] = apron.grid.quantise(value);
                    self.class[voxel] = tissue as u8;
                    self.density_hu[voxel] = hu(tissue);
                    self.label[voxel] = 1;
                }
            }
        }
    }

    fn solid_voxels(&self) -> usize {
        self.solid.iter().filter(|&&d| d > 0).count()
    }

    fn data(&self) -> ChunkData<'_> {
        ChunkData {
            density_hu: &self.density_hu,
            solid: &self.solid,
            class: &self.class,
            label: &self.label,
        }
    }
}

/// Density by tissue alone, HU; the reports' bones have no texture.
fn hu(tissue: Tissue) -> i16 {
    let density = match tissue {
        Tissue::Air => return -1000,
        Tissue::Cartilage => 0.10,
        Tissue::Subchondral => 1.9,
        Tissue::Cancellous => 0.45,
        Tissue::Cortical => 1.8,
    };
    hu_of_density(density).round() as i16
}

#[cfg(test)]
mod tests;
