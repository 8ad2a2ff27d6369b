//! A scene's folder, written whole or not at all: into a hidden folder beside it, then renamed.

use super::error::ImportError;
use glam::DVec3;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// A folder under construction; taken away again unless [`Self::finish`] is called.
#[derive(Debug)]
pub(crate) struct Draft {
    out: PathBuf,
    hidden: PathBuf,
    replace: bool,
    done: bool,
}

fn write_error(path: &Path) -> impl FnOnce(std::io::Error) -> ImportError + '_ {
    move |error| ImportError::Write {
        path: path.to_path_buf(),
        error,
    }
}

impl Draft {
    /// Begins the folder `out`, which must not be there unless `replace` says so.
    pub(crate) fn begin(out: &Path, replace: bool) -> Result<Self, ImportError> {
        let exists = || ImportError::Exists {
            path: out.to_path_buf(),
        };
        if out.exists() && !(replace && out.join(crate::scene::file::NAME).is_file()) {
            // an empty folder may be filled
            let empty = fs::read_dir(out).is_ok_and(|mut d| d.next().is_none());
            if !empty {
                return Err(exists());
            }
        }
        let name = out.file_name().ok_or_else(exists)?.to_string_lossy();
        let parent = match out.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        fs::create_dir_all(parent).map_err(write_error(parent))?;
        let hidden = parent.join(format!(".{name}.{}.part", std::process::id()));
        fs::create_dir(&hidden).map_err(write_error(&hidden))?;
        Ok(Self {
            out: out.to_path_buf(),
            hidden,
            replace,
            done: false,
        })
    }

    /// Where a file of the folder is to be written now.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.hidden.join(name)
    }

    /// Writes a small file.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<(), ImportError> {
        let path = self.path(name);
        let put = || {
            let mut file = File::create(&path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        put().map_err(write_error(&path))
    }

    /// Puts the folder in its place.
    pub(crate) fn finish(mut self) -> Result<(), ImportError> {
        let old = self.hidden.with_extension("old");
        let replaced = self.out.exists();
        if replaced && self.replace {
            fs::rename(&self.out, &old).map_err(write_error(&self.out))?;
        } else if replaced {
            fs::remove_dir(&self.out).map_err(write_error(&self.out))?;
        }
        if let Err(error) = fs::rename(&self.hidden, &self.out) {
            if replaced && self.replace {
                fs::rename(&old, &self.out).map_err(write_error(&old))?;
            }
            return Err(write_error(&self.out)(error));
        }
        self.done = true;
        if replaced && self.replace {
            fs::remove_dir_all(&old).map_err(write_error(&old))?;
        }
        Ok(())
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        if !self.done {
            // nothing is to be done about a folder that cannot be removed
            drop(fs::remove_dir_all(&self.hidden));
        }
    }
}

/// How voxels are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Bytes: labels.
    U8,
    /// Whole CT numbers.
    I16,
    /// Any numbers.
    F32,
}

impl Kind {
    fn code_and_bits(self) -> (i16, i16) {
        match self {
            Self::U8 => (2, 8),
            Self::I16 => (4, 16),
            Self::F32 => (16, 32),
        }
    }
}

/// A NIfTI-1 file that is written plane by plane, with the hash of all its bytes.
pub(crate) struct VolumeFile {
    path: PathBuf,
    file: BufWriter<File>,
    hash: Xxh3,
    kind: Kind,
    bytes: Vec<u8>,
}

/// Why a plane was not written.
#[derive(Debug)]
pub(crate) enum PlaneError {
    /// A value that the file's kind cannot hold.
    Value(f32),
    /// The system refused.
    Import(ImportError),
}

impl VolumeFile {
    /// Begins a file.
    pub(crate) fn create(
        path: &Path,
        grid: &Grid,
        lps_from_bone: &Pose,
        kind: Kind,
    ) -> Result<Self, ImportError> {
        let file = File::create(path).map_err(write_error(path))?;
        let mut volume = Self {
            path: path.to_path_buf(),
            file: BufWriter::with_capacity(1 << 20, file),
            hash: Xxh3::new(),
            kind,
            bytes: header(grid, lps_from_bone, kind),
        };
        volume.flush_bytes()?;
        Ok(volume)
    }

