//! The colours of tissues, tools and plots.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use egui::Color32;
use osteon_sim_core::tissue::Tissue;

/// Screen colour of a tissue class; the colour of bone for a class that is not known.
pub(crate) fn tissue_colour(class: u8) -> [u8; 3] {
    match class {
        c if c == Tissue::Cartilage as u8 => [0xb9, 0xd3, 0xdf],
        c if c == Tissue::Subchondral as u8 => [0xf4, 0xe3, 0xb4],
        c if c == Tissue::Cancellous as u8 => [0xcf, 0x86, 0x62],
        _ => [0xe3, 0xda, 0xc9],
    }
}

/// A texel of the tissue atlas: colour and presence. Cancellous bone is brighter where it is
/// denser, so that a cut shows its structure.
pub(crate) fn tissue_texel(class: u8, density_hu: i16) -> [u8; 4] {
    if class == Tissue::Air as u8 {
        return [0; 4];
    }
    let mut rgb = tissue_colour(class);
    if class == Tissue::Cancellous as u8 {
        let gain = 0.82 + 0.36 * (f32::from(density_hu) / 700.0).clamp(0.0, 1.0);
        // in [0, 255] by the clamp
        rgb = rgb.map(|c| (f32::from(c) * gain).clamp(0.0, 255.0) as u8);
    }
    [rgb[0], rgb[1], rgb[2], 255]
}

/// A tissue's colour for the panels.
pub(crate) fn tissue_paint(tissue: Tissue) -> Color32 {
    let [r, g, b] = tissue_colour(tissue as u8);
    Color32::from_rgb(r, g, b)
}

/// Polished steel.
pub(crate) const STEEL: [f32; 3] = [0.66, 0.70, 0.75];
/// Something to be noticed.
pub(crate) const WARNING: Color32 = Color32::from_rgb(0xff, 0xb8, 0x4d);
/// Something that failed.
pub(crate) const FAILURE: Color32 = Color32::from_rgb(0xff, 0x6b, 0x5e);
/// All is well.
pub(crate) const GOOD: Color32 = Color32::from_rgb(0x7d, 0xd8, 0x8a);
/// The force plot.
pub(crate) const FORCE: Color32 = Color32::from_rgb(0xff, 0x9f, 0x5a);
/// The spindle's load.
pub(crate) const LOAD: Color32 = Color32::from_rgb(0x5a, 0x7f, 0x9f);
/// The depth plot.
pub(crate) const DEPTH: Color32 = Color32::from_rgb(0x6f, 0xc3, 0xff);
