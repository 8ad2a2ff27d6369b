//! Tools: solids of revolution with an exact signed distance, or any mesh with a sampled one; and
//! their surface elements.
//!
//! Tool frame: origin at the apex of the tip, z from the tip towards the shank; mm. Drilling goes
//! along −z.

pub mod bvh;
mod digest;
pub mod elements;
mod facet;
pub mod mesh;
pub mod patches;
pub mod revolved;
pub mod sdf_grid;

pub use facet::Facet;

use crate::grid::Grid;
use glam::{DVec3, Vec3};
use mesh::Mesh;
use revolved::Revolved;
use sdf_grid::SdfGrid;
use std::sync::Arc;

/// The shape of a tool's head.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A solid of revolution about z.
    Revolved(Revolved),
    /// Any shape, sampled; shared by the threads that carve.
    Grid(Arc<SdfGrid>),
}

/// A small piece of the tool's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Element {
    /// Position in the tool frame, mm.
    pub position: Vec3,
    /// Outward unit normal, tool frame.
    pub normal: Vec3,
    /// Area, mm².
    pub area_mm2: f32,
    /// Distance from the spindle's axis, mm.
    pub radius_mm: f32,
    /// Cutting (true) or smooth (false).
    pub cutting: bool,
}

/// A tool: shape, surface elements, spindle.
#[derive(Debug, Clone, PartialEq)]
pub struct Tool {
    /// Name for people.
    pub name: String,
    /// Identifier in reports.
    pub id: String,
    /// The head.
    pub shape: Shape,
    /// Surface elements; at most [`MAX_ELEMENTS`].
    pub elements: Vec<Element>,
    /// The piece of surface about each of them; see [`Tool::with_elements`].
    pub facets: Vec<Facet>,
    /// Spindle speed when on, revolutions per minute.
    pub rpm: f64,
    /// Cutting lips around the axis.
    pub lips: u8,
    /// Torque at which its spindle stalls, N·mm; `None`: as the feel says.
    pub stall_nmm: Option<f64>,
    /// Colour, sRGB.
    pub colour: [u8; 3],
}

/// Most elements of a tool: the bound of the servo's contact loop.
pub const MAX_ELEMENTS: usize = 512;

/// Corners of a box in the tool frame, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolBox {
    /// Lowest corner.
    pub lo: DVec3,
    /// Highest corner.
    pub hi: DVec3,
}

/// Colour of surgical steel, sRGB.
pub const STEEL: [u8; 3] = [196, 202, 210];

impl ToolBox {
    /// Farthest that it reaches from the axis along x or y, mm.
    pub fn reach_mm(&self) -> f64 {
        let reach = self.lo.abs().max(self.hi.abs());
        reach.x.max(reach.y)
    }

    /// Radius of the ball about the tool's origin that holds it, mm.
    pub fn radius_mm(&self) -> f64 {
        self.lo.abs().max(self.hi.abs()).length()
    }
}

/// Points of an outline that a viewer turns on a lathe.
pub const OUTLINE_POINTS: usize = 64;

impl Shape {
    /// Signed distance of a point in the tool frame to the head's surface, mm, negative inside; see
    /// [`revolved`] for what it is beside edges. A NaN gives a NaN or infinity.
    pub fn signed_distance(&self, p: Vec3) -> f32 {
        match self {
            Self::Revolved(solid) => solid.signed_distance(p),
            Self::Grid(grid) => grid.signed_distance(p),
        }
    }

    /// Box around the head, tool frame, mm.
    pub fn bounds(&self) -> ToolBox {
        match self {
            Self::Revolved(solid) => solid.bounds,
            Self::Grid(grid) => grid.bounds,
        }
    }

    /// Smallest radius of curvature of a face, mm; [`f32::MAX`] where all are flat.
    pub fn smallest_radius_mm(&self) -> f32 {
        match self {
            Self::Revolved(solid) => solid.smallest_radius_mm(),
            // a mesh may have edges anywhere: its cells are the smallest thing that it shows
            Self::Grid(grid) => grid.spacing_mm,
        }
    }