    fn flush_bytes(&mut self) -> Result<(), ImportError> {
        self.hash.update(&self.bytes);
        self.file
            .write_all(&self.bytes)
            .map_err(write_error(&self.path))?;
        self.bytes.clear();
        Ok(())
    }

    /// Adds values, x fastest. Whole kinds take rounded values and refuse what does not fit.
    pub(crate) fn plane(&mut self, values: &[f32]) -> Result<(), PlaneError> {
        for &v in values {
            let whole = v.round();
            let (least, most) = match self.kind {
                Kind::U8 => (0.0, 255.0),
                Kind::I16 => (-32_768.0, 32_767.0),
                Kind::F32 => {
                    self.bytes.extend_from_slice(&v.to_le_bytes());
                    continue;
                }
            };
            if !(least..=most).contains(&whole) {
                return Err(PlaneError::Value(v));
            }
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "checked to fit"
            )]
            if self.kind == Kind::U8 {
                self.bytes.push(whole as u8);
            } else {
                self.bytes.extend_from_slice(&(whole as i16).to_le_bytes());
            }
        }
        self.flush_bytes().map_err(PlaneError::Import)
    }

    /// Ends the file; its hash in hexadecimal.
    pub(crate) fn finish(mut self) -> Result<String, ImportError> {
        let mut end = || {
            self.file.flush()?;
            self.file.get_ref().sync_all()
        };
        end().map_err(write_error(&self.path))?;
        Ok(format!("{:032x}", self.hash.digest128()))
    }
}

/// The NIfTI-1 header with its four bytes of "no extension"; the world is RAS.
fn header(grid: &Grid, lps_from_bone: &Pose, kind: Kind) -> Vec<u8> {
    let mut h = vec![0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| h[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    let [nx, ny, nz] = grid.dims;
    for (n, d) in [3, nx, ny, nz, 1, 1, 1, 1].into_iter().enumerate() {
        let d = i16::try_from(d).unwrap_or(i16::MAX);
        put(40 + 2 * n, &d.to_le_bytes());
    }
    let (code, bits) = kind.code_and_bits();
    put(70, &code.to_le_bytes());
    put(72, &bits.to_le_bytes());
    #[expect(clippy::cast_possible_truncation, reason = "lengths in mm fit an f32")]
    let narrow = |v: f64| (v as f32).to_le_bytes();
    put(76, &narrow(1.0));
    for (n, v) in grid.spacing_mm.to_array().into_iter().enumerate() {
        put(80 + 4 * n, &narrow(v));
    }
    put(108, &narrow(352.0));
    put(112, &narrow(1.0));
    // millimetres
    put(123, &[2]);
    // sform: scanner's coordinates
    put(254, &1_i16.to_le_bytes());
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let columns: [DVec3; 4] = core::array::from_fn(|n| match axes.get(n) {
        Some(&axis) => lps_from_bone.vector(axis) * grid.spacing_mm[n],
        None => lps_from_bone.translation,
    });
    for row in 0..3 {
        // LPS to RAS: x and y change sign
        let sign = if row < 2 { -1.0 } else { 1.0 };
        for (n, column) in columns.iter().enumerate() {
            put(280 + 16 * row + 4 * n, &narrow(sign * column[row]));
        }
    }
    put(344, b"n+1\0");
    h
}

/// The hash of a file's bytes in hexadecimal.
pub fn hash_file(path: &Path) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let mut hash = Xxh3::new();
    let mut block = vec![0; 1 << 20];
    loop {
        let got = std::io::Read::read(&mut file, &mut block)?;
        if got == 0 {
            return Ok(format!("{:032x}", hash.digest128()));
        }
        hash.update(&block[..got]);
    }
}
