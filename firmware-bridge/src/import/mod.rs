//! `osteon import`: a lab's own data into a scene.

mod dicom;
mod error;
mod meta_image;
mod nrrd;
mod output;
mod pictures;
mod raw;
mod summary;
#[cfg(test)]
mod tests;
mod volume;

pub use error::ImportError;
#[cfg(test)]
pub(crate) use nrrd::read as read_nrrd;
pub use output::hash_file;
pub(crate) use output::{Kind, PlaneError, VolumeFile};
pub use summary::Summary;

use crate::progress::Progress;
use crate::scene::file::{self, LabelsEntry, SceneFile, Surface, VolumeEntry};
use output::Draft;
use std::path::{Path, PathBuf};
use volume::{Input, Written};

/// The volume's name in a scene's folder.
const VOLUME: &str = "volume.nii";
/// The label map's name in a scene's folder.
const LABELS: &str = "labels.nii";

/// Options of the import.
#[derive(Debug, Clone, clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent flags of a command line"
)]
#[command(after_help = "\
Read are: a folder of DICOM slices (searched with its folders), a multi-frame DICOM file, NIfTI (.nii,
.nii.gz), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), a folder of 16- or 32-bit PNG or TIFF slices with
--spacing, and text (.txt, .csv, .xyz: x y z density).

A scene is a folder: scene.toml, volume.nii, labels.nii. 'osteon plan DIR' gives it a plan; then 'osteon demo
--scene DIR' and 'osteon haptics --scene DIR' take it.

Names and birth dates of patients are neither stored nor shown; --show-patient shows the name in the list
of series. File names are shown in errors.")]
pub struct ImportArgs {
    /// Folder or file to import
    pub input: PathBuf,
    /// Folder to make for the scene
    #[arg(long, value_name = "DIR", required_unless_present = "list")]
    pub out: Option<PathBuf>,
    /// Put the new scene in the place of one that is there
    #[arg(long)]
    pub replace: bool,
    /// Show the DICOM series and write nothing
    #[arg(long)]
    pub list: bool,
    /// DICOM series to take, as numbered in the list
    #[arg(long, value_name = "N")]
    pub series: Option<usize>,
    /// Fill missing DICOM slices from their neighbours; the scene records them
    #[arg(long)]
    pub accept_gap: bool,
    /// Show patients' names in the list of series
    #[arg(long)]
    pub show_patient: bool,
    /// Label map on the CT's grid, of any of the volume formats
    #[arg(long, value_name = "FILE")]
    pub labels: Option<PathBuf>,
    /// Labels that are bone [default: all]
    #[arg(long, value_name = "N[,N]", value_delimiter = ',', requires = "labels")]
    pub keep: Vec<u8>,
    /// CT number of the bone's surface, HU
    #[arg(
        long,
        value_name = "HU",
        default_value_t = 150.0,
        allow_negative_numbers = true
    )]
    pub threshold: f32,
    /// Spacing of a stack of pictures along x, y, z, mm
    #[arg(
        long,
        value_name = "X,Y,Z",
        value_delimiter = ',',
        num_args = 3,
        allow_negative_numbers = true
    )]
    pub spacing: Option<Vec<f64>>,
    /// CT number of a picture's pixel = pixel · slope + intercept
    #[arg(
        long,
        value_name = "HU",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub slope: f64,
    /// See --slope
    #[arg(
        long,
        value_name = "HU",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub intercept: f64,
    /// Take voxels that are no number (NaN) for air instead of refusing them
    #[arg(long)]
    pub nan_is_air: bool,
    /// Write the summary as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

impl ImportArgs {
    /// `input` into the scene `out`, nothing else asked.
    pub fn of(input: &Path, out: &Path) -> Self {
        Self {
            input: input.to_path_buf(),
            out: Some(out.to_path_buf()),
            replace: false,
            list: false,
            series: None,
            accept_gap: false,
            show_patient: false,
            labels: None,
            keep: Vec::new(),
            threshold: Surface::default().threshold_hu,
            spacing: None,
            slope: 1.0,
            intercept: 0.0,
            nan_is_air: false,
            json: None,
        }
    }
}

/// Imports, telling on stderr what was found.
#[expect(clippy::print_stderr, reason = "what a command-line program says")]
pub fn run(args: &ImportArgs) -> anyhow::Result<()> {
    let mut bar = Progress::new("import");
    let mut say = |line: &str| eprintln!("{line}");
    let done = import(args, &mut say, &mut |stage, share| bar.show(stage, share));
    bar.finish();
    let (Some(summary), Some(out)) = (done?, &args.out) else {
        return Ok(());
    };
    for line in summary.lines(out) {
        eprintln!("{line}");
    }
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&summary)? + "\n";
        std::fs::write(path, text).map_err(|error| ImportError::Write {
            path: path.clone(),
            error,
        })?;
    }
    Ok(())
}

/// Imports without touching the terminal; `None` where only the list was asked for. `say` hears the series
/// where there are several, `progress` a stage's name and the share done, in [0, 1].
pub fn import(
    args: &ImportArgs,
    say: &mut dyn FnMut(&str),
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Option<Summary>, ImportError> {
    let input = volume::open(args, progress)?;
    if let Input::Dicom(survey) = &input
        && (survey.series.len() > 1 || args.list)
    {
        let count = survey.series.len();
        say(&format!("{count} series in {}:", args.input.display()));
        for (n, series) in survey.series.iter().enumerate() {
            say(&series.line(n + 1));
        }
    }
    match &args.out {
        Some(out) if !args.list => write_scene(args, input, out, progress).map(Some),
        _ => Ok(None),
    }
}

/// Writes the scene `out`: all of it or nothing.
fn write_scene(
    args: &ImportArgs,
    input: Input,
    out: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Summary, ImportError> {
    let draft = Draft::begin(out, args.replace)?;
    let written = volume::write(args, input, &draft.path(VOLUME), progress)?;
    let labels = match &args.labels {
        Some(path) => Some(write_labels(args, path, &written, &draft)?),
        None => None,
    };
    let scene = SceneFile {
        format: file::FORMAT,
        volume: Some(VolumeEntry {
            file: VOLUME.to_owned(),
            xxh3: written.xxh3.clone(),
        }),
        phantom: None,
        labels,
        cartilage: None,
        density: None,
        surface: Surface {
            threshold_hu: args.threshold,
            ..Surface::default()
        },
        source: written.summary.source.clone(),
    };
    draft.write(file::NAME, &scene.text()?)?;
    draft.finish()?;
    Ok(written.summary)
}

/// Writes the label map, which must lie on the CT's grid.
fn write_labels(
    args: &ImportArgs,
    path: &Path,
    written: &Written,
    draft: &Draft,
) -> Result<LabelsEntry, ImportError> {
    use crate::scene::labels::{check_same_grid, label_bytes};
    let (labels, _) = volume::read_file(path, &mut |_, _| {})?;
    check_same_grid((&args.input, &written.place), (path, &labels))?;
    let (_, present) = label_bytes(path, &labels)?;
    if let Some(&label) = args.keep.iter().find(|l| !present.contains_key(l)) {
        let names: Vec<String> = present.keys().map(u8::to_string).collect();
        return Err(crate::scene::SceneError::NoSuchLabel {
            path: path.to_path_buf(),
            label,
            present: names.join(", "),
        }
        .into());
    }
    Ok(LabelsEntry {
        file: LABELS.to_owned(),
        xxh3: volume::store(&labels, &draft.path(LABELS), Kind::U8)?,
        keep: args.keep.clone(),
        protect: Vec::new(),
    })
}
