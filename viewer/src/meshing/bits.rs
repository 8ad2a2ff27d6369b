//! One bit a voxel: rows of x, made from the fields line by line.
#![expect(
    clippy::inline_always,
    reason = "all of a job must be compiled for the vectors of this processor"
)]

use super::unit::{Job, Unit, dispatch};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::{BRICKS_PER_CHUNK, CHUNK, LINE_VOXELS, LINES_PER_BRICK};

/// Rows of a chunk.
const ROWS: usize = CHUNK * CHUNK;
/// Rows along one edge of a chunk with one more on either side.
pub(crate) const EDGE: usize = CHUNK + 2;

/// A chunk that is not kept, or not yet read.
static NO_ROWS: [u32; ROWS] = [0; ROWS];

/// The bits of all chunks of a bone: 4 kB each. A chunk's apron comes from its neighbours' bits.
#[derive(Debug)]
pub(crate) struct Occupied {
    rows: Vec<[u32; ROWS]>,
}

impl Occupied {
    /// Nothing, for a bone of `chunks` chunks.
    pub(crate) fn new(chunks: usize) -> Self {
        Self {
            rows: vec![[0; ROWS]; chunks],
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        4 * (self.rows.len() * ROWS) as u64
    }

    /// The bits of a chunk, to be written by [`read_chunk`].
    pub(crate) fn rows_mut(&mut self, chunk: usize) -> &mut [u32; ROWS] {
        &mut self.rows[chunk]
    }

    /// Voxels that are solid and not cut.
    pub(crate) fn count(&self, chunk: usize) -> u32 {
        self.rows[chunk].iter().map(|r| r.count_ones()).sum()
    }

    /// Writes a chunk's bits and those around it.
    pub(crate) fn apron(&self, bone: &Bone, chunk: usize, out: &mut Apron) {
        let coord = bone.chunk_coord(chunk).map(usize::from);
        let near = |d: [usize; 3]| -> &[u32; ROWS] {
            let mut at = [0; 3];
            for a in 0..3 {
                // d = 0, 1, 2 stands for −1, 0, 1
                let Some(c) = (coord[a] + d[a]).checked_sub(1) else {
                    return &NO_ROWS;
                };
                at[a] = c;
            }
            bone.chunk_at(at).map_or(&NO_ROWS, |c| &self.rows[c])
        };
        for z in 0..EDGE {
            let (dz, z_in) = place(z);
            let plane = &mut out.rows[z * EDGE..(z + 1) * EDGE];
            for dy in 0..3 {
                let [left, own, right] = [0, 1, 2].map(|dx| near([dx, dy, dz]));
                let (first, ys) = match dy {
                    0 => (0, CHUNK - 1..CHUNK),
                    1 => (1, 0..CHUNK),
                    _ => (EDGE - 1, 0..1),
                };
                let from = z_in * CHUNK + ys.start;
                let to = z_in * CHUNK + ys.end;
                let rows = left[from..to]
                    .iter()
                    .zip(&own[from..to])
                    .zip(&right[from..to]);
                for (row, ((l, o), r)) in plane[first..].iter_mut().zip(rows) {
                    *row = u64::from(l >> 31) | u64::from(*o) << 1 | u64::from(r & 1) << 33;
                }
            }
        }
    }
}

/// Which neighbour (0, 1, 2) a place of the apron lies in, and where there.
fn place(at: usize) -> (usize, usize) {
    match at {
        0 => (0, CHUNK - 1),
        v if v <= CHUNK => (1, v - 1),
        _ => (2, 0),
    }
}

/// The bits of a chunk and one voxel around it: rows of 34 bits, bit 0 = voxel −1.
#[derive(Debug)]
pub(crate) struct Apron {
    /// Rows, y fastest.
    pub(crate) rows: Box<[u64; EDGE * EDGE]>,
}

impl Apron {
    /// Nothing.
    pub(crate) fn new() -> Self {
        Self {
            rows: Box::new([0; EDGE * EDGE]),
        }
    }
}

/// Reads the bits of a chunk: set where both distances are positive.
pub(crate) fn read_chunk(bone: &Bone, cut: &Cut, chunk: usize, rows: &mut [u32; ROWS]) {
    dispatch(ReadChunk {
        bone,
        cut,
        chunk,
        rows,
    });
}

struct ReadChunk<'a> {
    bone: &'a Bone,
    cut: &'a Cut,
    chunk: usize,
    rows: &'a mut [u32; ROWS],
}

impl Job for ReadChunk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<U: Unit>(self, unit: U) {
        let (solid, _) = self.bone.chunk(self.chunk).solid.as_chunks::<LINE_VOXELS>();
        let bony = self.bone.bony_bricks(self.chunk);
        // four bytes a row, one for each brick along x
        let mut bytes = [0u8; 4 * ROWS];
        for brick in (0..BRICKS_PER_CHUNK).filter(|b| bony >> b & 1 == 1) {
            let cut = self.cut.brick(self.chunk, brick);
            let cut = cut.map(|c| c.as_chunks::<LINE_VOXELS>().0);
            let first = brick * LINES_PER_BRICK;
            let (bx, by, bz) = (brick & 3, brick >> 2 & 3, brick >> 4);
            for pair in 0..LINES_PER_BRICK / 2 {
                let mask = |line: usize| {
                    let solid = unit.positive(&solid[first + line]);
                    match cut {
                        Some(cut) => solid & unit.positive(&cut[line]),
                        None => solid,
                    }
                };
                // two lines lie beside one another along x: eight bytes of eight voxels
                let both = spread(mask(2 * pair)) | spread(mask(2 * pair + 1)) << 4;
                let (y, z) = (8 * by + 4 * (pair & 1), 8 * bz + 2 * (pair >> 1));
                let at = 4 * (z * CHUNK + y) + bx;
                for (n, byte) in both.to_le_bytes().into_iter().enumerate() {
                    bytes[at + 4 * ((n & 1) * CHUNK + (n >> 1))] = byte;
                }
            }
        }
        for (row, bytes) in self.rows.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *row = u32::from_le_bytes(*bytes);
        }
    }
}

/// Each group of four bits into the low half of a byte.
#[inline(always)]
fn spread(mask: u32) -> u64 {
    let m = u64::from(mask);
    let m = (m | m << 16) & 0x0000_ffff_0000_ffff;
    let m = (m | m << 8) & 0x00ff_00ff_00ff_00ff;
    (m | m << 4) & 0x0f0f_0f0f_0f0f_0f0f
}
