//! What stands around the 3-D view. Panels read a [`Status`] and return [`Wish`]es; they hold no
//! lock and change nothing themselves.

mod bone;
mod connection;
mod control;
pub(crate) mod gauge;
mod guards;
mod hand;
pub(crate) mod overlay;
pub(crate) mod plots;
mod rates;
pub(crate) mod slices;
mod tool;
mod view;

use crate::camera::Preset;
use crate::history::Point;
use crate::mirror::Mirror;
use crate::render::look::ViewChoice;
use crate::render::method::Fates;
use egui::{Color32, FontId, Key, RichText, TextStyle};
use osteon_protocol::ipc::{Command, ControlState, Health, PoseUpdate, Scene};
use osteon_sim_core::tissue::TISSUES;
use std::sync::Arc;

/// The session as the panels show it: a copy, so that the link never waits for them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Status {
    /// What is on the table.
    pub(crate) scene: Option<Arc<Scene>>,
    /// Chunks here and in all.
    pub(crate) chunks: (usize, usize),
    /// Newest pose.
    pub(crate) pose: Option<PoseUpdate>,
    /// Newest health.
    pub(crate) health: Option<Health>,
    /// mm³ removed by tissue class.
    pub(crate) removed_mm3: [f64; TISSUES],
    /// Tissue at the tool's apex.
    pub(crate) layer: Option<&'static str>,
    /// Force and depth, oldest first.
    pub(crate) points: Vec<Point>,
    /// Bricks that wait to be shown.
    pub(crate) waiting: usize,
    /// Bricks taken over.
    pub(crate) updates: u64,
    /// Socket.
    pub(crate) socket: String,
    /// Frames a second while pictures change.
    pub(crate) fps: f64,
    /// Who draws.
    pub(crate) adapter: String,
    /// Whether the CPU draws.
    pub(crate) software: bool,
    /// Resolution of the 3-D view as a share of the window's.
    pub(crate) scale: f64,
    /// The uncut bone's layers along the planned axis.
    pub(crate) layers: Arc<Vec<gauge::Layer>>,
    /// What was chosen of the view.
    pub(crate) view: ViewChoice,
    /// What the plots show, left and right.
    pub(crate) plots: [plots::Quantity; 2],
    /// What became of the chunks in the last picture.
    pub(crate) fates: Fates,
    /// What went wrong with the last wish.
    pub(crate) complaint: String,
    /// Number of this viewer.
    pub(crate) number: Option<u16>,
    /// Who is here and who is in control.
    pub(crate) control: Option<ControlState>,
    /// The connection broke and is being made again.
    pub(crate) broken: bool,
}

impl Status {
    /// Copies the mirror's part.
    pub(crate) fn new(mirror: &Mirror) -> Self {
        Self {
            scene: mirror.scene.clone(),
            chunks: mirror.chunks(),
            pose: mirror.pose,
            health: mirror.health.clone(),
            removed_mm3: mirror.removed_mm3,
            layer: mirror.layer_at_tip(),
            points: mirror.history.points().copied().collect(),
            waiting: mirror.model.as_ref().map_or(0, |m| m.dirty.len()),
            updates: mirror.updates,
            complaint: mirror.denied.clone().unwrap_or_default(),
            number: mirror.welcome.map(|w| w.number),
            control: mirror.control.clone(),
            broken: mirror.broken,
            ..Self::default()
        }
    }

    fn spindle_on(&self) -> bool {
        self.pose.is_some_and(|p| p.spindle_on)
    }

    fn paused(&self) -> bool {
        self.pose.is_some_and(|p| p.paused)
    }

    fn clutched(&self) -> bool {
        self.pose.is_some_and(|p| p.clutched)
    }

    fn saturated(&self) -> bool {
        self.pose.is_some_and(|p| p.saturated)
    }

    /// Speed of the tool in hand without a load, turns a minute.
    fn set_rpm(&self) -> Option<f32> {
        let tool = usize::from(self.pose?.tool);
        self.scene.as_ref()?.tools.get(tool).map(|t| t.rpm)
    }

    /// Whether the spindle is held fast: under a load, below a tenth of its speed.
    fn stalled(&self) -> bool {
        let set = self.set_rpm().unwrap_or(0.0);
        self.pose
            .is_some_and(|p| p.spindle_on && p.spindle_load > 0.0 && p.spindle_rpm < 0.1 * set)
    }

    fn tools(&self) -> usize {
        self.scene.as_ref().map_or(0, |s| s.tools.len())
    }
}

