//! The immutable bone: density, solid distance, tissue class and structure label in 32³ chunks.
#![expect(
    clippy::cast_possible_truncation,
    reason = "chunk coordinates are below 4096 / 32, chunk counts below 2^32; f64 spacings become f32"
)]

mod dense;
mod digest;

pub use dense::{DenseBone, DenseChunk, MakeChunk};

use crate::aligned::Aligned;
use crate::grid::{
    BRICK, BRICK_VOXELS, BRICKS_PER_CHUNK, CHUNK, CHUNK_VOXELS, Grid, LINE_VOXELS, LINES_PER_BRICK,
    brick_origin, line_origin, voxel_in_chunk,
};
use crate::pose::Pose;
use glam::DVec3;

/// One bit a line of 4×4×2 voxels, for each brick of a chunk.
pub type LineMasks = [u16; BRICKS_PER_CHUNK];

/// "No chunk here" in [`Bone::chunk_at`]'s table.
const ABSENT: u32 = u32::MAX;

/// The values of one chunk, each of [`CHUNK_VOXELS`] values in brick-major order
/// ([`voxel_in_chunk`]).
#[derive(Debug, Clone, Copy)]
pub struct ChunkData<'a> {
    /// CT number, HU.
    pub density_hu: &'a [i16],
    /// Signed distance, units of [`Grid::quantum_mm`], positive inside.
    pub solid: &'a [i16],
    /// Tissue class.
    pub class: &'a [u8],
    /// Structure label.
    pub label: &'a [u8],
}

/// Why a bone could not be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoneError {
    /// An array's length is not the lattice's.
    Length {
        /// Values expected.
        expected: usize,
        /// Values given.
        got: usize,
    },
    /// No voxel is solid.
    Empty,
    /// A chunk coordinate lies outside the lattice or came twice.
    Chunk([u16; 3]),
}

impl core::fmt::Display for BoneError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Length { expected, got } => {
                write!(f, "an array of {got} voxels where {expected} were expected")
            }
            Self::Empty => write!(f, "no voxel is solid"),
            Self::Chunk(c) => write!(f, "chunk {c:?} is outside the grid or came twice"),
        }
    }
}

impl core::error::Error for BoneError {}

/// The bone. Shared read-only by servo and publisher; the viewer holds its own copy.
#[derive(Debug, Clone)]
pub struct Bone {
    grid: Grid,
    lps_from_bone: Pose,
    table: Vec<u32>,
    coords: Vec<[u16; 3]>,
    bony: Vec<u64>,
    bony_lines: Vec<LineMasks>,
    mixed_lines: Vec<LineMasks>,
    line_kinds: Vec<[u8; 2]>,
    density_hu: Aligned<i16>,
    solid: Aligned<i16>,
    class: Aligned<u8>,
    label: Aligned<u8>,
}

impl Bone {
    /// An empty lattice, to be filled with [`Self::push_chunk`].
    pub fn new(grid: Grid, lps_from_bone: Pose) -> Self {
        let [cx, cy, cz] = grid.chunk_dims();
        Self {
            grid,
            lps_from_bone,
            table: vec![ABSENT; cx * cy * cz],
            coords: Vec::new(),
            bony: Vec::new(),
            bony_lines: Vec::new(),
            mixed_lines: Vec::new(),
            line_kinds: Vec::new(),
            density_hu: Aligned::default(),
            solid: Aligned::default(),
            class: Aligned::default(),
            label: Aligned::default(),
        }
    }

    fn append(&mut self, coord: [u16; 3], bony: u64, data: &ChunkData<'_>) {
        let at = self.table_index(coord.map(usize::from));
        self.table[at] = self.coords.len() as u32;
        self.coords.push(coord);
        self.bony.push(bony);
        // until the neighbours are known, every line of a bony brick may be one
        self.bony_lines.push(core::array::from_fn(|brick| {
            if bony >> brick & 1 == 1 { u16::MAX } else { 0 }
        }));
        self.mixed_lines.push(mixed_lines(data));
        let firsts = (0..CHUNK_VOXELS).step_by(LINE_VOXELS);
        self.line_kinds
            .extend(firsts.map(|at| [data.class[at], data.label[at]]));
        self.density_hu.extend(data.density_hu);
        self.solid.extend(data.solid);
        self.class.extend(data.class);
        self.label.extend(data.label);
    }

