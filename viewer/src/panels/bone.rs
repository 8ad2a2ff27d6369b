//! Bone: where it comes from, its lattice, and what was removed.

use super::{Status, heading, row, table};
use crate::palette::tissue_paint;
use egui::RichText;
use osteon_sim_core::tissue::Tissue;

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status) {
    heading(ui, "Bone");
    let Some(scene) = &status.scene else {
        ui.label("none yet");
        return;
    };
    table(ui, "bone", |ui| {
        row(ui, "source", scene.source.as_str());
        let [x, y, z] = scene.dims;
        row(ui, "voxels", format!("{x} × {y} × {z}"));
        let [hx, hy, hz] = scene.spacing_mm;
        row(ui, "spacing", format!("{hx:.3} × {hy:.3} × {hz:.3} mm"));
        let solid = format!("{:.0} mm³ in {} chunks", scene.solid_mm3, status.chunks.0);
        row(ui, "solid", solid);
        let total: f64 = status.removed_mm3.iter().sum();
        row(
            ui,
            "removed",
            RichText::new(format!("{total:.1} mm³")).strong(),
        );
        for tissue in Tissue::ALL {
            let mm3 = status.removed_mm3[tissue as usize];
            if mm3 > 0.0 {
                let value = RichText::new(format!("{mm3:.1} mm³")).color(tissue_paint(tissue));
                row(ui, &format!("  {}", tissue.name()), value);
            }
        }
    });
}
