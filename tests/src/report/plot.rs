//! Plots as SVG, each with its CSV beside it: log–log unless said. Axes and ticks are our own.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "pixels and a handful of series"
)]

mod axis;

pub use axis::Scale;

use super::table::Table;
use anyhow::{Context as _, Result, anyhow};
use axis::Axis;
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;

/// One setting of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Abscissa.
    pub x: f64,
    /// Ordinate.
    pub y: f64,
    /// Spread of the ordinate, if it was measured several times.
    pub band: Option<[f64; 2]>,
    /// A failure: drawn as a cross on the frame's upper edge where `y` is no number.
    pub failed: bool,
}

/// A series of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Its points, joined in this order.
    pub points: Vec<Point>,
}

/// A plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// File name without its ending.
    pub stem: String,
    /// Heading.
    pub title: String,
    /// What a reader must know to read it; may be empty.
    pub note: String,
    /// Axis labels, with units.
    pub axes: [String; 2],
    /// How the axes run.
    pub scales: [Scale; 2],
    /// Series.
    pub series: Vec<Series>,
    /// Faint lines y ~ x^slope with a label each, where both axes are logarithmic.
    pub slopes: Vec<(f64, String)>,
    /// Straight levels of y with a label each (a floor, a published figure).
    pub levels: Vec<(f64, String)>,
    /// Faint curves with a label each (a law beside the measured points).
    pub curves: Vec<(Vec<[f64; 2]>, String)>,
}

const SIZE: (u32, u32) = (860, 540);
const COLOURS: [RGBColor; 10] = [
    RGBColor(0, 90, 181),
    RGBColor(220, 50, 32),
    RGBColor(0, 128, 80),
    RGBColor(230, 140, 0),
    RGBColor(130, 60, 160),
    RGBColor(0, 160, 190),
    RGBColor(150, 90, 40),
    RGBColor(210, 70, 140),
    RGBColor(110, 110, 110),
    RGBColor(120, 150, 0),
];
const FAINT: RGBColor = RGBColor(150, 150, 150);

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Axis, Axis>>;

impl Point {
    /// A plain point.
    pub fn at(x: f64, y: f64) -> Self {
        Self {
            x,
            y,
            band: None,
            failed: false,
        }
    }

    /// The median of several measurements with their spread; a failure where there is none.
    pub fn median(x: f64, values: &[f64]) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let failed = sorted.len() < values.len() || sorted.is_empty();
        let band = match sorted.as_slice() {
            [] | [_] => None,
            [first, .., last] => Some([*first, *last]),
        };
        Self {
            x,
            y: sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN),
            band,
            failed,
        }
    }
}

impl Plot {
    /// An empty plot, log–log.
    pub fn new(stem: &str, title: &str, note: &str, axes: [&str; 2]) -> Self {
        Self {
            stem: stem.to_owned(),
            title: title.to_owned(),
            note: note.to_owned(),
            axes: axes.map(str::to_owned),
            scales: [Scale::Log; 2],
            series: Vec::new(),
            slopes: Vec::new(),
            levels: Vec::new(),
            curves: Vec::new(),
        }
    }

    /// The same plot on other axes.
    #[must_use]
    pub fn on(mut self, scales: [Scale; 2]) -> Self {
        self.scales = scales;
        self
    }

    /// The series that is called `name`, made if there is none.
    pub fn series(&mut self, name: &str) -> &mut Vec<Point> {
        let found = self.series.iter().position(|s| s.name == name);
        let at = found.unwrap_or_else(|| {
            self.series.push(Series {
                name: name.to_owned(),
                points: Vec::new(),
            });
            self.series.len() - 1
        });
        &mut self.series[at].points
    }

    /// The points as a table.
    pub fn table(&self) -> Table {
        let [x, y] = &self.axes;
        let mut table = Table::new(
            &self.stem,
            &self.title,
            &self.note,
            &["series", x, y, "low", "high", "failed"],
        );
        let text = |v: f64| {
            if v.is_finite() {
                format!("{v}")
            } else {
                String::new()
            }
        };
        for series in &self.series {
            for p in &series.points {
                let [low, high] = p.band.unwrap_or([f64::NAN; 2]);
                table.push([
                    series.name.clone(),
                    text(p.x),
                    text(p.y),
                    text(low),
                    text(high),
                    p.failed.to_string(),
                ]);
            }
        }
        table
    }

    /// Markdown that shows the picture.
    pub fn markdown(&self) -> String {
        format!(
            "### {0}\n\n![{0}]({1}.svg)\n\n{2} [CSV]({1}.csv)\n\n",
            self.title, self.stem, self.note
        )
    }

    /// Writes `STEM.csv` and, where there is something to draw, `STEM.svg` into a folder.
    pub fn write(&self, dir: &Path) -> Result<()> {
        self.table().write(dir)?;
        let path = dir.join(format!("{}.svg", self.stem));
        self.draw(&path)
            .with_context(|| format!("drawing {}", path.display()))
    }

    /// Ranges of the two axes.
    fn ranges(&self) -> [Range<f64>; 2] {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let curves = || self.curves.iter().flat_map(|c| &c.0);
        let bands = points().filter_map(|p| p.band).flatten();
        let levels = self.levels.iter().map(|l| l.0);
        let x = points().map(|p| p.x).chain(curves().map(|c| c[0]));
        let y = points().map(|p| p.y).chain(levels).chain(bands);
        // a law may leave the picture upwards
        [self.scales[0].range(x), self.scales[1].range(y)]
    }

    fn drawable(&self, x: f64, y: f64) -> bool {
        self.scales[0].holds(x) && self.scales[1].holds(y)
    }

