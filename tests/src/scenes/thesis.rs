//! Stand-ins for the five CT scanned objects of the thesis, whose files are not public, and its
//! printed figures about them.
//!
//! Grids and spacings are the thesis's (Table 3.1). How many voxels are active (at least
//! [`ACTIVE_HU`]) is printed nowhere: Figure 3.15 shows it without numbers. It is taken from the
//! sizes of the text files, which hold the listed voxels only: Table 2.2's second row, one work item
//! a line, goes with the sizes (28 to 30 MB a millisecond for all five), so their lines are equally
//! long; and core 2's grid has room for its 1.4 GB only at 39 bytes a line or more
//! ([`LINE_BYTES`]). At 39, core 2's file lists its whole grid, and the other four list what
//! [`Theirs::active`] says, the most that is possible. Core 2 is given the ratio of core 1.
//!
//! The foam and the cores are round: a cylinder as wide as the box's shorter side meets 88 of 100
//! columns of chunks, 1672 of 1900 and 1056 of 1200 chunks, where Table 3.2 has 1669 and 1060.
//! Every stand-in is a function of its seed.

mod figures;
mod generate;
mod noise;
mod phases;
#[cfg(test)]
mod tests;
mod text;

pub use figures::{Chunks, Figures, cubes, figures};
pub use phases::{Phases, phases};
pub use text::{Listed, listed, write_text};

use glam::DVec3;
use osteon_sim_core::grid::Grid;

/// Least density of an active voxel, HU (Alg. 2.6).
pub const ACTIVE_HU: i16 = 120;
/// Bytes of a line of a stand-in's text file.
pub const LINE_BYTES: u64 = 39;

/// Chunks of 32³ over the scapula's rectangular grid, in all and active (Table 3.7, triangle mesh).
pub const SCAPULA_RECT_CHUNKS: (usize, usize) = (448, 99);

/// One of the thesis's objects (Figure 1.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Object {
    /// "Cellular foam", "Cellular foam 1".
    CellularFoam,
    /// "Trabecular bone core 1".
    TrabecularCore1,
    /// "Trabecular bone core 2".
    TrabecularCore2,
    /// "Scapula".
    Scapula,
    /// "Glenoid".
    Glenoid,
}

/// What the thesis prints about an object. Megabytes are millions of bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Theirs {
    /// Voxel size, mm (Table 3.1).
    pub spacing_mm: [f64; 3],
    /// Voxel grid dimensions (Table 3.1).
    pub dims: [usize; 3],
    /// Voxel count (Table 3.1).
    pub voxels: usize,
    /// Memory of the dense grid at 2 B a voxel, MB (Table 3.1).
    pub dense_mb: f64,
    /// Text file on disk, MB (Table 3.1).
    pub text_mb: f64,
    /// Voxel grid dimensions in cubes, up to whole chunks of 32³ (Table 3.2).
    pub chunked_dims: [usize; 3],
    /// Chunk grid (Table 3.2).
    pub chunk_dims: [usize; 3],
    /// Chunks in all (Table 3.2).
    pub chunks: usize,
    /// Chunks with an active voxel (Table 3.2).
    pub active_chunks: usize,
    /// Memory of all chunks at 2 B a voxel, MB (Table 3.2).
    pub chunks_mb: f64,
    /// Memory of the active chunks at 2 B a voxel, MB (Table 3.2).
    pub active_chunks_mb: f64,
    /// Load raw data from the text file; raw data to rectangular grid; that to cubes; those to
    /// chunks; ms (Table 2.2: i5 8600, GTX 1070).
    pub phases_ms: [f64; 4],
    /// Active voxels, derived as the module says, not printed.
    pub active: usize,
}

/// An object's densities in its rectangular grid.
#[derive(Debug, Clone, PartialEq)]
pub struct StandIn {
    /// Dimensions and spacing, mm.
    pub grid: Grid,
    /// CT number, HU; x fastest. Empty space is 0.
    pub density_hu: Vec<i16>,
}

