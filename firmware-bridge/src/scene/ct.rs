//! A patient's CT to a bone: read, crop, segment, distance, resample, classify.

use super::dense::{Dense, Lattice, VoxelBox, distance, mark_subchondral, near_bone};
use super::labels::{Keep, check_same_grid, claim, clear_excluded, label_bytes, segment};
use super::nifti::{self, Volume};
use super::recipe::{self, Calibration, Parts};
use super::resample::{self, ResampleError};
use super::{Scene, SceneArgs, SceneError, SceneSummary, cartilage, plan, text_ct};
use osteon_sim_core::bone::Occupancy;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::Tissue;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Voxels around the bone that a crop keeps: the distance field's reach and the rim.
const MARGIN: usize = 5;
/// CT number of air, HU.
pub(super) const AIR_HU: f32 = -1000.0;
/// CT number from which bone is cortical, HU.
const CORTICAL_HU: i16 = 600;

/// The CT cut to the bone's box.
struct Cropped {
    grid: Grid,
    lps_from_bone: Pose,
    hu: Vec<f32>,
    // all zero without a label map
    labels: Vec<u8>,
    keep: Keep,
    kept_labels: Vec<u8>,
    parts: Parts,
    // what CT numbers mean, where the scene says so
    density: Option<Calibration>,
    non_finite: usize,
    clamped: usize,
}

/// CT numbers, labels and distance on one lattice.
struct Fields {
    grid: Grid,
    hu: Vec<f32>,
    labels: Vec<u8>,
    solid_mm: Vec<f32>,
}

