//! Tables: a CSV file and the same table in Markdown.

use anyhow::{Context as _, Result};
use std::fmt::Write as _;
use std::path::Path;

/// A table of a report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    /// File name without its ending.
    pub stem: String,
    /// Heading.
    pub title: String,
    /// What a reader must know to read it; may be empty.
    pub note: String,
    /// Column names, with units.
    pub columns: Vec<String>,
    /// Cells, as wide as `columns`.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table.
    pub fn new(stem: &str, title: &str, note: &str, columns: &[&str]) -> Self {
        Self {
            stem: stem.to_owned(),
            title: title.to_owned(),
            note: note.to_owned(),
            columns: columns.iter().map(|&c| c.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row; missing cells stay empty, surplus ones are dropped.
    pub fn push(&mut self, cells: impl IntoIterator<Item = String>) {
        let mut row: Vec<String> = cells.into_iter().take(self.columns.len()).collect();
        row.resize(self.columns.len(), String::new());
        self.rows.push(row);
    }

    /// The table as CSV (RFC 4180).
    pub fn csv(&self) -> String {
        let mut text = String::new();
        for row in std::iter::once(&self.columns).chain(&self.rows) {
            let cells: Vec<String> = row.iter().map(|c| quoted(c)).collect();
            text.push_str(&cells.join(","));
            text.push('\n');
        }
        text
    }

    /// The table as Markdown, its title as a heading and a link to the CSV.
    pub fn markdown(&self) -> String {
        let mut text = format!("### {}\n\n", self.title);
        let line = |row: &[String]| {
            let cells: Vec<String> = row.iter().map(|c| c.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        text.push_str(&line(&self.columns));
        text.push_str(&"|---".repeat(self.columns.len()));
        text.push_str("|\n");
        for row in &self.rows {
            text.push_str(&line(row));
        }
        // writing to a string cannot fail
        let _infallible = write!(text, "\n{} [CSV]({}.csv)\n\n", self.note, self.stem);
        text
    }

    /// Writes `STEM.csv` into a folder.
    pub fn write(&self, dir: &Path) -> Result<()> {
        let path = dir.join(format!("{}.csv", self.stem));
        std::fs::write(&path, self.csv()).with_context(|| format!("writing {}", path.display()))
    }
}

fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// A number with three significant digits; "–" for none and for what is no number.
pub fn short(value: Option<f64>) -> String {
    match value {
        Some(v) if v.is_finite() => {
            let size = v.abs();
            if size >= 100.0 || size == 0.0 {
                format!("{v:.0}")
            } else if size >= 10.0 {
                format!("{v:.1}")
            } else if size >= 1.0 {
                format!("{v:.2}")
            } else if size >= 1e-3 {
                let digits = 2.0 - size.log10().floor();
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "3 to 5"
                )]
                let digits = digits as usize;
                format!("{v:.digits$}")
            } else {
                format!("{v:.1e}")
            }
        }
        _ => "–".to_owned(),
    }
}

/// A ratio as a percentage.
pub fn percent(value: Option<f64>) -> String {
    match value {
        Some(v) if v.is_finite() => format!("{} %", short(Some(100.0 * v))),
        _ => short(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_needs_it_and_rows_are_as_wide_as_the_head() {
        let mut table = Table::new("t", "T", "A note.", &["a", "b"]);
        table.push(["1,5".to_owned()]);
        table.push(["say \"x\"".to_owned(), "2".to_owned(), "surplus".to_owned()]);
        assert_eq!(table.csv(), "a,b\n\"1,5\",\n\"say \"\"x\"\"\",2\n");
        assert!(
            table
                .markdown()
                .contains("| a | b |\n|---|---|\n| 1,5 |  |\n")
        );
        assert!(table.markdown().contains("A note. [CSV](t.csv)"));
    }

    #[test]
    fn numbers_have_three_digits() {
        let all = [1234.5, 56.78, 3.456, 0.012_345, 0.000_012_3, 0.0, -7.125];
        let texts = all.map(|v| short(Some(v)));
        assert_eq!(
            texts,
            ["1234", "56.8", "3.46", "0.0123", "1.2e-5", "0", "-7.12"]
        );
        assert_eq!(short(None), "–");
        assert_eq!(percent(Some(f64::NAN)), "–");
        assert_eq!(percent(Some(0.005)), "0.500 %");
    }
}