impl Object {
    /// All five, in the order of Table 2.2.
    pub const ALL: [Self; 5] = [
        Self::CellularFoam,
        Self::TrabecularCore1,
        Self::TrabecularCore2,
        Self::Scapula,
        Self::Glenoid,
    ];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::CellularFoam => "cellular foam",
            Self::TrabecularCore1 => "trabecular core 1",
            Self::TrabecularCore2 => "trabecular core 2",
            Self::Scapula => "scapula",
            Self::Glenoid => "glenoid",
        }
    }

    /// The thesis's figures.
    pub fn theirs(self) -> &'static Theirs {
        match self {
            Self::CellularFoam => &CELLULAR_FOAM,
            Self::TrabecularCore1 => &TRABECULAR_CORE_1,
            Self::TrabecularCore2 => &TRABECULAR_CORE_2,
            Self::Scapula => &SCAPULA,
            Self::Glenoid => &GLENOID,
        }
    }

    /// The grid of Table 3.1, mm.
    pub fn grid(self) -> Grid {
        let theirs = self.theirs();
        Grid {
            dims: theirs.dims,
            spacing_mm: DVec3::from_array(theirs.spacing_mm),
        }
    }

    /// Its stand-in; the same for the same seed, on any number of cores.
    pub fn stand_in(self, seed: u64) -> StandIn {
        generate::stand_in(self, seed)
    }
}

impl Theirs {
    /// Active voxels of all voxels.
    pub fn active_ratio(&self) -> f64 {
        self.active as f64 / self.voxels as f64
    }
}

/// Spacing of the two shoulder scans, mm.
const SHOULDER_MM: [f64; 3] = [0.47, 0.47, 1.0];
/// Spacing of the three micro-CT scans, mm.
const MICRO_MM: [f64; 3] = [0.032; 3];

const CELLULAR_FOAM: Theirs = Theirs {
    spacing_mm: MICRO_MM,
    dims: [314, 320, 604],
    voxels: 60_689_920,
    dense_mb: 121.4,
    text_mb: 764.1,
    chunked_dims: [320, 320, 608],
    chunk_dims: [10, 10, 19],
    chunks: 1900,
    active_chunks: 1669,
    chunks_mb: 124.5,
    active_chunks_mb: 109.4,
    phases_ms: [6930.0, 26.0, 175.0, 141.0],
    active: 19_592_308,
};

const TRABECULAR_CORE_1: Theirs = Theirs {
    spacing_mm: MICRO_MM,
    dims: [156, 156, 313],
    voxels: 7_617_168,
    dense_mb: 15.2,
    text_mb: 101.4,
    chunked_dims: [160, 160, 320],
    chunk_dims: [5, 5, 10],
    chunks: 250,
    active_chunks: 250,
    chunks_mb: 16.4,
    active_chunks_mb: 16.4,
    phases_ms: [936.0, 3.5, 23.0, 17.0],
    active: 2_600_000,
};

const TRABECULAR_CORE_2: Theirs = Theirs {
    spacing_mm: MICRO_MM,
    dims: [314, 316, 360],
    voxels: 35_720_640,
    dense_mb: 71.4,
    text_mb: 1400.0,
    chunked_dims: [320, 320, 384],
    chunk_dims: [10, 10, 12],
    chunks: 1200,
    active_chunks: 1060,
    chunks_mb: 78.6,
    active_chunks_mb: 69.5,
    phases_ms: [13_379.0, 51.0, 106.0, 76.0],
    // core 1's ratio
    active: 12_192_676,
};

const SCAPULA: Theirs = Theirs {
    spacing_mm: SHOULDER_MM,
    dims: [256, 234, 201],
    voxels: 12_040_704,
    dense_mb: 24.1,
    text_mb: 34.3,
    chunked_dims: [256, 256, 448],
    chunk_dims: [8, 8, 14],
    chunks: 896,
    active_chunks: 202,
    chunks_mb: 58.7,
    active_chunks_mb: 13.2,
    phases_ms: [295.0, 1.2, 78.0, 62.0],
    active: 879_487,
};

const GLENOID: Theirs = Theirs {
    spacing_mm: SHOULDER_MM,
    dims: [49, 81, 41],
    voxels: 162_729,
    dense_mb: 0.3,
    text_mb: 3.7,
    chunked_dims: [64, 96, 96],
    chunk_dims: [2, 3, 3],
    chunks: 18,
    active_chunks: 18,
    chunks_mb: 1.2,
    active_chunks_mb: 1.2,
    phases_ms: [31.0, 0.13, 0.67, 1.2],
    active: 94_872,
};
