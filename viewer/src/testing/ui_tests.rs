//! Every control of the panels: found by its words, clicked, and what it asks for; and that each request
//! arrives on the wire.

use super::messages::{pose_at, scene};
use crate::camera::Preset;
use crate::panels::plots::Quantity;
use crate::panels::{self, Status, Wish};
use crate::render::look::{Colouring, Cutaway, ViewChoice};
use crate::render::method::Kind;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, RawInput, Rect, Shape, pos2};
use glam::DVec3;
use osteon_protocol::ipc::Command;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use std::sync::Arc;

/// The panels of a session, before an imagined pointer.
struct Bench {
    ctx: egui::Context,
    status: Status,
    clutch: bool,
    time: f64,
}

impl Bench {
    fn new() -> Self {
        let grid = Grid::new([32; 3], DVec3::ONE).unwrap();
        let bone = Bone::new(grid, Pose::IDENTITY);
        let ctx = egui::Context::default();
        panels::style(&ctx);
        Self {
            ctx,
            status: Status {
                scene: Some(Arc::new(scene(&bone, &Pose::IDENTITY))),
                pose: Some(pose_at([0.0; 3])),
                ..Status::default()
            },
            clutch: false,
            time: 0.0,
        }
    }

    /// One frame with these events: the wishes, and the words on the screen with their middles.
    fn frame(&mut self, events: Vec<Event>) -> (Vec<Wish>, Vec<(String, Pos2)>) {
        self.time += 0.05;
        let input = RawInput {
            screen_rect: Some(Rect::from_min_max(pos2(0.0, 0.0), pos2(900.0, 2400.0))),
            time: Some(self.time),
            events,
            focused: true,
            ..RawInput::default()
        };
        let mut wishes = Vec::new();
        let (status, clutch) = (self.status.clone(), &mut self.clutch);
        let output = self.ctx.run_ui(input, |ui| {
            // a frame may take a second pass, without events
            wishes.extend(panels::hotkeys(ui.ctx(), &status, clutch));
            egui::Panel::bottom("plots")
                .exact_size(190.0)
                .show(ui, |ui| {
                    panels::plots::show(ui, &status, &mut wishes);
                });
            panels::facts(ui, &status, &mut wishes);
            panels::overlay::show(ui, &status, &mut wishes);
        });
        let mut words = Vec::new();
        for clipped in &output.shapes {
            gather(&clipped.shape, &mut words);
        }
        (wishes, words)
    }

    /// Places of what reads `words`, in the order of drawing.
    fn places(&mut self, words: &str) -> Vec<Pos2> {
        // twice: sizes are known after the first frame
        self.frame(vec![]);
        let (_, found) = self.frame(vec![]);
        let places: Vec<Pos2> = found.iter().filter(|f| f.0 == words).map(|f| f.1).collect();
        let all: Vec<&String> = found.iter().map(|f| &f.0).collect();
        assert!(!places.is_empty(), "no '{words}' among {all:?}");
        places
    }

    /// Clicks what first reads `words`; what the click asked for.
    fn click(&mut self, words: &str) -> Vec<Wish> {
        let at = self.places(words)[0];
        self.click_at(at)
    }

    /// Clicks one of the two lowest that read `words`, from the left.
    fn click_lowest(&mut self, words: &str, n: usize) -> Vec<Wish> {
        let mut places = self.places(words);
        places.sort_by(|a, b| b.y.total_cmp(&a.y));
        places.truncate(2);
        places.sort_by(|a, b| a.x.total_cmp(&b.x));
        self.click_at(places[n])
    }

