//! Preparation of a bone beyond threshold and labels: which component, which part, what is protected, what
//! lies on the joint face, what its CT numbers mean.

use super::dense::{Lattice, VoxelBox};
use super::file::Phantom;
use super::nifti::Volume;
use super::{SceneError, labels};
use glam::DVec3;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::hu_of_density;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// CT number of a wall: so dense that no tool gets through it.
pub const WALL_HU: i16 = 30_000;
/// Label of bone that is a wall by the plan.
pub const WALL_LABEL: u8 = 250;
/// Label of what the component's choice leaves out.
const LEFT_OUT: u8 = 255;
/// A seed may lie this far from the bone, mm.
const SEED_MM: f64 = 3.0;

/// Which parts of what lies above the threshold are the bone. Parts are connected by voxels' faces (6
/// neighbours): edges and corners alone join neighbouring bones.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// All.
    #[default]
    All,
    /// The largest.
    Largest,
    /// The one at this place, LPS, mm.
    Seed([f64; 3]),
}

/// Cartilage that CT does not show.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cartilage {
    /// Thickness on the joint face, mm.
    pub thickness_mm: f64,
    /// Farthest from the plan's axis, mm.
    pub radius_mm: f64,
}

/// Apparent density of a CT number: slope · HU + offset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// g/cm³ per HU.
    pub slope: f64,
    /// g/cm³ at 0 HU.
    pub offset: f64,
    /// Scanner, phantom, date or publication that says so.
    pub source: String,
}

/// A recipe; the default changes nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recipe {
    /// Plan frame in LPS, instead of a plan's file.
    pub lps_from_plan: Option<Pose>,
    /// Which parts.
    pub part: Part,
    /// Parts smaller than this are loose fragments and left out, mm³.
    pub fragments_mm3: f64,
    /// Corners of the box to keep, LPS, mm.
    pub crop_mm: Option<[[f64; 3]; 2]>,
    /// Labels that are bone, but no tool may cut.
    pub protect: Vec<u8>,
    /// Cartilage on the joint face.
    pub cartilage: Option<Cartilage>,
    /// What CT numbers mean; `None`: the feel's own.
    pub density: Option<Calibration>,
    /// Thickness of bone at the vault's outside that is a wall, mm.
    pub wall_mm: f64,
    /// What is wrong with the phantom.
    pub phantom: Option<Phantom>,
}

/// What the choice of parts did.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Parts {
    /// Parts above the threshold.
    pub found: usize,
    /// Fragments left out.
    pub fragments: usize,
    /// Their volume, mm³.
    pub fragments_mm3: f64,
    /// Volume of all parts left out, mm³.
    pub left_out_mm3: f64,
}

impl Calibration {
    /// The CT number that means the same density by the law's own relation, HU.
    pub fn standard_hu(&self, hu: f32) -> f32 {
        let density = (self.slope * f64::from(hu) + self.offset).max(0.0);
        #[expect(clippy::cast_possible_truncation, reason = "CT numbers fit an f32")]
        let hu = hu_of_density(density) as f32;
        hu
    }
}

impl Recipe {
    /// Refuses numbers that cannot be.
    pub fn check(&self, path: &Path) -> Result<(), SceneError> {
        let refuse = |problem: String| {
            Err(SceneError::File {
                path: path.to_path_buf(),
                problem,
            })
        };
        if let Some(c) = self.cartilage
            && !((0.2..=6.0).contains(&c.thickness_mm) && (2.0..=30.0).contains(&c.radius_mm))
        {
            return refuse(format!(
                "cartilage of {} mm within {} mm cannot be (thickness 0.2 to 6, radius 2 to 30)",
                c.thickness_mm, c.radius_mm
            ));
        }
        if let Some(d) = &self.density {
            let sensible = (1e-5..=0.01).contains(&d.slope) && (-1.0..=2.0).contains(&d.offset);
            if !sensible || d.source.trim().is_empty() {
                return refuse(format!(
                    "density = {} · HU + {} ({}) cannot be: slope 0.00001 to 0.01 g/cm³ per HU, offset -1 to 2, and its source named",
                    d.slope, d.offset, d.source
                ));
            }
        }
        if !(0.0..=10.0).contains(&self.wall_mm) {
            return refuse(format!("wall_mm = {} (allowed: 0 to 10)", self.wall_mm));
        }
        if !(0.0..=1e6).contains(&self.fragments_mm3) {
            return refuse(format!(
                "fragments_mm3 = {} (allowed: 0 to 1000000)",
                self.fragments_mm3
            ));
        }
        Ok(())
    }

