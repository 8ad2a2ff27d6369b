//! The thesis's tables 2.1, 2.2, 3.1 to 3.5 and figures 3.9 to 3.12 in our terms.
//!
//! Its figures are printed as it gives them (Intel i5 8600, GTX 1070, OpenCL): another machine, so only
//! the form can be compared; the same methods run on this machine where the line-up holds them.

mod chunk_plot;
mod published;
mod statics;

use super::lineup::{self, Kit};
use super::rows::Row;
use super::{Output, tools};
use crate::report::plot::{Plot, Point};
use crate::report::table::{Table, percent, short};
use crate::scenes::bones::{self, BuiltBone};
use anyhow::Result;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::tool::Tool;
use std::collections::BTreeMap;
use std::time::Instant;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## The thesis's tables and figures in our terms");
    let h = if out.effort.quick { 1.2 } else { 0.47 };
    let built = bones::scapula(h, super::speed::SCALE)?;
    out.note_bone("scapula", &built);
    voxelisation(out)?;
    construction(out, &built)?;
    characteristics(out, &built)?;
    let first = out.rows.len();
    chunk_sizes(
        out,
        &built,
        ("3.3", tools::thesis_reamer),
        published::REAMER,
    )?;
    chunk_sizes(out, &built, ("3.4", tools::thesis_peg), published::PEG)?;
    tool_cells(out, &built)?;
    over_chunks(out, &built)?;
    over_tool_voxels(out, &built)?;
    let mut table = Table::new(
        "static-events",
        "All static events",
        "One event on the uncut bone at a pose that stands, least of many replays.",
        &super::output::ROW_COLUMNS,
    );
    for row in &out.rows[first..] {
        table.push(super::output::row_cells(row));
    }
    out.table(&table)
}

fn ms(seconds: f64) -> String {
    short(Some(1e3 * seconds))
}

/// Table 2.1: making a tool ready.
fn voxelisation(out: &mut Output) -> Result<()> {
    let mut table = Table::new(
        "table-2.1",
        "Table 2.1: making the tool ready, ms",
        "Theirs: voxelising the mesh on the GPU. Ours carves with the exact shape and has nothing to make; the last column is the time of all \
         sampled forms that the line-up holds.",
        &[
            "tool",
            "theirs: voxelise",
            "theirs: adjust",
            "ours: exact shape",
            "here: sampled forms",
        ],
    );
    for (name, voxelise, adjust, reamer) in [
        ("reamer", "0.754", "0.442", true),
        ("peg cylinder", "0.560", "–", false),
    ] {
        let start = Instant::now();
        let exact = std::hint::black_box(if reamer {
            tools::thesis_reamer()
        } else {
            tools::thesis_peg()
        });
        let plain = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let kit = std::hint::black_box(Kit::new(exact)?);
        let sampled = start.elapsed().as_secs_f64();
        drop(kit);
        table.push([name, voxelise, adjust, &ms(plain), &ms(sampled)].map(str::to_owned));
    }
    out.table(&table)
}

/// Table 2.2: from the source to chunks.
fn construction(out: &mut Output, built: &BuiltBone) -> Result<()> {
    let mut table = Table::new(
        "table-2.2",
        "Table 2.2: making the chunk grid, ms",
        "Theirs: scapula of 256 × 234 × 201 voxels from a text file. Ours: the built-in scapula from its function (distance, tissue and density of every voxel near \
         the bone) straight to chunks, on all cores; no filler voxels and no dense lattice in between.",
        &["task", "theirs: scapula", "ours"],
    );
    let start = Instant::now();
    let cut = Cut::new(&built.bone);
    let pool = start.elapsed().as_secs_f64();
    drop(cut);
    let rows: [[&str; 3]; 6] = [
        ["load raw data from the CT's text file", "295", "–"],
        ["raw data to rectangular grid", "1.2", "–"],
        ["rectangular to cubic grid", "78", "not needed"],
        ["cubic grid to chunk grid", "62", "–"],
        ["function to chunks", "–", &ms(built.seconds)],
        ["the cut's pool, written once", "–", &ms(pool)],
    ];
    for row in rows {
        table.push(row.map(str::to_owned));
    }
    out.table(&table)
}

