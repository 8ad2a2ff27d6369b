//! Messages between the haptics process and a viewer. See `WIRE.md`, part 2.
//!
//! Units: mm, N, s; positions in the bone frame (along the lattice, origin at the centre of voxel
//! (0, 0, 0)). Quaternions are (x, y, z, w), unit length. Texts without a limit of their own hold at
//! most 1024 bytes ([`crate::ipc_frame::MAX_TEXT`]).

use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

pub use crate::ipc_join::{
    ControlState, Join, MAX_FROM_VIEWER, MAX_VIEWERS, POSE_HZ, Resume, Role, ViewerInfo, Welcome,
    capability,
};

/// Version of the viewer link.
pub const IPC_VERSION: u16 = 4;

/// Most bytes of one framed message's payload. Bounded before it is believed.
pub const MAX_PAYLOAD: usize = 1 << 20;

/// Most bricks of one [`Bricks`] message.
pub const MAX_BRICKS: usize = 256;

/// Most guards of one [`Health`] message.
pub const MAX_GUARDS: usize = 32;

/// Most checkpoints of a session at once.
pub const MAX_CHECKPOINTS: u8 = 8;

/// Motion scales that can be asked for, thousandths.
pub const MOTION_SCALE_MILLI: RangeInclusive<u16> = 200..=5000;

/// Turns of the workspace that can be asked for at once, thousandths of a radian: half a turn.
pub const TURN_MILLIRAD: RangeInclusive<i16> = -3142..=3142;

/// The user's private directory for sockets and links: `osteon` in the runtime directory, or in
/// `osteon-<user>` under the temporary one where there is none.
pub fn private_dir(runtime: Option<&Path>, temporary: &Path, user: u32) -> PathBuf {
    let own = || temporary.join(format!("osteon-{user}"));
    runtime
        .filter(|dir| !dir.as_os_str().is_empty())
        .map_or_else(own, Path::to_owned)
        .join("osteon")
}

/// The socket at which a haptics process listens where none is named.
pub fn default_socket(runtime: Option<&Path>, temporary: &Path, user: u32) -> PathBuf {
    private_dir(runtime, temporary, user).join("haptics.sock")
}

/// A rigid transform on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WirePose {
    /// Quaternion (x, y, z, w).
    pub rotation: [f64; 4],
    /// Translation, mm.
    pub translation_mm: [f64; 3],
}

/// A tool's shape, enough to draw it. Tool frame: origin at the tip's apex, z from the tip towards
/// the shank.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolInfo {
    /// Name for people, for example "glenoid reamer".
    pub name: String,
    /// Identifier in reports, for example `reamer`.
    pub id: String,
    /// Outline of the solid of revolution as (r, z) points in mm, from the apex up to the shank's
    /// end; at most 256.
    pub outline_mm: Vec<[f32; 2]>,
    /// Speed of its spindle without a load, turns a minute; 0 where it does not turn.
    pub rpm: f32,
}

/// What is on the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Where the bone comes from, for people.
    pub source: String,
    /// Voxels along x, y, z.
    pub dims: [u32; 3],
    /// Voxel spacing, mm.
    pub spacing_mm: [f64; 3],
    /// Bone frame to DICOM LPS.
    pub lps_from_bone: WirePose,
    /// Planned axis: tool frame at first touch (apex at the glenoid's centre, z outward).
    pub bone_from_plan: WirePose,
    /// Number of [`BonePiece`]s that follow: the chunks that are kept.
    pub chunks: u32,
    /// Solid volume, mm³.
    pub solid_mm3: f64,
    /// Tools in the order of their index; at most 8.
    pub tools: Vec<ToolInfo>,
    /// Limit of the force at the stylus, N.
    pub force_limit_n: f64,
    /// Newtons at the stylus for one newton at a real tool.
    pub force_scale: f64,
}

/// One 32³ chunk of the immutable bone. Pieces come in index order 0, 1, 2, …; the index is the
/// chunk's number in all later messages.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BonePiece {
    /// Index of this chunk.
    pub chunk: u32,
    /// Chunk coordinate (units of 32 voxels).
    pub coord: [u16; 3],
    /// Bricks (bit = brick) where bone can be.
    pub bony: u64,
    /// LZ4 block of [`PIECE_BYTES`] bytes: density i16 LE ×32768, solid i16 LE ×32768, class u8
    /// ×32768, label u8 ×32768; brick-major.
    #[serde(with = "crate::bytes")]
    pub lz4: Vec<u8>,
}

