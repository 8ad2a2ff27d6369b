//! Cartilage on a joint face, and walls: what CT does not show and a plan forbids.

use super::SceneError;
use super::dense::{Dense, Lattice, VoxelBox, distance_within};
use super::recipe::{Cartilage, WALL_HU, WALL_LABEL};
use super::resample::trilinear;
use glam::{DVec2, DVec3};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::planning::face::{Face, disc, find_by, first_surface};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::{Tissue, hu_of_density};

/// Apparent density of cartilage in the cutting law, g/cm³.
const CARTILAGE_G_CM3: f64 = 0.10;
/// Distance of the rays that find the face, mm.
const RAYS_MM: f64 = 0.5;
/// A wall begins this far under the joint face, mm.
const WALL_BELOW_MM: f64 = 6.0;
/// A wall is looked for within this of the plan's axis, mm.
const WALL_ASIDE_MM: f64 = 25.0;

/// Where rays met the joint face and where they met something else, plan's plane, mm.
struct Footprint {
    face: Face,
    beside: Vec<DVec2>,
    radius_mm: f64,
}

impl Footprint {
    fn find(dense: &Dense, bone_from_plan: &Pose, radius_mm: f64) -> Option<Self> {
        const ABOVE_MM: f64 = 12.0;
        let depth = |p: DVec3| f64::from(trilinear(&dense.grid, &dense.solid_mm, p));
        let face = find_by(&depth, bone_from_plan, radius_mm)?;
        let inward = -bone_from_plan.vector(DVec3::Z);
        let is_face = |x: f64, y: f64| {
            let from = bone_from_plan.point(DVec3::new(x, y, ABOVE_MM));
            first_surface(&depth, from, inward, 2.0 * ABOVE_MM).is_some_and(|t| {
                let p = from + inward * t;
                (p.distance(face.sphere.centre) - face.sphere.radius_mm).abs() < 2.0
            })
        };
        let beside = disc(radius_mm + 1.0, RAYS_MM)
            .filter(|&(x, y)| !is_face(x, y))
            .map(|(x, y)| DVec2::new(x, y))
            .collect();
        Some(Self {
            face,
            beside,
            radius_mm,
        })
    }

    /// How far inside the face's outline a place is, mm.
    fn inside_mm(&self, p: DVec2) -> f64 {
        let nearest = self.beside.iter().map(|q| p.distance(*q));
        let rim = self.radius_mm - p.length();
        // the middle of four rays beside the face is beside it
        nearest.fold(rim, f64::min) - 0.75 * RAYS_MM
    }
}

/// The box of voxels around the plan's axis, and its lattice.
fn region(
    dense: &Dense,
    plan_from_bone: &Pose,
    aside_mm: f64,
    z_mm: [f64; 2],
) -> Option<(VoxelBox, Grid)> {
    let lattice = Lattice::of(&dense.grid);
    let near = |at: usize| {
        let [i, j, k] = lattice.coord(at);
        let p = plan_from_bone.point(dense.grid.centre(i, j, k));
        (z_mm[0]..=z_mm[1]).contains(&p.z) && p.truncate().length() <= aside_mm
    };
    let tight = VoxelBox::around(lattice, 0, near)?;
    let region = tight.grown(lattice, [6; 3]);
    let grid = Grid {
        dims: region.dims(),
        ..dense.grid
    };
    Some((region, grid))
}

