//! What goes into a servo tick and what comes out.

use crate::arm::Arm;
use crate::bone::Bone;
use crate::carve::CarveStep;
use crate::feel::Feel;
use crate::pose::Pose;
use crate::proxy::MAX_SUBSTEPS;
use crate::tool::Tool;
use glam::DVec3;
use std::sync::Arc;

/// Bits of [`Sample::buttons`].
pub mod button {
    /// Toggles the spindle.
    pub const SPINDLE: u8 = 1;
    /// Takes the next tool.
    pub const NEXT_TOOL: u8 = 2;
}

/// What the numbers of the device mean, from its hello message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceScale {
    /// Kinematic model.
    pub arm: Arm,
    /// Encoder counts per revolution of its shaft; per mm where the arm tells lengths.
    pub counts_per_rev: u32,
    /// Gimbal counts per revolution.
    pub gimbal_counts_per_rev: u16,
    /// Largest torque command, DAC counts.
    pub dac_max: i16,
    /// Torque of one command count at the motor's shaft (the joint's, where no gear lies between), N·mm;
    /// N where the arm takes forces.
    pub nmm_per_count: f64,
}

/// One raw device sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Device clock, µs, wraps.
    pub time_micros: u32,
    /// Joint encoder counts from the dock.
    pub encoders: [i32; 3],
    /// Gimbal counts.
    pub gimbal: [i16; 3],
    /// [`button`] bits that are pressed.
    pub buttons: u8,
    /// Whether the drive applies torque (active or holding).
    pub drive_active: bool,
    /// Whether the stylus rests in its dock.
    pub docked: bool,
    /// Joint torques in force from this sample on, DAC counts, as the device reports them.
    pub applied: [i16; 3],
    /// Ticks since the command was made that the device last acknowledged; 0 where none was.
    pub ack_age: u8,
}

/// What a person may ask for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// Take a tool; an index beyond the set is ignored.
    SelectTool(u8),
    /// Spindle on or off.
    Spindle(bool),
    /// Pause or go on.
    Pause(bool),
    /// Back to the uncut bone.
    Reset,
    /// Hold the clutch or let it go: while it is held the tool waits and the stylus moves freely.
    Clutch(bool),
    /// Millimetres of the tool per millimetre of the stylus; out of range it is ignored.
    MotionScale(f64),
    /// Turns the workspace about the line of sight, rad.
    TurnWorkspace(f64),
    /// Remember the cut as it is, once no step is pending.
    Checkpoint,
    /// Back to the newest checkpoint, which is used up; without one it is ignored.
    Undo,
}

/// Requests that a tick hears at most.
pub const MAX_REQUESTS: usize = 8;
/// One of each request, and a checkpoint that had to wait.
const MAX_EVENTS: usize = MAX_REQUESTS + 1;

/// What became of the cut as a whole, before anything was carved in the tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutEvent {
    /// It is the uncut bone's again.
    Reset {
        /// The new epoch.
        epoch: u32,
    },
    /// It was remembered.
    Checkpoint {
        /// Number of the checkpoint.
        id: u32,
    },
    /// It is a checkpoint's again; the bricks may follow in later ticks.
    Undone {
        /// Number of the checkpoint.
        id: u32,
        /// The new epoch.
        epoch: u32,
    },
}

/// The events of a tick, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CutEvents {
    list: [CutEvent; MAX_EVENTS],
    len: usize,
}

impl CutEvents {
    /// None.
    pub const NONE: Self = Self {
        list: [CutEvent::Reset { epoch: 0 }; MAX_EVENTS],
        len: 0,
    };

    /// Adds one; there is room for those of a tick.
    pub(super) fn push(&mut self, event: CutEvent) {
        if let Some(place) = self.list.get_mut(self.len) {
            *place = event;
            self.len += 1;
        }
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = CutEvent> {
        self.list[..self.len].iter().copied()
    }
}

/// What one tick made.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent facts, shown one by one"
)]
pub struct TickOutput {
    /// Joint torques for the device, DAC counts.
    pub torque: [i16; 3],
    /// Gimbal centre in the base frame, mm, from this tick's sample (or the last one).
    pub stylus_in_base: DVec3,
    /// Where the hand holds the tool.
    pub bone_from_device: Pose,
    /// Where the tool is shown and cuts.
    pub bone_from_tool: Pose,
    /// Force on the hand, bone frame, N at the stylus.
    pub force_n: DVec3,
    /// Force that a real tool meets, bone frame, N: the coupling's, over the force scale.
    pub physical_force_n: DVec3,
    /// Whether a real tool would meet more: the coupling is at the limit.
    pub saturated: bool,
    /// Torque that holds or turns a real tool in the bone, bone frame, N·mm. Three motors cannot show it.
    pub holding_torque_nmm: DVec3,
    /// Speed of the spindle, rad/s.
    pub spindle_rad_s: f64,
    /// Torque of the cut about it, N·mm at a real tool.
    pub spindle_nmm: f64,
    /// The same over what the motor has, in [0, 1]: what a drill's sound follows.
    pub spindle_load: f64,
    /// The vibration that is part of `force_n`, N.
    pub vibration_n: DVec3,
    /// Work of the hand on the bone in this tick, mJ at the stylus; never negative.
    pub hand_mj: f64,
    /// Work of the spindle in this tick, mJ at a real tool.
    pub spindle_mj: f64,
    /// What the passivity observer has on its account, mJ.
    pub energy_mj: f64,
    /// Newton iterations of the contact solves.
    pub iterations: u32,
    /// Their worst residual, N.
    pub residual_n: f64,
    /// Index of the tool in hand.
    pub tool: u8,
    /// Whether the spindle is switched on.
    pub spindle_on: bool,
    /// Whether the session is paused.
    pub paused: bool,
    /// The tool appeared inside bone: no force until it is pulled free.
    pub embedded: bool,
    /// The tool has not yet come in front of the joint since it left the dock: no contact.
    pub waiting: bool,
    /// The clutch is held.
    pub clutched: bool,
    /// Whether this tick had a fresh, plausible sample.
    pub fresh: bool,
    /// Counts resets and undos.
    pub epoch: u32,
    /// What became of the cut as a whole, before `carved`.
    pub events: CutEvents,
    /// Checkpoints that can be gone back to.
    pub checkpoints: u8,
    /// Carved steps in the order in which they began; the first `carved_len` count. The last may be
    /// finished in a later tick ([`crate::servo::Servo::carving`]).
    pub carved: [CarveStep; MAX_SUBSTEPS],
    /// Number of carved steps.
    pub carved_len: usize,
    /// Units of work carved in this tick ([`crate::servo::TICK_WORK`]).
    pub work: u32,
    /// Occupancy units removed since the reset, by tissue class, after this tick.
    pub removed_by_class: [i64; crate::tissue::TISSUES],
}

/// What a servo is made from.
#[derive(Debug, Clone)]
pub struct ServoSetup {
    /// The bone.
    pub bone: Arc<Bone>,
    /// Tools, at most [`crate::cut::MAX_TOOLS`]; at least one.
    pub tools: Vec<Tool>,
    /// Registration ([`crate::register::bone_from_base`]).
    pub bone_from_base: Pose,
    /// The plan: origin at the glenoid's centre, z outward.
    pub bone_from_plan: Pose,
    /// Meaning of the device's numbers.
    pub device: DeviceScale,
    /// Force limit asked for by the user, N.
    pub force_limit_n: f64,
    /// What the hand feels.
    pub feel: Feel,
}
