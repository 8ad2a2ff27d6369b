//! What is kept of a viewer, connected or not: how far it has come, what it has not seen, what it may.
//! Bounded by the bone, whatever the viewer does.
#![expect(
    clippy::cast_possible_truncation,
    reason = "a bone has fewer than 2^32 chunks"
)]

use super::dirty::DirtySet;
use super::line::{Ended, Line, Peer};
use super::pace::Pace;
use super::sent::Sent;
use super::{BATCH_BYTES, News};
use crate::haptics::mirror::Mirror;
use osteon_protocol::ipc::{
    Command, Digest, FromViewer, Join, RemovalEvent, Resume, Role, Scene, ToViewer, Welcome,
    capability,
};
use osteon_protocol::ipc_frame::{PieceValues, pack_bricks, pack_piece};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Removal events kept for a viewer, and sent with one pose at most; older ones are thinned, their
/// sums ride in the newer ones.
const MAX_REMOVALS: usize = 32;
/// Commands taken from one viewer per visit.
const MAX_COMMANDS: usize = 32;
/// Bytes made for one viewer in one visit, so that a fast one keeps nobody waiting.
const VISIT_BYTES: usize = 1 << 20;
/// Time between two rounds of bricks; in it, later values replace earlier ones.
const BRICK_PERIOD: Duration = Duration::from_millis(33);
/// Time between two reports of health.
const HEALTH_PERIOD: Duration = Duration::from_millis(250);
/// Time between two answers to refused wishes.
const DENIED_PERIOD: Duration = Duration::from_millis(250);

/// How far a viewer has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Bone { next_chunk: usize },
    Live,
}

/// What a viewer reported at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ViewerReport {
    pub digest: Digest,
    pub frames_rendered: u64,
    pub updates: u64,
    pub resyncs: u64,
}

/// One viewer.
#[derive(Debug)]
pub(crate) struct Seat {
    pub number: u16,
    /// With it the seat can be resumed.
    pub token: u64,
    /// Who it is; nobody else can resume it.
    pub peer: Peer,
    pub name: String,
    pub role: Role,
    pub granted: u32,
    /// The connection, while there is one.
    pub line: Option<Line>,
    /// When the connection was lost.
    pub left_at: Option<Instant>,
    stage: Stage,
    // everything cut before it came has been sent: from here on bricks are paced
    caught_up: bool,
    pub dirty: DirtySet,
    reset_to: Option<u32>,
    // epoch and mm³ by class
    undone_to: Option<(u32, [f64; 8])>,
    removals: VecDeque<RemovalEvent>,
    sent: Sent,
    pace: Pace,
    pose_period: Duration,
    last_pose: Instant,
    last_bricks: Instant,
    last_health: Option<Instant>,
    last_denied: Option<Instant>,
    // the change of the control state that it was told last; 0 = none
    told: u64,
    asked_digest: bool,
    /// It asked for the clutch and has not let it go.
    pub holds_clutch: bool,
    pub report: Option<ViewerReport>,
}

impl Seat {
    /// A new viewer, which begins empty.
    pub(crate) fn new(
        (number, token, peer): (u16, u64, Peer),
        name: String,
        join: &Join,
        chunks: usize,
    ) -> Self {
        let now = Instant::now();
        Self {
            number,
            token,
            peer,
            name,
            role: join.role,
            granted: granted(join),
            line: None,
            left_at: None,
            stage: Stage::Bone { next_chunk: 0 },
            caught_up: false,
            dirty: DirtySet::new(chunks),
            reset_to: None,
            undone_to: None,
            removals: VecDeque::new(),
            sent: Sent::default(),
            pace: Pace::new(now),
            pose_period: period(join),
            last_pose: now,
            last_bricks: now,
            last_health: None,
            last_denied: None,
            told: 0,
            asked_digest: false,
            holds_clutch: false,
            report: None,
        }
    }

    /// Whether `bit` of [`capability`] is granted.
    pub(crate) fn has(&self, bit: u32) -> bool {
        self.granted & bit != 0
    }

    /// True once the whole bone has been sent.
    pub(crate) fn is_live(&self) -> bool {
        self.stage == Stage::Live
    }

    /// Greets a new viewer: scene and bone follow.
    pub(crate) fn welcome(
        &mut self,
        mut line: Line,
        session: u64,
        scene: &Scene,
        epoch: u32,
    ) -> Result<(), Ended> {
        line.put(&ToViewer::Welcome(self.card(session, false)))?;
        line.put(&ToViewer::Scene(Box::new(scene.clone())))?;
        line.put(&ToViewer::Reset { epoch })?;
        self.line = Some(line);
        Ok(())
    }