/// Lays cartilage of an even thickness on the joint face, thinner towards its rim; its volume, mm³ (counted
/// in voxels), or an error where there is no face.
pub(super) fn lay(
    dense: &mut Dense,
    bone_from_plan: &Pose,
    cartilage: Cartilage,
) -> Result<f64, SceneError> {
    let thickness = cartilage.thickness_mm;
    let footprint = Footprint::find(dense, bone_from_plan, cartilage.radius_mm).ok_or_else(|| SceneError::File {
        path: super::file::NAME.into(),
        problem: format!("cartilage: no joint face within {} mm of the plan's axis; correct the plan or leave cartilage out", cartilage.radius_mm),
    })?;
    let plan_from_bone = bone_from_plan.inverse();
    let Some((region, part)) = region(dense, &plan_from_bone, cartilage.radius_mm, [-12.0, 12.0])
    else {
        return Ok(0.0);
    };
    let lattice = Lattice::of(&dense.grid);
    let band = dense.grid.band_mm();
    let reach = thickness + band;
    let far = distance_within(&part, &region.crop(lattice, &dense.solid_mm), reach)?;
    let small = Lattice { dims: part.dims };
    let label = dense.label.iter().copied().find(|&l| l != 0).unwrap_or(0);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a density below 2 g/cm³; lengths in mm"
    )]
    let (hu, most) = (hu_of_density(CARTILAGE_G_CM3).round() as i16, reach as f32);
    let mut voxels = 0.0;
    for (at, &solid) in far.iter().enumerate() {
        // bone, or out of reach
        if solid > 0.0 || solid <= -most {
            continue;
        }
        let c = small.coord(at);
        let whole = lattice.index(core::array::from_fn(|a| c[a] + region.lo[a]));
        let [i, j, k] = lattice.coord(whole);
        let in_bone = dense.grid.centre(i, j, k);
        let p = plan_from_bone.point(in_bone);
        let off = (in_bone.distance(footprint.face.sphere.centre)
            - footprint.face.sphere.radius_mm)
            .abs();
        let sheet = thickness + 2.0 - off;
        // thinner towards the rim, where it ends
        let here = thickness.min(footprint.inside_mm(p.truncate()));
        let layer = if here > 0.0 {
            (here + f64::from(solid)).min(sheet)
        } else {
            f64::NEG_INFINITY
        };
        if layer <= -band {
            continue;
        }
        #[expect(clippy::cast_possible_truncation, reason = "lengths in mm")]
        let layer = layer as f32;
        if layer > dense.solid_mm[whole] {
            dense.solid_mm[whole] = layer;
            dense.class[whole] = Tissue::Cartilage as u8;
            dense.density_hu[whole] = hu;
            if dense.label[whole] == 0 {
                dense.label[whole] = label;
            }
            voxels += f64::from(layer > 0.0);
        }
    }
    Ok(voxels * dense.grid.voxel_mm3())
}

/// Makes a wall of the outermost `wall_mm` of bone deeper than 6 mm under the joint face: the vault's
/// cortex, which no tool gets through. Its volume, mm³.
pub(super) fn wall(
    dense: &mut Dense,
    bone_from_plan: &Pose,
    wall_mm: f64,
) -> Result<f64, SceneError> {
    let plan_from_bone = bone_from_plan.inverse();
    let z = [-60.0, -WALL_BELOW_MM];
    let Some((region, part)) = region(dense, &plan_from_bone, WALL_ASIDE_MM, z) else {
        return Ok(0.0);
    };
    let lattice = Lattice::of(&dense.grid);
    let depth = distance_within(&part, &region.crop(lattice, &dense.solid_mm), wall_mm + 0.1)?;
    let small = Lattice { dims: part.dims };
    let mut voxels = 0.0;
    for (at, &depth) in depth.iter().enumerate() {
        let c = small.coord(at);
        let whole = lattice.index(core::array::from_fn(|a| c[a] + region.lo[a]));
        let [i, j, k] = lattice.coord(whole);
        let p = plan_from_bone.point(dense.grid.centre(i, j, k));
        let inside = (z[0]..=z[1]).contains(&p.z) && p.truncate().length() <= WALL_ASIDE_MM;
        if inside && dense.class[whole] != Tissue::Air as u8 && f64::from(depth) <= wall_mm {
            dense.density_hu[whole] = WALL_HU;
            dense.label[whole] = WALL_LABEL;
            voxels += f64::from(depth > 0.0);
        }
    }
    Ok(voxels * dense.grid.voxel_mm3())
}
