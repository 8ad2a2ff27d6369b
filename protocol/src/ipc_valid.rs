//! The documented ranges of the viewer messages, checked after decoding.

use crate::ipc::{
    Bricks, Command, ControlState, FromViewer, Health, MAX_BRICKS, MAX_CHECKPOINTS, MAX_GUARDS,
    MAX_VIEWERS, MOTION_SCALE_MILLI, POSE_HZ, PoseUpdate, RemovalEvent, Scene, TURN_MILLIRAD,
    ToViewer, ToolInfo, WirePose,
};
use crate::ipc_frame::{IpcError, Message};

/// Most tools of a scene.
pub const MAX_TOOLS: usize = 8;

/// Most points of a tool's outline.
pub const MAX_OUTLINE: usize = 256;

/// Most bytes of a name: of a tool, of a viewer.
pub const MAX_NAME: usize = 200;

/// Most bytes of any other text; [`clip`] cuts one to it.
pub const MAX_TEXT: usize = 1024;

/// Most voxels along one axis of a scene.
const MAX_DIM: u32 = 4096;

/// Edge of a chunk, voxels.
const CHUNK: u32 = 32;

/// Bricks of a chunk.
const BRICKS_PER_CHUNK: u8 = 64;

/// The longest beginning of `text` of at most [`MAX_TEXT`] bytes, for senders whose text may be
/// any length (a path).
pub fn clip(text: &str) -> &str {
    &text[..text.floor_char_boundary(MAX_TEXT)]
}

impl Message for ToViewer {
    fn validate(&self) -> Result<(), IpcError> {
        match self {
            Self::Hello { .. } | Self::Digest(_) | Self::Reset { .. } => Ok(()),
            Self::Welcome(welcome) => viewer_number(welcome.number),
            Self::Control(state) => check_control(state),
            Self::Undone {
                removed_mm3_by_class,
                ..
            } => volumes(removed_mm3_by_class),
            Self::Refused { reason } | Self::Bye { reason } | Self::Denied { reason } => {
                text(reason, MAX_TEXT, "reason")
            }
            Self::Scene(scene) => check_scene(scene),
            Self::BonePiece(piece) => {
                let inside = piece.coord.iter().all(|&c| u32::from(c) < MAX_DIM / CHUNK);
                ensure(inside, "chunk coordinate")
            }
            Self::Pose(update) => check_pose_update(update),
            Self::Removals(events) => events.iter().try_for_each(check_removal),
            Self::Bricks(bricks) => check_bricks(bricks),
            Self::Health(health) => check_health(health),
        }
    }
}

impl Message for FromViewer {
    fn validate(&self) -> Result<(), IpcError> {
        match self {
            Self::Hello { name, .. } => text(name, MAX_NAME, "viewer name"),
            Self::Command(command) => command.validate(),
            Self::Digest { .. } => Ok(()),
            Self::Join(join) => ensure(POSE_HZ.contains(&join.pose_hz), "pose rate"),
        }
    }
}

impl Command {
    /// Whether what is asked for is inside its documented range.
    pub fn validate(self) -> Result<(), IpcError> {
        match self {
            Self::SelectTool(tool) => tool_index(tool),
            Self::MotionScale(milli) => ensure(MOTION_SCALE_MILLI.contains(&milli), "motion scale"),
            Self::TurnWorkspace(milli) => {
                ensure(TURN_MILLIRAD.contains(&milli), "turn of the workspace")
            }
            Self::Spindle(_)
            | Self::Pause(_)
            | Self::Reset
            | Self::Stop
            | Self::Clutch(_)
            | Self::Checkpoint
            | Self::Undo
            | Self::AskControl => Ok(()),
            Self::HandOver(number) => viewer_number(number),
        }
    }
}

fn ensure(holds: bool, field: &'static str) -> Result<(), IpcError> {
    if holds {
        Ok(())
    } else {
        Err(IpcError::Range(field))
    }
}

fn text(text: &str, most: usize, field: &'static str) -> Result<(), IpcError> {
    ensure(text.len() <= most, field)
}

fn tool_index(tool: u8) -> Result<(), IpcError> {
    ensure(usize::from(tool) < MAX_TOOLS, "tool index")
}

fn viewer_number(number: u16) -> Result<(), IpcError> {
    ensure(number > 0, "viewer number")
}

fn check_control(state: &ControlState) -> Result<(), IpcError> {
    ensure(state.viewers.len() <= MAX_VIEWERS, "number of viewers")?;
    for number in [state.holder, state.asking].into_iter().flatten() {
        viewer_number(number)?;
    }
    for viewer in &state.viewers {
        viewer_number(viewer.number)?;
        text(&viewer.name, MAX_NAME, "viewer name")?;
    }
    Ok(())
}

