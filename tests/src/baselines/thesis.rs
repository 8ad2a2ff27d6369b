//! The thesis's chunk kernel (ch. 2.4, 2.5, 3.2.1; Alg. 2.7–2.10), in chunks of N³ voxels.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "coordinates are clamped to the lattice before the cast; a chunk count fits in u32"
)]

pub(super) mod gpu;

use super::place::{Cells, Region, active, density, overlap};
use super::simd::{self, Isa};
use super::{Baseline, VoxelTool};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;

const ABSENT: u32 = u32::MAX;

/// How the voxels of a chunk are gone through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scan {
    Scalar,
    // rows of 32 voxels
    Wide(Isa),
}

/// The bone in chunks of N³ densities, cut by a voxelised tool.
#[derive(Debug, Clone)]
pub struct Thesis<'a, const N: usize> {
    name: &'static str,
    scan: Scan,
    bone: &'a Bone,
    tool: &'a VoxelTool,
    chunk_dims: [usize; 3],
    table: Vec<u32>,
    coords: Vec<[usize; 3]>,
    values: Vec<i16>,
    touched: Vec<bool>,
}

impl<'a> Thesis<'a, 16> {
    /// Chunks of 16³, scalar.
    pub fn chunks_of_16(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self::new("thesis-16", Scan::Scalar, bone, tool)
    }
}

impl<'a> Thesis<'a, 32> {
    /// Chunks of 32³, scalar.
    pub fn chunks_of_32(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self::new("thesis-32", Scan::Scalar, bone, tool)
    }

    /// Chunks of 32³ with the best instructions of this machine.
    pub fn simd(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self::simd_on(Isa::best(), bone, tool)
    }

    /// Chunks of 32³ with the instructions of `isa`, scalar where this machine lacks them.
    pub fn simd_on(isa: Isa, bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        let isa = if isa.is_here() { isa } else { Isa::Scalar };
        Self::new("thesis-32-simd", Scan::Wide(isa), bone, tool)
    }
}

impl<'a> Thesis<'a, 64> {
    /// Chunks of 64³, scalar.
    pub fn chunks_of_64(bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        Self::new("thesis-64", Scan::Scalar, bone, tool)
    }
}

impl<'a, const N: usize> Thesis<'a, N> {
    fn new(name: &'static str, scan: Scan, bone: &'a Bone, tool: &'a VoxelTool) -> Self {
        let chunk_dims = bone.grid().dims.map(|n| n.div_ceil(N));
        let mut this = Self {
            name,
            scan,
            bone,
            tool,
            chunk_dims,
            table: vec![ABSENT; chunk_dims[0] * chunk_dims[1] * chunk_dims[2]],
            coords: Vec::new(),
            values: Vec::new(),
            touched: Vec::new(),
        };
        let mut chunk = vec![0; N * N * N];
        for at in 0..this.table.len() {
            let [cx, cy, _] = chunk_dims;
            let coord = [at % cx, at / cx % cy, at / (cx * cy)];
            fill::<N>(bone, coord, &mut chunk);
            if chunk.iter().any(|&d| d != 0) {
                this.table[at] = this.coords.len() as u32;
                this.coords.push(coord);
                this.values.extend_from_slice(&chunk);
            }
        }
        this.touched = vec![false; this.coords.len()];
        this
    }

    /// Which instructions the scan runs on.
    pub fn isa(&self) -> Isa {
        match self.scan {
            Scan::Scalar => Isa::Scalar,
            Scan::Wide(isa) => isa,
        }
    }

    /// Chunks that have at least one active voxel.
    pub fn chunk_count(&self) -> usize {
        self.coords.len()
    }

    /// Chunks that an event at this pose goes through.
    pub fn chunks_hit(&self, bone_from_tool: &Pose) -> usize {
        let range = self.range(bone_from_tool);
        range.voxels().filter(|&c| self.slot(c).is_some()).count()
    }

    // Alg. 2.7 to 2.9, in chunks
    fn range(&self, bone_from_tool: &Pose) -> Region {
        let overlap = overlap(self.bone.grid(), self.tool, bone_from_tool);
        overlap.map_or(Region::NONE, |[lo, hi]| Region {
            lo: lo.to_array().map(|c| (c / N as f64).floor() as usize),
            hi: hi.to_array().map(|c| (c / N as f64).ceil() as usize),
        })
    }

