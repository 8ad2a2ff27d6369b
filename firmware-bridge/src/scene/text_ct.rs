//! Reader of a CT as text: position and density, one voxel a line, in any order.
//!
//! `x y z density`, separated by blanks, commas or semicolons; `#` begins a comment line, the first
//! line may be a header. Positions are mm in the patient's DICOM LPS frame (the plan's), densities
//! CT numbers. A voxel that no line names is empty: such files hold what the scanner saw as bone,
//! not its air.
//!
//! The file is read twice in blocks on all cores, so that memory holds the grid and never the text:
//! [`TextCt::survey`] finds the lattice, [`TextCt::fill`] puts the densities into it.

mod blocks;
#[cfg(test)]
mod bone_tests;
mod fill;
mod lattice;
mod line;
mod survey;
#[cfg(test)]
mod tests;

pub use line::Fault;
pub use survey::Survey;

use super::memory;
use super::nifti::Volume;
use blocks::Text;
use glam::{DQuat, DVec3};
use osteon_sim_core::grid::{Grid, MAX_DIM};
use osteon_sim_core::pose::Pose;
use rayon::prelude::*;
use std::io;
use std::path::{Path, PathBuf};

/// Density of a voxel that the file leaves out: the thesis's "empty", and water among CT numbers,
/// which is what surrounds bone.
pub const EMPTY_HU: i16 = 0;
/// Most voxels of one grid.
pub const MAX_VOXELS: usize = 1 << 31;
/// How a file is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Bytes that one job takes at a time; the result does not depend on it.
    pub block_bytes: usize,
    /// Memory that the grid may take, bytes; `None` = what the system has available.
    pub memory_bytes: Option<u64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            block_bytes: 1 << 20,
            memory_bytes: None,
        }
    }
}

/// An open text CT.
#[derive(Debug)]
pub struct TextCt {
    path: PathBuf,
    text: Text,
    memory_bytes: Option<u64>,
}

/// A text CT in its rectangular grid.
#[derive(Debug, Clone, PartialEq)]
pub struct RectGrid {
    /// Dimensions and spacing, mm.
    pub grid: Grid,
    /// Centre of voxel (0, 0, 0), mm, in the file's frame (DICOM LPS).
    pub origin_mm: DVec3,
    /// CT numbers, x fastest; [`EMPTY_HU`] where the file has no voxel.
    pub density_hu: Vec<i16>,
    /// Voxels of the grid that the file leaves out.
    pub absent: usize,
}

/// Why a text CT could not be read: one line with file, line and remedy.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct TextCtError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What is wrong with a text CT. Lines count from 1.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// It cannot be opened or read.
    #[error("cannot be read ({0}); check the path and its permissions")]
    Io(#[from] io::Error),
    /// A folder, a pipe or a device.
    #[error("is no regular file; give a text CT or a NIfTI volume")]
    NotAFile,
    /// A line that is no voxel.
    #[error("line {line}: {fault}")]
    Line {
        /// The line.
        line: u64,
        /// What is wrong with it.
        fault: Fault,
    },
    /// No voxel at all.
    #[error("holds no voxel; give lines of `x y z density`")]
    Empty,
    /// All voxels lie in one plane.
    #[error("every voxel has {axis} = {value}: no spacing can be told; give two planes or more")]
    Flat {
        /// The axis.
        axis: char,
        /// Its only value, mm.
        value: f64,
    },
    /// So many positions that they are no lattice.
    #[error(
        "line {line}: {axis} has taken {count} values by here, a lattice has at most {MAX_DIM}; give voxels on a grid along the axes"
    )]
    Scattered {
        /// The axis.
        axis: char,
        /// Where the count was passed.
        line: u64,
        /// Different values found.
        count: usize,
    },
    /// A position between the lattice's planes.
    #[error(
        "line {line}: {axis} = {value} lies {off:.2} of a voxel off the planes that the others form every {spacing} mm; correct the line or resample the file to one spacing"
    )]
    Irregular {
        /// The axis.
        axis: char,
        /// The first line with that position.
        line: u64,
        /// The position, mm.
        value: f64,
        /// Spacing of the other planes, mm.
        spacing: f64,
        /// Distance to the nearest plane, voxels.
        off: f64,
    },
    /// A spacing that is absurd.
    #[error(
        "{axis} goes in steps of {spacing} mm (allowed: 0.01 to 20); give the positions in millimetres"
    )]
    Spacing {
        /// The axis.
        axis: char,
        /// The step, mm.
        spacing: f64,
    },
    /// An axis that is too long.
    #[error(
        "{axis} runs from {low} (line {low_line}) to {high} (line {high_line}): {count} voxels of {spacing} mm, at most {MAX_DIM}; remove a stray line or crop the file"
    )]
    Long {
        /// The axis.
        axis: char,
        /// Lowest position, mm.
        low: f64,
        /// Its first line.
        low_line: u64,
        /// Highest position, mm.
        high: f64,
        /// Its first line.
        high_line: u64,
        /// Voxels between them.
        count: u64,
        /// Spacing, mm.
        spacing: f64,
    },
    /// More voxels than are possible.
    #[error("a grid of {dims:?} has {} voxels, at most {MAX_VOXELS}; crop the file", dims.iter().product::<usize>())]
    Voxels {
        /// Voxels along x, y, z.
        dims: [usize; 3],
    },
    /// More memory than there is.
    #[error(
        "a grid of {dims:?} needs {} MB of memory, {} MB are available; crop the file or close other programs",
        need.div_ceil(1_000_000), available / 1_000_000
    )]
    Memory {
        /// Voxels along x, y, z.
        dims: [usize; 3],
        /// Bytes needed.
        need: u64,
        /// Bytes available.
        available: u64,
    },
    /// The same voxel twice.
    #[error(
        "line {line}: the voxel at ({x}, {y}, {z}) is already on line {first}; remove one of them"
    )]
    Duplicate {
        /// The later line.
        line: u64,
        /// The earlier one.
        first: u64,
        /// Position, mm.
        x: f64,
        /// Position, mm.
        y: f64,
        /// Position, mm.
        z: f64,
    },
    /// Other lines at the second reading than at the first.
    #[error("changed while it was read; wait until it is complete and try again")]
    Changed,
}

