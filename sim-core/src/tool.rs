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

/// Clearance of a smooth flank behind its cutting edge, mm (drills and reamers are relieved so
/// that they do not rub).
const RELIEF_MM: f32 = 0.05;

/// The golden angle, rad: neighbouring elements of a spiral never line up.
const GOLDEN_ANGLE: f32 = 2.399_963_2;

impl Shape {
    /// Signed distance of a point in the tool frame to the head's surface, mm: exact, negative
    /// inside. A NaN gives a NaN.
    pub fn signed_distance(self, p: Vec3) -> f32 {
        let r = (p.x * p.x + p.y * p.y).sqrt();
        match self {
            Self::Dome {
                radius_mm,
                face_radius_mm,
                height_mm,
            } => dome(r, p.z, [radius_mm, face_radius_mm, height_mm]),
            Self::Drill {
                radius_mm,
                point_mm,
                length_mm,
            } => drill(r, p.z, [radius_mm, point_mm, length_mm]),
        }
    }

    /// [`Self::signed_distance`] of four points in a row, `first + n·step`: the same bits as one by
    /// one.
    pub fn signed_distance_row(self, first: Vec3, step: Vec3) -> [f32; 4] {
        let points = [0.0f32, 1.0, 2.0, 3.0].map(|n| first + step * n);
        let radii = points.map(|p| (p.x * p.x + p.y * p.y).sqrt());
        let heights = points.map(|p| p.z);
        match self {
            Self::Dome {
                radius_mm,
                face_radius_mm,
                height_mm,
            } => {
                let outline = [radius_mm, face_radius_mm, height_mm];
                core::array::from_fn(|n| dome(radii[n], heights[n], outline))
            }
            Self::Drill {
                radius_mm,
                point_mm,
                length_mm,
            } => {
                let outline = [radius_mm, point_mm, length_mm];
                core::array::from_fn(|n| drill(radii[n], heights[n], outline))
            }
        }
    }

    /// Box around the head, tool frame, mm.
    pub fn bounds(self) -> ToolBox {
        let (radius, height) = match self {
            Self::Dome {
                radius_mm,
                height_mm,
                ..
            } => (radius_mm, height_mm),
            Self::Drill {
                radius_mm,
                length_mm,
                ..
            } => (radius_mm, length_mm),
        };
        let (r, z) = (f64::from(radius), f64::from(height));
        ToolBox {
            lo: DVec3::new(-r, -r, 0.0),
            hi: DVec3::new(r, r, z),
        }
    }

    /// Outline as (r, z) points in mm from the apex upwards, at most 64: what a viewer turns on a
    /// lathe.
    pub fn outline(self) -> Vec<[f32; 2]> {
        match self {
            Self::Dome {
                radius_mm,
                face_radius_mm,
                height_mm,
            } => {
                let mut points: Vec<[f32; 2]> = (0..=24u8)
                    .map(|i| {
                        let r = radius_mm * f32::from(i) / 24.0;
                        let z = face_radius_mm - (face_radius_mm * face_radius_mm - r * r).sqrt();
                        [r, z]
                    })
                    .collect();
                points.push([radius_mm, height_mm]);
                points.push([0.0, height_mm]);
                points
            }
            Self::Drill {
                radius_mm,
                point_mm,
                length_mm,
            } => vec![
                [0.0, 0.0],
                [radius_mm, point_mm],
                [radius_mm, length_mm],
                [0.0, length_mm],
            ],
        }
    }
}

// ball cap below, cylinder beside, plane on top; (r, z) half-plane. Written without early returns,
// so that rows of it are computed in parallel.
#[inline]
fn dome(r: f32, z: f32, [radius, face, height]: [f32; 3]) -> f32 {
    let rim = face - (face * face - radius * radius).sqrt();
    let from_centre = (r * r + (z - face) * (z - face)).sqrt();
    let ball = from_centre - face;
    let inside = ball.max(r - radius).max(z - height);
    let above = z > height;
    let edge = if above { z - height } else { z - rim };
    let beside = (r - radius).max(0.0);
    let corner = (beside * beside + edge * edge).sqrt();
    // below the rim: the nearest point of the ball lies on the cap, or the rim is nearest
    let on_cap = r * face <= radius * from_centre;
    let below = if on_cap { ball } else { corner };
    let flank = if z >= rim { r - radius } else { below };
    let outside = if above { corner } else { flank };
    if inside <= 0.0 { inside } else { outside }
}

