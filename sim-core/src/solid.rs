//! Signed distance to the zero surface of a sampled scalar field.
//!
//! The surface is where the field, interpolated linearly along the lattice edges, is zero. In each
//! cell the crossings on its edges are joined face by face to closed polygons (an ambiguous face is
//! decided by its bilinear saddle, so that the two cells beside it agree), the polygons are fanned
//! into triangles, and every voxel takes its distance to the nearest triangle. Exact for planes at
//! any spacing; for a surface of curvature radius R the chords lie about h²/(8 R) off.
//!
//! The result is the minimum over a set of triangles: free of order, so layers can be computed on
//! any number of threads with the same bits. It is Lipschitz with constant 1: of two neighbours on
//! either side of the surface, both are at most their edge's crossing away.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    reason = "lattice indices are below MAX_DIM and lengths in mm fit an f32"
)]

use crate::bone::BoneError;
use crate::grid::Grid;
use core::ops::Range;
use glam::{DVec3, Vec3};

/// How far [`signed_distance`] is computed, in bands; beyond, it saturates.
pub const REACH_BANDS: f64 = 1.3;

/// Signed distance, mm, positive where `phi > 0`, to the zero surface of `phi` (x fastest, as in
/// [`Grid::dense_index`]); saturated at ± [`REACH_BANDS`] bands. A NaN in `phi` counts as outside.
/// Where the positive region leaves the lattice, it has no surface there.
pub fn signed_distance(grid: &Grid, phi: &[f32]) -> Result<Vec<f32>, BoneError> {
    let mut out = vec![0.0; grid.len()];
    let reach_mm = REACH_BANDS * grid.band_mm();
    signed_distance_layers(grid, phi, 0..grid.dims[2], reach_mm, &mut out)?;
    Ok(out)
}

/// [`signed_distance`] for the z layers `layers` only, saturated at ± `reach_mm`, into `out` (which
/// holds just these layers). Layers computed apart equal those computed together bit for bit.
pub fn signed_distance_layers(
    grid: &Grid,
    phi: &[f32],
    layers: Range<usize>,
    reach_mm: f64,
    out: &mut [f32],
) -> Result<(), BoneError> {
    let [nx, ny, nz] = grid.dims;
    let layers = layers.start.min(nz)..layers.end.min(nz);
    check_length(phi, grid.len())?;
    check_length(out, layers.len() * nx * ny)?;
    let reach_mm = reach_mm.max(0.0);
    out.fill((reach_mm * reach_mm) as f32);
    let mut sweep = Sweep {
        grid,
        spacing: grid.spacing_mm.as_vec3(),
        phi,
        reach: (DVec3::splat(reach_mm) / grid.spacing_mm)
            .to_array()
            .map(|cells| cells.ceil() as usize),
        layers: layers.clone(),
        squared: out,
        polygons: Polygons::default(),
    };
    let first = layers.start.saturating_sub(sweep.reach[2] + 1);
    let last = (layers.end + sweep.reach[2]).min(nz.saturating_sub(1));
    for k in first..last {
        for j in 0..ny.saturating_sub(1) {
            sweep.row(j, k);
        }
    }
    let inside = &phi[layers.start * nx * ny..layers.end * nx * ny];
    for (d, &p) in out.iter_mut().zip(inside) {
        let distance = d.sqrt();
        *d = if p > 0.0 { distance } else { -distance };
    }
    Ok(())
}

fn check_length(values: &[f32], expected: usize) -> Result<(), BoneError> {
    let got = values.len();
    (got == expected)
        .then_some(())
        .ok_or(BoneError::Length { expected, got })
}

struct Sweep<'a> {
    grid: &'a Grid,
    spacing: Vec3,
    phi: &'a [f32],
    // voxels that the reach covers along each axis
    reach: [usize; 3],
    layers: Range<usize>,
    // squared distances of the voxels of `layers`, mm²
    squared: &'a mut [f32],
    polygons: Polygons,
}

