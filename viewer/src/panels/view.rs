//! View: renderer, colours, section plane, ghost.

use super::{Status, Wish, heading};
use crate::render::look::{Colouring, Cutaway};
use crate::render::method::Kind;
use egui::{Button, Color32, RichText, Slider};

/// Farthest shift of the section plane, mm.
const MOST_SHIFT_MM: f64 = 40.0;

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    heading(ui, "View");
    let mut choice = status.view;
    let grey = Color32::from_gray(0xa8);
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("renderer (V)").color(grey));
        for kind in Kind::ALL {
            let button = Button::selectable(choice.method == kind, kind.name());
            if ui.add(button).on_hover_text(kind.about()).clicked() {
                choice.method = kind;
            }
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("colours").color(grey));
        for colouring in Colouring::ALL {
            let button = Button::selectable(choice.colouring == colouring, colouring.name());
            if ui.add(button).clicked() {
                choice.colouring = colouring;
            }
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new("cut away").color(grey)).on_hover_text(
            "Hides the bone before a plane through the tool's tip. The renderer 'section' shows the CT on it.",
        );
        for cutaway in Cutaway::ALL {
            let button = Button::selectable(choice.cutaway == cutaway, cutaway.name());
            if ui.add(button).clicked() {
                choice.cutaway = cutaway;
            }
        }
    });
    if choice.cutaway != Cutaway::Off {
        ui.horizontal(|ui| {
            ui.label(RichText::new("shift, mm").color(grey));
            ui.add(
                Slider::new(&mut choice.shift_mm, -MOST_SHIFT_MM..=MOST_SHIFT_MM).show_value(false),
            );
            ui.label(format!("{:+.1}", choice.shift_mm));
        });
    }
    ui.checkbox(&mut choice.ghost, "tool shows through bone (X)");
    if choice != status.view {
        wishes.push(Wish::View(choice));
    }
}
