//! The attributes that are read (DICOM PS3.6).

use dicom_core::Tag;

pub(super) const SOP_CLASS: Tag = Tag(0x0008, 0x0016);
pub(super) const SOP_INSTANCE: Tag = Tag(0x0008, 0x0018);
pub(super) const MODALITY: Tag = Tag(0x0008, 0x0060);
pub(super) const MANUFACTURER: Tag = Tag(0x0008, 0x0070);
pub(super) const SERIES_DESCRIPTION: Tag = Tag(0x0008, 0x103e);
pub(super) const MODEL: Tag = Tag(0x0008, 0x1090);
pub(super) const PATIENT_NAME: Tag = Tag(0x0010, 0x0010);
pub(super) const PATIENT_ID: Tag = Tag(0x0010, 0x0020);
pub(super) const KVP: Tag = Tag(0x0018, 0x0060);
pub(super) const TILT: Tag = Tag(0x0018, 0x1120);
pub(super) const KERNEL: Tag = Tag(0x0018, 0x1210);
pub(super) const SERIES_UID: Tag = Tag(0x0020, 0x000e);
pub(super) const SERIES_NUMBER: Tag = Tag(0x0020, 0x0011);
pub(super) const POSITION: Tag = Tag(0x0020, 0x0032);
pub(super) const ORIENTATION: Tag = Tag(0x0020, 0x0037);
pub(super) const TIME_POINT: Tag = Tag(0x0020, 0x0100);
pub(super) const SAMPLES: Tag = Tag(0x0028, 0x0002);
pub(super) const PHOTOMETRIC: Tag = Tag(0x0028, 0x0004);
pub(super) const FRAMES: Tag = Tag(0x0028, 0x0008);
pub(super) const ROWS: Tag = Tag(0x0028, 0x0010);
pub(super) const COLUMNS: Tag = Tag(0x0028, 0x0011);
pub(super) const SPACING: Tag = Tag(0x0028, 0x0030);
pub(super) const BITS_ALLOCATED: Tag = Tag(0x0028, 0x0100);
pub(super) const BITS_STORED: Tag = Tag(0x0028, 0x0101);
pub(super) const HIGH_BIT: Tag = Tag(0x0028, 0x0102);
pub(super) const REPRESENTATION: Tag = Tag(0x0028, 0x0103);
pub(super) const PADDING: Tag = Tag(0x0028, 0x0120);
pub(super) const PADDING_LIMIT: Tag = Tag(0x0028, 0x0121);
pub(super) const INTERCEPT: Tag = Tag(0x0028, 0x1052);
pub(super) const SLOPE: Tag = Tag(0x0028, 0x1053);
pub(super) const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
// functional groups of multi-frame images
pub(super) const SHARED: Tag = Tag(0x5200, 0x9229);
pub(super) const PER_FRAME: Tag = Tag(0x5200, 0x9230);
pub(super) const PLANE_POSITION: Tag = Tag(0x0020, 0x9113);
pub(super) const PLANE_ORIENTATION: Tag = Tag(0x0020, 0x9116);
pub(super) const MEASURES: Tag = Tag(0x0028, 0x9110);
pub(super) const TRANSFORM: Tag = Tag(0x0028, 0x9145);