    /// Takes a viewer back that was here before: what it may have missed is owed to it again.
    pub(crate) fn welcome_back(
        &mut self,
        mut line: Line,
        session: u64,
        join: &Join,
        resume: &Resume,
        mirror: &Mirror,
    ) -> Result<(), Ended> {
        self.role = join.role;
        self.granted = granted(join);
        self.pose_period = period(join);
        line.put(&ToViewer::Welcome(self.card(session, true)))?;
        self.line = Some(line);
        self.left_at = None;
        self.told = 0;
        self.asked_digest = false;
        self.report = None;
        self.removals.clear();
        self.caught_up = false;
        let epoch = mirror.cut.epoch();
        let chunks = mirror.bone.chunk_count();
        let lost = self.sent.resume_from(resume.batches);
        let pieces = (resume.pieces as usize).min(match self.stage {
            Stage::Bone { next_chunk } => next_chunk,
            Stage::Live => chunks,
        });
        if pieces < chunks {
            self.stage = Stage::Bone { next_chunk: pieces };
            self.reset_to = Some(epoch);
        } else if let Some(ids) = lost.filter(|_| resume.epoch == epoch) {
            for (chunk, brick) in ids {
                self.dirty.mark(chunk as usize, usize::from(brick));
            }
        } else {
            self.reset_to = Some(epoch);
            self.mark_all(mirror);
        }
        // its sums may be old
        self.undone_to = Some((epoch, mirror.removed_mm3_by_class()));
        Ok(())
    }

    fn card(&self, session: u64, resumed: bool) -> Welcome {
        Welcome {
            session,
            seat: self.token,
            number: self.number,
            granted: self.granted,
            resumed,
        }
    }

    fn mark_all(&mut self, mirror: &Mirror) {
        self.dirty.clear();
        for chunk in 0..mirror.bone.chunk_count() {
            self.dirty.mark_bricks(chunk, mirror.cut.touched(chunk));
        }
    }

    /// A carved sub-step.
    pub(crate) fn removal(&mut self, event: &RemovalEvent) {
        if !self.is_live() || self.line.is_none() || !self.has(capability::REMOVALS) {
            return;
        }
        if self.removals.len() == MAX_REMOVALS {
            self.removals.pop_front();
        }
        self.removals.push_back(*event);
    }

    /// The cut was reset: what was owed is worthless.
    pub(crate) fn reset(&mut self, epoch: u32) {
        self.dirty.clear();
        self.removals.clear();
        self.reset_to = Some(epoch);
        self.undone_to = None;
    }

    /// The cut is a checkpoint's again: the bricks that differ are marked, the others stay.
    pub(crate) fn undone(&mut self, epoch: u32, removed_mm3_by_class: [f64; 8]) {
        self.removals.clear();
        self.undone_to = Some((epoch, removed_mm3_by_class));
    }

    /// Reads what has come, writes what can go; its wishes.
    pub(crate) fn visit(&mut self, news: &News<'_>) -> Result<Vec<Command>, Ended> {
        let Some(mut line) = self.line.take() else {
            return Ok(Vec::new());
        };
        // an error drops the line, which closes it
        let commands = self.hear(&mut line)?;
        let mut made = 0;
        while line.flush()? && made < VISIT_BYTES {
            self.fill(&mut line, news)?;
            if line.waiting() == 0 {
                break;
            }
            made += line.waiting();
        }
        self.line = Some(line);
        Ok(commands)
    }

    fn hear(&mut self, line: &mut Line) -> Result<Vec<Command>, Ended> {
        line.read()?;
        let mut commands = Vec::new();
        while commands.len() < MAX_COMMANDS {
            match line.next()? {
                None => break,
                Some(FromViewer::Hello { .. } | FromViewer::Join(_)) => {
                    return Err(Ended::Rude("joined twice".to_owned()));
                }
                Some(FromViewer::Command(command)) => commands.push(command),
                Some(FromViewer::Digest {
                    digest,
                    frames_rendered,
                    updates,
                    resyncs,
                }) => {
                    if !self.asked_digest {
                        return Err(Ended::Rude("sent a digest unasked".to_owned()));
                    }
                    self.report = Some(ViewerReport {
                        digest,
                        frames_rendered,
                        updates,
                        resyncs,
                    });
                }
            }
        }
        Ok(commands)
    }

    /// Says that a wish was refused, at most four times a second.
    pub(crate) fn deny(&mut self, reason: String) {
        let due = self
            .last_denied
            .is_none_or(|t| t.elapsed() >= DENIED_PERIOD);
        if let (true, Some(line)) = (due, &mut self.line) {
            self.last_denied = Some(Instant::now());
            // a line that cannot take it ends at its next visit
            line.put(&ToViewer::Denied { reason }).unwrap_or(());
        }
    }

    /// Makes the next batch; leaves the line empty where there is nothing to say.
    fn fill(&mut self, line: &mut Line, news: &News<'_>) -> Result<(), Ended> {
        if self.told != news.control_change {
            self.told = news.control_change;
            line.put(&ToViewer::Control(news.control.clone()))?;
        }
        match self.stage {
            Stage::Bone { next_chunk } => self.fill_bone(line, news.mirror, next_chunk),
            Stage::Live => self.fill_live(line, news),
        }
    }

