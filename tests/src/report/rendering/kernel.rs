//! The thesis's chunk kernel on the graphics adapter, beside the CPU's.

use super::rows::quantile;
use super::scene::Scene;
use super::{Effort, Output};
use crate::baselines::{Baseline as _, THESIS_VOXEL_MM, Thesis, ThesisOnAdapter, VoxelTool};
use crate::report::table::Table;
use anyhow::{Context as _, Result};
use osteon_sim_core::tool::Tool;
use osteon_viewer::lab::Adapter;
use serde_json::json;
use std::time::Instant;

/// What the thesis prints for chunks of 32³: its tool, ms an event, chunks (Tables 3.3 and 3.4, GTX 1070).
const THEIRS: [(f64, usize); 2] = [(1.172, 18), (0.970, 18)];

/// Measures both tools.
pub(super) fn measure(
    scene: &Scene,
    adapter: &Adapter,
    effort: &Effort,
    output: &mut Output,
) -> Result<()> {
    let mut table = Table::new(
        "thesis-kernel",
        "The thesis's chunk kernel (Alg. 2.10) on this adapter",
        "Tool voxels of 0.5 mm, chunks of 32³, one dispatch a chunk and one submission an event; the time ends when the \
         count of removed voxels has come back. *CPU*: the same kernel, scalar, on one thread. *Differ*: voxels that the \
         two end with differently; shaders may fuse a product with a sum.",
        &[
            "tool",
            "adapter",
            "chunks",
            "adapter p50, ms",
            "p99, ms",
            "CPU p50, ms",
            "thesis (GTX 1070), ms",
            "removed",
            "differ",
        ],
    );
    let mut facts = Vec::new();
    for (tool, theirs) in scene.tools.iter().zip(THEIRS) {
        let m = one(scene, adapter, effort, tool)?;
        table.push([
            tool.name.clone(),
            adapter.brief().name.clone(),
            format!("{} (thesis {})", m.chunks, theirs.1),
            format!("{:.3}", m.adapter_ms[0]),
            format!("{:.3}", m.adapter_ms[1]),
            format!("{:.3}", m.cpu_ms),
            format!("{:.3}", theirs.0),
            m.removed.to_string(),
            m.differing.to_string(),
        ]);
        facts.push(json!({
            "tool": tool.id, "adapter": adapter.brief().name, "chunks": m.chunks,
            "adapter_ms_p50": m.adapter_ms[0], "adapter_ms_p99": m.adapter_ms[1], "cpu_ms_p50": m.cpu_ms,
            "thesis_ms": theirs.0, "removed": m.removed, "differing": m.differing
        }));
    }
    output.tables.push(table);
    output.facts.push(("thesis_kernel", json!(facts)));
    Ok(())
}

/// One tool's events.
struct Measured {
    // most of an event
    chunks: usize,
    // p50 and p99
    adapter_ms: [f64; 2],
    cpu_ms: f64,
    removed: u64,
    differing: usize,
}

fn one(scene: &Scene, adapter: &Adapter, effort: &Effort, tool: &Tool) -> Result<Measured> {
    let voxels = VoxelTool::of_shape(THESIS_VOXEL_MM, tool.shape.clone())
        .with_context(|| format!("{} cannot be voxelised", tool.id))?;
    let mut cpu = Thesis::chunks_of_32(&scene.bone, &voxels);
    let mut ours = ThesisOnAdapter::new(&scene.bone, &voxels, adapter.device())?;
    let (mut on_adapter, mut on_cpu) = (Vec::new(), Vec::new());
    let (mut removed, mut chunks) = (0, 0);
    for n in 0..effort.events {
        let depth = -1.0 + 4.0 * n as f64 / effort.events as f64;
        let pose = scene.step(depth, depth).after;
        chunks = chunks.max(ours.chunks_hit(&pose));
        let begin = Instant::now();
        ours.event(&pose)?;
        on_adapter.push(begin.elapsed().as_secs_f64() * 1e3);
        let begin = Instant::now();
        removed += cpu.event(&pose);
        on_cpu.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    let (differing, _) = ours.differing(&cpu)?;
    Ok(Measured {
        chunks,
        adapter_ms: [0.5, 0.99].map(|q| quantile(&on_adapter, q)),
        cpu_ms: quantile(&on_cpu, 0.5),
        removed,
        differing,
    })
}
