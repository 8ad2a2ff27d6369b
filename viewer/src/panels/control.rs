//! Who watches, who is in control, and the buttons that change it.

use super::{Status, Wish, row, table};
use crate::palette::{GOOD, WARNING};
use egui::RichText;
use osteon_protocol::ipc::{Command, ControlState, ViewerInfo};

/// Shows the rows; nothing where this viewer is alone and in control.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    let (Some(control), Some(me)) = (&status.control, status.number) else {
        return;
    };
    let mine = control.holder == Some(me);
    let others = || control.viewers.iter().filter(|v| v.number != me);
    if mine && others().next().is_none() {
        return;
    }
    table(ui, "control", |ui| {
        row(ui, "control", in_control(control, me));
        for viewer in others() {
            row(ui, "also here", described(viewer));
        }
    });
    let asked = control.asking == Some(me);
    if !mine && may_ask(control, me) && !asked && ui.small_button("ask for control").clicked() {
        wishes.push(Wish::Command(Command::AskControl));
    }
    if asked {
        ui.label(RichText::new("asked for control: the other may hand over").color(WARNING));
    }
    if let Some(to) = control.asking.filter(|to| mine && *to != me) {
        let text = format!("viewer {to} asks for control");
        ui.label(RichText::new(text).color(WARNING));
        if ui.small_button("hand over").clicked() {
            wishes.push(Wish::Command(Command::HandOver(to)));
        }
    }
}

fn may_ask(control: &ControlState, me: u16) -> bool {
    let own = control.viewers.iter().find(|v| v.number == me);
    own.is_some_and(|v| v.role != osteon_protocol::ipc::Role::Projector)
}

fn in_control(control: &ControlState, me: u16) -> RichText {
    match control.holder {
        Some(holder) if holder == me => RichText::new("yours").color(GOOD),
        Some(holder) => {
            let who = control.viewers.iter().find(|v| v.number == holder);
            let text = who.map_or_else(|| format!("viewer {holder}"), described);
            RichText::new(text).color(WARNING)
        }
        None => RichText::new("nobody's").color(WARNING),
    }
}

fn described(viewer: &ViewerInfo) -> String {
    let away = if viewer.present { "" } else { ", away" };
    format!(
        "{} {} ({}){away}",
        viewer.role.name(),
        viewer.number,
        viewer.name
    )
}
