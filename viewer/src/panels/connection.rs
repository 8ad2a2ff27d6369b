//! Connection: socket, state of session and device.

use super::{Status, heading, row, table};
use crate::palette::{FAILURE, GOOD, WARNING};
use egui::RichText;

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status) {
    heading(ui, "Connection");
    table(ui, "connection", |ui| {
        row(ui, "socket", status.socket.as_str());
        row(ui, "session", state(status));
        let Some(health) = &status.health else {
            row(ui, "device", RichText::new("no word yet").color(WARNING));
            return;
        };
        row(ui, "device", health.link.as_str());
        row(ui, "drive", drive(&health.drive));
        let errors = health.crc_errors + health.gaps;
        let frames = format!(
            "{} frames, {} bad, {} missing",
            health.frames, health.crc_errors, health.gaps
        );
        row(ui, "cable", tinted(&frames, errors > 0));
        if health.watchdog_trips > 0 {
            row(
                ui,
                "watchdog",
                tinted(&format!("{} trips", health.watchdog_trips), true),
            );
        }
    });
    // whole, not cut: it says why there is no force and what to do
    if let Some(health) = status.health.as_ref().filter(|h| !h.note.is_empty()) {
        ui.label(RichText::new(&health.note).color(WARNING));
    }
    if !status.complaint.is_empty() {
        ui.label(RichText::new(&status.complaint).color(FAILURE));
    }
}

fn tinted(text: &str, bad: bool) -> RichText {
    let text = RichText::new(text);
    if bad { text.color(WARNING) } else { text }
}

fn state(status: &Status) -> RichText {
    let (here, all) = status.chunks;
    if status.broken {
        return RichText::new("connection lost, trying again").color(FAILURE);
    }
    if status.scene.is_none() {
        return RichText::new("waiting for the scene").color(WARNING);
    }
    if here < all {
        return RichText::new(format!("bone arrives: {here} of {all} chunks")).color(WARNING);
    }
    if status.paused() {
        return RichText::new("paused: no force, no cutting").color(WARNING);
    }
    RichText::new("running").color(GOOD)
}

fn drive(state: &str) -> RichText {
    let text = RichText::new(state).strong();
    match state {
        "active" => text.color(GOOD),
        "fault" | "tripped" => text.color(FAILURE),
        _ => text.color(WARNING),
    }
}
