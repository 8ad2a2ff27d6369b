//! What a DICOM file says about its slices: the attributes that make a volume. A person's name is read
//! only where it was asked for.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of a header are checked, or saturate"
)]

use super::tags;
use dicom_core::Tag;
use dicom_core::header::HasLength as _;
use dicom_object::file::ReadPreamble;
use dicom_object::{DefaultDicomObject, FileMetaTableBuilder, InMemDicomObject, OpenFileOptions};
use dicom_transfer_syntax_registry::entries;
use glam::DVec3;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How pixels are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stored {
    /// Pixels down a column.
    pub(crate) rows: usize,
    /// Pixels along a row.
    pub(crate) columns: usize,
    /// 16 or 32.
    pub(crate) bits_allocated: u16,
    /// At most `bits_allocated`.
    pub(crate) bits_stored: u16,
    /// The stored bits' highest, counted from 0.
    pub(crate) high_bit: u16,
    /// Two's complement.
    pub(crate) signed: bool,
}

/// Place and scale of one slice.
#[derive(Debug, Clone)]
pub(crate) struct Slice {
    /// Its file.
    pub(crate) path: Arc<Path>,
    /// Its frame in the file, from 0.
    pub(crate) frame: u32,
    /// True where the file has more than one frame.
    pub(crate) of_many: bool,
    /// How its pixels are stored.
    pub(crate) stored: Stored,
    /// Centre of its first pixel, LPS, mm.
    pub(crate) origin: DVec3,
    /// Unit vector along a row (column number grows).
    pub(crate) along_row: DVec3,
    /// Unit vector down a column (row number grows).
    pub(crate) down_column: DVec3,
    /// Distance of pixels along a row and down a column, mm.
    pub(crate) pixel_mm: [f64; 2],
    /// CT number = stored · slope + intercept.
    pub(crate) slope: f64,
    /// HU.
    pub(crate) intercept: f64,
    /// Stored values that mean "no pixel here", inclusive.
    pub(crate) padding: Option<(i64, i64)>,
    /// Time point of a series in time.
    pub(crate) time_point: Option<String>,
}

/// What a file's slices have in common.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    /// Series instance UID.
    pub(crate) series_uid: String,
    /// Series number, as the scanner counts.
    pub(crate) number: Option<i64>,
    /// The scanner's words for the series.
    pub(crate) description: String,
    /// CT, MR, …
    pub(crate) modality: String,
    /// Scanner's maker and model.
    pub(crate) scanner: String,
    /// Reconstruction kernel and tube voltage, as far as said.
    pub(crate) protocol: String,
    /// Tilt of the gantry as the header says it, degrees.
    pub(crate) tilt_deg: Option<f64>,
    /// Patient's identity, for comparison only.
    pub(crate) patient: String,
    /// Patient's name, where it was asked for.
    pub(crate) name: Option<String>,
    /// Transfer syntax UID.
    pub(crate) syntax: String,
    /// The slices.
    pub(crate) slices: Vec<Slice>,
}

/// What a file turned out to be.
#[derive(Debug)]
pub(crate) enum Opened {
    /// Another kind of file.
    Foreign,
    /// DICOM, but no image (a report, a directory, …).
    NoImage,
    /// An image.
    Image(Box<Image>),
}

/// Opens a file, up to the pixels or as a whole; `None` where it is no DICOM file. The error is a
/// reason without the file's name.
pub(crate) fn open(path: &Path, whole: bool) -> Result<Option<DefaultDicomObject>, String> {
    let mut head = [0; 132];
    let mut file = File::open(path).map_err(|e| format!("cannot be read ({e})"))?;
    let mut got = 0;
    while got < head.len() {
        match file.read(&mut head[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) => return Err(format!("cannot be read ({e})")),
        }
    }
    if got == head.len() && &head[128..] == b"DICM" {
        let options = OpenFileOptions::new().read_preamble(ReadPreamble::Always);
        let options = if whole {
            options
        } else {
            options.read_until(tags::PIXEL_DATA)
        };
        return options.open_file(path).map(Some).map_err(|e| reason(&e));
    }
    without_meta(path, &head[..got])
}

/// A bare data set, as very old files and some network tools write them: tags of group 0008 from the
/// first byte on.
fn without_meta(path: &Path, head: &[u8]) -> Result<Option<DefaultDicomObject>, String> {
    let bare = head.len() == 132 && head[..2] == [8, 0] && head[3] == 0;
    if !bare {
        return Ok(None);
    }
    let explicit = head[4..6].iter().all(u8::is_ascii_uppercase);
    let syntax = if explicit {
        entries::EXPLICIT_VR_LITTLE_ENDIAN
    } else {
        entries::IMPLICIT_VR_LITTLE_ENDIAN
    }
    .erased();
    let file = File::open(path).map_err(|e| format!("cannot be read ({e})"))?;
    let Ok(object) = InMemDicomObject::read_dataset_with_ts(BufReader::new(file), &syntax) else {
        return Ok(None);
    };
    let text = |tag| text(&object, tag).unwrap_or_else(|| "1.2.840.10008.5.1.4.1.1.2".to_owned());
    let meta = FileMetaTableBuilder::new()
        .transfer_syntax(syntax.uid())
        .media_storage_sop_class_uid(text(tags::SOP_CLASS))
        .media_storage_sop_instance_uid(text(tags::SOP_INSTANCE));
    object.with_meta(meta).map(Some).map_err(|e| reason(&e))
}