impl TextCt {
    /// Opens the file and passes over its comments and header.
    pub fn open(path: &Path, options: Options) -> Result<Self, TextCtError> {
        let text = Text::open(path, options.block_bytes).map_err(|problem| TextCtError {
            path: path.to_path_buf(),
            problem,
        })?;
        Ok(Self {
            path: path.to_path_buf(),
            text,
            memory_bytes: options.memory_bytes,
        })
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.text.bytes()
    }

    /// First reading: checks every line and finds the lattice. `progress` hears the fraction done.
    pub fn survey(&self, progress: &mut dyn FnMut(f32)) -> Result<Survey, TextCtError> {
        survey::survey(&self.text, progress).map_err(|problem| self.error(problem))
    }

    /// Second reading: the densities in the grid of `survey`, which is refused before any of it is
    /// allocated if it does not fit into memory.
    pub fn fill(
        &self,
        survey: &Survey,
        progress: &mut dyn FnMut(f32),
    ) -> Result<RectGrid, TextCtError> {
        check_size(survey.dims(), self.memory_bytes)
            .and_then(|()| fill::fill(&self.text, survey, progress))
            .map_err(|problem| self.error(problem))
    }

    fn error(&self, problem: Problem) -> TextCtError {
        TextCtError {
            path: self.path.clone(),
            problem,
        }
    }
}

/// Refuses a grid that is too large for this program or for the memory.
fn check_size(dims: [usize; 3], available: Option<u64>) -> Result<(), Problem> {
    let voxels: usize = dims.iter().product();
    if voxels > MAX_VOXELS {
        return Err(Problem::Voxels { dims });
    }
    match memory::shortage(voxels, available) {
        Some((need, available)) => Err(Problem::Memory {
            dims,
            need,
            available,
        }),
        None => Ok(()),
    }
}

/// Reads the whole file. `progress` hears the fraction done.
pub fn read(
    path: &Path,
    options: Options,
    progress: &mut dyn FnMut(f32),
) -> Result<RectGrid, TextCtError> {
    let text = TextCt::open(path, options)?;
    let survey = text.survey(&mut |done| progress(0.5 * done))?;
    text.fill(&survey, &mut |done| progress(0.5 + 0.5 * done))
}

impl RectGrid {
    /// The same as a volume whose axes are those of the patient, with `margin` empty voxels on each
    /// side (fewer where an axis would become too long): a file of bone voxels only ends where the
    /// bone does, and a surface needs an outside.
    pub fn into_volume(self, margin: usize) -> Volume {
        let [nx, ny, nz] = self.grid.dims;
        let pad = self.grid.dims.map(|n| margin.min((MAX_DIM - n) / 2));
        let dims: [usize; 3] = core::array::from_fn(|a| self.grid.dims[a] + 2 * pad[a]);
        let mut values = vec![f32::from(EMPTY_HU); dims.iter().product()];
        let inner = |at: usize, axis: usize, n: usize| at.checked_sub(pad[axis]).filter(|&v| v < n);
        values
            .par_chunks_mut(dims[0])
            .enumerate()
            .for_each(|(row, line)| {
                let (j, k) = (inner(row % dims[1], 1, ny), inner(row / dims[1], 2, nz));
                let (Some(j), Some(k)) = (j, k) else {
                    return;
                };
                let from = &self.density_hu[(k * ny + j) * nx..][..nx];
                for (v, &hu) in line[pad[0]..].iter_mut().zip(from) {
                    *v = f32::from(hu);
                }
            });
        let corner = DVec3::from_array(pad.map(|n| n as f64)) * self.grid.spacing_mm;
        Volume {
            grid: Grid { dims, ..self.grid },
            lps_from_bone: Pose::new(DQuat::IDENTITY, self.origin_mm - corner),
            values,
        }
    }
}

/// Whether the name is one of a text CT's: `.txt`, `.csv` or `.xyz`.
pub fn named_like_one(path: &Path) -> bool {
    path.extension().is_some_and(|extension| {
        ["txt", "csv", "xyz"]
            .iter()
            .any(|name| extension.eq_ignore_ascii_case(name))
    })
}
