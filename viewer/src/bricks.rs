//! Which bricks are drawn, where their texels come from, and which of them changed.
//!
//! Every brick that can hold a surface has a *slot*. A slot's *tile* is the brick's 8³ voxels and
//! one voxel around them (10³), so that trilinear reading inside the brick needs no neighbour.
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::{Cut, UNCUT};
use osteon_sim_core::grid::{
    BRICK, BRICK_VOXELS, BRICKS_PER_CHUNK, offset_in_brick, voxel_in_brick,
};
use std::collections::VecDeque;

/// Texels along one edge of a tile.
pub(crate) const TILE: usize = 10;
/// Texels of a tile.
pub(crate) const TILE_TEXELS: usize = TILE * TILE * TILE;
/// Index entry of a cell without a slot; the low bits hold the distance in bricks to the nearest
/// cell with one.
pub(crate) const EMPTY: u32 = 1 << 31;

/// Most bricks drawn: 8 kB of texels each, 1 GiB in all.
pub(crate) const MAX_SLOTS: usize = 1 << 17;
/// Most cells of the index: 64 MiB.
const MAX_CELLS: usize = 1 << 24;

/// Bricks along a chunk's edge.
const PER_CHUNK: usize = 4;

/// Slots of the bricks of one bone.
#[derive(Debug)]
pub(crate) struct BrickMap {
    // lowest brick of the index, in bricks of the lattice
    lo: [usize; 3],
    // cells along each axis, all at least 1
    dims: [usize; 3],
    // per cell, x fastest: a slot, or EMPTY | distance
    index: Vec<u32>,
    // slot -> (chunk, brick)
    bricks: Vec<(u32, u8)>,
}

impl BrickMap {
    /// Gives a slot to every brick that can hold bone. Refuses a bone beyond the memory bound.
    pub(crate) fn new(bone: &Bone) -> Result<Self, String> {
        let bricks = bony_bricks(bone);
        let Some((lo, hi)) = bounds(bone, &bricks) else {
            return Err("the bone that was sent has no voxel of bone; load another one".into());
        };
        let dims: [usize; 3] = core::array::from_fn(|a| hi[a] - lo[a]);
        let cells = dims[0] * dims[1] * dims[2];
        if bricks.len() > MAX_SLOTS || cells > MAX_CELLS {
            return Err(format!(
                "the bone needs {} bricks in {cells} cells, more than the viewer's {MAX_SLOTS} in \
                 {MAX_CELLS}; start the session with a larger --voxel-mm",
                bricks.len()
            ));
        }
        let mut map = Self {
            lo,
            dims,
            index: vec![EMPTY; cells],
            bricks,
        };
        for slot in 0..map.bricks.len() {
            let at = map.cell_of(brick_coord(bone, map.bricks[slot]));
            if let Some(at) = at {
                map.index[at] = slot as u32;
            }
        }
        map.measure_emptiness();
        Ok(map)
    }

    /// Lowest brick of the index, in bricks of the lattice.
    pub(crate) fn lo(&self) -> [usize; 3] {
        self.lo
    }

    /// Cells of the index along each axis.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The index, x fastest: a slot, or [`EMPTY`] and the distance to the nearest one in bricks.
    pub(crate) fn index(&self) -> &[u32] {
        &self.index
    }

    /// Number of slots.
    pub(crate) fn slots(&self) -> usize {
        self.bricks.len()
    }

    /// Places of all slots in order, in bricks of the lattice.
    pub(crate) fn coords(&self, bone: &Bone) -> impl Iterator<Item = [usize; 3]> {
        self.bricks.iter().map(|&b| brick_coord(bone, b))
    }

    /// Slot of a brick of the lattice.
    fn slot_at(&self, coord: [usize; 3]) -> Option<u32> {
        let entry = self.index[self.cell_of(coord)?];
        (entry & EMPTY == 0).then_some(entry)
    }

    fn cell_of(&self, coord: [usize; 3]) -> Option<usize> {
        let mut cell = [0; 3];
        for a in 0..3 {
            cell[a] = coord[a].checked_sub(self.lo[a])?;
            if cell[a] >= self.dims[a] {
                return None;
            }
        }
        Some((cell[2] * self.dims[1] + cell[1]) * self.dims[0] + cell[0])
    }

