//! A scene on disk: a folder with `scene.toml`, its volumes and, once there is one, its plan.
//!
//! The volumes are as imported; how a bone is made of them (threshold, labels, voxel size, …) is a recipe
//! in the file, applied at every load, so that no step of preparation adds its own rounding. Each volume's
//! hash is checked at load.

use super::recipe::{Calibration, Cartilage, Part, Recipe};
use super::{SceneArgs, SceneError, plan};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The file's name in its folder.
pub const NAME: &str = "scene.toml";
/// The plan's name in its folder.
pub const PLAN: &str = "plan.json";
/// What this program writes and reads.
pub const FORMAT: u32 = 1;
/// Longest file, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// [`FORMAT`].
    pub format: u32,
    /// The CT; absent in a scene of the built-in phantom.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<VolumeEntry>,
    /// The built-in phantom instead of a CT.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phantom: Option<Phantom>,
    /// The label map on the CT's grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelsEntry>,
    /// How the bone's surface is found.
    #[serde(default)]
    pub surface: Surface,
    /// Cartilage on the joint face.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cartilage: Option<Cartilage>,
    /// What CT numbers mean on this scanner; absent: as the feel says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<Calibration>,
    /// Where the volume came from.
    #[serde(default)]
    pub source: Source,
}

/// The built-in phantom, and what is wrong with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Phantom {
    /// Seed of its texture.
    pub seed: u64,
    /// Edge of its voxels, mm.
    pub voxel_mm: f64,
    /// Posterior erosion: how far the eroded half of the face looks backwards, degrees; 0: none.
    pub erosion_deg: f64,
    /// Depth of the erosion in its middle, mm.
    pub erosion_mm: f64,
    /// Density of plate and cancellous bone over the normal one.
    pub density: f64,
}

impl Default for Phantom {
    fn default() -> Self {
        Self {
            seed: 1,
            voxel_mm: super::phantom::VOXEL_MM,
            erosion_deg: 0.0,
            erosion_mm: 0.0,
            density: 1.0,
        }
    }
}

impl Phantom {
    fn check(&self, path: &Path) -> Result<(), SceneError> {
        let sensible = (0.0..=35.0).contains(&self.erosion_deg)
            && (0.0..=8.0).contains(&self.erosion_mm)
            && (0.1..=2.0).contains(&self.density);
        if sensible {
            return Ok(());
        }
        Err(SceneError::File {
            path: path.to_path_buf(),
            problem: format!(
                "phantom: erosion of {}° and {} mm, density {} (allowed: 0 to 35°, 0 to 8 mm, 0.1 to 2)",
                self.erosion_deg, self.erosion_mm, self.density
            ),
        })
    }
}

/// A volume's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VolumeEntry {
    /// Name in the folder.
    pub file: String,
    /// XXH3-128 of its bytes, hexadecimal.
    pub xxh3: String,
}

/// The label map.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelsEntry {
    /// Name in the folder.
    pub file: String,
    /// XXH3-128 of its bytes, hexadecimal.
    pub xxh3: String,
    /// Labels that are bone; none: all.
    #[serde(default)]
    pub keep: Vec<u8>,
    /// Labels that are bone, but not to be cut.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub protect: Vec<u8>,
}

/// How the bone's surface is found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// CT number of the surface, HU.
    pub threshold_hu: f32,
    /// Edge of the voxels, mm; absent: the CT's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxel_mm: Option<f64>,
    /// Which parts above the threshold are the bone.
    #[serde(default)]
    pub part: Part,
    /// Parts smaller than this are loose fragments and left out, mm³.
    #[serde(default)]
    pub fragments_mm3: f64,
    /// Corners of the box to keep, LPS, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop_mm: Option<[[f64; 3]; 2]>,
}

impl Default for Surface {
    fn default() -> Self {
        Self {
            threshold_hu: 150.0,
            voxel_mm: None,
            part: Part::All,
            fragments_mm3: 0.0,
            crop_mm: None,
        }
    }
}

