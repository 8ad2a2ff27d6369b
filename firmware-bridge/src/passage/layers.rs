//! The tissues that a planned axis goes through.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a search of some thousand steps"
)]

use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::Sampler;
use osteon_sim_core::tissue::Tissue;

/// A thicker layer is timed over its first so many mm, and ends the list.
pub const TIMED_MM: f64 = 4.0;
/// The search along the axis: from this far over the plan's origin to as far below it, mm …
const REACH_MM: f64 = 40.0;
/// … in steps of this, mm.
const STEP_MM: f64 = 0.05;

/// A tissue on the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// Its class.
    pub tissue: Tissue,
    /// Where it begins, mm below the bone's surface on the axis.
    pub from_mm: f64,
    /// Where it ends, or where its timing ends.
    pub to_mm: f64,
}

/// The layers along a planned axis, from the surface on; none where the axis meets no bone.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    /// Height of the bone's surface on the axis over the plan's origin, mm.
    pub surface_mm: f64,
    /// Each begins where the one before ends, to about half a voxel. At most 4 mm of the last.
    pub layers: Vec<Layer>,
}

impl Layers {
    /// Goes down the plan's z axis through the uncut bone, to its other side or through the first
    /// layer of at least [`TIMED_MM`]. Runs shorter than half a voxel belong to the layer above.
    pub fn along(bone: &Bone, bone_from_plan: &Pose) -> Self {
        let uncut = Uncut::new(bone);
        let steps = (2.0 * REACH_MM / STEP_MM) as u32;
        let thin = 0.5 * bone.grid().spacing_mm.min_element();
        let mut surface_mm = 0.0;
        let mut layers: Vec<Layer> = Vec::new();
        for n in 0..steps {
            let z = REACH_MM - STEP_MM * f64::from(n);
            let Some((_, tissue)) = uncut.at(bone_from_plan.point(DVec3::Z * z)) else {
                if layers.is_empty() {
                    continue;
                }
                break;
            };
            if layers.is_empty() {
                surface_mm = z;
            }
            let depth = hundredths(surface_mm - z);
            let same = |layer: &&mut Layer| layer.tissue == tissue || tissue == Tissue::Air;
            if let Some(layer) = layers.last_mut().filter(same) {
                layer.to_mm = hundredths(depth + STEP_MM);
            } else {
                join_thin(&mut layers, thin);
                layers.push(Layer {
                    tissue,
                    from_mm: depth,
                    to_mm: hundredths(depth + STEP_MM),
                });
            }
            if let Some(layer) = layers.last_mut()
                && layer.to_mm - layer.from_mm >= TIMED_MM
            {
                layer.to_mm = hundredths(layer.from_mm + TIMED_MM);
                break;
            }
        }
        Self { surface_mm, layers }
    }

    /// Where the last layer ends, mm below the surface.
    pub fn end_mm(&self) -> f64 {
        self.layers.last().map_or(0.0, |layer| layer.to_mm)
    }
}

/// Sums of steps as people write them.
fn hundredths(mm: f64) -> f64 {
    (mm * 100.0).round() / 100.0
}

/// A last layer that is too thin becomes a part of the one above it.
fn join_thin(layers: &mut Vec<Layer>, thin: f64) {
    let is_thin = |layer: &mut Layer| layer.to_mm - layer.from_mm < thin;
    if layers.len() > 1
        && let Some(gone) = layers.pop_if(is_thin)
        && let Some(above) = layers.last_mut()
    {
        above.to_mm = gone.to_mm;
    }
}

/// The uncut bone, read at points of its frame (mm).
pub(super) struct Uncut<'a> {
    bone: &'a Bone,
    cut: Cut,
}

impl<'a> Uncut<'a> {
    pub(super) fn new(bone: &'a Bone) -> Self {
        Self {
            bone,
            cut: Cut::new(bone),
        }
    }

    /// CT number, HU, and class of the nearest voxel; `None` outside the bone.
    pub(super) fn at(&self, p_in_bone: DVec3) -> Option<(f64, Tissue)> {
        let found = Sampler::new(self.bone, &self.cut).matter(p_in_bone)?;
        let tissue = Tissue::ALL.into_iter().find(|t| *t as u8 == found.class)?;
        Some((f64::from(found.hu), tissue))
    }
}