    fn slot(&self, [x, y, z]: [usize; 3]) -> Option<usize> {
        let [cx, cy, _] = self.chunk_dims;
        let slot = self.table[(z * cy + y) * cx + x];
        (slot != ABSENT).then_some(slot as usize)
    }

    fn chunk(&mut self, slot: usize, cells: &Cells) -> u64 {
        self.touched[slot] = true;
        let first = self.coords[slot].map(|c| c * N);
        let values = &mut self.values[slot * N * N * N..(slot + 1) * N * N * N];
        match self.scan {
            Scan::Scalar => scalar::<N>(values, first, cells, self.tool.cells()),
            Scan::Wide(isa) => {
                let tool = (self.tool.bits(), self.tool.cells());
                simd::scan(isa, values, first, cells, tool)
            }
        }
    }
}

/// Densities of the chunk at a chunk coordinate, x fastest.
fn fill<const N: usize>(bone: &Bone, coord: [usize; 3], values: &mut [i16]) {
    let dims = bone.grid().dims;
    for (at, value) in values.iter_mut().enumerate() {
        let voxel = [at % N, at / N % N, at / (N * N)];
        let voxel: [usize; 3] = core::array::from_fn(|a| coord[a] * N + voxel[a]);
        let there = (0..3).all(|a| voxel[a] < dims[a]);
        *value = if there { density(bone, voxel) } else { 0 };
    }
}

/// Alg. 2.10's kernel: every voxel of the chunk; one that is active and lies in a solid tool cell is
/// set to 0. Returns how many were.
// not inlined: beside the dispatch of the wide form the compiler makes it slower
#[inline(never)]
pub(super) fn scalar<const N: usize>(
    values: &mut [i16],
    first: [usize; 3],
    cells: &Cells,
    solid: &[i16],
) -> u64 {
    let along: [[f32; 3]; N] = core::array::from_fn(|x| cells.along(first[0] + x));
    let mut removed = 0;
    for (n, row) in values.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        let at = cells.row(first[1] + n % N, first[2] + n / N);
        for (value, x) in row.iter_mut().zip(&along) {
            if *value == 0 {
                continue;
            }
            let cell = cells.index([at[0] + x[0], at[1] + x[1], at[2] + x[2]]);
            if cell.is_some_and(|cell| solid[cell] != 0) {
                *value = 0;
                removed += 1;
            }
        }
    }
    removed
}

impl<const N: usize> Baseline for Thesis<'_, N> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn theirs(&self) -> &'static str {
        "Thesis 2019: chunks of N³ i16 densities, empty ones dropped (2.6); box test (2.7), overlap box \
         (2.8), range of chunks (2.9), and in each of them every voxel taken to a cell of the dense tool \
         grid and set to 0 where that is solid (2.10)"
    }

    fn inferred(&self) -> &'static str {
        "One CPU core instead of one OpenCL kernel a chunk; a voxel is its centre, a tool cell is solid \
         where its centre is; a lattice with unequal spacings is used as it is, without filler voxels. \
         The SIMD form (same voxels, tool as a bit set) is not theirs"
    }

    fn event(&mut self, bone_from_tool: &Pose) -> u64 {
        let cells = Cells::new(self.bone.grid(), self.tool, bone_from_tool);
        let mut removed = 0;
        for coord in self.range(bone_from_tool).voxels() {
            if let Some(slot) = self.slot(coord) {
                removed += self.chunk(slot, &cells);
            }
        }
        removed
    }

    fn restore(&mut self) {
        for slot in 0..self.coords.len() {
            if core::mem::take(&mut self.touched[slot]) {
                let values = &mut self.values[slot * N * N * N..(slot + 1) * N * N * N];
                fill::<N>(self.bone, self.coords[slot], values);
            }
        }
    }

    fn is_removed(&self, voxel: [usize; 3]) -> bool {
        if !active(self.bone, voxel) {
            return false;
        }
        let [i, j, k] = voxel.map(|v| v % N);
        self.slot(voxel.map(|v| v / N))
            .is_some_and(|slot| self.values[slot * N * N * N + (k * N + j) * N + i] == 0)
    }

    fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
            + size_of_val(self.table.as_slice())
            + size_of_val(self.tool.cells())
    }
}
