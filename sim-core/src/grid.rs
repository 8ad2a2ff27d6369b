//! The voxel lattice: dimensions, spacing, chunks of 32³, bricks of 8³, lines of 4×4×2.
//!
//! Bone frame: millimetres, right-handed, axes along the lattice, origin at the centre of voxel
//! (0, 0, 0); the centre of voxel (i, j, k) lies at (i·hx, j·hy, k·hz).
#![expect(
    clippy::cast_possible_truncation,
    reason = "clamped before the cast; f64 spacings become f32"
)]

use glam::DVec3;

/// Voxels along one edge of a chunk.
pub const CHUNK: usize = 32;
/// Voxels along one edge of a brick, the unit of updates.
pub const BRICK: usize = 8;
/// Voxels of a chunk.
pub const CHUNK_VOXELS: usize = CHUNK * CHUNK * CHUNK;
/// Voxels of a brick.
pub const BRICK_VOXELS: usize = BRICK * BRICK * BRICK;
/// Bricks of a chunk; one bit each in a `u64`.
pub const BRICKS_PER_CHUNK: usize = 64;
/// Voxels of a line: 4×4×2, whose stored distances fill one cache line of 64 bytes.
pub const LINE_VOXELS: usize = 32;
/// Lines of a brick; one bit each in a `u16`.
pub const LINES_PER_BRICK: usize = 16;
/// Lines of a chunk.
pub const LINES_PER_CHUNK: usize = LINES_PER_BRICK * BRICKS_PER_CHUNK;
/// Longest allowed edge of a lattice, voxels.
pub const MAX_DIM: usize = 4096;

/// Why a lattice was refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GridError {
    /// A dimension is 0 or above [`MAX_DIM`].
    Dimension(usize),
    /// A spacing is not finite, not positive, or outside 0.01–20 mm.
    Spacing(f64),
}

impl core::fmt::Display for GridError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Dimension(n) => write!(f, "a dimension of {n} voxels (allowed: 1 to {MAX_DIM})"),
            Self::Spacing(h) => write!(f, "a voxel spacing of {h} mm (allowed: 0.01 to 20)"),
        }
    }
}

impl core::error::Error for GridError {}

/// Dimensions and spacing of a voxel lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Voxels along x, y, z; each in 1..=[`MAX_DIM`].
    pub dims: [usize; 3],
    /// Distance of neighbouring voxel centres, mm; may differ per axis.
    pub spacing_mm: DVec3,
}

impl Grid {
    /// Checks and makes a lattice.
    pub fn new(dims: [usize; 3], spacing_mm: DVec3) -> Result<Self, GridError> {
        for n in dims {
            if n == 0 || n > MAX_DIM {
                return Err(GridError::Dimension(n));
            }
        }
        for h in spacing_mm.to_array() {
            if !(0.01..=20.0).contains(&h) {
                return Err(GridError::Spacing(h));
            }
        }
        Ok(Self { dims, spacing_mm })
    }

    /// Voxels in all.
    pub fn len(&self) -> usize {
        self.dims[0] * self.dims[1] * self.dims[2]
    }

    /// Never true: a lattice has at least one voxel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Offset of voxel (i, j, k) in a dense array, x fastest.
    pub fn dense_index(&self, i: usize, j: usize, k: usize) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    /// The band: the diagonal of a cell (the box between eight neighbouring voxels), mm. Both distance fields saturate at ± this value; every
    /// cell that the surface crosses has all its eight corners inside the band.
    pub fn band_mm(&self) -> f64 {
        self.spacing_mm.length()
    }

    /// Mean of the squared spacings, mm².
    pub fn mean_square_spacing(&self) -> f64 {
        self.spacing_mm.length_squared() / 3.0
    }

    /// Millimetres of one unit of a stored distance (`i16`, ±32767 = ± band).
    pub fn quantum_mm(&self) -> f32 {
        (self.band_mm() / f64::from(i16::MAX)) as f32
    }

    /// Volume of one voxel, mm³.
    pub fn voxel_mm3(&self) -> f64 {
        self.spacing_mm.x * self.spacing_mm.y * self.spacing_mm.z
    }

