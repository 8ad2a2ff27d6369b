//! Force and depth of the last seconds.

use super::Status;
use crate::history::PLOT_S;
use crate::palette::{DEPTH, FAILURE, FORCE};
use egui::{Color32, RichText};
use egui_plot::{HLine, Line, LineStyle, Plot, PlotPoints, PlotUi};

/// Height above the joint face that the depth plot shows, mm.
const MOST_AIR_MM: f64 = 8.0;
/// Depth that it shows, mm.
const MOST_DEPTH_MM: f64 = 40.0;

/// Shows both plots side by side.
pub(crate) fn show(ui: &mut egui::Ui, status: &Status) {
    let newest = status.points.last();
    let limit = status.scene.as_ref().map_or(3.3, |s| s.force_limit_n);
    ui.columns_const(|[left, right]| {
        let force = newest.map_or(0.0, |p| p.force_n);
        let real = status.pose.map_or(0.0, |p| p.physical_force_n);
        let mark = if status.saturated() {
            "  AT THE LIMIT"
        } else {
            ""
        };
        title(
            left,
            &format!(
                "Force at the stylus, N: {force:.2} of {limit:.1} ({real:.1} at a real tool){mark}"
            ),
            if status.saturated() { FAILURE } else { FORCE },
        );
        let points = series(status, |p| p.force_n);
        plot("force").show(left, |plot| {
            frame(plot, -0.05 * limit, 1.15 * limit);
            let line = HLine::new("limit", limit)
                .color(FAILURE)
                .style(LineStyle::dashed_loose());
            plot.hline(line);
            plot.line(Line::new("force", points).color(FORCE).width(1.5));
        });
        let depth = newest.map_or(0.0, |p| p.depth_mm);
        title(
            right,
            &format!("Depth past the joint face, mm: {depth:.2}"),
            DEPTH,
        );
        let points = series(status, |p| p.depth_mm);
        let (lo, hi) = range(status);
        plot("depth").show(right, |plot| {
            frame(plot, lo, hi);
            plot.hline(HLine::new("joint face", 0.0).color(Color32::from_gray(0x80)));
            plot.line(Line::new("depth", points).color(DEPTH).width(1.5));
        });
    });
}

fn title(ui: &mut egui::Ui, text: &str, colour: Color32) {
    ui.label(RichText::new(text).color(colour).strong());
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
fn series(status: &Status, value: impl Fn(&crate::history::Point) -> f64) -> PlotPoints<'static> {
    let now = status.points.last().map_or(0.0, |p| p.time_s);
    status
        .points
        .iter()
        .map(|p| [p.time_s - now, value(p)])
        .collect()
}

/// Depths to show: where bone can be, not the way through the air.
fn range(status: &Status) -> (f64, f64) {
    let depths = status.points.iter().map(|p| p.depth_mm);
    let (lo, hi) = depths.fold((0.0_f64, 0.0_f64), |(lo, hi), d| (lo.min(d), hi.max(d)));
    (
        (lo - 1.0).max(-MOST_AIR_MM),
        (hi + 1.0).clamp(5.0, MOST_DEPTH_MM),
    )
}