/// What a person asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Wish {
    /// Something for the haptics process.
    Command(Command),
    /// Frame the whole bone.
    WholeBone,
    /// Look closely at the glenoid.
    Glenoid,
    /// Show or hide the tool.
    ToggleTool,
    /// Show the bone in another way.
    View(ViewChoice),
    /// Look from one of the usual places.
    LookFrom(Preset),
    /// A picture for each eye, or one.
    ToggleStereo,
    /// Show or hide the CT slices.
    ToggleSlices,
    /// Show or hide the plots.
    TogglePlots,
    /// Show these quantities.
    Plots([plots::Quantity; 2]),
    /// Save a picture of the window.
    SavePicture,
    /// Show or hide the help.
    ToggleHelp,
    /// Close the viewer.
    Quit,
}

/// Dark, with text of high contrast.
pub(crate) fn style(ctx: &egui::Context) {
    ctx.set_theme(egui::Theme::Dark);
    ctx.all_styles_mut(|style| {
        style.visuals.override_text_color = Some(Color32::from_rgb(0xee, 0xf1, 0xf4));
        style.visuals.panel_fill = Color32::from_rgb(0x16, 0x19, 0x1d);
        style.visuals.extreme_bg_color = Color32::from_rgb(0x0e, 0x10, 0x13);
        style.spacing.item_spacing = egui::vec2(6.0, 3.0);
        style
            .text_styles
            .insert(TextStyle::Body, FontId::proportional(13.0));
        style
            .text_styles
            .insert(TextStyle::Button, FontId::proportional(13.0));
        style
            .text_styles
            .insert(TextStyle::Monospace, FontId::monospace(12.0));
        style
            .text_styles
            .insert(TextStyle::Small, FontId::proportional(11.0));
    });
}

/// The column of facts and buttons.
pub(crate) fn facts(ui: &mut egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    egui::ScrollArea::vertical().show(ui, |ui| {
        connection::show(ui, status);
        control::show(ui, status, wishes);
        tool::show(ui, status, wishes);
        view::show(ui, status, wishes);
        hand::show(ui, status, wishes);
        bone::show(ui, status);
        guards::show(ui, status);
        rates::show(ui, status);
    });
}

/// A heading with a line under it.
fn heading(ui: &mut egui::Ui, text: &str) -> egui::Response {
    ui.add_space(3.0);
    let label = ui.label(
        RichText::new(text)
            .strong()
            .size(14.0)
            .color(Color32::from_rgb(0x8f, 0xc7, 0xff)),
    );
    ui.add(egui::Separator::default().spacing(3.0));
    label
}

/// Height of a row of facts, points: so that the usual ones fit into a window 800 high.
const ROW: f32 = 15.0;

/// A grid of names and values.
fn table(ui: &mut egui::Ui, name: &str, rows: impl FnOnce(&mut egui::Ui)) {
    egui::Grid::new(name)
        .num_columns(2)
        .min_col_width(74.0)
        .min_row_height(ROW)
        .spacing([8.0, 1.0])
        .show(ui, rows);
}

/// A row of [`table`]; a long value is cut and shown whole under the pointer.
fn row(ui: &mut egui::Ui, name: &str, value: impl Into<RichText>) {
    ui.label(RichText::new(name).color(Color32::from_gray(0xa8)));
    ui.add(egui::Label::new(value.into()).truncate());
    ui.end_row();
}

/// [`row`] with an explanation under the pointer.
fn row_with(ui: &mut egui::Ui, name: &str, value: impl Into<RichText>, tip: &str) {
    ui.label(RichText::new(name).color(Color32::from_gray(0xa8)))
        .on_hover_text(tip);
    ui.add(egui::Label::new(value.into()).truncate())
        .on_hover_text(tip);
    ui.end_row();
}