    fn draw(&self, path: &Path) -> Result<()> {
        let root = SVGBackend::new(path, SIZE).into_drawing_area();
        root.fill(&WHITE).map_err(broken)?;
        let root = root
            .titled(&self.title, ("sans-serif", 18))
            .map_err(broken)?;
        let wide = SIZE.0 as i32 - 190;
        let (area, legend) = root.split_horizontally(wide);
        let [x, y] = self.ranges();
        let [across, up] = [(0, &x), (1, &y)].map(|(n, range)| Axis {
            scale: self.scales[n],
            range: range.clone(),
        });
        let mut chart = ChartBuilder::on(&area)
            .margin(10)
            .x_label_area_size(46)
            .y_label_area_size(66)
            .build_cartesian_2d(across, up)
            .map_err(broken)?;
        chart
            .configure_mesh()
            .x_desc(&self.axes[0])
            .y_desc(&self.axes[1])
            .axis_desc_style(("sans-serif", 14))
            .label_style(("sans-serif", 12))
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(225, 225, 225))
            .x_labels(12)
            .y_labels(12)
            .draw()
            .map_err(broken)?;
        self.guides(&mut chart, &x, &y)?;
        for (n, series) in self.series.iter().enumerate() {
            self.curve(&mut chart, series, n, y.end)?;
        }
        self.legend(&legend)?;
        root.present().map_err(broken)
    }

    /// Faint slopes and levels.
    fn guides(&self, chart: &mut Chart<'_, '_>, x: &Range<f64>, y: &Range<f64>) -> Result<()> {
        let middle = (
            self.scales[0].between(x, 0.5),
            self.scales[1].between(y, 0.5),
        );
        let mut line = |points: Vec<(f64, f64)>, label: &str| -> Result<()> {
            let inside = points.into_iter().filter(|(_, v)| y.contains(v));
            let inside: Vec<(f64, f64)> = inside.collect();
            let Some(&at) = inside.get(inside.len() / 12) else {
                return Ok(());
            };
            chart
                .draw_series(DashedLineSeries::new(inside, 5, 4, FAINT.stroke_width(1)))
                .map_err(broken)?;
            let text = Text::new(
                label.to_owned(),
                at,
                ("sans-serif", 11).into_font().color(&FAINT),
            );
            chart.draw_series(std::iter::once(text)).map_err(broken)?;
            Ok(())
        };
        let along = |f: &dyn Fn(f64) -> f64| {
            (0..=60)
                .map(|n| self.scales[0].between(x, f64::from(n) / 60.0))
                .map(|x| (x, f(x)))
                .collect::<Vec<_>>()
        };
        let powers = self.scales == [Scale::Log; 2];
        for (slope, label) in self.slopes.iter().filter(|_| powers) {
            line(along(&|x| middle.1 * (x / middle.0).powf(*slope)), label)?;
        }
        for (level, label) in &self.levels {
            line(along(&|_| *level), label)?;
        }
        for (curve, label) in &self.curves {
            let points = curve.iter().filter(|p| x.contains(&p[0]));
            line(points.map(|&[u, v]| (u, v)).collect(), label)?;
        }
        Ok(())
    }

    fn legend(&self, area: &Area<'_>) -> Result<()> {
        let style = ("sans-serif", 12).into_font().color(&BLACK);
        for (n, series) in self.series.iter().enumerate() {
            let (colour, y) = (COLOURS[n % COLOURS.len()], 24 + 20 * n as i32);
            area.draw(&PathElement::new(
                vec![(0, y), (22, y)],
                colour.stroke_width(2),
            ))
            .map_err(broken)?;
            let (size, form) = mark(n);
            area.draw(&Circle::new((11, y), size, form))
                .map_err(broken)?;
            area.draw(&Text::new(series.name.clone(), (30, y - 6), style.clone()))
                .map_err(broken)?;
        }
        Ok(())
    }
}

/// The mark of series `n`: a dot or one of two rings, so that equal points of several series all show.
fn mark(n: usize) -> (i32, ShapeStyle) {
    let colour = COLOURS[n % COLOURS.len()];
    match n % 3 {
        0 => (3, colour.filled()),
        1 => (5, colour.stroke_width(2)),
        _ => (8, colour.stroke_width(2)),
    }
}

impl Plot {
    /// Line, points, spread and failures of one series.
    fn curve(&self, chart: &mut Chart<'_, '_>, series: &Series, n: usize, top: f64) -> Result<()> {
        let colour = COLOURS[n % COLOURS.len()];
        let (size, style) = mark(n);
        let good = || {
            let points = series.points.iter();
            points.filter(|p| self.drawable(p.x, p.y))
        };
        chart
            .draw_series(LineSeries::new(
                good().map(|p| (p.x, p.y)),
                colour.stroke_width(2),
            ))
            .map_err(broken)?;
        chart
            .draw_series(good().map(|p| Circle::new((p.x, p.y), size, style)))
            .map_err(broken)?;
        let bands = good().filter_map(|p| {
            let [low, high] = p
                .band
                .filter(|b| b.iter().all(|v| self.scales[1].holds(*v)))?;
            Some(PathElement::new(
                vec![(p.x, low), (p.x, high)],
                colour.mix(0.5).stroke_width(1),
            ))
        });
        chart.draw_series(bands).map_err(broken)?;
        let points = series.points.iter();
        let failed = points.filter(|p| p.failed && self.scales[0].holds(p.x));
        chart
            .draw_series(failed.map(|p| {
                let y = if self.scales[1].holds(p.y) { p.y } else { top };
                Cross::new((p.x, y), 6, colour.stroke_width(2))
            }))
            .map_err(broken)?;
        Ok(())
    }
}

fn broken<E: std::fmt::Display>(e: E) -> anyhow::Error {
    anyhow!("{e}")
}

#[cfg(test)]
mod tests;
