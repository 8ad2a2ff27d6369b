//! A folder of pictures, one a slice: PNG or TIFF of 16 or 32 bits, spacing given.
//!
//! A picture says nothing about where it is: the first in the order of names is the lowest, rows run to the
//! patient's left, columns to the back (LPS), and the first pixel is the origin.

use super::ImportError;
use crate::scene::nifti::{self, Problem, Volume};
use glam::DVec3;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use tiff::decoder::DecodingResult;

/// How pictures become CT numbers, and where they lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    /// Distance of voxels along x, y, z, mm.
    pub(super) spacing_mm: [f64; 3],
    /// CT number = pixel · slope + intercept.
    pub(super) slope: f64,
    /// HU.
    pub(super) intercept: f64,
}

/// The pictures of a folder in the order of the numbers in their names; empty where there are none.
pub(super) fn files(dir: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let io = |error| ImportError::Read {
        path: dir.to_path_buf(),
        error,
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let extension = path
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or_default()
            .to_lowercase();
        if matches!(extension.as_str(), "png" | "tif" | "tiff") {
            found.push(path);
        }
    }
    found.sort_by_cached_key(|path| {
        natural(&path.file_name().unwrap_or_default().to_string_lossy())
    });
    Ok(found)
}

/// A name with its numbers padded, so that slice 10 follows slice 9.
fn natural(name: &str) -> String {
    let (mut out, mut digits) = (String::new(), String::new());
    for c in name.chars().chain([' ']) {
        if c.is_ascii_digit() {
            digits.push(c);
            continue;
        }
        if !digits.is_empty() {
            let padding = 20_usize.saturating_sub(digits.len());
            out.extend(std::iter::repeat_n('0', padding));
            out.push_str(&digits);
            digits.clear();
        }
        out.push(c);
    }
    out
}

/// Reads the stack.
pub(super) fn read(
    files: &[PathBuf],
    scale: &Scale,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<Volume, ImportError> {
    let at = |path: &Path, problem: String| ImportError::Slice {
        path: path.to_path_buf(),
        frame: None,
        problem,
    };
    let mut size = None;
    let mut values: Vec<f32> = Vec::new();
    for (n, path) in files.iter().enumerate() {
        progress("reading pictures", n as f32 / files.len() as f32);
        let tiff = path
            .extension()
            .is_some_and(|e| !e.eq_ignore_ascii_case("png"));
        let (dims, pixels) = if tiff {
            read_tiff(path)
        } else {
            read_png(path)
        }
        .map_err(|problem| at(path, problem))?;
        if *size.get_or_insert(dims) != dims {
            return Err(at(
                path,
                format!(
                    "{dims:?} pixels, but {size:?} in the first picture; give one stack a folder"
                ),
            ));
        }
        values.extend(pixels.into_iter().map(|v| {
            #[expect(clippy::cast_possible_truncation, reason = "CT numbers fit an f32")]
            let hu = (v * scale.slope + scale.intercept) as f32;
            hu
        }));
    }
    let [x, y] = size.unwrap_or([1, 1]);
    let [hx, hy, hz] = scale.spacing_mm;
    let axes = [DVec3::X * hx, DVec3::Y * hy, DVec3::Z * hz];
    let named = |problem: Problem| super::raw::named(&files[0], problem);
    let (grid, lps_from_bone, _) =
        nifti::lattice("--spacing", [x, y, files.len()], axes, DVec3::ZERO).map_err(named)?;
    Ok(Volume {
        grid,
        lps_from_bone,
        values,
    })
}

type Picture = ([usize; 2], Vec<f64>);

const EIGHT: &str = "8-bit pixels cannot hold CT numbers; export 16 bits";
const COLOUR: &str = "colour pixels hold no CT numbers; export grey, 16 bits";

fn read_png(path: &Path) -> Result<Picture, String> {
    let damaged = |e: png::DecodingError| format!("a damaged PNG ({e}); export it again");
    let file = File::open(path).map_err(|e| format!("cannot be read ({e})"))?;
    let mut reader = png::Decoder::new(BufReader::new(file))
        .read_info()
        .map_err(damaged)?;
    let info = reader.info();
    match (info.color_type, info.bit_depth) {
        (png::ColorType::Grayscale, png::BitDepth::Sixteen) => {}
        (png::ColorType::Grayscale, _) => return Err(EIGHT.to_owned()),
        _ => return Err(COLOUR.to_owned()),
    }
    let dims = [info.width as usize, info.height as usize];
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("too large a picture")?];
    reader.next_frame(&mut bytes).map_err(damaged)?;
    let (words, _) = bytes.as_chunks::<2>();
    let pixels = words.iter().map(|w| f64::from(u16::from_be_bytes(*w)));
    Ok((dims, pixels.take(dims[0] * dims[1]).collect()))
}

fn read_tiff(path: &Path) -> Result<Picture, String> {
    let damaged = |e: tiff::TiffError| format!("a damaged or unusual TIFF ({e}); export it again");
    let file = File::open(path).map_err(|e| format!("cannot be read ({e})"))?;
    let mut decoder = tiff::decoder::Decoder::new(BufReader::new(file)).map_err(damaged)?;
    if !matches!(
        decoder.colortype().map_err(damaged)?,
        tiff::ColorType::Gray(_)
    ) {
        return Err(COLOUR.to_owned());
    }
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    let pixels: Vec<f64> = match decoder.read_image().map_err(damaged)? {
        DecodingResult::U16(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::I16(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::U32(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::I32(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::F32(v) => v.into_iter().map(f64::from).collect(),
        DecodingResult::U8(_) | DecodingResult::I8(_) => return Err(EIGHT.to_owned()),
        _ => {
            return Err(
                "64-bit or half-float pixels are not read; export 16 or 32 bits".to_owned(),
            );
        }
    };
    if decoder.more_images() {
        return Err("more than one picture in the file; export one file a slice".to_owned());
    }
    Ok(([width as usize, height as usize], pixels))
}
