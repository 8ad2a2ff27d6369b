//! What each part of the model costs, and the error that it removes.

use super::Output;
use super::lineup::{self, Carvers, Kit};
use super::rows::{Case, Row, measure};
use crate::report::table::{Table, percent, short};
use crate::scenes::bones;
use crate::scenes::press::{self, Trajectory};
use anyhow::Result;
use glam::{DVec2, DVec3};
use osteon_sim_core::tool::Tool;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## What each part of the model costs and what it buys");
    let h = if out.effort.quick { 1.2 } else { 0.47 };
    let built = bones::block(DVec3::new(76.0, 46.0, 18.0), DVec3::splat(h))?;
    let scenes: [(&str, Trajectory); 2] = [
        ("press", press::straight(4.0, DVec2::new(0.11, 0.07), 300)),
        (
            "sweep 200 mm/s",
            press::sweep().first(out.effort.events.min(900)),
        ),
    ];
    let mut table = Table::new(
        "ablation",
        "Ablation, reamer in a block",
        "Each row leaves out one part of the full model; *costs* is the full model's mean time less that row's, *removes* is that \
         row's error less the full model's. A part whose removal changes no error has to show another use. Dashes: no variant without this part exists.",
        &[
            "scene",
            "left out",
            "p50 µs",
            "mean µs",
            "costs µs",
            "surface RMS µm",
            "removes µm",
            "max µm",
            "removes µm (max)",
            "volume",
        ],
    );
    for (scene, way) in scenes {
        let kit = Kit::new(Tool::glenoid_reamer())?;
        let way = way.placed(&built.bone_from_plan);
        let case = Case {
            scene: format!("ablation-{scene}"),
            bone: &built.bone,
            shape: kit.tool.shape.clone(),
            way: &way,
            errors: true,
        };
        let variants = lineup::variants(&built.bone, &kit);
        let mut names = vec!["nothing (full model)"];
        let mut carvers: Carvers<'_> = lineup::ours(&built.bone, &kit);
        // the full model is the first of ours
        carvers.truncate(1);
        for variant in variants {
            names.push(variant.left_out);
            carvers.push(variant.carver);
        }
        let rows = measure(&case, &out.effort, carvers);
        for (name, row) in names.iter().zip(&rows) {
            table.push(cells(scene, name, row, &rows[0]));
        }
        out.rows.extend(rows);
        for name in lineup::NOT_SEPARABLE {
            let mut cells = vec![scene.to_owned(), name.to_owned()];
            cells.resize(10, short(None));
            table.push(cells);
        }
    }
    out.table(&table)
}

fn cells(scene: &str, name: &str, row: &Row, full: &Row) -> Vec<String> {
    let less = |a: Option<f64>, b: Option<f64>| Some(a? - b?);
    vec![
        scene.to_owned(),
        name.to_owned(),
        short(row.p50_us),
        short(row.mean_us),
        short(less(full.mean_us, row.mean_us)),
        short(row.surface_rms_um),
        short(less(row.surface_rms_um, full.surface_rms_um)),
        short(row.surface_max_um),
        short(less(row.surface_max_um, full.surface_max_um)),
        percent(row.volume_rel_err),
    ]
}
