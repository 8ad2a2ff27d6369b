//! What viewers are shown of a session, live or played again.
#![expect(
    clippy::cast_possible_truncation,
    reason = "grid edges are at most 4096; turns a minute"
)]

use super::mirror::Mirror;
use super::publisher::{Publisher, wire_pose};
use super::record::Record;
use super::stats::Stats;
use super::viewers::Viewers;
use crate::passage::{Layers, Passages};
use crate::scene::Scene;
use interprocess::local_socket::Listener;
use osteon_protocol::ipc::ToolInfo;
use osteon_protocol::ipc_frame::clip;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::servo::Request;
use osteon_sim_core::tool::Tool;
use rtrb::{Consumer, Producer};
use std::sync::Arc;

/// What a session is about.
pub(crate) struct Session<'a> {
    pub tools: &'a [Tool],
    pub scene: &'a Scene,
    pub feel: &'a Feel,
}

/// A publisher for the session on a socket, under the device link's name, with its ends of the rings.
pub(crate) fn publisher_of(
    session: &Session<'_>,
    force_limit_n: f64,
    (listener, link_name): (Listener, String),
    (records, requests): (Consumer<Record>, Producer<Request>),
) -> Publisher {
    let &Session { tools, scene, .. } = session;
    let plan_from_bone = scene.bone_from_plan.inverse();
    Publisher {
        mirror: Mirror::new(Arc::clone(&scene.bone), tools.to_vec()),
        stats: Stats::new(tools),
        passages: Passages::new(
            Layers::along(&scene.bone, &scene.bone_from_plan),
            plan_from_bone,
            tools.len(),
        ),
        guide: None,
        records,
        requests,
        listener,
        net: None,
        scene: Arc::new(wire_scene(session, force_limit_n)),
        plan_from_bone,
        link_name,
        pose_log: None,
        timing_log: None,
        viewers: Viewers::new(scene.bone.chunk_count()),
        health: None,
    }
}

fn wire_scene(session: &Session<'_>, force_limit_n: f64) -> osteon_protocol::ipc::Scene {
    let &Session { tools, scene, feel } = session;
    let grid = scene.bone.grid();
    osteon_protocol::ipc::Scene {
        source: clip(&scene.source).to_owned(),
        dims: grid.dims.map(|n| n as u32),
        spacing_mm: grid.spacing_mm.to_array(),
        lps_from_bone: wire_pose(scene.bone.lps_from_bone()),
        bone_from_plan: wire_pose(&scene.bone_from_plan),
        chunks: scene.bone.chunk_count() as u32,
        solid_mm3: scene.summary.solid_mm3,
        tools: tools
            .iter()
            .map(|t| ToolInfo {
                name: t.name.clone(),
                id: t.id.clone(),
                outline_mm: t.shape.outline(),
                rpm: t.rpm as f32,
            })
            .collect(),
        force_limit_n,
        force_scale: feel.force_scale,
    }
}
