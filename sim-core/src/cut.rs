//! The cut field: signed distance to the union of all that the tools have swept.
//!
//! Made at load, so that the servo thread allocates nothing; a brick is cleared when an epoch first
//! touches it. `cut = min(cut, sd_tool)`: idempotent, free of order, monotone within an epoch.
#![expect(
    clippy::cast_possible_wrap,
    reason = "there are fewer than 2^32 chunks, a voxel index is below 4096"
)]

mod journal;

use crate::aligned::Aligned;
use crate::bone::{Bone, LineMasks, Occupancy};
use crate::carve::{Placed, Plans};
use crate::grid::{
    BRICK_VOXELS, BRICKS_PER_CHUNK, CHUNK, CHUNK_VOXELS, Grid, LINE_VOXELS, LINES_PER_BRICK,
    LINES_PER_CHUNK, brick_origin, voxel_in_brick,
};
use crate::tissue::TISSUES;
use glam::DVec3;
use journal::Journal;
pub use journal::{JOURNAL_BRICKS, MAX_CHECKPOINTS, journal_bricks};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Most tools of one session.
pub const MAX_TOOLS: usize = 8;
/// The value of an uncut voxel: at least one band away from all that was cut.
pub const UNCUT: i16 = i16::MAX;

/// A brick that nothing has touched.
static UNTOUCHED: [i16; BRICK_VOXELS] = [UNCUT; BRICK_VOXELS];

/// Removed volume in integer occupancy units ([`Occupancy`]), since the last reset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Totals {
    /// By tissue class.
    pub by_class: [i64; TISSUES],
    /// By tool index.
    pub by_tool: [i64; MAX_TOOLS],
    /// By structure label.
    pub by_label: Box<[i64; 256]>,
}

impl Totals {
    fn zero() -> Self {
        Self {
            by_class: [0; TISSUES],
            by_tool: [0; MAX_TOOLS],
            by_label: Box::new([0; 256]),
        }
    }

    fn clear(&mut self) {
        self.by_class = [0; TISSUES];
        self.by_tool = [0; MAX_TOOLS];
        self.by_label.fill(0);
    }

    fn copy_from(&mut self, other: &Self) {
        self.by_class = other.by_class;
        self.by_tool = other.by_tool;
        self.by_label.copy_from_slice(&*other.by_label);
    }

    /// All units removed.
    pub fn units(&self) -> i64 {
        self.by_class.iter().sum()
    }
}

/// What two holders of the same cut compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CutDigest {
    /// Counts resets and undos.
    pub epoch: u32,
    /// Carved sub-steps since the last reset, less those that were undone.
    pub revision: u64,
    /// XXH3 over (epoch, revision, chunk coordinate, cut values) of all changed chunks in the
    /// order of their index.
    pub hash: u64,
    /// Chunks with at least one cut value.
    pub changed_chunks: u32,
}

/// The cut distance of every touched chunk.
#[derive(Debug, Clone)]
pub struct Cut {
    epoch: u32,
    revision: u64,
    // one bit a brick that this epoch has touched: the values of others are those of an earlier one
    touched: Vec<u64>,
    // lines, and bricks of nothing else, whose every value is at its lowest: no more can change there
    emptied_lines: Vec<LineMasks>,
    emptied: Vec<u64>,
    // a stamp that lies in the values to its end, the last one
    last_stamp: Option<Placed>,
    // what carving keeps from step to step
    pub(crate) plans: Plans,
    values: Aligned<i16>,
    journal: Journal,
    pub(crate) totals: Totals,
}

/// A chunk's cut for writing.
pub(crate) struct OpenChunk<'a> {
    values: &'a mut [i16],
    touched: &'a mut u64,
    emptied: &'a mut u64,
    emptied_lines: &'a mut LineMasks,
    journal: &'a mut Journal,
    chunk: usize,
}