/// Unpacked size of a [`BonePiece`].
pub const PIECE_BYTES: usize = 32_768 * 6;

/// Unpacked size of one brick's cut values.
pub const BRICK_BYTES: usize = 1024;

/// The newest pose and force; newest wins, may be thinned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent facts, shown one by one"
)]
pub struct PoseUpdate {
    /// Servo tick.
    pub tick: u64,
    /// Index of the tool in hand.
    pub tool: u8,
    /// Whether the spindle turns.
    pub spindle_on: bool,
    /// Whether the session is paused (no force, no cutting).
    pub paused: bool,
    /// Whether the clutch is held: the tool waits, the stylus moves freely.
    pub clutched: bool,
    /// Whether a real tool would meet more force than the stylus may show.
    pub saturated: bool,
    /// Where the tool is shown and cuts: the proxy.
    pub bone_from_tool: WirePose,
    /// Where the hand holds the tool; inside the bone when it pushes.
    pub bone_from_device: WirePose,
    /// Force at the stylus, bone frame, N.
    pub force_n: [f32; 3],
    /// Force that a real tool meets, N: before guards and ramps, up to the limit.
    pub physical_force_n: f32,
    /// The vibration in `force_n`, N.
    pub vibration_n: f32,
    /// Speed of the spindle, turns a minute.
    pub spindle_rpm: f32,
    /// Torque of the cut about it, N·mm at a real tool.
    pub spindle_nmm: f32,
    /// The same over what its motor has, in [0, 1].
    pub spindle_load: f32,
    /// Millimetres of the tool per millimetre of the stylus.
    pub motion_scale: f32,
    /// Depth of the tool's apex along the planned axis past the plan's origin, mm.
    pub depth_mm: f32,
    /// mm³ removed since the last reset, less what was undone.
    pub removed_mm3: f64,
    /// Checkpoints that [`Command::Undo`] can go back to; at most [`MAX_CHECKPOINTS`].
    pub checkpoints: u8,
}

/// One carved sub-step. Thinning loses no sum: the totals are cumulative.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RemovalEvent {
    /// Servo tick.
    pub tick: u64,
    /// Counts resets and undos.
    pub epoch: u32,
    /// Number of this sub-step since the reset, from 1; an undo takes it back to the checkpoint's.
    pub revision: u64,
    /// Index of the tool.
    pub tool: u8,
    /// Pose at the beginning of the sub-step.
    pub bone_from_tool_before: WirePose,
    /// Pose at its end.
    pub bone_from_tool_after: WirePose,
    /// mm³ removed since the last reset, by tissue class (air, cartilage, subchondral, cancellous,
    /// cortical, 3 spare).
    pub removed_mm3_by_class: [f64; 8],
}

/// Lossless state of the cut in some bricks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bricks {
    /// Counts resets and undos; a viewer drops the cut of an older epoch.
    pub epoch: u32,
    /// The sender's sub-step count when these values were read.
    pub revision: u64,
    /// (chunk, brick) of each, at most [`MAX_BRICKS`].
    pub ids: Vec<(u32, u8)>,
    /// LZ4 block of `ids.len()` × [`BRICK_BYTES`] bytes: cut distance i16 LE ×512 a brick.
    #[serde(with = "crate::bytes")]
    pub lz4: Vec<u8>,
}

/// Digest of the cut ([`Scene`]'s bone, all changed chunks).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Digest {
    /// Counts resets and undos.
    pub epoch: u32,
    /// Sub-steps since the reset, less those that were undone.
    pub revision: u64,
    /// XXH3.
    pub hash: u64,
    /// Chunks with a cut.
    pub changed_chunks: u32,
}

/// What one guard of the force loop had to do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GuardCount {
    /// Its name, for people; at most 200 bytes.
    pub name: String,
    /// Ticks in which it intervened.
    pub count: u64,
    /// The last of them, from 1; 0 where it never did.
    pub last_tick: u64,
}