    /// Most that a cutting face is grown when it is carved into `grid`, mm
    /// ([`revolved::Form::grown_mm`]); 0 for a sampled tool, which is not grown.
    pub fn grown_mm(&self, grid: &Grid) -> f64 {
        let Self::Revolved(solid) = self else {
            return 0.0;
        };
        let square = grid.mean_square_spacing();
        let faces = solid.parts.iter().flat_map(|part| &part.faces);
        faces
            .filter(|face| face.cutting)
            .map(|face| face.form.grown_mm(square))
            .fold(0.0, f64::max)
    }

    /// How far beyond the head's box its distance can be below the band of `grid`, mm: the band, what any
    /// face is grown, and below a cone's point the band over the sine of its half angle (at most forty
    /// bands: such a needle's far field may miss chunks, which saturate anyway).
    pub fn margin_mm(&self, grid: &Grid) -> f64 {
        let band = grid.band_mm();
        let Self::Revolved(solid) = self else {
            return band;
        };
        let square = grid.mean_square_spacing();
        let faces = solid.parts.iter().flat_map(|part| &part.faces);
        faces.fold(band, |most, face| match face.form {
            revolved::Form::Cone { normal_z, .. } if normal_z != 0.0 => {
                most.max(band * (1.0 / f64::from(normal_z.abs())).min(40.0))
            }
            form => most.max(band + form.grown_mm(square)),
        })
    }

    /// Outline as (r, z) points in mm from the apex upwards, at most [`OUTLINE_POINTS`]: what a
    /// viewer turns on a lathe.
    pub fn outline(&self) -> Vec<[f32; 2]> {
        let bounds = self.bounds();
        #[expect(clippy::cast_possible_truncation, reason = "a tool is below 500 mm")]
        let (lo, hi) = (bounds.lo.z as f32, bounds.hi.z as f32);
        let steps = 60u8;
        let mut points = vec![[0.0, lo]];
        points.extend((0..=steps).map(|i| {
            // closer together at the tip, where a dome is flat
            let t = f32::from(i) / f32::from(steps);
            let z = lo + (hi - lo) * t * t;
            let r = match self {
                Self::Revolved(solid) => solid.radius_at(z).unwrap_or(0.0),
                Self::Grid(grid) => grid.radius_at(z),
            };
            [r, z]
        }));
        points.push([0.0, hi]);
        points
    }
}

impl Tool {
    /// A tool of faces, its elements made from them. `spindle` is its full speed in revolutions per
    /// minute and the number of its lips.
    pub fn revolved(
        [name, id]: [&str; 2],
        solid: Revolved,
        (rpm, lips): (f64, u8),
        colour: [u8; 3],
    ) -> Self {
        let elements = elements::of_revolved(&solid);
        Self {
            name: name.to_owned(),
            id: id.to_owned(),
            elements: Vec::new(),
            facets: Vec::new(),
            shape: Shape::Revolved(solid),
            rpm,
            lips,
            stall_nmm: None,
            colour,
        }
        .with_elements(elements)
    }

    /// A tool made of triangles: `grid` is its distance. Elements at or below the height
    /// `cutting_below_mm` cut, those above are smooth. `spindle` as in [`Tool::revolved`].
    pub fn meshed(
        [name, id]: [&str; 2],
        mesh: &Mesh,
        grid: Arc<SdfGrid>,
        (rpm, lips): (f64, u8),
        colour: [u8; 3],
        cutting_below_mm: f32,
    ) -> Self {
        Self {
            name: name.to_owned(),
            id: id.to_owned(),
            elements: Vec::new(),
            facets: Vec::new(),
            shape: Shape::Grid(grid),
            rpm,
            lips,
            stall_nmm: None,
            colour,
        }
        .with_elements(mesh.elements(cutting_below_mm))
    }

    /// The same tool with these surface elements.
    #[must_use]
    pub fn with_elements(mut self, elements: Vec<Element>) -> Self {
        self.facets = elements.iter().map(|e| Facet::of(e, &self.shape)).collect();
        self.elements = elements;
        self
    }

    /// Peg drill, Ø 8 mm, 118° point, 40 mm of flutes, 1500 rpm.
    pub fn peg_drill() -> Self {
        Self::revolved(
            ["Peg drill Ø 8 mm", "peg_drill"],
            Revolved::drill([4.0, 59.0, 40.0]),
            (1500.0, 2),
            STEEL,
        )
    }

    /// Glenoid reamer: a shallow dome, Ø 36 mm, face radius 30 mm, 1000 rpm.
    pub fn glenoid_reamer() -> Self {
        Self::revolved(
            ["Glenoid reamer Ø 36 mm", "reamer"],
            Revolved::dome([18.0, 30.0, 12.0]),
            (1000.0, 6),
            STEEL,
        )
    }

