//! The header of a NIfTI file: fields at their byte offsets, checked before anything is allocated.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "fields are checked against their range before they are narrowed"
)]

use super::{MAX_VOXELS, Problem, read_up_to};
use osteon_sim_core::grid::MAX_DIM;
use std::io::Read;

const SIZE_1: usize = 348;
const SIZE_2: usize = 540;

/// How one voxel is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Element {
    U8,
    I8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Element {
    fn of_code(code: i64) -> Result<Self, Problem> {
        let name = match code {
            2 => return Ok(Self::U8),
            4 => return Ok(Self::I16),
            8 => return Ok(Self::I32),
            16 => return Ok(Self::F32),
            64 => return Ok(Self::F64),
            256 => return Ok(Self::I8),
            512 => return Ok(Self::U16),
            768 => return Ok(Self::U32),
            1 => "1-bit",
            32 | 1792 | 2048 => "complex",
            128 => "RGB",
            2304 => "RGBA",
            1024 | 1280 => "64-bit integer",
            1536 => "128-bit float",
            _ => "unknown",
        };
        Err(Problem::Datatype { code, name })
    }

    /// Bytes of one voxel.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// How voxels become numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Encoding {
    pub(crate) element: Element,
    pub(crate) big_endian: bool,
    /// value = stored · slope + intercept; `None` where no scaling is asked for
    pub(crate) scale: Option<(f64, f64)>,
}

/// What the reader needs of a header.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub(super) dims: [usize; 3],
    pub(super) encoding: Encoding,
    // millimetres of one unit of the file
    unit_mm: f64,
    // pixdim[0..4]: handedness of the qform, then spacings
    pixdim: [f64; 4],
    qform: Option<[f64; 6]>,
    sform: Option<[[f64; 4]; 3]>,
}

/// Numbers at offsets of a header held in full.
struct Fields<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl Fields<'_> {
    fn raw<const N: usize>(&self, at: usize) -> [u8; N] {
        // every offset below is a constant inside the header; zeros beyond it
        let mut raw = [0; N];
        if let Some(slice) = self.bytes.get(at..at + N) {
            raw.copy_from_slice(slice);
        }
        if self.big_endian {
            raw.reverse();
        }
        raw
    }

    fn i16(&self, at: usize) -> i64 {
        i64::from(i16::from_le_bytes(self.raw(at)))
    }

    fn i32(&self, at: usize) -> i64 {
        i64::from(i32::from_le_bytes(self.raw(at)))
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.raw(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.raw(at)))
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.raw(at))
    }
}

/// The two versions' fields in one shape, unchecked.
struct Raw {
    dim: [i64; 8],
    datatype: i64,
    pixdim: [f64; 4],
    vox_offset: f64,
    slope: f64,
    intercept: f64,
    units: i64,
    qform_code: i64,
    sform_code: i64,
    qform: [f64; 6],
    sform: [[f64; 4]; 3],
}

impl Raw {
    fn version_1(f: &Fields<'_>) -> Self {
        Self {
            dim: core::array::from_fn(|n| f.i16(40 + 2 * n)),
            datatype: f.i16(70),
            pixdim: core::array::from_fn(|n| f.f32(76 + 4 * n)),
            vox_offset: f.f32(108),
            slope: f.f32(112),
            intercept: f.f32(116),
            units: i64::from(f.bytes[123]),
            qform_code: f.i16(252),
            sform_code: f.i16(254),
            qform: core::array::from_fn(|n| f.f32(256 + 4 * n)),
            sform: core::array::from_fn(|r| core::array::from_fn(|c| f.f32(280 + 16 * r + 4 * c))),
        }
    }

    fn version_2(f: &Fields<'_>) -> Self {
        Self {
            dim: core::array::from_fn(|n| f.i64(16 + 8 * n)),
            datatype: f.i16(12),
            pixdim: core::array::from_fn(|n| f.f64(104 + 8 * n)),
            vox_offset: f.i64(168) as f64,
            slope: f.f64(176),
            intercept: f.f64(184),
            units: f.i32(500),
            qform_code: f.i32(344),
            sform_code: f.i32(348),
            qform: core::array::from_fn(|n| f.f64(352 + 8 * n)),
            sform: core::array::from_fn(|r| core::array::from_fn(|c| f.f64(400 + 32 * r + 8 * c))),
        }
    }
}

