//! Static events: one event on the uncut bone at a pose that stands.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the lattice before the cast"
)]

use crate::report::carving::Output;
use crate::report::carving::lineup::{self, Carvers, Kit};
use crate::report::carving::rows::{Case, Effort, Row, measure};
use crate::scenes::bones::BuiltBone;
use crate::scenes::press::Trajectory;
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::broad::Obb;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;

/// Chunks that the thesis's static events meet.
const CHUNKS: usize = 18;
/// Replays of a static event.
const REPLAYS: usize = 21;

/// Blocks of `edge`³ voxels that hold bone and meet the tool's box: the thesis's count of chunks.
pub(super) fn chunks_hit(bone: &Bone, tool: &Tool, bone_from_tool: &Pose, edge: usize) -> usize {
    let grid = bone.grid();
    let (lo, hi) = Obb::of_tool(&tool.shape.bounds(), bone_from_tool, 0.0).aabb();
    let index = |p: DVec3| -> [usize; 3] {
        let v = (p / grid.spacing_mm).to_array();
        std::array::from_fn(|a| v[a].clamp(0.0, (grid.dims[a] - 1) as f64) as usize / edge)
    };
    let (lo, hi) = (index(lo), index(hi));
    (lo[2]..=hi[2])
        .flat_map(|z| (lo[1]..=hi[1]).flat_map(move |y| (lo[0]..=hi[0]).map(move |x| [x, y, z])))
        .filter(|block| holds_bone(bone, block.map(|b| b * edge), edge))
        .count()
}

fn holds_bone(bone: &Bone, lo: [usize; 3], edge: usize) -> bool {
    let dims = bone.grid().dims;
    let end: [usize; 3] = std::array::from_fn(|a| (lo[a] + edge).min(dims[a]));
    (lo[2]..end[2]).any(|k| {
        (lo[1]..end[1]).any(|j| {
            (lo[0]..end[0]).any(|i| {
                let place = bone.locate([i, j, k]);
                place.is_some_and(|(chunk, at)| bone.chunk(chunk).solid[at] > 0)
            })
        })
    })
}

/// Poses on the plan's axis, from 1 to 40 mm deep.
pub(super) fn descent(built: &BuiltBone) -> Vec<Pose> {
    (0..10)
        .map(|n| at_depth(built, 1.0 + 4.3 * f64::from(n)))
        .collect()
}

fn at_depth(built: &BuiltBone, depth: f64) -> Pose {
    let lean = DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 0.05);
    built
        .bone_from_plan
        .then(&Pose::new(lean, DVec3::NEG_Z * depth))
}

/// The shallowest pose on the plan's axis whose chunks of 32³ are as near to 18 as can be.
pub(super) fn pose_of_18_chunks(built: &BuiltBone, tool: &Tool) -> Pose {
    let poses = (2..40).map(|n| at_depth(built, f64::from(n)));
    poses
        .min_by_key(|pose| chunks_hit(&built.bone, tool, pose, 32).abs_diff(CHUNKS))
        .unwrap_or(built.bone_from_plan)
}

/// All methods at one pose.
pub(super) fn measure_static(
    out: &Output,
    built: &BuiltBone,
    kit: &Kit,
    at: (&str, Pose),
) -> Vec<Row> {
    measure_with(out, built, kit, at, lineup::carvers(&built.bone, kit))
}

/// Some methods at one pose.
pub(super) fn measure_with(
    out: &Output,
    built: &BuiltBone,
    kit: &Kit,
    (scene, pose): (&str, Pose),
    carvers: Carvers<'_>,
) -> Vec<Row> {
    let way = Trajectory {
        name: "static",
        poses: vec![pose; 2],
    };
    let case = Case {
        scene: scene.to_owned(),
        bone: &built.bone,
        shape: kit.tool.shape.clone(),
        way: &way,
        errors: true,
    };
    let effort = Effort {
        replays: REPLAYS,
        points: 600.min(out.effort.points),
        ..out.effort
    };
    measure(&case, &effort, carvers)
}
