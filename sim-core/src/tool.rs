//! Tools: solids of revolution with an exact signed distance, and their surface elements.
//!
//! Tool frame: origin at the apex of the tip, z from the tip towards the shank; mm. Drilling goes
//! along −z.

use glam::{DVec3, Vec3};

/// The shape of a tool's head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Shallow dome: a ball of `face_radius_mm` cut by a cylinder of `radius_mm` (glenoid reamer).
    Dome {
        /// Half the tool's width, mm; in (0, `face_radius_mm`).
        radius_mm: f32,
        /// Radius of the spherical face, mm.
        face_radius_mm: f32,
        /// Height of the head from the apex, mm.
        height_mm: f32,
    },
    /// Cylinder with a conical point (drill).
    Drill {
        /// Half the drill's width, mm.
        radius_mm: f32,
        /// Height of the conical point, mm.
        point_mm: f32,
        /// Length from the apex, mm.
        length_mm: f32,
    },
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
#[derive(Debug, Clone)]
pub struct Tool {
    /// Name for people.
    pub name: &'static str,
    /// Identifier in reports.
    pub id: &'static str,
    /// The head.
    pub shape: Shape,
    /// Surface elements; at most [`MAX_ELEMENTS`].
    pub elements: Vec<Element>,
    /// Spindle speed when on, revolutions per minute.
    pub rpm: f64,
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