impl Sweep<'_> {
    /// All cells of one lattice row.
    fn row(&mut self, j: usize, k: usize) {
        let [nx, ny, _] = self.grid.dims;
        let start = self.grid.dense_index(0, j, k);
        let rows = [start, start + nx, start + nx * ny, start + nx * ny + nx];
        let column = |i: usize| {
            rows.iter().enumerate().fold(0u8, |bits, (b, row)| {
                bits | (u8::from(self.phi[row + i] > 0.0) << b)
            })
        };
        let mut left = column(0);
        let mut crossed = Vec::new();
        for i in 1..nx {
            let right = column(i);
            // mixed signs among the eight corners
            if left != right || (left != 0 && left != 15) {
                crossed.push(i - 1);
            }
            left = right;
        }
        for i in crossed {
            self.cell([i, j, k]);
        }
    }

    fn cell(&mut self, at: [usize; 3]) {
        let [nx, ny, _] = self.grid.dims;
        let start = self.grid.dense_index(at[0], at[1], at[2]);
        let phi: [f32; 8] = core::array::from_fn(|c| {
            self.phi[start + (c & 1) + ((c >> 1) & 1) * nx + (c >> 2) * nx * ny]
        });
        self.polygons.trace(&phi, self.spacing);
        self.scatter(at);
    }

    /// Lowers the squared distances around cell `at` to those of its triangles.
    fn scatter(&mut self, at: [usize; 3]) {
        let [nx, ny, nz] = self.grid.dims;
        let lo: [usize; 3] = core::array::from_fn(|a| at[a].saturating_sub(self.reach[a]));
        let hi: [usize; 3] =
            core::array::from_fn(|a| (at[a] + self.reach[a] + 2).min([nx, ny, nz][a]));
        let (box_lo, box_hi) = self.polygons.bounds();
        let offset = |v: usize, a: usize| (v as isize - at[a] as isize) as f32;
        for k in lo[2].max(self.layers.start)..hi[2].min(self.layers.end) {
            let layer = (k - self.layers.start) * ny;
            for j in lo[1]..hi[1] {
                let row = (layer + j) * nx;
                for i in lo[0]..hi[0] {
                    let p = Vec3::new(offset(i, 0), offset(j, 1), offset(k, 2)) * self.spacing;
                    let nearest_in_box = p.clamp(box_lo, box_hi);
                    let best = &mut self.squared[row + i];
                    if p.distance_squared(nearest_in_box) < *best {
                        *best = best.min(self.polygons.distance_squared(p));
                    }
                }
            }
        }
    }
}

/// Corners of a cell are numbered x + 2 y + 4 z; its edges by axis and lower corner.
const NO_EDGE: u8 = u8::MAX;
const EDGES: usize = 12;
/// Corners of each face in cyclic order.
const FACES: [[usize; 4]; 6] = [
    [0, 2, 6, 4],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 3, 7, 6],
    [0, 1, 3, 2],
    [4, 5, 7, 6],
];

/// Number in 0..12 of the edge between two neighbouring corners.
const fn edge_between(c0: usize, c1: usize) -> usize {
    let low = c0 & c1;
    match c0 ^ c1 {
        1 => low >> 1,
        2 => 4 + (low & 1) + ((low >> 2) << 1),
        _ => 8 + low,
    }
}

/// The surface inside one cell, mm from the cell's lowest corner.
#[derive(Default)]
struct Polygons {
    triangles: Vec<[Vec3; 3]>,
    vertices: [Vec3; EDGES],
    // the two edges that each crossed edge is joined to, one in each of its faces
    links: [[u8; 2]; EDGES],
}

impl Polygons {
    fn trace(&mut self, phi: &[f32; 8], spacing: Vec3) {
        self.triangles.clear();
        self.links = [[NO_EDGE; 2]; EDGES];
        for corners in FACES {
            self.join_face(corners, phi, spacing);
        }
        for start in 0..EDGES {
            if self.links[start][0] != NO_EDGE {
                self.fan(start);
            }
        }
    }

