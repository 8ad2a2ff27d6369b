//! Faces merged into rectangles, greedily: first along the one axis as far as they go, then along the
//! other as long as whole rows fit.
#![expect(
    clippy::inline_always,
    reason = "all of a job must be compiled for the vectors of this processor"
)]
#![expect(
    clippy::cast_possible_truncation,
    clippy::needless_range_loop,
    reason = "places in a chunk of 32³ and its apron"
)]

use super::bits::Apron;
use super::faces::{DIRECTION_BIT, PlaneFaces, SIZE_BIT, of_plane};
use super::unit::{Job, Unit, dispatch};
use osteon_sim_core::grid::CHUNK;

/// Appends a chunk's merged faces, as words of [`super::faces`].
pub(crate) fn greedy(apron: &Apron, scratch: &mut Scratch, out: &mut Vec<u32>) {
    dispatch(Greedy {
        apron,
        scratch,
        out,
    });
}

/// The masks of a whole chunk, to be used again.
#[derive(Debug)]
pub(crate) struct Scratch {
    planes: Box<[PlaneFaces; CHUNK]>,
}

impl Scratch {
    /// Nothing.
    #[expect(
        clippy::large_stack_arrays,
        reason = "on its way to the heap, once for a thread"
    )]
    pub(crate) fn new() -> Self {
        Self {
            planes: Box::new([[[0; CHUNK]; 6]; CHUNK]),
        }
    }
}

struct Greedy<'a> {
    apron: &'a Apron,
    scratch: &'a mut Scratch,
    out: &'a mut Vec<u32>,
}

/// A word of [`super::faces`].
#[inline(always)]
fn word([x, y, z]: [usize; 3], direction: usize, [first, second]: [usize; 2]) -> u32 {
    let place = (x | y << 5 | z << 10) as u32;
    let size = ((first - 1) | (second - 1) << 5) as u32;
    place | (direction as u32) << DIRECTION_BIT | size << SIZE_BIT
}

impl Job for Greedy<'_> {
    type Output = ();

    #[inline(always)]
    fn run<U: Unit>(self, _unit: U) {
        let planes = &mut self.scratch.planes;
        for (z, plane) in planes.iter_mut().enumerate() {
            *plane = of_plane(self.apron, z);
            for direction in [4, 5] {
                across_z(&mut plane[direction], z, direction, self.out);
            }
        }
        for direction in [2, 3] {
            across_y(planes, direction, self.out);
        }
        for direction in [0, 1] {
            across_x(planes, direction, self.out);
        }
    }
}

/// The first run of ones of a mask: where it begins, its length, its bits.
#[inline(always)]
fn first_run(mask: u32) -> (usize, usize, u32) {
    let begin = mask.trailing_zeros();
    let length = (mask >> begin).trailing_ones();
    let bits = (u32::MAX >> (32 - length)) << begin;
    (begin as usize, length as usize, bits)
}

/// Faces that look along z: runs along x, then rows of y.
#[inline(always)]
fn across_z(rows: &mut [u32; CHUNK], z: usize, direction: usize, out: &mut Vec<u32>) {
    for y in 0..CHUNK {
        while rows[y] != 0 {
            let (x, length, bits) = first_run(rows[y]);
            let mut high = 1;
            rows[y] &= !bits;
            while y + high < CHUNK && rows[y + high] & bits == bits {
                rows[y + high] &= !bits;
                high += 1;
            }
            // the others in cyclic order are x and y
            out.push(word([x, y, z], direction, [length, high]));
        }
    }
}

/// Faces that look along y: runs along x, then planes of z.
#[inline(always)]
fn across_y(planes: &mut [PlaneFaces; CHUNK], direction: usize, out: &mut Vec<u32>) {
    for z in 0..CHUNK {
        for y in 0..CHUNK {
            while planes[z][direction][y] != 0 {
                let (x, length, bits) = first_run(planes[z][direction][y]);
                let mut deep = 1;
                planes[z][direction][y] &= !bits;
                while z + deep < CHUNK && planes[z + deep][direction][y] & bits == bits {
                    planes[z + deep][direction][y] &= !bits;
                    deep += 1;
                }
                // the others in cyclic order are z and x
                out.push(word([x, y, z], direction, [deep, length]));
            }
        }
    }
}

/// Faces that look along x: columns of y, then planes of z.
#[inline(always)]
fn across_x(planes: &mut [PlaneFaces; CHUNK], direction: usize, out: &mut Vec<u32>) {
    for z in 0..CHUNK {
        for y in 0..CHUNK {
            while planes[z][direction][y] != 0 {
                let x = planes[z][direction][y].trailing_zeros() as usize;
                let bit = 1u32 << x;
                let mut high = 0;
                while y + high < CHUNK && planes[z][direction][y + high] & bit != 0 {
                    planes[z][direction][y + high] &= !bit;
                    high += 1;
                }
                let mut deep = 1;
                while z + deep < CHUNK {
                    let rows = &mut planes[z + deep][direction][y..y + high];
                    if rows.iter().any(|r| r & bit == 0) {
                        break;
                    }
                    for row in rows {
                        *row &= !bit;
                    }
                    deep += 1;
                }
                // the others in cyclic order are y and z
                out.push(word([x, y, z], direction, [high, deep]));
            }
        }
    }
}
