//! NRRD volumes (`.nrrd`, `.nhdr` with its data file), as 3D Slicer and ITK write them.
//!
//! Format: "Definition of NRRD File Format" (teem). Raw and gzip encodings, three axes.

use super::ImportError;
use super::raw::{self, Layout, number, numbers};
use crate::scene::nifti::{Element, Volume};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

/// Longest header, bytes.
const MAX_HEADER: usize = 1 << 20;

/// Reads a volume and remarks about it.
pub(crate) fn read(path: &Path) -> Result<(Volume, Vec<String>), ImportError> {
    let io = |error| ImportError::Read {
        path: path.to_path_buf(),
        error,
    };
    let refuse = |problem: String| ImportError::Input {
        path: path.to_path_buf(),
        problem,
    };
    let mut file = BufReader::new(File::open(path).map_err(io)?);
    let (mut fields, mut length, mut line) = (BTreeMap::new(), 0, Vec::new());
    loop {
        line.clear();
        length += file.read_until(b'\n', &mut line).map_err(io)?;
        let text = String::from_utf8_lossy(&line).trim().to_owned();
        if text.is_empty() || length > MAX_HEADER {
            break;
        }
        if fields.is_empty() && !text.starts_with("NRRD000") {
            return Err(refuse(
                "does not begin with NRRD000: no NRRD file".to_owned(),
            ));
        }
        if let Some((key, value)) = text.split_once(": ") {
            fields.insert(key.trim().to_lowercase(), value.trim().to_owned());
        } else {
            fields.insert(text, String::new());
        }
    }
    let header = Header { fields };
    let (layout, remarks) = header.layout().map_err(refuse)?;
    let detached = header.get("data file").or(header.get("datafile"));
    let values = match detached {
        None => raw::values(&mut file, &layout),
        Some(name) => {
            let data = path.parent().unwrap_or(Path::new(".")).join(name);
            let mut file =
                BufReader::new(File::open(&data).map_err(|error| ImportError::Read {
                    path: data.clone(),
                    error,
                })?);
            raw::values(&mut file, &layout)
        }
    };
    let volume = raw::volume(&layout, values).map_err(|p| raw::named(path, p))?;
    Ok((volume, remarks))
}

struct Header {
    fields: BTreeMap<String, String>,
}

impl Header {
    fn get(&self, key: &str) -> Option<&str> {
        self.fields.get(key).map(String::as_str)
    }

    fn need(&self, key: &str) -> Result<&str, String> {
        self.get(key)
            .ok_or_else(|| format!("field `{key}` is missing; save the volume again"))
    }

    fn layout(&self) -> Result<(Layout, Vec<String>), String> {
        let dimension = self.need("dimension")?;
        if dimension != "3" {
            return Err(format!(
                "dimension: {dimension}; one scalar volume of 3 axes is read"
            ));
        }
        let sizes = numbers("sizes", self.need("sizes")?, 3)?;
        let kind = self.need("type")?;
        let element = element(kind)
            .ok_or_else(|| format!("type: {kind} is not read; save as int16 or float"))?;
        let encoding = self.need("encoding")?.to_lowercase();
        let gzip = match encoding.as_str() {
            "raw" => false,
            "gzip" | "gz" => true,
            other => {
                return Err(format!(
                    "encoding: {other} is not read; save as raw or gzip"
                ));
            }
        };
        for key in ["byte skip", "byteskip", "line skip", "lineskip"] {
            if self.get(key).is_some_and(|v| v != "0") {
                return Err(format!("{key} is not read; save the volume as one .nrrd"));
            }
        }
        let mut remarks = Vec::new();
        let (axes, origin) = self.places(&mut remarks)?;
        let layout = Layout {
            dims: raw::dims(&sizes)?,
            axes,
            origin,
            element,
            big_endian: self.get("endian") == Some("big"),
            gzip,
            zlib: false,
            scale: None,
        };
        Ok((layout, remarks))
    }

    /// Axis vectors and origin in LPS, mm.
    fn places(&self, remarks: &mut Vec<String>) -> Result<([DVec3; 3], DVec3), String> {
        let Some(directions) = self.get("space directions") else {
            let spacings = numbers("spacings", self.need("spacings")?, 3)?;
            if let Some(bad) = spacings.iter().find(|v| **v <= 0.0) {
                return Err(format!(
                    "spacings: {bad} mm is no spacing; save the volume with its spacing"
                ));
            }
            remarks.push(
                "no orientation in the file: its axes were taken for left, posterior, superior"
                    .to_owned(),
            );
            let axes = [
                DVec3::X * spacings[0],
                DVec3::Y * spacings[1],
                DVec3::Z * spacings[2],
            ];
            return Ok((axes, DVec3::ZERO));
        };
        let to_lps = signs(self.need("space")?)?;
        let vectors = vectors(directions);
        let vectors: [DVec3; 3] = vectors
            .as_deref()
            .and_then(|v| v.try_into().ok())
            .ok_or_else(|| {
                format!(
                    "space directions: {directions} are not three vectors; save the volume again"
                )
            })?;
        let origin = match self.get("space origin") {
            None => DVec3::ZERO,
            Some(text) => match vectors_of_one(text) {
                Some(v) => v,
                None => {
                    return Err(format!(
                        "space origin: {text} is no vector; save the volume again"
                    ));
                }
            },
        };
        Ok((vectors.map(|v| v * to_lps), origin * to_lps))
    }
}

fn vectors_of_one(text: &str) -> Option<DVec3> {
    match vectors(text)?.as_slice() {
        [one] => Some(*one),
        _ => None,
    }
}

/// "(1,0,0) (0,1,0)" as vectors.
fn vectors(text: &str) -> Option<Vec<DVec3>> {
    let mut all = Vec::new();
    for part in text.split('(').skip(1) {
        let inner = part.split(')').next()?;
        let parts: Vec<f64> = inner.split(',').map(number).collect::<Option<_>>()?;
        let [x, y, z] = parts[..] else { return None };
        all.push(DVec3::new(x, y, z));
    }
    Some(all)
}

/// What turns the named space into LPS.
fn signs(space: &str) -> Result<DVec3, String> {
    match space.to_lowercase().as_str() {
        "left-posterior-superior" | "lps" => Ok(DVec3::ONE),
        "right-anterior-superior" | "ras" => Ok(DVec3::new(-1.0, -1.0, 1.0)),
        "left-anterior-superior" | "las" => Ok(DVec3::new(1.0, -1.0, 1.0)),
        other => Err(format!("space: {other} is not read; save in LPS or RAS")),
    }
}

fn element(kind: &str) -> Option<Element> {
    Some(match kind {
        "signed char" | "int8" | "int8_t" => Element::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Element::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            Element::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Element::U16,
        "int" | "signed int" | "int32" | "int32_t" => Element::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Element::U32,
        "float" => Element::F32,
        "double" => Element::F64,
        _ => return None,
    })
}
