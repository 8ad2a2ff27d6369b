//! A static event over the chunk's edge.

use crate::report::carving::lineup::Kit;
use crate::report::carving::rows::Row;
use crate::report::plot::{Plot, Point};

/// Tables 3.3 and 3.4 as a plot.
pub(super) fn over_edge(kit: &Kit, rows: &[Row], theirs: [[f64; 3]; 3]) -> Plot {
    let mut plot = Plot::new(
        &format!("chunk-size-{}", kit.tool.id),
        &format!("Static event over the chunk's edge, {}", kit.tool.name),
        "Ours has one chunk size; the thesis's method grows with the voxels of the chunks that it scans.",
        ["chunk's edge, voxels", "time of the event, µs"],
    );
    for (edge, all) in [16, 32, 64].into_iter().zip(theirs.map(|t| t[2])) {
        plot.series("thesis, published")
            .push(Point::at(f64::from(edge), 1e3 * all));
        let name = format!("thesis-{edge}");
        for row in rows.iter().filter(|r| r.method == name) {
            plot.series("thesis, here")
                .push(Point::at(f64::from(edge), row.p50_us.unwrap_or(f64::NAN)));
        }
    }
    for row in rows.iter().filter(|r| !r.method.starts_with("thesis")) {
        plot.series(&row.method)
            .push(Point::at(32.0, row.p50_us.unwrap_or(f64::NAN)));
    }
    plot
}
