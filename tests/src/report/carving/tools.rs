//! Tools of the report's scenes.
#![expect(
    clippy::cast_possible_truncation,
    reason = "f64 becomes f32 inside a tool"
)]

use osteon_sim_core::tool::{Shape, Tool};

/// Edge of a tool voxel of the thesis, mm.
pub(super) const THESIS_CELL_MM: f64 = 0.5;

/// A tool that only carves: no surface elements.
fn of(name: &'static str, id: &'static str, shape: Shape) -> Tool {
    Tool {
        name,
        id,
        shape,
        elements: Vec::new(),
        rpm: 1000.0,
    }
}

/// A ball-nosed cylinder, `height` mm from the apex.
fn ball_nose(radius: f64, height: f64) -> Shape {
    Shape::Dome {
        // the rim of the face must lie below its equator by a hair
        radius_mm: (0.999_99 * radius) as f32,
        face_radius_mm: radius as f32,
        height_mm: height as f32,
    }
}

/// The thesis's reamer: hemispherical, 36 mm wide, 20.5 mm tall.
pub(super) fn thesis_reamer() -> Tool {
    of("Thesis reamer", "thesis_reamer", ball_nose(18.0, 20.5))
}

/// The thesis's peg tool: a cylinder of 8 × 25 mm.
pub(super) fn thesis_peg() -> Tool {
    let shape = Shape::Drill {
        radius_mm: 4.0,
        // flat, but for a cone of a µm that keeps the shape's form
        point_mm: 1e-3,
        length_mm: 25.0,
    };
    of("Thesis peg cylinder", "thesis_peg", shape)
}

/// A ball burr of `diameter` mm, twice as long as wide.
pub(super) fn burr(diameter: f64) -> Tool {
    of("Burr", "burr", ball_nose(0.5 * diameter, diameter))
}
