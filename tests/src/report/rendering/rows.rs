//! The rows of the report: every method at every size.

use super::scene::Scene;
use super::{Effort, Output};
use crate::report::table::{Table, short};
use anyhow::Result;
use osteon_viewer::RendererKind as Kind;
use osteon_viewer::lab::{Difference, Reference, Stage};
use serde::Serialize;
use std::path::Path;

/// One method at one size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the method.
    pub method: &'static str,
    /// The adapter's own name.
    pub adapter: String,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Its height.
    pub height: u32,
    /// Internal scale: pixels drawn for a pixel shown, along an edge.
    pub scale: f64,
    /// Chunks with bone that were loaded.
    pub active_chunks: usize,
    /// Median of the idle frames, ms.
    pub frame_ms_p50: f64,
    /// 99 of 100 idle frames took no longer; with fewer frames the longest.
    pub frame_ms_p99: f64,
    /// Median of the carving frames, ms.
    pub carving_ms_p50: Option<f64>,
    /// It over the idle frames' median.
    pub carving_ratio: Option<f64>,
    /// Frames of each kind.
    pub frames: usize,
    /// Pixels of bone too much or too little against the reference.
    pub silhouette_px: Option<f64>,
    /// Depth against the reference, mm.
    pub depth_rms_mm: Option<f64>,
    /// Normals against it, degrees.
    pub normal_rms_deg: Option<f64>,
    /// Pixels that show bone in the reference.
    pub covered_px: Option<usize>,
    /// Bytes on the adapter for bone and picture.
    pub bytes: u64,
}

/// A value of a sorted list by the nearest rank.
pub(super) fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a rank of a short list"
    )]
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted
        .get(rank.saturating_sub(1))
        .copied()
        .unwrap_or(f64::NAN)
}

/// Measures all methods and writes their pictures.
pub(super) fn measure(
    scene: &Scene,
    effort: &Effort,
    out: &Path,
    output: &mut Output,
    progress: &mut dyn FnMut(&str, f32),
) -> Result<()> {
    let cut = scene.operated();
    let mut reference: Option<Reference> = None;
    for (n, kind) in Kind::ALL.into_iter().enumerate() {
        progress(kind.name(), n as f32 / Kind::ALL.len() as f32);
        let mut stage = Stage::new(
            &scene.bone,
            &cut,
            &scene.plan,
            &scene.tools,
            kind,
            effort.error_size,
        )?;
        // the section shows the inside of the bone, which is no surface of the reference
        let error = if kind == Kind::Section {
            None
        } else {
            stage.show_whole();
            let reference = reference.get_or_insert_with(|| stage.reference(effort.samples));
            let voxel = scene.bone.grid().spacing_mm.max_element();
            Some(reference.difference(&stage.surfaces()?, voxel))
        };
        picture(&mut stage, kind, effort, out)?;
        let mut depth = 1.0;
        for &(size, frames) in &effort.sizes {
            let known = error.filter(|_| size == effort.error_size);
            let row = row(&mut stage, scene, kind, (size, frames), &mut depth, known)?;
            output.rows.push(row);
        }
    }
    output.tables.push(table(&output.rows));
    Ok(())
}

/// A small picture of the glenoid, after carving.
fn picture(stage: &mut Stage, kind: Kind, effort: &Effort, out: &Path) -> Result<()> {
    stage.resize(if effort.quick { [160, 90] } else { [400, 225] });
    stage.show_glenoid();
    stage.write_picture(&out.join(format!("{}.png", kind.name())))
}

fn row(
    stage: &mut Stage,
    scene: &Scene,
    kind: Kind,
    (size, frames): ([u32; 2], usize),
    depth: &mut f64,
    error: Option<Difference>,
) -> Result<Row> {
    stage.resize(size);
    stage.show_whole();
    // the first frame makes the buffers
    stage.frame()?;
    let (mut idle, mut carving) = (Vec::new(), Vec::new());
    for _ in 0..frames {
        idle.push(stage.frame()?.0.as_secs_f64() * 1e3);
        let next = *depth + 0.05;
        stage.carve(&scene.tools[1], &scene.step(*depth, next))?;
        *depth = next;
        carving.push(stage.frame()?.0.as_secs_f64() * 1e3);
    }
    let (idle_p50, carving_p50) = (quantile(&idle, 0.5), quantile(&carving, 0.5));
    Ok(Row {
        method: kind.name(),
        adapter: stage.adapter().name.clone(),
        width: size[0],
        height: size[1],
        scale: 1.0,
        active_chunks: scene.bone.chunk_count(),
        frame_ms_p50: idle_p50,
        frame_ms_p99: quantile(&idle, 0.99),
        carving_ms_p50: Some(carving_p50),
        carving_ratio: Some(carving_p50 / idle_p50),
        frames,
        silhouette_px: error.map(|e| e.silhouette_px),
        depth_rms_mm: error.map(|e| e.depth_rms_mm),
        normal_rms_deg: error.map(|e| e.normal_rms_deg),
        covered_px: error.map(|e| e.covered_px),
        bytes: stage.bytes(),
    })
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "rendering_rows",
        "Frame time, error and memory of every method",
        "*Carving*: median of the carving frames over that of the idle ones.",
        &[
            "method",
            "picture",
            "chunks",
            "p50, ms",
            "p99, ms",
            "frames/s",
            "carving",
            "silhouette, px",
            "depth RMS, mm",
            "normal RMS, °",
            "MB",
        ],
    );
    for row in rows {
        table.push([
            row.method.to_owned(),
            format!("{} × {}", row.width, row.height),
            row.active_chunks.to_string(),
            format!("{:.1}", row.frame_ms_p50),
            format!("{:.1}", row.frame_ms_p99),
            format!("{:.1}", 1e3 / row.frame_ms_p50),
            row.carving_ratio
                .map_or_else(|| "–".to_owned(), |r| format!("{r:.2}")),
            short(row.silhouette_px),
            short(row.depth_rms_mm),
            short(row.normal_rms_deg),
            format!("{:.1}", row.bytes as f64 / 1e6),
        ]);
    }
    table
}
