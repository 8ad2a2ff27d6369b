//! Hand and workspace: clutch, motion scale, turn about the line of sight.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a scale in thousandths is within its documented range"
)]

use super::{Status, Wish, heading};
use egui::{Button, RichText, Slider};
use osteon_protocol::ipc::{Command, MOTION_SCALE_MILLI};

/// A turn of the workspace by 15°, thousandths of a radian.
const TURN: i16 = 262;

const CLUTCH: &str = "Hold C, or click here: the tool waits where it is while the stylus goes to a better \
    place, as a lifted mouse does. There is no force meanwhile; afterwards it rises from zero.";
const SCALE: &str = "Millimetres of the tool per millimetre of the stylus. Below 1 the hand works finer, above 1 \
    it reaches further; the wall feels as stiff as before to the tool, not to the hand. The tool stays \
    where it is.";

/// Shows the panel.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    heading(ui, "Hand and workspace");
    let Some(pose) = status.pose else {
        ui.label("none yet");
        return;
    };
    ui.horizontal(|ui| {
        let clutch = if pose.clutched {
            "C  clutch held"
        } else {
            "C  clutch"
        };
        let clutch = ui.add(Button::selectable(pose.clutched, clutch));
        if clutch.on_hover_text(CLUTCH).clicked() {
            wishes.push(Wish::Command(Command::Clutch(!pose.clutched)));
        }
        for (text, turn, way) in [("turn +15°", TURN, "up"), ("turn −15°", -TURN, "down")] {
            let tip = format!(
                "Turns the workspace about your line of sight: a hand that goes to the right then moves \
                 the tool to the right and a little {way}. The tool stays where it is."
            );
            if ui.button(text).on_hover_text(tip).clicked() {
                wishes.push(Wish::Command(Command::TurnWorkspace(turn)));
            }
        }
    });
    let now = milli(f64::from(pose.motion_scale));
    let mut scale = f64::from(now) / 1000.0;
    ui.horizontal(|ui| {
        ui.label(RichText::new("motion scale").color(egui::Color32::from_gray(0xa8)));
        let [least, most] =
            [MOTION_SCALE_MILLI.start(), MOTION_SCALE_MILLI.end()].map(|m| f64::from(*m) / 1000.0);
        // without a field for digits: those choose tools
        let slider = Slider::new(&mut scale, least..=most)
            .logarithmic(true)
            .show_value(false);
        let moved = ui.add(slider).on_hover_text(SCALE).changed();
        ui.label(format!("{scale:.2}"));
        let one = ui.small_button("1:1").on_hover_text(SCALE).clicked();
        let wanted = if one { 1000 } else { milli(scale) };
        if (moved || one) && wanted != now {
            wishes.push(Wish::Command(Command::MotionScale(wanted)));
        }
    });
}

/// A scale in thousandths, within the range that can be asked for.
fn milli(scale: f64) -> u16 {
    let [least, most] =
        [MOTION_SCALE_MILLI.start(), MOTION_SCALE_MILLI.end()].map(|m| f64::from(*m));
    (scale * 1000.0).round().clamp(least, most) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_is_asked_for_within_its_range() {
        assert_eq!(
            [0.0, 0.2, 1.0, 1.2345, 5.0, 9.0, f64::NAN].map(milli),
            [200, 200, 1000, 1235, 5000, 5000, 0]
        );
    }
}
