//! The viewer's copy of the session: scene, bone, cut, newest pose and health.
//!
//! Filled by the link thread from decoded messages; read by the renderer and the panels. Nothing
//! here trusts the other side: every count and index is checked before it is used.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::bricks::{BrickMap, Dirty, lattice_brick};
use crate::history::History;
use glam::{DQuat, DVec3};
use osteon_protocol::ipc::{
    BonePiece, Bricks, ControlState, Digest, Health, PoseUpdate, RemovalEvent, Resume, Scene,
    ToViewer, Welcome, WirePose, capability,
};
use osteon_protocol::ipc_frame::{unpack_bricks, unpack_piece};
use osteon_sim_core::bone::{Bone, ChunkData};
use osteon_sim_core::cut::Cut;

use osteon_sim_core::grid::{BRICK_VOXELS, BRICKS_PER_CHUNK, Grid};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::{TISSUES, Tissue};
use std::sync::Arc;

/// Most chunks of a bone: 256 kB each in the mirror, 2 GiB in all.
pub(crate) const MAX_CHUNKS: usize = 8192;

/// Why a message could not be taken over. The connection ends.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum MirrorError {
    /// The scene makes no sense or exceeds a bound.
    #[error("the scene is refused: {0}")]
    Scene(String),
    /// A chunk of bone makes no sense.
    #[error("bone piece {chunk} is refused: {why}")]
    Piece {
        /// Index of the chunk.
        chunk: u32,
        /// What is wrong.
        why: String,
    },
    /// A brick update makes no sense.
    #[error("a brick update is refused: {0}")]
    Bricks(String),
    /// A message came before the one that it needs.
    #[error("{0}")]
    Order(&'static str),
}

/// The bone with its cut, complete.
#[derive(Debug)]
pub(crate) struct Model {
    /// The immutable bone.
    pub(crate) bone: Arc<Bone>,
    /// What was cut away.
    pub(crate) cut: Cut,
    /// The bricks that are drawn.
    pub(crate) map: Arc<BrickMap>,
    /// Slots to upload.
    pub(crate) dirty: Dirty,
}

/// How far the session is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum End {
    /// Ended in good order, with the reason.
    Bye(String),
    /// The link failed, with an error line.
    Failed(String),
}

/// The viewer's copy of the session.
#[derive(Debug, Default)]
pub(crate) struct Mirror {
    /// What is on the table.
    pub(crate) scene: Option<Arc<Scene>>,
    /// The bone, once all pieces are here.
    pub(crate) model: Option<Model>,
    // the bone while its pieces arrive
    loading: Option<Bone>,
    /// Newest pose.
    pub(crate) pose: Option<PoseUpdate>,
    /// Newest health.
    pub(crate) health: Option<Health>,
    /// mm³ removed since the last reset, by tissue class.
    pub(crate) removed_mm3: [f64; TISSUES],
    /// Force and depth of the last seconds.
    pub(crate) history: History,
    /// Bricks taken over.
    pub(crate) updates: u64,
    /// Times that the mirror began empty.
    pub(crate) resyncs: u64,
    /// Counts everything that changes the picture.
    pub(crate) revision: u64,
    /// Why there will be no more messages.
    pub(crate) end: Option<End>,
    /// Who this viewer is to the haptics process.
    pub(crate) welcome: Option<Welcome>,
    /// Who is here and who is in control.
    pub(crate) control: Option<ControlState>,
    /// Why a wish was refused last, until control changes.
    pub(crate) denied: Option<String>,
    /// The connection broke and is being made again.
    pub(crate) broken: bool,
    // messages of bricks since the welcome as new
    batches: u64,
}

/// What the link has to do after a message.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Answer {
    /// Nothing.
    None,
    /// Send this digest of the own mirror.
    Digest(Digest),
    /// The session is over.
    Bye(String),
    /// The viewer was refused.
    Refused(String),
}

impl Mirror {
    /// Takes over one message. [`ToViewer::Hello`] is the link's business and changes nothing.
    pub(crate) fn take(&mut self, message: ToViewer) -> Result<Answer, MirrorError> {
        self.revision += 1;
        match message {
            ToViewer::Hello { .. } => {}
            ToViewer::Refused { reason } => return Ok(Answer::Refused(reason)),
            ToViewer::Scene(scene) => self.begin(*scene)?,
            ToViewer::BonePiece(piece) => self.take_piece(&piece)?,
            ToViewer::Pose(pose) => self.take_pose(pose),
            ToViewer::Removals(events) => self.take_removals(&events),
            ToViewer::Bricks(bricks) => self.take_bricks(&bricks)?,
            ToViewer::Digest(theirs) => return Ok(Answer::Digest(self.digest(theirs))),
            ToViewer::Health(health) => self.health = Some(*health),
            ToViewer::Reset { epoch } => self.reset(epoch),
            ToViewer::Undone {
                epoch,
                removed_mm3_by_class,
            } => {
                self.removed_mm3 = removed_mm3_by_class;
                if let Some(model) = &mut self.model {
                    model.cut.set_epoch(epoch);
                }
            }
            ToViewer::Bye { reason } => return Ok(Answer::Bye(reason)),
            ToViewer::Welcome(welcome) => self.take_welcome(welcome)?,
            ToViewer::Control(state) => {
                self.control = Some(state);
                self.denied = None;
            }
            ToViewer::Denied { reason } => self.denied = Some(reason),
        }
        Ok(Answer::None)
    }

