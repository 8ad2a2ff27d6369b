//! Work–precision (physics.md, section 6): time per event against error.

use super::lineup::{self, Kit};
use super::output::{ROW_COLUMNS, row_cells};
use super::rows::{Case, Row, measure};
use super::{Output, tools};
use crate::report::plot::{Plot, Point};
use crate::report::table::Table;
use crate::scenes::bones;
use crate::scenes::press::{self, Trajectory};
use anyhow::Result;
use glam::{DVec2, DVec3};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::collections::BTreeMap;

/// The block that accuracy is measured in, mm.
const BLOCK: DVec3 = DVec3::new(46.0, 46.0, 18.0);
/// Leans of the tool against the lattice, rad; the first is the aligned worst case.
const LEANS: [DVec2; 3] = [DVec2::ZERO, DVec2::new(0.11, 0.07), DVec2::new(-0.19, 0.23)];
/// Shifts of the plan against the lattice, voxels.
const SHIFTS: [DVec3; 3] = [
    DVec3::ZERO,
    DVec3::new(0.31, 0.17, 0.0),
    DVec3::new(0.73, 0.59, 0.0),
];

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Work and precision");
    over_voxels(out)?;
    over_tool_cells(out)?;
    over_sub_steps(out)
}

/// P1 and P3: the reamer pressed 5 mm into a block, over voxel size.
fn over_voxels(out: &mut Output) -> Result<()> {
    let sizes: &[f64] = if out.effort.quick {
        &[2.0, 1.0]
    } else {
        &[2.0, 1.0, 0.5, 0.25, 0.125]
    };
    let mut rows: Vec<(f64, Row)> = Vec::new();
    for &h in sizes {
        for row in pressed(
            out,
            DVec3::splat(h),
            &Kit::new(Tool::glenoid_reamer())?,
            true,
        )? {
            rows.push((h, row));
        }
    }
    // the thesis's own lattice
    let thesis = DVec3::new(0.47, 0.47, 1.0);
    for row in pressed(out, thesis, &Kit::new(Tool::glenoid_reamer())?, true)? {
        out.rows.push(row);
    }
    let [mut surface, mut volume, mut order] = voxel_plots();
    for ((method, _), group) in &grouped(&rows) {
        let p50 = middle(group, |r| r.p50_us);
        surface
            .series(method)
            .push(Point::at(middle(group, |r| r.surface_rms_um), p50));
        volume.series(method).push(Point::at(
            middle(group, |r| r.volume_rel_err.map(f64::abs)),
            p50,
        ));
        let errors: Vec<f64> = group
            .iter()
            .map(|r| r.surface_rms_um.unwrap_or(f64::NAN))
            .collect();
        order
            .series(method)
            .push(Point::median(group[0].voxel_mm, &errors));
    }
    out.rows.extend(rows.into_iter().map(|(_, row)| row));
    let table = table_of(
        out,
        "precision",
        "Reamer pressed 5 mm into a block",
        "block-reamer",
    );
    out.table(&table)?;
    out.plot(&surface)?;
    out.plot(&volume)?;
    out.plot(&order)
}

/// The empty plots over voxel size.
fn voxel_plots() -> [Plot; 3] {
    let mut surface = Plot::new(
        "precision-surface",
        "Time against the surface's error, over voxel size",
        "One point a voxel size (2, 1, 0.5, 0.25, 0.125 mm), the same run timed and measured; median and spread over \
         offsets against the lattice. Halving the error of a second-order surface method costs h⁻² work, so time \
         goes with error⁻¹; of a first-order volume method error⁻³.",
        ["surface RMS, µm", "p50 of a contact event, µs"],
    );
    surface.slopes = vec![
        (-1.0, "2nd order, surface".to_owned()),
        (-3.0, "1st order, volume".to_owned()),
    ];
    let volume = Plot::new(
        "precision-volume",
        "Time against the volume's error, over voxel size",
        "The same runs. Volume alone flatters methods of whole voxels: errors cancel over a curved cut.",
        ["relative error of the volume", "p50 of a contact event, µs"],
    );
    let mut order = Plot::new(
        "precision-order",
        "Surface error over voxel size",
        "The same runs. Theory for a trilinear field without curvature correction: bias h²/(6 R).",
        ["voxel, mm", "surface RMS, µm"],
    );
    order.slopes = vec![(1.0, "1st order".to_owned()), (2.0, "2nd order".to_owned())];
    [surface, volume, order]
}

