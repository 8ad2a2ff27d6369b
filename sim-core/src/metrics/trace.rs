//! What the process metrics need of a session: a row a tick, from a recording or from memory.

use crate::pose::Pose;
use crate::tissue::TISSUES;
use glam::DVec3;

/// Length of a tick, s.
pub const TICK_S: f64 = 0.001;

/// One tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceTick {
    /// Number of the tick; ticks that were skipped are missing.
    pub tick: u64,
    /// Pose of the tool (the proxy's, never the device's): origin at its tip, z towards the shank.
    pub bone_from_tool: Pose,
    /// Force shown at the stylus, bone frame, N.
    pub shown_n: DVec3,
    /// Length of the force at a real tool, N.
    pub physical_n: f64,
    /// Index of the tool in hand.
    pub tool: u8,
    /// The spindle's switch.
    pub spindle_on: bool,
    /// Removed volume so far by tissue class, mm³.
    pub removed_mm3: [f64; TISSUES],
}

/// A session's ticks in their order, and the tools in the order of their index.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SessionTrace {
    /// A row a tick.
    pub ticks: Vec<TraceTick>,
    /// Identifier and name of each tool.
    pub tools: Vec<(String, String)>,
}

impl TraceTick {
    /// The tool's tip, bone frame, mm.
    pub fn tip(&self) -> DVec3 {
        self.bone_from_tool.translation
    }

    /// Unit direction from the tip to the shank, bone frame.
    pub fn axis(&self) -> DVec3 {
        self.bone_from_tool.vector(DVec3::Z)
    }

    /// Removed in all, mm³.
    pub fn removed(&self) -> f64 {
        self.removed_mm3.iter().sum()
    }
}

impl SessionTrace {
    /// Time of a tick since the first, s.
    pub fn seconds(&self, tick: u64) -> f64 {
        let first = self.ticks.first().map_or(0, |t| t.tick);
        tick.saturating_sub(first) as f64 * TICK_S
    }

    /// Runs of ticks with one tool while it removes bone: from the first removal to the last.
    pub fn uses(&self) -> Vec<(u8, &[TraceTick])> {
        let mut all = Vec::new();
        for run in self.ticks.chunk_by(|a, b| a.tool == b.tool) {
            let start = run.first().map_or(0.0, TraceTick::removed);
            let end = run.last().map_or(0.0, TraceTick::removed);
            if end <= start {
                continue;
            }
            let from = run.partition_point(|t| t.removed() <= start);
            let to = run.partition_point(|t| t.removed() < end);
            all.push((run[0].tool, &run[from..run.len().min(to + 1)]));
        }
        all
    }
}
