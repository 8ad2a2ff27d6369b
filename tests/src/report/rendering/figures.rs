//! The thesis's figures 3.13 to 3.16 and tables 3.7 and 3.8 in our terms.

use super::rows::quantile;
use super::scene::Scene;
use super::{Effort, Output, Row};
use crate::report::plot::{Plot, Point, Scale};
use crate::report::table::Table;
use crate::scenes::thesis::{Object, figures};
use anyhow::Result;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::CHUNK_VOXELS;
use osteon_viewer::RendererKind as Kind;
use osteon_viewer::lab::Stage;
use osteon_viewer::lab::meshing::{Phases, Rate, rates};
use osteon_viewer::lab::stage::nearest_chunks;
use serde_json::json;

/// Measures all of it.
pub(super) fn measure(scene: &Scene, effort: &Effort, output: &mut Output) -> Result<()> {
    over_chunks(scene, effort, output)?;
    ratios(scene, effort, output);
    memory(scene, output);
    meshing(scene, effort, output);
    Ok(())
}

/// Figures 3.13, 3.14 and 3.16: frame time against active chunks, every method.
fn over_chunks(scene: &Scene, effort: &Effort, output: &mut Output) -> Result<()> {
    let (size, frames) = effort.figure;
    let mut plot = Plot::new(
        "figure-3.13-3.16",
        "Frame time against active chunks (figures 3.13, 3.14, 3.16)",
        "The chunks nearest to the glenoid, the camera on the whole of them: more chunks are smaller in the picture. \
         The thesis has a straight line for each method on each graphics card; ours has one adapter, named above.",
        ["active chunks", "frame, ms"],
    )
    .on([Scale::Linear, Scale::Log]);
    for kind in Kind::ALL {
        for &share in &effort.counts {
            let all = scene.bone.chunk_count();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a share of a count"
            )]
            let count = ((share * all as f64).round() as usize).clamp(1, all);
            let part = nearest_chunks(&scene.bone, scene.plan.translation, count)?;
            let cut = Cut::new(&part);
            let mut stage = Stage::new(&part, &cut, &scene.plan, &scene.tools, kind, size)?;
            stage.frame()?;
            let times = stage.idle(frames)?.whole_ms;
            let p50 = quantile(&times, 0.5);
            plot.series(kind.name()).push(Point::at(count as f64, p50));
            if count < all {
                output.rows.push(Row {
                    method: kind.name(),
                    adapter: stage.adapter().name.clone(),
                    width: size[0],
                    height: size[1],
                    scale: 1.0,
                    active_chunks: count,
                    frame_ms_p50: p50,
                    frame_ms_p99: quantile(&times, 0.99),
                    carving_ms_p50: None,
                    carving_ratio: None,
                    frames,
                    silhouette_px: None,
                    depth_rms_mm: None,
                    normal_rms_deg: None,
                    covered_px: None,
                    bytes: stage.bytes(),
                });
            }
        }
    }
    output.plots.push(plot);
    Ok(())
}

/// Figure 3.15: active voxels of all voxels.
fn ratios(scene: &Scene, effort: &Effort, output: &mut Output) {
    let mut table = Table::new(
        "figure-3.15",
        "Active of all voxels (figure 3.15)",
        "*In active chunks*: of the voxels of chunks that are kept, which is what a kernel over chunks goes through. \
         The thesis's objects are stand-ins of the same grids (their files are not public).",
        &[
            "object",
            "voxels",
            "active",
            "of all, %",
            "in active chunks, %",
        ],
    );
    let solid = |chunk: usize| {
        scene
            .bone
            .chunk(chunk)
            .solid
            .iter()
            .filter(|&&d| d > 0)
            .count()
    };
    let active: usize = (0..scene.bone.chunk_count()).map(solid).sum();
    let all = scene.bone.grid().len();
    let kept = scene.bone.chunk_count() * CHUNK_VOXELS;
    let share = |part: usize, of: usize| format!("{:.1}", 100.0 * part as f64 / of.max(1) as f64);
    table.push([
        scene.name.to_owned(),
        all.to_string(),
        active.to_string(),
        share(active, all),
        share(active, kept),
    ]);
    let objects: &[Object] = if effort.quick {
        &[Object::Glenoid]
    } else {
        &Object::ALL
    };
    for object in objects {
        let counted = figures(&object.stand_in(1));
        let chunks = counted.chunks[1].active * CHUNK_VOXELS;
        table.push([
            format!("{} (stand-in)", object.name()),
            counted.voxels.to_string(),
            counted.active.to_string(),
            share(counted.active, counted.voxels),
            share(counted.active, chunks),
        ]);
    }
    output.tables.push(table);
}

