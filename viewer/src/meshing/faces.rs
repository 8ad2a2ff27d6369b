//! Faces between a voxel of bone and one of air, and the voxels that have one.
//!
//! A face is one word: x, y, z (five bits each), direction (three bits: twice the axis, one more
//! where it looks along it), and from bit 18 its size less one along the two other axes in cyclic
//! order (five bits each; 0 here, see [`super::greedy`]).
#![expect(
    clippy::inline_always,
    reason = "all of a job must be compiled for the vectors of this processor"
)]
#![expect(
    clippy::cast_possible_truncation,
    reason = "places in a chunk of 32³ and its apron"
)]

use super::bits::{Apron, EDGE};
use super::unit::{Job, Unit, dispatch};
use osteon_sim_core::grid::CHUNK;

/// Bit where a face's direction begins.
pub(crate) const DIRECTION_BIT: u32 = 15;
/// Bit where its size along the first other axis begins; the second follows five bits on.
pub(crate) const SIZE_BIT: u32 = 18;

/// Masks of a plane of rows: per row, the voxels whose neighbour in one direction is empty.
pub(crate) type PlaneFaces = [[u32; CHUNK]; 6];

/// The faces of plane `z` (0..32) in all six directions.
#[inline(always)]
pub(crate) fn of_plane(apron: &Apron, z: usize) -> PlaneFaces {
    let mut faces = [[0u32; CHUNK]; 6];
    let at = (z + 1) * EDGE + 1;
    let rows = |shift: usize| -> &[u64] { &apron.rows[at + shift - EDGE - 1..][..CHUNK] };
    let (own, before, after) = (rows(EDGE + 1), rows(EDGE), rows(EDGE + 2));
    let (below, above) = (rows(1), rows(2 * EDGE + 1));
    for y in 0..CHUNK {
        let row = own[y];
        // bit 1 is the chunk's first voxel
        let low = |mask: u64| (mask >> 1) as u32;
        faces[0][y] = low(row & !(row << 1));
        faces[1][y] = low(row & !(row >> 1));
        faces[2][y] = low(row & !before[y]);
        faces[3][y] = low(row & !after[y]);
        faces[4][y] = low(row & !below[y]);
        faces[5][y] = low(row & !above[y]);
    }
    faces
}

/// Appends a chunk's faces.
pub(crate) fn faces(apron: &Apron, out: &mut Vec<u32>) {
    dispatch(Faces { apron, out });
}

struct Faces<'a> {
    apron: &'a Apron,
    out: &'a mut Vec<u32>,
}

impl Job for Faces<'_> {
    type Output = ();

    #[inline(always)]
    fn run<U: Unit>(self, _unit: U) {
        // a row has at most 32 faces in each direction
        let mut line = [0u32; 6 * CHUNK];
        for z in 0..CHUNK {
            let plane = of_plane(self.apron, z);
            for y in 0..CHUNK {
                let mut n = 0;
                for (direction, rows) in (0u32..).zip(&plane) {
                    let word = (y as u32) << 5 | (z as u32) << 10 | direction << DIRECTION_BIT;
                    let mut mask = rows[y];
                    while mask != 0 {
                        line[n] = word | mask.trailing_zeros();
                        n += 1;
                        mask &= mask - 1;
                    }
                }
                self.out.extend_from_slice(&line[..n]);
            }
        }
    }
}

/// Appends a chunk's voxels that have a face: x, y, z as in a face.
pub(crate) fn surface_voxels(apron: &Apron, out: &mut Vec<u32>) {
    dispatch(SurfaceVoxels { apron, out });
}

struct SurfaceVoxels<'a> {
    apron: &'a Apron,
    out: &'a mut Vec<u32>,
}

impl Job for SurfaceVoxels<'_> {
    type Output = ();

    #[inline(always)]
    fn run<U: Unit>(self, _unit: U) {
        let mut line = [0u32; CHUNK];
        for z in 0..CHUNK {
            let plane = of_plane(self.apron, z);
            for y in 0..CHUNK {
                let mut mask = plane.iter().fold(0, |all, rows| all | rows[y]);
                let mut n = 0;
                while mask != 0 {
                    line[n] = mask.trailing_zeros() | (y as u32) << 5 | (z as u32) << 10;
                    n += 1;
                    mask &= mask - 1;
                }
                self.out.extend_from_slice(&line[..n]);
            }
        }
    }
}
