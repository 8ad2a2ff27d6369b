//! Surface nets: a vertex in every cell that the surface crosses, at the mean of its edges'
//! crossings; a quad about every crossed edge.
//!
//! A *cell* has the centres of 2³ voxels as corners. Cells are numbered from 0 to 32 along each axis,
//! cell 0 begins at voxel −1. A chunk owns the edges that begin at its own voxels; vertices on its
//! border are made twice, from the same values, at the same place.
#![expect(
    clippy::inline_always,
    reason = "all of a job must be compiled for the vectors of this processor"
)]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "places in a chunk of 32³ and its apron"
)]

use super::bits::{Apron, EDGE};
use super::unit::{Job, Unit, dispatch};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::{BRICK_VOXELS, CHUNK, CHUNK_VOXELS, voxel_in_chunk};

/// Cells along an axis.
const CELLS: usize = CHUNK + 1;
/// Units of a vertex's place: this many a voxel, from voxel −1.
pub(crate) const UNITS: f32 = 1024.0;
/// Cells that are done at a time.
const BATCH: usize = 16;
/// Bits of an apron row that are voxels of the chunk.
const OWN: u64 = ((1 << CHUNK) - 1) << 1;

/// A chunk's mesh.
#[derive(Debug, Default)]
pub(crate) struct Net {
    /// Place along x, y, z in [`UNITS`] from voxel −1, and nothing.
    pub(crate) vertices: Vec<[u16; 4]>,
    /// Triangles, anticlockwise seen from outside.
    pub(crate) indices: Vec<u16>,
}

impl Net {
    /// Forgets all, keeps the room.
    pub(crate) fn clear(&mut self) {
        self.vertices.clear();
        self.indices.clear();
    }
}

/// The values of one chunk.
type Values = [i16; CHUNK_VOXELS];

/// A chunk that is not kept: all outside.
static OUTSIDE: Values = [-i16::MAX; CHUNK_VOXELS];

/// The values of a chunk and those of its neighbours.
#[derive(Debug)]
pub(crate) struct Around<'a> {
    // in the order x, y, z of −1, 0, 1
    solid: [&'a Values; 27],
    // the bricks that count, and all values
    cut: [(u64, &'a Values); 27],
    is_cut: bool,
}

/// Offset of a place of the apron in its chunk's values, by axis: they add up.
static OFFSETS: [[u16; EDGE]; 3] = offsets();

/// Which neighbour along an axis (0, 1, 2) a place of the apron lies in.
static NEAR: [u8; EDGE] = {
    let mut near = [1; EDGE];
    near[0] = 0;
    near[EDGE - 1] = 2;
    near
};

const fn offsets() -> [[u16; EDGE]; 3] {
    let mut table = [[0; EDGE]; 3];
    let mut i = 0;
    while i < EDGE {
        let v = (i + CHUNK - 1) % CHUNK;
        table[0][i] = voxel_in_chunk(v, 0, 0) as u16;
        table[1][i] = voxel_in_chunk(0, v, 0) as u16;
        table[2][i] = voxel_in_chunk(0, 0, v) as u16;
        i += 1;
    }
    table
}

impl<'a> Around<'a> {
    /// Of a chunk of a bone.
    pub(crate) fn new(bone: &'a Bone, cut: &'a Cut, chunk: usize) -> Self {
        let coord = bone.chunk_coord(chunk).map(usize::from);
        let near: [Option<usize>; 27] = core::array::from_fn(|n| {
            let d = [n % 3, n / 3 % 3, n / 9];
            let mut at = [0; 3];
            for a in 0..3 {
                at[a] = (coord[a] + d[a]).checked_sub(1)?;
            }
            bone.chunk_at(at)
        });
        let solid = near.map(|c| match c {
            Some(c) => bone.chunk(c).solid.try_into().unwrap_or(&OUTSIDE),
            None => &OUTSIDE,
        });
        let cut = near.map(|c| match c {
            Some(c) => {
                let (bricks, values) = cut.stored(c);
                (bricks, values.try_into().unwrap_or(&OUTSIDE))
            }
            None => (0, &OUTSIDE),
        });
        let is_cut = cut.iter().any(|(bricks, _)| *bricks != 0);
        Self { solid, cut, is_cut }
    }

    /// Smaller of both distances of a voxel of a neighbour.
    #[inline(always)]
    fn value(&self, near: usize, voxel: usize) -> i16 {
        let voxel = voxel & (CHUNK_VOXELS - 1);
        let solid = self.solid[near][voxel];
        let (bricks, cut) = self.cut[near];
        if bricks >> (voxel / BRICK_VOXELS) & 1 == 1 {
            solid.min(cut[voxel])
        } else {
            solid
        }
    }

    /// Values at the corners of a cell, x fastest.
    #[inline(always)]
    fn corners(&self, [x, y, z]: [usize; 3]) -> [i16; 8] {
        let [tx, ty, tz] = &OFFSETS;
        let xs = [tx[x], tx[x + 1]];
        let rows = [
            ty[y] + tz[z],
            ty[y + 1] + tz[z],
            ty[y] + tz[z + 1],
            ty[y + 1] + tz[z + 1],
        ];
        let at = |n: usize| usize::from(rows[n >> 1] + xs[n & 1]);
        let inner = 1..CHUNK;
        if inner.contains(&x) && inner.contains(&y) && inner.contains(&z) {
            if self.is_cut {
                return core::array::from_fn(|n| self.value(13, at(n)));
            }
            return core::array::from_fn(|n| self.solid[13][at(n) & (CHUNK_VOXELS - 1)]);
        }
        let near = |v: usize| usize::from(NEAR[v]);
        let rows = [
            3 * near(y) + 9 * near(z),
            3 * near(y + 1) + 9 * near(z),
            3 * near(y) + 9 * near(z + 1),
            3 * near(y + 1) + 9 * near(z + 1),
        ];
        core::array::from_fn(|n| self.value((rows[n >> 1] + near(x + (n & 1))).min(26), at(n)))
    }
}

/// What a chunk's net is made with, to be used again.
#[derive(Debug)]
pub(crate) struct Scratch {
    // the vertex of each cell that has one
    vertex_of: Box<[u16; CELLS * CELLS * CELLS]>,
    cells: Vec<[u8; 4]>,
}

impl Scratch {
    /// Nothing.
    #[expect(
        clippy::large_stack_arrays,
        reason = "on its way to the heap, once for a thread"
    )]
    pub(crate) fn new() -> Self {
        Self {
            vertex_of: Box::new([0; CELLS * CELLS * CELLS]),
            cells: Vec::new(),
        }
    }
}

