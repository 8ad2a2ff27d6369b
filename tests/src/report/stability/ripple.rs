//! Ripple while sliding over oblique planes, beside binary voxels.

use super::Output;
use crate::feel::peers::tangent;
use crate::feel::ripple::{RippleRow, TILTS_DEG, VOXELS_MM, slide};
use crate::report::plot::{Plot, Point, Scale};
use crate::report::table::{Table, percent, short};
use anyhow::Result;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Ripple while sliding");
    let mut rows = Vec::new();
    for voxel in VOXELS_MM {
        for tilt in TILTS_DEG {
            out.stage(&format!("{voxel} mm, {tilt}°"));
            rows.push(slide(voxel, tilt));
            rows.push(tangent::slide(voxel, tilt));
        }
    }
    out.section("ripple", &rows)?;
    let mut plot = Plot::new(
        "ripple_tilt",
        "Ripple of the normal force while sliding over an oblique plane",
        "Ball of 6 mm, 20 mm of way; standard deviation over mean.",
        ["tilt against the lattice, degrees", "ripple, %"],
    )
    .on([Scale::Linear, Scale::Log]);
    let mut table = Table::new(
        "ripple",
        "Ripple while sliding over an oblique plane",
        "Ball of 6 mm, 20 mm of way. Ours: the servo with fine encoders, the device 0.3 mm below the face; *exact* is the coupling's \
         stiffness times that. Binary: 1000 points, 0.3 mm deep; *exact* is the same points against the true plane.",
        &[
            "method",
            "voxel mm",
            "tilt °",
            "mean/exact",
            "normal, RMS",
            "normal, half of peak to peak",
            "tangential, RMS",
        ],
    );
    for row in &rows {
        let name = format!("{}, {} mm", row.rule, row.voxel_mm);
        plot.series(&name)
            .push(Point::at(row.tilt_deg, 100.0 * row.ripple_rms));
        table.push(cells(row));
    }
    plot.levels.push((1.0, "asked for".to_owned()));
    out.plot(&plot)?;
    out.table(&table)
}

fn cells(row: &RippleRow) -> [String; 7] {
    [
        row.rule.clone(),
        short(Some(row.voxel_mm)),
        short(Some(row.tilt_deg)),
        short(Some(row.mean_over_exact)),
        percent(Some(row.ripple_rms)),
        percent(Some(row.ripple_peak)),
        percent(Some(row.tangential_rms)),
    ]
}