    /// Chunks along x, y, z.
    pub fn chunk_dims(&self) -> [usize; 3] {
        let [x, y, z] = self.dims;
        [x.div_ceil(CHUNK), y.div_ceil(CHUNK), z.div_ceil(CHUNK)]
    }

    /// Centre of voxel (i, j, k) in the bone frame, mm.
    pub fn centre(&self, i: usize, j: usize, k: usize) -> DVec3 {
        DVec3::new(i as f64, j as f64, k as f64) * self.spacing_mm
    }

    /// A stored distance from millimetres: clamped to the band, rounded to the nearest unit; a NaN
    /// becomes "far outside".
    pub fn quantise(&self, distance_mm: f32) -> i16 {
        let units = distance_mm / self.quantum_mm();
        if units.is_nan() {
            return -i16::MAX;
        }
        // clamped first: the cast cannot wrap
        units.round().clamp(-32767.0, 32767.0) as i16
    }
}

/// Offset of a voxel inside its chunk's arrays: brick after brick (x fastest), in a brick line after
/// line (x fastest), in a line x, then z, then y. So a brick's 512 values and a line's 32 are each one
/// contiguous run, and a line's two layers interleave the way that vector units pack them.
/// Arguments in `0..32`.
pub const fn voxel_in_chunk(x: usize, y: usize, z: usize) -> usize {
    let brick = ((z >> 3) * 4 + (y >> 3)) * 4 + (x >> 3);
    brick * BRICK_VOXELS + offset_in_brick([x & 7, y & 7, z & 7])
}

/// Offset in its brick's values of a voxel inside the brick (each in `0..8`).
pub const fn offset_in_brick([x, y, z]: [usize; 3]) -> usize {
    let line = (z >> 1) * 4 + (y >> 2) * 2 + (x >> 2);
    let lane = (y & 3) * 8 + (z & 1) * 4 + (x & 3);
    line * LINE_VOXELS + lane
}

/// The voxel inside its brick at offset `local` (in `0..512`) of the brick's values: the inverse of
/// [`offset_in_brick`].
pub fn voxel_in_brick(local: usize) -> [usize; 3] {
    let (line, lane) = (local / LINE_VOXELS, local % LINE_VOXELS);
    let o = line_origin(line);
    [
        o[0] + (lane & 3),
        o[1] + (lane >> 3),
        o[2] + ((lane >> 2) & 1),
    ]
}

/// Lowest voxel of line `line` (in `0..16`) inside its brick.
pub fn line_origin(line: usize) -> [usize; 3] {
    [(line & 1) * 4, ((line >> 1) & 1) * 4, (line >> 2) * 2]
}

/// Lowest voxel of brick `brick` (in `0..64`) inside its chunk.
pub fn brick_origin(brick: usize) -> [usize; 3] {
    [(brick & 3) * 8, ((brick >> 2) & 3) * 8, (brick >> 4) * 8]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_voxel_has_its_own_place_in_its_brick() {
        let mut seen = vec![false; CHUNK_VOXELS];
        for z in 0..CHUNK {
            for y in 0..CHUNK {
                for x in 0..CHUNK {
                    let at = voxel_in_chunk(x, y, z);
                    assert!(!core::mem::replace(&mut seen[at], true));
                    let o = brick_origin(at / BRICK_VOXELS);
                    let inside = voxel_in_brick(at % BRICK_VOXELS);
                    assert_eq!([x, y, z], [0, 1, 2].map(|a| o[a] + inside[a]));
                }
            }
        }
    }

    #[test]
    fn quantised_distances_saturate_and_never_wrap() {
        let grid = Grid::new([1, 1, 1], DVec3::splat(0.5)).expect("valid");
        assert_eq!(grid.quantise(f32::INFINITY), i16::MAX);
        assert_eq!(grid.quantise(f32::NEG_INFINITY), -i16::MAX);
        assert_eq!(grid.quantise(f32::NAN), -i16::MAX);
        assert_eq!(grid.quantise(0.0), 0);
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(Grid::new([0, 1, 1], DVec3::ONE).is_err());
        assert!(Grid::new([1, 1, 1], DVec3::new(1.0, 0.0, 1.0)).is_err());
        assert!(Grid::new([1, 1, 1], DVec3::new(1.0, f64::NAN, 1.0)).is_err());
    }
}