/// How the haptics process fares; about four a second.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Health {
    /// Servo ticks so far.
    pub ticks: u64,
    /// Ticks that began more than 0.5 ms after their deadline.
    pub late_ticks: u64,
    /// Wake-up delay: p50, p99, p99.9, max, µs.
    pub wake_micros: [f32; 4],
    /// Duration of a tick: p50, p99, p99.9, max, µs.
    pub tick_micros: [f32; 4],
    /// Command to acknowledgement: p50, p99, p99.9, max, µs.
    pub roundtrip_micros: [f32; 4],
    /// Drive state of the device, for people.
    pub drive: String,
    /// Device link, for example `open:/dev/ttyACM0`.
    pub link: String,
    /// State frames received.
    pub frames: u64,
    /// Frames refused for a bad CRC or shape.
    pub crc_errors: u64,
    /// Missing state frames.
    pub gaps: u64,
    /// Watchdog trips of the device.
    pub watchdog_trips: u64,
    /// Interventions of all guards: clamps, slews, refused samples.
    pub guard_events: u64,
    /// The same guard by guard, in the order of their place in a tick; at most [`MAX_GUARDS`].
    pub guards: Vec<GuardCount>,
    /// Why the force is off, or empty.
    pub note: String,
}

/// Haptics to viewer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum ToViewer {
    /// First message. Its bytes stay as they are in every future version, so that any viewer can
    /// name the version of any haptics process.
    Hello {
        /// [`IPC_VERSION`] of the haptics process.
        version: u16,
    },
    /// The viewer is refused; the connection ends.
    Refused {
        /// Why, and what to do.
        reason: String,
    },
    /// What is on the table. All pieces follow.
    Scene(Box<Scene>),
    /// A chunk of bone.
    BonePiece(BonePiece),
    /// Newest pose.
    Pose(PoseUpdate),
    /// Carved sub-steps, oldest first.
    Removals(Vec<RemovalEvent>),
    /// State of bricks.
    Bricks(Bricks),
    /// All that was carved up to this digest has been sent; the viewer answers with its own.
    Digest(Digest),
    /// How the haptics process fares.
    Health(Box<Health>),
    /// The cut was reset: drop it and go on under this epoch.
    Reset {
        /// The new epoch.
        epoch: u32,
    },
    /// The session has ended in good order.
    Bye {
        /// Why.
        reason: String,
    },
    /// The cut is an earlier one's again: keep it, go on under this epoch; the bricks that differ
    /// follow.
    Undone {
        /// The new epoch.
        epoch: u32,
        /// mm³ removed since the last reset, less what was undone, by tissue class.
        removed_mm3_by_class: [f64; 8],
    },
    /// Answer to [`FromViewer::Join`].
    Welcome(Welcome),
    /// Who is here and who is in control.
    Control(ControlState),
    /// A wish was refused; the connection goes on. At most four a second.
    Denied {
        /// Why, and what to do.
        reason: String,
    },
}

/// What a person may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// Take a tool in hand.
    SelectTool(u8),
    /// Spindle on or off.
    Spindle(bool),
    /// Pause (no force, no cutting) or go on.
    Pause(bool),
    /// Back to the uncut bone.
    Reset,
    /// End the session.
    Stop,
    /// Hold the clutch or let it go: while it is held the tool waits and the stylus moves freely.
    Clutch(bool),
    /// Thousandths of a millimetre of the tool per millimetre of the stylus, in
    /// [`MOTION_SCALE_MILLI`]. The tool stays where it is.
    MotionScale(u16),
    /// Turns the workspace about the line of sight by thousandths of a radian, in
    /// [`TURN_MILLIRAD`]. The tool stays where it is.
    TurnWorkspace(i16),
    /// Remember the cut as it is.
    Checkpoint,
    /// Back to the newest checkpoint, which is used up.
    Undo,
    /// Asks for control: at once where nobody has it, the one in control has gone or reads nothing,
    /// or a trainer asks a trainee; else the one in control is told and may hand over.
    AskControl,
    /// The one in control gives it to the viewer of this number.
    HandOver(u16),
}

/// Viewer to haptics.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum FromViewer {
    /// First message. Its bytes stay as they are in every future version, so that any viewer can be
    /// refused by name.
    Hello {
        /// [`IPC_VERSION`] of the viewer.
        version: u16,
        /// Program and adapter, for people; at most 200 bytes.
        name: String,
    },
    /// A person's wish.
    Command(Command),
    /// Answer to [`ToViewer::Digest`], and the viewer's counters.
    Digest {
        /// The viewer's own digest of its mirror.
        digest: Digest,
        /// Frames drawn by this viewer.
        frames_rendered: u64,
        /// Bricks taken over.
        updates: u64,
        /// Times that this viewer started from an empty mirror.
        resyncs: u64,
    },
    /// Second message: as what the viewer joins.
    Join(Join),
}