/// Makes a chunk's net; `apron` holds its bits.
pub(crate) fn net(apron: &Apron, around: &Around<'_>, scratch: &mut Scratch, out: &mut Net) {
    out.clear();
    dispatch(MakeNet {
        apron,
        around,
        scratch,
        out,
    });
}

struct MakeNet<'a, 'b> {
    apron: &'a Apron,
    around: &'a Around<'b>,
    scratch: &'a mut Scratch,
    out: &'a mut Net,
}

impl Job for MakeNet<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<U: Unit>(self, _unit: U) {
        let Scratch { vertex_of, cells } = self.scratch;
        list_cells(self.apron, vertex_of, cells);
        for batch in cells.chunks(BATCH) {
            place_vertices(batch, self.around, &mut self.out.vertices);
        }
        for z in 1..=CHUNK {
            for y in 1..=CHUNK {
                quads_of_row(self.apron, vertex_of, [y, z], &mut self.out.indices);
            }
        }
    }
}

/// Lists the cells whose corners differ and numbers their vertices.
#[inline(always)]
fn list_cells(
    apron: &Apron,
    vertex_of: &mut [u16; CELLS * CELLS * CELLS],
    cells: &mut Vec<[u8; 4]>,
) {
    cells.clear();
    for z in 0..CELLS {
        for y in 0..CELLS {
            let at = z * EDGE + y;
            let rows = [at, at + 1, at + EDGE, at + EDGE + 1].map(|r| apron.rows[r]);
            let any = rows[0] | rows[1] | rows[2] | rows[3];
            if any == 0 {
                continue;
            }
            let all = rows[0] & rows[1] & rows[2] & rows[3];
            let mut mask = (any | any >> 1) & !(all & all >> 1) & ((1 << CELLS) - 1);
            let row = (z * CELLS + y) * CELLS;
            while mask != 0 {
                let x = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                vertex_of[row + x] = cells.len() as u16;
                cells.push([x as u8, y as u8, z as u8, 0]);
            }
        }
    }
}

/// The fields of [`BATCH`] cells.
type Lanes = [f32; BATCH];

