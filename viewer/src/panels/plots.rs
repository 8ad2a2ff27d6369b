//! The last seconds of two quantities, each chosen from a list.

use super::{Status, Wish};
use crate::history::{PLOT_S, Point};
use crate::palette::{DEPTH, FAILURE, FORCE, GOOD, LOAD};
use egui::{Button, Color32, RichText};
use egui_plot::{HLine, Line, LineStyle, Plot, PlotPoints, PlotUi};

/// Height above the joint face that the depth plot shows, mm.
const MOST_AIR_MM: f64 = 8.0;
/// Depth that it shows, mm.
const MOST_DEPTH_MM: f64 = 40.0;

/// What a plot shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub(crate) enum Quantity {
    /// Force at the stylus, N.
    #[default]
    Force,
    /// Depth past the joint face, mm.
    Depth,
    /// Torque of the cut, N·mm.
    Torque,
    /// Speed along the planned axis, mm/s.
    Feed,
    /// Removed volume, mm³.
    Removed,
}

impl Quantity {
    /// All, in the order of their buttons.
    pub(crate) const ALL: [Self; 5] = [
        Self::Force,
        Self::Depth,
        Self::Torque,
        Self::Feed,
        Self::Removed,
    ];

    /// Name on a button.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Force => "force",
            Self::Depth => "depth",
            Self::Torque => "torque",
            Self::Feed => "feed",
            Self::Removed => "removed",
        }
    }

    fn of(self, p: &Point) -> f64 {
        match self {
            Self::Force => p.force_n,
            Self::Depth => p.depth_mm,
            Self::Torque => p.torque_nmm,
            Self::Feed => p.feed_mm_s,
            Self::Removed => p.removed_mm3,
        }
    }

    fn colour(self, status: &Status) -> Color32 {
        match self {
            Self::Force if status.saturated() => FAILURE,
            Self::Force => FORCE,
            Self::Depth => DEPTH,
            Self::Torque => Color32::from_rgb(0xd8, 0xa0, 0xff),
            Self::Feed => GOOD,
            Self::Removed => LOAD.gamma_multiply(1.4),
        }
    }

    /// The newest value in words.
    fn words(self, status: &Status) -> String {
        let value = status.points.last().map_or(0.0, |p| self.of(p));
        match self {
            Self::Force => {
                let limit = status.scene.as_ref().map_or(3.3, |s| s.force_limit_n);
                let real = status.pose.map_or(0.0, |p| p.physical_force_n);
                let mark = if status.saturated() {
                    "  AT THE LIMIT"
                } else {
                    ""
                };
                format!("{value:.2} of {limit:.1} N at the stylus ({real:.1} at a real tool){mark}")
            }
            Self::Depth => format!("{value:.2} mm past the joint face"),
            Self::Torque => format!("{value:.0} N·mm of the cut at a real tool"),
            Self::Feed => format!("{value:.1} mm/s along the planned axis"),
            Self::Removed => format!("{value:.1} mm³ since the last reset"),
        }
    }

    /// Least and largest value that the plot shows.
    fn range(self, status: &Status) -> (f64, f64) {
        let values = status.points.iter().map(|p| self.of(p));
        let (lo, hi) = values.fold((0.0_f64, 0.0_f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        let limit = status.scene.as_ref().map_or(3.3, |s| s.force_limit_n);
        match self {
            Self::Force => (-0.05 * limit, 1.15 * limit),
            // where bone can be, not the way through the air
            Self::Depth => (
                (lo - 1.0).max(-MOST_AIR_MM),
                (hi + 1.0).clamp(5.0, MOST_DEPTH_MM),
            ),
            Self::Torque => (-0.05 * hi.max(100.0), 1.15 * hi.max(100.0)),
            Self::Feed => ((lo - 1.0).clamp(-30.0, -5.0), (hi + 1.0).clamp(5.0, 30.0)),
            Self::Removed => (-0.05 * hi.max(10.0), 1.15 * hi.max(10.0)),
        }
    }
}

/// Shows both plots side by side.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status, wishes: &mut Vec<Wish>) {
    ui.columns_const(|sides: &mut [egui::Ui; 2]| {
        for (n, side) in sides.iter_mut().enumerate() {
            let shown = status.plots[n];
            side.horizontal(|ui| {
                for quantity in Quantity::ALL {
                    let button = Button::selectable(shown == quantity, quantity.name()).small();
                    if ui.add(button).clicked() && shown != quantity {
                        let mut plots = status.plots;
                        plots[n] = quantity;
                        wishes.push(Wish::Plots(plots));
                    }
                }
            });
            let colour = shown.colour(status);
            side.add(
                egui::Label::new(RichText::new(shown.words(status)).color(colour).strong())
                    .truncate(),
            );
            let points = series(status, |p| shown.of(p));
            let (lo, hi) = shown.range(status);
            plot(["left", "right"][n]).show(side, |plot| {
                frame(plot, lo, hi);
                match shown {
                    Quantity::Force => {
                        let limit = status.scene.as_ref().map_or(3.3, |s| s.force_limit_n);
                        let line = HLine::new("limit", limit).color(FAILURE);
                        plot.hline(line.style(LineStyle::dashed_loose()));
                    }
                    _ => plot.hline(HLine::new("zero", 0.0).color(Color32::from_gray(0x80))),
                }
                plot.line(Line::new(shown.name(), points).color(colour).width(1.5));
            });
        }
    });
}

fn plot(name: &'static str) -> Plot<'static> {
    Plot::new(name)
        .show_x(false)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .x_axis_formatter(|mark, _| format!("{:.0} s", mark.value))
}

/// The last seconds, and values from `lo` to `hi`.
fn frame(plot: &mut PlotUi<'_>, lo: f64, hi: f64) {
    plot.set_plot_bounds_x(-PLOT_S..=0.02 * PLOT_S);
    plot.set_plot_bounds_y(lo..=hi);
}

/// Points over seconds before now.
fn series(status: &Status, value: impl Fn(&Point) -> f64) -> PlotPoints<'static> {
    let now = status.points.last().map_or(0.0, |p| p.time_s);
    status
        .points
        .iter()
        .map(|p| [p.time_s - now, value(p)])
        .collect()
}
