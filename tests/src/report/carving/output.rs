//! What a report collects and writes.

use super::floors;
use super::rows::{Effort, Row};
use crate::report::Machine;
use crate::report::plot::Plot;
use crate::report::table::{Table, short};
use crate::scenes::bones::BuiltBone;
use anyhow::{Context as _, Result};
use osteon_firmware_bridge::progress::Progress;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Facts of a bone that outlive it.
#[derive(Debug, Clone)]
pub struct BoneFacts {
    /// What it is.
    pub name: String,
    /// Spacing along x, mm.
    pub voxel_mm: f64,
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Chunks along x, y, z.
    pub chunk_dims: [usize; 3],
    /// Chunks kept.
    pub chunks: usize,
    /// Voxels whose centre is bone.
    pub solid_voxels: usize,
    /// Building it, s.
    pub seconds: f64,
}

/// Seconds of a part.
#[derive(Debug, Clone, Serialize)]
pub(super) struct PartTime {
    /// Its name.
    pub part: String,
    /// How long it took.
    pub seconds: f64,
}

/// The report while it is being made.
#[derive(Debug)]
pub struct Output {
    dir: PathBuf,
    machine: Machine,
    /// How much is measured.
    pub effort: Effort,
    /// All rows so far.
    pub rows: Vec<Row>,
    /// All scapulas so far.
    pub bones: Vec<BoneFacts>,
    parts: Vec<PartTime>,
    text: String,
    progress: Progress,
    part: &'static str,
    share: f32,
}

#[derive(Serialize)]
struct Json<'a> {
    report: &'static str,
    quick: bool,
    machine: &'a Machine,
    parts: &'a [PartTime],
    floors: &'a [floors::Verdict],
    rows: &'a [Row],
}

impl Output {
    /// An empty report into a folder that exists.
    pub fn new(dir: PathBuf, effort: Effort, machine: Machine) -> Self {
        Self {
            dir,
            machine,
            effort,
            rows: Vec::new(),
            bones: Vec::new(),
            parts: Vec::new(),
            text: String::new(),
            progress: Progress::new("carving report"),
            part: "",
            share: 0.0,
        }
    }

    /// Adds Markdown to the document.
    pub fn say(&mut self, markdown: &str) {
        self.text.push_str(markdown);
        self.text.push_str("\n\n");
    }

    /// Writes a table and shows it.
    pub fn table(&mut self, table: &Table) -> Result<()> {
        table.write(&self.dir)?;
        self.text.push_str(&table.markdown());
        Ok(())
    }

    /// Writes a plot and shows it.
    pub fn plot(&mut self, plot: &Plot) -> Result<()> {
        plot.write(&self.dir)?;
        self.text.push_str(&plot.markdown());
        Ok(())
    }

    /// Notes a bone's facts.
    pub fn note_bone(&mut self, name: &str, built: &BuiltBone) {
        let grid = built.bone.grid();
        self.bones.push(BoneFacts {
            name: name.to_owned(),
            voxel_mm: grid.spacing_mm.x,
            dims: grid.dims,
            chunk_dims: grid.chunk_dims(),
            chunks: built.bone.chunk_count(),
            solid_voxels: built.solid_voxels,
            seconds: built.seconds,
        });
    }

    /// Says that a part begins, `share` of the report being done.
    pub fn part_begins(&mut self, part: &'static str, share: f32) {
        (self.part, self.share) = (part, share);
        self.stage("");
    }

    /// Says what the part is at.
    pub fn stage(&mut self, what: &str) {
        self.progress
            .show(&format!("{} {what}", self.part), self.share);
    }

    /// Notes how long a part took and says so.
    pub fn part_done(&mut self, part: &str, seconds: f64) {
        #[expect(clippy::print_stderr, reason = "progress of a command")]
        {
            eprintln!("carving report: {part} {seconds:.1} s");
        }
        self.parts.push(PartTime {
            part: part.to_owned(),
            seconds,
        });
    }

