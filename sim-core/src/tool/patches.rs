//! Quadratic patches of a sampled distance: where the distance is smooth, one polynomial stands for a
//! ball of samples, and a line of voxels needs no look-up of its own.
//!
//! The grid is cut into cubes of `EDGE` cells. A cube near the surface gets the polynomial that fits
//! the nodes in a ball about its middle best (least squares), in the largest of `REACHES` where no value
//! of the grid is farther than [`TOLERANCE_MM`] from it. Beside creases there is none.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "node numbers below 2^25; f64 sums become f32"
)]

use super::sdf_grid::{BAND_MM, SdfGrid, UNIT_MM};
use glam::Vec3;

/// Cells along a cube's edge.
pub(super) const EDGE: usize = 4;
/// Farthest that a patch may be from the grid's own values, mm.
pub const TOLERANCE_MM: f32 = 0.004;
/// Radii of balls that are tried, largest first, cube edges: half the cube's diagonal, and the half
/// diagonal of a line of voxels that may lie about any point of the cube.
const REACHES: [f32; 3] = [0.867 + 1.1, 0.867 + 0.56, 0.867 + 0.36];

/// One cube's polynomial about its middle, mm and mm⁻¹.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Patch {
    /// x², xy, xz, y², yz, z².
    pub second: [f32; 6],
    /// x, y, z.
    pub first: [f32; 3],
    /// The value in the middle.
    pub value: f32,
    /// Bound on the gradient within its reach.
    pub steep: f32,
    // how far from the middle it holds, mm; 0 where there is none
    reach: f32,
}

impl Patch {
    const NONE: Self = Self {
        second: [0.0; 6],
        first: [0.0; 3],
        value: 0.0,
        steep: 0.0,
        reach: 0.0,
    };

    /// The distance at a point from the cube's middle, mm: what carving computes, in its order.
    pub(crate) fn at(&self, p: Vec3) -> f32 {
        let [xx, xy, xz, yy, yz, zz] = self.second;
        let [x, y, z] = self.first;
        let a = ((p.x * xx + p.y * xy) + (p.z * xz + x)) * p.x;
        let b = ((p.y * yy + p.z * yz) + y) * p.y;
        let c = (p.z * zz + z) * p.z;
        (a + b) + (c + self.value)
    }
}

/// All patches of a grid.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Patches {
    origin: Vec3,
    edge_mm: f32,
    per_mm: f32,
    dims: [usize; 3],
    cubes: Vec<Patch>,
}

impl Patches {
    /// Of a grid whose values are all there.
    pub(super) fn new(grid: &SdfGrid) -> Self {
        let dims = grid.dims.map(|n| (n - 1) / EDGE);
        let edge_mm = grid.spacing_mm * EDGE as f32;
        let balls = REACHES.map(|reach| Ball::new(reach * EDGE as f32));
        let count = dims.iter().product();
        let cubes = (0..count).map(|n| {
            let cube = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
            let middle = cube.map(|c| c * EDGE + EDGE / 2);
            if grid.node_mm(middle).abs() > BAND_MM {
                return Patch::NONE;
            }
            let fits = balls.iter().map(|ball| ball.fit(grid, middle));
            fits.into_iter().flatten().next().unwrap_or(Patch::NONE)
        });
        Self {
            origin: grid.origin,
            edge_mm,
            per_mm: 1.0 / edge_mm,
            dims,
            cubes: cubes.collect(),
        }
    }

    /// The patch about a point (mm) that holds as far as `radius` mm around it, and the point from the
    /// patch's middle.
    #[inline]
    pub(crate) fn about(&self, p: Vec3, radius: f32) -> Option<(&Patch, Vec3)> {
        let from = p - self.origin;
        let t = from * self.per_mm;
        // a NaN, or what lies below, becomes 0 or is too far away
        let at = [t.x as usize, t.y as usize, t.z as usize];
        if (0..3).any(|a| at[a] >= self.dims[a]) || t.min_element() < 0.0 {
            return None;
        }
        let patch = &self.cubes[(at[2] * self.dims[1] + at[1]) * self.dims[0] + at[0]];
        let middle = Vec3::new(at[0] as f32 + 0.5, at[1] as f32 + 0.5, at[2] as f32 + 0.5);
        let needed = 0.867 * self.edge_mm + radius;
        (needed <= patch.reach).then(|| (patch, from - middle * self.edge_mm))
    }
}