/// An error and its causes in one line.
pub(crate) fn reason(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let cause_text = cause.to_string();
        if !text.contains(&cause_text) {
            text = format!("{text}: {cause_text}");
        }
        next = cause.source();
    }
    text.replace(['\n', '\r'], " ")
}

/// Reads a file's header. The error is a reason without the file's name.
pub(crate) fn read(path: &Path, with_name: bool) -> Result<Opened, String> {
    let Some(object) = open(path, false)
        .map_err(|e| format!("a damaged DICOM file ({e}); copy it again or remove it"))?
    else {
        return Ok(Opened::Foreign);
    };
    if object.get(tags::ROWS).is_none() || object.get(tags::COLUMNS).is_none() {
        return Ok(Opened::NoImage);
    }
    image(path, &object, with_name).map(|image| Opened::Image(Box::new(image)))
}

fn image(path: &Path, object: &DefaultDicomObject, with_name: bool) -> Result<Image, String> {
    let words = |tag| text(object, tag).unwrap_or_default();
    let protocol = [
        text(object, tags::KERNEL).map(|k| format!("kernel {k}")),
        text(object, tags::KVP).map(|k| format!("{k} kVp")),
    ];
    let mut image = Image {
        series_uid: words(tags::SERIES_UID),
        number: number(object, tags::SERIES_NUMBER).map(|n| n as i64),
        description: words(tags::SERIES_DESCRIPTION),
        modality: words(tags::MODALITY),
        scanner: format!("{} {}", words(tags::MANUFACTURER), words(tags::MODEL))
            .trim()
            .to_owned(),
        protocol: protocol
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .join(", "),
        tilt_deg: number(object, tags::TILT),
        patient: format!(
            "{}\u{0}{}",
            words(tags::PATIENT_ID),
            words(tags::PATIENT_NAME)
        ),
        name: with_name.then(|| words(tags::PATIENT_NAME)),
        syntax: object
            .meta()
            .transfer_syntax()
            .trim_end_matches(['\0', ' '])
            .to_owned(),
        slices: Vec::new(),
    };
    let stored = stored(object)?;
    let frames = number(object, tags::FRAMES).map_or(1, |n| n.max(1.0) as u32);
    let path: Arc<Path> = Arc::from(path);
    for frame in 0..frames {
        image
            .slices
            .push(slice(&path, object, stored, (frame, frames))?);
    }
    Ok(image)
}

/// Refuses what can be no CT slice.
pub(super) fn stored(object: &InMemDicomObject) -> Result<Stored, String> {
    let whole = |tag, name: &str| {
        number(object, tag)
            .filter(|v| (0.0..=65_535.0).contains(v) && v.fract() == 0.0)
            .map(|v| v as u16)
            .ok_or_else(|| format!("{name} is missing or no whole number; export the series again"))
    };
    let samples = number(object, tags::SAMPLES).unwrap_or(1.0);
    let colours = text(object, tags::PHOTOMETRIC).unwrap_or_default();
    if (samples - 1.0).abs() > f64::EPSILON
        || !colours.is_empty() && !colours.starts_with("MONOCHROME")
    {
        return Err(format!(
            "colour pixels ({colours}, {samples} samples) hold no CT numbers; export the original series"
        ));
    }
    if colours == "MONOCHROME1" {
        return Err(
            "MONOCHROME1: an inverted picture holds no CT numbers; export the original series"
                .to_owned(),
        );
    }
    let stored = Stored {
        rows: usize::from(whole(tags::ROWS, "Rows")?),
        columns: usize::from(whole(tags::COLUMNS, "Columns")?),
        bits_allocated: whole(tags::BITS_ALLOCATED, "BitsAllocated")?,
        bits_stored: whole(tags::BITS_STORED, "BitsStored")?,
        high_bit: whole(tags::HIGH_BIT, "HighBit")?,
        signed: whole(tags::REPRESENTATION, "PixelRepresentation")? == 1,
    };
    if stored.bits_allocated == 8 {
        return Err(
            "8-bit pixels cannot hold CT numbers; export the original series with 12 or 16 bits"
                .to_owned(),
        );
    }
    let sensible = matches!(stored.bits_allocated, 16 | 32)
        && (1..=stored.bits_allocated).contains(&stored.bits_stored)
        && stored.high_bit < stored.bits_allocated
        && stored.high_bit + 1 >= stored.bits_stored;
    if !sensible {
        return Err(format!(
            "BitsAllocated {}, BitsStored {}, HighBit {} cannot be; export the series again",
            stored.bits_allocated, stored.bits_stored, stored.high_bit
        ));
    }
    if stored.rows == 0 || stored.columns == 0 {
        return Err("no rows or no columns; export the series again".to_owned());
    }
    Ok(stored)
}

