//! Which methods a report compares. This is the one place where methods are added.

use super::tools;
use crate::baselines::simd::Isa as WideIsa;
use crate::baselines::{Baseline, VoxelTool, all};
use crate::report::carver::{Carver, Kernel, Rival, WholeVoxels};
use anyhow::{Context as _, Result};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{Isa, Model};
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
    voxels: VoxelTool,
    // the tool as a mesh on a grid, where it was asked for
    meshed: Option<Tool>,
}

impl Kit {
    /// With the thesis's cells of 0.5 mm.
    pub fn new(tool: Tool) -> Result<Self> {
        Self::with_cells(tool, tools::THESIS_CELL_MM)
    }

    /// With cells of `cell_mm`.
    pub fn with_cells(tool: Tool, cell_mm: f64) -> Result<Self> {
        let voxels = VoxelTool::of_shape(cell_mm, tool.shape.clone())
            .with_context(|| format!("{} in voxels of {cell_mm} mm", tool.id))?;
        Ok(Self {
            tool,
            cell_mm,
            voxels,
            meshed: None,
        })
    }

    /// With the tool as a mesh too.
    pub fn and_meshed(self) -> Result<Self> {
        let meshed = Some(tools::meshed(&self.tool)?);
        Ok(Self { meshed, ..self })
    }
}

/// All methods: ours first.
pub fn carvers<'a>(bone: &'a Bone, kit: &'a Kit) -> Carvers<'a> {
    let mut carvers = ours(bone, kit);
    carvers.extend(sampled(bone, kit));
    carvers
}

/// Ours alone: on the widest vector unit, on the others, and with the tool as a mesh.
pub fn ours<'a>(bone: &'a Bone, kit: &'a Kit) -> Carvers<'a> {
    let mut carvers: Carvers<'a> = vec![Box::new(Kernel::new(bone, &kit.tool))];
    for isa in Isa::ALL {
        if isa.is_available() && isa != Isa::best() {
            carvers.push(Box::new(Kernel::on(bone, &kit.tool, isa)));
        }
    }
    if let Some(tool) = &kit.meshed {
        carvers.push(Box::new(Kernel::new(bone, tool)));
    }
    carvers
}

/// Methods whose tool is sampled in cells of [`Kit::cell_mm`].
pub fn sampled<'a>(bone: &'a Bone, kit: &'a Kit) -> Carvers<'a> {
    let rival = |method: Box<dyn Baseline + 'a>| -> Box<dyn Carver + 'a> {
        let wide = method.name() == "thesis-32-simd";
        let rival = Rival::new(bone, method);
        Box::new(if wide {
            rival.running_on(match WideIsa::best() {
                WideIsa::Avx512 => "avx512",
                WideIsa::Avx2 => "avx2",
                WideIsa::Scalar => "scalar",
            })
        } else {
            rival
        })
    };
    all(bone, &kit.voxels).into_iter().map(rival).collect()
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
    let variant = |model: Model, suffix: &str| -> Box<dyn Carver + 'a> {
        Box::new(Kernel::variant(bone, &kit.tool, suffix, model))
    };
    vec![
        Variant {
            left_out: "sweep (one stamp an event)",
            carver: stamping(bone, kit),
        },
        Variant {
            left_out: "curvature correction",
            carver: variant(
                Model {
                    curvature: false,
                    ..Model::FULL
                },
                "no-curvature",
            ),
        },
        Variant {
            left_out: "account by class, label and tool",
            carver: variant(
                Model {
                    account: false,
                    ..Model::FULL
                },
                "no-account",
            ),
        },
        Variant {
            left_out: "sub-voxel field (read by whole voxels, still made: no time saved)",
            carver: Box::new(WholeVoxels::new(bone, &kit.tool)),
        },
    ]
}

/// Parts of the model that the issue names and that no variant leaves out yet: they show as dashes.
pub const NOT_SEPARABLE: [&str; 1] = ["band (the surface cannot be read without it)"];