impl Header {
    /// Reads and checks the header and leaves the stream at the first voxel.
    pub(super) fn read(stream: &mut dyn Read) -> Result<Self, Problem> {
        let mut bytes = vec![0; SIZE_1];
        // the first four bytes tell a short NIfTI file from a file of another kind
        if read_up_to(stream, &mut bytes[..4])? < 4 {
            return Err(Problem::NotNifti);
        }
        let size: [u8; 4] = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let (size, big_endian) = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
            (348, _) => (SIZE_1, false),
            (540, _) => (SIZE_2, false),
            (_, 348) => (SIZE_1, true),
            (_, 540) => (SIZE_2, true),
            _ => return Err(Problem::NotNifti),
        };
        bytes.resize(size, 0);
        fill(stream, &mut bytes, 4)?;
        let magic = if size == SIZE_1 {
            &bytes[344..348]
        } else {
            &bytes[4..8]
        };
        match magic {
            b"n+1\0" | b"n+2\0" => {}
            b"ni1\0" | b"ni2\0" => return Err(Problem::Pair),
            _ => return Err(Problem::NotNifti),
        }
        let fields = Fields {
            bytes: &bytes,
            big_endian,
        };
        let raw = if size == SIZE_1 {
            Raw::version_1(&fields)
        } else {
            Raw::version_2(&fields)
        };
        let header = Self::check(&raw, big_endian)?;
        skip_to_voxels(stream, raw.vox_offset, size)?;
        Ok(header)
    }

    fn check(raw: &Raw, big_endian: bool) -> Result<Self, Problem> {
        let unit_mm = match raw.units & 7 {
            1 => 1000.0,
            3 => 0.001,
            _ => 1.0,
        };
        let dims = check_dims(raw.dim)?;
        let element = Element::of_code(raw.datatype)?;
        for axis in 1..4 {
            let value = raw.pixdim[axis] * unit_mm;
            if !(0.01..=20.0).contains(&value) {
                let field = format!("pixdim[{axis}]");
                return Err(Problem::Spacing { field, value });
            }
        }
        // slope 0 or not a number: no scaling asked for
        let scaled = raw.slope.is_finite() && raw.slope != 0.0;
        let intercept = if raw.intercept.is_finite() {
            raw.intercept
        } else {
            0.0
        };
        let unchanged = (raw.slope - 1.0).abs() < f64::EPSILON && intercept == 0.0;
        Ok(Self {
            dims,
            encoding: Encoding {
                element,
                big_endian,
                scale: (scaled && !unchanged).then_some((raw.slope, intercept)),
            },
            unit_mm,
            pixdim: raw.pixdim,
            qform: (raw.qform_code > 0).then_some(raw.qform),
            sform: (raw.sform_code > 0).then_some(raw.sform),
        })
    }

    /// The field that [`Self::ras_affine`] is made of.
    pub(super) fn form(&self) -> &'static str {
        match (self.sform, self.qform) {
            (Some(_), _) => "sform",
            (None, Some(_)) => "qform",
            (None, None) => "pixdim",
        }
    }

    /// Rows of the affine from voxel indices to RAS mm: sform, else qform, else the spacing alone.
    pub(super) fn ras_affine(&self) -> [[f64; 4]; 3] {
        let rows = match (self.sform, self.qform) {
            (Some(rows), _) => rows,
            (None, Some(q)) => quaternion_affine(q, self.pixdim),
            (None, None) => core::array::from_fn(|r| {
                core::array::from_fn(|c| if r == c { self.pixdim[r + 1] } else { 0.0 })
            }),
        };
        rows.map(|row| row.map(|v| v * self.unit_mm))
    }
}

impl Encoding {
    /// Appends the numbers of a block of whole voxels.
    pub(super) fn convert(&self, block: &[u8], values: &mut Vec<f32>) {
        match self.element {
            Element::U8 => self.each(block, values, |[b]: [u8; 1]| f64::from(b)),
            Element::I8 => self.each(block, values, |b| f64::from(i8::from_le_bytes(b))),
            Element::I16 => self.each(block, values, |b| f64::from(i16::from_le_bytes(b))),
            Element::U16 => self.each(block, values, |b| f64::from(u16::from_le_bytes(b))),
            Element::I32 => self.each(block, values, |b| f64::from(i32::from_le_bytes(b))),
            Element::U32 => self.each(block, values, |b| f64::from(u32::from_le_bytes(b))),
            Element::F32 => self.each(block, values, |b| f64::from(f32::from_le_bytes(b))),
            Element::F64 => self.each(block, values, f64::from_le_bytes),
        }
    }

