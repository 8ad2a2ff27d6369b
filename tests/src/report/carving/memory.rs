//! Memory by field, beside the thesis's table 3.2.

use super::Output;
use super::output::BoneFacts;
use super::speed::SCALE;
use crate::report::carver::FIELDS;
use crate::report::plot::{Plot, Point};
use crate::report::table::{Table, short};
use crate::scenes::bones;
use anyhow::Result;
use osteon_sim_core::grid::CHUNK_VOXELS;
use std::collections::BTreeSet;

/// Runs the part.
pub(super) fn run(out: &mut Output) -> Result<()> {
    out.say("## Memory");
    if out.bones.is_empty() {
        let h = if out.effort.quick { 1.2 } else { 0.47 };
        let built = bones::scapula(h, SCALE)?;
        out.note_bone("scapula", &built);
    }
    let mut facts = out.bones.clone();
    let mut seen = BTreeSet::new();
    facts.retain(|bone| seen.insert(bone.dims));
    let mut columns = vec![
        "bone",
        "voxel mm",
        "lattice",
        "voxels M",
        "chunks kept",
        "solid voxels M",
    ];
    columns.extend(FIELDS.iter().map(|f| f.0));
    columns.extend([
        "all MB",
        "one dense i16 MB",
        "bytes per solid voxel",
        "built in s",
    ]);
    let mut table = Table::new(
        "memory",
        "Memory by field, MB",
        "The thesis's scapula (table 3.2): lattice 256 × 256 × 448, 202 of 896 chunks active, 58.7 MB dense and 13.2 MB in chunks at 2 bytes a voxel.",
        &columns,
    );
    let mut plot = Plot::new(
        "memory",
        "Memory of a scapula over the surface's error",
        "All fields of the kept chunks and the cut's pool; the error is that of the reamer's press on the same bone.",
        ["surface RMS, µm", "memory, MB"],
    );
    for bone in &facts {
        table.push(cells(bone));
    }
    for row in out
        .rows
        .iter()
        .filter(|r| r.scene.starts_with("reamer-press"))
    {
        plot.series(&row.method).push(Point {
            x: row.surface_rms_um.unwrap_or(f64::NAN),
            y: row.bytes as f64 * 1e-6,
            band: None,
            failed: row.surface_rms_um.is_none(),
        });
    }
    out.table(&table)?;
    out.plot(&plot)
}

/// A bone's row.
fn cells(bone: &BoneFacts) -> Vec<String> {
    let voxels = (bone.chunks * CHUNK_VOXELS) as f64;
    let all: usize = FIELDS.iter().map(|f| f.1).sum();
    let lattice: usize = bone.dims.iter().product();
    let mut cells = vec![
        bone.name.clone(),
        bone.voxel_mm.to_string(),
        format!("{} × {} × {}", bone.dims[0], bone.dims[1], bone.dims[2]),
        short(Some(lattice as f64 * 1e-6)),
        format!(
            "{} of {}",
            bone.chunks,
            bone.chunk_dims.iter().product::<usize>()
        ),
        short(Some(bone.solid_voxels as f64 * 1e-6)),
    ];
    cells.extend(
        FIELDS
            .iter()
            .map(|f| short(Some(voxels * f.1 as f64 * 1e-6))),
    );
    cells.push(short(Some(voxels * all as f64 * 1e-6)));
    cells.push(short(Some(lattice as f64 * 2e-6)));
    cells.push(short(Some(voxels * all as f64 / bone.solid_voxels as f64)));
    cells.push(short(Some(bone.seconds)));
    cells
}
