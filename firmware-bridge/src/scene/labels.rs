//! From CT numbers and a label map to the sign and place of the bone's surface.
//!
//! Rules, in this order:
//! 1. A voxel of a kept label is bone, whatever its CT number: marrow lies below any threshold.
//! 2. A void (no label) that kept voxels enclose is bone of that label.
//! 3. The rim, unlabelled voxels in the 26-neighbourhood of a kept one, keeps its CT numbers, so
//!    that the surface lies where the partial volume says; it counts to that kept label.
//! 4. Any other label is air, and stays air between voxels too ([`clear_excluded`]).
//! 5. All the rest is outside.

use super::SceneError;
use super::dense::{Lattice, NEIGHBOURS};
use super::nifti::Volume;
use osteon_sim_core::grid::Grid;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// HU above the threshold that a kept voxel counts for at least.
const FLOOR_HU: f32 = 20.0;
/// HU below the threshold that a voxel outside counts for where its own CT number says "bone".
const CEILING_HU: f32 = 50.0;
/// Largest difference of two affines' entries (mm, mm per voxel) that counts as the same grid.
const SAME_AFFINE: f64 = 1e-3;
/// Unlabelled.
const NONE: u8 = 0;

/// Which labels are bone.
#[derive(Debug, Clone)]
pub struct Keep([bool; 256]);

impl Keep {
    /// The kept labels; 0 is never kept.
    pub fn new(labels: &[u8]) -> Self {
        let mut kept = [false; 256];
        for &l in labels {
            kept[usize::from(l)] = l != NONE;
        }
        Self(kept)
    }

    /// True where `label` is kept.
    pub fn has(&self, label: u8) -> bool {
        self.0[usize::from(label)]
    }

    /// True where `label` is another structure's.
    pub fn excludes(&self, label: u8) -> bool {
        label != NONE && !self.has(label)
    }
}

/// Refuses a label map that does not lie on the CT's grid.
pub fn check_same_grid(ct: (&Path, &Volume), labels: (&Path, &Volume)) -> Result<(), SceneError> {
    let refuse = |difference: String| {
        Err(SceneError::OtherGrid {
            labels: labels.0.to_path_buf(),
            bone: ct.0.to_path_buf(),
            difference,
        })
    };
    let (a, b) = (ct.1, labels.1);
    if a.grid.dims != b.grid.dims {
        return refuse(format!(
            "{:?} voxels against {:?}",
            b.grid.dims, a.grid.dims
        ));
    }
    let columns = |v: &Volume| {
        let axes = [glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z];
        let axis = |n: usize| v.lps_from_bone.vector(axes[n]) * v.grid.spacing_mm[n];
        [axis(0), axis(1), axis(2), v.lps_from_bone.translation]
    };
    for (p, q) in columns(a).into_iter().zip(columns(b)) {
        let apart = (p - q).abs().max_element();
        if apart > SAME_AFFINE {
            return refuse(format!("affines differ by {apart:.4}"));
        }
    }
    Ok(())
}

/// The label map as bytes, and the voxels of every label in it.
pub fn label_bytes(
    path: &Path,
    volume: &Volume,
) -> Result<(Vec<u8>, BTreeMap<u8, usize>), SceneError> {
    let mut counts = [0; 256];
    let mut bytes = Vec::with_capacity(volume.values.len());
    for &value in &volume.values {
        let rounded = value.round();
        if !(0.0..=255.0).contains(&rounded) || (value - rounded).abs() > 1e-3 {
            return Err(SceneError::LabelValue {
                path: path.to_path_buf(),
                value,
            });
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked to be a whole number in 0..=255"
        )]
        let label = rounded as u8;
        counts[usize::from(label)] += 1;
        bytes.push(label);
    }
    let present = (0..=255u8)
        .zip(counts)
        .filter(|&(label, count)| label != NONE && count > 0)
        .collect();
    Ok((bytes, present))
}

/// The surface field `phi` (HU above the threshold, positive inside) under the rules above.
/// `labels` gains the kept label in filled voids and on the rim.
pub fn segment(
    lattice: Lattice,
    hu: &[f32],
    labels: &mut [u8],
    keep: &Keep,
    threshold_hu: f32,
) -> Vec<f32> {
    fill_voids(lattice, labels, keep);
    let kept = labels.to_vec();
    claim(lattice, labels, keep, |_| true);
    let phi_of = |at: usize| {
        let above = hu[at] - threshold_hu;
        if keep.has(kept[at]) {
            above.max(FLOOR_HU)
        } else if keep.excludes(kept[at]) {
            // mirrored: between two touching bones the surface is half way
            -above.abs().max(CEILING_HU)
        } else if labels[at] != NONE || above < 0.0 {
            above
        } else {
            -CEILING_HU
        }
    };
    (0..hu.len()).into_par_iter().map(phi_of).collect()
}

