//! Which methods a report compares. This is the one place where methods are added.

use super::tools;
use crate::report::carver::{Carver, Kernel, WholeVoxels};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::tool::Tool;

/// Methods of one scene.
pub type Carvers<'a> = Vec<Box<dyn Carver + 'a>>;

/// A tool in all the forms that methods need: methods borrow it.
#[derive(Debug)]
pub struct Kit {
    /// The tool.
    pub tool: Tool,
    /// Edge of a cell where a method samples the tool, mm.
    pub cell_mm: f64,
}

impl Kit {
    /// With the thesis's cells of 0.5 mm.
    pub fn new(tool: Tool) -> Self {
        Self::with_cells(tool, tools::THESIS_CELL_MM)
    }

    /// With cells of `cell_mm`.
    pub fn with_cells(tool: Tool, cell_mm: f64) -> Self {
        Self { tool, cell_mm }
    }
}

/// All methods: ours first.
pub fn carvers<'a>(bone: &'a Bone, kit: &'a Kit) -> Carvers<'a> {
    vec![Box::new(Kernel::new(bone, &kit.tool))]
}

/// Ours alone.
pub fn ours<'a>(bone: &'a Bone, kit: &'a Kit) -> Carvers<'a> {
    vec![Box::new(Kernel::new(bone, &kit.tool))]
}

/// Methods whose tool is sampled in cells of [`Kit::cell_mm`].
pub fn sampled<'a>(_bone: &'a Bone, _kit: &'a Kit) -> Carvers<'a> {
    Vec::new()
}

/// One stamp an event, for the plot over sub-steps.
pub fn stamping<'a>(bone: &'a Bone, kit: &'a Kit) -> Box<dyn Carver + 'a> {
    Box::new(Kernel::stamping(bone, &kit.tool))
}

/// A part of the model that can be left out.
pub struct Variant<'a> {
    /// What is left out, as the table names it.
    pub left_out: &'static str,
    /// The model without it.
    pub carver: Box<dyn Carver + 'a>,
}

impl std::fmt::Debug for Variant<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "without {}", self.left_out)
    }
}

/// The full model's variants, each with one part left out.
pub fn variants<'a>(bone: &'a Bone, kit: &'a Kit) -> Vec<Variant<'a>> {
    vec![
        Variant {
            left_out: "sweep (one stamp an event)",
            carver: stamping(bone, kit),
        },
        Variant {
            left_out: "sub-voxel field (read by whole voxels, still made: no time saved)",
            carver: Box::new(WholeVoxels::new(bone, &kit.tool)),
        },
    ]
}

/// Parts of the model that the issue names and that no variant leaves out yet: they show as dashes.
pub const NOT_SEPARABLE: [&str; 3] = ["curvature correction", "band", "class accounting"];
