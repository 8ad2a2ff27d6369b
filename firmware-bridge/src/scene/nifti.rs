//! Reader of NIfTI-1 and NIfTI-2 volumes, plain or gzipped, either byte order.
//!
//! NIfTI's world is RAS; ours is DICOM LPS, and the change is made here and nowhere else. Format:
//! `nifti1.h` and `nifti2.h` of the NIfTI Data Format Working Group.

mod header;
#[cfg(test)]
pub(crate) mod tests;

use super::memory;
use flate2::bufread::MultiGzDecoder;
use glam::{DMat3, DQuat, DVec3};
use header::Header;
pub(crate) use header::{Element, Encoding};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Read};
use std::path::{Path, PathBuf};

/// Most voxels of one file.
pub const MAX_VOXELS: usize = 1 << 31;
/// Largest cosine between two lattice axes that is taken for a right angle.
pub const MAX_SHEAR: f64 = 1e-3;
// bytes converted at a time; a multiple of every element's size
const BLOCK: usize = 1 << 20;

/// A scalar volume in a right-handed lattice.
#[derive(Debug, Clone)]
pub struct Volume {
    /// Dimensions and spacing, mm.
    pub grid: Grid,
    /// Lattice axes (origin at the centre of voxel (0, 0, 0)) to DICOM LPS, mm.
    pub lps_from_bone: Pose,
    /// Values with slope and intercept applied, x fastest. May hold non-finite values where the
    /// file does.
    pub values: Vec<f32>,
}

/// Why a volume could not be read: one line with file, field and remedy.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct NiftiError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}

/// What is wrong with a NIfTI file.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// It cannot be opened or read.
    #[error("cannot be read ({0}); check the path and its permissions")]
    Io(io::Error),
    /// The gzip stream is damaged.
    #[error("the gzip stream is damaged ({0}); copy or download the file again")]
    Gzip(io::Error),
    /// It ends too early.
    #[error(
        "truncated: {expected} bytes of {part} expected, {got} there; copy or export the file again"
    )]
    Truncated {
        /// Header or voxels.
        part: &'static str,
        /// Bytes that the header promises.
        expected: u64,
        /// Bytes that there are.
        got: u64,
    },
    /// Another kind of file.
    #[error(
        "not a NIfTI file (sizeof_hdr or magic is wrong); give a .nii or .nii.gz, e.g. by `dcm2niix -z y`"
    )]
    NotNifti,
    /// The voxels are in another file.
    #[error(
        "magic `ni1`: a header whose voxels are in a separate .img; convert the pair to one .nii"
    )]
    Pair,
    /// A dimension is absurd.
    #[error("{field} = {value}: {allowed}; export one 3-D volume")]
    Dimension {
        /// Header field.
        field: String,
        /// What it says.
        value: i64,
        /// What would do.
        allowed: &'static str,
    },
    /// Values that are no scalar numbers, or of an unusual kind.
    #[error(
        "datatype = {code} ({name}) is not read; export as 8, 16 or 32-bit integer or 32 or 64-bit float"
    )]
    Datatype {
        /// NIfTI code.
        code: i64,
        /// Its name.
        name: &'static str,
    },
    /// A spacing that is zero, negative, not a number or absurd.
    #[error(
        "{field} = {value} mm is no voxel spacing (allowed: 0.01 to 20); export again with the spacing set"
    )]
    Spacing {
        /// Header field.
        field: String,
        /// Its value, mm.
        value: f64,
    },
    /// The voxel offset is impossible.
    #[error("vox_offset = {0} is outside the file's possible range; export the file again")]
    Offset(f64),
    /// The lattice axes are not at right angles.
    #[error(
        "{form}: lattice axes {axes} are sheared (cosine {cosine:.4}, allowed {MAX_SHEAR}); resample to an orthogonal grid (a tilted gantry does this)"
    )]
    Sheared {
        /// sform or qform.
        form: &'static str,
        /// The two axes.
        axes: &'static str,
        /// Cosine of their angle.
        cosine: f64,
    },
    /// The affine holds something that is no number, or is singular.
    #[error("{0} is not a finite, invertible affine; export the file again")]
    Affine(&'static str),
    /// Not enough memory.
    #[error(
        "{dims:?} voxels need {} MB of memory, {} MB are available; crop the volume or close other programs",
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
    /// The system would not give the memory.
    #[error("{0} voxels do not fit into memory; crop the volume")]
    Allocation(usize),
}

/// Reads a `.nii` or `.nii.gz` (told apart by content, not by name).
pub fn read(path: &Path) -> Result<Volume, NiftiError> {
    read_problem(path).map_err(|problem| NiftiError {
        path: path.to_path_buf(),
        problem,
    })
}

fn read_problem(path: &Path) -> Result<Volume, Problem> {
    let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(Problem::Io)?);
    let gzipped = file
        .fill_buf()
        .map_err(Problem::Io)?
        .starts_with(&[0x1f, 0x8b]);
    if gzipped {
        read_stream(&mut MultiGzDecoder::new(file))
    } else {
        read_stream(&mut file)
    }
}

