//! What a session begins with beside device and servo: the publisher, its logs, its doors.
#![expect(
    clippy::cast_possible_truncation,
    reason = "grid edges are at most 4096"
)]

use super::HapticsArgs;
use super::mirror::Mirror;
use super::net::Net;
use super::publisher::{Publisher, wire_pose};
use super::record::{RING_RECORDS, Record};
use super::session::{Session, create, say};
use super::stats::Stats;
use super::viewers::Viewers;
use crate::clinic::guide::Guide;
use crate::keys;
use crate::passage::{Layers, Passages};
use crate::scene::Scene;
use anyhow::Result;
use interprocess::local_socket::Listener;
use osteon_protocol::ipc::ToolInfo;
use osteon_protocol::ipc_frame::clip;
use osteon_sim_core::servo::Request;
use rtrb::{Consumer, Producer, RingBuffer};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

/// A log that the publisher writes.
type Log = Option<Box<dyn Write + Send>>;

/// What was asked for, opened.
#[derive(Default)]
pub(super) struct Outset {
    guide: Option<Guide>,
    pose_log: Log,
    timing_log: Log,
    net: Option<Net>,
}

/// The servo's ends of the rings to and from the publisher.
pub(super) struct Rings {
    pub(super) records: Producer<Record>,
    pub(super) requests: Consumer<Request>,
}

impl Outset {
    /// Opens what the options ask for.
    pub(super) fn new(args: &HapticsArgs, scene: &Scene) -> Result<Self> {
        let poses = "tick,state_seq,time_micros,x_mm,y_mm,z_mm";
        let times = "monotonic_ns,wake_ns,tick_ns,skipped,publisher_bytes";
        Ok(Self {
            guide: Guide::new(args.task, args.scene.scene.as_deref(), scene)?,
            pose_log: log(args.pose_log.as_deref(), poses)?,
            timing_log: log(args.timing_log.as_deref(), times)?,
            net: open_port(args)?,
        })
    }

    /// The publisher, and the servo's ends of its rings.
    pub(super) fn publisher(
        self,
        session: &Session<'_>,
        listener: Listener,
        force_limit_n: f64,
        link_name: &str,
    ) -> (Publisher, Rings) {
        let &Session { tools, scene, .. } = session;
        let (record_in, record_out) = RingBuffer::new(RING_RECORDS);
        let (request_in, request_out) = RingBuffer::new(64);
        let publisher = Publisher {
            mirror: Mirror::new(Arc::clone(&scene.bone), tools.to_vec()),
            stats: Stats::new(tools),
            passages: Passages::new(
                Layers::along(&scene.bone, &scene.bone_from_plan),
                scene.bone_from_plan.inverse(),
                tools.len(),
            ),
            guide: self.guide,
            records: record_out,
            requests: request_in,
            listener,
            net: self.net,
            scene: Arc::new(wire_scene(session, force_limit_n)),
            plan_from_bone: scene.bone_from_plan.inverse(),
            link_name: link_name.to_owned(),
            pose_log: self.pose_log,
            timing_log: self.timing_log,
            viewers: Viewers::new(scene.bone.chunk_count()),
            health: None,
        };
        let rings = Rings {
            records: record_in,
            requests: request_out,
        };
        (publisher, rings)
    }
}

/// A CSV file with these columns.
fn log(path: Option<&Path>, columns: &str) -> Result<Log> {
    let Some(path) = path else {
        return Ok(None);
    };
    let mut log = BufWriter::new(create(path)?);
    writeln!(log, "{columns}")?;
    Ok(Some(Box::new(log)))
}

/// The port for viewers on other machines, where one is asked for.
fn open_port(args: &HapticsArgs) -> Result<Option<Net>> {
    let Some(address) = &args.listen else {
        return Ok(None);
    };
    let identity = keys::identity(&args.keys)?;
    let net = Net::listen(address, identity, keys::trusted(&args.keys)?)?;
    say(&format!(
        "haptics: viewers with a trusted key can connect to {}",
        net.address()
    ));
    Ok(Some(net))
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