impl<'a> OpenChunk<'a> {
    /// The values of a brick; clears it where this epoch has not touched it, and saves it where a
    /// checkpoint needs it.
    pub(crate) fn brick(&mut self, brick: usize) -> &mut [i16] {
        let values = &mut self.values[brick * BRICK_VOXELS..(brick + 1) * BRICK_VOXELS];
        let touched = *self.touched >> brick & 1 == 1;
        if self.journal.wants(self.chunk, brick) {
            let emptied = *self.emptied >> brick & 1 == 1;
            let what = (self.emptied_lines[brick], emptied);
            let old = touched.then_some(&*values);
            self.journal.save((self.chunk, brick), what, old);
        }
        if !touched {
            values.fill(UNCUT);
            *self.touched |= 1 << brick;
        }
        values
    }

    /// The same by lines.
    pub(crate) fn lines(&mut self, brick: usize) -> &mut [[i16; LINE_VOXELS]; LINES_PER_BRICK] {
        let lines: &mut [[i16; LINE_VOXELS]] = self.brick(brick).as_chunks_mut().0;
        &mut lines.as_chunks_mut().0[0]
    }

    /// The values of the whole chunk by lines; those of bricks that were not opened by [`Self::brick`] mean
    /// nothing.
    pub(crate) fn all(&mut self) -> &mut [[i16; LINE_VOXELS]; LINES_PER_CHUNK] {
        let lines: &mut [[i16; LINE_VOXELS]] = self.values.as_chunks_mut().0;
        &mut lines.as_chunks_mut().0[0]
    }

    /// Lines whose every value is at its lowest.
    pub(crate) fn emptied_lines(&self, brick: usize) -> u16 {
        self.emptied_lines[brick]
    }

    fn into_brick(mut self, brick: usize) -> &'a mut [i16] {
        self.brick(brick);
        &mut self.values[brick * BRICK_VOXELS..(brick + 1) * BRICK_VOXELS]
    }

    /// Says that lines are at their lowest; `bony` are those of the brick that matter.
    pub(crate) fn add_emptied(&mut self, brick: usize, lines: u16, bony: u16) {
        let all = self.emptied_lines[brick] | lines;
        self.emptied_lines[brick] = all;
        if bony & !all == 0 {
            *self.emptied |= 1 << brick;
        }
    }
}

impl Cut {
    /// An uncut field for `bone`. Allocates and writes all values, so that no page fault is left for
    /// later.
    pub fn new(bone: &Bone) -> Self {
        Self {
            epoch: 0,
            revision: 0,
            touched: vec![0; bone.chunk_count()],
            emptied_lines: vec![[0; BRICKS_PER_CHUNK]; bone.chunk_count()],
            emptied: vec![0; bone.chunk_count()],
            last_stamp: None,
            plans: Plans::new(bone.chunk_count()),
            values: Aligned::filled(UNCUT, bone.chunk_count() * CHUNK_VOXELS),
            journal: Journal::new(bone.chunk_count(), 0),
            totals: Totals::zero(),
        }
    }

    /// Counts resets and undos.
    pub fn epoch(&self) -> u32 {
        self.epoch
    }

    /// Goes on under another epoch with the values that are here, as a viewer's mirror does after an
    /// undo.
    pub fn set_epoch(&mut self, epoch: u32) {
        self.epoch = epoch;
    }

    /// Carved sub-steps since the last reset, less those that were undone.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Says that one more sub-step was carved.
    pub(crate) fn bump_revision(&mut self) {
        self.revision += 1;
    }

    /// What was removed since the last reset.
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// mm³ of `units`, for the lattice of this cut.
    pub fn mm3(grid: &Grid, units: i64) -> f64 {
        Occupancy::new(grid).mm3(grid, units)
    }

