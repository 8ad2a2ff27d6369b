//! Trilinear reading of the bone's fields at a point.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    reason = "indices are checked against the lattice, whose edges are below 4096, before each cast"
)]

use crate::bone::Bone;
use crate::cut::{Cut, UNCUT};
use crate::grid::{CHUNK, voxel_in_chunk};
use glam::{DVec3, Vec3};

/// Both distance fields at a point, each interpolated separately.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fields {
    /// Distance to the bone's surface, mm, positive inside, saturated at ± band.
    pub solid: f32,
    /// Distance to what was cut, mm, positive outside the cut, saturated at ± band.
    pub cut: f32,
    /// Gradient of the smaller of the two, mm/mm, bone frame: points into the bone.
    pub gradient: Vec3,
}

impl Fields {
    /// Signed distance into what is left of the bone, mm: positive inside.
    pub fn depth(&self) -> f32 {
        self.solid.min(self.cut)
    }
}

/// The cell around a point: lowest corner (may lie outside the lattice) and fraction in [0, 1).
#[derive(Debug, Clone, Copy)]
struct Cell {
    corner: [i64; 3],
    fraction: Vec3,
}

fn cell(bone: &Bone, p_in_bone: DVec3) -> Option<Cell> {
    let index = p_in_bone / bone.grid().spacing_mm;
    // far outside, or NaN: no corner to read
    if index.is_nan() || index.abs().max_element() >= 1e6 {
        return None;
    }
    let floor = index.floor();
    Some(Cell {
        corner: floor.to_array().map(|v| v as i64),
        fraction: (index - floor).as_vec3(),
    })
}

/// Calls `read(corner number, place)` for the eight corners; place is `None` where no chunk is.
fn for_corners(bone: &Bone, cell: &Cell, mut read: impl FnMut(usize, Option<(usize, usize)>)) {
    let [i, j, k] = cell.corner;
    let dims = bone.grid().dims.map(|n| n as i64);
    let mask = CHUNK as i64 - 1;
    let one_chunk = [i, j, k]
        .iter()
        .zip(dims)
        .all(|(&v, n)| v >= 0 && v + 1 < n && (v & mask) != mask);
    if one_chunk {
        let at = [i, j, k].map(|v| v as usize);
        let chunk = bone.chunk_at(at.map(|v| v / CHUNK));
        let [x, y, z] = at.map(|v| v % CHUNK);
        for corner in 0..8 {
            let (dx, dy, dz) = (corner & 1, (corner >> 1) & 1, corner >> 2);
            read(
                corner,
                chunk.map(|c| (c, voxel_in_chunk(x + dx, y + dy, z + dz))),
            );
        }
        return;
    }
    for corner in 0..8 {
        let at = [
            i + (corner as i64 & 1),
            j + ((corner as i64 >> 1) & 1),
            k + (corner as i64 >> 2),
        ];
        let inside = (0..3).all(|a| at[a] >= 0 && at[a] < dims[a]);
        read(
            corner,
            if inside {
                bone.locate(at.map(|v| v as usize))
            } else {
                None
            },
        );
    }
}

fn trilinear(v: &[f32; 8], f: Vec3) -> f32 {
    let x = [0, 2, 4, 6].map(|c| v[c] + f.x * (v[c + 1] - v[c]));
    let y = [x[0] + f.y * (x[1] - x[0]), x[2] + f.y * (x[3] - x[2])];
    y[0] + f.z * (y[1] - y[0])
}

// derivative of the trilinear form by the cell's fraction
fn trilinear_gradient(v: &[f32; 8], f: Vec3) -> Vec3 {
    let lerp2 = |a: f32, b: f32, c: f32, d: f32, s: f32, t: f32| {
        let low = a + s * (b - a);
        let high = c + s * (d - c);
        low + t * (high - low)
    };
    Vec3::new(
        lerp2(v[1] - v[0], v[3] - v[2], v[5] - v[4], v[7] - v[6], f.y, f.z),
        lerp2(v[2] - v[0], v[3] - v[1], v[6] - v[4], v[7] - v[5], f.x, f.z),
        lerp2(v[4] - v[0], v[5] - v[1], v[6] - v[2], v[7] - v[3], f.x, f.y),
    )
}

/// Both distance fields and the gradient at a point of the bone frame (mm). Outside the kept
/// chunks, and for a NaN, the bone is one band away.
pub fn fields(bone: &Bone, cut: &Cut, p_in_bone: DVec3) -> Fields {
    let grid = bone.grid();
    let band = grid.band_mm() as f32;
    let outside = Fields {
        solid: -band,
        cut: band,
        gradient: Vec3::ZERO,
    };
    let Some(cell) = cell(bone, p_in_bone) else {
        return outside;
    };
    let quantum = grid.quantum_mm();
    let mut solid = [-f32::from(i16::MAX); 8];
    let mut removed = [f32::from(UNCUT); 8];
    for_corners(bone, &cell, |corner, place| {
        if let Some((chunk, voxel)) = place {
            solid[corner] = f32::from(bone.chunk(chunk).solid[voxel]);
            removed[corner] = f32::from(cut.value(chunk, voxel));
        }
    });
    let s = trilinear(&solid, cell.fraction) * quantum;
    let c = trilinear(&removed, cell.fraction) * quantum;
    let smaller = if s <= c { &solid } else { &removed };
    let per_cell = trilinear_gradient(smaller, cell.fraction) * quantum;
    Fields {
        solid: s,
        cut: c,
        gradient: per_cell / grid.spacing_mm.as_vec3(),
    }
}

/// What the bone is made of at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matter {
    /// CT number, HU.
    pub hu: f32,
    /// [`crate::tissue::Tissue`] of the nearest voxel.
    pub class: u8,
}

/// Density and class at a point of the bone frame (mm); `None` outside the solid bone of the CT
/// (whatever has been cut since).
pub fn matter(bone: &Bone, p_in_bone: DVec3) -> Option<Matter> {
    let cell = cell(bone, p_in_bone)?;
    let nearest = usize::from(cell.fraction.x >= 0.5)
        | usize::from(cell.fraction.y >= 0.5) << 1
        | usize::from(cell.fraction.z >= 0.5) << 2;
    let mut solid = [-f32::from(i16::MAX); 8];
    let mut density = [-1000.0; 8];
    let mut class = 0;
    for_corners(bone, &cell, |corner, place| {
        if let Some((chunk, voxel)) = place {
            let data = bone.chunk(chunk);
            solid[corner] = f32::from(data.solid[voxel]);
            density[corner] = f32::from(data.density_hu[voxel]);
            if corner == nearest {
                class = data.class[voxel];
            }
        }
    });
    (trilinear(&solid, cell.fraction) > 0.0).then(|| Matter {
        hu: trilinear(&density, cell.fraction),
        class,
    })
}