/// Rows by method and voxel size, largest first, in a fixed order.
fn grouped(rows: &[(f64, Row)]) -> BTreeMap<(String, i64), Vec<&Row>> {
    let mut groups: BTreeMap<(String, i64), Vec<&Row>> = BTreeMap::new();
    for (h, row) in rows {
        #[expect(clippy::cast_possible_truncation, reason = "a voxel's edge in µm")]
        let key = (row.method.clone(), -(1e3 * h).round() as i64);
        groups.entry(key).or_default().push(row);
    }
    groups
}

fn middle(rows: &[&Row], value: impl Fn(&Row) -> Option<f64>) -> f64 {
    let values: Vec<f64> = rows.iter().map(|r| value(r).unwrap_or(f64::NAN)).collect();
    Point::median(0.0, &values).y
}

/// The press at each offset; scenes `block-reamer-H-N`.
fn pressed(out: &Output, spacing: DVec3, kit: &Kit, all: bool) -> Result<Vec<Row>> {
    let built = bones::block(BLOCK, spacing)?;
    let mut rows = Vec::new();
    for n in 0..out.effort.offsets as usize {
        let shift = Pose::new(glam::DQuat::IDENTITY, SHIFTS[n] * spacing);
        let way = press::straight(5.0, LEANS[n], 150).placed(&shift.then(&built.bone_from_plan));
        let case = Case {
            scene: format!("block-reamer-{}-{n}", name(spacing)),
            bone: &built.bone,
            shape: kit.tool.shape.clone(),
            way: &way,
            errors: true,
        };
        let carvers = if all {
            lineup::carvers(&built.bone, kit)
        } else {
            lineup::sampled(&built.bone, kit)
        };
        rows.extend(measure(&case, &out.effort, carvers));
    }
    Ok(rows)
}

fn name(h: DVec3) -> String {
    #[expect(clippy::float_cmp, reason = "equal by construction")]
    let cube = h.x == h.z;
    if cube {
        format!("{}", h.x)
    } else {
        format!("{}x{}x{}", h.x, h.y, h.z)
    }
}

fn table_of(out: &Output, stem: &str, title: &str, scene: &str) -> Table {
    let mut table = Table::new(stem, title, "", &ROW_COLUMNS);
    for row in out.rows.iter().filter(|r| r.scene.starts_with(scene)) {
        table.push(row_cells(row));
    }
    table
}

/// P2: methods that sample the tool, over the size of its cells, at 0.5 mm voxels.
fn over_tool_cells(out: &mut Output) -> Result<()> {
    let cells: &[f64] = if out.effort.quick {
        &[1.0]
    } else {
        &[1.0, 0.5, 0.25, 0.125]
    };
    let mut plot = Plot::new(
        "precision-tool",
        "Time against the surface's error, over the tool's resolution, 0.5 mm voxels",
        "Methods that sample the tool in cells of 1, 0.5, 0.25 and 0.125 mm. The exact tool's point is what it is \
         compared with.",
        ["surface RMS, µm", "p50 of a contact event, µs"],
    );
    let h = DVec3::splat(if out.effort.quick { 1.0 } else { 0.5 });
    let mut rows = Vec::new();
    for &cell in cells {
        let kit = Kit::with_cells(Tool::glenoid_reamer(), cell)?;
        for mut row in pressed(out, h, &kit, false)? {
            row.scene = format!("{}-cell-{cell}", row.scene);
            plot.series(&row.method).push(point(&row));
            rows.push(row);
        }
    }
    let built = bones::block(BLOCK, h)?;
    let kit = Kit::new(Tool::glenoid_reamer())?;
    let way = press::straight(5.0, LEANS[0], 150).placed(&built.bone_from_plan);
    let case = Case {
        scene: "block-reamer-exact-tool".to_owned(),
        bone: &built.bone,
        shape: kit.tool.shape.clone(),
        way: &way,
        errors: true,
    };
    for row in measure(&case, &out.effort, lineup::ours(&built.bone, &kit)) {
        plot.series(&format!("{} (exact tool)", row.method))
            .push(point(&row));
        rows.push(row);
    }
    out.rows.extend(rows);
    out.plot(&plot)
}