    /// Back to the uncut bone under a new epoch, without checkpoints. Constant work per chunk of the
    /// bone (144 bytes); bricks are cleared when they are next touched.
    pub fn reset(&mut self, epoch: u32) {
        self.journal.forget();
        self.epoch = epoch;
        self.revision = 0;
        self.touched.fill(0);
        self.last_stamp = None;
        self.plans.clear();
        self.emptied.fill(0);
        self.emptied_lines.fill([0; BRICKS_PER_CHUNK]);
        self.totals.clear();
    }

    /// Bricks (one bit each) whose every value is at its lowest.
    pub(crate) fn emptied(&self, chunk: usize) -> u64 {
        self.emptied[chunk]
    }

    /// The same for the lines of a brick.
    pub(crate) fn emptied_lines(&self, chunk: usize, brick: usize) -> u16 {
        self.emptied_lines[chunk][brick]
    }

    /// The last stamp of a tool of faces, if it is whole: no value lies above its distance.
    pub(crate) fn last_stamp(&self) -> Option<Placed> {
        self.last_stamp
    }

    /// Says that a stamp is whole.
    pub(crate) fn set_last_stamp(&mut self, placed: &Placed) {
        self.last_stamp = Some(*placed);
    }

    /// The cut values of a chunk, brick-major; `None` where nothing was cut.
    pub fn chunk(&self, chunk: usize) -> Option<impl Iterator<Item = i16>> {
        (self.touched[chunk] != 0).then(|| {
            let bricks = (0..BRICKS_PER_CHUNK).map(move |brick| self.values_of(chunk, brick));
            bricks.flatten().copied()
        })
    }

    /// The stored values of a chunk and the bricks (one bit each) that count; the others are
    /// [`UNCUT`].
    pub fn stored(&self, chunk: usize) -> (u64, &[i16]) {
        let values = &self.values[chunk * CHUNK_VOXELS..(chunk + 1) * CHUNK_VOXELS];
        (self.touched[chunk], values)
    }

    /// The 512 cut values of a brick; `None` where nothing of its chunk was cut.
    pub fn brick(&self, chunk: usize, brick: usize) -> Option<&[i16]> {
        (self.touched[chunk] != 0).then(|| self.values_of(chunk, brick))
    }

    /// Bricks (one bit each) that can hold cut values.
    pub fn touched(&self, chunk: usize) -> u64 {
        self.touched[chunk]
    }

    /// The 512 cut values of a brick, whether it was cut or not.
    pub fn values_of(&self, chunk: usize, brick: usize) -> &[i16] {
        if self.touched[chunk] >> brick & 1 == 0 {
            return &UNTOUCHED;
        }
        let base = chunk * CHUNK_VOXELS + brick * BRICK_VOXELS;
        &self.values[base..base + BRICK_VOXELS]
    }

    /// Cut value of one voxel, in units of [`Grid::quantum_mm`].
    pub fn value(&self, chunk: usize, voxel: usize) -> i16 {
        if self.touched[chunk] >> (voxel / BRICK_VOXELS) & 1 == 0 {
            return UNCUT;
        }
        self.values[chunk * CHUNK_VOXELS + voxel]
    }

    /// The values of a brick for writing; clears it where this epoch has not touched it: 1 KiB.
    pub(crate) fn brick_mut(&mut self, chunk: usize, brick: usize) -> &mut [i16] {
        self.open(chunk).0.into_brick(brick)
    }

    /// A chunk for writing, and the account.
    pub(crate) fn open(&mut self, chunk: usize) -> (OpenChunk<'_>, &mut Totals) {
        let base = chunk * CHUNK_VOXELS;
        let open = OpenChunk {
            values: &mut self.values[base..base + CHUNK_VOXELS],
            touched: &mut self.touched[chunk],
            emptied: &mut self.emptied[chunk],
            emptied_lines: &mut self.emptied_lines[chunk],
            journal: &mut self.journal,
            chunk,
        };
        (open, &mut self.totals)
    }