    /// Writes into each empty cell its Chebyshev distance to the nearest slot, by one sweep
    /// forwards and one backwards over half of the 26 neighbours each (exact for this metric).
    fn measure_emptiness(&mut self) {
        let [nx, ny, nz] = self.dims;
        let near: Vec<[isize; 3]> = neighbours()
            .filter(|d| (d[2], d[1], d[0]) < (0, 0, 0))
            .collect();
        for back in [false, true] {
            for step in 0..nx * ny * nz {
                let at = if back { nx * ny * nz - 1 - step } else { step };
                if self.index[at] & EMPTY == 0 {
                    continue;
                }
                let cell = [at % nx, at / nx % ny, at / (nx * ny)];
                let mut best = match self.index[at] & !EMPTY {
                    0 => 0xffff,
                    known => known,
                };
                for d in &near {
                    let sign = if back { -1 } else { 1 };
                    let other: Option<[usize; 3]> = offset(cell, d.map(|v| v * sign), self.dims);
                    if let Some([x, y, z]) = other {
                        let entry = self.index[(z * ny + y) * nx + x];
                        let far = if entry & EMPTY == 0 {
                            0
                        } else {
                            entry & !EMPTY
                        };
                        best = best.min(far + 1);
                    }
                }
                self.index[at] = EMPTY | best;
            }
        }
    }

    /// Calls `each(texel, chunk, voxel in chunk)` for the texels of a slot's tile that lie in a
    /// kept chunk.
    fn for_texels(&self, bone: &Bone, slot: usize, mut each: impl FnMut(usize, usize, usize)) {
        let centre = brick_coord(bone, self.bricks[slot]);
        for d in neighbours().chain([[0; 3]]) {
            let Some(at) = offset(centre, d, [usize::MAX; 3]) else {
                continue;
            };
            let Some(chunk) = bone.chunk_at(at.map(|v| v / PER_CHUNK)) else {
                continue;
            };
            let [bx, by, bz] = at.map(|v| v % PER_CHUNK);
            let base = ((bz * PER_CHUNK + by) * PER_CHUNK + bx) * BRICK_VOXELS;
            let [xs, ys, zs] = d.map(texels_of_neighbour);
            for z in zs {
                for y in ys.clone() {
                    for x in xs.clone() {
                        // texel t of the tile is voxel t - 1 of the brick, modulo its edge
                        let v = [x, y, z].map(|t| (t + BRICK - 1) % BRICK);
                        let voxel = base + offset_in_brick(v);
                        each((z * TILE + y) * TILE + x, chunk, voxel);
                    }
                }
            }
        }
    }

    /// Solid and cut distance of a slot's tile as pairs of half floats, units of the band.
    pub(crate) fn gather_field(&self, bone: &Bone, cut: &Cut, slot: usize, out: &mut [[u16; 2]]) {
        out.fill([half(-i16::MAX), half(UNCUT)]);
        self.for_texels(bone, slot, |texel, chunk, voxel| {
            let solid = bone.chunk(chunk).solid[voxel];
            out[texel] = [half(solid), half(cut.value(chunk, voxel))];
        });
    }

    /// CT numbers of a slot's tile as half floats, HU; air where nothing is kept.
    pub(crate) fn gather_density(&self, bone: &Bone, slot: usize, out: &mut [u16]) {
        out.fill(half_float(-1000.0));
        self.for_texels(bone, slot, |texel, chunk, voxel| {
            out[texel] = half_float(f32::from(bone.chunk(chunk).density_hu[voxel]));
        });
    }

    /// Chunk of a slot's brick.
    pub(crate) fn chunk_of(&self, slot: usize) -> usize {
        self.bricks[slot].0 as usize
    }

    /// Tissue colours of a slot's tile.
    pub(crate) fn gather_tissue(&self, bone: &Bone, slot: usize, out: &mut [[u8; 4]]) {
        out.fill([0; 4]);
        self.for_texels(bone, slot, |texel, chunk, voxel| {
            let data = bone.chunk(chunk);
            out[texel] = crate::palette::tissue_texel(data.class[voxel], data.density_hu[voxel]);
        });
    }
}

/// Texels of a tile that a neighbour in direction `d` (−1, 0, 1) of one axis provides.
fn texels_of_neighbour(d: isize) -> core::ops::Range<usize> {
    match d {
        0 => 1..TILE - 1,
        1 => TILE - 1..TILE,
        _ => 0..1,
    }
}

/// The 26 directions to a brick's neighbours.
fn neighbours() -> impl Iterator<Item = [isize; 3]> {
    (0..27)
        .filter(|&n| n != 13)
        .map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1])
}

fn offset(at: [usize; 3], d: [isize; 3], below: [usize; 3]) -> Option<[usize; 3]> {
    let mut to = [0; 3];
    for a in 0..3 {
        to[a] = at[a].checked_add_signed(d[a])?;
        if to[a] >= below[a] {
            return None;
        }
    }
    Some(to)
}

fn bony_bricks(bone: &Bone) -> Vec<(u32, u8)> {
    let mut bricks = Vec::new();
    for chunk in 0..bone.chunk_count() {
        let bony = bone.bony_bricks(chunk);
        for brick in 0..BRICKS_PER_CHUNK {
            if bony >> brick & 1 == 1 {
                bricks.push((chunk as u32, brick as u8));
            }
        }
    }
    bricks
}