    fn fill_bone(
        &mut self,
        line: &mut Line,
        mirror: &Mirror,
        next_chunk: usize,
    ) -> Result<(), Ended> {
        let bone = &mirror.bone;
        let mut chunk = next_chunk;
        while chunk < bone.chunk_count() && line.waiting() < BATCH_BYTES {
            let data = bone.chunk(chunk);
            let values = PieceValues {
                density_hu: data.density_hu,
                solid: data.solid,
                class: data.class,
                label: data.label,
            };
            let coord = bone.chunk_coord(chunk);
            let piece = pack_piece(chunk as u32, coord, bone.bony_bricks(chunk), &values);
            let piece = piece.map_err(|e| Ended::Left(format!("cannot be sent the bone: {e}")))?;
            line.put(&ToViewer::BonePiece(piece))?;
            chunk += 1;
        }
        self.stage = Stage::Bone { next_chunk: chunk };
        if chunk == bone.chunk_count() {
            self.stage = Stage::Live;
            // from here on it is like any viewer with a large dirty set
            self.mark_all(mirror);
            self.undone_to = Some((mirror.cut.epoch(), mirror.removed_mm3_by_class()));
        }
        Ok(())
    }

    fn fill_live(&mut self, line: &mut Line, news: &News<'_>) -> Result<(), Ended> {
        if let Some(epoch) = self.reset_to.take() {
            line.put(&ToViewer::Reset { epoch })?;
        }
        if let Some((epoch, removed_mm3_by_class)) = self.undone_to.take() {
            line.put(&ToViewer::Undone {
                epoch,
                removed_mm3_by_class,
            })?;
        }
        let now = Instant::now();
        if let Some(pose) = news.pose
            && now - self.last_pose >= self.pose_period
        {
            self.last_pose = now;
            line.put(&ToViewer::Pose(*pose))?;
            if !self.removals.is_empty() {
                line.put(&ToViewer::Removals(self.removals.drain(..).collect()))?;
            }
        }
        self.fill_cut(line, news, now)?;
        // the first one tells the viewer that its picture is whole
        let may_hear = self.caught_up && self.has(capability::HEALTH);
        if let Some(health) = news.health.filter(|_| may_hear)
            && self.last_health.is_none_or(|t| now - t >= HEALTH_PERIOD)
        {
            self.last_health = Some(now);
            line.put(&ToViewer::Health(Box::new(health.clone())))?;
        }
        if let Some(digest) = news.final_digest
            && self.dirty.is_clean()
            && self.has(capability::DIGEST)
            && !self.asked_digest
        {
            self.asked_digest = true;
            line.put(&ToViewer::Digest(digest))?;
        }
        Ok(())
    }

    /// Bricks: as fast as they go for one that catches up and at the end, else in rounds and paced.
    fn fill_cut(&mut self, line: &mut Line, news: &News<'_>, now: Instant) -> Result<(), Ended> {
        if !self.caught_up || news.final_digest.is_some() {
            self.caught_up |= self.dirty.is_clean();
            self.fill_bricks(line, news.mirror)?;
            return Ok(());
        }
        if now - self.last_bricks < BRICK_PERIOD {
            return Ok(());
        }
        self.last_bricks = now;
        while self.pace.may_send(now) && line.waiting() < BATCH_BYTES {
            let sent = self.fill_bricks(line, news.mirror)?;
            if sent == 0 {
                break;
            }
            self.pace.spend(sent);
        }
        Ok(())
    }

    /// One message of bricks; its bytes.
    fn fill_bricks(&mut self, line: &mut Line, mirror: &Mirror) -> Result<usize, Ended> {
        let ids = self.dirty.take();
        if ids.is_empty() {
            return Ok(0);
        }
        let before = line.waiting();
        let mut values = Vec::with_capacity(ids.len() * 512);
        for &(chunk, brick) in &ids {
            // one that an undo has left uncut is news, too
            values.extend_from_slice(mirror.cut.values_of(chunk as usize, usize::from(brick)));
        }
        let (epoch, revision) = (mirror.cut.epoch(), mirror.cut.revision());
        let message = pack_bricks(epoch, revision, ids.clone(), &values)
            .map_err(|e| Ended::Left(format!("cannot be sent the cut: {e}")))?;
        line.put(&ToViewer::Bricks(message))?;
        self.sent.remember(ids);
        Ok(line.waiting() - before)
    }

    /// Bytes of memory that it holds.
    pub(crate) fn held(&self) -> usize {
        let removals = self.removals.capacity() * size_of::<RemovalEvent>();
        let line = self.line.as_ref().map_or(0, Line::held);
        size_of::<Self>() + line + removals + self.sent.held() + self.dirty.held()
    }

    /// Most bytes that [`Self::held`] can give for a bone of so many chunks.
    pub(crate) fn most_held(chunks: usize) -> usize {
        let removals = 2 * MAX_REMOVALS * size_of::<RemovalEvent>();
        size_of::<Self>() + Line::MOST_HELD + removals + Sent::MOST_HELD + 8 * chunks
    }
}

fn granted(join: &Join) -> u32 {
    let known = join.capabilities & capability::ALL;
    if join.role == Role::Projector {
        known & !capability::CONTROL
    } else {
        known
    }
}

fn period(join: &Join) -> Duration {
    Duration::from_secs_f64(1.0 / f64::from(join.pose_hz.max(1)))
}
