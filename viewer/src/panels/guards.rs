//! Guards of the force loop: how often each had to act, and when last.

use super::{ROW, Status, heading};
use crate::palette::{GOOD, WARNING};
use egui::{Color32, Grid, RichText};
use osteon_protocol::ipc::GuardCount;

/// Servo ticks a second.
const TICKS_PER_S: f64 = 1000.0;
/// An intervention is recent for this long, s.
const RECENT_S: f64 = 1.0;

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status) {
    heading(ui, "Guards").on_hover_text(
        "What stood between the force that was computed and your hand. A few clamps and slews are \
         daily bread; overruns, unsolved contacts and refused samples should stay rare.",
    );
    let Some(health) = &status.health else {
        ui.label("no word yet");
        return;
    };
    let acted: Vec<&GuardCount> = health.guards.iter().filter(|g| g.count > 0).collect();
    if acted.is_empty() {
        ui.label(RichText::new("none had to act").color(GOOD));
        return;
    }
    let columns = Grid::new("guards").num_columns(3).min_row_height(ROW);
    columns.spacing([12.0, 1.0]).show(ui, |ui| {
        for guard in acted {
            let since = health.ticks.saturating_sub(guard.last_tick) as f64 / TICKS_PER_S;
            let colour = if since < RECENT_S {
                WARNING
            } else {
                Color32::from_gray(0xa8)
            };
            let tip = explain(&guard.name);
            let ago = format!("{} ago", brief(since));
            for text in [
                RichText::new(&guard.name).color(Color32::from_gray(0xa8)),
                RichText::new(format!("{} ticks", guard.count)),
                RichText::new(ago).color(colour),
            ] {
                ui.label(text).on_hover_text(tip);
            }
            ui.end_row();
        }
    });
}

/// A time, short.
fn brief(seconds: f64) -> String {
    if seconds < 10.0 {
        format!("{seconds:.1} s")
    } else if seconds < 600.0 {
        format!("{seconds:.0} s")
    } else {
        format!("{:.0} min", seconds / 60.0)
    }
}

/// What a guard does, for people.
fn explain(name: &str) -> &'static str {
    match name {
        "implausible sample" => {
            "A sample of the device was refused: no hand can have moved so. A bad cable does this."
        }
        "not a number" => "A value that is no number became zero.",
        "embedded" => {
            "The tool appeared inside bone, after a reset or a change of tool: no force until it is pulled free."
        }
        "overrun" => {
            "The tool did not get as far as the hand within a tick; it went on in the next."
        }
        "unsolved" => "The contact was solved less exactly than promised.",
        "passivity" => {
            "The loop had given the hand energy that it did not have; damping took it back."
        }
        "clamp" => {
            "The force reached its limit; the whole vector is shortened, so its direction stays."
        }
        "slew" => "The force rose faster than a hand should feel it and was slowed down.",
        "thermal" => "The motors are hot: what they may give for long is less than at once.",
        "hold" => "Samples were missing: the last force was held for a moment, then reduced.",
        _ => "A guard of the force loop.",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osteon_sim_core::chain::Guard;

    #[test]
    fn every_guard_is_explained() {
        for guard in Guard::ALL {
            assert_ne!(explain(guard.name()), explain(""), "{}", guard.name());
        }
    }

    #[test]
    fn times_are_short() {
        assert_eq!(
            [0.26, 42.4, 660.0].map(brief),
            ["0.3 s", "42 s", "11 min"].map(str::to_owned)
        );
    }
}