/// Gives enclosed unlabelled voxels a kept neighbour's label: those that a flood from the border,
/// face to face through all that is not kept, does not reach.
fn fill_voids(lattice: Lattice, labels: &mut [u8], keep: &Keep) {
    let mut open: Vec<bool> = labels.iter().map(|&l| !keep.has(l)).collect();
    let mut front = Vec::new();
    for at in lattice.border() {
        if core::mem::replace(&mut open[at], false) {
            front.push(at);
        }
    }
    while let Some(at) = front.pop() {
        for next in lattice.faces(at) {
            if core::mem::replace(&mut open[next], false) {
                front.push(next);
            }
        }
    }
    // what is still open is enclosed; from its walls inwards
    let mut left: Vec<usize> = (0..labels.len())
        .filter(|&at| open[at] && labels[at] == NONE)
        .collect();
    while !left.is_empty() {
        let found: Vec<(usize, u8)> = left
            .iter()
            .filter_map(|&at| Some((at, kept_neighbour(lattice, labels, keep, at)?)))
            .collect();
        if found.is_empty() {
            // walled in by excluded voxels only
            return;
        }
        for (at, label) in found {
            labels[at] = label;
        }
        left.retain(|&at| labels[at] == NONE);
    }
}

/// The label of the nearest kept voxel in the 26-neighbourhood.
fn kept_neighbour(lattice: Lattice, labels: &[u8], keep: &Keep, at: usize) -> Option<u8> {
    NEIGHBOURS
        .iter()
        .filter_map(|&step| lattice.step(at, step))
        .map(|next| labels[next])
        .find(|&l| keep.has(l))
}

/// Gives unlabelled voxels that satisfy `wanted` the label of a kept 26-neighbour. Neighbours are
/// read as they were before.
pub fn claim(
    lattice: Lattice,
    labels: &mut [u8],
    keep: &Keep,
    wanted: impl Fn(usize) -> bool + Sync,
) {
    let before: &[u8] = labels;
    let mut beside = vec![false; before.len()];
    for at in (0..before.len()).filter(|&at| keep.has(before[at])) {
        for next in NEIGHBOURS.iter().filter_map(|&step| lattice.step(at, step)) {
            beside[next] = before[next] == NONE;
        }
    }
    let found: Vec<(usize, u8)> = (0..before.len())
        .into_par_iter()
        .filter(|&at| beside[at] && wanted(at))
        .filter_map(|at| Some((at, kept_neighbour(lattice, before, keep, at)?)))
        .collect();
    for (at, label) in found {
        labels[at] = label;
    }
}

/// Keeps a ball of half the largest spacing around every excluded voxel's centre free of bone, so
/// that no removed volume can ever count to it. The minimum of two distances: still Lipschitz 1.
pub fn clear_excluded(grid: &Grid, solid_mm: &mut [f32], labels: &[u8], keep: &Keep) {
    let lattice = Lattice::of(grid);
    let radius = free_radius_mm(grid);
    // a distance that already says "at least `radius` outside" says so about the whole ball
    let centres: Vec<usize> = (0..solid_mm.len())
        .into_par_iter()
        .filter(|&at| keep.excludes(labels[at]) && solid_mm[at] > -radius)
        .collect();
    let ball = ball_offsets(grid, radius);
    for at in centres {
        for &(step, distance) in &ball {
            if let Some(near) = lattice.step(at, step) {
                solid_mm[near] = solid_mm[near].min(distance - radius);
            }
        }
    }
}

/// Half the largest spacing and a little, mm: from there on a voxel's occupancy is zero.
pub fn free_radius_mm(grid: &Grid) -> f32 {
    grid.spacing_mm.as_vec3().max_element() * 0.5 + 2.0 * grid.quantum_mm()
}

/// All voxel steps whose length is within the reach of the distance field, with their length, mm.
fn ball_offsets(grid: &Grid, radius: f32) -> Vec<([i32; 3], f32)> {
    let spacing = grid.spacing_mm.as_vec3();
    #[expect(clippy::cast_possible_truncation, reason = "a small constant")]
    let reach = osteon_sim_core::solid::REACH_BANDS as f32 * spacing.length() + radius;
    #[expect(clippy::cast_possible_truncation, reason = "a few voxels")]
    let span = (reach / spacing.min_element()).ceil() as i32;
    let range = -span..=span;
    let mut offsets = Vec::new();
    for k in range.clone() {
        for j in range.clone() {
            for i in range.clone() {
                let length = (glam::IVec3::new(i, j, k).as_vec3() * spacing).length();
                if length <= reach {
                    offsets.push(([i, j, k], length));
                }
            }
        }
    }
    offsets
}

#[cfg(test)]
mod tests;