fn point(row: &Row) -> Point {
    Point {
        x: row.surface_rms_um.unwrap_or(f64::NAN),
        y: row.p50_us.unwrap_or(f64::NAN),
        band: None,
        failed: row.surface_rms_um.is_none() || row.surface_lost > 0,
    }
}

/// P4: a ball burr drawn 20 mm through a block with one stamp every s mm, and the kernel's own rule.
fn over_sub_steps(out: &mut Output) -> Result<()> {
    let built = bones::block(
        DVec3::new(40.0, 24.0, 16.0),
        DVec3::splat(if out.effort.quick { 1.0 } else { 0.25 }),
    )?;
    let kit = Kit::new(tools::burr(12.0))?;
    let mut plot = Plot::new(
        "precision-steps",
        "Ball burr Ø 12 mm over 20 mm: scallops against time, over the sub-step",
        "One stamp every 2, 1, 0.5, 0.25, 0.125 and 0.0625 mm; beside it the kernel's own rule for steps of 2 mm. \
         Theory: scallops s²/(8 R). The floor is that of the field.",
        ["time of the whole stroke, µs", "surface max, µm"],
    );
    let own = measure_stroke(out, (&built, &kit), 2.0, true);
    plot.series("osteon, own rule").push(own.1);
    let mut rows = vec![own.0];
    for s in [2.0, 1.0, 0.5, 0.25, 0.125, 0.0625] {
        let (row, point) = measure_stroke(out, (&built, &kit), s, false);
        plot.series("one stamp every s mm").push(point);
        rows.push(row);
    }
    out.rows.extend(rows);
    let table = table_of(
        out,
        "precision-steps-rows",
        "The same as a table",
        "stroke-",
    );
    out.plot(&plot)?;
    out.table(&table)
}

fn measure_stroke(
    out: &Output,
    (built, kit): (&bones::BuiltBone, &Kit),
    step: f64,
    own: bool,
) -> (Row, Point) {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "10 to 320 steps"
    )]
    let events = (20.0 / step).round() as u32;
    // the first event stamps where the stroke begins
    let poses = std::iter::once(0)
        .chain(0..=events)
        .map(|n| {
            let x = 20.0 * f64::from(n) / f64::from(events) - 10.0;
            Pose::new(glam::DQuat::IDENTITY, DVec3::new(x, 0.013 * x, -4.0))
        })
        .collect();
    let way = Trajectory {
        name: "stroke",
        poses,
    }
    .placed(&built.bone_from_plan);
    let carver = if own {
        lineup::ours(&built.bone, kit)
    } else {
        vec![lineup::stamping(&built.bone, kit)]
    };
    let case = Case {
        scene: format!("stroke-{step}"),
        bone: &built.bone,
        shape: kit.tool.shape.clone(),
        way: &way,
        errors: true,
    };
    let row = measure(&case, &out.effort, carver).swap_remove(0);
    let total = row.mean_us.unwrap_or(f64::NAN) * row.events as f64;
    let point = Point {
        x: total,
        y: row.surface_max_um.unwrap_or(f64::NAN),
        band: None,
        failed: row.surface_lost > 0 || row.surface_max_um.is_none(),
    };
    (row, point)
}