    fn each<const N: usize>(
        &self,
        block: &[u8],
        values: &mut Vec<f32>,
        number: impl Fn([u8; N]) -> f64,
    ) {
        let (elements, _) = block.as_chunks::<N>();
        let (slope, intercept) = self.scale.unwrap_or((1.0, 0.0));
        let scaled = self.scale.is_some();
        values.extend(elements.iter().map(|&element| {
            let mut raw = element;
            if self.big_endian {
                raw.reverse();
            }
            let v = number(raw);
            (if scaled { v * slope + intercept } else { v }) as f32
        }));
    }
}

fn check_dims(dim: [i64; 8]) -> Result<[usize; 3], Problem> {
    let refuse = |n: usize, allowed| {
        Err(Problem::Dimension {
            field: format!("dim[{n}]"),
            value: dim[n],
            allowed,
        })
    };
    if !(3..=7).contains(&dim[0]) {
        return refuse(0, "3 axes are needed");
    }
    let last = dim[0] as usize;
    for (n, &length) in dim.iter().enumerate().take(last + 1).skip(1) {
        let possible = usize::try_from(length).is_ok_and(|v| (1..=MAX_DIM).contains(&v));
        if n < 4 && !possible {
            return refuse(n, "1 to 4096 voxels are allowed");
        }
        if n >= 4 && length != 1 {
            return refuse(n, "only 1 is allowed, for this is a series of volumes");
        }
    }
    let dims = [dim[1], dim[2], dim[3]].map(|n| n as usize);
    if dims.iter().product::<usize>() > MAX_VOXELS {
        return Err(Problem::Dimension {
            field: "dim[1]·dim[2]·dim[3]".to_owned(),
            value: dim[1] * dim[2] * dim[3],
            allowed: "at most 2147483648 voxels are allowed",
        });
    }
    Ok(dims)
}

/// Reads the header `bytes` from offset `from` on, or says how much of it was there.
fn fill(stream: &mut dyn Read, bytes: &mut [u8], from: usize) -> Result<(), Problem> {
    let got = from + read_up_to(stream, &mut bytes[from..])?;
    if got == bytes.len() {
        return Ok(());
    }
    Err(Problem::Truncated {
        part: "header",
        expected: bytes.len() as u64,
        got: got as u64,
    })
}

/// Skips extensions up to the first voxel. An offset of 0 means "right after the header".
fn skip_to_voxels(stream: &mut dyn Read, vox_offset: f64, header: usize) -> Result<(), Problem> {
    const MOST: f64 = 1e9;
    if !(0.0..=MOST).contains(&vox_offset) {
        return Err(Problem::Offset(vox_offset));
    }
    // four bytes say whether extensions follow
    let gap = (vox_offset as usize).max(header + 4) - header;
    let mut left = gap;
    let mut sink = [0; 4096];
    while left > 0 {
        let step = left.min(sink.len());
        let got = read_up_to(stream, &mut sink[..step])?;
        left -= got;
        if got < step {
            return Err(Problem::Truncated {
                part: "header extensions",
                expected: gap as u64,
                got: (gap - left) as u64,
            });
        }
    }
    Ok(())
}

/// The qform's affine: a unit quaternion (b, c, d; a ≥ 0 follows), an offset, and the spacings with
/// the third axis mirrored where pixdim[0] is negative.
fn quaternion_affine(q: [f64; 6], pixdim: [f64; 4]) -> [[f64; 4]; 3] {
    let [b, c, d, ox, oy, oz] = q;
    let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
    let mirror = if pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let (x, y, z) = (pixdim[1], pixdim[2], pixdim[3] * mirror);
    [
        [
            (a * a + b * b - c * c - d * d) * x,
            2.0 * (b * c - a * d) * y,
            2.0 * (b * d + a * c) * z,
            ox,
        ],
        [
            2.0 * (b * c + a * d) * x,
            (a * a + c * c - b * b - d * d) * y,
            2.0 * (c * d - a * b) * z,
            oy,
        ],
        [
            2.0 * (b * d - a * c) * x,
            2.0 * (c * d + a * b) * y,
            (a * a + d * d - b * b - c * c) * z,
            oz,
        ],
    ]
}