/// Where a volume came from; nothing about a person.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Source {
    /// DICOM, NIfTI, …
    pub kind: String,
    /// CT, MR, …
    #[serde(skip_serializing_if = "Option::is_none")]
    pub modality: Option<String>,
    /// Maker and model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scanner: Option<String>,
    /// Kernel and voltage.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<String>,
    /// Slices read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slices: Option<usize>,
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Voxel spacing, mm.
    pub spacing_mm: [f64; 3],
    /// Tilt that was resampled away, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<f64>,
    /// Largest distance of a slice from its plane, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uneven_mm: Option<f64>,
    /// Pixels that were padding (now air).
    pub padding_voxels: usize,
    /// Voxels that were no number (now air).
    pub non_finite_voxels: usize,
    /// Voxels that a text leaves out (now empty).
    pub absent_voxels: usize,
    /// The compression that lost something.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lossy: Option<String>,
    /// Missing slices, filled linearly from their neighbours.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gaps: Vec<Gap>,
}

/// Missing slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gap {
    /// The first missing plane, from 0.
    pub first: usize,
    /// How many.
    pub missing: usize,
}

/// Scenes that are built in: name, file, plan.
const BUILT_IN: [(&str, &str, &str); 3] = [
    (
        "normal",
        include_str!("../../scenarios/normal/scene.toml"),
        include_str!("../../scenarios/normal/plan.json"),
    ),
    (
        "eroded",
        include_str!("../../scenarios/eroded/scene.toml"),
        include_str!("../../scenarios/eroded/plan.json"),
    ),
    (
        "soft",
        include_str!("../../scenarios/soft/scene.toml"),
        include_str!("../../scenarios/soft/plan.json"),
    ),
];

/// `dir/scene.toml`, or `dir` itself where it is the file.
pub fn path_in(dir: &Path) -> PathBuf {
    if dir.is_dir() {
        dir.join(NAME)
    } else {
        dir.to_path_buf()
    }
}

/// A built-in scene by its name, where nothing of that name is on disk: its file and plan.
pub fn built_in(dir: &Path) -> Option<(&'static str, &'static str)> {
    let named = BUILT_IN.iter().find(|(name, ..)| Path::new(name) == dir);
    named
        .filter(|_| !dir.exists())
        .map(|&(_, file, plan)| (file, plan))
}

/// Reads a scene's file.
pub fn read(dir: &Path) -> Result<SceneFile, SceneError> {
    let path = path_in(dir);
    if let Some((text, _)) = built_in(dir) {
        return parse(&path, text);
    }
    let refuse = |problem: String| SceneError::File {
        path: path.clone(),
        problem,
    };
    let length = std::fs::metadata(&path)
        .map_err(|e| {
            refuse(format!(
                "cannot be read ({e}); make a scene with 'osteon import', or take normal, eroded or soft"
            ))
        })?
        .len();
    if length > MAX_BYTES {
        return Err(refuse(format!(
            "{length} bytes are no scene; give its folder"
        )));
    }
    let text = std::fs::read_to_string(&path)
        .map_err(|e| refuse(format!("cannot be read ({e}); check the file")))?;
    parse(&path, &text)
}

fn parse(path: &Path, text: &str) -> Result<SceneFile, SceneError> {
    let refuse = |problem: String| SceneError::File {
        path: path.to_path_buf(),
        problem,
    };
    let file: SceneFile = toml::from_str(text).map_err(|e| {
        let line = e
            .span()
            .map_or(1, |s| text[..s.start].lines().count().max(1));
        refuse(format!(
            "line {line}: {}; correct it",
            e.message().replace('\n', " ")
        ))
    })?;
    if file.format != FORMAT {
        return Err(refuse(format!(
            "format {}: this program reads {FORMAT}; import again",
            file.format
        )));
    }
    if file.volume.is_some() == file.phantom.is_some() {
        return Err(refuse(
            "needs either [volume] or [phantom]; import again".to_owned(),
        ));
    }
    Ok(file)
}

impl SceneFile {
    /// The file's text.
    pub fn text(&self) -> Result<String, SceneError> {
        let body = toml::to_string(self).map_err(|e| SceneError::File {
            path: NAME.into(),
            problem: format!("cannot be written as TOML ({e}); report this"),
        })?;
        Ok(format!(
            "# A scene of osteon: LPS, mm, HU. Volumes are as imported; the rest is a recipe.\n{body}"
        ))
    }
}