    fn click_at(&mut self, at: Pos2) -> Vec<Wish> {
        let button = |pressed| Event::PointerButton {
            pos: at,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        let mut all = self.frame(vec![Event::PointerMoved(at)]).0;
        all.extend(self.frame(vec![button(true)]).0);
        all.extend(self.frame(vec![button(false)]).0);
        all.extend(self.frame(vec![Event::PointerGone]).0);
        all
    }

    /// Presses and lets go of a key.
    fn press(&mut self, key: Key) -> Vec<Wish> {
        let event = |pressed| Event::Key {
            key,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        let mut all = self.frame(vec![event(true)]).0;
        all.extend(self.frame(vec![event(false)]).0);
        all
    }
}

fn gather(shape: &Shape, words: &mut Vec<(String, Pos2)>) {
    match shape {
        Shape::Text(text) => {
            let middle = text.pos + text.galley.rect.center().to_vec2();
            words.push((text.galley.text().to_owned(), middle));
        }
        Shape::Vec(all) => {
            for shape in all {
                gather(shape, words);
            }
        }
        _ => {}
    }
}

/// What every button with a command reads and asks for, in the state of [`Bench::new`].
const COMMANDS: [(&str, Command); 10] = [
    ("1  peg drill", Command::SelectTool(0)),
    ("2  glenoid reamer", Command::SelectTool(1)),
    ("S  spindle on", Command::Spindle(false)),
    ("P  pause", Command::Pause(true)),
    ("R  reset bone", Command::Reset),
    ("K  keep bone", Command::Checkpoint),
    ("stop session", Command::Stop),
    ("C  clutch", Command::Clutch(true)),
    ("turn +15°", Command::TurnWorkspace(262)),
    ("turn −15°", Command::TurnWorkspace(-262)),
];

#[test]
fn every_button_asks_for_what_it_reads() {
    let mut bench = Bench::new();
    for (words, command) in COMMANDS {
        assert_eq!(bench.click(words), [Wish::Command(command)], "{words}");
    }
    for (words, wish) in [
        ("W  whole bone", Wish::WholeBone),
        ("G  glenoid", Wish::Glenoid),
        ("A  surgeon", Wish::LookFrom(Preset::Surgeon)),
        ("L  lateral", Wish::LookFrom(Preset::Lateral)),
        ("E  along tool", Wish::LookFrom(Preset::Tool)),
        ("H  hide tool", Wish::ToggleTool),
        ("?  help", Wish::ToggleHelp),
    ] {
        assert_eq!(bench.click(words), [wish], "{words}");
    }
}

#[test]
fn every_choice_of_the_view_changes_that_alone() {
    let mut bench = Bench::new();
    let usual = ViewChoice::default();
    for kind in Kind::ALL.into_iter().filter(|k| *k != usual.method) {
        let wanted = ViewChoice {
            method: kind,
            ..usual
        };
        assert_eq!(bench.click(kind.name()), [Wish::View(wanted)]);
    }
    for colouring in Colouring::ALL.into_iter().filter(|c| *c != usual.colouring) {
        let wanted = ViewChoice { colouring, ..usual };
        assert_eq!(bench.click(colouring.name()), [Wish::View(wanted)]);
    }
    for cutaway in Cutaway::ALL.into_iter().filter(|c| *c != usual.cutaway) {
        let wanted = ViewChoice { cutaway, ..usual };
        assert_eq!(bench.click(cutaway.name()), [Wish::View(wanted)]);
    }
    let ghost = ViewChoice {
        ghost: true,
        ..usual
    };
    assert_eq!(
        bench.click("tool shows through bone (X)"),
        [Wish::View(ghost)]
    );
}

#[test]
fn every_quantity_can_be_plotted() {
    let mut bench = Bench::new();
    for quantity in Quantity::ALL.into_iter().skip(1) {
        let (left, right) = ([quantity, Quantity::Force], [Quantity::Force, quantity]);
        // both lie below all panels
        assert_eq!(bench.click_lowest(quantity.name(), 0), [Wish::Plots(left)]);
        assert_eq!(bench.click_lowest(quantity.name(), 1), [Wish::Plots(right)]);
    }
}

#[test]
fn every_key_asks_for_what_the_help_says() {
    let mut bench = Bench::new();
    let usual = ViewChoice::default();
    let view = |view| vec![Wish::View(view)];
    for (key, wishes) in [
        (Key::Num1, vec![Wish::Command(Command::SelectTool(0))]),
        (Key::Num2, vec![Wish::Command(Command::SelectTool(1))]),
        // no third tool
        (Key::Num3, vec![]),
        (Key::S, vec![Wish::Command(Command::Spindle(false))]),
        (Key::P, vec![Wish::Command(Command::Pause(true))]),
        (Key::R, vec![Wish::Command(Command::Reset)]),
        (Key::K, vec![Wish::Command(Command::Checkpoint)]),
        (
            Key::C,
            vec![
                Wish::Command(Command::Clutch(true)),
                Wish::Command(Command::Clutch(false)),
            ],
        ),
        (Key::W, vec![Wish::WholeBone]),
        (Key::G, vec![Wish::Glenoid]),
        (Key::H, vec![Wish::ToggleTool]),
        (Key::V, view(usual.with_next_method())),
        (Key::X, view(usual.with_other_ghost())),
        (Key::J, view(usual.with_other_boxes())),
        (Key::A, vec![Wish::LookFrom(Preset::Surgeon)]),
        (Key::L, vec![Wish::LookFrom(Preset::Lateral)]),
        (Key::E, vec![Wish::LookFrom(Preset::Tool)]),
        (Key::B, vec![Wish::ToggleStereo]),
        (Key::T, vec![Wish::ToggleSlices]),
        (Key::O, vec![Wish::TogglePlots]),
        (Key::F12, vec![Wish::SavePicture]),
        (Key::F1, vec![Wish::ToggleHelp]),
        (Key::Escape, vec![Wish::Quit]),
    ] {
        assert_eq!(bench.press(key), wishes, "{key:?}");
    }
}

#[test]
fn empty_states_have_words() {
    let mut bench = Bench::new();
    bench.status = Status::default();
    bench.frame(vec![]);
    let (wishes, words) = bench.frame(vec![]);
    assert_eq!(wishes, []);
    let all: Vec<&str> = words.iter().map(|w| w.0.as_str()).collect();
    assert!(
        all.contains(&"waiting for the haptics process to send its scene"),
        "{all:?}"
    );
    assert!(all.contains(&"none yet"), "{all:?}");
}

#[test]
fn every_command_of_a_button_arrives_on_the_wire() {
    let wanted: Vec<Command> = COMMANDS.iter().map(|c| c.1).collect();
    super::link_tests::arrive(&wanted);
}
