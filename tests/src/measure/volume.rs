//! The exact volume of what a swept tool takes from a bone, and which voxels it holds.
//!
//! Boxes of voxels are halved until the tool's exact distance says that they are in or out; voxels on
//! the surface are integrated in small cubes by the smaller of both distances. What the bone itself holds
//! is read from its stored distance, as the program does.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the lattice before the cast"
)]

use super::surface::solid_mm;
use super::swept::Swept;
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::{BRICK, BRICK_VOXELS, CHUNK, Grid, voxel_in_chunk};
use rayon::prelude::*;

/// Edge of the boxes that are begun with, voxels.
const BOX: usize = 16;

/// Edge of the cubes that a surface is integrated in, mm. The curvature's bias of a face of radius R is
/// e²/(24 R), some 0.1 µm.
const LEAF_MM: f64 = 0.16;

/// Whether a voxel of the lattice was removed.
pub type Removed<'a> = &'a (dyn Fn([usize; 3]) -> bool + Sync);

/// The truth, and how one method's voxels compare.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Account {
    /// Exact volume of bone in the swept solid, mm³.
    pub mm3: f64,
    /// Solid voxels whose centre is in the swept solid.
    pub voxels: u64,
    /// Of these, not removed.
    pub missed: u64,
    /// Solid voxels that were removed although their centre is outside.
    pub excess: u64,
}

impl Account {
    /// Missed voxels over the exact ones; `None` where there are none.
    pub fn missed_frac(&self) -> Option<f64> {
        (self.voxels > 0).then(|| self.missed as f64 / self.voxels as f64)
    }

    /// Excess voxels over the exact ones.
    pub fn excess_frac(&self) -> Option<f64> {
        (self.voxels > 0).then(|| self.excess as f64 / self.voxels as f64)
    }
}

/// One account for each of `methods`; the truth is the same in all.
pub fn accounts(swept: &Swept, bone: &Bone, methods: &[Removed<'_>]) -> Vec<Account> {
    let grid = bone.grid();
    let (lo, hi) = swept.bounds();
    // voxels that a method removed outside count within two of them
    let index = |v: DVec3, by: f64| {
        let v = (v / grid.spacing_mm + by).to_array();
        std::array::from_fn::<usize, 3, _>(|a| v[a].clamp(0.0, grid.dims[a] as f64) as usize)
    };
    // whole boxes, each inside one chunk
    let (lo, hi) = (index(lo, -2.0).map(|v| v / BOX * BOX), index(hi, 3.0));
    let mut boxes = Vec::new();
    for z in (lo[2]..hi[2]).step_by(BOX) {
        for y in (lo[1]..hi[1]).step_by(BOX) {
            boxes.extend((lo[0]..hi[0]).step_by(BOX).map(|x| [x, y, z]));
        }
    }
    let job = Job {
        swept,
        bone,
        methods,
    };
    let zero = || vec![Account::default(); methods.len()];
    // one list in the boxes' order: the sums do not depend on the threads
    let parts: Vec<(Vec<Account>, Vec<u64>)> = boxes
        .into_par_iter()
        .map(|lo| {
            let (mut sums, mut removed) = (zero(), vec![0; methods.len()]);
            job.cube(lo, BOX, None, &mut sums);
            job.removed(lo, &mut removed);
            (sums, removed)
        })
        .collect();
    let mut all = zero();
    for (sums, removed) in parts {
        for (total, (sum, removed)) in all.iter_mut().zip(sums.iter().zip(removed)) {
            total.mm3 += sum.mm3;
            total.voxels += sum.voxels;
            total.missed += sum.missed;
            total.excess += removed;
        }
    }
    for total in &mut all {
        // what was removed and should have been is no excess
        total.excess -= total.voxels - total.missed;
    }
    all
}

struct Job<'a> {
    swept: &'a Swept,
    bone: &'a Bone,
    methods: &'a [Removed<'a>],
}