    /// Joins the crossings on one face: two by a segment, four by two segments that cut off the
    /// corners of the sign that the saddle does not have.
    fn join_face(&mut self, corners: [usize; 4], phi: &[f32; 8], spacing: Vec3) {
        let mut crossed = [0; 4];
        let mut count = 0;
        for side in 0..4 {
            let (c0, c1) = (corners[side], corners[(side + 1) % 4]);
            if (phi[c0] > 0.0) != (phi[c1] > 0.0) {
                let edge = edge_between(c0, c1);
                self.vertices[edge] = crossing(c0.min(c1), c0.max(c1), phi) * spacing;
                crossed[count] = edge;
                count += 1;
            }
        }
        match count {
            2 => self.link(crossed[0], crossed[1]),
            4 => {
                let [a, b, c, d] = corners.map(|c| f64::from(phi[c]));
                let joins_a_and_c = if a > 0.0 {
                    a * c > b * d
                } else {
                    a * c >= b * d
                };
                // sides 0 and 1 meet in corner b, sides 2 and 3 in d
                let first = usize::from(!joins_a_and_c);
                self.link(crossed[first], crossed[first + 1]);
                self.link(crossed[first + 2], crossed[(first + 3) % 4]);
            }
            _ => {}
        }
    }

    fn link(&mut self, e0: usize, e1: usize) {
        for (from, to) in [(e0, e1), (e1, e0)] {
            let slot = usize::from(self.links[from][0] != NO_EDGE);
            self.links[from][slot] = to as u8;
        }
    }

    /// Walks the polygon through edge `start`, unlinking as it goes, and adds its triangles.
    fn fan(&mut self, start: usize) {
        let mut ring = [Vec3::ZERO; EDGES];
        let mut length = 0;
        let mut edge = Some(start);
        while let Some(e) = edge {
            ring[length] = self.vertices[e];
            length += 1;
            // an edge already walked has no links left, so the walk ends where it began
            edge = core::mem::replace(&mut self.links[e], [NO_EDGE; 2])
                .into_iter()
                .map(usize::from)
                .find(|&next| next < EDGES && self.links[next][0] != NO_EDGE);
        }
        for n in 2..length {
            self.triangles.push([ring[0], ring[n - 1], ring[n]]);
        }
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.triangles
            .iter()
            .flatten()
            .fold(start, |(lo, hi), &v| (lo.min(v), hi.max(v)))
    }

    fn distance_squared(&self, p: Vec3) -> f32 {
        self.triangles
            .iter()
            .map(|t| squared_distance_to_triangle(p, *t))
            .fold(f32::INFINITY, f32::min)
    }
}

/// Where the field is zero between two neighbouring corners, in cells.
fn crossing(c0: usize, c1: usize, phi: &[f32; 8]) -> Vec3 {
    let corner = |c: usize| Vec3::new((c & 1) as f32, ((c >> 1) & 1) as f32, (c >> 2) as f32);
    let (f0, f1) = (f64::from(phi[c0]), f64::from(phi[c1]));
    let t = f0 / (f0 - f1);
    // a NaN or two infinities say nothing about where
    let t = if t.is_finite() {
        t.clamp(0.0, 1.0)
    } else {
        0.5
    };
    corner(c0).lerp(corner(c1), t as f32)
}

/// Squared distance of `p` to a triangle; a degenerate one counts as its edges. The point's
/// Voronoi region is found from the plane projection's edge tests.
fn squared_distance_to_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    let inside = |from: Vec3, to: Vec3| (to - from).cross(p - from).dot(normal) >= 0.0;
    if area > f32::MIN_POSITIVE && inside(a, b) && inside(b, c) && inside(c, a) {
        let height = (p - a).dot(normal);
        return height * height / area;
    }
    squared_distance_to_segment(p, a, b)
        .min(squared_distance_to_segment(p, b, c))
        .min(squared_distance_to_segment(p, c, a))
}

fn squared_distance_to_segment(p: Vec3, a: Vec3, b: Vec3) -> f32 {
    let along = b - a;
    let length = along.length_squared();
    let t = if length > 0.0 {
        ((p - a).dot(along) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    p.distance_squared(a + along * t)
}

#[cfg(test)]
mod tests;
