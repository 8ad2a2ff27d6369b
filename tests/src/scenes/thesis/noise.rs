//! Band-limited noise on a dense lattice: random knots, blended by cubic B-splines.

use rayon::prelude::*;

/// Noise whose knots lie a number of voxels apart; its zero surfaces about twice as far.
#[derive(Debug)]
pub(super) struct Noise {
    dims: [usize; 3],
    knots: [usize; 3],
    taps: [Vec<Tap>; 3],
    values: Vec<f32>,
}

/// First of the four knots of a voxel along one axis, and their weights.
#[derive(Debug, Clone, Copy)]
struct Tap {
    at: usize,
    weight: [f32; 4],
}

impl Noise {
    /// Noise over `dims` voxels with a knot every `step` voxels.
    pub(super) fn new(dims: [usize; 3], step: f32, seed: u64) -> Self {
        let taps = dims.map(|n| taps(n, step));
        let knots: [usize; 3] =
            core::array::from_fn(|a| taps[a].last().map_or(0, |tap| tap.at) + 4);
        let values = (0..knots.iter().product::<usize>())
            .map(|n| random(n as u64, seed))
            .collect();
        Self {
            dims,
            knots,
            taps,
            values,
        }
    }

    /// Calls `take` with every voxel of `out` (x fastest) and its noise, mean 0, about ±0.5.
    pub(super) fn each(&self, out: &mut [f32], take: impl Fn(&mut f32, f32) + Sync) {
        let [nx, ny, _] = self.dims;
        out.par_chunks_mut(nx * ny)
            .enumerate()
            .for_each(|(k, layer)| self.layer(k, layer, &take));
    }

    fn layer(&self, k: usize, layer: &mut [f32], take: &impl Fn(&mut f32, f32)) {
        let [kx, ky, _] = self.knots;
        let z = self.taps[2][k];
        let planes = [0, 1, 2, 3].map(|n| &self.values[(z.at + n) * kx * ky..][..kx * ky]);
        let plane = blend(planes, z.weight);
        for (line, y) in layer.chunks_exact_mut(self.dims[0]).zip(&self.taps[1]) {
            let rows = [0, 1, 2, 3].map(|n| &plane[(y.at + n) * kx..][..kx]);
            let row = blend(rows, y.weight);
            for (v, x) in line.iter_mut().zip(&self.taps[0]) {
                let near = &row[x.at..x.at + 4];
                let noise = near[0] * x.weight[0]
                    + near[1] * x.weight[1]
                    + near[2] * x.weight[2]
                    + near[3] * x.weight[3];
                take(v, noise);
            }
        }
    }
}

fn blend(lines: [&[f32]; 4], weight: [f32; 4]) -> Vec<f32> {
    (0..lines[0].len())
        .map(|n| (0..4).map(|m| lines[m][n] * weight[m]).sum())
        .collect()
}

fn taps(count: usize, step: f32) -> Vec<Tap> {
    (0..count)
        .map(|n| {
            let x = n as f32 / step;
            let t = x.fract();
            let (t2, t3, s) = (t * t, t * t * t, 1.0 - t);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most the lattice's length"
            )]
            let at = x as usize;
            let weight = [
                s * s * s,
                3.0 * t3 - 6.0 * t2 + 4.0,
                -3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0,
                t3,
            ];
            Tap {
                at,
                weight: weight.map(|w| w / 6.0),
            }
        })
        .collect()
}

/// A number in [-1, 1) of a count and a seed (splitmix64).
fn random(n: u64, seed: u64) -> f32 {
    let mut x = n
        .wrapping_add(seed.wrapping_mul(0xd134_2543_de82_ef95))
        .wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^= x >> 31;
    // 24 bits are an f32's
    (x >> 40) as f32 / 8_388_608.0 - 1.0
}