    /// Finds the lines of every chunk that can hold bone ([`Self::bony_lines`]); to be called when
    /// all chunks are there. Without it every line of a bony brick counts as one: the same cuts,
    /// more slowly.
    pub fn index_lines(&mut self) {
        for chunk in 0..self.chunk_count() {
            self.bony_lines[chunk] = self.lines_near_bone(chunk);
        }
    }

    /// The lines of a chunk with a voxel inside the band, or next to one.
    fn lines_near_bone(&self, chunk: usize) -> LineMasks {
        let near = self.near_rows(chunk);
        core::array::from_fn(|brick| {
            let b = brick_origin(brick);
            (0..LINES_PER_BRICK).fold(0, |mask, line| {
                let l = line_origin(line);
                let (x, y, z) = (b[0] + l[0], b[1] + l[1], b[2] + l[2]);
                // four voxels and one on either side; bit 0 is voxel −1
                let wanted = 0x3fu64 << x;
                let rows = (z..z + 4).flat_map(|z| (y..y + 6).map(move |y| (y, z)));
                let any = rows.fold(0, |any, (y, z)| any | near[z * APRON + y]) & wanted;
                mask | u16::from(any != 0) << line
            })
        })
    }

    /// One bit a voxel of a chunk and its one-voxel apron, set inside the band: rows of x, by y, z;
    /// everything begins at −1.
    fn near_rows(&self, chunk: usize) -> Vec<u64> {
        let coord = self.coords[chunk].map(usize::from);
        let mut rows = vec![0u64; APRON * APRON];
        for (n, row) in rows.iter_mut().enumerate() {
            let (y, z) = (n % APRON, n / APRON);
            for x in 0..APRON {
                let at = [x, y, z];
                // voxel −1 of this chunk is the last of the one before
                let voxel: [Option<usize>; 3] =
                    core::array::from_fn(|a| (coord[a] * CHUNK + at[a]).checked_sub(1));
                let [Some(i), Some(j), Some(k)] = voxel else {
                    continue;
                };
                let inner = at.iter().all(|v| (1..=CHUNK).contains(v));
                let place = if inner {
                    Some((chunk, voxel_in_chunk(x - 1, y - 1, z - 1)))
                } else {
                    self.locate([i, j, k])
                };
                let solid = place.map_or(-i16::MAX, |(c, v)| self.solid[c * CHUNK_VOXELS + v]);
                *row |= u64::from(solid > -i16::MAX) << x;
            }
        }
        rows
    }

    /// Adds one chunk as it came over the wire. `bony` is the sender's brick mask
    /// ([`Self::bony_bricks`]).
    pub fn push_chunk(
        &mut self,
        coord: [u16; 3],
        bony: u64,
        data: &ChunkData<'_>,
    ) -> Result<usize, BoneError> {
        for got in [
            data.density_hu.len(),
            data.solid.len(),
            data.class.len(),
            data.label.len(),
        ] {
            if got != CHUNK_VOXELS {
                return Err(BoneError::Length {
                    expected: CHUNK_VOXELS,
                    got,
                });
            }
        }
        let at = coord.map(usize::from);
        let dims = self.grid.chunk_dims();
        if (0..3).any(|a| at[a] >= dims[a]) || self.chunk_at(at).is_some() {
            return Err(BoneError::Chunk(coord));
        }
        let index = self.coords.len();
        self.append(coord, bony, data);
        Ok(index)
    }

    /// The lattice.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Bone frame to the patient's DICOM LPS frame, mm.
    pub fn lps_from_bone(&self) -> &Pose {
        &self.lps_from_bone
    }

    /// Number of chunks kept.
    pub fn chunk_count(&self) -> usize {
        self.coords.len()
    }

    /// Number of chunks of the whole lattice.
    pub fn chunks_total(&self) -> usize {
        self.table.len()
    }

    /// Chunk coordinate of chunk `chunk`.
    pub fn chunk_coord(&self, chunk: usize) -> [u16; 3] {
        self.coords[chunk]
    }

    /// One bit a brick: set where a voxel of the brick, or of its one-voxel apron, is inside the
    /// band. Only there can the surface run or a cut matter.
    pub fn bony_bricks(&self, chunk: usize) -> u64 {
        self.bony[chunk]
    }

    /// The same for the lines of each brick (bit = line).
    pub fn bony_lines(&self, chunk: usize) -> &LineMasks {
        &self.bony_lines[chunk]
    }

    /// Lines whose voxels are not all of one tissue class and label.
    pub(crate) fn mixed_lines(&self, chunk: usize) -> &LineMasks {
        &self.mixed_lines[chunk]
    }

