//! The messages of a session file that a replay needs, in postcard. See `WIRE.md`, part 3.
//!
//! Everything that goes into the servo's pure step is here, and of what came out enough to compare bit
//! for bit. Units: mm, N, s, rad; poses `a_from_b`; times in ns on the session's own clock, which begins
//! at 0 with the first tick.

use crate::ipc::{Digest, WirePose};
use serde::{Deserialize, Serialize};

/// Version of these messages.
pub const SESSION_VERSION: u16 = 1;

/// Most bytes of one message.
pub const MAX_MESSAGE: usize = 1 << 20;

/// Topic of [`Setup`]: one message, the first.
pub const SETUP_TOPIC: &str = "/osteon/setup";
/// Topic of [`Tick`]: one message a tick.
pub const TICK_TOPIC: &str = "/osteon/ticks";
/// Topic of [`Mark`].
pub const MARK_TOPIC: &str = "/osteon/marks";

/// What the session began with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// [`SESSION_VERSION`].
    pub version: u16,
    /// Program that recorded.
    pub software: String,
    /// Wall clock at the first tick's beginning, ns since 1970, UTC.
    pub began_unix_ns: u64,
    /// The bone's source.
    pub scene: SceneSource,
    /// Tools file, absolute; `None`: the built-in set.
    pub tools: Option<String>,
    /// Files that were read.
    pub files: Vec<InputFile>,
    /// XXH3-64 of the bone as the servo has it.
    pub bone_hash: u64,
    /// Identifier and XXH3-64 of each tool.
    pub tool_hashes: Vec<(String, u64)>,
    /// Every parameter of the feel by its key.
    pub feel: Vec<(String, f64)>,
    /// Length of a tick, s.
    pub tick_s: f64,
    /// Limit of the force at the stylus, N.
    pub force_limit_n: f64,
    /// Registration.
    pub bone_from_base: WirePose,
    /// The plan.
    pub bone_from_plan: WirePose,
    /// The device.
    pub device: Device,
}

/// Where the bone comes from: the options of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneSource {
    /// CT, absolute path; `None`: the built-in phantom.
    pub bone: Option<String>,
    /// Label map, absolute path.
    pub labels: Option<String>,
    /// Labels that are bone.
    pub keep: Vec<u8>,
    /// Plan, absolute path.
    pub pose: Option<String>,
    /// CT number of the surface, HU.
    pub threshold_hu: f32,
    /// Edge of a voxel asked for, mm.
    pub voxel_mm: Option<f64>,
    /// Seed of the phantom's texture.
    pub seed: u64,
    /// Scene: its folder, or the name of one that is built in.
    pub scene: Option<String>,
}

/// A file that a session has read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// The option that named it, without dashes.
    pub role: String,
    /// Absolute path.
    pub path: String,
    /// Length.
    pub bytes: u64,
    /// XXH3-128 of its bytes, hexadecimal.
    pub xxh3: String,
}

/// What the device's numbers mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Device {
    /// Name of the link, for people.
    pub link: String,
    /// Name of the arm.
    pub arm: String,
    /// Encoder counts per revolution (per mm where the arm tells lengths).
    pub counts_per_rev: u32,
    /// Gimbal counts per revolution.
    pub gimbal_counts_per_rev: u16,
    /// Largest torque command, counts.
    pub dac_max: i16,
    /// Torque of one command count, N·mm.
    pub nmm_per_count: f64,
}

/// One servo tick: what went in, what came out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tick {
    /// Number, from 0.
    pub tick: u64,
    /// Beginning, ns.
    pub started_ns: u64,
    /// Delay from its deadline to its beginning, ns.
    pub late_ns: u64,
    /// Whole periods that were skipped before it.
    pub skipped: u64,
    /// The sample that the step took; `None` where none had come since the last tick.
    pub sample: Option<Sample>,
    /// What persons asked for, in its order; at most 8, and [`Request::Reconnected`].
    pub requests: Vec<Request>,
    /// What came out.
    pub outcome: Outcome,
    /// The link, as it was.
    pub link: Link,
}

/// A raw device sample, as the step takes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sample {
    /// Number of the state frame.
    pub seq: u16,
    /// Device clock, µs, wraps.
    pub time_micros: u32,
    /// Joint encoder counts from the dock.
    pub encoders: [i32; 3],
    /// Gimbal counts.
    pub gimbal: [i16; 3],
    /// Bit 0 spindle, bit 1 next tool.
    pub buttons: u8,
    /// Whether the drive applies torque.
    pub drive_active: bool,
    /// Whether the stylus rests in its dock.
    pub docked: bool,
    /// Torques in force, counts.
    pub applied: [i16; 3],
    /// Ticks since the command that the device acknowledged last was made; 0 where none was.
    pub ack_age: u8,
}

