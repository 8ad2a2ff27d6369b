//! Tools from STL: the file's triangles, placed, checked and sampled.

use super::toml_tool::{Entry, Place};
use super::{Detail, ToolError, in_folder_of, on_all_cores, stl};
use glam::{DQuat, DVec3};
use osteon_sim_core::tool::mesh::{Findings, Mesh};
use osteon_sim_core::tool::sdf_grid::SdfGrid;
use osteon_sim_core::tool::{STEEL, Tool};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MeshEntry {
    file: PathBuf,
    #[serde(default = "one")]
    scale: f64,
    #[serde(default)]
    apex_mm: [f64; 3],
    #[serde(default = "up")]
    axis: [f64; 3],
    cutting_below_mm: Option<f32>,
    spacing_mm: Option<f32>,
}

fn one() -> f64 {
    1.0
}

fn up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

/// The tool of `entry`, whose shape is `mesh`; what people should know of it goes to `notes`.
pub(super) fn meshed(
    place: Place<'_>,
    entry: &Entry,
    mesh: &MeshEntry,
    detail: Detail,
    notes: &mut Vec<String>,
) -> Result<Tool, ToolError> {
    place.range("mesh: scale", mesh.scale, 1e-6..=1e6)?;
    if let Some(h) = mesh.spacing_mm {
        place.range("mesh: spacing_mm", h.into(), 0.05..=1.0)?;
    }
    for (axis, v) in ["x", "y", "z"].iter().zip(mesh.apex_mm) {
        place.range(format!("mesh: apex_mm {axis}"), v, -1e6..=1e6)?;
    }
    let Some(axis) = DVec3::from_array(mesh.axis).try_normalize() else {
        let problem = "no direction; give three numbers, from the tip to the shank";
        return Err(place.fault("mesh: axis", problem));
    };
    let path = in_folder_of(place.path, &mesh.file);
    let soup = stl::read(&path).map_err(|problem| ToolError::Stl {
        path: path.clone(),
        problem,
        tool: place.tool.to_owned(),
    })?;
    let fault = |problem| ToolError::Mesh {
        path: path.clone(),
        problem,
        tool: place.tool.to_owned(),
    };
    let upright = DQuat::from_rotation_arc(axis, DVec3::Z);
    let apex = DVec3::from_array(mesh.apex_mm);
    let placed = soup.triangles.iter().map(|t| {
        t.map(|v| {
            let p = upright * (v.as_dvec3() * mesh.scale - apex);
            if p.is_finite() {
                // huge numbers stay finite, so that they are called huge
                p.clamp(DVec3::splat(-1e9), DVec3::splat(1e9)).as_vec3()
            } else {
                p.as_vec3()
            }
        })
    });
    let solid = Mesh::new(placed.collect()).map_err(fault)?;
    let spacing = match detail {
        Detail::Full => mesh.spacing_mm,
        Detail::Elements => Some(1.0),
    };
    let grid = SdfGrid::new(&solid, spacing, &on_all_cores).map_err(fault)?;
    notes.extend(mesh_notes(&path, soup.trailing, &solid.findings(), &grid));
    Ok(Tool::meshed(
        [entry.name.trim(), &entry.id],
        &solid,
        Arc::new(grid),
        (entry.rpm, entry.lips),
        entry.colour.unwrap_or(STEEL),
        mesh.cutting_below_mm.unwrap_or(f32::MAX),
    ))
}

/// What was found in a mesh, one line each.
fn mesh_notes(path: &Path, trailing: u64, found: &Findings, grid: &SdfGrid) -> Vec<String> {
    let mut notes = Vec::new();
    let mut say = |text: String| notes.push(format!("{}: {text}", path.display()));
    if trailing > 0 {
        say(format!(
            "{trailing} bytes after the last triangle are ignored"
        ));
    }
    if found.zero_area > 0 {
        say(format!(
            "{} triangles without area left out",
            found.zero_area
        ));
    }
    if found.duplicates > 0 {
        say(format!(
            "{} triangles that were there twice left out",
            found.duplicates
        ));
    }
    if found.turned {
        say("its normals pointed inwards and were turned".to_owned());
    }
    if found.open_edges > 0 {
        say(format!(
            "open: {} edges do not match up (winding number off by up to {:.3}); holes are closed by the surface where it is one half",
            found.open_edges, found.winding_gap
        ));
    }
    let [nx, ny, nz] = grid.dims;
    say(format!(
        "{} triangles on a grid of {nx} x {ny} x {nz} at {:.3} mm; off by {:.3} mm at most within 2 mm of the surface, {:.3} mm RMS on it",
        found.triangles, grid.spacing_mm, grid.error_mm, grid.surface_rms_mm
    ));
    notes
}
