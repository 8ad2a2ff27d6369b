//! Points that a pose's boxes and voxels have, relative to their node.
#![expect(clippy::inline_always, reason = "lanes must melt into the job")]

use super::node::Points;
use crate::grid::{BRICK, line_origin};
use crate::lanes::Lanes;

/// The 16 voxels of the first layer of line `place` (0 to 3), from the brick's first voxel.
#[inline(always)]
pub(super) fn layer<L: Lanes>(l: L, h: [f32; 3], place: usize) -> Points<L::F> {
    let (mut x, mut y) = ([0.0; 16], [0.0; 16]);
    for n in 0..16 {
        x[n] = h[0] * (4 * (place & 1) + (n & 3)) as f32;
        y[n] = h[1] * (4 * (place >> 1) + (n >> 2)) as f32;
    }
    Points::new(l, [l.load(&x), l.load(&y), l.splat(0.0)])
}

/// Heights of a brick's 8 layers above its first voxel, and their squares.
#[inline(always)]
pub(super) fn heights<L: Lanes>(l: L, rise: f32) -> [L::F; 2] {
    let mut z = [0.0; 16];
    for (n, z) in z.iter_mut().enumerate().take(BRICK) {
        *z = rise * n as f32;
    }
    let z = l.load(&z);
    [z, l.mul(z, z)]
}

/// The middles of 16 bricks of a chunk, from the chunk's middle (15.5 voxels from its first; a brick's
/// is 3.5 from its own).
#[inline(always)]
pub(super) fn brick_layer<L: Lanes>(l: L, h: [f32; 3], layer: usize) -> Points<L::F> {
    let (mut x, mut y) = ([0.0; 16], [0.0; 16]);
    for n in 0..16 {
        x[n] = h[0] * (8.0 * (n & 3) as f32 - 12.0);
        y[n] = h[1] * (8.0 * (n >> 2) as f32 - 12.0);
    }
    let z = l.splat(h[2] * (8.0 * layer as f32 - 12.0));
    Points::new(l, [l.load(&x), l.load(&y), z])
}

/// The middles of the 16 lines of a brick, from its first voxel.
#[inline(always)]
pub(super) fn line_middles<L: Lanes>(l: L, h: [f32; 3]) -> Points<L::F> {
    let mut at = [[0.0; 16]; 3];
    for (a, at) in at.iter_mut().enumerate() {
        let middle = [1.5, 1.5, 0.5][a];
        for (line, at) in at.iter_mut().enumerate() {
            *at = h[a] * (line_origin(line)[a] as f32 + middle);
        }
    }
    Points::new(l, [l.load(&at[0]), l.load(&at[1]), l.load(&at[2])])
}