    /// Tissue class and label of each line's first voxel: of all its voxels where it is not mixed.
    pub(crate) fn line_kinds(&self, chunk: usize) -> &[[u8; 2]] {
        let lines = LINES_PER_BRICK * BRICKS_PER_CHUNK;
        &self.line_kinds[chunk * lines..(chunk + 1) * lines]
    }

    /// The values of chunk `chunk`.
    pub fn chunk(&self, chunk: usize) -> ChunkData<'_> {
        let range = chunk * CHUNK_VOXELS..(chunk + 1) * CHUNK_VOXELS;
        ChunkData {
            density_hu: &self.density_hu[range.clone()],
            solid: &self.solid[range.clone()],
            class: &self.class[range.clone()],
            label: &self.label[range],
        }
    }

    /// Solid distances of one chunk, in units of [`Grid::quantum_mm`].
    pub(crate) fn solid(&self, chunk: usize) -> &[i16] {
        &self.solid[chunk * CHUNK_VOXELS..(chunk + 1) * CHUNK_VOXELS]
    }

    /// CT numbers of one chunk, HU.
    pub(crate) fn density(&self, chunk: usize) -> &[i16] {
        &self.density_hu[chunk * CHUNK_VOXELS..(chunk + 1) * CHUNK_VOXELS]
    }

    /// Tissue classes of one chunk.
    pub(crate) fn class(&self, chunk: usize) -> &[u8] {
        &self.class[chunk * CHUNK_VOXELS..(chunk + 1) * CHUNK_VOXELS]
    }

    fn table_index(&self, [x, y, z]: [usize; 3]) -> usize {
        let [cx, cy, _] = self.grid.chunk_dims();
        (z * cy + y) * cx + x
    }

    /// Index of the chunk at a chunk coordinate; `None` where it is outside or was dropped.
    pub fn chunk_at(&self, coord: [usize; 3]) -> Option<usize> {
        let [nx, ny, nz] = self.grid.chunk_dims();
        let [x, y, z] = coord;
        if x >= nx || y >= ny || z >= nz {
            return None;
        }
        let index = self.table[(z * ny + y) * nx + x];
        (index != ABSENT).then_some(index as usize)
    }

    /// Chunk index and offset of voxel (i, j, k); `None` outside the kept chunks.
    pub fn locate(&self, [i, j, k]: [usize; 3]) -> Option<(usize, usize)> {
        let chunk = self.chunk_at([i / CHUNK, j / CHUNK, k / CHUNK])?;
        Some((chunk, voxel_in_chunk(i % CHUNK, j % CHUNK, k % CHUNK)))
    }

    /// Volume of all solid voxels, mm³, by the same occupancy that counts removed volume.
    pub fn solid_mm3(&self) -> f64 {
        let occupancy = Occupancy::new(&self.grid);
        let units: i64 = self.solid.iter().map(|&d| occupancy.units(d)).sum();
        occupancy.mm3(&self.grid, units)
    }

    /// Corners of the box around all kept chunks, bone frame, mm.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let mut lo = [u16::MAX; 3];
        let mut hi = [0u16; 3];
        for coord in &self.coords {
            for a in 0..3 {
                lo[a] = lo[a].min(coord[a]);
                hi[a] = hi[a].max(coord[a] + 1);
            }
        }
        let corner = |c: [u16; 3]| {
            let v = c.map(|n| f64::from(n) * CHUNK as f64);
            DVec3::from_array(v) * self.grid.spacing_mm
        };
        (corner(lo), corner(hi))
    }
}

/// Voxels along a chunk's edge with one more on either side.
const APRON: usize = CHUNK + 2;

/// Lines of a chunk whose voxels differ in tissue class or label.
fn mixed_lines(data: &ChunkData<'_>) -> LineMasks {
    core::array::from_fn(|brick| {
        (0..LINES_PER_BRICK).fold(0, |mask, line| {
            let at = brick * BRICK_VOXELS + line * LINE_VOXELS;
            let differ = |v: &[u8]| v[at..at + LINE_VOXELS].iter().any(|&m| m != v[at]);
            mask | u16::from(differ(data.class) || differ(data.label)) << line
        })
    })
}

