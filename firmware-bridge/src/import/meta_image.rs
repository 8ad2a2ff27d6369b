//! `MetaImage` volumes (`.mha`, `.mhd` with its data file), as ITK and elastix write them.
//!
//! Format: `MetaIO`, in ITK's documentation. World is LPS; raw or zlib-compressed, three axes.

use super::ImportError;
use super::raw::{self, Layout, numbers};
use crate::scene::nifti::{Element, Volume};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

/// Longest header, bytes.
const MAX_HEADER: usize = 1 << 20;

/// Reads a volume and remarks about it.
pub(super) fn read(path: &Path) -> Result<(Volume, Vec<String>), ImportError> {
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
    let data = loop {
        line.clear();
        let got = file.read_until(b'\n', &mut line).map_err(io)?;
        length += got;
        if got == 0 || length > MAX_HEADER {
            return Err(refuse(
                "has no ElementDataFile: no MetaImage header".to_owned(),
            ));
        }
        let text = String::from_utf8_lossy(&line);
        let Some((key, value)) = text.split_once('=') else {
            return Err(refuse(format!(
                "line `{}` is no `key = value`: no MetaImage header",
                text.trim().chars().take(40).collect::<String>()
            )));
        };
        let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
        if key == "ElementDataFile" {
            break value;
        }
        fields.insert(key, value);
    };
    let header = Header { fields };
    let (layout, remarks) = header.layout().map_err(refuse)?;
    let values = if data.eq_ignore_ascii_case("LOCAL") {
        raw::values(&mut file, &layout)
    } else if data.starts_with("LIST") || data.contains('%') {
        return Err(refuse(format!(
            "ElementDataFile = {data}: one file a slice is not read; save as one .mha"
        )));
    } else {
        let data = path.parent().unwrap_or(Path::new(".")).join(data);
        let mut file = BufReader::new(File::open(&data).map_err(|error| ImportError::Read {
            path: data.clone(),
            error,
        })?);
        raw::values(&mut file, &layout)
    };
    let volume = raw::volume(&layout, values).map_err(|p| raw::named(path, p))?;
    Ok((volume, remarks))
}

struct Header {
    fields: BTreeMap<String, String>,
}

impl Header {
    fn get(&self, keys: &[&str]) -> Option<&str> {
        keys.iter()
            .find_map(|k| self.fields.get(*k))
            .map(String::as_str)
    }

    fn need(&self, key: &str) -> Result<&str, String> {
        self.get(&[key])
            .ok_or_else(|| format!("{key} is missing; save the volume again"))
    }

    fn says(&self, keys: &[&str]) -> bool {
        self.get(keys)
            .is_some_and(|v| v.eq_ignore_ascii_case("true"))
    }

    fn layout(&self) -> Result<(Layout, Vec<String>), String> {
        if self.need("NDims")? != "3" {
            return Err(format!(
                "NDims = {}; one volume of 3 axes is read",
                self.need("NDims")?
            ));
        }
        if self
            .get(&["ElementNumberOfChannels"])
            .is_some_and(|v| v != "1")
        {
            return Err("ElementNumberOfChannels is not 1: colours hold no CT numbers; save one scalar volume".to_owned());
        }
        let kind = self.need("ElementType")?;
        let element = element(kind).ok_or_else(|| {
            format!("ElementType = {kind} is not read; save as MET_SHORT or MET_FLOAT")
        })?;
        let spacing = self
            .get(&["ElementSpacing", "ElementSize"])
            .ok_or("ElementSpacing is missing; save the volume with its spacing")?;
        let spacing = numbers("ElementSpacing", spacing, 3)?;
        if let Some(bad) = spacing.iter().find(|v| **v <= 0.0) {
            return Err(format!(
                "ElementSpacing = {bad} mm is no spacing; save the volume with its spacing"
            ));
        }
        let mut remarks = Vec::new();
        let matrix = if let Some(text) = self.get(&["TransformMatrix", "Rotation", "Orientation"]) {
            numbers("TransformMatrix", text, 9)?
        } else {
            remarks.push(
                "no orientation in the file: its axes were taken for left, posterior, superior"
                    .to_owned(),
            );
            vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        };
        let origin = match self.get(&["Offset", "Origin", "Position"]) {
            Some(text) => DVec3::from_slice(&numbers("Offset", text, 3)?),
            None => DVec3::ZERO,
        };
        let sizes = numbers("DimSize", self.need("DimSize")?, 3)?;
        let layout = Layout {
            dims: raw::dims(&sizes)?,
            axes: core::array::from_fn(|n| DVec3::from_slice(&matrix[3 * n..]) * spacing[n]),
            origin,
            element,
            big_endian: self.says(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]),
            gzip: false,
            zlib: self.says(&["CompressedData"]),
            scale: None,
        };
        Ok((layout, remarks))
    }
}

fn element(kind: &str) -> Option<Element> {
    Some(match kind {
        "MET_CHAR" => Element::I8,
        "MET_UCHAR" => Element::U8,
        "MET_SHORT" => Element::I16,
        "MET_USHORT" => Element::U16,
        "MET_INT" => Element::I32,
        "MET_UINT" => Element::U32,
        "MET_FLOAT" => Element::F32,
        "MET_DOUBLE" => Element::F64,
        _ => return None,
    })
}
