//! The publisher: drains the servo's ring into its mirror and serves the viewers. It runs in the
//! main thread, and nothing in it can reach the servo but accepted requests.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 for the screen"
)]

use super::mirror::Mirror;
use super::net::{self, Net};
use super::record::{Record, TickRecord};
use super::socket;
use super::stats::Stats;
use super::viewers::{Facts, Peer, Viewers};
use crate::clinic::guide::Guide;
use crate::clinic::task::{Said, SaidKind};
use crate::passage::Passages;
use crate::rt::now_ns;
use glam::DVec3;
use interprocess::local_socket::Listener;
use osteon_protocol::device::DriveState;
use osteon_protocol::ipc::{Command, Digest, Health, PoseUpdate, RemovalEvent, Scene, WirePose};
use osteon_sim_core::cut::{Cut, CutDigest};
use osteon_sim_core::grid::BRICKS_PER_CHUNK;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::Request;
use rtrb::{Consumer, Producer};
use std::f64::consts::TAU;
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Records taken in one visit.
const MAX_RECORDS: usize = 8192;
/// Connections accepted in one visit.
const MAX_ACCEPTED: usize = 8;
/// Time between two looks at the quantiles for viewers.
const HEALTH_PERIOD: Duration = Duration::from_millis(100);

/// The publisher's state.
pub(crate) struct Publisher {
    pub mirror: Mirror,
    pub stats: Stats,
    pub passages: Passages,
    /// The task, where one is set.
    pub guide: Option<Guide>,
    pub records: Consumer<Record>,
    pub requests: Producer<Request>,
    pub listener: Listener,
    /// The port for other machines, where one was asked for.
    pub net: Option<Net>,
    pub scene: Arc<Scene>,
    pub plan_from_bone: Pose,
    pub link_name: String,
    pub pose_log: Option<Box<dyn Write + Send>>,
    pub timing_log: Option<Box<dyn Write + Send>>,
    pub viewers: Viewers,
    pub health: Option<(Instant, Health)>,
}

/// A pose as it goes over the wire.
pub(crate) fn wire_pose(pose: &Pose) -> WirePose {
    WirePose {
        rotation: pose.rotation.to_array(),
        translation_mm: pose.translation.to_array(),
    }
}

/// A digest as it goes over the wire.
pub(crate) fn wire_digest(digest: CutDigest) -> Digest {
    Digest {
        epoch: digest.epoch,
        revision: digest.revision,
        hash: digest.hash,
        changed_chunks: digest.changed_chunks,
    }
}

/// What a task says, on stderr.
#[expect(clippy::print_stderr, reason = "for the trainee and the trainer")]
fn say_task(said: &Said) {
    let kind = match said.kind {
        SaidKind::Hint => "hint",
        SaidKind::Done => "done",
        SaidKind::Stop => "STOP",
    };
    eprintln!("task {:>7.1} s {kind}: {}", said.at_s, said.text);
}

impl Publisher {
    /// One visit: take what the servo wrote, then talk to the viewers. True where somebody asked to
    /// end the session.
    pub(crate) fn visit(&mut self, final_digest: Option<Digest>) -> bool {
        self.drain();
        self.accept();
        self.serve(final_digest)
    }

    /// Takes all that is in the ring.
    pub(crate) fn drain(&mut self) {
        for _ in 0..MAX_RECORDS {
            let Ok(record) = self.records.pop() else {
                return;
            };
            self.take(&record);
        }
    }

    /// Takes over what the servo still owed when it stopped.
    pub(crate) fn catch_up(&mut self, truth: &Cut) {
        let tool = self.stats.last.map_or(0, |t| t.tool);
        let viewers = &mut self.viewers;
        if truth.epoch() != self.mirror.cut.epoch() {
            viewers.reset(truth.epoch());
        }
        self.mirror.catch_up(truth, tool, &mut |chunk, brick| {
            viewers.mark(chunk, brick);
        });
    }