fn read_stream(stream: &mut dyn Read) -> Result<Volume, Problem> {
    let header = Header::read(stream)?;
    let (grid, lps_from_bone, mirrored) = lattice_of(&header)?;
    if let Some((need, available)) = memory::shortage(grid.len(), None) {
        return Err(Problem::Memory {
            dims: grid.dims,
            need,
            available,
        });
    }
    let mut values = read_values(stream, &header.encoding, grid.len())?;
    if mirrored {
        mirror_rows(&mut values, grid.dims[0]);
    }
    Ok(Volume {
        grid,
        lps_from_bone,
        values,
    })
}

/// Fills `buffer` as far as the stream goes; the count of bytes read.
fn read_up_to<R: Read + ?Sized>(stream: &mut R, buffer: &mut [u8]) -> Result<usize, Problem> {
    let mut got = 0;
    while got < buffer.len() {
        match stream.read(&mut buffer[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) => match e.kind() {
                io::ErrorKind::Interrupted => {}
                // a gzip stream that stops short
                io::ErrorKind::UnexpectedEof => break,
                io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => {
                    return Err(Problem::Gzip(e));
                }
                _ => return Err(Problem::Io(e)),
            },
        }
    }
    Ok(got)
}

/// Bytes that so many voxels need and that there are, where the latter are too few.
pub(crate) fn memory_shortage(voxels: usize) -> Option<(u64, u64)> {
    memory::shortage(voxels, None)
}

/// Turns every row round.
pub(crate) fn mirror_rows(values: &mut [f32], length: usize) {
    for row in values.chunks_exact_mut(length) {
        row.reverse();
    }
}

/// `count` voxels, in blocks: memory grows with what is really there, not with what is promised.
pub(crate) fn read_values<R: Read + ?Sized>(
    stream: &mut R,
    encoding: &Encoding,
    count: usize,
) -> Result<Vec<f32>, Problem> {
    let size = encoding.element.size();
    let expected = (count * size) as u64;
    let mut values: Vec<f32> = Vec::new();
    let mut block = vec![0; BLOCK.min(count * size)];
    let mut left = count * size;
    while left > 0 {
        let want = left.min(BLOCK);
        let got = read_up_to(stream, &mut block[..want])?;
        if got < want {
            let got = expected - (left - got) as u64;
            return Err(Problem::Truncated {
                part: "voxels",
                expected,
                got,
            });
        }
        if values.capacity() - values.len() < want / size {
            let more = (count - values.len()).min(values.len().max(BLOCK));
            values
                .try_reserve_exact(more)
                .map_err(|_too_much| Problem::Allocation(count))?;
        }
        encoding.convert(&block[..want], &mut values);
        left -= want;
    }
    Ok(values)
}

/// The lattice of a header.
fn lattice_of(header: &Header) -> Result<(Grid, Pose, bool), Problem> {
    let form = header.form();
    let ras = header.ras_affine();
    if ras.iter().flatten().any(|v| !v.is_finite()) {
        return Err(Problem::Affine(form));
    }
    // RAS to LPS: x and y change sign
    let lps_of = |column: usize| DVec3::new(-ras[0][column], -ras[1][column], ras[2][column]);
    let axes = [lps_of(0), lps_of(1), lps_of(2)];
    lattice(form, header.dims, axes, lps_of(3))
}

/// Grid, frame, and whether rows must be mirrored to make the lattice right-handed, from the steps from
/// voxel to voxel and the first voxel's centre (LPS, mm). `form` names the source in an error.
pub(crate) fn lattice(
    form: &'static str,
    dims: [usize; 3],
    mut axes: [DVec3; 3],
    mut origin: DVec3,
) -> Result<(Grid, Pose, bool), Problem> {
    for (a, axis) in axes.iter().enumerate() {
        let value = axis.length();
        if !(0.01..=20.0).contains(&value) {
            let field = format!("length of {form} column {a}");
            return Err(Problem::Spacing { field, value });
        }
    }
    let spacing = DVec3::new(axes[0].length(), axes[1].length(), axes[2].length());
    for (a, b, name) in [(0, 1, "i and j"), (0, 2, "i and k"), (1, 2, "j and k")] {
        let cosine = axes[a].dot(axes[b]) / (spacing[a] * spacing[b]);
        if cosine.abs() > MAX_SHEAR {
            return Err(Problem::Sheared {
                form,
                axes: name,
                cosine,
            });
        }
    }
    let mirrored = axes[0].cross(axes[1]).dot(axes[2]) < 0.0;
    if mirrored {
        origin += axes[0] * (dims[0] - 1) as f64;
        axes[0] = -axes[0];
    }
    let grid = Grid::new(dims, spacing).map_err(|_spacing| Problem::Affine(form))?;
    let rotation = rotation(axes).ok_or(Problem::Affine(form))?;
    Ok((grid, Pose::new(rotation, origin), mirrored))
}

/// The rotation nearest in order x, y, z to three almost orthogonal axes.
fn rotation(axes: [DVec3; 3]) -> Option<DQuat> {
    let x = axes[0].try_normalize()?;
    let y = axes[1].reject_from_normalized(x).try_normalize()?;
    Some(DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize())
}