    /// Chunks that have arrived and chunks in all.
    pub(crate) fn chunks(&self) -> (usize, usize) {
        let all = self.scene.as_ref().map_or(0, |s| s.chunks as usize);
        let here = match (&self.model, &self.loading) {
            (Some(model), _) => model.bone.chunk_count(),
            (None, Some(bone)) => bone.chunk_count(),
            (None, None) => 0,
        };
        (here, all)
    }

    fn take_welcome(&mut self, welcome: Welcome) -> Result<(), MirrorError> {
        let known = self.welcome.is_some_and(|w| w.seat == welcome.seat);
        if welcome.resumed && !known {
            return Err(MirrorError::Order(
                "a seat was resumed that this viewer never had",
            ));
        }
        if !welcome.resumed {
            self.batches = 0;
        }
        self.broken = false;
        self.welcome = Some(welcome);
        Ok(())
    }

    /// What this viewer has, for the seat that it wants back after a break. The seat is used up:
    /// only a new welcome gives one again.
    pub(crate) fn resume(&mut self) -> Option<Resume> {
        if self.broken || self.scene.is_none() {
            return None;
        }
        let welcome = self
            .welcome
            .filter(|w| w.granted & capability::RESUME != 0)?;
        // at most the scene's count
        let pieces = self.chunks().0 as u32;
        Some(Resume {
            session: welcome.session,
            seat: welcome.seat,
            pieces,
            batches: self.batches,
            epoch: self.model.as_ref().map_or(0, |m| m.cut.epoch()),
        })
    }

    fn begin(&mut self, scene: Scene) -> Result<(), MirrorError> {
        let dims = scene.dims.map(|n| n as usize);
        let grid = Grid::new(dims, DVec3::from_array(scene.spacing_mm))
            .map_err(|e| MirrorError::Scene(e.to_string()))?;
        let most = MAX_CHUNKS.min(grid.chunk_dims().iter().product());
        if scene.chunks == 0 || scene.chunks as usize > most {
            return Err(MirrorError::Scene(format!(
                "{} chunks of bone (allowed: 1 to {most}); start the session with a larger --voxel-mm",
                scene.chunks
            )));
        }
        let lps_from_bone = pose(&scene.lps_from_bone)
            .ok_or_else(|| MirrorError::Scene("lps_from_bone is no rigid transform".into()))?;
        if pose(&scene.bone_from_plan).is_none() {
            return Err(MirrorError::Scene(
                "bone_from_plan is no rigid transform".into(),
            ));
        }
        self.loading = Some(Bone::new(grid, lps_from_bone));
        self.scene = Some(Arc::new(scene));
        self.model = None;
        self.pose = None;
        self.removed_mm3 = [0.0; TISSUES];
        self.history.clear();
        self.resyncs += 1;
        Ok(())
    }

    fn take_piece(&mut self, piece: &BonePiece) -> Result<(), MirrorError> {
        let chunk = piece.chunk;
        let refuse = |why: String| MirrorError::Piece { chunk, why };
        let (Some(bone), Some(scene)) = (&mut self.loading, &self.scene) else {
            return Err(MirrorError::Order("a bone piece came before its scene"));
        };
        if chunk as usize != bone.chunk_count() {
            return Err(refuse(format!("piece {} was expected", bone.chunk_count())));
        }
        let values = unpack_piece(piece).map_err(|e| refuse(e.to_string()))?;
        let data = ChunkData {
            density_hu: &values.density_hu,
            solid: &values.solid,
            class: &values.class,
            label: &values.label,
        };
        bone.push_chunk(piece.coord, piece.bony, &data)
            .map_err(|e| refuse(e.to_string()))?;
        if bone.chunk_count() == scene.chunks as usize {
            self.complete()?;
        }
        Ok(())
    }

    fn complete(&mut self) -> Result<(), MirrorError> {
        if let Some(bone) = self.loading.take() {
            let map = BrickMap::new(&bone).map_err(MirrorError::Scene)?;
            self.model = Some(Model {
                cut: Cut::new(&bone),
                dirty: Dirty::all(&map),
                map: Arc::new(map),
                bone: Arc::new(bone),
            });
        }
        Ok(())
    }

