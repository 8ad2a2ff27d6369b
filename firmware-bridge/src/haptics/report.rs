//! The session report of the haptics process.

use super::loads::{GuardReport, Loads, by_guard};
use super::publisher::wire_digest;
use super::stats::{Quantiles, Stats};
use super::viewers::{ViewerCounts, Viewers};
use crate::feel::in_force;
use crate::link::LinkStats;
use crate::passage::Passage;
use crate::recording::RecordingReport;
use crate::scene::Scene;
use osteon_protocol::ipc::Digest;
use osteon_sim_core::cut::{Cut, CutDigest};
use osteon_sim_core::feel::Feel;
use osteon_sim_core::tissue::Tissue;
use osteon_sim_core::tool::Tool;
use serde::Serialize;
use std::collections::BTreeMap;

/// What the session was done on.
#[derive(Debug, Clone, Serialize)]
pub struct BoneReport {
    /// Where the bone is from.
    pub source: String,
    /// All other figures.
    #[serde(flatten)]
    pub summary: crate::scene::SceneSummary,
}

/// The device link.
#[derive(Debug, Clone, Serialize)]
pub struct DeviceReport {
    /// Its name.
    pub link: String,
    /// State frames accepted.
    pub frames: u64,
    /// Frames refused for a bad CRC or shape.
    pub crc_errors: u64,
    /// State frames missing in the sequence.
    pub gaps: u64,
    /// State frames refused as stale.
    pub stale: u64,
    /// Commands that the full cable dropped.
    pub dropped_commands: u64,
    /// Watchdog trips.
    pub watchdog_trips: u64,
    /// Times that the device went away and came back.
    pub reconnects: u64,
}

/// The viewers.
#[derive(Debug, Clone, Serialize)]
pub struct ViewerReport {
    /// Frames drawn by the viewer that was there at the end.
    pub frames_rendered: u64,
    /// Bricks that it took over.
    pub updates: u64,
    /// Times that a viewer began from an empty mirror.
    pub resyncs: u64,
    /// Viewers that joined, resumed ones included.
    pub connected: u64,
    /// Of them: came back after a break and went on where they were.
    pub resumed: u64,
    /// Connections of viewers that ended before the session.
    pub lost: u64,
    /// Connections refused, or dropped for what they sent.
    pub refused: u64,
    /// Wishes refused because another viewer was in control.
    pub denied: u64,
    /// Most memory held for viewers at one time, bytes.
    pub peak_bytes: usize,
    /// What the most viewers at one time could have made of it, whatever they did, bytes.
    pub bound_bytes: usize,
    /// Commands that came faster than the servo takes them.
    pub dropped_commands: u64,
}

/// Digests of the cut, hexadecimal; equal when everybody holds the same bone.
#[derive(Debug, Clone, Serialize)]
pub struct DigestReport {
    /// The servo's.
    pub servo: String,
    /// The publisher's mirror's.
    pub publisher: String,
    /// The viewer's; absent where none answered.
    pub viewer: Option<String>,
    /// Viewers whose digest is another one.
    pub strayed_viewers: usize,
    /// Chunks with a cut.
    pub changed_chunks: u32,
    /// Resets.
    pub epoch: u32,
    /// Carved sub-steps since the last reset.
    pub revision: u64,
}

/// The whole report.
#[derive(Debug, Clone, Serialize)]
pub struct SessionReport {
    /// The bone.
    pub bone: BoneReport,
    /// Servo ticks.
    pub ticks: u64,
    /// Wall-clock length of the servo's run, s.
    pub seconds: f64,
    /// Ticks that began more than 0.5 ms after their deadline.
    pub late_ticks: u64,
    /// The same, second by second.
    pub late_ticks_per_s: Vec<u64>,
    /// Periods that were skipped because a tick began that late.
    pub skipped_periods: u64,
    /// Delay from deadline to start.
    pub wake_us: Quantiles,
    /// Duration of a tick.
    pub tick_us: Quantiles,
    /// Of a tick: reading the device.
    pub tick_read_us: Quantiles,
    /// Of a tick: the pure step.
    pub tick_compute_us: Quantiles,
    /// Command sent to its acknowledgement seen (includes up to one period at either end).
    pub device_roundtrip_us: Quantiles,
    /// Removed volume, mm³.
    pub removed_mm3: f64,
    /// By tool.
    pub removed_by_tool_mm3: BTreeMap<String, f64>,
    /// By tissue class.
    pub removed_by_tissue_mm3: BTreeMap<String, f64>,
    /// By structure label.
    pub removed_by_label_mm3: BTreeMap<String, f64>,
    /// Centroid of what was removed, DICOM LPS, mm.
    pub removed_centroid_lps_mm: Option<[f64; 3]>,
    /// Its distance from the planned axis, mm.
    pub removed_centroid_off_axis_mm: Option<f64>,
    /// By tool and layer along the planned axis: time of the tip in it, force at the stylus.
    pub passages: Vec<Passage>,
    /// Every parameter of the feel by its key, in the units of its table.
    pub feel: BTreeMap<&'static str, f64>,
    /// Newtons at the stylus for one newton at a real tool.
    pub force_scale: f64,
    /// Largest loads, and ticks at a limit.
    #[serde(flatten)]
    pub loads: Loads,
    /// Interventions of all guards.
    pub guard_events: u64,
    /// The same guard by guard.
    pub guards: BTreeMap<String, GuardReport>,
    /// Records that found the ring full.
    pub ring_overflows: u64,
    /// Real-time rights that were refused.
    pub realtime_refused: Vec<String>,
    /// The device.
    pub device: DeviceReport,
    /// The viewers.
    pub viewer: ViewerReport,
    /// The digests.
    pub digest: DigestReport,
    /// The recording; `null` where none was asked for.
    pub recording: Option<RecordingReport>,
    /// Why the session ended.
    pub ended: String,
}

