//! The carved surface as points, and what was carved there: the reamed face and the peg's hole.

use crate::bone::Bone;
use crate::cut::Cut;
use crate::grid::{CHUNK, voxel_in_chunk};
use crate::planning::component::{Component, Peg};
use crate::planning::fit::{Cylinder, Sphere, cylinder, sphere};
use crate::pose::Pose;
use glam::DVec3;

/// Points farther than this from the reamed face's sphere are not of it, mm.
const FACE_MM: f64 = 0.3;
/// The same for a peg hole's wall.
const WALL_MM: f64 = 0.3;
/// Fewest points of a face or a wall.
const FEWEST: usize = 40;
/// A peg's wall is looked for this far from its planned axis, mm beyond its radius.
const PEG_SEARCH_MM: f64 = 8.0;

/// Where the cut's surface crosses the lattice edges inside the uncut bone, plan frame, mm.
pub fn carved_points(bone: &Bone, cut: &Cut, plan_from_bone: &Pose) -> Vec<DVec3> {
    let grid = bone.grid();
    let value = |[i, j, k]: [usize; 3]| {
        let (chunk, voxel) = bone.locate([i, j, k])?;
        Some((cut.value(chunk, voxel), bone.chunk(chunk).solid[voxel]))
    };
    let mut points = Vec::new();
    for chunk in (0..bone.chunk_count()).filter(|&c| cut.chunk(c).is_some()) {
        let origin = bone.chunk_coord(chunk).map(|c| usize::from(c) * CHUNK);
        for k in 0..CHUNK {
            for (j, i) in (0..CHUNK).flat_map(|j| (0..CHUNK).map(move |i| (j, i))) {
                let here = cut.value(chunk, voxel_in_chunk(i, j, k));
                let solid = bone.chunk(chunk).solid[voxel_in_chunk(i, j, k)];
                let at = [origin[0] + i, origin[1] + j, origin[2] + k];
                for axis in 0..3 {
                    let mut next = at;
                    next[axis] += 1;
                    let Some((there, solid_there)) = value(next) else {
                        continue;
                    };
                    if (here > 0) == (there > 0) {
                        continue;
                    }
                    let (a, b) = (f64::from(here), f64::from(there));
                    let t = a / (a - b);
                    let solid = f64::from(solid) * (1.0 - t) + f64::from(solid_there) * t;
                    // well inside: nearer to the bone's own surface the two edges round each other
                    if solid * f64::from(grid.quantum_mm()) < 0.5 * grid.spacing_mm.max_element() {
                        continue;
                    }
                    let mut p = grid.centre(at[0], at[1], at[2]);
                    p[axis] += grid.spacing_mm[axis] * t;
                    points.push(plan_from_bone.point(p));
                }
            }
        }
    }
    points
}

/// What was carved, in the plan's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Achieved {
    /// The reamed face, where one is found.
    pub face: Option<Sphere>,
    /// The wall of each planned peg's hole, where one is found; its axis looks out of the bone.
    pub pegs: Vec<Option<Cylinder>>,
    /// The reamed face's points.
    pub face_points: Vec<DVec3>,
}

impl Achieved {
    /// Finds them among the carved points.
    pub fn find(points: &[DVec3], component: &Component) -> Self {
        let pegs: Vec<Option<Cylinder>> = component
            .pegs
            .iter()
            .map(|peg| peg_wall(points, component, peg))
            .collect();
        let (face, face_points) = reamed_face(points, component, &pegs);
        Self {
            face,
            pegs,
            face_points,
        }
    }

    /// The middle of the achieved back about `axis` (outward): where the line along the axis through the
    /// sphere's centre meets the reamed face.
    pub fn apex(&self, axis: DVec3) -> Option<DVec3> {
        let face = self.face?;
        Some(face.centre - axis * face.radius_mm)
    }
}

/// The wall of one peg's hole: a cylinder of nearly its radius about nearly its axis.
fn peg_wall(points: &[DVec3], component: &Component, peg: &Peg) -> Option<Cylinder> {
    let at = DVec3::new(peg.at_mm[0], peg.at_mm[1], 0.0);
    let radius = 0.5 * peg.diameter_mm;
    let others: Vec<DVec3> = component
        .pegs
        .iter()
        .filter(|p| *p != peg)
        .map(|p| DVec3::new(p.at_mm[0], p.at_mm[1], 0.0))
        .collect();
    let aside = |p: DVec3, from: DVec3| (p - from).truncate().length();
    // below the reamed face, nearer to this peg than to another
    let mut wall: Vec<DVec3> = points
        .iter()
        .copied()
        .filter(|p| p.z < component.back_mm(aside(*p, DVec3::ZERO)) - 2.5)
        .filter(|p| aside(*p, at) < radius + PEG_SEARCH_MM)
        .filter(|p| others.iter().all(|o| aside(*p, at) < aside(*p, *o)))
        .collect();
    // the tip is no wall
    let deepest = wall.iter().fold(f64::INFINITY, |z, p| z.min(p.z));
    wall.retain(|p| p.z > deepest + radius);
    let mut found = None;
    for tolerance in [2.0, 1.0, WALL_MM, WALL_MM] {
        if wall.len() < FEWEST {
            return None;
        }
        let fit = cylinder(&wall, DVec3::Z)?;
        let off = |p: &DVec3| {
            ((*p - fit.centre).reject_from_normalized(fit.axis).length() - fit.radius_mm).abs()
        };
        wall.retain(|p| off(p) < tolerance);
        found = Some(fit);
    }
    found.filter(|fit| (fit.radius_mm - radius).abs() < 1.0 && fit.rms_mm < 0.5 * WALL_MM)
}

/// The sphere of the reamed face, without the holes and the reamer's rim.
fn reamed_face(
    points: &[DVec3],
    component: &Component,
    pegs: &[Option<Cylinder>],
) -> (Option<Sphere>, Vec<DVec3>) {
    const NEAR_MM: f64 = 4.0;
    let clear_of_pegs = |p: DVec3| {
        component.pegs.iter().zip(pegs).all(|(peg, found)| {
            let radius = 0.5 * peg.diameter_mm + 1.0;
            match found {
                Some(c) => (p - c.centre).reject_from_normalized(c.axis).length() > radius,
                None => (p.truncate() - glam::DVec2::from_array(peg.at_mm)).length() > radius,
            }
        })
    };
    let reach = 0.5 * component.width_mm.max(component.height_mm);
    let candidates: Vec<DVec3> = points
        .iter()
        .copied()
        .filter(|p| p.truncate().length() < reach)
        .filter(|p| (p.z - component.back_mm(p.truncate().length())).abs() < NEAR_MM)
        .filter(|p| clear_of_pegs(*p))
        .collect();
    let mut kept = candidates.clone();
    let mut found = None;
    for tolerance in [1.0, 0.5, FACE_MM, FACE_MM] {
        if kept.len() < FEWEST {
            return (None, Vec::new());
        }
        let Some(fit) = sphere(&kept) else {
            return (None, Vec::new());
        };
        kept = candidates
            .iter()
            .copied()
            .filter(|p| (p.distance(fit.centre) - fit.radius_mm).abs() < tolerance)
            .collect();
        found = Some(fit);
    }
    (
        found.filter(|fit| fit.centre.z > 0.0 && fit.rms_mm < FACE_MM),
        kept,
    )
}