    fn take_pose(&mut self, new: PoseUpdate) {
        // a pose that cannot be drawn is dropped: the next one comes in a moment
        if pose(&new.bone_from_tool).is_some() {
            self.history.push(&new);
            self.pose = Some(new);
        }
    }

    fn take_removals(&mut self, events: &[RemovalEvent]) {
        let epoch = self.model.as_ref().map_or(0, |m| m.cut.epoch());
        for event in events {
            // sums are cumulative: the newest of this epoch holds them all
            if event.epoch >= epoch {
                self.removed_mm3 = event.removed_mm3_by_class;
            }
        }
    }

    fn take_bricks(&mut self, update: &Bricks) -> Result<(), MirrorError> {
        let Some(model) = &mut self.model else {
            return Err(MirrorError::Order(
                "a brick update came before the bone was complete",
            ));
        };
        self.batches += 1;
        if update.epoch < model.cut.epoch() {
            return Ok(());
        }
        if update.epoch > model.cut.epoch() {
            model.reset(update.epoch);
        }
        let values = unpack_bricks(update).map_err(|e| MirrorError::Bricks(e.to_string()))?;
        for (&(chunk, brick), values) in update.ids.iter().zip(values.chunks_exact(BRICK_VOXELS)) {
            model.set_brick(chunk as usize, usize::from(brick), values)?;
        }
        model.cut.set_revision(update.revision);
        self.updates += update.ids.len() as u64;
        Ok(())
    }

    fn reset(&mut self, epoch: u32) {
        self.removed_mm3 = [0.0; TISSUES];
        if let Some(model) = &mut self.model {
            model.reset(epoch);
        }
    }

    /// The own digest under the sender's epoch and revision. A cut of another epoch is dropped
    /// first: to the sender it no longer exists.
    fn digest(&mut self, theirs: Digest) -> Digest {
        let Some(model) = &mut self.model else {
            return Digest {
                hash: 0,
                changed_chunks: 0,
                ..theirs
            };
        };
        if theirs.epoch > model.cut.epoch() {
            model.reset(theirs.epoch);
        }
        model.cut.set_revision(theirs.revision);
        let own = model.cut.digest(&model.bone);
        Digest {
            epoch: own.epoch,
            revision: own.revision,
            hash: own.hash,
            changed_chunks: own.changed_chunks,
        }
    }

    /// Name of the tissue at the tool's apex, where it touches bone.
    pub(crate) fn layer_at_tip(&self) -> Option<&'static str> {
        let model = self.model.as_ref()?;
        let tip = DVec3::from_array(self.pose?.bone_from_tool.translation_mm);
        let grid = model.bone.grid();
        let voxel = (tip / grid.spacing_mm).round();
        if voxel.min_element() < 0.0 {
            return None;
        }
        // a float beyond the lattice saturates and is then not found
        let voxel = voxel.to_array().map(|v| v as usize);
        if (0..3).any(|a| voxel[a] >= grid.dims[a]) {
            return None;
        }
        let (chunk, at) = model.bone.locate(voxel)?;
        let class = model.bone.chunk(chunk).class[at];
        Tissue::ALL
            .iter()
            .find(|t| **t as u8 == class)
            .map(|t| t.name())
    }
}

impl Model {
    pub(crate) fn set_brick(
        &mut self,
        chunk: usize,
        brick: usize,
        values: &[i16],
    ) -> Result<(), MirrorError> {
        if chunk >= self.bone.chunk_count() || brick >= BRICKS_PER_CHUNK {
            return Err(MirrorError::Bricks(format!(
                "there is no brick {brick} of chunk {chunk}"
            )));
        }
        let coord = lattice_brick(&self.bone, chunk, brick);
        let old = self.cut.brick(chunk, brick);
        self.dirty.mark_change(&self.map, coord, old, values);
        self.cut.set_brick(chunk, brick, values);
        Ok(())
    }

    fn reset(&mut self, epoch: u32) {
        let uncut = [osteon_sim_core::cut::UNCUT; BRICK_VOXELS];
        for chunk in 0..self.bone.chunk_count() {
            if self.cut.chunk(chunk).is_none() {
                continue;
            }
            for brick in 0..BRICKS_PER_CHUNK {
                let coord = lattice_brick(&self.bone, chunk, brick);
                let old = self.cut.brick(chunk, brick);
                self.dirty.mark_change(&self.map, coord, old, &uncut);
            }
        }
        self.cut.reset(epoch);
    }
}

/// A pose from the wire; `None` where it is not finite or not a rotation. A quaternion within
/// 1 % of unit length is brought to it.
pub(crate) fn pose(wire: &WirePose) -> Option<Pose> {
    let rotation = DQuat::from_array(wire.rotation);
    let length = rotation.length();
    let translation = DVec3::from_array(wire.translation_mm);
    // written so that a NaN fails it
    let sound = (0.99..=1.01).contains(&length) && translation.is_finite();
    sound.then(|| Pose::new(rotation * (1.0 / length), translation))
}
