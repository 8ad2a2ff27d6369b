//! Getting tools: the built-in set, or a TOML file with solids of revolution and meshes.

mod mesh_tool;
pub mod stl;
mod toml_tool;

#[cfg(test)]
mod tests;

use osteon_sim_core::tool::Tool;
use osteon_sim_core::tool::mesh::MeshError;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Most tools of a session: what a viewer's message can hold.
pub const MAX_TOOLS: usize = osteon_protocol::ipc_frame::MAX_TOOLS;

/// Which tools a session has.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ToolArgs {
    /// Tools: TOML, see 'Your own tools' in the README [default: peg drill and glenoid reamer]
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
}

/// How much of a mesh is worked out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// All, for carving.
    Full,
    /// The surface elements as for carving, the distance on a grid of 1 mm: enough to plan a stroke.
    Elements,
}

/// Tools, and what people should know about them.
#[derive(Debug, Clone)]
pub struct LoadedTools {
    /// The tools, in the order of their index and hotkey; at least one.
    pub tools: Vec<Tool>,
    /// One line each: what was mended, sizes and errors of grids.
    pub notes: Vec<String>,
}

/// Why there are no tools: one line with what, where and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum ToolError {
    /// The file cannot be read.
    #[error("{}: cannot be read ({reason}); check the path given with --tools", path.display())]
    Read {
        /// The tools file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// It is no TOML, or has a field that no tool has, or lacks one.
    #[error("{}: line {line}: {problem}; compare with firmware-bridge/tools/examples.toml", path.display())]
    Syntax {
        /// The tools file.
        path: PathBuf,
        /// Where, from 1.
        line: usize,
        /// What the reader says.
        problem: String,
    },
    /// A number of tools that cannot be.
    #[error("{}: {count} tools; list 1 to {MAX_TOOLS}", path.display())]
    Count {
        /// The tools file.
        path: PathBuf,
        /// How many there are.
        count: usize,
    },
    /// A value out of its range, or values that do not go together.
    #[error("{}: tool {tool}: {field}: {problem}", path.display())]
    Field {
        /// The tools file.
        path: PathBuf,
        /// The tool's id.
        tool: String,
        /// The field.
        field: String,
        /// What is wrong, and the remedy.
        problem: String,
    },
    /// An STL file that cannot be read.
    #[error("{}: {problem} (for tool {tool})", path.display())]
    Stl {
        /// The STL file.
        path: PathBuf,
        /// What is wrong, and the remedy.
        problem: stl::StlError,
        /// The tool's id.
        tool: String,
    },
    /// Triangles that are no solid.
    #[error("{}: {problem} (for tool {tool})", path.display())]
    Mesh {
        /// The STL file.
        path: PathBuf,
        /// What is wrong, and the remedy.
        problem: MeshError,
        /// The tool's id.
        tool: String,
    },
}

/// The tools of a file, or the built-in set where none is named.
pub fn load(args: &ToolArgs, detail: Detail) -> Result<LoadedTools, ToolError> {
    match &args.tools {
        Some(path) => toml_tool::load(path, detail),
        None => Ok(LoadedTools {
            tools: Tool::standard_set(),
            notes: Vec::new(),
        }),
    }
}

/// The layers of a grid on all cores; their values are those of one core.
pub(crate) fn on_all_cores(
    count: usize,
    layer: &(dyn Fn(usize) -> Vec<i16> + Sync),
) -> Vec<Vec<i16>> {
    (0..count).into_par_iter().map(layer).collect()
}

fn in_folder_of(file: &Path, name: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(name)
}
