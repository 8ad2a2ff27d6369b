//! A folder of DICOM slices: which series there are, which of them is meant, its voxels.

mod header;
mod order;
mod pixels;
#[cfg(test)]
mod planted;
mod tags;
#[cfg(test)]
mod tests;
mod upright;
mod write;

use order::Gap;

use super::error::ImportError;
use header::{Image, Opened, Slice};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Most files of one folder.
const MAX_FILES: usize = 100_000;
/// Deepest folder below the given one.
const MAX_DEPTH: usize = 16;

/// One series of a folder.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    /// The first file's header without its slices.
    pub(crate) about: Image,
    /// All slices, in no order.
    pub(crate) slices: Vec<Slice>,
    /// A file of it that cannot be used, and why.
    pub(crate) bad: Option<(PathBuf, String)>,
    // another patient's file in the same series
    second_patient: Option<PathBuf>,
}

/// What a folder holds.
#[derive(Debug, Clone)]
pub(crate) struct Survey {
    /// Its series, by number.
    pub(crate) series: Vec<Series>,
    /// Files that are not DICOM.
    pub(crate) foreign: usize,
    /// DICOM files without an image.
    pub(crate) without_image: usize,
    /// Files in all.
    pub(crate) files: usize,
}

impl Series {
    /// One line about it; no person is named unless it was asked for.
    pub(crate) fn line(&self, number: usize) -> String {
        let a = &self.about;
        let name = a
            .name
            .as_ref()
            .map_or(String::new(), |n| format!(", patient {n}"));
        let of_scanner = a
            .number
            .map_or(String::new(), |n| format!(", scanner's number {n}"));
        let size = self.slices.first().map_or(String::new(), |s| {
            format!(", {}×{}", s.stored.columns, s.stored.rows)
        });
        let description = if a.description.is_empty() {
            "no description"
        } else {
            &a.description
        };
        format!(
            "  {number}: {} {}, {} slice{}{size}{of_scanner}{name}",
            a.modality,
            description,
            self.slices.len(),
            if self.slices.len() == 1 { "" } else { "s" },
        )
    }
}