/// Tables 3.1 and 3.2.
fn characteristics(out: &mut Output, built: &BuiltBone) -> Result<()> {
    let mut table = Table::new(
        "table-3.1-3.2",
        "Tables 3.1 and 3.2: lattice and chunks",
        "Theirs as printed; ours is the built-in scapula. Memory at 2 bytes a voxel, as theirs; all fields of ours are in the part on memory.",
        &[
            "model", "voxel mm", "lattice", "voxels", "dense MB", "chunks", "kept", "kept MB",
        ],
    );
    for row in published::MODELS {
        table.push(row.map(str::to_owned));
    }
    let grid = built.bone.grid();
    let chunks = built.bone.chunk_count();
    let mb = |voxels: usize| short(Some(voxels as f64 * 2e-6));
    table.push([
        "scapula (ours)".to_owned(),
        format!("{}", grid.spacing_mm.x),
        format!("{} × {} × {}", grid.dims[0], grid.dims[1], grid.dims[2]),
        grid.len().to_string(),
        mb(grid.len()),
        built.bone.chunks_total().to_string(),
        chunks.to_string(),
        mb(chunks * osteon_sim_core::grid::CHUNK_VOXELS),
    ]);
    out.table(&table)
}

/// Tables 3.3 and 3.4: a static event over the chunk's size.
fn chunk_sizes(
    out: &mut Output,
    built: &BuiltBone,
    (number, tool): (&str, fn() -> Tool),
    theirs: [[f64; 3]; 3],
) -> Result<()> {
    let kit = Kit::new(tool())?;
    let pose = statics::pose_of_18_chunks(built, &kit.tool);
    let h = built.bone.grid().spacing_mm.x;
    let scene = format!("static-{}-{h}", kit.tool.id);
    let rows = statics::measure_static(out, built, &kit, (&scene, pose));
    let mut table = Table::new(
        &format!("table-{number}"),
        &format!(
            "Table {number}: static event over the chunk's size, {}",
            kit.tool.name
        ),
        "Chunks here: blocks of N³ voxels with bone in the tool's box. Ours skips bricks and lines inside its chunks, so a chunk is not what its time is made of.",
        &[
            "method",
            "chunk",
            "chunks theirs",
            "here",
            "a chunk theirs ms",
            "here",
            "event theirs ms",
            "here",
        ],
    );
    let hit = |edge| statics::chunks_hit(&built.bone, &kit.tool, &pose, edge);
    for (edge, theirs) in [16, 32, 64].into_iter().zip(theirs) {
        let name = format!("thesis-{edge}");
        let row = rows.iter().find(|r| r.method == name);
        let us = row.and_then(|r| r.p50_us);
        table.push(chunk_cells((&name, edge), theirs.map(Some), hit(edge), us));
    }
    for row in rows.iter().filter(|r| !r.method.starts_with("thesis")) {
        let name = (row.method.as_str(), 32);
        table.push(chunk_cells(name, [None; 3], hit(32), row.p50_us));
    }
    let plot = chunk_plot::over_edge(&kit, &rows, theirs);
    out.rows.extend(rows);
    out.table(&table)?;
    out.plot(&plot)
}

fn chunk_cells(
    (method, edge): (&str, usize),
    [chunks, each, all]: [Option<f64>; 3],
    hit: usize,
    us: Option<f64>,
) -> [String; 8] {
    let event_ms = us.map(|v| 1e-3 * v);
    [
        method.to_owned(),
        edge.to_string(),
        short(chunks),
        hit.to_string(),
        short(each),
        short(event_ms.map(|v| v / hit as f64)),
        short(all),
        short(event_ms),
    ]
}

