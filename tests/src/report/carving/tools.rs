//! Tools of the report's scenes.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 inside a tool"
)]

use anyhow::{Context as _, Result};
use glam::Vec3;
use osteon_sim_core::tool::bvh::Triangle;
use osteon_sim_core::tool::mesh::Mesh;
use osteon_sim_core::tool::revolved::{Face, Form, Part, Revolved};
use osteon_sim_core::tool::sdf_grid::SdfGrid;
use osteon_sim_core::tool::{STEEL, Shape, Tool};
use rayon::prelude::*;
use std::sync::Arc;

/// Edge of a tool voxel of the thesis, mm.
pub(super) const THESIS_CELL_MM: f64 = 0.5;
/// Heights and facets of a tool's mesh.
const MESH: (u16, u16) = (160, 180);

/// A tool of convex parts that only carves: no surface elements.
fn of([name, id]: [&str; 2], parts: &[&[Form]]) -> Tool {
    #[expect(clippy::expect_used, reason = "the forms below make closed solids")]
    let solid = Revolved::new(parts.iter().map(|forms| part(forms)).collect()).expect("closed");
    Tool {
        name: name.to_owned(),
        id: id.to_owned(),
        shape: Shape::Revolved(solid),
        elements: Vec::new(),
        facets: Vec::new(),
        rpm: 1000.0,
        lips: 4,
        stall_nmm: None,
        colour: STEEL,
    }
}

fn part(forms: &[Form]) -> Part {
    let faces = forms.iter().map(|&form| Face {
        form,
        cutting: true,
    });
    Part {
        faces: faces.collect(),
    }
}

fn plane(height: f64, up: bool) -> Form {
    Form::Plane {
        height_mm: height as f32,
        up,
    }
}

/// A ball-nosed cylinder, `height` mm from the apex.
fn ball_nose(names: [&str; 2], radius: f64, height: f64) -> Tool {
    let nose = Form::Ball {
        radius_mm: radius as f32,
        centre_mm: radius as f32,
    };
    let shank = [
        Form::cylinder(radius as f32),
        // the parts overlap: where they only touched, a film of bone would be left
        plane(radius - 0.05, false),
        plane(height, true),
    ];
    of(names, &[&[nose, plane(height, true)], &shank])
}

/// The thesis's reamer: hemispherical, 36 mm wide, 20.5 mm tall.
pub(super) fn thesis_reamer() -> Tool {
    ball_nose(["Thesis reamer", "thesis_reamer"], 18.0, 20.5)
}

/// The thesis's peg tool: a cylinder of 8 × 25 mm.
pub(super) fn thesis_peg() -> Tool {
    of(
        ["Thesis peg cylinder", "thesis_peg"],
        &[&[plane(0.0, false), Form::cylinder(4.0), plane(25.0, true)]],
    )
}

/// A ball burr of `diameter` mm, twice as long as wide at its shank.
pub(crate) fn burr(diameter: f64) -> Tool {
    ball_nose(["Burr", "burr"], 0.5 * diameter, diameter)
}

/// The same tool as a mesh, sampled on a grid of the product's own spacing.
pub(super) fn meshed(tool: &Tool) -> Result<Tool> {
    let Shape::Revolved(solid) = &tool.shape else {
        return Ok(tool.clone());
    };
    let mesh = Mesh::new(lathe(solid)).context("the mesh of a tool of the report")?;
    let grid = SdfGrid::new(&mesh, None, &|count, layer| {
        (0..count).into_par_iter().map(layer).collect()
    })
    .context("the grid of a tool of the report")?;
    Ok(Tool {
        shape: Shape::Grid(Arc::new(grid)),
        ..tool.clone()
    })
}

/// Triangles of a solid of revolution.
fn lathe(solid: &Revolved) -> Vec<Triangle> {
    let (lo, hi) = (solid.bounds.lo.z as f32, solid.bounds.hi.z as f32);
    let mut outline = vec![[0.0, lo]];
    outline.extend((0..=MESH.0).map(|n| {
        let t = f32::from(n) / f32::from(MESH.0);
        // closer together at the tip, where a dome is flat
        let z = lo + (hi - lo) * t * t;
        [solid.radius_at(z).unwrap_or(0.0), z]
    }));
    outline.push([0.0, hi]);
    let at = |[r, z]: [f32; 2], n: u16| {
        let turn = std::f32::consts::TAU * f32::from(n % MESH.1) / f32::from(MESH.1);
        Vec3::new(r * turn.cos(), r * turn.sin(), z)
    };
    let mut all = Vec::new();
    for pair in outline.windows(2) {
        for n in 0..MESH.1 {
            let [a, b] = [at(pair[0], n), at(pair[0], n + 1)];
            let [d, c] = [at(pair[1], n), at(pair[1], n + 1)];
            all.extend([[a, c, b], [a, d, c]]);
        }
    }
    all
}