/// What the keys that were pressed ask for. `clutch`: whether its key is held, from frame to frame.
pub(crate) fn hotkeys(ctx: &egui::Context, status: &Status, clutch: &mut bool) -> Vec<Wish> {
    const DIGITS: [Key; 8] = [
        Key::Num1,
        Key::Num2,
        Key::Num3,
        Key::Num4,
        Key::Num5,
        Key::Num6,
        Key::Num7,
        Key::Num8,
    ];
    let mut wishes = Vec::new();
    ctx.input(|input| {
        for (tool, key) in (0u8..).zip(DIGITS) {
            if usize::from(tool) < status.tools() && input.key_pressed(key) {
                wishes.push(Wish::Command(Command::SelectTool(tool)));
            }
        }
        let plain = [
            (
                Key::S,
                Wish::Command(Command::Spindle(!status.spindle_on())),
            ),
            (Key::P, Wish::Command(Command::Pause(!status.paused()))),
            (Key::R, Wish::Command(Command::Reset)),
            (Key::K, Wish::Command(Command::Checkpoint)),
            (Key::U, Wish::Command(Command::Undo)),
            (Key::W, Wish::WholeBone),
            (Key::G, Wish::Glenoid),
            (Key::H, Wish::ToggleTool),
            (Key::V, Wish::View(status.view.with_next_method())),
            (Key::J, Wish::View(status.view.with_other_boxes())),
            (Key::X, Wish::View(status.view.with_other_ghost())),
            (Key::A, Wish::LookFrom(Preset::Surgeon)),
            (Key::L, Wish::LookFrom(Preset::Lateral)),
            (Key::E, Wish::LookFrom(Preset::Tool)),
            (Key::B, Wish::ToggleStereo),
            (Key::T, Wish::ToggleSlices),
            (Key::O, Wish::TogglePlots),
            (Key::F12, Wish::SavePicture),
            (Key::Questionmark, Wish::ToggleHelp),
            (Key::F1, Wish::ToggleHelp),
            (Key::Escape, Wish::Quit),
        ];
        let bare = !input.modifiers.command && !input.modifiers.alt;
        // let go with the key, and where the window loses the keyboard
        let held = bare && input.focused && input.key_down(Key::C);
        if held != *clutch {
            *clutch = held;
            wishes.push(Wish::Command(Command::Clutch(held)));
        }
        wishes.extend(
            plain
                .iter()
                .filter(|(k, _)| bare && input.key_pressed(*k))
                .map(|&(_, w)| w),
        );
        if input.modifiers.command && input.key_pressed(Key::Q) {
            wishes.push(Wish::Quit);
        }
    });
    wishes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::messages::{pose_at, scene};
    use glam::DVec3;
    use osteon_sim_core::bone::Bone;
    use osteon_sim_core::grid::Grid;
    use osteon_sim_core::pose::Pose;

    #[test]
    fn a_spindle_stalls_under_a_load_only() {
        let grid = Grid::new([32; 3], DVec3::ONE).unwrap();
        let bone = Bone::new(grid, Pose::IDENTITY);
        let mut status = Status {
            scene: Some(Arc::new(scene(&bone, &Pose::IDENTITY))),
            pose: Some(pose_at([0.0; 3])),
            ..Status::default()
        };
        assert_eq!(status.set_rpm(), Some(800.0));
        let mut stalls = |rpm, load, on| {
            status.pose = status.pose.map(|p| PoseUpdate {
                spindle_rpm: rpm,
                spindle_load: load,
                spindle_on: on,
                ..p
            });
            status.stalled()
        };
        assert!(stalls(79.0, 0.4, true));
        assert!(!stalls(81.0, 1.0, true), "slow, not stalled");
        assert!(!stalls(0.0, 0.0, true), "it begins to turn");
        assert!(!stalls(0.0, 0.4, false), "switched off");
    }

    /// One frame with these events.
    fn frame(
        ctx: &egui::Context,
        events: Vec<egui::Event>,
        focused: bool,
        held: &mut bool,
    ) -> Vec<Wish> {
        let input = egui::RawInput {
            events,
            focused,
            ..egui::RawInput::default()
        };
        let mut wishes = Vec::new();
        drop(ctx.run_ui(input, |ui| {
            wishes = hotkeys(ui.ctx(), &Status::default(), held);
        }));
        wishes
    }

    #[test]
    fn the_clutch_is_held_as_long_as_its_key() {
        let key = |pressed| egui::Event::Key {
            key: Key::C,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: egui::Modifiers::NONE,
        };
        let clutch = |hold| vec![Wish::Command(Command::Clutch(hold))];
        let ctx = egui::Context::default();
        let mut held = false;
        assert_eq!(frame(&ctx, vec![], true, &mut held), []);
        assert_eq!(frame(&ctx, vec![key(true)], true, &mut held), clutch(true));
        assert_eq!(
            frame(&ctx, vec![key(true)], true, &mut held),
            [],
            "a repeat"
        );
        assert_eq!(frame(&ctx, vec![], true, &mut held), []);
        assert_eq!(
            frame(&ctx, vec![key(false)], true, &mut held),
            clutch(false)
        );
        assert_eq!(frame(&ctx, vec![key(true)], true, &mut held), clutch(true));
        assert_eq!(
            frame(&ctx, vec![], false, &mut held),
            clutch(false),
            "another window"
        );
    }
}
