//! The value of a voxel as `carve/placed.rs` and `carve/sampled.rs` write it down: scalar, voxel by
//! voxel, every face, nothing skipped.

use glam::{DMat3, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::UNCUT;
use osteon_sim_core::grid::{
    CHUNK, CHUNK_VOXELS, Grid, brick_origin, line_origin, voxel_in_brick, voxel_in_chunk,
};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Shape;
use osteon_sim_core::tool::revolved::Form;
use osteon_sim_core::tool::sdf_grid::SdfGrid;

/// The square of a distance as a function of δ, or a share of it.
#[derive(Clone, Copy)]
struct Square {
    base: f32,
    twice: [f32; 3],
    share: f32,
}

/// Radius from which a ball or cylinder is wide, bands.
const WIDE: f64 = 18.5;

impl Square {
    fn new(w: DVec3) -> Self {
        Self {
            base: w.length_squared() as f32,
            twice: (2.0 * w).as_vec3().to_array(),
            share: 1.0,
        }
    }

    /// (q − R²)/2R.
    fn less(w: DVec3, radius: f64) -> Self {
        let share = 0.5 / radius;
        Self {
            base: ((w.length_squared() - radius * radius) * share) as f32,
            twice: (2.0 * share * w).as_vec3().to_array(),
            share: share as f32,
        }
    }

    fn moved(self, o: [f32; 3]) -> Self {
        let t = self.twice;
        let o2 = self.share * ((o[0] * o[0] + o[1] * o[1]) + o[2] * o[2]);
        Self {
            base: self.base + ((t[0] * o[0] + t[1] * o[1]) + (t[2] * o[2] + o2)),
            twice: [0, 1, 2].map(|a| t[a] + 2.0 * self.share * o[a]),
            share: self.share,
        }
    }

    fn at(self, d: [f32; 3]) -> f32 {
        let t = self.twice;
        let xy2 = self.share * (d[0] * d[0] + d[1] * d[1]);
        let flat = ((self.base + t[0] * d[0]) + t[1] * d[1]) + xy2;
        flat + (t[2] * d[2] + self.share * (d[2] * d[2]))
    }
}

/// A face about a chunk's middle: its kind with lengths in units, and a ball's square.
enum Near {
    Plane(f32, f32),
    Cone(f32, f32, f32),
    Ball(Square, f32),
    Ring(f32, f32, f32),
    WideBall(Square, [f32; 2]),
    WideCylinder(Square, [f32; 2]),
}

/// e (1 − e (m/2R − e/2R²)).
fn wide(e: f32, [a, b]: [f32; 2]) -> f32 {
    e * (1.0 - e * (a - b * e))
}

/// m/2R and 1/2R² of a wide face, whose radius is given in units; `None` where it is not wide.
fn wide_by(radius: f64, band: f64) -> Option<[f32; 2]> {
    let m = 1.0 + 3.75 * (0.5 * band / radius) * (0.5 * band / radius);
    let numbers = [0.5 * m / radius, 0.5 / (radius * radius)].map(|v| v as f32);
    (radius >= WIDE * band).then_some(numbers)
}

fn near(form: Form, grid: &Grid, units: f64, (middle, axis, foot): (DVec3, DVec3, f64)) -> Near {
    // the band in units, as the kernel has it
    let band = f64::from((grid.band_mm() * units) as f32);
    let bend = grid.mean_square_spacing();
    let len = |mm: f32| f64::from(mm) * units;
    let grown = form.grown_mm(bend) * units;
    match form {
        Form::Plane { height_mm, up } => {
            let sign = if up { 1.0 } else { -1.0 };
            Near::Plane(sign as f32, (sign * len(height_mm) - sign * foot) as f32)
        }
        Form::Cone {
            normal_r,
            normal_z,
            offset_mm,
        } => {
            let radius = len(offset_mm) + grown;
            if let Some(numbers) = wide_by(radius, band)
                && normal_z == 0.0
            {
                return Near::WideCylinder(Square::less(middle - foot * axis, radius), numbers);
            }
            let c = radius - f64::from(normal_z) * foot;
            Near::Cone(normal_r, normal_z, c as f32)
        }
        Form::Ball {
            radius_mm,
            centre_mm,
        } => {
            let (w, radius) = (middle - len(centre_mm) * axis, len(radius_mm) + grown);
            match wide_by(radius, band) {
                Some(numbers) => Near::WideBall(Square::less(w, radius), numbers),
                None => Near::Ball(Square::new(w), radius as f32),
            }
        }
        Form::Ring {
            disc_mm,
            centre_mm,
            radius_mm,
        } => Near::Ring(
            len(disc_mm) as f32,
            (len(centre_mm) - foot) as f32,
            (len(radius_mm) + grown) as f32,
        ),
    }
}

fn stored(value: f32) -> i16 {
    value.clamp(-32767.0, 32767.0).round_ties_even() as i16
}

/// Calls `voxel(index in the chunk, place in the lattice, value)` for every voxel of a chunk.
fn each_value(
    grid: &Grid,
    coord: [u16; 3],
    (shape, pose): (&Shape, &Pose),
    mut voxel: impl FnMut(usize, [usize; 3], i16),
) {
    let coord = coord.map(|c| usize::from(c) * CHUNK);
    for brick in 0..64 {
        let corner = brick_origin(brick);
        let first: [usize; 3] = std::array::from_fn(|a| coord[a] + corner[a]);
        let mut put = |inside: [usize; 3], value: f32| {
            let [x, y, z]: [usize; 3] = std::array::from_fn(|a| corner[a] + inside[a]);
            let at = std::array::from_fn(|a| first[a] + inside[a]);
            voxel(voxel_in_chunk(x, y, z), at, stored(value));
        };
        match shape {
            Shape::Grid(samples) => sampled_brick(grid, (samples, pose), first, &mut put),
            Shape::Revolved(solid) => {
                let faces: Vec<Vec<Form>> = (solid.parts.iter())
                    .map(|part| part.faces.iter().map(|f| f.form).collect())
                    .collect();
                faced_brick(grid, (&faces, pose), (coord, corner), &mut put);
            }
        }
    }
}

fn faced_brick(
    grid: &Grid,
    (parts, pose): (&[Vec<Form>], &Pose),
    (chunk, corner): ([usize; 3], [usize; 3]),
    put: &mut dyn FnMut([usize; 3], f32),
) {
    let units = 1.0 / f64::from(grid.quantum_mm());
    let spacing = grid.spacing_mm * units;
    let h = spacing.as_vec3().to_array();
    let apex = pose.translation * units;
    let axis = pose.vector(DVec3::Z);
    let a = axis.as_vec3().to_array();
    let first = DVec3::from_array(chunk.map(|v| v as f64)) * spacing - apex;
    let middle = first + spacing * 15.5;
    let foot = middle.dot(axis);
    let o: [f32; 3] = std::array::from_fn(|n| h[n] * (corner[n] as f32 - 15.5));
    let square = Square::new(middle - foot * axis).moved(o);
    let z0 = (a[0] * o[0] + a[1] * o[1]) + a[2] * o[2];
    let faces: Vec<Vec<Near>> = (parts.iter())
        .map(|part| {
            let at = |&form: &Form| match near(form, grid, units, (middle, axis, foot)) {
                Near::Ball(square, radius) => Near::Ball(square.moved(o), radius),
                Near::WideBall(square, numbers) => Near::WideBall(square.moved(o), numbers),
                Near::WideCylinder(foot, numbers) => Near::WideCylinder(foot.moved(o), numbers),
                other => other,
            };
            part.iter().map(at).collect()
        })
        .collect();
    for n in 0..512 {
        let inside = voxel_in_brick(n);
        let d: [f32; 3] = std::array::from_fn(|n| h[n] * inside[n] as f32);
        let z = ((z0 + a[0] * d[0]) + a[1] * d[1]) + a[2] * d[2];
        let r = (square.at(d) - z * z).max(0.0).sqrt();
        let of_face = |face: &Near| match *face {
            Near::Plane(sign, c) => sign * z - c,
            Near::Cone(n_r, n_z, c) => (n_r * r + n_z * z) - c,
            Near::Ball(square, radius) => square.at(d).max(0.0).sqrt() - radius,
            Near::WideBall(square, numbers) => wide(square.at(d), numbers),
            Near::WideCylinder(foot, numbers) => wide(foot.at(d) - foot.share * z * z, numbers),
            Near::Ring(disc, centre, radius) => {
                let (beyond, dz) = ((r - disc).max(0.0), z - centre);
                (beyond * beyond + dz * dz).sqrt() - radius
            }
        };
        let of_part = |part: &Vec<Near>| {
            let distances = part.iter().map(of_face);
            distances.fold(f32::NEG_INFINITY, f32::max)
        };
        let value = faces.iter().map(of_part).fold(f32::INFINITY, f32::min);
        put(inside, value);
    }
}

fn sampled_brick(
    grid: &Grid,
    (samples, pose): (&SdfGrid, &Pose),
    first: [usize; 3],
    put: &mut dyn FnMut([usize; 3], f32),
) {
    let tool_from_bone = pose.inverse();
    let axes = DMat3::from_quat(tool_from_bone.rotation);
    let h = grid.spacing_mm;
    let step = [axes.x_axis * h.x, axes.y_axis * h.y, axes.z_axis * h.z].map(DVec3::as_vec3);
    let p = tool_from_bone
        .point(grid.centre(first[0], first[1], first[2]))
        .as_vec3();
    let units = 1.0 / grid.quantum_mm();
    let radius = (DVec3::new(1.5, 1.5, 0.5) * h).length() as f32;
    for n in 0..512 {
        let v = voxel_in_brick(n).map(|v| v as f32);
        let at = ((p + step[0] * v[0]) + step[1] * v[1]) + step[2] * v[2];
        let o = line_origin(n / 32).map(|v| v as f32);
        let across = (p + step[0] * (o[0] + 1.5)) + step[1] * (o[1] + 1.5);
        let middle = across + step[2] * (o[2] + 0.5);
        let by = [v[0] - o[0] - 1.5, v[1] - o[1] - 1.5, v[2] - o[2] - 0.5];
        let offset = (step[0] * by[0] + step[1] * by[1]) + step[2] * by[2];
        let value = samples.carved((middle, radius), offset, at);
        put(voxel_in_brick(n), value * units);
    }
}

/// Lowers the values of a chunk to one pose of a tool, and calls `voxel(place, old value, value)` for
/// each voxel of a line that can hold bone. All others stay uncut.
pub fn lower(
    bone: &Bone,
    chunk: usize,
    values: &mut [i16],
    placed: (&Shape, &Pose),
    mut voxel: impl FnMut([usize; 3], i16),
) {
    let lines = bone.bony_lines(chunk);
    each_value(
        bone.grid(),
        bone.chunk_coord(chunk),
        placed,
        |n, at, value| {
            if lines[n / 512] >> (n % 512 / 32) & 1 == 1 {
                values[n] = values[n].min(value);
                voxel(at, value);
            }
        },
    );
}

/// An uncut chunk.
pub fn uncut() -> Vec<i16> {
    vec![UNCUT; CHUNK_VOXELS]
}

/// Place in the lattice of a chunk's voxel.
pub fn place(coord: [u16; 3], n: usize) -> [usize; 3] {
    let (o, v) = (brick_origin(n / 512), voxel_in_brick(n % 512));
    debug_assert!(line_origin(n % 512 / 32)[0] <= v[0]);
    std::array::from_fn(|a| usize::from(coord[a]) * CHUNK + o[a] + v[a])
}