/// Sums of the crossings of the four edges along one axis: number, place along it, and along the two
/// other axes. `pairs` are the corners that an edge joins, those at (0, 0), (1, 0), (0, 1), (1, 1) of
/// the other axes.
#[inline(always)]
fn along(corners: &[Lanes; 8], pairs: [(usize, usize); 4]) -> [Lanes; 4] {
    let mut sums = [[0.0f32; BATCH]; 4];
    for lane in 0..BATCH {
        let edge = |n: usize| {
            let (a, b) = (corners[pairs[n].0][lane], corners[pairs[n].1][lane]);
            let crossed = (a > 0.0) != (b > 0.0);
            // a quotient of no meaning where they are equal, and then not taken
            let t = if crossed { a / (a - b) } else { 0.0 };
            (if crossed { 1.0f32 } else { 0.0 }, t)
        };
        let e = [edge(0), edge(1), edge(2), edge(3)];
        sums[0][lane] = (e[0].0 + e[1].0) + (e[2].0 + e[3].0);
        sums[1][lane] = (e[0].1 + e[1].1) + (e[2].1 + e[3].1);
        sums[2][lane] = e[1].0 + e[3].0;
        sums[3][lane] = e[2].0 + e[3].0;
    }
    sums
}

/// 2²³: adding it to a small positive number rounds that to an integer in the lowest bits.
const ROUNDER: f32 = 8_388_608.0;

/// Appends the vertices of at most [`BATCH`] cells.
#[inline(always)]
fn place_vertices(cells: &[[u8; 4]], around: &Around<'_>, out: &mut Vec<[u16; 4]>) {
    let mut corners = [[0i16; BATCH]; 8];
    for (lane, cell) in cells.iter().enumerate() {
        let values = around.corners([cell[0], cell[1], cell[2]].map(usize::from));
        for (n, value) in values.into_iter().enumerate() {
            corners[n][lane] = value;
        }
    }
    let corners = corners.map(|row| row.map(f32::from));
    let x = along(&corners, [(0, 1), (2, 3), (4, 5), (6, 7)]);
    let y = along(&corners, [(0, 2), (4, 6), (1, 3), (5, 7)]);
    let z = along(&corners, [(0, 4), (1, 5), (2, 6), (3, 7)]);
    let mut places = [[0u16; 4]; BATCH];
    for lane in 0..BATCH {
        let count = x[0][lane] + y[0][lane] + z[0][lane];
        let share = UNITS / count.max(1.0);
        // the others of x are y, z; of y they are z, x; of z they are x, y
        let sum = [
            x[1][lane] + (y[3][lane] + z[2][lane]),
            x[2][lane] + (y[1][lane] + z[3][lane]),
            x[3][lane] + (y[2][lane] + z[1][lane]),
        ];
        for axis in 0..3 {
            places[lane][axis] = (sum[axis] * share + ROUNDER).to_bits() as u16;
        }
    }
    out.extend(cells.iter().zip(&places).map(|(cell, place)| {
        let at = |a: usize| u16::from(cell[a]) * UNITS as u16 + place[a];
        [at(0), at(1), at(2), 0]
    }));
}

/// Steps to the cells before, along each axis.
const STEPS: [usize; 3] = [1, CELLS, CELLS * CELLS];

/// Appends the quads about the edges that begin in one row of voxels.
#[inline(always)]
fn quads_of_row(
    apron: &Apron,
    vertex_of: &[u16; CELLS * CELLS * CELLS],
    [y, z]: [usize; 2],
    out: &mut Vec<u16>,
) {
    let at = z * EDGE + y;
    let row = apron.rows[at];
    let ends = [row >> 1, apron.rows[at + 1], apron.rows[at + EDGE]];
    let base = (z * CELLS + y) * CELLS;
    for (axis, end) in ends.into_iter().enumerate() {
        let crossed = (row ^ end) & OWN;
        let (first, second) = (STEPS[(axis + 1) % 3], STEPS[(axis + 2) % 3]);
        let mut mask = crossed;
        while mask != 0 {
            let x = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let cell = base + x;
            let a = vertex_of[cell - first - second];
            let b = vertex_of[cell - second];
            let c = vertex_of[cell];
            let d = vertex_of[cell - first];
            // bone at the edge's beginning: the surface looks along the axis
            let [b, d] = if row >> x & 1 == 1 { [b, d] } else { [d, b] };
            out.extend_from_slice(&[a, b, c, a, c, d]);
        }
    }
}