/// What a person asked for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// Take a tool.
    SelectTool(u8),
    /// Spindle on or off.
    Spindle(bool),
    /// Pause or go on.
    Pause(bool),
    /// Back to the uncut bone.
    Reset,
    /// Hold the clutch or let it go.
    Clutch(bool),
    /// Millimetres of the tool per millimetre of the stylus.
    MotionScale(f64),
    /// Turn of the workspace, rad.
    TurnWorkspace(f64),
    /// Remember the cut.
    Checkpoint,
    /// Back to the newest checkpoint.
    Undo,
    /// Nobody asked: the device was away before this tick, and is connected again. The first of its tick.
    Reconnected,
}

/// What a tick made. A replay makes the same bytes of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Joint torques for the device, counts.
    pub torque: [i16; 3],
    /// Where the tool is shown and cuts.
    pub bone_from_tool: WirePose,
    /// Where the hand holds it.
    pub bone_from_device: WirePose,
    /// Force on the hand, bone frame, N at the stylus.
    pub force_n: [f64; 3],
    /// Force that a real tool meets, bone frame, N.
    pub physical_force_n: [f64; 3],
    /// Speed of the spindle, rad/s.
    pub spindle_rad_s: f64,
    /// Torque of the cut about it, N·mm at a real tool.
    pub spindle_nmm: f64,
    /// Account of the passivity observer, mJ.
    pub energy_mj: f64,
    /// Removed volume by tissue class, occupancy units.
    pub removed_by_class: [i64; 8],
    /// Counts resets and undos.
    pub epoch: u32,
    /// Steps that began since the reset, less those that were undone.
    pub revision: u64,
    /// Units of work carved.
    pub work: u32,
    /// Index of the tool.
    pub tool: u8,
    /// Checkpoints that can be gone back to.
    pub checkpoints: u8,
    /// Bits of [`flag`].
    pub flags: u8,
}

/// Bits of [`Outcome::flags`].
pub mod flag {
    /// The spindle is switched on.
    pub const SPINDLE_ON: u8 = 1;
    /// The session is paused.
    pub const PAUSED: u8 = 2;
    /// The tool appeared inside bone.
    pub const EMBEDDED: u8 = 4;
    /// The tool has not yet come in front of the joint.
    pub const WAITING: u8 = 8;
    /// A real tool would meet more force.
    pub const SATURATED: u8 = 16;
    /// The clutch is held.
    pub const CLUTCHED: u8 = 32;
    /// The tick had a fresh, plausible sample.
    pub const FRESH: u8 = 64;
}

/// The device link at a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Link {
    /// Drive state of the newest state frame (`WIRE.md`, part 1); 255 where none has come.
    pub drive: u8,
    /// Its fault bits.
    pub faults: u16,
    /// Watchdog trips since the device's boot; wraps.
    pub trips: u8,
    /// State frames accepted.
    pub frames: u64,
    /// Frames refused for a bad CRC or shape.
    pub crc_errors: u64,
    /// State frames missing.
    pub gaps: u64,
    /// State frames refused as stale.
    pub stale: u64,
    /// Commands not sent because the cable was full.
    pub dropped_commands: u64,
}

/// What is not of one tick.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mark {
    /// The cut as the publisher had it after `ticks` ticks, every step that had begun carved whole.
    Digest {
        /// Ticks that were over.
        ticks: u64,
        /// The cut.
        digest: Digest,
    },
    /// Ticks that are not in the file: the disk was too slow for the ring. A replay ends here.
    Lost {
        /// First tick that is missing.
        first: u64,
        /// How many.
        count: u64,
    },
    /// The session ended in good order.
    End {
        /// Ticks in all.
        ticks: u64,
        /// The servo's cut; `None` where the servo panicked.
        digest: Option<Digest>,
        /// Why.
        reason: String,
    },
}

/// Why bytes are no message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NoMessage;

impl core::fmt::Display for NoMessage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("not a message of this version")
    }
}

impl core::error::Error for NoMessage {}

/// The bytes of a message, put into `out` instead of what was there.
pub fn encode<T: Serialize>(message: &T, out: &mut Vec<u8>) -> Result<(), NoMessage> {
    out.clear();
    let bytes = core::mem::take(out);
    *out = postcard::to_extend(message, bytes).map_err(|_shape| NoMessage)?;
    Ok(())
}

/// The message that `bytes` are, to the last one.
pub fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, NoMessage> {
    if bytes.len() > MAX_MESSAGE {
        return Err(NoMessage);
    }
    match postcard::take_from_bytes(bytes) {
        Ok((message, [])) => Ok(message),
        _ => Err(NoMessage),
    }
}
