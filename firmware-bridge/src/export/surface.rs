//! The surface of the bone that is left, as triangles: surface nets (S. F. F. Gibson 1998). A vertex for
//! each cell that the surface crosses, at the mean of the crossings of its edges; four around each edge
//! that it crosses. The surface is closed: outside the lattice is air.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "positions become f32 for the file; an index is below 2^32"
)]

use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::{
    BRICK_VOXELS, BRICKS_PER_CHUNK, CHUNK, brick_origin, voxel_in_brick, voxel_in_chunk,
};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// A closed surface, DICOM LPS, mm, normals outward.
#[derive(Debug, Clone, Default)]
pub(super) struct Surface {
    pub vertices: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

/// What is left: min(solid, cut), positive inside; outside the lattice and its chunks far outside.
struct Left<'a> {
    bone: &'a Bone,
    cut: &'a Cut,
}

impl Left<'_> {
    fn at(&self, p: [i64; 3]) -> i16 {
        let dims = self.bone.grid().dims;
        let mut v = [0; 3];
        for a in 0..3 {
            match usize::try_from(p[a]) {
                Ok(n) if n < dims[a] => v[a] = n,
                _ => return -i16::MAX,
            }
        }
        let Some(chunk) = self.bone.chunk_at(v.map(|n| n / CHUNK)) else {
            return -i16::MAX;
        };
        let voxel = voxel_in_chunk(v[0] % CHUNK, v[1] % CHUNK, v[2] % CHUNK);
        self.bone.chunk(chunk).solid[voxel].min(self.cut.value(chunk, voxel))
    }
}

fn step(p: [i64; 3], axis: usize, by: i64) -> [i64; 3] {
    let mut q = p;
    q[axis] += by;
    q
}

/// The surface.
pub(super) fn of(bone: &Bone, cut: &Cut) -> Surface {
    let left = Left { bone, cut };
    let mut surface = Surface::default();
    // cells by their lowest corner
    let mut cells: HashMap<[i64; 3], u32> = HashMap::new();
    for chunk in 0..bone.chunk_count() {
        let first = bone.chunk_coord(chunk).map(|c| i64::from(c) * CHUNK as i64);
        let bony = bone.bony_bricks(chunk);
        // neither inside nor next to it is bone elsewhere
        for brick in (0..BRICKS_PER_CHUNK).filter(|b| bony >> b & 1 == 1) {
            let origin = brick_origin(brick);
            for voxel in 0..BRICK_VOXELS {
                let inside = voxel_in_brick(voxel);
                let p = core::array::from_fn(|a| first[a] + (origin[a] + inside[a]) as i64);
                edges(&left, p, &mut cells, &mut surface);
            }
        }
    }
    surface
}

/// The faces around the three edges that go up from a voxel, and those that come into it from where no
/// chunk is.
fn edges(left: &Left<'_>, p: [i64; 3], cells: &mut HashMap<[i64; 3], u32>, surface: &mut Surface) {
    let here = left.at(p) > 0;
    for axis in 0..3 {
        let next = step(p, axis, 1);
        if here != (left.at(next) > 0) {
            face(left, (p, axis, here), cells, surface);
        }
        let before = step(p, axis, -1);
        if here && !left.is_there(before) {
            face(left, (before, axis, false), cells, surface);
        }
    }
}

impl Left<'_> {
    /// Whether a voxel is in a chunk, which then looks after its own edges.
    fn is_there(&self, p: [i64; 3]) -> bool {
        let v = p.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
        let dims = self.bone.grid().chunk_dims();
        let chunk = v.map(|n| n / CHUNK);
        (0..3).all(|a| chunk[a] < dims[a]) && self.bone.chunk_at(chunk).is_some()
    }
}

/// Two triangles around the edge from `p` up along `axis`; `inside`: whether `p` is.
fn face(
    left: &Left<'_>,
    (p, axis, inside): ([i64; 3], usize, bool),
    cells: &mut HashMap<[i64; 3], u32>,
    surface: &mut Surface,
) {
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let corners = [
        step(step(p, b, -1), c, -1),
        step(p, c, -1),
        p,
        step(p, b, -1),
    ];
    let mut v = [0; 4];
    for (v, cell) in v.iter_mut().zip(corners) {
        *v = *cells.entry(cell).or_insert_with(|| {
            surface.vertices.push(vertex(left, cell));
            (surface.vertices.len() - 1) as u32
        });
    }
    // counter-clockwise seen from outside
    if !inside {
        v.reverse();
    }
    surface.triangles.push([v[0], v[1], v[2]]);
    surface.triangles.push([v[0], v[2], v[3]]);
}

/// The mean of the crossings of a cell's edges, LPS, mm.
fn vertex(left: &Left<'_>, cell: [i64; 3]) -> DVec3 {
    let corner = |n: usize| {
        let by = |a: usize| (n >> a & 1) as i64;
        [cell[0] + by(0), cell[1] + by(1), cell[2] + by(2)]
    };
    let values: [f64; 8] = core::array::from_fn(|n| f64::from(left.at(corner(n))));
    let place = |n: usize| {
        let p = corner(n);
        DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64)
    };
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for n in 0..8 {
        for a in 0..3 {
            let m = n | 1 << a;
            if m != n && (values[n] > 0.0) != (values[m] > 0.0) {
                let share = values[n] / (values[n] - values[m]);
                sum += place(n).lerp(place(m), share);
                count += 1.0;
            }
        }
    }
    let at = if count > 0.0 { sum / count } else { place(0) };
    let bone = left.bone;
    bone.lps_from_bone().point(at * bone.grid().spacing_mm)
}

impl Surface {
    fn corners(&self, triangle: [u32; 3]) -> [DVec3; 3] {
        triangle.map(|n| self.vertices[n as usize])
    }

    /// Volume inside, by the divergence theorem, mm³.
    pub(super) fn volume_mm3(&self) -> f64 {
        let sixth = |t: &[u32; 3]| {
            let [a, b, c] = self.corners(*t);
            a.dot(b.cross(c)) / 6.0
        };
        self.triangles.iter().map(sixth).sum()
    }

    /// Writes binary STL.
    pub(super) fn write_stl(&self, path: &Path) -> std::io::Result<()> {
        let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
        let mut header = [b' '; 80];
        let text = b"Osteon: bone as it was left, DICOM LPS, mm";
        header[..text.len()].copy_from_slice(text);
        file.write_all(&header)?;
        file.write_all(&(self.triangles.len() as u32).to_le_bytes())?;
        for triangle in &self.triangles {
            let [a, b, c] = self.corners(*triangle);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            for v in [normal, a, b, c] {
                for value in v.as_vec3().to_array() {
                    file.write_all(&value.to_le_bytes())?;
                }
            }
            file.write_all(&[0, 0])?;
        }
        file.flush()?;
        file.get_ref().sync_all()
    }
}
