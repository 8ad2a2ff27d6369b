//! Time per event on the scapula: speed.md's trajectories at three voxel sizes.

use super::lineup::{self, Kit};
use super::output::{ROW_COLUMNS, row_cells};
use super::rows::{Case, Row, measure};
use super::{Output, tools};
use crate::report::plot::{Plot, Point};
use crate::report::table::Table;
use crate::scenes::bones::{self, BuiltBone};
use crate::scenes::press::{self, Trajectory};
use anyhow::Result;
use osteon_firmware_bridge::scene::phantom::shape::FACE_RADIUS_MM;
use osteon_sim_core::tool::Tool;

/// Enlargement of the scapula: at 0.14 mm its lattice then has more than 10⁹ voxels, and more than the
/// 29 M solid ones that were asked for.
pub(super) const SCALE: f64 = 1.12;

/// A tool's way at a voxel size.
struct Scene {
    name: &'static str,
    kit: Kit,
    way: Trajectory,
    // rivals run here too
    rivals: bool,
    errors: bool,
}

fn scene(name: &'static str, kit: Kit, way: Trajectory, [rivals, errors]: [bool; 2]) -> Scene {
    Scene {
        name,
        kit,
        way,
        rivals,
        errors,
    }
}

fn presses() -> Result<Vec<Scene>> {
    let reamer = Kit::new(Tool::glenoid_reamer())?.and_meshed()?;
    let peg = Kit::new(Tool::peg_drill())?.and_meshed()?;
    Ok(vec![
        scene("reamer-press", reamer, press::reamer_press(), [true; 2]),
        scene("peg-press", peg, press::peg_press(), [true; 2]),
    ])
}

fn others() -> Result<Vec<Scene>> {
    let reamer = || Kit::new(Tool::glenoid_reamer());
    let burr = Kit::new(tools::burr(6.0))?;
    let paint = press::burr_paint(FACE_RADIUS_MM * SCALE);
    Ok(vec![
        scene("reamer-free", reamer()?, press::free(), [true, false]),
        scene("reamer-sweep", reamer()?, press::sweep(), [false, true]),
        scene("reamer-plunge", reamer()?, press::plunge(), [false, false]),
        scene("burr-paint", burr, paint, [true; 2]),
    ])
}

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    let sizes: &[f64] = if out.effort.quick {
        &[1.2]
    } else {
        &[0.47, 0.235, 0.14]
    };
    let first = out.rows.len();
    for &voxel_mm in sizes {
        out.stage(&format!("bone of {voxel_mm} mm"));
        let built = bones::scapula(voxel_mm, SCALE)?;
        out.note_bone("scapula", &built);
        let mut scenes = presses()?;
        if voxel_mm > 0.2 {
            // rivals are made anew for each scene: beside the presses at the thesis's voxel size only
            scenes.extend(others()?.into_iter().map(|scene| Scene {
                rivals: scene.rivals && voxel_mm > 0.4,
                ..scene
            }));
        }
        if out.effort.quick {
            // the strokes and the plunge only take long
            scenes.retain(|scene| scene.rivals);
        }
        for scene in &scenes {
            out.stage(&format!("{}-{voxel_mm}", scene.name));
            let rows = scene_rows(out, &built, scene);
            out.rows.extend(rows);
        }
    }
    let rows: Vec<Row> = out.rows[first..].to_vec();
    out.say("## Speed on the scapula");
    let mut table = Table::new(
        "speed",
        "Time per event and error of the same run",
        "Speed and error, per scene, voxel size and method. The reamer's press goes through cartilage, plate and \
         cancellous bone. Published figures of the thesis (GTX 1070, another machine): 970 µs an event for its reamer \
         and 1172 µs for its peg at 0.47 mm.",
        &ROW_COLUMNS,
    );
    for row in &rows {
        table.push(row_cells(row));
    }
    out.table(&table)?;
    out.plot(&over_voxels(&rows, "reamer-press"))?;
    out.plot(&over_voxels(&rows, "peg-press"))
}

fn scene_rows(out: &Output, built: &BuiltBone, scene: &Scene) -> Vec<Row> {
    let mut way = scene.way.placed(&built.bone_from_plan);
    if way.events() > out.effort.events {
        way = way.thinned(out.effort.events);
    }
    let case = Case {
        scene: format!("{}-{}", scene.name, built.bone.grid().spacing_mm.x),
        bone: &built.bone,
        shape: scene.kit.tool.shape.clone(),
        way: &way,
        errors: scene.errors,
    };
    let carvers = if scene.rivals {
        lineup::carvers(&built.bone, &scene.kit)
    } else {
        lineup::ours(&built.bone, &scene.kit)
    };
    measure(&case, &out.effort, carvers)
}

/// p50, with the worst event as the spread, over the voxel size.
fn over_voxels(rows: &[Row], scene: &str) -> Plot {
    let mut plot = Plot::new(
        &format!("speed-{scene}"),
        &format!("{scene}: contact event over voxel size"),
        "Dots: median of the contact events; bars: up to the worst event. Work on a surface grows with h⁻², work on \
         a volume with h⁻³.",
        ["voxel, mm", "time per event, µs"],
    );
    for row in rows.iter().filter(|r| r.scene.starts_with(scene)) {
        let p50 = row.p50_us.unwrap_or(f64::NAN);
        let max = row.max_us.unwrap_or(f64::NAN);
        plot.series(&row.method).push(Point {
            x: row.voxel_mm,
            y: p50,
            band: Some([p50, max]),
            failed: row.p50_us.is_none(),
        });
    }
    plot.slopes = vec![(-2.0, "h⁻²".to_owned()), (-3.0, "h⁻³".to_owned())];
    plot.levels = vec![(1000.0, "1 ms".to_owned())];
    plot
}
