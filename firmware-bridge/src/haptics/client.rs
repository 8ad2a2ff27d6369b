//! One viewer's connection, never waited for: at most one batch is in flight, and while it has not
//! gone out nothing more is made.
#![expect(
    clippy::cast_possible_truncation,
    reason = "a bone has fewer than 2^32 chunks"
)]

use super::dirty::DirtySet;
use super::mirror::Mirror;
use anyhow::{Context as _, bail};
use interprocess::local_socket::Stream;
use interprocess::local_socket::traits::Stream as _;
use osteon_protocol::ipc::{
    Command, Digest, FromViewer, Health, IPC_VERSION, PoseUpdate, RemovalEvent, Scene, ToViewer,
};
use osteon_protocol::ipc_frame::{
    PieceValues, StreamDecoder, encode_into, pack_bricks, pack_piece,
};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A viewer must say hello within this time.
const HELLO_TIMEOUT: Duration = Duration::from_secs(3);
/// Removal events kept for a viewer that is slow; older ones are thinned, their sums ride in the
/// newer ones.
const MAX_REMOVALS: usize = 256;
/// Bytes that are put together before they are written.
const BATCH_BYTES: usize = 256 * 1024;
/// Commands taken from one viewer per visit.
const MAX_COMMANDS: usize = 32;
/// Time between two poses: 125 a second.
const POSE_PERIOD: Duration = Duration::from_millis(8);

/// Time between two reports of health.
const HEALTH_PERIOD: Duration = Duration::from_millis(250);

/// Reason of a connection that ended before its hello: somebody only looked whether we are there.
pub(crate) const LEFT_EARLY: &str = "left before its hello";

/// How far a viewer has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Greeting,
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

/// One connected viewer.
pub(crate) struct Client {
    stream: Stream,
    decoder: StreamDecoder,
    out: Vec<u8>,
    written: usize,
    stage: Stage,
    since: Instant,
    last_pose: Instant,
    last_health: Option<Instant>,
    pub name: String,
    pub dirty: DirtySet,
    reset_to: Option<u32>,
    // epoch and mm³ by class
    undone_to: Option<(u32, [f64; 8])>,
    removals: VecDeque<RemovalEvent>,
    asked_digest: bool,
    /// It asked for the clutch and has not let it go.
    pub holds_clutch: bool,
    pub report: Option<ViewerReport>,
}

/// What the publisher has to tell at this moment.
pub(crate) struct News<'a> {
    pub scene: &'a Arc<Scene>,
    pub mirror: &'a Mirror,
    pub pose: Option<&'a PoseUpdate>,
    pub health: Option<&'a Health>,
    /// Set at the session's end: the digest that viewers must answer.
    pub final_digest: Option<Digest>,
}

impl Client {
    /// Takes over an accepted connection.
    pub(crate) fn new(stream: Stream, chunks: usize) -> anyhow::Result<Self> {
        stream
            .set_nonblocking(true)
            .context("viewer connection: cannot make it non-blocking")?;
        let now = Instant::now();
        Ok(Self {
            stream,
            decoder: StreamDecoder::new(),
            out: Vec::new(),
            written: 0,
            stage: Stage::Greeting,
            since: now,
            last_pose: now,
            last_health: None,
            name: "viewer".to_owned(),
            dirty: DirtySet::new(chunks),
            reset_to: None,
            undone_to: None,
            removals: VecDeque::new(),
            asked_digest: false,
            holds_clutch: false,
            report: None,
        })
    }

    /// True once the whole bone has been sent.
    pub(crate) fn is_live(&self) -> bool {
        self.stage == Stage::Live
    }

    /// A carved sub-step.
    pub(crate) fn removal(&mut self, event: RemovalEvent) {
        if self.removals.len() == MAX_REMOVALS {
            self.removals.pop_front();
        }
        self.removals.push_back(event);
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

    /// Reads what has come, writes what can go. `Err` ends the connection, with the reason.
    pub(crate) fn visit(&mut self, news: &News<'_>) -> anyhow::Result<Vec<Command>> {
        let commands = self.read(news)?;
        if self.stage == Stage::Greeting && self.since.elapsed() > HELLO_TIMEOUT {
            bail!("said nothing for 3 s; is it an Osteon viewer?");
        }
        while self.flush()? {
            self.fill(news)?;
            if self.out.is_empty() {
                break;
            }
        }
        Ok(commands)
    }

    /// Puts a last message behind what is in flight.
    pub(crate) fn say(&mut self, message: &ToViewer) -> anyhow::Result<()> {
        encode_into(message, &mut self.out)?;
        self.flush()?;
        Ok(())
    }

    fn read(&mut self, news: &News<'_>) -> anyhow::Result<Vec<Command>> {
        let mut commands = Vec::new();
        let mut buffer = [0u8; 4096];
        match (&self.stream).read(&mut buffer) {
            Ok(0) if self.stage == Stage::Greeting => bail!(LEFT_EARLY),
            Ok(0) => bail!("closed its connection"),
            Ok(n) => self.decoder.push(&buffer[..n]),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(e) => return Err(e).context("read failed"),
        }
        while commands.len() < MAX_COMMANDS {
            match self.decoder.next::<FromViewer>() {
                Ok(Some(message)) => self.take(message, news, &mut commands)?,
                Ok(None) => break,
                Err(e) => bail!("sent what is no message ({e}); use a viewer of the same release"),
            }
        }
        Ok(commands)
    }

    fn take(
        &mut self,
        message: FromViewer,
        news: &News<'_>,
        commands: &mut Vec<Command>,
    ) -> anyhow::Result<()> {
        match message {
            FromViewer::Hello { version, name } => self.greet(version, name, news),
            _ if self.stage == Stage::Greeting => bail!("spoke before its hello"),
            FromViewer::Command(command) => {
                if let Command::Clutch(hold) = command {
                    self.holds_clutch = hold;
                }
                commands.push(command);
                Ok(())
            }
            FromViewer::Digest {
                digest,
                frames_rendered,
                updates,
                resyncs,
            } => {
                if !self.asked_digest {
                    bail!("sent a digest unasked");
                }
                self.report = Some(ViewerReport {
                    digest,
                    frames_rendered,
                    updates,
                    resyncs,
                });
                Ok(())
            }
        }
    }

    fn greet(&mut self, version: u16, name: String, news: &News<'_>) -> anyhow::Result<()> {
        if self.stage != Stage::Greeting {
            bail!("said hello twice");
        }
        self.name = name;
        encode_into(
            &ToViewer::Hello {
                version: IPC_VERSION,
            },
            &mut self.out,
        )?;
        if version != IPC_VERSION {
            let reason = format!(
                "this viewer speaks version {version} of the viewer link, the haptics process version {IPC_VERSION}; update the older of the two"
            );
            self.say(&ToViewer::Refused {
                reason: reason.clone(),
            })?;
            bail!("{reason}");
        }
        encode_into(
            &ToViewer::Scene(Box::new(Scene::clone(news.scene))),
            &mut self.out,
        )?;
        encode_into(
            &ToViewer::Reset {
                epoch: news.mirror.cut.epoch(),
            },
            &mut self.out,
        )?;
        self.stage = Stage::Bone { next_chunk: 0 };
        Ok(())
    }

    /// Writes what is in flight; true where all of it went.
    fn flush(&mut self) -> anyhow::Result<bool> {
        while self.written < self.out.len() {
            match (&self.stream).write(&self.out[self.written..]) {
                Ok(0) => bail!("takes no more bytes"),
                Ok(n) => self.written += n,
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e).context("closed its connection"),
            }
        }
        self.out.clear();
        self.written = 0;
        Ok(true)
    }

