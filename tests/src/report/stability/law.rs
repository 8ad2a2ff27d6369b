//! Does the tool cut as the law says, at any rate of the loop and in any direction?

use super::Output;
use crate::feel::feed::{FeedRow, LedgerRow, all_fed};
use crate::feel::peers::capped::{directions, side_row};
use crate::feel::rate::{RateRow, rate_rows};
use crate::feel::side::{SymmetryRow, symmetry_rows};
use crate::feel::tilt::{TiltRow, tilted};
use crate::report::plot::{Plot, Point, Scale};
use crate::report::table::{Table, percent, short};
use anyhow::Result;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Does it cut as its law says");
    out.stage("feed");
    let (feed, energy): (Vec<FeedRow>, Vec<LedgerRow>) = all_fed().into_iter().unzip();
    out.section("feed", &feed)?;
    out.plot(&feed_plot(&feed))?;
    out.table(&feed_table(&feed))?;
    out.section("energy", &energy)?;
    out.table(&energy_table(&energy))?;
    out.stage("rates");
    let rates = rate_rows();
    out.section("rate_invariance", &rates)?;
    out.table(&rates_table(&rates))?;
    out.stage("sides");
    let sides = symmetry_rows();
    out.section("symmetry", &sides)?;
    out.table(&sides_table(&sides))?;
    out.stage("tilt");
    let tilts: Vec<TiltRow> = [false, true].map(tilted).into();
    out.section("tilt", &tilts)?;
    out.table(&tilts_table(&tilts))
}

fn feed_plot(rows: &[FeedRow]) -> Plot {
    let mut plot = Plot::new(
        "feed_plot",
        "Feed under a constant push",
        "Dashed: the closed form v(F). Pushes below yield, where the tool stands, are not on a logarithmic axis.",
        ["push at a real tool, N", "feed, mm/s"],
    )
    .on([Scale::Linear, Scale::Log]);
    let mut name = String::new();
    for row in rows.iter().filter(|r| r.closed_form_mm_s > 0.0) {
        let this = format!("{}, {} g/cm³", row.tool, row.density);
        plot.series(&this)
            .push(Point::at(row.push_n_physical, row.feed_mm_s));
        let point = [row.push_n_physical, row.closed_form_mm_s];
        if name != this {
            plot.curves.push((Vec::new(), format!("v(F), {this}")));
            name = this;
        }
        if let Some((points, _)) = plot.curves.last_mut() {
            points.push(point);
        }
    }
    plot.curves.retain(|(points, _)| points.len() > 1);
    plot
}

fn feed_table(rows: &[FeedRow]) -> Table {
    let mut table = Table::new(
        "feed",
        "Feed under a constant push",
        "The whole face engaged. v(F) at the spindle's speed under that load.",
        &[
            "tool",
            "g/cm³",
            "push N",
            "feed mm/s",
            "v(F) mm/s",
            "off",
            "rad/s",
        ],
    );
    for row in rows {
        table.push([
            row.tool.clone(),
            short(Some(row.density)),
            short(Some(row.push_n_physical)),
            short(Some(row.feed_mm_s)),
            short(Some(row.closed_form_mm_s)),
            percent(Some(row.rel)),
            short(Some(row.omega_rad_s)),
        ]);
    }
    table
}

fn energy_table(rows: &[LedgerRow]) -> Table {
    let mut table = Table::new(
        "energy",
        "Energy of a cut",
        "*Hand*: the servo's sum over the elements beside the coupling's force times the proxy's way, mJ at the stylus. *Spindle*: torque times turn \
         beside u dV from the removed volume and the edges' friction, mJ at a real tool.",
        &[
            "tool",
            "g/cm³",
            "push N",
            "mm³",
            "hand",
            "force × way",
            "off",
            "spindle",
            "u dV",
            "edges",
            "off",
        ],
    );
    for row in rows {
        table.push([
            row.tool.clone(),
            short(Some(row.density)),
            short(Some(row.push_n_physical)),
            short(Some(row.removed_mm3)),
            short(Some(row.hand_mj)),
            short(Some(row.force_way_mj)),
            percent(Some(row.hand_rel)),
            short(Some(row.spindle_mj)),
            short(Some(row.cut_mj)),
            short(Some(row.edge_mj)),
            percent(Some(row.spindle_rel)),
        ]);
    }
    table
}

fn rates_table(rows: &[RateRow]) -> Table {
    let mut table = Table::new(
        "rate_invariance",
        "The same push at other rates of the loop",
        "The drill under 10 N (physical) for 0.5 s in bone of 0.45 g/cm³. What a cap a tick makes of the rate is shown below.",
        &["rate Hz", "removed mm³", "against 1 kHz"],
    );
    for row in rows {
        table.push([
            row.hz.to_string(),
            short(Some(row.removed_mm3)),
            percent(Some(row.rel_to_1khz)),
        ]);
    }
    table
}

fn sides_table(rows: &[SymmetryRow]) -> Table {
    let mut table = Table::new(
        "symmetry",
        "Side force of a symmetric plunge",
        "A ball of 3 mm plunged 1 mm deep; ours under 6 N (physical) into voxels of 0.5 mm, beside it the first ten voxels of a tick in the \
         order of memory.",
        &[
            "direction",
            "lateral/axial",
            "wobble/axial",
            "centroid off axis mm",
            "ten a tick: lateral/axial",
            "ten a tick: off axis mm",
        ],
    );
    for (row, direction) in rows.iter().zip(directions()) {
        let peer = side_row("ten a tick", 10, direction);
        let [x, y, z] = row.direction;
        table.push([
            format!("({x}, {y}, {z})"),
            percent(Some(row.lateral_over_axial)),
            percent(Some(row.wobble_over_axial)),
            short(Some(row.centroid_off_axis_mm)),
            percent(Some(peer.lateral_share)),
            short(Some(peer.off_axis_mm)),
        ]);
    }
    table
}

fn tilts_table(rows: &[TiltRow]) -> Table {
    let mut table = Table::new(
        "tilt",
        "Tilting an engaged reamer by 10°",
        "At 20°/s in bone of 0.3 g/cm³ (spindle off: 10 mm deep). *Law*: the tractions over the elements that move into bone. *Swept*: what the tool's \
         own way covers.",
        &[
            "spindle",
            "turned °",
            "torque N·m",
            "law N·m",
            "removed mm³",
            "swept mm³",
        ],
    );
    for row in rows {
        table.push([
            if row.spindle { "on" } else { "off" }.to_owned(),
            short(Some(row.turned_deg)),
            short(Some(row.torque_nm)),
            short(Some(row.law_nm)),
            short(Some(row.removed_mm3)),
            short(Some(row.swept_mm3)),
        ]);
    }
    table
}
