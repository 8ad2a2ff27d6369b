//! `osteon prepare`: how a scene's bone is made of its volume, with numbers to choose by.

use super::{ClinicError, write_whole};
use crate::progress::Progress;
use crate::scene::dense::Lattice;
use crate::scene::file::{self, SceneFile};
use crate::scene::recipe::{Calibration, Cartilage, Part, connected};
use crate::scene::{Scene, SceneArgs, load, nifti};
use osteon_sim_core::pose::Pose;
use serde::Serialize;
use std::path::PathBuf;

/// Options of the preparation.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Without options it only shows what the scene's thresholds would give. What is set is written into scene.toml;
the volumes stay as they were imported.

Tissue classes: cortical from 600 HU; subchondral within 3 mm under the joint face from 400 HU; else cancellous.")]
pub struct PrepareArgs {
    /// The scene's folder
    pub scene: PathBuf,
    /// CT number of the bone's surface, HU
    #[arg(long, value_name = "HU", allow_negative_numbers = true)]
    pub threshold: Option<f32>,
    /// Parts that are the bone: all, largest, or the one at X,Y,Z (LPS, mm); parts touch by voxels' faces
    #[arg(long, value_name = "PART", value_parser = part, allow_hyphen_values = true)]
    pub part: Option<Part>,
    /// Leave out loose fragments smaller than this, mm³
    #[arg(long, value_name = "MM3")]
    pub fragments: Option<f64>,
    /// Labels that are bone
    #[arg(long, value_name = "N[,N]", value_delimiter = ',')]
    pub keep: Option<Vec<u8>>,
    /// Labels that are bone, but not to be cut
    #[arg(long, value_name = "N[,N]", value_delimiter = ',')]
    pub protect: Option<Vec<u8>>,
    /// Box to keep: two corners, LPS, mm
    #[arg(
        long,
        value_name = "X,Y,Z,X,Y,Z",
        value_delimiter = ',',
        num_args = 6,
        allow_hyphen_values = true
    )]
    pub crop: Option<Vec<f64>>,
    /// Edge of the voxels, mm; the error that this costs is shown
    #[arg(long, value_name = "H")]
    pub voxel_mm: Option<f64>,
    /// Thickness of the cartilage to lay on the joint face, mm; 0: none (needs a plan)
    #[arg(long, value_name = "MM")]
    pub cartilage: Option<f64>,
    /// Apparent density of a CT number on this scanner: slope (g/cm³ per HU), offset (g/cm³) and where they are from
    #[arg(long, value_names = ["SLOPE", "OFFSET", "SOURCE"], num_args = 3, allow_hyphen_values = true)]
    pub density: Option<Vec<String>>,
    /// Write what was found as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

fn part(text: &str) -> Result<Part, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|p| p.trim().parse().ok()).collect();
    match (text, numbers.as_deref()) {
        ("all", _) => Ok(Part::All),
        ("largest", _) => Ok(Part::Largest),
        (_, Some(&[x, y, z])) => Ok(Part::Seed([x, y, z])),
        _ => Err("give all, largest, or X,Y,Z in mm (LPS)".to_owned()),
    }
}

/// What a threshold would give, the labels left aside.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Preview {
    /// HU.
    pub threshold_hu: f32,
    /// Volume above it, cm³.
    pub cm3: f64,
    /// Parts that touch by faces.
    pub parts: usize,
    /// Share of the largest part, in [0, 1].
    pub largest: f64,
}

/// Prepares, telling on stderr what came out.
#[expect(clippy::print_stderr, reason = "what a command-line program says")]
pub fn run(args: &PrepareArgs) -> anyhow::Result<()> {
    let mut scene = file::read(&args.scene)?;
    let before = scene.clone();
    apply(args, &mut scene)?;
    let path = file::path_in(&args.scene);
    let mut bar = Progress::new("prepare");
    let mut progress = |stage: &str, share: f32| bar.show(stage, share);
    let previews = previews(&path, &scene, &mut progress)?;
    // a recipe that makes no bone is not written
    let made = trial(args, &scene, &path, &mut progress);
    bar.finish();
    let made = made?;
    eprintln!("threshold     volume    parts   largest");
    for p in &previews {
        eprintln!(
            "{:>6} HU {:>8.1} cm³ {:>6}   {:>5.1} %",
            p.threshold_hu,
            p.cm3,
            p.parts,
            100.0 * p.largest
        );
    }
    for line in lines(&made) {
        eprintln!("{line}");
    }
    if scene != before {
        write_whole(&path, &scene.text()?)?;
        eprintln!("scene: {}", path.display());
    }
    if let Some(json) = &args.json {
        let all = serde_json::json!({ "thresholds": previews, "bone": made.summary });
        write_whole(json, &(serde_json::to_string_pretty(&all)? + "\n"))?;
    }
    Ok(())
}