/// Where an attribute of a frame may stand: in its own functional groups, the shared ones, the file.
struct Places<'a> {
    own: Option<&'a InMemDicomObject>,
    shared: Option<&'a InMemDicomObject>,
    file: &'a InMemDicomObject,
}

impl Places<'_> {
    fn numbers(&self, sequence: Tag, tag: Tag) -> Option<Vec<f64>> {
        [self.own, self.shared]
            .into_iter()
            .flatten()
            .find_map(|group| numbers(item(group, sequence, 0)?, tag))
            .or_else(|| numbers(self.file, tag))
    }

    fn first(&self, sequence: Tag, tag: Tag) -> Option<f64> {
        self.numbers(sequence, tag)?.first().copied()
    }
}

fn slice(
    path: &Arc<Path>,
    object: &InMemDicomObject,
    stored: Stored,
    (frame, frames): (u32, u32),
) -> Result<Slice, String> {
    let places = Places {
        own: item(object, tags::PER_FRAME, frame as usize),
        shared: item(object, tags::SHARED, 0),
        file: object,
    };
    let need = |what: Option<Vec<f64>>, count: usize, name: &str| {
        what.filter(|v| v.len() == count && v.iter().all(|x| x.is_finite()))
            .ok_or_else(|| {
                format!("{name} is missing or not {count} numbers, so its place is unknown; export the original series")
            })
    };
    let position = places.numbers(tags::PLANE_POSITION, tags::POSITION);
    let position = need(position, 3, "ImagePositionPatient")?;
    let axes = places.numbers(tags::PLANE_ORIENTATION, tags::ORIENTATION);
    let axes = need(axes, 6, "ImageOrientationPatient")?;
    let spacing = need(
        places.numbers(tags::MEASURES, tags::SPACING),
        2,
        "PixelSpacing",
    )?;
    if let Some(bad) = spacing.iter().find(|v| !(0.01..=20.0).contains(*v)) {
        return Err(format!(
            "PixelSpacing = {bad} mm is no spacing (allowed: 0.01 to 20); export the series again"
        ));
    }
    let (row, column) = (DVec3::from_slice(&axes), DVec3::from_slice(&axes[3..]));
    let unit = |v: DVec3| (v.length() - 1.0).abs() < 1e-2;
    if !unit(row) || !unit(column) || row.dot(column).abs() > 1e-3 {
        return Err(
            "ImageOrientationPatient is not two unit vectors at right angles; export the series again"
                .to_owned(),
        );
    }
    let along_row = row / row.length();
    let down = column - along_row * column.dot(along_row);
    Ok(Slice {
        path: Arc::clone(path),
        frame,
        of_many: frames > 1,
        stored,
        origin: DVec3::from_slice(&position),
        along_row,
        down_column: down / down.length(),
        // PixelSpacing: distance of rows first
        pixel_mm: [spacing[1], spacing[0]],
        slope: places.first(tags::TRANSFORM, tags::SLOPE).unwrap_or(1.0),
        intercept: places
            .first(tags::TRANSFORM, tags::INTERCEPT)
            .unwrap_or(0.0),
        padding: padding(object, stored),
        time_point: text(object, tags::TIME_POINT),
    })
}

/// The padding values; stored as the pixels are, but often labelled with the other sign.
fn padding(object: &InMemDicomObject, stored: Stored) -> Option<(i64, i64)> {
    let as_stored = |v: f64| {
        let bits = v as i64 & 0xffff;
        if stored.signed && bits & 0x8000 != 0 {
            bits - 0x1_0000
        } else {
            bits
        }
    };
    let first = as_stored(number(object, tags::PADDING)?);
    let last = number(object, tags::PADDING_LIMIT).map_or(first, as_stored);
    Some((first.min(last), first.max(last)))
}

fn item(object: &InMemDicomObject, tag: Tag, index: usize) -> Option<&InMemDicomObject> {
    object.get(tag)?.items()?.get(index)
}

fn numbers(object: &InMemDicomObject, tag: Tag) -> Option<Vec<f64>> {
    let element = object.get(tag)?;
    (!element.is_empty())
        .then(|| element.to_multi_float64().ok())
        .flatten()
}

fn number(object: &InMemDicomObject, tag: Tag) -> Option<f64> {
    numbers(object, tag)?.first().copied()
}

/// An attribute as one line of text without padding; `None` where it is missing or empty.
fn text(object: &InMemDicomObject, tag: Tag) -> Option<String> {
    let value = object.get(tag)?.to_str().ok()?;
    let line = value.trim_matches(['\0', ' ']).replace(['\n', '\r'], " ");
    (!line.is_empty()).then_some(line)
}

impl Slice {
    /// The slice's file and, of many, its frame from 1: for an error.
    pub(crate) fn place(&self) -> (PathBuf, Option<u32>) {
        (
            self.path.to_path_buf(),
            self.of_many.then(|| self.frame + 1),
        )
    }

    /// Unit normal of the slice, right-handed with row and column.
    pub(crate) fn normal(&self) -> DVec3 {
        self.along_row.cross(self.down_column)
    }
}