    /// The tools of a session that names none, in the order of their index and hotkey.
    /// `firmware-bridge/tools/standard.toml` says the same as data; a test compares the two.
    pub fn standard_set() -> Vec<Self> {
        vec![Self::peg_drill(), Self::glenoid_reamer()]
    }
}

#[cfg(test)]
mod tests {
    use super::elements::RELIEF_MM;
    use super::*;

    /// Outline pieces of the two tools as dense points: an oracle that knows nothing of faces.
    fn outline_points(tool: &Tool) -> Vec<[f32; 2]> {
        let corners: Vec<[f32; 2]> = if tool.id == "reamer" {
            let cap = (0..=2000u16).map(|i| {
                let r = 18.0 * f32::from(i) / 2000.0;
                [r, 30.0 - (900.0 - r * r).sqrt()]
            });
            cap.chain([[18.0, 12.0], [0.0, 12.0]]).collect()
        } else {
            vec![[0.0, 0.0], [4.0, 2.403_442], [4.0, 40.0], [0.0, 40.0]]
        };
        let mut points = Vec::new();
        for pair in corners.windows(2) {
            for i in 0..=2000u16 {
                let t = f32::from(i) / 2000.0;
                points.push([0, 1].map(|n| pair[0][n] + t * (pair[1][n] - pair[0][n])));
            }
        }
        points
    }

    #[test]
    fn signed_distance_is_true_inside_and_never_too_large_outside() {
        for tool in Tool::standard_set() {
            let outline = outline_points(&tool);
            let (mut inside, mut beside) = (0, 0);
            for i in -10..40i16 {
                for j in 0..30i16 {
                    let (r, z) = (f32::from(j) * 0.81, f32::from(i) * 1.13);
                    let d = tool.shape.signed_distance(Vec3::new(0.6 * r, 0.8 * r, z));
                    let nearest =
                        |[pr, pz]: &[f32; 2]| ((r - pr) * (r - pr) + (z - pz) * (z - pz)).sqrt();
                    let oracle = outline.iter().map(nearest).fold(f32::MAX, f32::min);
                    if d <= 0.0 {
                        inside += 1;
                        assert!(
                            (-d - oracle).abs() < 0.02,
                            "{} {r} {z} {d} {oracle}",
                            tool.id
                        );
                    } else {
                        beside += 1;
                        assert!(d < oracle + 0.01, "{} {r} {z} {d} {oracle}", tool.id);
                        assert!(d > 0.5 * oracle, "{} {r} {z} {d} {oracle}", tool.id);
                    }
                }
            }
            assert!(inside > 50 && beside > 500, "{inside} {beside}");
        }
    }

    #[test]
    fn outlines_follow_the_surface() {
        for tool in Tool::standard_set() {
            let outline = tool.shape.outline();
            assert!(outline.len() <= OUTLINE_POINTS);
            for [r, z] in outline.iter().skip(1).take(outline.len() - 2) {
                let d = tool.shape.signed_distance(Vec3::new(*r, 0.0, *z));
                assert!(d.abs() < 1e-3, "{} {r} {z} {d}", tool.id);
            }
        }
    }

    #[test]
    fn elements_lie_on_the_surface_and_sum_to_its_area() {
        for tool in Tool::standard_set() {
            assert!(tool.elements.len() <= MAX_ELEMENTS);
            let mut cutting = 0.0;
            for e in &tool.elements {
                let d = tool.shape.signed_distance(e.position);
                let expected = if e.cutting { 0.0 } else { -RELIEF_MM };
                assert!((d - expected).abs() < 2e-3, "{} {d}", tool.id);
                assert!((e.normal.length() - 1.0).abs() < 1e-4);
                cutting += if e.cutting { e.area_mm2 } else { 0.0 };
            }
            let truth = if tool.id == "reamer" {
                // spherical cap 2πRh
                core::f32::consts::TAU * 30.0 * 6.0
            } else {
                // cone πr·edge
                core::f32::consts::PI * 4.0 * 4.0 / libm::sinf(1.029_744)
            };
            assert!((cutting / truth - 1.0).abs() < 1e-3, "{cutting} {truth}");
        }
    }
}