/// Sets what was asked for.
fn apply(args: &PrepareArgs, scene: &mut SceneFile) -> Result<(), ClinicError> {
    let surface = &mut scene.surface;
    surface.threshold_hu = args.threshold.unwrap_or(surface.threshold_hu);
    surface.part = args.part.unwrap_or(surface.part);
    surface.fragments_mm3 = args.fragments.unwrap_or(surface.fragments_mm3);
    surface.voxel_mm = args.voxel_mm.or(surface.voxel_mm);
    if let Some(&[a, b, c, d, e, f]) = args.crop.as_deref() {
        surface.crop_mm = Some([[a, b, c], [d, e, f]]);
    }
    if let Some(thickness_mm) = args.cartilage {
        scene.cartilage = (thickness_mm > 0.0).then_some(Cartilage {
            thickness_mm,
            radius_mm: 18.0,
        });
    }
    if let Some([slope, offset, source]) = args.density.as_deref() {
        let number = |text: &String| {
            text.parse::<f64>().map_err(|_not| {
                ClinicError::Plan(format!(
                    "--density: {text} is no number; give slope, offset and source"
                ))
            })
        };
        scene.density = Some(Calibration {
            slope: number(slope)?,
            offset: number(offset)?,
            source: source.clone(),
        });
    }
    if args.keep.is_some() || args.protect.is_some() {
        let labels = scene.labels.as_mut().ok_or_else(|| {
            ClinicError::Plan(
                "--keep and --protect need a label map; import with --labels FILE".to_owned(),
            )
        })?;
        labels.keep = args.keep.clone().unwrap_or_else(|| labels.keep.clone());
        labels.protect = args
            .protect
            .clone()
            .unwrap_or_else(|| labels.protect.clone());
    }
    Ok(())
}

/// The name of the scene's volume.
fn volume(scene: &SceneFile) -> Result<&str, ClinicError> {
    let entry = scene.volume.as_ref();
    entry.map(|v| v.file.as_str()).ok_or_else(|| {
        ClinicError::Plan("the scene is the built-in phantom; nothing can be prepared".to_owned())
    })
}

/// What other thresholds would give.
fn previews(
    path: &std::path::Path,
    scene: &SceneFile,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Vec<Preview>, ClinicError> {
    progress("trying thresholds", 0.0);
    let folder = path.parent().map_or_else(PathBuf::new, PathBuf::from);
    let ct = nifti::read(&folder.join(volume(scene)?)).map_err(crate::scene::SceneError::from)?;
    let set = scene.surface.threshold_hu;
    let mut thresholds = vec![100.0, 150.0, 200.0, 300.0, 400.0, set];
    thresholds.sort_unstable_by(f32::total_cmp);
    thresholds.dedup();
    let lattice = Lattice::of(&ct.grid);
    let of = |(n, threshold_hu): (usize, f32)| {
        progress("trying thresholds", n as f32 / 6.0);
        let (_, sizes) = connected(lattice, ct.values.len(), |at| ct.values[at] > threshold_hu);
        let all: usize = sizes.iter().sum();
        let most = sizes.iter().copied().max().unwrap_or(0);
        Preview {
            threshold_hu,
            cm3: all as f64 * ct.grid.voxel_mm3() / 1000.0,
            parts: sizes.len() - 1,
            largest: most as f64 / all.max(1) as f64,
        }
    };
    Ok(thresholds.into_iter().enumerate().map(of).collect())
}

/// Loads the bone by the new recipe, from a copy of the scene's file beside its volumes.
fn trial(
    args: &PrepareArgs,
    scene: &SceneFile,
    path: &std::path::Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Scene, ClinicError> {
    let folder = path.parent().map_or_else(PathBuf::new, PathBuf::from);
    let copy = folder.join(format!(".trial.{}.toml", std::process::id()));
    write_whole(&copy, &scene.text()?)?;
    let mut trial = SceneArgs {
        scene: Some(copy.clone()),
        ..SceneArgs::default()
    };
    if !folder.join(file::PLAN).is_file() {
        let volume =
            nifti::read(&folder.join(volume(scene)?)).map_err(crate::scene::SceneError::from);
        let middle = volume.map(|v| {
            let [x, y, z] = v.grid.dims;
            v.lps_from_bone.point(v.grid.centre(x / 2, y / 2, z / 2))
        });
        let middle = middle.inspect_err(|_| drop(std::fs::remove_file(&copy)))?;
        trial.recipe.lps_from_plan = Some(Pose::new(glam::DQuat::IDENTITY, middle));
        if args.cartilage.is_some_and(|mm| mm > 0.0) {
            drop(std::fs::remove_file(&copy));
            return Err(ClinicError::Plan(
                "--cartilage needs a joint face: make a plan first ('osteon plan')".to_owned(),
            ));
        }
    }
    let made = load(&trial, progress);
    drop(std::fs::remove_file(&copy));
    Ok(made?)
}

fn lines(scene: &Scene) -> Vec<String> {
    let s = &scene.summary;
    let [x, y, z] = s.dims;
    let mut all = vec![format!(
        "bone: {:.1} cm³ in {x} × {y} × {z} voxels of {:.3} × {:.3} × {:.3} mm",
        s.solid_mm3 / 1000.0,
        s.spacing_mm[0],
        s.spacing_mm[1],
        s.spacing_mm[2]
    )];
    if s.parts.found > 0 {
        all.push(format!(
            "parts: {} found, {:.1} cm³ left out; {} loose fragments of {:.1} mm³ in all",
            s.parts.found,
            s.parts.left_out_mm3 / 1000.0,
            s.parts.fragments,
            s.parts.fragments_mm3
        ));
    }
    if let Some(e) = &s.resample_error {
        all.push(format!(
            "resampled: the surface moves by {:.3} mm rms, {:.3} mm at most",
            e.surface_rms_mm, e.surface_max_mm
        ));
    }
    if s.cartilage_mm3 > 0.0 {
        all.push(format!(
            "cartilage: {:.0} mm³ on the joint face",
            s.cartilage_mm3
        ));
    }
    all
}
