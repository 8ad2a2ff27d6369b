//! Bones in closed form, and cuts in them.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use glam::DVec3;
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::{
    BRICK_VOXELS, BRICKS_PER_CHUNK, CHUNK, Grid, brick_origin, voxel_in_brick,
};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::Tissue;

/// A bone from a signed distance, mm, positive inside.
pub(crate) fn from_sdf(
    grid: Grid,
    solid: impl Fn(DVec3) -> f64,
    class: impl Fn(DVec3, f64) -> Tissue,
) -> Bone {
    let mut solid_mm = Vec::with_capacity(grid.len());
    let mut classes = Vec::with_capacity(grid.len());
    for k in 0..grid.dims[2] {
        for j in 0..grid.dims[1] {
            for i in 0..grid.dims[0] {
                let p = grid.centre(i, j, k);
                let d = solid(p);
                solid_mm.push(d as f32);
                let inside = d > -grid.band_mm();
                classes.push(if inside { class(p, d) as u8 } else { 0 });
            }
        }
    }
    let density: Vec<i16> = solid_mm
        .iter()
        .map(|&d| if d > 1.5 { 300 } else { 900 })
        .collect();
    let label = vec![1; grid.len()];
    let dense = DenseBone {
        density_hu: &density,
        solid_mm: &solid_mm,
        class: &classes,
        label: &label,
    };
    Bone::from_dense(grid, Pose::IDENTITY, &dense).unwrap()
}

/// A ball of radius `radius` mm about the middle of a lattice of `n`³ voxels.
pub(crate) fn ball(n: usize, spacing: DVec3, radius: f64) -> (Bone, DVec3) {
    let grid = Grid::new([n; 3], spacing).unwrap();
    let middle = spacing * (n as f64 - 1.0) * 0.5;
    let bone = from_sdf(grid, |p| radius - (p - middle).length(), |_, d| layer(d));
    (bone, middle)
}

/// Cartilage, subchondral plate, cancellous bone from outside in.
pub(crate) fn layer(depth_mm: f64) -> Tissue {
    match depth_mm {
        d if d < 1.6 => Tissue::Cartilage,
        d if d < 3.2 => Tissue::Subchondral,
        _ => Tissue::Cancellous,
    }
}

/// Lowers the cut to a tool's signed distance (mm, negative inside the tool) in all bricks of the
/// kept chunks that it touches. The test's own carve: a plain loop over voxels.
pub(crate) fn carve(bone: &Bone, cut: &mut Cut, tool: impl Fn(DVec3) -> f64) {
    let grid = bone.grid();
    for chunk in 0..bone.chunk_count() {
        let coord = bone.chunk_coord(chunk);
        for brick in 0..BRICKS_PER_CHUNK {
            let o = brick_origin(brick);
            let mut values = [0i16; BRICK_VOXELS];
            let mut changed = false;
            for (v, value) in values.iter_mut().enumerate() {
                let inner = voxel_in_brick(v);
                let at: [usize; 3] =
                    core::array::from_fn(|a| usize::from(coord[a]) * CHUNK + o[a] + inner[a]);
                let old = cut.brick(chunk, brick).map_or(i16::MAX, |b| b[v]);
                *value = old.min(grid.quantise(tool(grid.centre(at[0], at[1], at[2])) as f32));
                changed |= *value != old;
            }
            if changed {
                cut.set_brick(chunk, brick, &values);
            }
        }
    }
    cut.set_revision(cut.revision() + 1);
}

fn capsule(p: DVec3, a: DVec3, b: DVec3, r: f64) -> f64 {
    let ab = b - a;
    let t = ((p - a).dot(ab) / ab.length_squared()).clamp(0.0, 1.0);
    r - (p - a - ab * t).length()
}

fn ellipsoid(p: DVec3, c: DVec3, r: DVec3) -> f64 {
    let q = (p - c) / r;
    let (f, g) = (q.length(), (q / r).length());
    if g < 1e-9 {
        r.min_element()
    } else {
        f * (1.0 - f) / g
    }
}

/// Something like a right scapula: a thin blade, a spine, a neck and a concave glenoid that faces
/// +x. Returns the bone and `bone_from_plan`.
pub(crate) fn scapula_like(h: f64) -> (Bone, Pose) {
    let dims = [100.0, 50.0, 130.0].map(|mm| (mm / h) as usize);
    let grid = Grid::new(dims, DVec3::splat(h)).unwrap();
    let glenoid = DVec3::new(88.0, 25.0, 85.0);
    let solid = move |p: DVec3| {
        let blade_centre = DVec3::new(38.0, 24.0, 64.0);
        let bend = 0.004 * (p.x - 40.0).powi(2);
        let q = DVec3::new(p.x, p.y + bend - 4.0, p.z);
        let blade = ellipsoid(q, blade_centre, DVec3::new(36.0, 4.0, 56.0));
        let border = capsule(
            p,
            DVec3::new(22.0, 24.0, 12.0),
            DVec3::new(78.0, 25.0, 76.0),
            4.5,
        );
        let spine = capsule(
            p,
            DVec3::new(8.0, 30.0, 92.0),
            DVec3::new(70.0, 42.0, 104.0),
            3.6,
        );
        let acromion = capsule(
            p,
            DVec3::new(70.0, 42.0, 104.0),
            DVec3::new(90.0, 38.0, 114.0),
            5.0,
        );
        let coracoid = capsule(
            p,
            DVec3::new(76.0, 22.0, 100.0),
            DVec3::new(88.0, 7.0, 108.0),
            4.2,
        );
        let neck = capsule(
            p,
            DVec3::new(62.0, 25.0, 82.0),
            DVec3::new(80.0, 25.0, 85.0),
            9.5,
        );
        let head = ellipsoid(
            p,
            DVec3::new(82.0, 25.0, 85.0),
            DVec3::new(11.0, 13.5, 18.5),
        );
        let dish = (p - (glenoid + DVec3::X * 31.0)).length() - 32.0;
        let union = [blade, border, spine, acromion, coracoid, neck, head];
        let body = union.into_iter().fold(f64::NEG_INFINITY, f64::max);
        body.min(dish)
    };
    let class = move |p: DVec3, d: f64| {
        let from_face = (p - (glenoid + DVec3::X * 31.0)).length() - 32.0;
        if from_face < 12.0 && p.x > 76.0 {
            layer(from_face.max(0.0))
        } else if d > 1.5 {
            Tissue::Cancellous
        } else {
            Tissue::Cortical
        }
    };
    let bone = from_sdf(grid, solid, class);
    let plan = Pose::from_origin_and_z(glenoid - DVec3::X, DVec3::X);
    (bone, plan)
}

/// Peg hole and reamed face in [`scapula_like`].
pub(crate) fn surgery(bone: &Bone, cut: &mut Cut, plan: &Pose) {
    let plan_from_bone = plan.inverse();
    carve(bone, cut, |p| {
        let q = plan_from_bone.point(p);
        let radial = q.truncate().length() - 4.0;
        radial.max(-18.0 - q.z)
    });
    carve(bone, cut, |p| {
        let q = plan_from_bone.point(p);
        let face = (q - DVec3::Z * (30.0 - 2.5)).length() - 30.0;
        face.max(q.truncate().length() - 18.0).max(q.z - 12.0)
    });
}