// cone below, cylinder beside, plane on top
#[inline]
fn drill(r: f32, z: f32, [radius, point, length]: [f32; 3]) -> f32 {
    let edge2 = radius * radius + point * point;
    let cone = (r * point - z * radius) / edge2.sqrt();
    let inside = cone.max(r - radius).max(z - length);
    let along = (r * radius + z * point) / edge2;
    // the corner that is nearest where no face is: apex, shoulder or upper rim
    let above = z > length;
    let (corner_r, corner_z) = if above {
        ((r - radius).max(0.0), z - length)
    } else if along < 0.0 {
        (r, z)
    } else {
        (r - radius, z - point)
    };
    let corner = (corner_r * corner_r + corner_z * corner_z).sqrt();
    let on_cone = (0.0..=1.0).contains(&along);
    let beside = z >= point && along > 1.0;
    let face = if on_cone { cone } else { r - radius };
    let outside = if above || !(on_cone || beside) {
        corner
    } else {
        face
    };
    if inside <= 0.0 { inside } else { outside }
}

#[cfg(test)]
fn hypot(a: f32, b: f32) -> f32 {
    (a * a + b * b).sqrt()
}

impl Tool {
    /// Peg drill, Ø 8 mm, 118° point, 40 mm of flutes, 1500 rpm.
    pub fn peg_drill() -> Self {
        // 4 mm / tan(59°)
        let shape = Shape::Drill {
            radius_mm: 4.0,
            point_mm: 2.403_442,
            length_mm: 40.0,
        };
        let mut elements = cone_elements(4.0, 2.403_442, 64);
        // the very tip, so that a standing drill rests on its point
        elements.push(Element {
            position: Vec3::ZERO,
            normal: Vec3::NEG_Z,
            area_mm2: 0.05,
            radius_mm: 0.0,
            cutting: true,
        });
        elements.extend(flank_elements(4.0, [3.0, 27.0], [24, 12]));
        Self {
            name: "Peg drill Ø 8 mm",
            id: "peg_drill",
            shape,
            elements,
            rpm: 1500.0,
        }
    }

    /// Glenoid reamer: a shallow dome, Ø 36 mm, face radius 30 mm, 1000 rpm.
    pub fn glenoid_reamer() -> Self {
        let shape = Shape::Dome {
            radius_mm: 18.0,
            face_radius_mm: 30.0,
            height_mm: 12.0,
        };
        let mut elements = cap_elements(30.0, 6.0, 320);
        elements.extend(flank_elements(18.0, [6.5, 12.0], [3, 32]));
        Self {
            name: "Glenoid reamer Ø 36 mm",
            id: "reamer",
            shape,
            elements,
            rpm: 1000.0,
        }
    }

    /// The tools of a session, in the order of their index and hotkey.
    pub fn standard_set() -> Vec<Self> {
        vec![Self::peg_drill(), Self::glenoid_reamer()]
    }
}

fn turned(r: f32, turn: f32) -> (f32, f32) {
    (r * libm::cosf(turn), r * libm::sinf(turn))
}

// equal areas: the area of a spherical cap grows linearly with height
fn cap_elements(face: f32, cap_height: f32, count: u16) -> Vec<Element> {
    let area = core::f32::consts::TAU * face * cap_height / f32::from(count);
    (0..count)
        .map(|i| {
            let z = cap_height * (f32::from(i) + 0.5) / f32::from(count);
            let r = (2.0 * face * z - z * z).sqrt();
            let (x, y) = turned(r, f32::from(i) * GOLDEN_ANGLE);
            let position = Vec3::new(x, y, z);
            Element {
                position,
                normal: (position - Vec3::new(0.0, 0.0, face)) / face,
                area_mm2: area,
                radius_mm: r,
                cutting: true,
            }
        })
        .collect()
}