/// Coordinate of a brick in bricks of the lattice.
fn brick_coord(bone: &Bone, (chunk, brick): (u32, u8)) -> [usize; 3] {
    let coord = bone.chunk_coord(chunk as usize);
    let brick = usize::from(brick);
    let inner = [brick % 4, brick / 4 % 4, brick / 16];
    core::array::from_fn(|a| usize::from(coord[a]) * PER_CHUNK + inner[a])
}

fn bounds(bone: &Bone, bricks: &[(u32, u8)]) -> Option<([usize; 3], [usize; 3])> {
    let mut coords = bricks.iter().map(|&b| brick_coord(bone, b));
    let first = coords.next()?;
    let mut lo = first;
    let mut hi = first.map(|v| v + 1);
    for c in coords {
        for a in 0..3 {
            lo[a] = lo[a].min(c[a]);
            hi[a] = hi[a].max(c[a] + 1);
        }
    }
    Some((lo, hi))
}

/// A stored distance as an IEEE 754 half float in [−1, 1], rounded to nearest.
fn half(units: i16) -> u16 {
    half_float(f32::from(units) / f32::from(i16::MAX))
}

/// An IEEE 754 half float, rounded to nearest; `value` is below 65504 in size, and what is below
/// the smallest normal half becomes zero.
fn half_float(value: f32) -> u16 {
    let bits = value.to_bits();
    let sign = (bits >> 16 & 0x8000) as u16;
    let magnitude = bits & 0x7fff_ffff;
    if magnitude < 0x3880_0000 {
        return sign;
    }
    // rebias the exponent from 127 to 15 and round the 13 bits that are dropped
    sign | ((magnitude - 0x3800_0000 + 0x0fff + (magnitude >> 13 & 1)) >> 13) as u16
}

/// Slots whose texels are out of date: each at most once, oldest first.
#[derive(Debug)]
pub(crate) struct Dirty {
    waiting: Vec<bool>,
    queue: VecDeque<u32>,
}

impl Dirty {
    /// All slots of a map.
    pub(crate) fn all(map: &BrickMap) -> Self {
        Self {
            waiting: vec![true; map.slots()],
            queue: (0..map.slots() as u32).collect(),
        }
    }

    /// Whether nothing waits.
    pub(crate) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Number of slots that wait.
    pub(crate) fn len(&self) -> usize {
        self.queue.len()
    }

    /// The oldest slot that waits.
    pub(crate) fn pop(&mut self) -> Option<usize> {
        let slot = self.queue.pop_front()? as usize;
        self.waiting[slot] = false;
        Some(slot)
    }

    fn mark(&mut self, slot: u32) {
        if !core::mem::replace(&mut self.waiting[slot as usize], true) {
            self.queue.push_back(slot);
        }
    }

    /// Marks the slots whose tiles show a voxel of `brick` that differs between `old` (`None` =
    /// uncut) and `new`. Returns whether any voxel differs.
    pub(crate) fn mark_change(
        &mut self,
        map: &BrickMap,
        coord: [usize; 3],
        old: Option<&[i16]>,
        new: &[i16],
    ) -> bool {
        let Some((lo, hi)) = changed_box(old, new) else {
            return false;
        };
        for d in neighbours().chain([[0; 3]]) {
            let seen = (0..3).all(|a| match d[a] {
                0 => true,
                1 => hi[a] == BRICK - 1,
                _ => lo[a] == 0,
            });
            if !seen {
                continue;
            }
            let slot = offset(coord, d, [usize::MAX; 3]).and_then(|c| map.slot_at(c));
            if let Some(slot) = slot {
                self.mark(slot);
            }
        }
        true
    }
}

/// Lowest and highest voxel, per axis, that differs.
fn changed_box(old: Option<&[i16]>, new: &[i16]) -> Option<([usize; 3], [usize; 3])> {
    let mut found: Option<([usize; 3], [usize; 3])> = None;
    for (i, &value) in new.iter().enumerate() {
        if value == old.map_or(UNCUT, |o| o[i]) {
            continue;
        }
        let v = voxel_in_brick(i);
        let (lo, hi) = found.get_or_insert((v, v));
        for a in 0..3 {
            lo[a] = lo[a].min(v[a]);
            hi[a] = hi[a].max(v[a]);
        }
    }
    found
}

/// Coordinate of brick `brick` of chunk `chunk` in bricks of the lattice.
pub(crate) fn lattice_brick(bone: &Bone, chunk: usize, brick: usize) -> [usize; 3] {
    brick_coord(bone, (chunk as u32, brick as u8))
}

#[cfg(test)]
mod tests;