    /// Shows another moment of the session under a new epoch: the bricks that differ follow.
    pub(crate) fn leap(&mut self, cut: &Cut, epoch: u32) {
        let mirror = &mut self.mirror;
        for chunk in 0..mirror.bone.chunk_count() {
            let touched = mirror.cut.touched(chunk) | cut.touched(chunk);
            for brick in (0..BRICKS_PER_CHUNK).filter(|b| touched >> b & 1 == 1) {
                if mirror.cut.values_of(chunk, brick) != cut.values_of(chunk, brick) {
                    self.viewers.mark(chunk, brick);
                }
            }
        }
        mirror.cut = cut.clone();
        mirror.cut.set_epoch(epoch);
        let removed = mirror.removed_mm3_by_class();
        self.viewers.undone(epoch, removed);
    }

    /// Takes over a record.
    pub(crate) fn take(&mut self, record: &Record) {
        let viewers = &mut self.viewers;
        self.mirror.apply(record, &mut |chunk, brick| {
            viewers.mark(chunk, brick);
        });
        match record {
            Record::Carved { tick, step } => {
                let event = RemovalEvent {
                    tick: *tick,
                    epoch: self.mirror.cut.epoch(),
                    revision: self.mirror.cut.revision(),
                    tool: step.tool,
                    bone_from_tool_before: wire_pose(&step.before),
                    bone_from_tool_after: wire_pose(&step.after),
                    removed_mm3_by_class: self.mirror.removed_mm3_by_class(),
                };
                self.viewers.removal(&event);
            }
            Record::Reset { epoch } => {
                self.viewers.reset(*epoch);
            }
            Record::Tick(tick) => {
                let before = self.stats.last.and_then(|t| t.drive);
                if tick.drive == Some(DriveState::Fault) && before != tick.drive {
                    warn(
                        "the device has a fault: its motors are off; look at the device, then start anew",
                    );
                }
                self.stats.add(tick);
                self.passages.add(tick);
                let cut = &self.mirror.cut;
                if let Some(said) = self.guide.as_mut().and_then(|g| g.tick(tick, cut)) {
                    say_task(&said);
                }
                self.log_pose(tick);
                self.log_timing(tick);
            }
            Record::Undone { epoch, .. } => {
                let removed = self.mirror.removed_mm3_by_class();
                self.viewers.undone(*epoch, removed);
            }
            Record::Brick(_) | Record::Checkpoint { .. } => {}
        }
    }

    fn log_timing(&mut self, tick: &TickRecord) {
        let Some(log) = &mut self.timing_log else {
            return;
        };
        let held = self.viewers.held();
        let (now, wake, took) = (now_ns(), tick.wake_ns, tick.duration_ns);
        if let Err(e) = writeln!(log, "{now},{wake},{took},{},{held}", tick.skipped) {
            warn(&format!("timing log: {e}; it ends here"));
            self.timing_log = None;
        }
    }

    fn log_pose(&mut self, tick: &TickRecord) {
        let (Some(log), Some((seq, micros))) = (&mut self.pose_log, tick.state) else {
            return;
        };
        let p = tick.stylus_in_base;
        if let Err(e) = writeln!(log, "{},{seq},{micros},{},{},{}", tick.tick, p.x, p.y, p.z) {
            warn(&format!("pose log: {e}; it ends here"));
            self.pose_log = None;
        }
    }

    fn accept(&mut self) {
        self.accept_local();
        let news = self.net.as_mut().map(|net| net.visit(MAX_ACCEPTED));
        for news in news.into_iter().flatten() {
            match news {
                net::News::Viewer(wire, peer) => self.viewers.admit(wire, peer),
                net::News::Refused(why) => self.viewers.refuse("a connection to the port", &why),
            }
        }
    }

