//! Trilinear reading of the bone's fields at a point.

use crate::bone::Bone;
use crate::cut::{Cut, UNCUT};
use crate::grid::{BRICK_VOXELS, CHUNK, CHUNK_VOXELS, voxel_in_chunk};
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

/// What the bone is made of at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matter {
    /// CT number, HU.
    pub hu: f32,
    /// [`crate::tissue::Tissue`] of the nearest voxel.
    pub class: u8,
}

/// Reads one bone and its cut at many points. Positions are in the bone frame, mm; outside the kept
/// chunks, and for a NaN, the bone is one band away.
#[derive(Debug, Clone, Copy)]
pub struct Sampler<'a> {
    bone: &'a Bone,
    cut: &'a Cut,
    per_mm: DVec3,
    dims: [u32; 3],
    quantum_mm: f32,
}

/// A cell whose eight corners lie in one chunk: all but those on a chunk's far faces and at the
/// lattice's edges.
struct Inner {
    chunk: usize,
    // offset of the lowest corner, and what a step along each axis adds
    base: usize,
    step: [usize; 3],
}

/// What is read where no chunk is.
const NO_SOLID: f32 = -(i16::MAX as f32);
const NO_CUT: f32 = UNCUT as f32;
const NO_DENSITY: f32 = -1000.0;

/// Indices run from −SHIFT: added before a cast that only knows how to cut off.
const SHIFT: f64 = 8192.0;
/// Every field is saturated farther out than this many voxels.
const FAR: f64 = 8000.0;
const OFFSETS: [[usize; CHUNK]; 3] = offsets();

// a voxel's offset is the sum of one number for each coordinate
const fn offsets() -> [[usize; CHUNK]; 3] {
    let mut table = [[0; CHUNK]; 3];
    let mut i = 0;
    while i < CHUNK {
        table[0][i] = voxel_in_chunk(i, 0, 0);
        table[1][i] = voxel_in_chunk(0, i, 0);
        table[2][i] = voxel_in_chunk(0, 0, i);
        i += 1;
    }
    table
}

impl<'a> Sampler<'a> {
    /// A reader of `bone` and `cut`.
    #[expect(clippy::cast_possible_truncation, reason = "edges are at most 4096")]
    pub fn new(bone: &'a Bone, cut: &'a Cut) -> Self {
        let grid = bone.grid();
        Self {
            bone,
            cut,
            per_mm: grid.spacing_mm.recip(),
            dims: grid.dims.map(|n| n as u32),
            quantum_mm: grid.quantum_mm(),
        }
    }

