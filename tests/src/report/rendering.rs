//! `osteon report rendering`: frame times, picture errors and memory of every method of drawing, the
//! cost of meshing again, and the thesis's chunk kernel on the graphics adapter.

mod figures;
mod kernel;
mod rows;
mod scene;
#[cfg(test)]
mod tests;

pub use rows::Row;

use super::Machine;
use super::plot::Plot;
use super::table::Table;
use crate::measure::intrinsic;
use anyhow::{Context as _, Result};
use osteon_firmware_bridge::progress::Progress;
use osteon_viewer::AdapterBrief;
use osteon_viewer::lab::Adapter;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What to measure and where to write it.
#[derive(Debug, Clone, clap::Args)]
pub struct RenderingArgs {
    /// Folder for rendering.json, rendering.md, tables, plots and pictures; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// A coarse bone, small pictures, few frames: a check of the report, not a measurement
    #[arg(long)]
    pub quick: bool,
}

/// How much is measured.
#[derive(Debug, Clone)]
struct Effort {
    // sizes of the picture, and frames of each kind
    sizes: Vec<([u32; 2], usize)>,
    // of figures 3.13 and 3.14
    figure: ([u32; 2], usize),
    counts: Vec<f64>,
    // of the pictures' errors: size, and rays along a pixel's edge
    error_size: [u32; 2],
    samples: u32,
    rounds: usize,
    events: usize,
    quick: bool,
}

impl Effort {
    fn new(quick: bool) -> Self {
        if quick {
            return Self {
                sizes: vec![([160, 90], 3)],
                figure: ([160, 90], 2),
                counts: vec![0.5, 1.0],
                error_size: [160, 90],
                samples: 2,
                rounds: 2,
                events: 4,
                quick,
            };
        }
        Self {
            sizes: vec![([640, 360], 15), ([1280, 720], 9), ([2560, 1440], 5)],
            figure: ([1280, 720], 5),
            counts: vec![0.02, 0.25, 0.5, 0.75, 1.0],
            error_size: [640, 360],
            samples: 4,
            rounds: 60,
            events: 40,
            quick,
        }
    }
}

/// What the report is made of.
#[derive(Debug)]
struct Output {
    rows: Vec<Row>,
    tables: Vec<Table>,
    plots: Vec<Plot>,
    facts: Vec<(&'static str, Value)>,
}

/// Measures and writes.
pub fn run(args: &RenderingArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    let effort = Effort::new(args.quick);
    let adapter = Adapter::open()?;
    let name = adapter.brief().clone();
    let not_pinned = Err("drawing takes all cores that it finds".to_owned());
    let mut machine = Machine::look(not_pinned, intrinsic::timer_cost_ns());
    let mut progress = Progress::new("rendering report");
    progress.show("the bone", 0.0);
    let scene = scene::load(args.quick)?;
    let mut output = Output {
        rows: Vec::new(),
        tables: Vec::new(),
        plots: Vec::new(),
        facts: Vec::new(),
    };
    rows::measure(
        &scene,
        &effort,
        &args.out,
        &mut output,
        &mut |what, share| {
            progress.show(what, 0.05 + 0.6 * share);
        },
    )?;
    progress.show("figures 3.13 to 3.16", 0.65);
    figures::measure(&scene, &effort, &mut output)?;
    progress.show("the thesis's kernel", 0.95);
    if let Err(e) = kernel::measure(&scene, &adapter, &effort, &mut output) {
        // an adapter without compute shaders still draws
        output
            .facts
            .push(("thesis_kernel", json!({ "error": format!("{e:#}") })));
    }
    progress.finish();
    machine.finish();
    let known = Known {
        scene: &scene,
        adapter: &name,
        machine: &machine,
        quick: args.quick,
    };
    write(&args.out, &known, &output)?;
    #[expect(clippy::print_stderr, reason = "what a command says at its end")]
    {
        eprintln!(
            "rendering report: {}",
            args.out.join("rendering.md").display()
        );
    }
    Ok(())
}

/// On what it was measured.
struct Known<'a> {
    scene: &'a scene::Scene,
    adapter: &'a AdapterBrief,
    machine: &'a Machine,
    quick: bool,
}

fn write(out: &Path, known: &Known<'_>, output: &Output) -> Result<()> {
    for table in &output.tables {
        table.write(out)?;
    }
    for plot in &output.plots {
        plot.write(out)?;
    }
    let threads = std::env::var("LP_NUM_THREADS").ok();
    let mut document = json!({
        "report": "rendering", "quick": known.quick, "scene": known.scene.name, "adapter": known.adapter,
        "raster_threads": threads, "machine": known.machine, "rows": output.rows
    });
    for (key, value) in &output.facts {
        document[key] = value.clone();
    }
    let write = |file: &str, text: &str| {
        let path = out.join(file);
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
    };
    write("rendering.json", &serde_json::to_string_pretty(&document)?)?;
    write("rendering.md", &text(known, output)?)
}

fn text(known: &Known<'_>, output: &Output) -> Result<String> {
    let adapter = known.adapter;
    let mut text = format!(
        "# Drawing the bone\n\nMade with `osteon report rendering --out DIR`{} on the adapter **{}** ({}), {}. Bone: \
         {}. {}. All figures are in [rendering.json](rendering.json).\n\n{METHOD}\n\n",
        if known.quick {
            " (with `--quick`: a check, not a measurement)"
        } else {
            ""
        },
        adapter.name,
        adapter.backend,
        if adapter.is_cpu {
            "which is the CPU: no graphics card drew here"
        } else {
            "a graphics card"
        },
        known.scene.words(),
        known.machine.words(),
    );
    for table in &output.tables {
        text.push_str(&table.markdown());
    }
    for plot in &output.plots {
        text.push_str(&plot.markdown());
    }
    text.push_str("### Pictures\n\nAfter carving, without shadows of the key light.\n\n");
    for kind in osteon_viewer::RendererKind::ALL {
        writeln!(text, "![{0}]({0}.png) {0}\n", kind.name())?;
    }
    Ok(text)
}

const METHOD: &str = "A frame's time runs from the first upload to the adapter's word that all is drawn; the view \
    holds the whole bone and no tool. *Idle*: the same frame again. *Carving*: before each frame the reamer sinks \
    0.05 mm and what it cut is taken over, as from the link; the carving itself is not counted. Idle and carving \
    frames alternate. With few frames p99 is the longest. *Reference*: a ray-march in 64-bit floats on the CPU through \
    the fields as the servo reads them, 16 rays a pixel, which shares no code with the shaders. *Silhouette*: how much \
    bone a method shows too much or too little, in pixels. *Depth* and *normal*: over the pixels that lie on one \
    surface in both pictures. The voxels' methods (cubes, greedy, splats) draw voxels, so their normals are off by \
    design.";
