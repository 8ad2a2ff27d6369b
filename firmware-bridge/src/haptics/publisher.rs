//! The publisher: drains the servo's ring into its mirror and serves the viewers. It runs in the
//! main thread, and nothing in it can reach the servo but accepted requests.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 for the screen"
)]

use super::client::{Client, LEFT_EARLY, News};
use super::mirror::Mirror;
use super::record::{Record, TickRecord};
use super::socket;
use super::stats::Stats;
use crate::clinic::guide::Guide;
use crate::clinic::task::{Said, SaidKind};
use crate::passage::Passages;
use glam::DVec3;
use interprocess::local_socket::Listener;
use osteon_protocol::device::DriveState;
use osteon_protocol::ipc::{
    Command, Digest, Health, PoseUpdate, RemovalEvent, Scene, ToViewer, WirePose,
};
use osteon_sim_core::cut::{Cut, CutDigest};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::Request;
use rtrb::{Consumer, Producer};
use std::f64::consts::TAU;
use std::io::Write;
use std::sync::Arc;

/// Viewers at once.
const MAX_CLIENTS: usize = 4;
/// Records taken in one visit.
const MAX_RECORDS: usize = 8192;

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
    pub scene: Arc<Scene>,
    pub plan_from_bone: Pose,
    pub link_name: String,
    pub pose_log: Option<Box<dyn Write + Send>>,
    pub clients: Vec<Client>,
    pub viewers: ViewerCounts,
    /// The viewer that held the clutch has gone.
    pub let_go: bool,
}

/// What happened to the viewers.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ViewerCounts {
    /// Connections that were accepted.
    pub connected: u64,
    /// Connections that ended before the session did.
    pub lost: u64,
    /// Connections that were refused or dropped for what they sent.
    pub refused: u64,
    /// Commands that found the servo's ring full.
    pub dropped_commands: u64,
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
        let clients = &mut self.clients;
        let reset = truth.epoch() != self.mirror.cut.epoch();
        for client in clients.iter_mut().filter(|_| reset) {
            client.reset(truth.epoch());
        }
        self.mirror.catch_up(truth, tool, &mut |chunk, brick| {
            for client in clients.iter_mut() {
                client.dirty.mark(chunk, brick);
            }
        });
    }

    fn take(&mut self, record: &Record) {
        let clients = &mut self.clients;
        self.mirror.apply(record, &mut |chunk, brick| {
            for client in clients.iter_mut() {
                client.dirty.mark(chunk, brick);
            }
        });
        match record {
            Record::Carved { tick, step } => {
                let grid = self.mirror.bone.grid();
                let event = RemovalEvent {
                    tick: *tick,
                    epoch: self.mirror.cut.epoch(),
                    revision: self.mirror.cut.revision(),
                    tool: step.tool,
                    bone_from_tool_before: wire_pose(&step.before),
                    bone_from_tool_after: wire_pose(&step.after),
                    removed_mm3_by_class: self
                        .mirror
                        .cut
                        .totals()
                        .by_class
                        .map(|units| Cut::mm3(grid, units)),
                };
                for client in self.clients.iter_mut().filter(|c| c.is_live()) {
                    client.removal(event);
                }
            }
            Record::Reset { epoch } => {
                for client in &mut self.clients {
                    client.reset(*epoch);
                }
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
            }
            Record::Brick(_) => {}
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
        while let Some(connection) = socket::accept(&self.listener) {
            let chunks = self.mirror.bone.chunk_count();
            let client = connection.and_then(|stream| Client::new(stream, chunks));
            match client {
                Ok(mut client) if self.clients.len() >= MAX_CLIENTS => {
                    self.viewers.refused += 1;
                    let reason = format!("{MAX_CLIENTS} viewers are connected; close one first");
                    if let Err(e) = client.say(&ToViewer::Refused { reason }) {
                        warn(&format!("viewer refused: {e:#}"));
                    }
                }
                Ok(client) => {
                    self.viewers.connected += 1;
                    self.clients.push(client);
                }
                Err(e) => {
                    self.viewers.refused += 1;
                    warn(&format!("{e:#}"));
                    return;
                }
            }
        }
    }

    fn serve(&mut self, final_digest: Option<Digest>) -> bool {
        let pose = self.stats.last.as_ref().map(|t| self.pose_update(t));
        let health: Health = self.stats.health(&self.link_name);
        let news = News {
            scene: &self.scene,
            mirror: &self.mirror,
            pose: pose.as_ref(),
            health: Some(&health),
            final_digest,
        };
        if self.let_go && self.requests.push(Request::Clutch(false)).is_ok() {
            self.let_go = false;
        }
        let mut stop = false;
        let mut kept = Vec::with_capacity(self.clients.len());
        for mut client in self.clients.drain(..) {
            match client.visit(&news) {
                Ok(commands) => {
                    for command in commands {
                        stop |= forward(
                            command,
                            &mut self.requests,
                            &mut self.viewers.dropped_commands,
                        );
                    }
                    kept.push(client);
                }
                Err(e) if e.to_string() == LEFT_EARLY => self.viewers.connected -= 1,
                Err(e) => {
                    self.let_go |= client.holds_clutch;
                    if client.is_live() {
                        self.viewers.lost += 1;
                    } else {
                        self.viewers.refused += 1;
                    }
                    warn(&format!("viewer '{}': {e:#}", client.name));
                }
            }
        }
        self.clients = kept;
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
