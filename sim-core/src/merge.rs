//! Taking over cut values from another holder of the same cut.
use crate::bone::{Bone, Occupancy};
use crate::cut::{Cut, MAX_TOOLS};
use crate::grid::{BRICK_VOXELS, BRICKS_PER_CHUNK};
use crate::tissue::TISSUES;

/// Where copied values belong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CopyPlace {
    /// Chunk index.
    pub chunk: usize,
    /// Brick in `0..64`.
    pub brick: usize,
    /// First voxel inside the brick, in `0..512`.
    pub first: usize,
    /// Tool that the difference is booked to.
    pub tool: u8,
}

/// Takes the smaller of the present and the given values and books what that removes; true where a
/// value changed. Values that do not fit into the brick, or a place that does not exist, change
/// nothing.
pub fn merge(bone: &Bone, cut: &mut Cut, place: CopyPlace, values: &[i16]) -> bool {
    let fits = place.chunk < bone.chunk_count()
        && place.brick < BRICKS_PER_CHUNK
        && place.first + values.len() <= BRICK_VOXELS
        && usize::from(place.tool) < MAX_TOOLS;
    if !fits {
        return false;
    }
    let occupancy = Occupancy::new(bone.grid());
    let data = bone.chunk(place.chunk);
    let mut changed = false;
    for (n, &new) in values.iter().enumerate() {
        let local = place.first + n;
        let voxel = place.brick * BRICK_VOXELS + local;
        let old = cut.value(place.chunk, voxel);
        if new >= old {
            continue;
        }
        changed = true;
        cut.brick_mut(place.chunk, place.brick)[local] = new;
        let solid = data.solid[voxel];
        let units = occupancy.units(solid.min(old)) - occupancy.units(solid.min(new));
        let totals = &mut cut.totals;
        totals.by_class[usize::from(data.class[voxel]) % TISSUES] += units;
        totals.by_label[usize::from(data.label[voxel])] += units;
        totals.by_tool[usize::from(place.tool)] += units;
    }
    changed
}