    /// Writes carving.json and carving.md, and where they are.
    pub fn finish(mut self, quick: bool) -> Result<()> {
        self.progress.finish();
        self.machine.finish();
        let verdicts = floors::verdicts(&self.rows);
        let json = Json {
            report: "carving",
            quick,
            machine: &self.machine,
            parts: &self.parts,
            floors: &verdicts,
            rows: &self.rows,
        };
        let path = self.dir.join("carving.json");
        let text = serde_json::to_string_pretty(&json).context("carving.json")?;
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
        floors::table(&verdicts).write(&self.dir)?;
        let document = self.document(quick, &verdicts);
        let path = self.dir.join("carving.md");
        std::fs::write(&path, document).with_context(|| format!("writing {}", path.display()))?;
        #[expect(clippy::print_stderr, reason = "what a command says at its end")]
        {
            eprintln!("carving report: {}", path.display());
        }
        Ok(())
    }

    fn document(&self, quick: bool, verdicts: &[floors::Verdict]) -> String {
        let mut text = String::from("# Carving: time, error, memory\n\n");
        if quick {
            text.push_str("**A quick run: small scenes and few events. It checks the report and measures nothing.**\n\n");
        }
        let total: f64 = self.parts.iter().map(|p| p.seconds).sum();
        let parts: Vec<String> = self
            .parts
            .iter()
            .map(|p| format!("{} {:.0} s", p.part, p.seconds))
            .collect();
        // writing to a string cannot fail
        let _infallible = write!(
            text,
            "Machine: {}.\n\nMade with `osteon report carving --out DIR` in {total:.0} s ({}). All figures \
             are in [carving.json](carving.json); every table and plot has its CSV beside it.\n\n{METHOD}\n\n\
             ## What was asked for and what was measured\n\n{}",
            self.machine.words(),
            parts.join(", "),
            floors::table(verdicts).markdown(),
        );
        text.push_str(&floors::shortfall(verdicts));
        text.push_str(&self.text);
        text
    }
}

const METHOD: &str = "\
## How it was measured

* **Intrinsic time**: the same deterministic events are replayed at least three times from the same start on \
one pinned core, all methods in turns (round robin), and the least time of each event is kept; quantiles are over events. *p50*, *p99* \
and *max* are over **contact events** (those that changed something), *mean* over all events; the raw quantiles, noise included, are in \
carving.json. The account of removed volume is in every time of ours. Slow methods run every n-th event only (the others are not \
carved, which leaves scallops in the error of fast ways): the column *events* says how many; ratios are of the means over the events that both methods ran.
* **Error of the same run that was timed**: signed distance along exact normals between the exact swept tool and the surface \
where the method's own field changes sign, at points at least 1.5 voxels inside the bone. *Surface* figures are away from creases; within 1.5 voxels of a \
corner of the tool or of an edge between two cuts errors are shown apart. Volume: against an integration of the exact distance. \
*missed* and *excess* are voxels by their centres.
* A failure (a surface that was not found, a method that is not there) is a cross in a plot and a dash in a table, never a gap that \
looks like a zero.
* *bytes* of ours are all fields of the kept chunks and the cut's whole pool.";

/// Cells for a row's table.
pub(super) fn row_cells(row: &Row) -> Vec<String> {
    let frac = |v: Option<f64>| crate::report::table::percent(v);
    vec![
        row.scene.clone(),
        row.method.clone(),
        row.isa.clone(),
        if row.events < row.events_total {
            format!("{} of {}", row.events, row.events_total)
        } else {
            row.events.to_string()
        },
        row.contact_events.to_string(),
        short(row.p50_us),
        short(row.p99_us),
        short(row.max_us),
        short(row.mean_us),
        short(row.surface_rms_um),
        short(row.surface_max_um),
        short(row.crease_max_um),
        row.surface_lost.to_string(),
        frac(row.volume_rel_err),
        frac(row.missed_frac),
        frac(row.excess_frac),
        short(row.ratio_thesis_scalar),
        short(row.ratio_thesis_simd),
    ]
}

/// Head of a table of rows.
pub(super) const ROW_COLUMNS: [&str; 18] = [
    "scene",
    "method",
    "isa",
    "events",
    "contact",
    "p50 µs",
    "p99 µs",
    "max µs",
    "mean µs",
    "surface RMS µm",
    "max µm",
    "crease max µm",
    "lost",
    "volume",
    "missed",
    "excess",
    "× thesis",
    "× thesis SIMD",
];