/// What the report is made from.
pub(crate) struct Facts<'a> {
    pub scene: &'a Scene,
    pub tools: &'a [Tool],
    pub feel: &'a Feel,
    pub stats: &'a Stats,
    pub passages: Vec<Passage>,
    pub servo_digest: CutDigest,
    /// The servo's, when it had stopped.
    pub cut: &'a Cut,
    pub mirror_digest: CutDigest,
    pub link_name: String,
    pub link: LinkStats,
    pub reconnects: u64,
    pub viewers: ViewerCounts,
    pub viewer: Option<super::viewers::ViewerReport>,
    /// Viewers whose last digest is not the servo's.
    pub strayed: usize,
    pub seconds: f64,
    pub realtime_refused: Vec<String>,
    pub recording: Option<RecordingReport>,
    pub ended: String,
}

impl SessionReport {
    pub(crate) fn new(facts: &Facts<'_>) -> Self {
        let grid = facts.scene.bone.grid();
        let totals = facts.cut.totals();
        let mm3 = |units: i64| Cut::mm3(grid, units);
        let centroid = facts.cut.centroid(&facts.scene.bone);
        let plan_from_bone = facts.scene.bone_from_plan.inverse();
        let stats = facts.stats;
        let guards = stats.last.map(|t| t.guards).unwrap_or_default();
        Self {
            bone: BoneReport {
                source: facts.scene.source.clone(),
                summary: facts.scene.summary.clone(),
            },
            ticks: stats.ticks,
            seconds: facts.seconds,
            late_ticks: stats.late_ticks,
            late_ticks_per_s: stats.late_per_second.clone(),
            skipped_periods: stats.skipped_periods,
            wake_us: stats.wake.quantiles(),
            tick_us: stats.tick.quantiles(),
            tick_read_us: stats.read.quantiles(),
            tick_compute_us: stats.compute.quantiles(),
            device_roundtrip_us: stats.roundtrip.quantiles(),
            removed_mm3: mm3(totals.units()),
            removed_by_tool_mm3: (facts.tools.iter().zip(totals.by_tool))
                .map(|(tool, units)| (tool.id.clone(), mm3(units)))
                .collect(),
            removed_by_tissue_mm3: Tissue::ALL
                .iter()
                .map(|t| (t.name().to_owned(), mm3(totals.by_class[*t as usize])))
                .collect(),
            removed_by_label_mm3: (0..)
                .zip(totals.by_label.iter())
                .filter(|(_, units)| **units != 0)
                .map(|(label, units): (u32, _)| (label.to_string(), mm3(*units)))
                .collect(),
            removed_centroid_lps_mm: centroid
                .map(|c| facts.scene.bone.lps_from_bone().point(c).to_array()),
            removed_centroid_off_axis_mm: centroid
                .map(|c| plan_from_bone.point(c).truncate().length()),
            passages: facts.passages.clone(),
            feel: in_force(facts.feel),
            force_scale: facts.feel.force_scale,
            loads: stats.loads.clone(),
            guard_events: guards.total(),
            guards: by_guard(&guards),
            ring_overflows: stats.last.map_or(0, |t| t.ring_overflows),
            realtime_refused: facts.realtime_refused.clone(),
            device: facts.device(),
            viewer: facts.viewer(),
            digest: facts.digest(),
            recording: facts.recording.clone(),
            ended: facts.ended.clone(),
        }
    }

    /// True where all digests that exist are equal.
    pub fn digests_agree(&self) -> bool {
        let d = &self.digest;
        d.servo == d.publisher && d.strayed_viewers == 0
    }
}

impl Facts<'_> {
    fn device(&self) -> DeviceReport {
        DeviceReport {
            link: self.link_name.clone(),
            frames: self.link.frames,
            crc_errors: self.link.crc_errors,
            gaps: self.link.gaps,
            stale: self.link.stale,
            dropped_commands: self.link.dropped_commands,
            watchdog_trips: self.stats.trips(),
            reconnects: self.reconnects,
        }
    }

    fn viewer(&self) -> ViewerReport {
        let last = self.viewer;
        ViewerReport {
            frames_rendered: last.map_or(0, |v| v.frames_rendered),
            updates: last.map_or(0, |v| v.updates),
            resyncs: self.viewers.connected - self.viewers.resumed,
            connected: self.viewers.connected,
            resumed: self.viewers.resumed,
            lost: self.viewers.lost,
            refused: self.viewers.refused,
            denied: self.viewers.denied,
            peak_bytes: self.viewers.peak_bytes,
            bound_bytes: Viewers::most_held(self.scene.bone.chunk_count(), self.viewers.most),
            dropped_commands: self.viewers.dropped_commands,
        }
    }

    fn digest(&self) -> DigestReport {
        let hex = |d: Digest| format!("{:016x}", d.hash);
        DigestReport {
            servo: hex(wire_digest(self.servo_digest)),
            publisher: hex(wire_digest(self.mirror_digest)),
            viewer: self.viewer.map(|v| hex(v.digest)),
            strayed_viewers: self.strayed,
            changed_chunks: self.servo_digest.changed_chunks,
            epoch: self.servo_digest.epoch,
            revision: self.servo_digest.revision,
        }
    }
}
