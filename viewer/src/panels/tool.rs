//! Tool and spindle, with the buttons of the session.

use super::{ROW, Status, Wish, heading, row, row_with, table};
use crate::palette::{FAILURE, FORCE, GOOD, LOAD};
use egui::{Button, Color32, ProgressBar, RichText};
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
        button(ui, "K  keep bone", false, Command::Checkpoint);
        let kept = status.pose.map_or(0, |p| p.checkpoints);
        if kept > 0 {
            let text = format!("U  undo ({kept} kept)");
            button(ui, &text, false, Command::Undo);
        }
        button(ui, "stop session", false, Command::Stop);
    });
    if let Some(pose) = status.pose {
        figures(ui, status, &pose);
    }
}

fn figures(ui: &mut egui::Ui, status: &Status, pose: &PoseUpdate) {
    table(ui, "tool", |ui| {
        spindle(ui, status, pose);
        force(ui, status, pose);
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

fn spindle(ui: &mut egui::Ui, status: &Status, pose: &PoseUpdate) {
    let (set, rpm) = (status.set_rpm().unwrap_or(0.0), pose.spindle_rpm);
    let speed = if status.stalled() {
        RichText::new("STALLED: pull back a little")
            .color(FAILURE)
            .strong()
    } else if pose.spindle_on {
        RichText::new(format!("{rpm:.0} of {set:.0} rpm"))
    } else {
        RichText::new(format!("off ({set:.0} rpm)"))
    };
    row_with(
        ui,
        "speed",
        speed,
        "Under a load the spindle slows down. It stalls where the cut asks for more torque than the motor has; \
         it turns again as soon as you press less.",
    );
    let tip = "Torque of the cut over what the spindle's motor has. A surgeon hears it in the sound of the drill.";
    ui.label(RichText::new("load").color(Color32::from_gray(0xa8)))
        .on_hover_text(tip);
    let bar = ProgressBar::new(pose.spindle_load)
        .desired_width(150.0)
        .desired_height(ROW - 2.0)
        .corner_radius(2)
        .fill(if pose.spindle_load > 0.8 {
            FAILURE
        } else {
            LOAD
        });
    ui.horizontal(|ui| {
        ui.add(bar);
        ui.label(format!("{:.0} %", 100.0 * pose.spindle_load));
    })
    .response
    .on_hover_text(tip);
    ui.end_row();
    row_with(
        ui,
        "cutting",
        format!(
            "{:.0} N·mm, vibration {:.2} N",
            pose.spindle_nmm, pose.vibration_n
        ),
        "Torque with which the bone brakes a real tool. The hand feels the part of it that shakes, by each lip as it \
         passes; the rest is held by the handpiece.",
    );
}

fn force(ui: &mut egui::Ui, status: &Status, pose: &PoseUpdate) {
    let newest = status.points.last();
    let force = newest.map_or(0.0, |p| p.force_n);
    let (limit, scale) = status
        .scene
        .as_ref()
        .map_or((0.0, 0.0), |s| (s.force_limit_n, s.force_scale));
    let stylus = if pose.saturated {
        RichText::new(format!("{force:.2} N, AT THE LIMIT of {limit:.1} N")).color(FAILURE)
    } else {
        RichText::new(format!("{force:.2} N of {limit:.1} N")).color(FORCE)
    };
    row_with(
        ui,
        "force",
        stylus.strong(),
        "What your hand feels at the stylus, after all guards. At the limit a real tool would push back harder than \
         this device may: trust your eyes, not your hand.",
    );
    row_with(
        ui,
        "real tool",
        format!("{:.1} N (scale {scale})", pose.physical_force_n),
        "What a real tool would meet in this bone. The stylus shows this share of it, since its motors cannot \
         bear the whole.",
    );
}