/// Table 3.7: memory of each method.
fn memory(scene: &Scene, output: &mut Output) {
    let mut table = Table::new(
        "table-3.7",
        "Memory of the methods (table 3.7)",
        "The thesis: scapula of 0.47 × 0.47 × 1 mm, 99 active chunks, 6.48 MB of voxels and 6.93 MB of mesh; with filler \
         voxels of 0.47 mm, 199 chunks and 13.04 MB, no mesh. Ours: *voxels* at 2 B a voxel of the active chunks, for \
         comparison; *adapter*: all that the method holds there for bone and picture at the smallest size (two distances \
         and a colour a voxel of the bricks with bone, the mesh, the surface buffers).",
        &["method", "active chunks", "voxels, MB", "adapter, MB"],
    );
    let least = output.rows.iter().map(|r| r.width).min().unwrap_or(0);
    let all = scene.bone.chunk_count();
    let voxels = (all * CHUNK_VOXELS * 2) as f64 / 1e6;
    for row in output
        .rows
        .iter()
        .filter(|r| r.width == least && r.active_chunks == all)
    {
        table.push([
            row.method.to_owned(),
            row.active_chunks.to_string(),
            format!("{voxels:.2}"),
            format!("{:.2}", row.bytes as f64 / 1e6),
        ]);
    }
    output.tables.push(table);
}

/// Table 3.8 and the throughput of the meshers.
fn meshing(scene: &Scene, effort: &Effort, output: &mut Output) {
    let (rates, phases) = rates(&scene.bone, &scene.operated(), effort.rounds);
    output.tables.push(throughput(&rates));
    output.tables.push(table_3_8(&phases));
    output
        .facts
        .push(("meshing", json!({ "rates": rates, "phases": phases })));
}

fn throughput(rates: &[Rate]) -> Table {
    let mut table = Table::new(
        "meshing",
        "Chunks that become meshes, on one core",
        "Over all chunks with a surface, after carving; the best of all rounds, the bits of every chunk and its apron \
         included. Wanted: faces at least 60, greedy 50, surface nets 27 chunks a millisecond.",
        &["mesher", "chunks", "chunks/ms", "without bits", "pieces"],
    );
    for rate in rates {
        table.push([
            rate.mesher.to_owned(),
            rate.chunks.to_string(),
            format!("{:.1}", rate.chunks_per_ms),
            format!("{:.1}", rate.without_bits_per_ms),
            rate.pieces.to_string(),
        ]);
    }
    table
}

/// The thesis's phases of making a chunk's mesh on a GTX 1070, ms (Table 3.8), with ours that do the same.
const THEIRS: [(&str, f64, &str); 5] = [
    (
        "copy chunk cluster data to padded chunk",
        0.077_047,
        "apron",
    ),
    ("classify active voxels in padded chunk", 0.067_482, "bits"),
    (
        "sparse active voxels by prefix scan",
        0.081_673,
        "none: bits are scanned as they are",
    ),
    ("generate mesh", 0.018_723, "faces"),
    (
        "copy to the chunk's mesh buffer",
        0.007_131,
        "one upload, in the frame's time",
    ),
];

fn table_3_8(phases: &Phases) -> Table {
    let mut table = Table::new(
        "table-3.8",
        "Phases of meshing a chunk again (table 3.8)",
        "Theirs on a GTX 1070, ours on one core of the machine named above: other hardware, the same task.",
        &["phase", "theirs, µs", "ours", "ours, µs"],
    );
    let of = |name: &str| {
        phases
            .mesh_us
            .iter()
            .find(|(n, _)| *n == name)
            .map_or(0.0, |m| m.1)
    };
    let mut total = 0.0;
    for (phase, ms, ours) in THEIRS {
        let us = match ours {
            "apron" => phases.apron_us,
            "bits" => phases.bits_us,
            "faces" => of("faces"),
            _ => 0.0,
        };
        total += us;
        let us = if us > 0.0 {
            format!("{us:.1}")
        } else {
            "–".to_owned()
        };
        table.push([
            phase.to_owned(),
            format!("{:.1}", ms * 1e3),
            ours.to_owned(),
            us,
        ]);
    }
    let theirs: f64 = THEIRS.iter().map(|t| t.1 * 1e3).sum();
    table.push([
        "all".to_owned(),
        format!("{theirs:.1}"),
        "faces".to_owned(),
        format!("{total:.1}"),
    ]);
    for (name, us) in &phases.mesh_us {
        let all = us + phases.apron_us + phases.bits_us;
        table.push([
            "all".to_owned(),
            "–".to_owned(),
            (*name).to_owned(),
            format!("{all:.1}"),
        ]);
    }
    table
}