/// Bricks of one chunk of a dense lattice that hold a voxel inside the band, or have one next to
/// them.
fn bony_bricks(grid: &Grid, solid_mm: &[f32], coord: [u16; 3]) -> u64 {
    (0..BRICKS_PER_CHUNK).fold(0, |mask, brick| {
        let o = brick_origin(brick);
        let lo = core::array::from_fn(|a| usize::from(coord[a]) * CHUNK + o[a]);
        mask | u64::from(near_bone(grid, solid_mm, lo)) << brick
    })
}

/// Whether a voxel of the brick at `lo`, or of its one-voxel apron, is inside the band.
fn near_bone(grid: &Grid, solid_mm: &[f32], lo: [usize; 3]) -> bool {
    let from = lo.map(|v| v.saturating_sub(1));
    let to: [usize; 3] = core::array::from_fn(|a| (lo[a] + BRICK + 1).min(grid.dims[a]));
    (from[2]..to[2]).any(|k| {
        (from[1]..to[1]).any(|j| {
            (from[0]..to[0]).any(|i| grid.quantise(solid_mm[grid.dense_index(i, j, k)]) > -i16::MAX)
        })
    })
}

/// How much of a voxel a distance value stands for, in integer units, so that sums of removed
/// volume are exact and free of order, and never take from a voxel what was not removed.
///
/// A plane at signed distance *d* from the voxel's centre leaves the fraction
/// `clamp(1/2 + d/w, 0, 1)`, `w` = the largest spacing. Sums over a plane along that axis are
/// exact; across a shorter one, of spacing *h*, the plane's depth is off by at most h²/(8 w), without
/// bias (two kinks of the ramp, each with the error of the midpoint rule). On a face of curvature κ (the
/// sum of both) the ramp counts as if the face lay w²κ/24 too far out, its first moment, and the carved
/// face is grown by h²κ/12 ([`crate::tool::revolved::Form::grown_mm`]): a ball of radius R counts
/// 3h²/4R² too large.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Occupancy {
    // half the window, units of the stored distance; at least 1
    half_window: i16,
}

impl Occupancy {
    /// The rule for one lattice.
    pub fn new(grid: &Grid) -> Self {
        let widest = grid.spacing_mm.max_element();
        let half = 0.5 * widest / f64::from(grid.quantum_mm());
        Self {
            // half a spacing is less than the band, which is i16::MAX units
            half_window: (half as i16).max(1),
        }
    }

    /// Half the window, units of the stored distance: what a vector unit needs.
    pub(crate) fn half_window(self) -> i16 {
        self.half_window
    }

    /// Units of a full voxel.
    pub fn full(self) -> i64 {
        2 * i64::from(self.half_window)
    }

    /// Units in `0..=full()` of a voxel whose stored distance is `d`.
    pub fn units(self, d: i16) -> i64 {
        i64::from(d.clamp(-self.half_window, self.half_window)) + i64::from(self.half_window)
    }

    /// Volume of `units`, mm³.
    pub fn mm3(self, grid: &Grid, units: i64) -> f64 {
        units as f64 * (grid.voxel_mm3() / self.full() as f64)
    }
}

const _: () = assert!(BRICK_VOXELS * BRICKS_PER_CHUNK == CHUNK_VOXELS);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_planes_depth_is_exact_along_the_widest_axis_and_bounded_along_the_others() {
        for h in [1.0, 0.78, 2.0 / 3.0, 0.55, 0.5, 0.31] {
            let grid = Grid::new([1, 1, 1], DVec3::new(h, h, 1.0)).expect("a grid");
            let occupancy = Occupancy::new(&grid);
            let bound = if h < 1.0 { h * h / 8.0 } else { 0.0 } + 1e-3 * h;
            let (mut worst, mut sum) = (0.0f64, 0.0);
            for step in 0..1000 {
                // a plane between −h/2 and h/2, bone below it: its depth counted over 41 voxels
                let plane = h * (f64::from(step) / 1000.0 - 0.5);
                let units: i64 = (-20..=20)
                    .map(|k| {
                        #[expect(clippy::cast_possible_truncation, reason = "f32 is the field's")]
                        let d = (plane - f64::from(k) * h) as f32;
                        occupancy.units(grid.quantise(d))
                    })
                    .sum();
                let depth = units as f64 / occupancy.full() as f64 * h;
                let error = depth - (plane + 20.5 * h);
                worst = worst.max(error.abs());
                sum += error / 1000.0;
            }
            assert!(worst <= bound, "h {h}: {worst} > {bound}");
            assert!(sum.abs() < 1e-3 * h, "h {h}: bias {sum}");
        }
    }
}