    /// Lowest corner, as a number that wraps below zero, and fraction; `None` far outside.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "checked against ± FAR before"
    )]
    #[inline]
    fn corner(&self, p_in_bone: DVec3) -> Option<([u32; 3], Vec3)> {
        let index = p_in_bone * self.per_mm;
        // a NaN fails this, too
        let near = |v: f64| v > -FAR && v < FAR;
        if !(near(index.x) && near(index.y) && near(index.z)) {
            return None;
        }
        let split = |v: f64| {
            let floor = (v + SHIFT) as i32 - SHIFT as i32;
            ((v - f64::from(floor)) as f32, floor as u32)
        };
        let ((fx, i), (fy, j), (fz, k)) = (split(index.x), split(index.y), split(index.z));
        Some(([i, j, k], Vec3::new(fx, fy, fz)))
    }

    #[inline]
    fn inner(&self, [i, j, k]: [u32; 3]) -> Option<Inner> {
        const MASK: u32 = 31;
        const { assert!(MASK as usize == CHUNK - 1) };
        // one below the lattice has wrapped to a large number
        let fits = |v: u32, n: u32| v < n - 1 && v & MASK != MASK;
        let [nx, ny, nz] = self.dims;
        if !(fits(i, nx) && fits(j, ny) && fits(k, nz)) {
            return None;
        }
        let (i, j, k) = (i as usize, j as usize, k as usize);
        let chunk = self.bone.chunk_at([i / CHUNK, j / CHUNK, k / CHUNK])?;
        let (x, y, z) = (i % CHUNK, j % CHUNK, k % CHUNK);
        let next = |table: &[usize; CHUNK], v: usize| table[(v + 1) % CHUNK] - table[v];
        Some(Inner {
            chunk,
            base: OFFSETS[0][x] + OFFSETS[1][y] + OFFSETS[2][z],
            step: [
                next(&OFFSETS[0], x),
                next(&OFFSETS[1], y),
                next(&OFFSETS[2], z),
            ],
        })
    }

    /// The corners one by one: at a chunk's border.
    #[cold]
    fn scattered(&self, corner: [u32; 3]) -> [Option<(usize, usize)>; 8] {
        [0, 1, 2, 3, 4, 5, 6, 7u32].map(|c| {
            let step = [c & 1, (c >> 1) & 1, c >> 2];
            let at = [0, 1, 2].map(|a| corner[a].wrapping_add(step[a]));
            let inside = (0..3).all(|a| at[a] < self.dims[a]);
            inside
                .then(|| self.bone.locate(at.map(|v| v as usize)))
                .flatten()
        })
    }

    /// Solid and cut values at the corners of a cell, in stored units.
    #[inline]
    fn distances(&self, corner: [u32; 3]) -> [[f32; 8]; 2] {
        if let Some(cell) = self.inner(corner) {
            let (touched, values) = self.cut.stored(cell.chunk);
            let cut = cell.read_touched(touched, values);
            return [cell.read(self.bone.solid(cell.chunk)), cut];
        }
        let places = self.scattered(corner);
        let solid = |(chunk, voxel): (usize, usize)| f32::from(self.bone.solid(chunk)[voxel]);
        let cut = |(chunk, voxel)| f32::from(self.cut.value(chunk, voxel));
        [
            places.map(|place| place.map_or(NO_SOLID, solid)),
            places.map(|place| place.map_or(NO_CUT, cut)),
        ]
    }

    fn outside(&self) -> Fields {
        #[expect(clippy::cast_possible_truncation, reason = "millimetres")]
        let band = self.bone.grid().band_mm() as f32;
        Fields {
            solid: -band,
            cut: band,
            gradient: Vec3::ZERO,
        }
    }

    /// Signed distance into what is left of the bone, mm ([`Fields::depth`]).
    #[inline]
    pub fn depth(&self, p_in_bone: DVec3) -> f32 {
        let (solid, cut) = self.both(p_in_bone);
        solid.min(cut)
    }

    /// Distance to the bone's surface as it was, positive inside, and to what was cut, positive outside the
    /// cut; mm.
    #[inline]
    pub fn both(&self, p_in_bone: DVec3) -> (f32, f32) {
        let Some((corner, fraction)) = self.corner(p_in_bone) else {
            let outside = self.outside();
            return (outside.solid, outside.cut);
        };
        let [solid, cut] = self.distances(corner);
        let solid = trilinear(&solid, fraction) * self.quantum_mm;
        let cut = trilinear(&cut, fraction) * self.quantum_mm;
        (solid, cut)
    }

    /// Both distances and the gradient.
    pub fn fields(&self, p_in_bone: DVec3) -> Fields {
        let Some((corner, fraction)) = self.corner(p_in_bone) else {
            return self.outside();
        };
        let [solid, cut] = self.distances(corner);
        let s = trilinear(&solid, fraction) * self.quantum_mm;
        let c = trilinear(&cut, fraction) * self.quantum_mm;
        let smaller = if s <= c { &solid } else { &cut };
        let per_cell = trilinear_gradient(smaller, fraction) * self.quantum_mm;
        Fields {
            solid: s,
            cut: c,
            gradient: per_cell * self.per_mm.as_vec3(),
        }
    }

    /// Density and class; `None` outside the solid bone of the CT (whatever has been cut since).
    #[inline]
    pub fn matter(&self, p_in_bone: DVec3) -> Option<Matter> {
        let (corner, f) = self.corner(p_in_bone)?;
        let Some(cell) = self.inner(corner) else {
            return self.matter_at_border(corner, f);
        };
        if trilinear(&cell.read(self.bone.solid(cell.chunk)), f) <= 0.0 {
            return None;
        }
        let nearest = cell.offset(nearest(f));
        Some(Matter {
            hu: trilinear(&cell.read(self.bone.density(cell.chunk)), f),
            class: self.bone.class(cell.chunk)[nearest % CHUNK_VOXELS],
        })
    }

    #[cold]
    fn matter_at_border(&self, corner: [u32; 3], f: Vec3) -> Option<Matter> {
        let places = self.scattered(corner);
        let solid = |(chunk, voxel): (usize, usize)| f32::from(self.bone.solid(chunk)[voxel]);
        let density = |(chunk, voxel): (usize, usize)| f32::from(self.bone.density(chunk)[voxel]);
        let solid = places.map(|place| place.map_or(NO_SOLID, solid));
        (trilinear(&solid, f) > 0.0).then(|| Matter {
            hu: trilinear(&places.map(|place| place.map_or(NO_DENSITY, density)), f),
            class: places[nearest(f)].map_or(0, |(chunk, voxel)| self.bone.class(chunk)[voxel]),
        })
    }
}

/// Number of the corner that is nearest.
fn nearest(f: Vec3) -> usize {
    usize::from(f.x >= 0.5) | usize::from(f.y >= 0.5) << 1 | usize::from(f.z >= 0.5) << 2
}

impl Inner {
    #[inline]
    fn offset(&self, corner: usize) -> usize {
        let [dx, dy, dz] = self.step;
        self.base + (corner & 1) * dx + ((corner >> 1) & 1) * dy + (corner >> 2) * dz
    }

    /// The same of bricks that may not be touched.
    #[inline]
    fn read_touched(&self, touched: u64, values: &[i16]) -> [f32; 8] {
        let Some(values) = values.first_chunk::<CHUNK_VOXELS>() else {
            return [NO_CUT; 8];
        };
        if touched == 0 {
            return [NO_CUT; 8];
        }
        let v = |c: usize| {
            let at = self.offset(c) % CHUNK_VOXELS;
            let counts = touched >> (at / BRICK_VOXELS) & 1 != 0;
            f32::from(if counts { values[at] } else { UNCUT })
        };
        [v(0), v(1), v(2), v(3), v(4), v(5), v(6), v(7)]
    }

    #[inline]
    fn read(&self, values: &[i16]) -> [f32; 8] {
        // one check instead of eight
        let Some(values) = values.first_chunk::<CHUNK_VOXELS>() else {
            return [NO_SOLID; 8];
        };
        let v = |c: usize| f32::from(values[self.offset(c) % CHUNK_VOXELS]);
        [v(0), v(1), v(2), v(3), v(4), v(5), v(6), v(7)]
    }
}

#[inline]
fn trilinear(v: &[f32; 8], f: Vec3) -> f32 {
    let lerp = |a: f32, b: f32, t: f32| a + t * (b - a);
    let low = lerp(lerp(v[0], v[1], f.x), lerp(v[2], v[3], f.x), f.y);
    let high = lerp(lerp(v[4], v[5], f.x), lerp(v[6], v[7], f.x), f.y);
    lerp(low, high, f.z)
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

/// [`Sampler::fields`] at a single point.
pub fn fields(bone: &Bone, cut: &Cut, p_in_bone: DVec3) -> Fields {
    Sampler::new(bone, cut).fields(p_in_bone)
}