    /// Makes air of what lies outside the box to keep.
    pub fn crop(&self, path: &Path, ct: &mut Volume, labels: &mut [u8]) -> Result<(), SceneError> {
        let Some([a, b]) = self.crop_mm else {
            return Ok(());
        };
        let (a, b) = (DVec3::from_array(a), DVec3::from_array(b));
        let (lo, hi) = (a.min(b), a.max(b));
        let lattice = Lattice::of(&ct.grid);
        let (grid, pose) = (ct.grid, ct.lps_from_bone);
        let inside = |at: usize| {
            let [i, j, k] = lattice.coord(at);
            let p = pose.point(grid.centre(i, j, k));
            p.cmpge(lo).all() && p.cmple(hi).all()
        };
        if VoxelBox::around(lattice, 0, inside).is_none() {
            return Err(SceneError::File {
                path: path.to_path_buf(),
                problem: format!(
                    "the box to keep, {lo} to {hi} mm (LPS), holds no voxel of it; give corners inside the volume"
                ),
            });
        }
        for at in 0..ct.values.len() {
            if !inside(at) {
                ct.values[at] = super::ct::AIR_HU;
                if let Some(label) = labels.get_mut(at) {
                    *label = 0;
                }
            }
        }
        Ok(())
    }

    /// True where parts must be looked for.
    fn chooses(&self) -> bool {
        self.part != Part::All || self.fragments_mm3 > 0.0
    }

    /// Leaves out what is no part of the bone: its voxels take a label of their own, which is air. Without a
    /// label map one is made: 1 is the bone.
    pub fn choose(
        &self,
        path: &Path,
        (ct, threshold_hu): (&Volume, f32),
        labels: &mut Vec<u8>,
        kept: &mut Vec<u8>,
    ) -> Result<Parts, SceneError> {
        if !self.chooses() {
            return Ok(Parts::default());
        }
        let keep = labels::Keep::new(kept);
        let bony = |at: usize| match labels.get(at) {
            Some(&label) => keep.has(label),
            None => ct.values[at] > threshold_hu,
        };
        let lattice = Lattice::of(&ct.grid);
        let (ids, sizes) = connected(lattice, ct.values.len(), bony);
        let mm3 = ct.grid.voxel_mm3();
        let wanted = match self.part {
            Part::All => None,
            Part::Largest => (1..sizes.len()).max_by_key(|&n| sizes[n]),
            Part::Seed(seed) => Some(at_seed(path, ct, &ids, DVec3::from_array(seed))?),
        };
        let small = |n: usize| (sizes[n] as f64) * mm3 < self.fragments_mm3;
        let is_bone = |n: usize| wanted.map_or(!small(n), |w| w == n);
        let mut parts = Parts {
            found: sizes.len() - 1,
            ..Parts::default()
        };
        for (n, &size) in sizes.iter().enumerate().skip(1) {
            if !is_bone(n) {
                parts.left_out_mm3 += size as f64 * mm3;
            }
            if small(n) {
                parts.fragments += 1;
                parts.fragments_mm3 += size as f64 * mm3;
            }
        }
        if labels.is_empty() {
            *labels = vec![0; ids.len()];
            *kept = vec![1];
        }
        let one = kept.first().copied().unwrap_or(1);
        for (label, &id) in labels.iter_mut().zip(&ids) {
            match id as usize {
                0 => {}
                n if is_bone(n) => {
                    if *label == 0 {
                        *label = one;
                    }
                }
                _ => *label = LEFT_OUT,
            }
        }
        Ok(parts)
    }
}

/// The part at a seed, or the nearest within 3 mm.
fn at_seed(path: &Path, ct: &Volume, ids: &[u32], seed: DVec3) -> Result<usize, SceneError> {
    let lattice = Lattice::of(&ct.grid);
    let p = ct.lps_from_bone.inverse().point(seed);
    let distance = |at: usize| {
        let [i, j, k] = lattice.coord(at);
        ct.grid.centre(i, j, k).distance(p)
    };
    let near = (0..ids.len())
        .filter(|&at| ids[at] != 0 && distance(at) <= SEED_MM)
        .min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    near.map(|at| ids[at] as usize).ok_or_else(|| SceneError::File {
        path: path.to_path_buf(),
        problem: format!("no bone within {SEED_MM} mm of the seed {seed} (LPS); give a place inside the bone, or lower the threshold"),
    })
}

/// Number of the part of each voxel (0: not bony) and the voxels of each; parts touch by faces.
pub fn connected(
    lattice: Lattice,
    length: usize,
    bony: impl Fn(usize) -> bool,
) -> (Vec<u32>, Vec<usize>) {
    let mut ids = vec![0_u32; length];
    let mut sizes = vec![0];
    let mut stack = Vec::new();
    for start in 0..length {
        if ids[start] != 0 || !bony(start) {
            continue;
        }
        let id = u32::try_from(sizes.len()).unwrap_or(u32::MAX);
        let mut size = 0;
        ids[start] = id;
        stack.push(start);
        while let Some(at) = stack.pop() {
            size += 1;
            for next in lattice.faces(at) {
                if ids[next] == 0 && bony(next) {
                    ids[next] = id;
                    stack.push(next);
                }
            }
        }
        sizes.push(size);
    }
    (ids, sizes)
}

#[cfg(test)]
mod tests;