/// Refuses a volume that is not the one the scene was made with.
pub fn check_hash(path: &Path, expected: &str) -> Result<(), SceneError> {
    let refuse = |problem: String| SceneError::File {
        path: path.to_path_buf(),
        problem,
    };
    let found = crate::import::hash_file(path)
        .map_err(|e| refuse(format!("cannot be read ({e}); import again")))?;
    if found != expected {
        return Err(refuse(format!(
            "its bytes have changed (xxh3 {found}, the scene says {expected}); import again"
        )));
    }
    Ok(())
}

/// What `args` with `--scene dir` stand for: the scene's volumes, checked, and its recipe; a plan or voxel
/// size that `args` have goes before the scene's own.
pub(super) fn resolved(dir: &Path, args: &SceneArgs) -> Result<SceneArgs, SceneError> {
    let file = read(dir)?;
    if let Some(phantom) = file.phantom {
        return phantom_args(dir, args, phantom);
    }
    let folder = path_in(dir)
        .parent()
        .map_or_else(PathBuf::new, Path::to_path_buf);
    let checked = |name: &str, xxh3: &str| {
        let path = inside(&folder, name)?;
        check_hash(&path, xxh3)?;
        Ok::<_, SceneError>(path)
    };
    let bone = match &file.volume {
        Some(entry) => Some(checked(&entry.file, &entry.xxh3)?),
        None => None,
    };
    let labels = match &file.labels {
        Some(entry) => Some(checked(&entry.file, &entry.xxh3)?),
        None => None,
    };
    let pose = args.pose.clone().unwrap_or_else(|| folder.join(PLAN));
    let given = args.recipe.lps_from_plan;
    if given.is_none() && !pose.is_file() {
        return Err(SceneError::File {
            path: pose,
            problem: "the scene has no plan yet; make one with 'osteon plan', or give --pose FILE"
                .to_owned(),
        });
    }
    let (keep, protect) = file
        .labels
        .map_or_else(Default::default, |l| (l.keep, l.protect));
    let recipe = Recipe {
        lps_from_plan: given,
        part: file.surface.part,
        fragments_mm3: file.surface.fragments_mm3,
        crop_mm: file.surface.crop_mm,
        protect,
        cartilage: file.cartilage.filter(|_| given.is_none()),
        density: file.density,
        phantom: None,
        wall_mm: if given.is_none() {
            plan::wall_mm(&pose)?
        } else {
            0.0
        },
    };
    recipe.check(&path_in(dir))?;
    Ok(SceneArgs {
        scene: None,
        bone,
        keep,
        labels,
        pose: Some(pose),
        threshold: file.surface.threshold_hu,
        voxel_mm: args.voxel_mm.or(file.surface.voxel_mm),
        seed: args.seed,
        recipe,
    })
}

/// The options of a phantom's scene. A built-in one's plan is in the program.
fn phantom_args(dir: &Path, args: &SceneArgs, phantom: Phantom) -> Result<SceneArgs, SceneError> {
    let path = path_in(dir);
    phantom.check(&path)?;
    let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
    let mut recipe = Recipe {
        lps_from_plan: args.recipe.lps_from_plan,
        phantom: Some(phantom),
        ..Recipe::default()
    };
    let in_scene = folder.join(PLAN);
    let mut pose = args.pose.clone();
    match built_in(dir) {
        Some((_, text)) if pose.is_none() && recipe.lps_from_plan.is_none() => {
            recipe.lps_from_plan = Some(plan::parse(&path, text)?);
        }
        None if pose.is_none() && in_scene.is_file() => pose = Some(in_scene),
        _ => {}
    }
    Ok(SceneArgs {
        scene: None,
        pose,
        voxel_mm: args.voxel_mm.or(Some(phantom.voxel_mm)),
        seed: phantom.seed,
        recipe,
        ..SceneArgs::default()
    })
}

/// A file of the scene's own folder; a path that leads elsewhere is refused.
fn inside(folder: &Path, name: &str) -> Result<PathBuf, SceneError> {
    let plain = Path::new(name).file_name().is_some_and(|n| n == name);
    if !plain {
        return Err(SceneError::File {
            path: folder.join(NAME),
            problem: format!(
                "file = \"{name}\": only a name in the scene's own folder will do; correct it"
            ),
        });
    }
    Ok(folder.join(name))
}