    /// Replaces a brick's values, as a viewer's mirror does on an update. `values` must have 512
    /// entries and `chunk`, `brick` must exist; otherwise nothing happens and `false` is returned.
    pub fn set_brick(&mut self, chunk: usize, brick: usize, values: &[i16]) -> bool {
        if chunk >= self.touched.len() || brick >= BRICKS_PER_CHUNK || values.len() != BRICK_VOXELS
        {
            return false;
        }
        self.brick_mut(chunk, brick).copy_from_slice(values);
        // values may have risen: nothing is known to be at its lowest, or below a stamp
        self.last_stamp = None;
        self.plans.forget(chunk);
        self.emptied_lines[chunk][brick] = 0;
        self.emptied[chunk] &= !(1 << brick);
        true
    }

    /// Takes over the sender's count of sub-steps, as a viewer's mirror does on an update.
    pub fn set_revision(&mut self, revision: u64) {
        self.revision = revision;
    }

    /// The digest of the whole cut. Reads every touched chunk: not for the servo's loop.
    pub fn digest(&self, bone: &Bone) -> CutDigest {
        let mut all = Xxh3::new();
        all.update(&self.epoch.to_le_bytes());
        all.update(&self.revision.to_le_bytes());
        let mut changed_chunks = 0;
        for chunk in 0..self.touched.len() {
            let Some(hash) = self.chunk_hash(chunk) else {
                continue;
            };
            changed_chunks += 1;
            for c in bone.chunk_coord(chunk) {
                all.update(&c.to_le_bytes());
            }
            all.update(&hash.to_le_bytes());
        }
        CutDigest {
            epoch: self.epoch,
            revision: self.revision,
            hash: all.digest(),
            changed_chunks,
        }
    }

    /// XXH3 of a chunk's cut values (little endian); `None` where no value is cut.
    pub fn chunk_hash(&self, chunk: usize) -> Option<u64> {
        let values = self.chunk(chunk)?;
        let mut bytes = Vec::with_capacity(2 * CHUNK_VOXELS);
        let mut cut = false;
        for v in values {
            cut |= v != UNCUT;
            bytes.extend_from_slice(&v.to_le_bytes());
        }
        cut.then(|| xxh3_64(&bytes))
    }

    /// Centroid of all that was removed, bone frame, mm; `None` where nothing was. Reads every touched
    /// chunk: not for the servo's loop.
    pub fn centroid(&self, bone: &Bone) -> Option<DVec3> {
        let occupancy = Occupancy::new(bone.grid());
        let mut units = 0i64;
        let mut moment = [0i64; 3];
        for chunk in 0..self.touched.len() {
            let Some(values) = self.chunk(chunk) else {
                continue;
            };
            let solid = bone.chunk(chunk).solid;
            let first = bone.chunk_coord(chunk).map(|c| usize::from(c) * CHUNK);
            for (voxel, (cut, &solid)) in values.zip(solid).enumerate() {
                let gone = occupancy.units(solid) - occupancy.units(solid.min(cut));
                if gone != 0 {
                    let brick = brick_origin(voxel / BRICK_VOXELS);
                    let inside = voxel_in_brick(voxel % BRICK_VOXELS);
                    units += gone;
                    for a in 0..3 {
                        moment[a] += gone * (first[a] + brick[a] + inside[a]) as i64;
                    }
                }
            }
        }
        (units > 0).then(|| {
            let m = moment.map(|m| m as f64 / units as f64);
            DVec3::from_array(m) * bone.grid().spacing_mm
        })
    }

    /// Volume left in chunk `chunk`, occupancy units: an independent check of the totals.
    pub fn solid_units(&self, bone: &Bone, chunk: usize) -> i64 {
        let occupancy = Occupancy::new(bone.grid());
        let data = bone.chunk(chunk);
        (0..CHUNK_VOXELS)
            .map(|v| occupancy.units(data.solid[v].min(self.value(chunk, v))))
            .sum()
    }
}
