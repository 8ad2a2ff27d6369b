//! From a whole lattice in dense arrays to the chunks of a bone.

use super::{Bone, BoneError, ChunkData, bony_bricks};
use crate::grid::{CHUNK, CHUNK_VOXELS, Grid, voxel_in_chunk};
use crate::pose::Pose;

/// Chunks that [`Bone::from_dense_by`] makes at a time.
const BATCH: usize = 256;

/// A whole lattice in dense arrays (x fastest), as a loader makes it. All slices have
/// [`Grid::len`] values.
#[derive(Debug, Clone, Copy)]
pub struct DenseBone<'a> {
    /// CT number, HU.
    pub density_hu: &'a [i16],
    /// Signed distance to the segmented surface, mm, positive inside the bone.
    pub solid_mm: &'a [f32],
    /// Tissue class ([`crate::tissue::Tissue`] as a byte).
    pub class: &'a [u8],
    /// Structure label of the segmentation; 0 = none.
    pub label: &'a [u8],
}

/// One chunk of a dense lattice on its way into a bone ([`Bone::from_dense_by`]).
#[derive(Debug, Clone)]
pub struct DenseChunk {
    coord: [u16; 3],
    bony: u64,
    density_hu: Vec<i16>,
    solid: Vec<i16>,
    class: Vec<u8>,
    label: Vec<u8>,
}

/// Makes the chunk at a chunk coordinate; `None` where it has no voxel in the band.
pub type MakeChunk<'a> = dyn Fn([u16; 3]) -> Option<DenseChunk> + Sync + 'a;

impl DenseChunk {
    fn of(grid: &Grid, dense: &DenseBone<'_>, coord: [u16; 3]) -> Option<Self> {
        let bony = bony_bricks(grid, dense.solid_mm, coord);
        if bony == 0 {
            return None;
        }
        let mut chunk = Self {
            coord,
            bony,
            density_hu: vec![-1000; CHUNK_VOXELS],
            solid: vec![-i16::MAX; CHUNK_VOXELS],
            class: vec![0; CHUNK_VOXELS],
            label: vec![0; CHUNK_VOXELS],
        };
        let lo = coord.map(|c| usize::from(c) * CHUNK);
        for k in lo[2]..(lo[2] + CHUNK).min(grid.dims[2]) {
            for j in lo[1]..(lo[1] + CHUNK).min(grid.dims[1]) {
                for i in lo[0]..(lo[0] + CHUNK).min(grid.dims[0]) {
                    let from = grid.dense_index(i, j, k);
                    let to = voxel_in_chunk(i - lo[0], j - lo[1], k - lo[2]);
                    chunk.density_hu[to] = dense.density_hu[from];
                    chunk.solid[to] = grid.quantise(dense.solid_mm[from]);
                    chunk.class[to] = dense.class[from];
                    chunk.label[to] = dense.label[from];
                }
            }
        }
        Some(chunk)
    }
}

impl Bone {
    /// Builds the chunks of a dense lattice and drops the empty ones. A chunk is kept where one of
    /// its voxels, or one of the voxels next to it (a one-voxel apron), is inside the band; so
    /// trilinear reading equals that of the dense lattice bit for bit.
    pub fn from_dense(
        grid: Grid,
        lps_from_bone: Pose,
        dense: &DenseBone<'_>,
    ) -> Result<Self, BoneError> {
        Self::from_dense_by(grid, lps_from_bone, dense, |coords, chunk| {
            coords.iter().map(|&coord| chunk(coord)).collect()
        })
    }

    /// [`Self::from_dense`] by the caller's means: `map` is to call the given function on each of
    /// the coordinates, in parallel if it likes, and to return the results in the same order (another
    /// order is refused). The bone is the same bit for bit.
    pub fn from_dense_by(
        grid: Grid,
        lps_from_bone: Pose,
        dense: &DenseBone<'_>,
        map: impl Fn(&[[u16; 3]], &MakeChunk<'_>) -> Vec<Option<DenseChunk>>,
    ) -> Result<Self, BoneError> {
        let lengths = [
            dense.density_hu.len(),
            dense.solid_mm.len(),
            dense.class.len(),
            dense.label.len(),
        ];
        for got in lengths {
            if got != grid.len() {
                return Err(BoneError::Length {
                    expected: grid.len(),
                    got,
                });
            }
        }
        if !dense.solid_mm.iter().any(|&d| d > 0.0) {
            return Err(BoneError::Empty);
        }
        let mut bone = Self::new(grid, lps_from_bone);
        let [cx, cy, cz] = grid.chunk_dims();
        let coord = |n: usize| [n % cx, n / cx % cy, n / (cx * cy)].map(|c| c as u16);
        let coords: Vec<[u16; 3]> = (0..cx * cy * cz).map(coord).collect();
        // in batches: two copies of the whole bone would be needless memory
        for batch in coords.chunks(BATCH) {
            let chunks = map(batch, &|coord| DenseChunk::of(&grid, dense, coord));
            if chunks.len() != batch.len() {
                return Err(BoneError::Length {
                    expected: batch.len(),
                    got: chunks.len(),
                });
            }
            for (&coord, chunk) in batch.iter().zip(&chunks) {
                match chunk {
                    Some(chunk) if chunk.coord != coord => return Err(BoneError::Chunk(coord)),
                    Some(chunk) => bone.push_dense(chunk),
                    None => {}
                }
            }
        }
        bone.index_lines();
        Ok(bone)
    }

    fn push_dense(&mut self, chunk: &DenseChunk) {
        let data = ChunkData {
            density_hu: &chunk.density_hu,
            solid: &chunk.solid,
            class: &chunk.class,
            label: &chunk.label,
        };
        self.append(chunk.coord, chunk.bony, &data);
    }
}
