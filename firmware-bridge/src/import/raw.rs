//! What volumes with a header of text have in common: voxels as raw numbers and a place in the patient.

use super::ImportError;
use crate::scene::nifti::{self, Element, Encoding, MAX_VOXELS, NiftiError, Problem, Volume};
use flate2::bufread::{GzDecoder, ZlibDecoder};
use glam::DVec3;
use osteon_sim_core::grid::MAX_DIM;
use std::io::BufRead;
use std::path::Path;

/// A volume's voxels and place.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    /// Voxels along the axes, the fastest first.
    pub(super) dims: [usize; 3],
    /// Step from voxel to voxel along each axis, LPS, mm.
    pub(super) axes: [DVec3; 3],
    /// Centre of the first voxel, LPS, mm.
    pub(super) origin: DVec3,
    pub(super) element: Element,
    pub(super) big_endian: bool,
    pub(super) gzip: bool,
    pub(super) zlib: bool,
    /// Slope and intercept.
    pub(super) scale: Option<(f64, f64)>,
}

/// A finite number.
pub(super) fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// `count` finite numbers.
pub(super) fn numbers(field: &str, text: &str, count: usize) -> Result<Vec<f64>, String> {
    let all: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
    all.filter(|v| v.len() == count)
        .ok_or_else(|| format!("{field}: {text} are not {count} numbers; save the volume again"))
}

/// Whole, possible numbers of voxels.
pub(super) fn dims(sizes: &[f64]) -> Result<[usize; 3], String> {
    let mut dims = [0; 3];
    for (d, &size) in dims.iter_mut().zip(sizes) {
        if size.fract() != 0.0 || !(1.0..=MAX_DIM as f64).contains(&size) {
            return Err(format!(
                "{size} voxels along an axis (allowed: 1 to {MAX_DIM}); crop the volume"
            ));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked to be whole and in 1..=MAX_DIM"
        )]
        let size = size as usize;
        *d = size;
    }
    if dims.iter().product::<usize>() > MAX_VOXELS {
        return Err(format!(
            "{dims:?} voxels are more than {MAX_VOXELS}; crop the volume"
        ));
    }
    Ok(dims)
}

/// The voxels' values, in file order.
pub(super) fn values(stream: &mut dyn BufRead, layout: &Layout) -> Result<Vec<f32>, Problem> {
    let encoding = Encoding {
        element: layout.element,
        big_endian: layout.big_endian,
        scale: layout.scale,
    };
    let count = layout.dims.iter().product();
    if let Some((need, available)) = nifti::memory_shortage(count) {
        return Err(Problem::Memory {
            dims: layout.dims,
            need,
            available,
        });
    }
    if layout.gzip {
        nifti::read_values(&mut GzDecoder::new(stream), &encoding, count)
    } else if layout.zlib {
        nifti::read_values(&mut ZlibDecoder::new(stream), &encoding, count)
    } else {
        nifti::read_values(stream, &encoding, count)
    }
}

/// Values and place as a volume in a right-handed lattice.
pub(super) fn volume(
    layout: &Layout,
    values: Result<Vec<f32>, Problem>,
) -> Result<Volume, Problem> {
    let (grid, lps_from_bone, mirrored) =
        nifti::lattice("the header", layout.dims, layout.axes, layout.origin)?;
    let mut values = values?;
    if mirrored {
        nifti::mirror_rows(&mut values, grid.dims[0]);
    }
    Ok(Volume {
        grid,
        lps_from_bone,
        values,
    })
}

/// A problem with the file's name.
pub(super) fn named(path: &Path, problem: Problem) -> ImportError {
    ImportError::Nifti(NiftiError {
        path: path.to_path_buf(),
        problem,
    })
}
