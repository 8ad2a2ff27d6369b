//! Getting a bone: a patient's CT with its label map and plan, or the built-in scapula phantom.
//!
//! Everything here runs once, before the servo starts, on all cores.

mod cartilage;
mod ct;
pub mod dense;
pub mod file;
pub mod labels;
mod memory;
pub mod nifti;
pub mod phantom;
pub mod plan;
pub mod recipe;
pub mod resample;
pub mod text_ct;

use osteon_sim_core::bone::{Bone, BoneError};
use osteon_sim_core::pose::Pose;
use recipe::{Parts, Recipe};
use resample::ResampleError;
use serde::Serialize;
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;

/// Which bone to load, and how.
#[derive(Debug, Clone, clap::Args)]
pub struct SceneArgs {
    /// A scene's folder, as 'osteon import' makes it; or one that is built in: normal, eroded, soft
    #[arg(long, value_name = "DIR", conflicts_with_all = ["bone", "labels", "keep", "threshold", "seed"])]
    pub scene: Option<PathBuf>,
    /// CT of the bone: NIfTI (.nii, .nii.gz) or text (.txt, .csv, .xyz: `x y z density`) [default: the built-in scapula phantom]
    #[arg(long, value_name = "PATH")]
    pub bone: Option<PathBuf>,
    /// Label map on the CT's grid; its kept labels are bone, its others are air
    #[arg(long, value_name = "PATH", requires = "bone")]
    pub labels: Option<PathBuf>,
    /// Labels that are bone [default: all]
    #[arg(long, value_name = "N[,N]", value_delimiter = ',', requires = "labels")]
    pub keep: Vec<u8>,
    /// Plan: JSON with `glenoid_centre` and `glenoid_normal_outward`, LPS mm (a CT needs one)
    #[arg(long, value_name = "FILE")]
    pub pose: Option<PathBuf>,
    /// CT number of the bone's surface, HU
    #[arg(
        long,
        value_name = "HU",
        default_value_t = 150.0,
        allow_negative_numbers = true
    )]
    pub threshold: f32,
    /// Edge of a voxel, mm; resamples the bone [default: the CT's own; phantom: 0.8]
    #[arg(long, value_name = "H")]
    pub voxel_mm: Option<f64>,
    /// Seed of the phantom's texture
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Preparation that a scene's file asks for.
    #[arg(skip)]
    pub recipe: Recipe,
}

impl Default for SceneArgs {
    fn default() -> Self {
        Self {
            scene: None,
            bone: None,
            labels: None,
            keep: Vec::new(),
            pose: None,
            threshold: 150.0,
            voxel_mm: None,
            seed: 1,
            recipe: Recipe::default(),
        }
    }
}

/// A bone, ready to be worked on.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The bone.
    pub bone: Arc<Bone>,
    /// Plan frame (origin at the joint face's centre, z outward) to bone frame, mm.
    pub bone_from_plan: Pose,
    /// Where the bone is from: a path, or "phantom" with its seed.
    pub source: String,
    /// Figures for reports.
    pub summary: SceneSummary,
    /// Labels that count as this bone, ascending; empty where there is no label map.
    pub kept_labels: Vec<u8>,
    /// Labels of bone that is not to be cut.
    pub protected_labels: Vec<u8>,
}

/// Figures of a loaded bone.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneSummary {
    /// Voxels along x, y, z, after cropping.
    pub dims: [usize; 3],
    /// Voxel spacing, mm.
    pub spacing_mm: [f64; 3],
    /// 32³ chunks of the lattice.
    pub chunks_total: usize,
    /// Chunks kept.
    pub chunks_active: usize,
    /// Solid volume, mm³.
    pub solid_mm3: f64,
    /// CT number of the surface, HU; absent for the phantom.
    pub threshold_hu: Option<f32>,
    /// What `--voxel-mm` (or the phantom's lattice) costs; absent at the CT's own spacing.
    pub resample_error: Option<ResampleError>,
    /// CT voxels that were no number (taken as air).
    pub non_finite_voxels: usize,
    /// CT voxels outside the 16-bit range of CT numbers (clamped).
    pub clamped_voxels: usize,
    /// Voxels that a text CT leaves out of its grid (taken as empty).
    pub absent_voxels: usize,
    /// Parts found and left out.
    pub parts: Parts,
    /// Cartilage laid on the joint face, mm³.
    pub cartilage_mm3: f64,
    /// Bone that is a wall by the plan, mm³.
    pub wall_mm3: f64,
}

