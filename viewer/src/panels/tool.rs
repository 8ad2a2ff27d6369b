//! Tool and spindle, with the buttons of the session.

use super::{Status, Wish, heading, row, table};
use crate::palette::{FORCE, GOOD};
use egui::{Button, RichText};
use osteon_protocol::ipc::{Command, PoseUpdate};

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    heading(ui, "Tool and spindle");
    let in_hand = status.pose.map(|p| usize::from(p.tool));
    ui.horizontal_wrapped(|ui| {
        let tools = status.scene.iter().flat_map(|s| &s.tools);
        for (index, tool) in (0u8..).zip(tools) {
            let name = format!("{}  {}", index + 1, tool.name);
            let chosen = in_hand == Some(usize::from(index));
            if ui.add(Button::selectable(chosen, name)).clicked() {
                wishes.push(Wish::Command(Command::SelectTool(index)));
            }
        }
    });
    ui.horizontal_wrapped(|ui| {
        let mut button = |ui: &mut egui::Ui, text: &str, on: bool, command: Command| {
            if ui.add(Button::selectable(on, text)).clicked() {
                wishes.push(Wish::Command(command));
            }
        };
        let (spindle, paused) = (status.spindle_on(), status.paused());
        button(
            ui,
            if spindle {
                "S  spindle on"
            } else {
                "S  spindle off"
            },
            spindle,
            Command::Spindle(!spindle),
        );
        button(
            ui,
            if paused { "P  go on" } else { "P  pause" },
            paused,
            Command::Pause(!paused),
        );
        button(ui, "R  reset bone", false, Command::Reset);
        button(ui, "stop session", false, Command::Stop);
    });
    if let Some(pose) = status.pose {
        figures(ui, status, &pose);
    }
}

fn figures(ui: &mut egui::Ui, status: &Status, pose: &PoseUpdate) {
    table(ui, "tool", |ui| {
        let newest = status.points.last();
        let force = newest.map_or(0.0, |p| p.force_n);
        let limit = status.scene.as_ref().map_or(0.0, |s| s.force_limit_n);
        row(
            ui,
            "force",
            RichText::new(format!("{force:.2} N of {limit:.1} N"))
                .color(FORCE)
                .strong(),
        );
        row(ui, "real tool", format!("{:.1} N", pose.physical_force_n));
        row(
            ui,
            "depth",
            format!("{:.2} mm past the joint face", pose.depth_mm),
        );
        let layer = status.layer.unwrap_or("none");
        row(
            ui,
            "layer at tip",
            if layer == "none" {
                RichText::new(layer)
            } else {
                RichText::new(layer).color(GOOD)
            },
        );
    });
}
