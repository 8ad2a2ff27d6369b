//! What the report collects and writes.

use crate::report::plot::Plot;
use crate::report::table::Table;
use anyhow::{Context as _, Result};
use osteon_firmware_bridge::progress::Progress;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// The report while it is being made. A section that was not measured is not in it.
#[derive(Debug)]
pub struct Output {
    dir: PathBuf,
    sections: Map<String, Value>,
    parts: Vec<(&'static str, f64)>,
    text: String,
    progress: Progress,
    part: &'static str,
    share: f32,
}

impl Output {
    /// An empty report into a folder that exists.
    pub fn new(dir: PathBuf) -> Self {
        Self {
            dir,
            sections: Map::new(),
            parts: Vec::new(),
            text: String::new(),
            progress: Progress::new("stability report"),
            part: "",
            share: 0.0,
        }
    }

    /// Adds Markdown to the document.
    pub fn say(&mut self, markdown: &str) {
        self.text.push_str(markdown);
        self.text.push_str("\n\n");
    }

    /// Puts rows into stability.json under a name.
    pub fn section(&mut self, name: &str, rows: &impl Serialize) -> Result<()> {
        let value = serde_json::to_value(rows).with_context(|| format!("the section '{name}'"))?;
        self.sections.insert(name.to_owned(), value);
        Ok(())
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
    pub fn part_done(&mut self, part: &'static str, seconds: f64) {
        #[expect(clippy::print_stderr, reason = "progress of a command")]
        {
            eprintln!("stability report: {part} {seconds:.1} s");
        }
        self.parts.push((part, seconds));
    }

    /// Writes stability.json and stability.md, and where they are.
    pub fn finish(mut self) -> Result<()> {
        self.progress.finish();
        let parts: Vec<Value> = self
            .parts
            .iter()
            .map(|(part, seconds)| json!({"part": part, "seconds": seconds}))
            .collect();
        self.sections
            .insert("report".to_owned(), "stability".into());
        self.sections.insert("parts".to_owned(), parts.into());
        let text = serde_json::to_string_pretty(&self.sections).context("stability.json")?;
        self.write("stability.json", &text)?;
        self.write("stability.md", &self.document())?;
        #[expect(clippy::print_stderr, reason = "what a command says at its end")]
        {
            eprintln!(
                "stability report: {}",
                self.dir.join("stability.md").display()
            );
        }
        Ok(())
    }

    fn write(&self, name: &str, text: &str) -> Result<()> {
        let path = self.dir.join(name);
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
    }

    fn document(&self) -> String {
        let total: f64 = self.parts.iter().map(|p| p.1).sum();
        let parts: Vec<String> = self
            .parts
            .iter()
            .map(|(part, seconds)| format!("{part} {seconds:.0} s"))
            .collect();
        format!(
            "# The force loop: stillness, safety, truth\n\nMade with `osteon report stability --out DIR` in {total:.0} s \
             ({}). All figures are in [stability.json](stability.json); every table and plot has its CSV beside \
             it.\n\n{METHOD}\n\n{}",
            parts.join(", "),
            self.text
        )
    }
}

const METHOD: &str = "\
## How it was measured

* **The loop** is the real servo, from encoder counts to converter counts, on a virtual clock of 1 kHz. Against it stands a point of \
45 g with 0.1 N·s/m of viscous and 0.1 N of Coulomb friction, integrated at 20 kHz, behind the kinematics of the arm: encoders of \
15,000 counts a revolution that floor, converters that round. *Delay*: from a sample to the moment at which its command is in force, in ticks.
* **Hands**: *none* (the bare device under a constant push), *light* (20 g, 0.5 N·s/m, 50 N/m), *grip* (100 g, 4 N·s/m, 400 N/m).
* **Energy** is counted at the plant, from the force that really acted and the way that was really made; the servo's own account \
has no part in it.
* The device is a point without the resonances of a real arm (some tens of Hz), so that stiffness limits are optimistic.";
