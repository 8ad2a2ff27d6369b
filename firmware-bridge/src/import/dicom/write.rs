//! A stack's voxels, decoded on all cores a few slices at a time and written plane by plane: memory does
//! not grow with the series.

use super::Series;
use super::header::Slice;
use super::order::{Stack, stack};
use super::pixels;
use super::upright::{Frame, OUTSIDE_HU};
use crate::import::error::ImportError;
use crate::import::output::{Kind, PlaneError, VolumeFile};
use crate::scene::file::{Gap, Source};
use crate::scene::nifti::Volume;
use glam::{DMat3, DQuat, DVec3};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use rayon::prelude::*;
use std::path::Path;

/// Slices decoded at a time.
const BATCH: usize = 16;

/// A volume that has been written.
#[derive(Debug, Clone)]
pub(crate) struct Imported {
    /// Its place, without its values.
    pub(crate) place: Volume,
    /// Hash of the file.
    pub xxh3: String,
    /// Where it came from, for the scene's file.
    pub(crate) source: Source,
}

/// One plane of CT numbers and how many of its pixels were padding.
type Plane = (Vec<f32>, usize);

/// Decodes the series into the NIfTI file `to`.
pub(crate) fn write(
    series: &Series,
    accept_gap: bool,
    (root, to): (&Path, &Path),
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Imported, ImportError> {
    let stack = stack(series.slices.clone(), accept_gap, root)?;
    let whole = |v: f64| v.fract() == 0.0;
    let whole = stack
        .slices
        .iter()
        .all(|s| whole(s.slope) && whole(s.intercept));
    let mut kind = if whole { Kind::I16 } else { Kind::F32 };
    loop {
        match attempt(&stack, kind, to, progress) {
            // CT numbers beyond 16 bits: once more with room
            Err(PlaneError::Value(_)) if kind == Kind::I16 => kind = Kind::F32,
            Err(PlaneError::Value(v)) => {
                return Err(ImportError::Input {
                    path: root.to_path_buf(),
                    problem: format!("a CT number of {v}; export the series again"),
                });
            }
            Err(PlaneError::Import(e)) => return Err(e),
            Ok((place, xxh3, padding)) => {
                return Ok(Imported {
                    xxh3,
                    source: source(series, &stack, padding),
                    place,
                });
            }
        }
    }
}

fn source(series: &Series, stack: &Stack, padding: usize) -> Source {
    let gap = |g: &super::Gap| Gap {
        first: g.first,
        missing: g.missing,
    };
    Source {
        kind: "DICOM".to_owned(),
        modality: Some(series.about.modality.clone()),
        scanner: Some(series.about.scanner.clone()),
        protocol: Some(series.about.protocol.clone()),
        slices: Some(stack.slices.len()),
        tilt_deg: stack.tilted().then(|| stack.tilt_deg()),
        uneven_mm: Some(stack.uneven_mm),
        padding_voxels: padding,
        lossy: pixels::lossy(&series.about.syntax).map(str::to_owned),
        gaps: stack.gaps.iter().map(gap).collect(),
        ..Source::default()
    }
}

/// Lattice of the upright stack and its place in the patient.
fn lattice(stack: &Stack, frame: &Frame) -> Option<(Grid, Pose)> {
    let first = &stack.slices[0];
    let [px, py] = first.pixel_mm;
    let [nx, ny] = frame.dims;
    let grid = Grid::new([nx, ny, stack.planes], DVec3::new(px, py, stack.spacing_mm)).ok()?;
    let axes = DMat3::from_cols(first.along_row, first.down_column, first.normal());
    let origin = first.origin
        - first.along_row * (frame.before[0] as f64 * px)
        - first.down_column * (frame.before[1] as f64 * py);
    Some((grid, Pose::new(DQuat::from_mat3(&axes).normalize(), origin)))
}

fn attempt(
    stack: &Stack,
    kind: Kind,
    to: &Path,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<(Volume, String, usize), PlaneError> {
    let frame = Frame::around(stack);
    let (grid, pose) = lattice(stack, &frame).ok_or_else(|| {
        PlaneError::Import(ImportError::Input {
            path: stack.slices[0].path.to_path_buf(),
            problem: "more than 4096 pixels or slices along an axis; crop the series".to_owned(),
        })
    })?;
    let mut file = VolumeFile::create(to, &grid, &pose, kind).map_err(PlaneError::Import)?;
    let (mut padding, mut last): (usize, Option<(usize, Vec<f32>)>) = (0, None);
    let numbered: Vec<(usize, &Slice)> = stack.places.iter().copied().zip(&stack.slices).collect();
    let one_file = stack.slices.iter().all(|s| s.path == stack.slices[0].path);
    let shared = one_file.then(|| pixels::open(&stack.slices[0].path));
    for batch in numbered.chunks(BATCH) {
        progress("decoding slices", batch[0].0 as f32 / stack.planes as f32);
        for (place, plane) in planes(batch, &frame, shared.as_ref())? {
            padding += plane.1;
            if let Some((before, values)) = &last {
                fill_gap((*before, values), (place, &plane.0), &mut file)?;
            }
            file.plane(&plane.0)?;
            last = Some((place, plane.0));
        }
    }
    let xxh3 = file.finish().map_err(PlaneError::Import)?;
    let place = Volume {
        grid,
        lps_from_bone: pose,
        values: Vec::new(),
    };
    Ok((place, xxh3, padding))
}

/// Decodes some slices on all cores. `shared` is the file that holds them all, where one does.
fn planes(
    batch: &[(usize, &Slice)],
    frame: &Frame,
    shared: Option<&Result<pixels::Opened, String>>,
) -> Result<Vec<(usize, Plane)>, PlaneError> {
    let decode = |&(place, slice): &(usize, &Slice)| {
        let own = shared.is_none().then(|| pixels::open(&slice.path));
        let stored = match shared.or(own.as_ref()) {
            Some(Ok(opened)) => opened.frame(slice.frame, &slice.stored),
            Some(Err(e)) => Err(e.clone()),
            None => Err("is not open".to_owned()),
        };
        let stored = stored.map_err(|problem| {
            let (path, frame) = slice.place();
            ImportError::Slice {
                path,
                frame,
                problem,
            }
        })?;
        let (hu, padding) = ct_numbers(slice, &stored);
        let hu = match frame.shift(place) {
            Some(shift) => shift.apply(&hu),
            None => hu,
        };
        Ok((place, (hu, padding)))
    };
    batch
        .par_iter()
        .map(decode)
        .collect::<Result<_, ImportError>>()
        .map_err(PlaneError::Import)
}

/// CT numbers of a slice; padding becomes air and is counted.
pub(super) fn ct_numbers(slice: &Slice, stored: &[i32]) -> Plane {
    let mut padding = 0;
    let hu = stored
        .iter()
        .map(|&v| {
            let v = i64::from(v);
            if slice.padding.is_some_and(|(lo, hi)| (lo..=hi).contains(&v)) {
                padding += 1;
                return OUTSIDE_HU;
            }
            #[expect(clippy::cast_possible_truncation, reason = "CT numbers fit an f32")]
            let hu = (v as f64 * slice.slope + slice.intercept) as f32;
            hu
        })
        .collect();
    (hu, padding)
}

/// Planes between two that are there, linearly between them.
fn fill_gap(
    (before, a): (usize, &[f32]),
    (after, b): (usize, &[f32]),
    file: &mut VolumeFile,
) -> Result<(), PlaneError> {
    let steps = after - before;
    for n in 1..steps {
        let t = n as f32 / steps as f32;
        let between: Vec<f32> = a.iter().zip(b).map(|(a, b)| a + t * (b - a)).collect();
        file.plane(&between)?;
    }
    Ok(())
}