/// Nodes in a ball about a node, and the sums that a fit needs.
struct Ball {
    // radius in cells
    radius: f32,
    nodes: Vec<[i32; 3]>,
    // Σ 1, Σ x², Σ x⁴, Σ x²y²
    sums: [f64; 4],
}

impl Ball {
    fn new(radius: f32) -> Self {
        // every cell that the ball touches
        let outer = radius + 0.867;
        let last = outer.floor() as i32;
        let range = -last..=last;
        let nodes: Vec<[i32; 3]> = (range.clone())
            .flat_map(|k| {
                let range = range.clone();
                range
                    .clone()
                    .flat_map(move |j| range.clone().map(move |i| [i, j, k]))
            })
            .filter(|n| n.iter().map(|v| (v * v) as f32).sum::<f32>() <= outer * outer)
            .collect();
        let mut sums = [nodes.len() as f64, 0.0, 0.0, 0.0];
        for n in &nodes {
            let [x, y, _] = n.map(|v| f64::from(v * v));
            sums[1] += x;
            sums[2] += x * x;
            sums[3] += x * y;
        }
        Self {
            radius,
            nodes,
            sums,
        }
    }

    /// The best polynomial about node `middle`; `None` where it is not good, or leaves the grid.
    fn fit(&self, grid: &SdfGrid, middle: [usize; 3]) -> Option<Patch> {
        let last = (self.radius + 0.867).floor() as usize;
        let inside = (0..3).all(|a| middle[a] >= last && middle[a] + last < grid.dims[a]);
        if !inside {
            return None;
        }
        let value = |n: &[i32; 3]| {
            let at = core::array::from_fn(|a| (middle[a] as i32 + n[a]) as usize);
            f64::from(grid.node_mm(at))
        };
        let mut sum = 0.0;
        let (mut first, mut square, mut mixed) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for n in &self.nodes {
            let v = value(n);
            let [x, y, z] = n.map(f64::from);
            sum += v;
            for (to, by) in [
                (&mut first, [x, y, z]),
                (&mut square, [x * x, y * y, z * z]),
            ] {
                for a in 0..3 {
                    to[a] += v * by[a];
                }
            }
            for (to, by) in mixed.iter_mut().zip([x * y, x * z, y * z]) {
                *to += v * by;
            }
        }
        let [count, two, four, cross] = self.sums;
        // Σ of the second coefficients and the constant, then each of them
        let total: f64 = square.iter().sum();
        let spread = four + 2.0 * cross;
        let all = (total - 3.0 * two * sum / count) / (spread - 3.0 * two * two / count);
        let constant = (sum - two * all) / count;
        let pure = square.map(|s| (s - two * constant - cross * all) / (four - cross));
        let first = first.map(|f| f / two);
        let mixed = mixed.map(|m| m / cross);
        let of = |n: &[i32; 3]| {
            let [x, y, z] = n.map(f64::from);
            let second = pure[0] * x * x + pure[1] * y * y + pure[2] * z * z;
            let crossed = mixed[0] * x * y + mixed[1] * x * z + mixed[2] * y * z;
            constant + first[0] * x + first[1] * y + first[2] * z + second + crossed
        };
        // between nodes the grid is linear along each axis, the polynomial is not
        let between = pure.iter().map(|p| p.abs()).sum::<f64>() / 4.0;
        let bound = f64::from(TOLERANCE_MM) - between;
        if !(self.nodes.iter()).all(|n| (of(n) - value(n)).abs() <= bound) {
            return None;
        }
        let h = f64::from(grid.spacing_mm);
        let second = [pure[0], mixed[0], mixed[1], pure[1], mixed[2], pure[2]];
        let second = second.map(|v| (v / (h * h)) as f32);
        let first = first.map(|v| (v / h) as f32);
        let reach = self.radius * grid.spacing_mm;
        let bend: f32 = second.iter().map(|v| v.abs()).sum();
        Some(Patch {
            second,
            first,
            value: constant as f32,
            steep: Vec3::from_array(first).length() + 2.0 * bend * reach + UNIT_MM,
            reach,
        })
    }
}