/// Loads the CT at `path`.
pub(super) fn load(
    args: &SceneArgs,
    path: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Scene, SceneError> {
    let lps_from_plan = match (&args.recipe.lps_from_plan, &args.pose) {
        (Some(pose), _) => *pose,
        (None, Some(file)) => plan::read(file)?,
        (None, None) => {
            return Err(SceneError::NoPlan {
                path: path.to_path_buf(),
            });
        }
    };
    let plan_path = args.pose.as_deref().unwrap_or(path);
    progress("reading the CT", 0.0);
    let (ct, absent) = read_ct(args, path, progress)?;
    let mut cropped = read_cropped(args, path, ct)?;
    let bone_from_plan = cropped.lps_from_bone.inverse().then(&lps_from_plan);
    plan::check_near(plan_path, &cropped.grid, &bone_from_plan)?;
    progress("finding the surface", 0.3);
    let mut fields = surface(&mut cropped, args.threshold)?;
    let mut error = None;
    if let Some(voxel_mm) = args.voxel_mm {
        progress("resampling", 0.5);
        let (resampled, cost) = resampled(&fields, &cropped.keep, voxel_mm)?;
        (fields, error) = (resampled, Some(cost));
    }
    progress("classifying", 0.8);
    let mut dense = classified(fields, &cropped);
    mark_subchondral(&mut dense, &bone_from_plan)?;
    let (cartilage_mm3, wall_mm3) = added(&mut dense, args, &bone_from_plan)?;
    let bone = dense
        .into_bone()
        .map_err(|e| empty_or(e, args, path, &cropped.kept_labels))?;
    progress("bone ready", 1.0);
    let mut summary = SceneSummary::of(&bone);
    summary.threshold_hu = Some(args.threshold);
    summary.resample_error = error;
    summary.non_finite_voxels = cropped.non_finite;
    summary.clamped_voxels = cropped.clamped;
    summary.absent_voxels = absent;
    summary.parts = cropped.parts;
    (summary.cartilage_mm3, summary.wall_mm3) = (cartilage_mm3, wall_mm3);
    let mut protected = args.recipe.protect.clone();
    if args.recipe.wall_mm > 0.0 {
        protected.push(recipe::WALL_LABEL);
    }
    Ok(Scene {
        bone: Arc::new(bone),
        bone_from_plan,
        source: path.display().to_string(),
        summary,
        kept_labels: cropped.kept_labels,
        protected_labels: protected,
    })
}

/// What the CT does not show: cartilage, walls, protected structures. Volumes of the first two, mm³.
fn added(
    dense: &mut Dense,
    args: &SceneArgs,
    bone_from_plan: &Pose,
) -> Result<(f64, f64), SceneError> {
    let recipe = &args.recipe;
    let mut added = (0.0, 0.0);
    if let Some(wanted) = recipe.cartilage {
        added.0 = cartilage::lay(dense, bone_from_plan, wanted)?;
    }
    if recipe.wall_mm > 0.0 {
        added.1 = cartilage::wall(dense, bone_from_plan, recipe.wall_mm)?;
    }
    if !recipe.protect.is_empty() {
        for (hu, label) in dense.density_hu.iter_mut().zip(&dense.label) {
            if recipe.protect.contains(label) {
                *hu = recipe::WALL_HU;
            }
        }
    }
    Ok(added)
}

fn empty_or(error: SceneError, args: &SceneArgs, path: &Path, kept: &[u8]) -> SceneError {
    match error {
        SceneError::Bone(osteon_sim_core::bone::BoneError::Empty) => empty(args, path, kept),
        other => other,
    }
}

fn empty(args: &SceneArgs, path: &Path, kept: &[u8]) -> SceneError {
    let labels = if args.labels.is_some() {
        format!(" in labels {kept:?}")
    } else {
        String::new()
    };
    SceneError::Empty {
        path: path.to_path_buf(),
        threshold_hu: args.threshold,
        labels,
    }
}

/// The CT, a volume or a text, and how many of its voxels a text leaves out.
fn read_ct(
    args: &SceneArgs,
    path: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<(Volume, usize), SceneError> {
    if !text_ct::named_like_one(path) {
        return Ok((nifti::read(path)?, 0));
    }
    if args.threshold <= f32::from(text_ct::EMPTY_HU) {
        return Err(SceneError::EmptyThreshold {
            path: path.to_path_buf(),
            threshold_hu: args.threshold,
        });
    }
    let mut tell = |done: f32| progress("reading the CT", 0.3 * done);
    let rect = text_ct::read(path, text_ct::Options::default(), &mut tell)?;
    let absent = rect.absent;
    // a label map lies on the file's own grid
    let margin = if args.labels.is_some() { 0 } else { MARGIN };
    Ok((rect.into_volume(margin), absent))
}

/// Reads the label map and keeps the box of the kept bone.
fn read_cropped(args: &SceneArgs, path: &Path, mut ct: Volume) -> Result<Cropped, SceneError> {
    let labels = args.labels.as_deref().map(|p| (p, nifti::read(p)));
    let (non_finite, clamped) = sanitise(&mut ct.values);
    let (mut labels, mut kept_labels) = match labels {
        Some((labels_path, volume)) => {
            let volume = volume?;
            check_same_grid((path, &ct), (labels_path, &volume))?;
            let kept = [args.keep.as_slice(), &args.recipe.protect].concat();
            let asked = if args.keep.is_empty() {
                &[]
            } else {
                kept.as_slice()
            };
            read_labels(labels_path, &volume, asked)?
        }
        None => (Vec::new(), Vec::new()),
    };
    args.recipe.crop(path, &mut ct, &mut labels)?;
    let chosen = (&ct, args.threshold);
    let parts = args
        .recipe
        .choose(path, chosen, &mut labels, &mut kept_labels)?;
    let keep = Keep::new(&kept_labels);
    let lattice = Lattice::of(&ct.grid);
    let above = |at: usize| ct.values[at] > args.threshold;
    let kept = |at: usize| labels.get(at).is_none_or(|&l| keep.has(l));
    if !(0..ct.values.len()).any(|at| kept(at) && above(at)) {
        return Err(empty(args, path, &kept_labels));
    }
    // below the threshold a kept voxel is bone all the same
    let wanted = |at: usize| kept(at) && (above(at) || !labels.is_empty());
    let region =
        VoxelBox::around(lattice, MARGIN, wanted).ok_or_else(|| empty(args, path, &kept_labels))?;
    let grid = Grid {
        dims: region.dims(),
        ..ct.grid
    };
    Ok(Cropped {
        grid,
        lps_from_bone: crop_pose(&ct, region),
        hu: region.crop(lattice, &ct.values),
        labels: if labels.is_empty() {
            vec![0; grid.len()]
        } else {
            region.crop(lattice, &labels)
        },
        keep,
        kept_labels,
        parts,
        density: args.recipe.density.clone(),
        non_finite,
        clamped,
    })
}

/// The pose of the lattice that begins at the region's lowest voxel.
fn crop_pose(ct: &Volume, region: VoxelBox) -> Pose {
    let [i, j, k] = region.lo;
    let origin = ct.lps_from_bone.point(ct.grid.centre(i, j, k));
    Pose::new(ct.lps_from_bone.rotation, origin)
}

/// CT numbers into the range of `i16`; counts of those that were no number and of those clamped.
fn sanitise(hu: &mut [f32]) -> (usize, usize) {
    let (least, most) = (f32::from(i16::MIN), f32::from(i16::MAX));
    hu.par_iter_mut()
        .map(|v| {
            if v.is_nan() {
                *v = AIR_HU;
                (1, 0)
            } else if *v < least || *v > most {
                *v = v.clamp(least, most);
                (0, 1)
            } else {
                (0, 0)
            }
        })
        .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
}

/// Label bytes and the kept labels, ascending: those asked for, or all that there are.
fn read_labels(
    path: &Path,
    volume: &Volume,
    keep: &[u8],
) -> Result<(Vec<u8>, Vec<u8>), SceneError> {
    let (bytes, present) = label_bytes(path, volume)?;
    if keep.is_empty() {
        return Ok((bytes, present.into_keys().collect()));
    }
    if let Some(&label) = keep.iter().find(|l| !present.contains_key(l)) {
        let names: Vec<String> = present.keys().map(u8::to_string).collect();
        return Err(SceneError::NoSuchLabel {
            path: path.to_path_buf(),
            label,
            present: names.join(", "),
        });
    }
    let mut kept = keep.to_vec();
    kept.sort_unstable();
    kept.dedup();
    Ok((bytes, kept))
}

/// The distance field on the CT's own lattice. Takes CT numbers and labels out of `cropped`.
fn surface(cropped: &mut Cropped, threshold_hu: f32) -> Result<Fields, SceneError> {
    let grid = cropped.grid;
    let hu = core::mem::take(&mut cropped.hu);
    let mut labels = core::mem::take(&mut cropped.labels);
    let phi = if cropped.kept_labels.is_empty() {
        hu.iter().map(|v| v - threshold_hu).collect()
    } else {
        segment(
            Lattice::of(&grid),
            &hu,
            &mut labels,
            &cropped.keep,
            threshold_hu,
        )
    };
    let mut solid_mm = distance(&grid, &phi)?;
    clear_excluded(&grid, &mut solid_mm, &labels, &cropped.keep);
    Ok(Fields {
        grid,
        hu,
        labels,
        solid_mm,
    })
}

/// The fields on cubes of `voxel_mm`, and what that costs.
fn resampled(
    source: &Fields,
    keep: &Keep,
    voxel_mm: f64,
) -> Result<(Fields, ResampleError), SceneError> {
    let grid = resample::resampled_grid(&source.grid, voxel_mm)?;
    let labels = resample::nearest(&source.grid, &source.labels, &grid);
    let hu = resample::cubic(&source.grid, &source.hu, &grid);
    let phi = resample::cubic(&source.grid, &source.solid_mm, &grid);
    let mut solid_mm = distance(&grid, &phi)?;
    drop(phi);
    clear_excluded(&grid, &mut solid_mm, &labels, keep);
    let points = resample::surface_points(&source.grid, &source.solid_mm);
    let read = (source.hu.as_slice(), source.solid_mm.as_slice());
    let error = ResampleError {
        hu_rms: Some(resample::hu_error(&source.grid, read, &grid, &hu)),
        ..ResampleError::at(&grid, &solid_mm, &points)
    };
    let fields = Fields {
        grid,
        hu,
        labels,
        solid_mm,
    };
    Ok((fields, error))
}

/// Final arrays: densities, labels of all that has an occupancy, tissue classes.
fn classified(mut fields: Fields, cropped: &Cropped) -> Dense {
    let grid = fields.grid;
    let occupancy = Occupancy::new(&grid);
    let solid_mm = fields.solid_mm;
    let occupied = |at: usize| occupancy.units(grid.quantise(solid_mm[at])) > 0;
    claim(
        Lattice::of(&grid),
        &mut fields.labels,
        &cropped.keep,
        occupied,
    );
    let excluded_to_air = |(&hu, &label): (&f32, &u8)| {
        let hu = if cropped.keep.excludes(label) && !cropped.kept_labels.is_empty() {
            AIR_HU
        } else {
            cropped
                .density
                .as_ref()
                .map_or(hu, |d| d.standard_hu(hu))
                .round()
        };
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the cubic may overshoot; the cast saturates"
        )]
        let hu = hu as i16;
        hu
    };
    let density_hu: Vec<i16> = fields
        .hu
        .par_iter()
        .zip(&fields.labels)
        .map(excluded_to_air)
        .collect();
    let class_of = |(&hu, (&solid, &label)): (&i16, (&f32, &u8))| {
        if !near_bone(&grid, solid) || cropped.keep.excludes(label) {
            Tissue::Air as u8
        } else if hu >= CORTICAL_HU {
            Tissue::Cortical as u8
        } else {
            Tissue::Cancellous as u8
        }
    };
    let class = density_hu
        .par_iter()
        .zip(solid_mm.par_iter().zip(&fields.labels))
        .map(class_of)
        .collect();
    Dense {
        grid,
        lps_from_bone: cropped.lps_from_bone,
        density_hu,
        solid_mm,
        class,
        label: fields.labels,
    }
}