/// Why no scene could be made: one line with what, where and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A volume could not be read.
    #[error(transparent)]
    Nifti(#[from] nifti::NiftiError),
    /// A text CT could not be read.
    #[error(transparent)]
    TextCt(#[from] text_ct::TextCtError),
    /// A threshold at which the voxels that a text CT leaves out would be bone.
    #[error("--threshold {threshold_hu} HU: the voxels that {} leaves out count as {} HU; give a threshold above that", path.display(), text_ct::EMPTY_HU)]
    EmptyThreshold {
        /// The CT.
        path: PathBuf,
        /// The threshold, HU.
        threshold_hu: f32,
    },
    /// A scene's folder that cannot be used.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The label map lies on another grid than the CT.
    #[error("{}: not on the grid of {} ({difference}); resample the label map onto the CT", labels.display(), bone.display())]
    OtherGrid {
        /// The label map.
        labels: PathBuf,
        /// The CT.
        bone: PathBuf,
        /// What differs.
        difference: String,
    },
    /// A label that is no whole number in 0..=255.
    #[error("{}: a label of {value}; labels must be whole numbers from 0 to 255", path.display())]
    LabelValue {
        /// The label map.
        path: PathBuf,
        /// The value found.
        value: f32,
    },
    /// A label to keep that no voxel has.
    #[error("{}: no voxel has label {label}; --keep one of: {present}", path.display())]
    NoSuchLabel {
        /// The label map.
        path: PathBuf,
        /// The label asked for.
        label: u8,
        /// Labels that there are.
        present: String,
    },
    /// No bone is left.
    #[error("{}: no bone above {threshold_hu} HU{labels}; lower --threshold or keep other labels", path.display())]
    Empty {
        /// The CT.
        path: PathBuf,
        /// The threshold, HU.
        threshold_hu: f32,
        /// The labels kept, in words.
        labels: String,
    },
    /// A threshold that is no CT number.
    #[error("--threshold {0} HU is no CT number; give one from -1000 to 3000 (bone: 120 to 300)")]
    Threshold(f32),
    /// A voxel size that is absurd for this bone.
    #[error(
        "--voxel-mm {voxel_mm}: from 0.05 to 10 mm and at most 2^28 voxels are possible; give e.g. 0.5"
    )]
    VoxelSize {
        /// The size asked for, mm.
        voxel_mm: f64,
    },
    /// A CT without a plan.
    #[error("{}: a CT needs a plan; give --pose FILE with glenoid_centre and glenoid_normal_outward (LPS mm)", path.display())]
    NoPlan {
        /// The CT.
        path: PathBuf,
    },
    /// A plan that cannot be used.
    #[error("{}: {problem}", path.display())]
    Plan {
        /// The plan.
        path: PathBuf,
        /// What is wrong and what to do.
        problem: String,
    },
    /// Options that do not go together.
    #[error("{option} needs {needs}; add it or leave {option} out")]
    Options {
        /// The option given.
        option: &'static str,
        /// The one that is missing.
        needs: &'static str,
    },
    /// The dense arrays did not make a bone.
    #[error("the bone could not be built: {0}; report this with the input")]
    Bone(BoneError),
}

/// Loads the bone that `args` asks for. `progress` hears a stage's name and the fraction done,
/// in [0, 1].
pub fn load(args: &SceneArgs, progress: &mut dyn FnMut(&str, f32)) -> Result<Scene, SceneError> {
    if args.scene.is_some() {
        progress("checking the scene", 0.0);
    }
    let args = &*resolve(args)?;
    match &args.bone {
        Some(path) => ct::load(args, path, progress),
        None => phantom::load(args, progress),
    }
}

/// The same options with the files of a scene's folder instead of its name.
pub(crate) fn resolve(args: &SceneArgs) -> Result<Cow<'_, SceneArgs>, SceneError> {
    check_options(args)?;
    Ok(match &args.scene {
        Some(dir) => Cow::Owned(file::resolved(dir, args)?),
        None => Cow::Borrowed(args),
    })
}

fn check_options(args: &SceneArgs) -> Result<(), SceneError> {
    let needs = |given: bool, option, has: bool, needs| {
        if given && !has {
            Err(SceneError::Options { option, needs })
        } else {
            Ok(())
        }
    };
    needs(
        args.labels.is_some(),
        "--labels",
        args.bone.is_some(),
        "--bone",
    )?;
    needs(
        !args.keep.is_empty(),
        "--keep",
        args.labels.is_some(),
        "--labels",
    )?;
    if !(-1000.0..=3000.0).contains(&args.threshold) {
        return Err(SceneError::Threshold(args.threshold));
    }
    Ok(())
}

impl SceneSummary {
    fn of(bone: &Bone) -> Self {
        Self {
            dims: bone.grid().dims,
            spacing_mm: bone.grid().spacing_mm.to_array(),
            chunks_total: bone.chunks_total(),
            chunks_active: bone.chunk_count(),
            solid_mm3: bone.solid_mm3(),
            threshold_hu: None,
            resample_error: None,
            non_finite_voxels: 0,
            clamped_voxels: 0,
            absent_voxels: 0,
            parts: Parts::default(),
            cartilage_mm3: 0.0,
            wall_mm3: 0.0,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
