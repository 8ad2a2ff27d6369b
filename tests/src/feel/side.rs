//! Side force of a symmetric plunge along the 26 directions to a voxel's neighbours.

use super::device::FINE;
use super::guided::Guided;
use super::peers::capped::directions;
use super::setup::{Scene, Spec, ball, bone_of};
use glam::{DQuat, DVec2, DVec3};
use osteon_sim_core::pose::Pose;
use rayon::prelude::*;
use serde::Serialize;

/// Push at a real tool, N, and how deep, mm.
const PUSH_N: f64 = 6.0;
const DEPTH_MM: f64 = 1.0;
/// From this depth on the force is looked at: the face under the tool is more than a voxel wide.
const FROM_MM: f64 = 0.2;

/// A plunge along one direction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SymmetryRow {
    /// Of the plunge, not of unit length.
    pub direction: [i8; 3],
    /// Mean force across the plunge over the mean along it.
    pub lateral_over_axial: f64,
    /// The mean of its size in each tick over the same: what wobbles is in it, too.
    pub wobble_over_axial: f64,
    /// Centroid of what was removed off the axis, mm.
    pub centroid_off_axis_mm: f64,
}

/// A ball of 3 mm plunged 1 mm deep under a constant push into voxels of 0.5 mm.
pub fn symmetry_row(direction: [i8; 3]) -> SymmetryRow {
    let inward = DVec3::from_array(direction.map(f64::from));
    let inward = inward.try_normalize().unwrap_or(DVec3::NEG_Z);
    // off the voxels' planes
    let centre = DVec3::splat(9.0) + DVec3::new(0.01, 0.02, 0.03);
    let bone = bone_of(DVec3::splat(18.0), DVec3::splat(0.5), 0.45, |p| {
        inward.dot(p - centre)
    });
    let mut spec = Spec::at(Scene {
        bone,
        bone_from_base: Pose::new(DQuat::from_rotation_arc(DVec3::Z, -inward), centre),
        tools: vec![ball(3.0)],
    });
    spec.scale = FINE;
    let push = PUSH_N * spec.feel.force_scale;
    let mut guided = Guided::new(&spec, DVec3::Z * 6.0, true);
    guided.glide(DVec3::ZERO, 20.0);
    guided.push_up_to(push, 0.05);
    let (mut across, mut wobble, mut along) = (DVec2::ZERO, 0.0, 0.0);
    for _ in 0..5000 {
        guided.push(push);
        let depth = -guided.proxy_mm().z;
        if depth > FROM_MM {
            across += guided.coupling_n().truncate();
            wobble += guided.coupling_n().truncate().length();
            along += guided.coupling_n().z;
        }
        if depth > DEPTH_MM {
            break;
        }
    }
    guided.servo.finish_carving();
    let centroid = guided.removed_centroid();
    SymmetryRow {
        direction,
        lateral_over_axial: across.length() / along,
        wobble_over_axial: wobble / along,
        centroid_off_axis_mm: centroid.map_or(f64::NAN, |c| c.truncate().length()),
    }
}

/// All 26.
pub fn symmetry_rows() -> Vec<SymmetryRow> {
    directions().into_par_iter().map(symmetry_row).collect()
}
