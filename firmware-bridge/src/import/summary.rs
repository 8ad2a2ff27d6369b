//! What an import did, for a person and as JSON.

use crate::scene::file::Source;
use serde::Serialize;
use std::path::Path;

/// What an import did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Where the volume came from.
    pub source: Source,
    /// Hash of `volume.nii`.
    pub xxh3: String,
    /// Direction of each voxel axis in the patient: "left", "posterior", "superior" or their
    /// opposites, with the degrees that it is off.
    pub axes: [String; 3],
    /// Files that are not DICOM.
    pub ignored_files: usize,
    /// DICOM files without an image.
    pub without_image: usize,
    /// Series in the folder.
    pub series: usize,
    /// Remarks that somebody should read.
    pub remarks: Vec<String>,
}

/// What somebody should know before trusting a volume.
pub(super) fn remarks(source: &Source, header_tilt_deg: Option<f64>) -> Vec<String> {
    let mut all = Vec::new();
    if let Some(modality) = source.modality.as_deref().filter(|m| *m != "CT") {
        all.push(format!("modality {modality}: its values are no Hounsfield units; thresholds and densities do not apply"));
    }
    if let Some(lossy) = &source.lossy {
        all.push(format!(
            "{lossy} has lost part of the CT numbers; ask for the uncompressed series"
        ));
    }
    for gap in &source.gaps {
        all.push(format!(
            "{} missing slice(s) from plane {} on were filled from their neighbours",
            gap.missing, gap.first
        ));
    }
    match (source.tilt_deg, header_tilt_deg) {
        (Some(tilt), _) => all.push(format!(
            "gantry tilt of {tilt:.2}° resampled to an upright grid, within each slice only"
        )),
        (None, Some(said)) if said.abs() > 0.1 => all.push(format!(
            "the header says a gantry tilt of {said}°, the slices' places show none; the places were believed"
        )),
        _ => {}
    }
    if source.non_finite_voxels > 0 {
        all.push(format!(
            "{} voxels that were no number are air",
            source.non_finite_voxels
        ));
    }
    all
}

/// The patient's direction nearest to `axis` (LPS), in words.
pub(super) fn direction(axis: glam::DVec3) -> String {
    let names = [
        ["left", "right"],
        ["posterior", "anterior"],
        ["superior", "inferior"],
    ];
    let nearest = (0..3)
        .max_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs()))
        .unwrap_or(0);
    let name = names[nearest][usize::from(axis[nearest] < 0.0)];
    let off = (axis[nearest].abs() / axis.length())
        .min(1.0)
        .acos()
        .to_degrees();
    if off < 0.05 {
        name.to_owned()
    } else {
        format!("{name}, {off:.1}° off")
    }
}

impl Summary {
    /// The summary for a person.
    pub fn lines(&self, out: &Path) -> Vec<String> {
        let s = &self.source;
        let [nx, ny, nz] = s.dims;
        let [hx, hy, hz] = s.spacing_mm;
        let slices = s.slices.map_or(String::new(), |n| format!(", {n} slices"));
        let mut lines = vec![
            format!(
                "{}{slices}: {nx} × {ny} × {nz} voxels of {hx:.4} × {hy:.4} × {hz:.4} mm",
                s.kind
            ),
            format!(
                "axes towards: {}; {}; {} (patient, LPS)",
                self.axes[0], self.axes[1], self.axes[2]
            ),
        ];
        if s.kind == "DICOM" {
            lines.push(format!(
                "ignored: {} files that are not DICOM, {} without an image; padding voxels: {}",
                self.ignored_files, self.without_image, s.padding_voxels
            ));
        }
        lines.extend(self.remarks.iter().map(|r| format!("note: {r}")));
        lines.push(format!("scene: {} (xxh3 {})", out.display(), self.xxh3));
        lines
    }
}