fn pose(pose: &WirePose, field: &'static str) -> Result<(), IpcError> {
    let square: f64 = pose.rotation.iter().map(|v| v * v).sum();
    // Also false for a NaN. Wide enough for a quaternion that was rounded to f32 on its way.
    let unit = (square - 1.0).abs() < 1e-3;
    let finite = pose.translation_mm.iter().all(|v| v.is_finite());
    ensure(unit && finite, field)
}

fn amount(value: f64, field: &'static str) -> Result<(), IpcError> {
    ensure(value.is_finite() && value >= 0.0, field)
}

fn check_scene(scene: &Scene) -> Result<(), IpcError> {
    text(&scene.source, MAX_TEXT, "bone source")?;
    let dims = scene.dims.iter().all(|d| (1..=MAX_DIM).contains(d));
    ensure(dims, "voxel count")?;
    let spacing = scene.spacing_mm.iter().all(|h| h.is_finite() && *h > 0.0);
    ensure(spacing, "voxel spacing")?;
    // At most 128³: fits.
    let lattice: u32 = scene.dims.iter().map(|d| d.div_ceil(CHUNK)).product();
    ensure(scene.chunks <= lattice, "chunk count")?;
    pose(&scene.lps_from_bone, "patient pose")?;
    pose(&scene.bone_from_plan, "planned pose")?;
    amount(scene.solid_mm3, "solid volume")?;
    amount(scene.force_limit_n, "force limit")?;
    amount(scene.force_scale, "force scale")?;
    ensure(scene.tools.len() <= MAX_TOOLS, "tool count")?;
    scene.tools.iter().try_for_each(check_tool)
}

fn check_tool(tool: &ToolInfo) -> Result<(), IpcError> {
    text(&tool.name, MAX_NAME, "tool name")?;
    text(&tool.id, MAX_NAME, "tool identifier")?;
    ensure(tool.outline_mm.len() <= MAX_OUTLINE, "tool outline length")?;
    let finite = tool.outline_mm.iter().flatten().all(|v| v.is_finite());
    ensure(finite, "tool outline")?;
    amount(tool.rpm.into(), "tool speed")
}

fn check_pose_update(update: &PoseUpdate) -> Result<(), IpcError> {
    tool_index(update.tool)?;
    pose(&update.bone_from_tool, "tool pose")?;
    pose(&update.bone_from_device, "device pose")?;
    let force = update.force_n.iter().all(|v| v.is_finite()) && update.physical_force_n.is_finite();
    ensure(force, "force")?;
    amount(update.vibration_n.into(), "vibration")?;
    amount(update.spindle_rpm.into(), "spindle speed")?;
    amount(update.spindle_nmm.into(), "spindle torque")?;
    // false for a NaN, too
    let load = (0.0..=1.0).contains(&update.spindle_load);
    ensure(load, "spindle load")?;
    amount(update.motion_scale.into(), "motion scale")?;
    ensure(update.depth_mm.is_finite(), "depth")?;
    amount(update.removed_mm3, "removed volume")?;
    ensure(update.checkpoints <= MAX_CHECKPOINTS, "checkpoints")
}

fn check_removal(event: &RemovalEvent) -> Result<(), IpcError> {
    tool_index(event.tool)?;
    pose(&event.bone_from_tool_before, "pose before a cut")?;
    pose(&event.bone_from_tool_after, "pose after a cut")?;
    volumes(&event.removed_mm3_by_class)
}

fn volumes(by_class: &[f64]) -> Result<(), IpcError> {
    by_class
        .iter()
        .try_for_each(|v| amount(*v, "removed volume"))
}

fn check_bricks(bricks: &Bricks) -> Result<(), IpcError> {
    ensure(bricks.ids.len() <= MAX_BRICKS, "number of bricks")?;
    let inside = bricks
        .ids
        .iter()
        .all(|(_, brick)| *brick < BRICKS_PER_CHUNK);
    ensure(inside, "brick index")
}

fn check_health(health: &Health) -> Result<(), IpcError> {
    let quantiles = [
        health.wake_micros,
        health.tick_micros,
        health.roundtrip_micros,
    ];
    let finite = quantiles.iter().flatten().all(|v| v.is_finite());
    ensure(finite, "latency")?;
    text(&health.drive, MAX_TEXT, "drive state")?;
    text(&health.link, MAX_TEXT, "link name")?;
    ensure(health.guards.len() <= MAX_GUARDS, "number of guards")?;
    for guard in &health.guards {
        text(&guard.name, MAX_NAME, "guard name")?;
    }
    text(&health.note, MAX_TEXT, "note")
}