    /// Makes the next batch; leaves `out` empty where there is nothing to say.
    fn fill(&mut self, news: &News<'_>) -> anyhow::Result<()> {
        match self.stage {
            Stage::Greeting => Ok(()),
            Stage::Bone { next_chunk } => self.fill_bone(news.mirror, next_chunk),
            Stage::Live => self.fill_live(news),
        }
    }

    fn fill_bone(&mut self, mirror: &Mirror, next_chunk: usize) -> anyhow::Result<()> {
        let bone = &mirror.bone;
        let mut chunk = next_chunk;
        while chunk < bone.chunk_count() && self.out.len() < BATCH_BYTES {
            let data = bone.chunk(chunk);
            let values = PieceValues {
                density_hu: data.density_hu,
                solid: data.solid,
                class: data.class,
                label: data.label,
            };
            let piece = pack_piece(
                chunk as u32,
                bone.chunk_coord(chunk),
                bone.bony_bricks(chunk),
                &values,
            )?;
            encode_into(&ToViewer::BonePiece(piece), &mut self.out)?;
            chunk += 1;
        }
        self.stage = Stage::Bone { next_chunk: chunk };
        if chunk == bone.chunk_count() {
            self.stage = Stage::Live;
            // from here on it is like any viewer with a large dirty set
            for chunk in 0..bone.chunk_count() {
                if mirror.cut.chunk(chunk).is_some() {
                    self.dirty.mark_chunk(chunk);
                }
            }
        }
        Ok(())
    }

    fn fill_live(&mut self, news: &News<'_>) -> anyhow::Result<()> {
        if let Some(epoch) = self.reset_to.take() {
            encode_into(&ToViewer::Reset { epoch }, &mut self.out)?;
        }
        if let Some((epoch, removed_mm3_by_class)) = self.undone_to.take() {
            let undone = ToViewer::Undone {
                epoch,
                removed_mm3_by_class,
            };
            encode_into(&undone, &mut self.out)?;
        }
        if let Some(pose) = news.pose
            && self.last_pose.elapsed() >= POSE_PERIOD
        {
            self.last_pose = Instant::now();
            encode_into(&ToViewer::Pose(*pose), &mut self.out)?;
            if !self.removals.is_empty() {
                let events = self.removals.drain(..).collect();
                encode_into(&ToViewer::Removals(events), &mut self.out)?;
            }
            self.fill_bricks(news.mirror)?;
        }
        if let Some(health) = news.health
            && self
                .last_health
                .is_none_or(|at| at.elapsed() >= HEALTH_PERIOD)
        {
            self.last_health = Some(Instant::now());
            encode_into(&ToViewer::Health(Box::new(health.clone())), &mut self.out)?;
        }
        if let Some(digest) = news.final_digest {
            self.fill_bricks(news.mirror)?;
            if self.dirty.is_clean() && !self.asked_digest {
                self.asked_digest = true;
                encode_into(&ToViewer::Digest(digest), &mut self.out)?;
            }
        }
        Ok(())
    }

    fn fill_bricks(&mut self, mirror: &Mirror) -> anyhow::Result<()> {
        let ids = self.dirty.take();
        if ids.is_empty() {
            return Ok(());
        }
        let mut values = Vec::with_capacity(ids.len() * 512);
        for &(chunk, brick) in &ids {
            // one that an undo has left uncut is news, too
            let brick_values = mirror.cut.values_of(chunk as usize, usize::from(brick));
            values.extend_from_slice(brick_values);
        }
        let message = pack_bricks(mirror.cut.epoch(), mirror.cut.revision(), ids, &values)?;
        encode_into(&ToViewer::Bricks(message), &mut self.out)?;
        Ok(())
    }
}
