//! What crosses from the servo thread to the publisher: fixed-size records through a ring.

use crate::link::LinkStats;
use glam::DVec3;
use osteon_protocol::device::DriveState;
use osteon_sim_core::carve::CarveStep;
use osteon_sim_core::chain::GuardCounts;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Servo, TickOutput};
use osteon_sim_core::tissue::TISSUES;

/// Records that the ring holds: more than three seconds of the busiest ticks, ten of usual ones.
pub(crate) const RING_RECORDS: usize = 16_384;

/// One record. Order in the ring is order in time.
#[derive(Debug, Clone, Copy)]
#[expect(
    clippy::large_enum_variant,
    reason = "a ring of fixed-size records: the size is bounded by the largest"
)]
pub(crate) enum Record {
    /// A carved sub-step: the publisher carves the same into its mirror.
    Carved {
        /// Servo tick.
        tick: u64,
        /// What was carved.
        step: CarveStep,
    },
    /// The cut was reset.
    Reset {
        /// The new epoch.
        epoch: u32,
    },
    /// The cut was remembered: the mirror does the same.
    Checkpoint {
        /// The servo's number of it.
        id: u32,
    },
    /// The cut is a checkpoint's again.
    Undone {
        /// The servo's number of it.
        id: u32,
        /// The new epoch.
        epoch: u32,
    },
    /// A brick's values after carved records were lost to a full ring.
    Brick(BrickCopy),
    /// One tick, after all that was carved in it.
    Tick(TickRecord),
}

/// Most cut values that one record carries: an eighth of a brick, so that records stay small.
pub(crate) const COPY_VALUES: usize = 64;

/// Part of a brick, copied out of the servo's cut.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BrickCopy {
    pub chunk: u32,
    pub brick: u8,
    /// First value, in units of [`COPY_VALUES`], in `0..8`.
    pub part: u8,
    /// Tool in hand, for the account by tool.
    pub tool: u8,
    pub values: [i16; COPY_VALUES],
}

/// What the publisher needs of a tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TickRecord {
    pub tick: u64,
    /// Delay from the deadline to the start of the tick, ns.
    pub wake_ns: u64,
    /// Duration of the tick, ns.
    pub duration_ns: u64,
    /// Of it: reading the device, ns.
    pub read_ns: u64,
    /// Of it: the pure step, ns. The rest is writing to the device.
    pub compute_ns: u64,
    /// Command to acknowledgement, ns, where one came in this tick.
    pub roundtrip_ns: Option<u64>,
    /// Whole periods that were skipped before this tick.
    pub skipped: u64,
    /// Number and device time (µs) of the state used, where it was fresh.
    pub state: Option<(u16, u32)>,
    /// Gimbal centre in the base frame, mm.
    pub stylus_in_base: DVec3,
    pub bone_from_device: Pose,
    pub bone_from_tool: Pose,
    pub force_n: DVec3,
    pub felt: Felt,
    pub tool: u8,
    pub flags: Flags,
    pub removed_by_class: [i64; TISSUES],
    pub epoch: u32,
    /// Checkpoints that can be gone back to.
    pub checkpoints: u8,
    /// Steps that began since the reset: what the mirror carves, the servo's pending one included.
    pub revision: u64,
    pub drive: Option<DriveState>,
    pub trips: u8,
    pub guards: GuardCounts,
    pub link: LinkStats,
    /// Records that found the ring full so far.
    pub ring_overflows: u64,
}

/// Yes-or-no facts of a tick.
#[derive(Debug, Clone, Copy, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent facts, shown one by one"
)]
pub(crate) struct Flags {
    pub spindle_on: bool,
    pub paused: bool,
    pub embedded: bool,
    pub waiting: bool,
    /// A real tool would meet more than the stylus may show.
    pub saturated: bool,
    pub clutched: bool,
}

/// What the force loop knows beside the force that it shows; of vectors their lengths.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Felt {
    /// At a real tool, N.
    pub physical_force_n: f64,
    /// Part of the force at the stylus, N.
    pub vibration_n: f64,
    /// At a real tool, N·mm.
    pub holding_torque_nmm: f64,
    pub spindle_rad_s: f64,
    /// Torque of the cut about the spindle, N·mm at a real tool.
    pub spindle_nmm: f64,
    /// The same over what its motor has, in [0, 1].
    pub spindle_load: f64,
    /// Account of the passivity observer, mJ.
    pub energy_mj: f64,
    /// Millimetres of the tool per millimetre of the stylus.
    pub motion_scale: f64,
}

impl Flags {
    /// Of a tick.
    pub(crate) fn of(output: &TickOutput) -> Self {
        Self {
            spindle_on: output.spindle_on,
            paused: output.paused,
            embedded: output.embedded,
            waiting: output.waiting,
            saturated: output.saturated,
            clutched: output.clutched,
        }
    }
}

impl Felt {
    /// Of a tick, and of the servo after it.
    pub(crate) fn of(output: &TickOutput, servo: &Servo) -> Self {
        Self {
            physical_force_n: output.physical_force_n.length(),
            vibration_n: output.vibration_n.length(),
            holding_torque_nmm: output.holding_torque_nmm.length(),
            spindle_rad_s: output.spindle_rad_s,
            spindle_nmm: output.spindle_nmm,
            spindle_load: output.spindle_load,
            energy_mj: output.energy_mj,
            motion_scale: servo.motion_scale(),
        }
    }
}
