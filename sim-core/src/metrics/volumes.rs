//! Volumes by tissue, what was taken too much or left, the plate, the seat, the surface, the vault's wall.

use crate::bone::{Bone, Occupancy};
use crate::cut::Cut;
use crate::grid::{BRICK_VOXELS, CHUNK, CHUNK_VOXELS, brick_origin, voxel_in_brick};
use crate::planning::component::Component;
use crate::planning::face::first_surface;
use crate::pose::Pose;
use crate::sample::Sampler;
use crate::tissue::{TISSUES, Tissue};
use glam::DVec3;

/// A component is seated on a point of its back where bone is within this of it, mm.
pub const SEATED_MM: f64 = 0.5;
/// A hole deeper than this below the planned back that comes out of the bone is a perforation, mm.
const VAULT_MM: f64 = 5.0;
/// Distance of the points on the back, mm.
const STEP_MM: f64 = 0.5;
/// How far from the planned back the achieved surface is looked for, mm.
const LOOK_MM: f64 = 4.0;

/// Volumes, mm³.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Volumes {
    /// Removed, by tissue class.
    pub removed: [f64; TISSUES],
    /// Removed by the planned cut, by tissue class.
    pub planned: [f64; TISSUES],
    /// Removed, though the plan leaves it.
    pub over: f64,
    /// Left, though the plan removes it.
    pub under: f64,
    /// Subchondral bone under the component's outline, before and after.
    pub plate: [f64; 2],
    /// Removed of protected structures.
    pub protected: f64,
}

/// Volumes of a cut and of the planned one. `protected` are labels that are not to be touched.
pub fn volumes(
    bone: &Bone,
    (cut, planned): (&Cut, &Cut),
    plan_from_bone: &Pose,
    component: &Component,
    protected: &[u8],
) -> Volumes {
    let grid = bone.grid();
    let occupancy = Occupancy::new(grid);
    let mm3 = |units: i64| occupancy.mm3(grid, units);
    let mut sums = Volumes::default();
    let (a, b) = (0.5 * component.width_mm, 0.5 * component.height_mm);
    let under_outline = |p: DVec3| (p.x / a).powi(2) + (p.y / b).powi(2) <= 1.0 && p.z.abs() < 12.0;
    for chunk in 0..bone.chunk_count() {
        let data = bone.chunk(chunk);
        let touched = cut.chunk(chunk).is_some() || planned.chunk(chunk).is_some();
        for voxel in 0..CHUNK_VOXELS {
            let solid = data.solid[voxel];
            let full = occupancy.units(solid);
            let class = usize::from(data.class[voxel]) % TISSUES;
            let plate = class == Tissue::Subchondral as usize;
            if full == 0 || !(touched || plate) {
                continue;
            }
            let left = occupancy.units(solid.min(cut.value(chunk, voxel)));
            let plan_left = occupancy.units(solid.min(planned.value(chunk, voxel)));
            let (gone, plan_gone) = (full - left, full - plan_left);
            sums.removed[class] += mm3(gone);
            sums.planned[class] += mm3(plan_gone);
            sums.over += mm3((gone - plan_gone).max(0));
            sums.under += mm3((plan_gone - gone).max(0));
            if protected.contains(&data.label[voxel]) {
                sums.protected += mm3(gone);
            }
            if plate && under_outline(plan_from_bone.point(centre(bone, chunk, voxel))) {
                sums.plate[0] += mm3(full);
                sums.plate[1] += mm3(left);
            }
        }
    }
    sums
}

/// Centre of a chunk's voxel, bone frame, mm.
fn centre(bone: &Bone, chunk: usize, voxel: usize) -> DVec3 {
    let coord = bone.chunk_coord(chunk).map(usize::from);
    let brick = brick_origin(voxel / BRICK_VOXELS);
    let local = voxel_in_brick(voxel % BRICK_VOXELS);
    let [i, j, k]: [usize; 3] = core::array::from_fn(|a| coord[a] * CHUNK + brick[a] + local[a]);
    bone.grid().centre(i, j, k)
}

/// How a component lies on what was carved, and how that surface lies to the planned one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seat {
    /// Share of the back, in [0, 1], with bone within [`SEATED_MM`], of the points away from the pegs.
    pub seated: f64,
    /// Root mean square of the achieved surface over the planned back along its normals, mm.
    pub rms_mm: f64,
    /// Largest such distance, mm.
    pub max_mm: f64,
    /// Points compared.
    pub points: u32,
}

/// The seat of a component whose frame is at `bone_from_component`.
pub fn seat(bone: &Bone, cut: &Cut, bone_from_component: &Pose, component: &Component) -> Seat {
    let sampler = Sampler::new(bone, cut);
    let clear = |p: DVec3| {
        component.pegs.iter().all(|peg| {
            let d = p.truncate() - glam::DVec2::from_array(peg.at_mm);
            d.length() > 0.5 * peg.diameter_mm + 1.0
        })
    };
    let (mut seated, mut all, mut squares, mut compared, mut max_mm) =
        (0_u32, 0_u32, 0.0, 0_u32, 0.0_f64);
    for point in component
        .back_points(STEP_MM)
        .iter()
        .filter(|p| clear(p.position))
    {
        all += 1;
        let from = bone_from_component.point(point.position - point.inward * LOOK_MM);
        let along = bone_from_component.vector(point.inward);
        let Some(t) = first_surface(&|p| f64::from(sampler.depth(p)), from, along, 2.0 * LOOK_MM)
        else {
            continue;
        };
        let off = t - LOOK_MM;
        if off.abs() <= SEATED_MM {
            seated += 1;
        }
        squares += off * off;
        max_mm = max_mm.max(off.abs());
        compared += 1;
    }
    Seat {
        seated: f64::from(seated) / f64::from(all.max(1)),
        rms_mm: (squares / f64::from(compared.max(1))).sqrt(),
        max_mm,
        points: compared,
    }
}

/// Volume of the swept space outside of the bone, deeper than 5 mm under the planned back and within 25 mm
/// of its axis, mm³: above a voxel or two the vault is perforated.
pub fn perforated_mm3(bone: &Bone, cut: &Cut, plan_from_bone: &Pose) -> f64 {
    const ASIDE_MM: f64 = 25.0;
    let grid = bone.grid();
    let occupancy = Occupancy::new(grid);
    let mut units = 0;
    for chunk in (0..bone.chunk_count()).filter(|&c| cut.chunk(c).is_some()) {
        let data = bone.chunk(chunk);
        for voxel in 0..CHUNK_VOXELS {
            let swept = cut.value(chunk, voxel);
            // clearly swept, clearly outside
            if swept > 0 || data.solid[voxel] > 0 {
                continue;
            }
            let p = plan_from_bone.point(centre(bone, chunk, voxel));
            if p.z < -VAULT_MM && p.truncate().length() < ASIDE_MM {
                units += occupancy.full() - occupancy.units(swept.max(data.solid[voxel]));
            }
        }
    }
    occupancy.mm3(grid, units)
}