/// Table 3.5: the thesis's kernel over the tool's resolution, with the error that it did not test.
fn tool_cells(out: &mut Output, built: &BuiltBone) -> Result<()> {
    let mut table = Table::new(
        "table-3.5",
        "Table 3.5: static event over the tool's resolution, reamer",
        "The thesis leaves open whether finer tool voxels cut better: *surface* answers it. Theirs: event 0.982, 0.975, 0.967 ms for 1, 0.75, 0.5 mm.",
        &[
            "method",
            "tool cell mm",
            "event theirs ms",
            "here ms",
            "surface RMS µm",
            "missed",
            "excess",
        ],
    );
    let theirs = [Some(0.982), Some(0.975), Some(0.967), None];
    let kit = Kit::new(tools::thesis_reamer())?;
    let pose = statics::pose_of_18_chunks(built, &kit.tool);
    let exact = statics::measure_with(
        out,
        built,
        &kit,
        ("static-exact", pose),
        lineup::ours(&built.bone, &kit),
    );
    for row in exact {
        table.push(cell_cells("exact", None, &row));
        out.rows.push(row);
    }
    for (cell, theirs) in [1.0, 0.75, 0.5, 0.25].into_iter().zip(theirs) {
        let kit = Kit::with_cells(tools::thesis_reamer(), cell)?;
        let pose = statics::pose_of_18_chunks(built, &kit.tool);
        let scene = format!("static-cell-{cell}");
        let carvers = lineup::sampled(&built.bone, &kit);
        for row in statics::measure_with(out, built, &kit, (&scene, pose), carvers) {
            table.push(cell_cells(&cell.to_string(), theirs, &row));
            out.rows.push(row);
        }
    }
    out.table(&table)
}

fn cell_cells(cell: &str, theirs: Option<f64>, row: &Row) -> [String; 7] {
    [
        row.method.clone(),
        cell.to_owned(),
        short(theirs.filter(|_| row.method == "thesis-32")),
        short(row.p50_us.map(|v| 1e-3 * v)),
        short(row.surface_rms_um),
        percent(row.missed_frac),
        percent(row.excess_frac),
    ]
}

/// Figures 3.10 to 3.12: time over the number of chunks that an event goes through.
fn over_chunks(out: &mut Output, built: &BuiltBone) -> Result<()> {
    let mut plot = Plot::new(
        "figure-3.10-3.12",
        "Figures 3.10–3.12: static peg event over the chunks that it meets",
        "The peg at rising depths. *Published*: 0.065 ms a chunk (their table 3.4, GTX 1070). Their rivals' curves are in the figures alone and were measured by nobody here but as the methods of the line-up.",
        [
            "chunks of 32³ with bone in the tool's box",
            "time of the event, µs",
        ],
    );
    let kit = Kit::new(tools::thesis_peg())?;
    let mut times: BTreeMap<(String, usize), Vec<f64>> = BTreeMap::new();
    for (n, pose) in statics::descent(built).into_iter().enumerate() {
        let chunks = statics::chunks_hit(&built.bone, &kit.tool, &pose, 32);
        if chunks == 0 {
            continue;
        }
        let scene = format!("static-peg-descent-{n}");
        for row in statics::measure_static(out, built, &kit, (&scene, pose)) {
            let key = (row.method.clone(), chunks);
            let us = row.p50_us.unwrap_or(f64::NAN);
            times.entry(key).or_default().push(us);
            out.rows.push(row);
        }
    }
    for ((method, chunks), us) in &times {
        plot.series(method).push(Point::median(*chunks as f64, us));
    }
    plot.series("thesis, published")
        .extend([1.0, 20.0].map(|chunks| Point::at(chunks, 65.0 * chunks)));
    plot.levels.push((1000.0, "1 ms".to_owned()));
    out.plot(&plot)
}

/// Figure 3.9: time over the tool's resolution.
fn over_tool_voxels(out: &mut Output, built: &BuiltBone) -> Result<()> {
    let mut plot = Plot::new(
        "figure-3.9",
        "Figure 3.9: static reamer event over the tool's voxels",
        "Tool grids of about 64³ and 128³ voxels. *Published* at 64³ (GTX 1070): 440 µs for the chunk kernel and 190 µs for Reza et al.",
        [
            "voxels of the tool's grid along an edge",
            "time of the event, µs",
        ],
    );
    for edge in [64.0, 128.0] {
        let kit = Kit::with_cells(tools::thesis_reamer(), 36.0 / edge)?;
        let pose = statics::pose_of_18_chunks(built, &kit.tool);
        let scene = format!("static-tool-{edge}");
        for row in statics::measure_static(out, built, &kit, (&scene, pose)) {
            plot.series(&row.method)
                .push(Point::at(edge, row.p50_us.unwrap_or(f64::NAN)));
            out.rows.push(row);
        }
    }
    plot.series("thesis, published")
        .push(Point::at(64.0, 440.0));
    plot.series("Reza et al., published")
        .push(Point::at(64.0, 190.0));
    out.plot(&plot)
}