impl Job<'_> {
    /// Whether a box of at most a chunk, aligned to its own size, may hold bone.
    fn may_hold_bone(&self, lo: [usize; 3], size: usize) -> bool {
        let Some(chunk) = self.bone.chunk_at(lo.map(|v| v / CHUNK)) else {
            return false;
        };
        let [x, y, z] = lo.map(|v| v % CHUNK);
        let bit = voxel_in_chunk(x, y, z) / BRICK_VOXELS;
        size > BRICK || self.bone.bony_bricks(chunk) >> bit & 1 == 1
    }

    fn cube(&self, lo: [usize; 3], size: usize, among: Option<&[u32]>, sums: &mut [Account]) {
        if !self.may_hold_bone(lo, size) {
            return;
        }
        let h = self.bone.grid().spacing_mm;
        let half = 0.5 * (size - 1) as f64;
        let middle = DVec3::from_array(lo.map(|v| v as f64 + half)) * h;
        let radius = 0.5 * size as f64 * h.length();
        let (distance, near) = self.swept.near(among, middle, radius);
        if distance >= radius {
            return;
        }
        if distance <= -radius {
            self.all_inside(lo, size, sums);
            return;
        }
        if size > 1 {
            let half = size / 2;
            for part in 0..8usize {
                let at = [part & 1, (part >> 1) & 1, part >> 2];
                let lo = std::array::from_fn(|a| lo[a] + half * at[a]);
                self.cube(lo, half, Some(&near), sums);
            }
            return;
        }
        let Some(solid) = self.solid(lo) else {
            return;
        };
        let fraction = if solid > -i16::MAX {
            self.fraction(middle, h, &near, 2)
        } else {
            0.0
        };
        let mm3 = self.bone.grid().voxel_mm3() * fraction;
        self.book(lo, solid > 0, (mm3, distance < 0.0), sums);
    }

    fn solid(&self, at: [usize; 3]) -> Option<i16> {
        let (chunk, voxel) = self.bone.locate(at)?;
        Some(self.bone.chunk(chunk).solid[voxel])
    }

    fn all_inside(&self, lo: [usize; 3], size: usize, sums: &mut [Account]) {
        let dims = self.bone.grid().dims;
        let end: [usize; 3] = std::array::from_fn(|a| (lo[a] + size).min(dims[a]));
        for k in lo[2]..end[2] {
            for j in lo[1]..end[1] {
                for i in lo[0]..end[0] {
                    let Some(solid) = self.solid([i, j, k]) else {
                        continue;
                    };
                    let mm3 = plain_mm3(self.bone.grid(), solid);
                    self.book([i, j, k], solid > 0, (mm3, true), sums);
                }
            }
        }
    }

    /// The fraction of a small box that is bone inside the tool. Halved down to [`LEAF_MM`], and twice
    /// more where both surfaces may run through it (a thin wedge at the rim of a cut); then by the smaller
    /// distance.
    fn fraction(&self, centre: DVec3, edge: DVec3, among: &[u32], more: u8) -> f64 {
        let radius = 0.5 * edge.length();
        let (distance, near) = self.swept.near(Some(among), centre, radius);
        if distance >= radius {
            return 0.0;
        }
        let solid = solid_mm(self.bone, centre);
        let both = solid.abs().max(distance.abs()) < radius;
        let large = edge.max_element() > LEAF_MM;
        if large || (both && more > 0) {
            let more = if large { more } else { more - 1 };
            let part = 0.5 * edge;
            let corners = (0..8u8).map(|n| {
                let at = [n & 1, (n >> 1) & 1, n >> 2].map(|b| f64::from(b) - 0.5);
                self.fraction(centre + DVec3::from_array(at) * part, part, &near, more)
            });
            return corners.sum::<f64>() / 8.0;
        }
        (0.5 + solid.min(-distance) / edge.max_element()).clamp(0.0, 1.0)
    }

    fn book(&self, at: [usize; 3], solid: bool, (mm3, inside): (f64, bool), sums: &mut [Account]) {
        for (sum, removed) in sums.iter_mut().zip(self.methods) {
            sum.mm3 += mm3;
            if solid && inside {
                sum.voxels += 1;
                sum.missed += u64::from(!removed(at));
            }
        }
    }

    /// Voxels of a box that each method removed.
    fn removed(&self, lo: [usize; 3], sums: &mut [u64]) {
        if !self.may_hold_bone(lo, BOX) {
            return;
        }
        let dims = self.bone.grid().dims;
        let end: [usize; 3] = std::array::from_fn(|a| (lo[a] + BOX).min(dims[a]));
        for k in lo[2]..end[2] {
            for j in lo[1]..end[1] {
                for i in lo[0]..end[0] {
                    if self.solid([i, j, k]).is_some_and(|d| d > 0) {
                        for (sum, removed) in sums.iter_mut().zip(self.methods) {
                            *sum += u64::from(removed([i, j, k]));
                        }
                    }
                }
            }
        }
    }
}

/// What a plane at a voxel's stored distance leaves of it, mm³: the plain ramp over one voxel, so that
/// the truth does not rest on the account that it judges.
fn plain_mm3(grid: &Grid, solid: i16) -> f64 {
    let d = f64::from(solid) * f64::from(grid.quantum_mm());
    let share = 0.5 + d / grid.spacing_mm.max_element();
    share.clamp(0.0, 1.0) * grid.voxel_mm3()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::{bones, press};
    use osteon_sim_core::tool::Tool;
    use std::f64::consts::PI;

    #[test]
    fn the_integral_is_the_closed_form() {
        let built = bones::block(DVec3::new(46.0, 46.0, 20.0), DVec3::splat(0.6)).expect("a block");
        let cap = PI * 2.5 * 2.5 * (30.0 - 2.5 / 3.0);
        let drill = PI * 16.0 * (2.403_442 / 3.0 + 10.0 - 2.403_442);
        for (tool, depth, truth) in [
            (Tool::glenoid_reamer(), 2.5, cap),
            (Tool::peg_drill(), 10.0, drill),
        ] {
            let way = press::straight(depth, glam::DVec2::ZERO, 60).placed(&built.bone_from_plan);
            let swept = Swept::new(tool.shape, &way.poses);
            let account = accounts(&swept, &built.bone, &[&|_| false])[0];
            let error = account.mm3 / truth - 1.0;
            assert!(error.abs() < 3e-4, "{} {error}", tool.id);
            let voxels = account.voxels as f64 * built.bone.grid().voxel_mm3();
            // whole voxels under an aligned plane: half a voxel's depth
            assert!((voxels / truth - 1.0).abs() < 0.15, "{voxels}");
            assert_eq!(account.missed_frac(), Some(1.0));
            assert_eq!(account.excess, 0);
        }
    }
}