/// All files below `root`, sorted by name; symbolic links are not followed into folders.
fn files(root: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let read_error = |path: &Path| {
        let path = path.to_path_buf();
        move |error| ImportError::Read { path, error }
    };
    if root.is_file() {
        return Ok(vec![root.to_path_buf()]);
    }
    let mut found = Vec::new();
    let mut folders = vec![(root.to_path_buf(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        for entry in std::fs::read_dir(&folder).map_err(read_error(&folder))? {
            let entry = entry.map_err(read_error(&folder))?;
            let kind = entry.file_type().map_err(read_error(&folder))?;
            if kind.is_dir() && depth < MAX_DEPTH {
                folders.push((entry.path(), depth + 1));
            } else if entry.path().is_file() {
                found.push(entry.path());
            }
        }
        if found.len() > MAX_FILES {
            return Err(ImportError::Input {
                path: root.to_path_buf(),
                problem: format!("more than {MAX_FILES} files; give the folder of one study"),
            });
        }
    }
    found.sort_unstable();
    Ok(found)
}

/// Reads the headers of all files below `root`. Names of persons are kept only if `with_names`.
pub(crate) fn survey(
    root: &Path,
    with_names: bool,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Survey, ImportError> {
    let files = files(root)?;
    let (foreign, without_image) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let mut series: BTreeMap<String, Series> = BTreeMap::new();
    let mut damaged = Vec::new();
    for (n, batch) in files.chunks(64).enumerate() {
        progress("reading headers", (n * 64) as f32 / files.len() as f32);
        let read: Vec<_> = batch
            .par_iter()
            .map(|path| (path, header::read(path, with_names)))
            .collect();
        for (path, result) in read {
            match result {
                Ok(Opened::Foreign) => _ = foreign.fetch_add(1, Ordering::Relaxed),
                Ok(Opened::NoImage) => _ = without_image.fetch_add(1, Ordering::Relaxed),
                Ok(Opened::Image(image)) => add(&mut series, path, *image),
                Err(problem) => damaged.push((path.clone(), problem)),
            }
        }
    }
    let mut series: Vec<Series> = series.into_values().collect();
    series.sort_by_key(|s| s.about.number);
    // a damaged file's series is unknown: it may be any
    if let Some(bad) = damaged.first() {
        for s in &mut series {
            s.bad.get_or_insert_with(|| bad.clone());
        }
        if series.is_empty() {
            return Err(ImportError::Slice {
                path: bad.0.clone(),
                frame: None,
                problem: bad.1.clone(),
            });
        }
    }
    Ok(Survey {
        series,
        foreign: foreign.into_inner(),
        without_image: without_image.into_inner(),
        files: files.len(),
    })
}

fn add(series: &mut BTreeMap<String, Series>, path: &Path, mut image: Image) {
    let slices = std::mem::take(&mut image.slices);
    let entry = series
        .entry(image.series_uid.clone())
        .or_insert_with(|| Series {
            about: image.clone(),
            slices: Vec::new(),
            bad: None,
            second_patient: None,
        });
    if entry.about.patient != image.patient {
        entry
            .second_patient
            .get_or_insert_with(|| path.to_path_buf());
    }
    if let Err(problem) = pixels::check_syntax(&image.syntax) {
        entry
            .bad
            .get_or_insert_with(|| (path.to_path_buf(), problem));
    }
    entry.slices.extend(slices);
}

/// The only series of one patient's that has three or more slices, or the only one at all.
fn the_only_one<'a>(survey: &'a Survey, root: &Path) -> Result<&'a Series, ImportError> {
    let count = survey.series.len();
    let refuse = |problem: String| {
        Err(ImportError::Input {
            path: root.to_path_buf(),
            problem,
        })
    };
    let ids = survey.series.iter().map(|s| s.about.patient.as_str());
    let mut patients: Vec<&str> = ids.collect();
    patients.sort_unstable();
    patients.dedup();
    if patients.len() > 1 {
        return refuse(format!(
            "files of {} patients in one folder; give one patient's folder, or the series by --series 1 to {count} (--list shows them)",
            patients.len()
        ));
    }
    let whole = survey.series.iter().filter(|s| s.slices.len() >= 3);
    match whole.collect::<Vec<_>>().as_slice() {
        [one] => Ok(one),
        // refused with its reason when it is stacked
        [] if count == 1 => Ok(&survey.series[0]),
        _ => refuse(format!(
            "{count} series; choose one by --series 1 to {count} (--list shows them)"
        )),
    }
}

/// The series that is meant: the one asked for (by its number in the list, from 1), or the only one that
/// has three or more slices.
pub(crate) fn choose<'a>(
    survey: &'a Survey,
    asked: Option<usize>,
    root: &Path,
) -> Result<&'a Series, ImportError> {
    let refuse = |problem: String| {
        Err(ImportError::Input {
            path: root.to_path_buf(),
            problem,
        })
    };
    if survey.series.is_empty() {
        return Err(ImportError::NoImage {
            path: root.to_path_buf(),
            files: survey.files,
        });
    }
    let count = survey.series.len();
    let chosen = match asked {
        Some(n) => match n.checked_sub(1).and_then(|n| survey.series.get(n)) {
            Some(series) => series,
            None => {
                return refuse(format!(
                    "--series {n}: there are {count}; give 1 to {count}"
                ));
            }
        },
        None => the_only_one(survey, root)?,
    };
    if let Some(path) = &chosen.second_patient {
        return Err(ImportError::Slice {
            path: path.clone(),
            frame: None,
            problem: "another patient's slice in the same series; give one patient's folder"
                .to_owned(),
        });
    }
    if let Some((path, problem)) = &chosen.bad {
        return Err(ImportError::Slice {
            path: path.clone(),
            frame: None,
            problem: problem.clone(),
        });
    }
    Ok(chosen)
}

pub(super) use write::write;