// equal areas: the area of a cone grows with the square of the radius
fn cone_elements(radius: f32, point: f32, count: u16) -> Vec<Element> {
    let edge = (radius * radius + point * point).sqrt();
    let area = core::f32::consts::PI * radius * edge / f32::from(count);
    (0..count)
        .map(|i| {
            let r = radius * ((f32::from(i) + 0.5) / f32::from(count)).sqrt();
            let turn = f32::from(i) * GOLDEN_ANGLE;
            let (x, y) = turned(r, turn);
            let (nx, ny) = turned(point / edge, turn);
            Element {
                position: Vec3::new(x, y, r * point / radius),
                normal: Vec3::new(nx, ny, -radius / edge),
                area_mm2: area,
                radius_mm: r,
                cutting: true,
            }
        })
        .collect()
}

fn flank_elements(radius: f32, [z0, z1]: [f32; 2], [rings, around]: [u16; 2]) -> Vec<Element> {
    let area = core::f32::consts::TAU * radius * (z1 - z0) / f32::from(rings * around);
    let mut elements = Vec::with_capacity(usize::from(rings * around));
    for ring in 0..rings {
        let z = z0 + (z1 - z0) * (f32::from(ring) + 0.5) / f32::from(rings);
        for i in 0..around {
            let turn = core::f32::consts::TAU * (f32::from(i) + 0.5 * f32::from(ring % 2))
                / f32::from(around);
            let (nx, ny) = turned(1.0, turn);
            let r = radius - RELIEF_MM;
            elements.push(Element {
                position: Vec3::new(nx * r, ny * r, z),
                normal: Vec3::new(nx, ny, 0.0),
                area_mm2: area,
                radius_mm: r,
                cutting: false,
            });
        }
    }
    elements
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nearest of many points on the outline: an oracle that knows nothing of cases.
    fn brute_distance(shape: Shape, r: f32, z: f32) -> f32 {
        let outline = shape.outline();
        let mut best = f32::MAX;
        for pair in outline.windows(2) {
            for i in 0..=2000u16 {
                let t = f32::from(i) / 2000.0;
                let pr = pair[0][0] + t * (pair[1][0] - pair[0][0]);
                let mut pz = pair[0][1] + t * (pair[1][1] - pair[0][1]);
                if let Shape::Dome { face_radius_mm, .. } = shape
                    && pair[1][1] <= 6.01
                {
                    pz = face_radius_mm - (face_radius_mm * face_radius_mm - pr * pr).sqrt();
                }
                best = best.min(hypot(r - pr, z - pz));
            }
        }
        best
    }

    #[test]
    fn signed_distance_is_the_distance_to_the_outline() {
        for tool in Tool::standard_set() {
            for i in -20..60i16 {
                for j in 0..50i16 {
                    let (r, z) = (f32::from(j) * 0.61, f32::from(i) * 0.83);
                    let d = tool.shape.signed_distance(Vec3::new(0.6 * r, 0.8 * r, z));
                    let oracle = brute_distance(tool.shape, r, z);
                    assert!(
                        (d.abs() - oracle).abs() < 0.01,
                        "{} {r} {z} {d} {oracle}",
                        tool.id
                    );
                }
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
            let truth = match tool.shape {
                // spherical cap 2πRh
                Shape::Dome { .. } => core::f32::consts::TAU * 30.0 * 6.0,
                // cone πr·edge
                Shape::Drill { .. } => core::f32::consts::PI * 4.0 * 4.0 / libm::sinf(1.029_744),
            };
            assert!((cutting / truth - 1.0).abs() < 1e-3, "{cutting} {truth}");
        }
    }
}
