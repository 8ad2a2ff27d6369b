//! Which kind of input it is, and its voxels as the scene's volume.

use super::dicom::{self, Survey};
use super::output::{Kind, PlaneError, VolumeFile};
use super::pictures::{self, Scale};
use super::summary::{Summary, direction, remarks};
use super::{ImportArgs, ImportError, meta_image, nrrd};
use crate::scene::file::Source;
use crate::scene::nifti::{self, Volume};
use crate::scene::text_ct;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// CT number of air, HU.
const AIR_HU: f32 = -1000.0;

/// What was found at the path.
#[derive(Debug)]
pub(super) enum Input {
    /// DICOM files, surveyed.
    Dicom(Survey),
    /// Slices as pictures.
    Pictures(Vec<PathBuf>, Scale),
    /// A volume in one file.
    File,
}

/// A volume that has been written.
#[derive(Debug)]
pub(super) struct Written {
    /// Its place, without its values.
    pub(super) place: Volume,
    /// Hash of the file.
    pub(super) xxh3: String,
    /// What was done.
    pub(super) summary: Summary,
}

/// Finds out what the input is.
pub(super) fn open(
    args: &ImportArgs,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Input, ImportError> {
    let path = &args.input;
    if let Err(error) = std::fs::metadata(path) {
        return Err(ImportError::Read {
            path: path.clone(),
            error,
        });
    }
    if path.is_file() && (known(path) || args.list) && !is_dicom(path) {
        return Ok(Input::File);
    }
    if let (true, Some(scale)) = (path.is_dir(), scale(args)?) {
        let files = pictures::files(path)?;
        if files.is_empty() {
            return Err(ImportError::Input {
                path: path.clone(),
                problem: "no .png or .tif in it, and --spacing is for a stack of pictures; leave it out or give their folder".to_owned(),
            });
        }
        return Ok(Input::Pictures(files, scale));
    }
    if path.is_file() && !is_dicom(path) {
        return Err(ImportError::Input {
            path: path.clone(),
            problem: "is no DICOM file and its name ends in none of .nii, .nii.gz, .nrrd, .nhdr, .mha, .mhd, .txt, .csv, .xyz; rename or convert it".to_owned(),
        });
    }
    let survey = dicom::survey(path, args.show_patient, progress)?;
    if survey.series.is_empty() && path.is_dir() && !pictures::files(path)?.is_empty() {
        return Err(ImportError::Input {
            path: path.clone(),
            problem: "pictures say nothing about their size; give --spacing X,Y,Z in mm (and --slope, --intercept)".to_owned(),
        });
    }
    Ok(Input::Dicom(survey))
}

fn is_dicom(path: &Path) -> bool {
    let mut head = [0; 132];
    std::fs::File::open(path)
        .and_then(|mut f| std::io::Read::read_exact(&mut f, &mut head))
        .is_ok_and(|()| &head[128..] == b"DICM")
}

/// A file's name in lower case.
fn name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase()
}

/// Whether a name in lower case ends so.
fn ends(name: &str, ending: &str) -> bool {
    name.ends_with(ending)
}

fn known(path: &Path) -> bool {
    let name = name(path);
    let endings = [".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd"];
    endings.iter().any(|e| ends(&name, e)) || text_ct::named_like_one(path)
}

/// The scale of pictures, where a spacing is given.
fn scale(args: &ImportArgs) -> Result<Option<Scale>, ImportError> {
    let Some(spacing) = &args.spacing else {
        return Ok(None);
    };
    let refuse = |problem: String| ImportError::Input {
        path: args.input.clone(),
        problem,
    };
    let [x, y, z] = spacing[..] else {
        return Err(refuse(
            "--spacing wants three numbers: X,Y,Z in mm".to_owned(),
        ));
    };
    if let Some(bad) = spacing.iter().find(|v| !(0.01..=20.0).contains(*v)) {
        return Err(refuse(format!(
            "--spacing: {bad} mm is no spacing (allowed: 0.01 to 20)"
        )));
    }
    if !args.slope.is_finite() || args.slope == 0.0 || !args.intercept.is_finite() {
        return Err(refuse(
            "--slope and --intercept must be finite, the slope not 0".to_owned(),
        ));
    }
    Ok(Some(Scale {
        spacing_mm: [x, y, z],
        slope: args.slope,
        intercept: args.intercept,
    }))
}

