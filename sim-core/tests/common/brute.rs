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

/// The square of a distance as a function of δ.
#[derive(Clone, Copy)]
struct Square {
    base: f32,
    twice: [f32; 3],
}

impl Square {
    fn new(w: DVec3) -> Self {
        Self {
            base: w.length_squared() as f32,
            twice: (2.0 * w).as_vec3().to_array(),
        }
    }

    fn moved(self, o: [f32; 3]) -> Self {
        let t = self.twice;
        let o2 = (o[0] * o[0] + o[1] * o[1]) + o[2] * o[2];
        Self {
            base: self.base + ((t[0] * o[0] + t[1] * o[1]) + (t[2] * o[2] + o2)),
            twice: [0, 1, 2].map(|a| t[a] + 2.0 * o[a]),
        }
    }

    fn at(self, d: [f32; 3]) -> f32 {
        let t = self.twice;
        let flat = ((self.base + t[0] * d[0]) + t[1] * d[1]) + (d[0] * d[0] + d[1] * d[1]);
        flat + (t[2] * d[2] + d[2] * d[2])
    }
}

/// A face about a chunk's middle: its kind with lengths in units, and a ball's square.
enum Near {
    Plane(f32, f32),
    Cone(f32, f32, f32),
    Ball(Square, f32),
    Ring(f32, f32, f32),
}

fn near(form: Form, bend: f64, units: f64, (middle, axis, foot): (DVec3, DVec3, f64)) -> Near {
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
            let c = len(offset_mm) + grown - f64::from(normal_z) * foot;
            Near::Cone(normal_r, normal_z, c as f32)
        }
        Form::Ball {
            radius_mm,
            centre_mm,
        } => {
            let square = Square::new(middle - len(centre_mm) * axis);
            Near::Ball(square, (len(radius_mm) + grown) as f32)
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
    let bend = grid.mean_square_spacing();
    let faces: Vec<Vec<Near>> = (parts.iter())
        .map(|part| {
            let at = |&form: &Form| match near(form, bend, units, (middle, axis, foot)) {
                Near::Ball(square, radius) => Near::Ball(square.moved(o), radius),
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
    for n in 0..512 {
        let v = voxel_in_brick(n).map(|v| v as f32);
        let at = ((p + step[0] * v[0]) + step[1] * v[1]) + step[2] * v[2];
        put(voxel_in_brick(n), samples.signed_distance(at) * units);
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
