//! Getting the feel: the defaults, changed by a TOML file of parameters.

mod print;
mod toml_feel;

#[cfg(test)]
mod tests;

pub use print::to_toml;

use osteon_sim_core::feel::{FIELDS, Feel};
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;

/// Which parameters a session has.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct FeelArgs {
    /// Stiffness, cutting law, materials, guards: TOML of what differs from the defaults. A copy of
    /// firmware-bridge/feel/standard.toml (--print-feel prints it) has every parameter with its unit, its
    /// range and its source
    #[arg(long, value_name = "FILE")]
    pub feel: Option<PathBuf>,
    /// Print all parameters as a file for --feel, with what --feel changes, and end
    #[arg(long)]
    pub print_feel: bool,
}

/// Why there is no feel: one line with what, where and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum FeelFileError {
    /// The file cannot be read.
    #[error("{}: cannot be read ({reason}); check the path given with --feel", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// It is no TOML.
    #[error("{}: line {line}: {problem}; compare with firmware-bridge/feel/standard.toml", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where, from 1.
        line: usize,
        /// What the reader says.
        problem: String,
    },
    /// A parameter that there is not, or a value that it cannot have.
    #[error("{}: line {line}: {problem}", path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// Where, from 1.
        line: usize,
        /// What is wrong with which key, and the remedy.
        problem: String,
    },
}

/// The parameters of a file over the defaults, or the defaults where none is named.
pub fn load(args: &FeelArgs) -> Result<Feel, FeelFileError> {
    match &args.feel {
        Some(path) => toml_feel::load(path),
        None => Ok(Feel::default()),
    }
}

/// Does what `--print-feel` asks for; true where it was asked.
pub(crate) fn printed(args: &FeelArgs) -> anyhow::Result<bool> {
    if args.print_feel {
        let text = to_toml(&load(args)?);
        std::io::stdout().write_all(text.as_bytes())?;
    }
    Ok(args.print_feel)
}

/// Every parameter by its key, for reports.
pub fn in_force(feel: &Feel) -> BTreeMap<&'static str, f64> {
    FIELDS.iter().map(|f| (f.key, f.get(feel))).collect()
}