/// A volume in one file of any known kind, and where it came from.
pub(super) fn read_file(
    path: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<(Volume, (Source, Vec<String>)), ImportError> {
    progress("reading the volume", 0.0);
    let name = name(path);
    let of_kind = |kind: &str| Source {
        kind: kind.to_owned(),
        ..Source::default()
    };
    if ends(&name, ".nrrd") || ends(&name, ".nhdr") {
        let (volume, remarks) = nrrd::read(path)?;
        return Ok((volume, (of_kind("NRRD"), remarks)));
    }
    if ends(&name, ".mha") || ends(&name, ".mhd") {
        let (volume, remarks) = meta_image::read(path)?;
        return Ok((volume, (of_kind("MetaImage"), remarks)));
    }
    if text_ct::named_like_one(path) {
        let mut tell = |done: f32| progress("reading the text", done);
        let rect = text_ct::read(path, text_ct::Options::default(), &mut tell)?;
        let mut source = of_kind("text");
        source.absent_voxels = rect.absent;
        return Ok((rect.into_volume(0), (source, Vec::new())));
    }
    Ok((nifti::read(path)?, (of_kind("NIfTI"), Vec::new())))
}

/// Writes the input's voxels to the NIfTI file `to`.
pub(super) fn write(
    args: &ImportArgs,
    input: Input,
    to: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Written, ImportError> {
    let (volume, (source, said)) = match input {
        Input::Dicom(survey) => return write_dicom(args, &survey, to, progress),
        Input::File => read_file(&args.input, progress)?,
        Input::Pictures(files, scale) => {
            let source = Source {
                kind: "pictures".to_owned(),
                slices: Some(files.len()),
                ..Source::default()
            };
            let remark = "pictures say no orientation: rows were taken to run to the left, columns to the back, slices upwards";
            (
                pictures::read(&files, &scale, progress)?,
                (source, vec![remark.to_owned()]),
            )
        }
    };
    progress("writing the volume", 0.8);
    let (volume, source) = checked(args, volume, source)?;
    let kind = kind_for(&volume.values);
    let xxh3 = store(&volume, to, kind)?;
    let mut all = remarks(&source, None);
    all.extend(said);
    Ok(written(&volume, source, xxh3, all))
}

fn written(volume: &Volume, mut source: Source, xxh3: String, remarks: Vec<String>) -> Written {
    source.dims = volume.grid.dims;
    source.spacing_mm = volume.grid.spacing_mm.to_array();
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| direction(volume.lps_from_bone.vector(a)));
    Written {
        place: Volume {
            grid: volume.grid,
            lps_from_bone: volume.lps_from_bone,
            values: Vec::new(),
        },
        summary: Summary {
            source,
            xxh3: xxh3.clone(),
            axes,
            ignored_files: 0,
            without_image: 0,
            series: 1,
            remarks,
        },
        xxh3,
    }
}

fn write_dicom(
    args: &ImportArgs,
    survey: &Survey,
    to: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Written, ImportError> {
    let series = dicom::choose(survey, args.series, &args.input)?;
    let imported = dicom::write(series, args.accept_gap, (&args.input, to), progress)?;
    let remarks = remarks(&imported.source, series.about.tilt_deg);
    let mut done = written(&imported.place, imported.source, imported.xxh3, remarks);
    done.summary.ignored_files = survey.foreign;
    done.summary.without_image = survey.without_image;
    done.summary.series = survey.series.len();
    Ok(done)
}

/// Refuses, or where asked replaces, what is no number.
fn checked(
    args: &ImportArgs,
    mut volume: Volume,
    mut source: Source,
) -> Result<(Volume, Source), ImportError> {
    let bad = volume.values.iter().filter(|v| !v.is_finite()).count();
    if bad == 0 {
        return Ok((volume, source));
    }
    if !args.nan_is_air {
        return Err(ImportError::Input {
            path: args.input.clone(),
            problem: format!(
                "{bad} voxels are no number (NaN or infinite); mend the volume, or --nan-is-air to take them for air"
            ),
        });
    }
    for v in volume.values.iter_mut().filter(|v| !v.is_finite()) {
        *v = AIR_HU;
    }
    source.non_finite_voxels = bad;
    Ok((volume, source))
}

/// Whole CT numbers in 16 bits where that loses nothing.
fn kind_for(values: &[f32]) -> Kind {
    let fits = |v: &f32| v.fract() == 0.0 && (-32_768.0..=32_767.0).contains(v);
    if values.iter().all(fits) {
        Kind::I16
    } else {
        Kind::F32
    }
}

/// Writes a volume; its hash.
pub(super) fn store(volume: &Volume, to: &Path, kind: Kind) -> Result<String, ImportError> {
    let mut file = VolumeFile::create(to, &volume.grid, &volume.lps_from_bone, kind)?;
    let layer = volume.grid.dims[0] * volume.grid.dims[1];
    for plane in volume.values.chunks(layer) {
        file.plane(plane).map_err(|e| match e {
            PlaneError::Import(e) => e,
            PlaneError::Value(v) => ImportError::Input {
                path: to.to_path_buf(),
                problem: format!("a value of {v} does not fit; report this"),
            },
        })?;
    }
    file.finish()
}
