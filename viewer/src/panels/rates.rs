//! Rates: the servo's clock and the viewer's.

use super::{Status, heading, row, table};
use crate::palette::{GOOD, WARNING};
use egui::RichText;

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status) {
    heading(ui, "Rates and late ticks");
    table(ui, "rates", |ui| {
        row(
            ui,
            "viewer",
            format!("{:.0} fps, {} brick updates", status.fps, status.updates),
        );
        let Some(health) = &status.health else {
            return;
        };
        let share = 100.0 * health.late_ticks as f64 / health.ticks.max(1) as f64;
        let late = format!("{} of {} ({share:.3} %)", health.late_ticks, health.ticks);
        let late = RichText::new(late).strong();
        row(
            ui,
            "late ticks",
            late.color(if health.late_ticks > 0 { WARNING } else { GOOD }),
        );
    });
    let Some(health) = &status.health else {
        return;
    };
    ui.add_space(2.0);
    egui::Grid::new("quantiles")
        .num_columns(5)
        .min_row_height(super::ROW)
        .spacing([8.0, 1.0])
        .show(ui, |ui| {
            for title in ["µs", "p50", "p99", "p99.9", "max"] {
                ui.label(RichText::new(title).color(egui::Color32::from_gray(0xa8)));
            }
            ui.end_row();
            let rows = [
                ("wake-up", health.wake_micros),
                ("tick", health.tick_micros),
                ("round trip", health.roundtrip_micros),
            ];
            for (name, quantiles) in rows {
                ui.label(RichText::new(name).color(egui::Color32::from_gray(0xa8)));
                for value in quantiles {
                    ui.monospace(format!("{value:.0}"));
                }
                ui.end_row();
            }
        });
}
