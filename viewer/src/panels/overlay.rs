//! What lies over the 3-D view: notes, view buttons, help.

use super::{Status, Wish};
use crate::camera::Preset;
use crate::palette::WARNING;
use egui::{Align2, Color32, RichText};

/// Notes and buttons in the view's corners.
pub(crate) fn show(ui: &egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    let rect = ui.min_rect();
    let area =
        egui::Area::new(egui::Id::unique("notes")).fixed_pos(rect.min + egui::vec2(10.0, 8.0));
    area.show(ui.ctx(), |ui| {
        ui.set_max_width(rect.width() - 20.0);
        notes(ui, status);
        ui.horizontal_wrapped(|ui| {
            for (text, wish) in [
                ("W  whole bone", Wish::WholeBone),
                ("G  glenoid", Wish::Glenoid),
                ("A  surgeon", Wish::LookFrom(Preset::Surgeon)),
                ("L  lateral", Wish::LookFrom(Preset::Lateral)),
                ("E  along tool", Wish::LookFrom(Preset::Tool)),
                ("H  hide tool", Wish::ToggleTool),
                ("?  help", Wish::ToggleHelp),
            ] {
                if ui.small_button(text).clicked() {
                    wishes.push(wish);
                }
            }
        });
    });
}

fn notes(ui: &mut egui::Ui, status: &Status) {
    if status.software {
        let text = format!(
            "software rendering: {} at {:.0} % resolution, low priority",
            status.adapter,
            100.0 * status.scale
        );
        note(ui, &text);
    }
    if status.view.boxes {
        let f = status.fates;
        let text = format!(
            "chunks: {} drawn (green), {} behind others (red), {} outside the picture",
            f.drawn, f.hidden, f.outside
        );
        note(ui, &text);
    }
    let (here, all) = status.chunks;
    if all > 0 && here < all {
        let share = here as f32 / all as f32;
        ui.add(
            egui::ProgressBar::new(share)
                .desired_width(260.0)
                .text(format!("bone: {here} of {all} chunks")),
        );
    } else if status.scene.is_none() {
        note(ui, "waiting for the haptics process to send its scene");
    }
    if status.paused() {
        note(ui, "PAUSED: no force, no cutting (P goes on)");
    }
    if status.clutched() {
        note(
            ui,
            "CLUTCH: the tool waits, the stylus moves freely (let C go)",
        );
    }
    if status.waiting > 2000 {
        note(
            ui,
            &format!("{} bricks are still to be drawn", status.waiting),
        );
    }
}

fn note(ui: &mut egui::Ui, text: &str) {
    egui::Frame::new()
        .fill(Color32::from_black_alpha(170))
        .corner_radius(3)
        .inner_margin(egui::Margin::symmetric(6, 2))
        .show(ui, |ui| ui.label(RichText::new(text).color(WARNING)));
}

/// All keys and mouse gestures.
pub(crate) fn help(ctx: &egui::Context, status: &Status, open: &mut bool) {
    egui::Window::new("Keys and mouse")
        .open(open)
        .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
        .collapsible(false)
        .resizable(false)
        .show(ctx, |ui| {
            egui::Grid::new("help")
                .num_columns(2)
                .spacing([18.0, 4.0])
                .show(ui, |ui| {
                    for (number, tool) in (1..).zip(status.scene.iter().flat_map(|s| &s.tools)) {
                        line(
                            ui,
                            &number.to_string(),
                            &format!("take the {} in hand", tool.name),
                        );
                    }
                    for (key, what) in KEYS {
                        line(ui, key, what);
                    }
                });
        });
}

const KEYS: [(&str, &str); 24] = [
    ("S", "spindle on or off"),
    ("P", "pause (no force, no cutting) or go on"),
    ("R", "back to the uncut bone"),
    ("K", "keep the bone as it is now"),
    ("U", "undo: back to the bone that was kept last"),
    ("C", "hold: the tool waits while the stylus moves freely"),
    ("W", "show the whole bone"),
    ("G", "show the glenoid closely"),
    ("A", "look as the surgeon does"),
    ("L", "look straight onto the joint's face"),
    ("E", "look along the tool"),
    ("B", "a picture for each eye, side by side"),
    ("T", "CT slices, or not"),
    ("O", "plots, or not"),
    ("H", "hide or show the tool"),
    ("V", "next renderer"),
    ("X", "the tool shows through bone, or not"),
    ("J", "chunks and what is culled of them, or not"),
    ("drag", "turn the view"),
    ("right or middle drag", "shift the view"),
    ("wheel", "come nearer or go away"),
    ("F12", "save a picture of the window"),
    ("?", "this help"),
    ("Esc or Ctrl-Q", "close the viewer; the session goes on"),
];

fn line(ui: &mut egui::Ui, key: &str, what: &str) {
    ui.monospace(RichText::new(key).strong());
    ui.label(what);
    ui.end_row();
}