    fn accept_local(&mut self) {
        for _ in 0..MAX_ACCEPTED {
            match socket::accept(&self.listener) {
                None => return,
                Some(Ok(stream)) => self.viewers.admit(Box::new(stream), Peer::Local),
                Some(Err(e)) => {
                    self.viewers.refuse("a connection:", &format!("{e:#}"));
                    return;
                }
            }
        }
    }

    fn serve(&mut self, final_digest: Option<Digest>) -> bool {
        if self.viewers.let_go && self.requests.push(Request::Clutch(false)).is_ok() {
            self.viewers.let_go = false;
        }
        if self
            .health
            .as_ref()
            .is_none_or(|(at, _)| at.elapsed() >= HEALTH_PERIOD)
        {
            self.health = Some((Instant::now(), self.stats.health(&self.link_name)));
        }
        let wishes = self.viewers.visit(&Facts {
            scene: &self.scene,
            mirror: &self.mirror,
            pose: self.stats.last.as_ref().map(|t| self.pose_update(t)),
            health: self.health.as_ref().map(|(_, health)| health),
            final_digest,
        });
        let dropped = &mut self.viewers.counts.dropped_commands;
        let mut stop = false;
        for command in wishes {
            stop |= forward(command, &mut self.requests, dropped);
        }
        stop
    }

    fn pose_update(&self, tick: &TickRecord) -> PoseUpdate {
        let grid = self.mirror.bone.grid();
        let felt = &tick.felt;
        let tip: DVec3 = self.plan_from_bone.point(tick.bone_from_tool.translation);
        PoseUpdate {
            tick: tick.tick,
            tool: tick.tool,
            spindle_on: tick.flags.spindle_on,
            paused: tick.flags.paused,
            clutched: tick.flags.clutched,
            saturated: tick.flags.saturated,
            bone_from_tool: wire_pose(&tick.bone_from_tool),
            bone_from_device: wire_pose(&tick.bone_from_device),
            force_n: tick.force_n.as_vec3().to_array(),
            physical_force_n: felt.physical_force_n as f32,
            vibration_n: felt.vibration_n as f32,
            spindle_rpm: (felt.spindle_rad_s * 60.0 / TAU) as f32,
            spindle_nmm: felt.spindle_nmm as f32,
            spindle_load: felt.spindle_load as f32,
            motion_scale: felt.motion_scale as f32,
            depth_mm: -tip.z as f32,
            removed_mm3: Cut::mm3(grid, tick.removed_by_class.iter().sum()),
            checkpoints: tick.checkpoints,
        }
    }
}

/// Hands a viewer's wish to the servo; true where it asks to end the session. A full request ring
/// drops the wish: a person presses again. A wish out of its range is none.
pub(super) fn forward(
    command: Command,
    requests: &mut Producer<Request>,
    dropped: &mut u64,
) -> bool {
    // the decoder has refused it already; the servo's loop does not rely on that
    if command.validate().is_err() {
        return false;
    }
    let request = match command {
        Command::SelectTool(tool) => Request::SelectTool(tool),
        Command::Spindle(on) => Request::Spindle(on),
        Command::Pause(paused) => Request::Pause(paused),
        Command::Reset => Request::Reset,
        Command::Stop => return true,
        Command::Clutch(hold) => Request::Clutch(hold),
        Command::MotionScale(milli) => Request::MotionScale(f64::from(milli) / 1000.0),
        Command::TurnWorkspace(milli) => Request::TurnWorkspace(f64::from(milli) / 1000.0),
        Command::Checkpoint => Request::Checkpoint,
        Command::Undo => Request::Undo,
        // the viewers' own affair
        Command::AskControl | Command::HandOver(_) => return false,
    };
    if requests.push(request).is_err() {
        if *dropped == 0 {
            warn("a viewer sends commands faster than the servo takes them; some are dropped");
        }
        *dropped += 1;
    }
    false
}

#[expect(
    clippy::print_stderr,
    reason = "warnings of a command-line program go to stderr"
)]
pub(crate) fn warn(text: &str) {
    eprintln!("haptics: {text}");
}
