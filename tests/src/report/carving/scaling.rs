//! Time over the tool's diameter and over the bone's size.

use super::lineup::{self, Kit};
use super::output::{ROW_COLUMNS, row_cells};
use super::rows::{Case, Row, measure};
use super::{Output, tools};
use crate::report::plot::{Plot, Point};
use crate::report::table::Table;
use crate::scenes::bones::{self, BuiltBone, Plate};
use crate::scenes::press;
use anyhow::{Context as _, Result};
use glam::{DQuat, DVec2, DVec3};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Scaling");
    let first = out.rows.len();
    let diameters = over_diameter(out)?;
    let sizes = over_size(out)?;
    let mut table = Table::new(
        "scaling",
        "Scaling as a table",
        "`ball-D`: ball of diameter D pressed to its radius, at most 6 mm; `plate-N`: the reamer on a plate whose lattice has N million voxels.",
        &ROW_COLUMNS,
    );
    for row in &out.rows[first..] {
        table.push(row_cells(row));
    }
    out.plot(&diameters)?;
    out.plot(&sizes)?;
    out.table(&table)
}

/// A ball-nosed tool pressed into a block at 0.5 mm voxels: the time should go with the swept surface.
fn over_diameter(out: &mut Output) -> Result<Plot> {
    let h = if out.effort.quick { 1.5 } else { 0.5 };
    let built = bones::block(DVec3::new(70.0, 70.0, 16.0), DVec3::splat(h))?;
    let mut plot = Plot::new(
        "scaling-diameter",
        "Time over the tool's diameter, 0.5 mm voxels",
        "A ball-nosed tool pressed by its radius, at most 6 mm. The contact's area is 2πR·depth: it grows with the square of the \
         diameter up to 12 mm and in proportion beyond.",
        ["diameter, mm", "p50 of a contact event, µs"],
    );
    plot.slopes = vec![(1.0, "~ D".to_owned()), (2.0, "~ D²".to_owned())];
    for diameter in [2.0, 4.0, 8.0, 15.0, 30.0, 60.0] {
        let kit = Kit::new(tools::burr(diameter))?;
        let depth = (0.5 * diameter).min(6.0);
        let way =
            press::straight(depth, DVec2::new(0.03, -0.02), 200).placed(&built.bone_from_plan);
        let case = Case {
            scene: format!("ball-{diameter}"),
            bone: &built.bone,
            shape: kit.tool.shape.clone(),
            way: &way,
            errors: false,
        };
        for row in measure(&case, &out.effort, lineup::carvers(&built.bone, &kit)) {
            plot.series(&row.method).push(spread(diameter, &row));
            out.rows.push(row);
        }
    }
    Ok(plot)
}

/// The same press on plates whose lattice grows to a thousand million voxels.
fn over_size(out: &mut Output) -> Result<Plot> {
    let mut plot = Plot::new(
        "scaling-bone",
        "Time over the bone's size, 0.3 mm voxels",
        "The reamer's press on a plate 8 mm thick in a cubic lattice that grows; the cut stays the same, so must the time.",
        ["voxels of the lattice", "p50 of a contact event, µs"],
    );
    let edges: &[usize] = if out.effort.quick {
        &[64, 128]
    } else {
        &[160, 256, 512, 1000]
    };
    for &edge in edges {
        let built = plate(edge, if out.effort.quick { 0.8 } else { 0.3 })?;
        let kit = Kit::new(Tool::glenoid_reamer())?;
        let way = press::reamer_press()
            .thinned(400.min(out.effort.events))
            .placed(&built.bone_from_plan);
        let voxels = built.bone.grid().len();
        let case = Case {
            scene: format!("plate-{}", voxels / 1_000_000),
            bone: &built.bone,
            shape: kit.tool.shape.clone(),
            way: &way,
            errors: false,
        };
        for row in measure(&case, &out.effort, lineup::ours(&built.bone, &kit)) {
            plot.series(&row.method).push(spread(voxels as f64, &row));
            out.rows.push(row);
        }
    }
    Ok(plot)
}

/// A plate in the middle of a cubic lattice of `edge` voxels; its face lies at the same place inside a
/// chunk whatever the lattice's size.
fn plate(edge: usize, h: f64) -> Result<BuiltBone> {
    let grid = Grid::new([edge; 3], DVec3::splat(h)).context("a plate's lattice")?;
    // whole chunks and a bit
    let chunk = 32.0 * h;
    let middle = (0.5 * edge as f64 * h / chunk).floor() * chunk + 0.37 * h;
    let body = Plate {
        top: middle,
        thickness: 8.0,
    };
    let plan = Pose::new(DQuat::IDENTITY, DVec3::splat(middle));
    bones::build(grid, plan, &body)
}

/// Median with the worst event as its spread.
fn spread(x: f64, row: &Row) -> Point {
    let p50 = row.p50_us.unwrap_or(f64::NAN);
    Point {
        x,
        y: p50,
        band: Some([p50, row.max_us.unwrap_or(f64::NAN)]),
        failed: row.p50_us.is_none(),
    }
}
