//! Solids of revolution: a union of convex parts, each the points inside all of its faces.
//!
//! Signed distance = the smallest over the parts of the largest over a part's faces. Its zero set is
//! the solid's surface, exactly; inside a convex part and beside a face it is the true distance.
//! Outside an edge it is a lower bound (the larger of the two faces' distances, not that to the
//! edge): convex for each part, so that a field interpolated from it never cuts beyond a convex rim.
//! Where two parts meet in a groove, points inside are called less deep than they are.

use super::ToolBox;
use glam::{DVec3, Vec3};

/// Most faces of a part.
pub const MAX_FACES: usize = 6;
/// Most parts of a solid.
pub const MAX_PARTS: usize = 4;
/// Most faces of a solid: the length of the carving kernel's tables.
pub const MAX_ALL_FACES: usize = 12;

/// The surface that a face lies on, in the (r, z) half plane; mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    /// Flat, across the axis: inside below `height_mm` (`up`) or above it (not `up`).
    Plane {
        /// z of the plane, mm.
        height_mm: f32,
        /// The outward normal is +z (else −z).
        up: bool,
    },
    /// A cone about the axis, a cylinder where `normal_z` is 0: inside where
    /// `normal_r·r + normal_z·z ≤ offset_mm`.
    Cone {
        /// Radial part of the outward unit normal, in (0, 1].
        normal_r: f32,
        /// Axial part of the outward unit normal, in (−1, 1).
        normal_z: f32,
        /// Distance of the face from the origin along its normal, mm.
        offset_mm: f32,
    },
    /// A ball whose centre lies on the axis.
    Ball {
        /// Radius, mm.
        radius_mm: f32,
        /// z of the centre, mm.
        centre_mm: f32,
    },
    /// All within `radius_mm` of a flat disc: a rounded rim (the outer half of a torus).
    Ring {
        /// Radius of the disc, mm; 0 makes it a ball.
        disc_mm: f32,
        /// z of the disc, mm.
        centre_mm: f32,
        /// Radius of the rounding, mm.
        radius_mm: f32,
    },
}

/// One face of a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Where it lies.
    pub form: Form,
    /// Cutting (true) or smooth (false).
    pub cutting: bool,
}

/// A convex solid of revolution: the points inside all of its faces, at least one and at most
/// [`MAX_FACES`].
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// The faces.
    pub faces: Vec<Face>,
}

/// A union of at least one and at most [`MAX_PARTS`] convex parts about the z axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Revolved {
    /// The parts.
    pub parts: Vec<Part>,
    /// Box around the solid, mm.
    pub bounds: ToolBox,
}

/// Why faces do not make a solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RevolvedError {
    /// A part without faces, or with more than [`MAX_FACES`]; the number of the part.
    Faces(usize),
    /// No part, or more than [`MAX_PARTS`].
    Parts(usize),
    /// More than [`MAX_ALL_FACES`] in all.
    AllFaces(usize),
    /// A number of a face that is not finite or has the wrong sign; part and face.
    Number(usize, usize),
    /// A part that is empty or reaches beyond 500 mm from the origin: a face is missing.
    Open(usize),
}

impl core::fmt::Display for RevolvedError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Faces(part) => write!(f, "part {part} must have 1 to {MAX_FACES} faces"),
            Self::Parts(n) => write!(f, "{n} parts (a tool has 1 to {MAX_PARTS})"),
            Self::AllFaces(n) => write!(f, "{n} faces in all (a tool has at most {MAX_ALL_FACES})"),
            Self::Number(part, face) => write!(
                f,
                "face {face} of part {part} has a number that is not finite or not positive where it must be"
            ),
            Self::Open(part) => write!(
                f,
                "part {part} is empty or not closed by its faces within 500 mm"
            ),
        }
    }
}

impl core::error::Error for RevolvedError {}

/// Largest extent of a tool from its origin, mm.
const REACH_MM: f32 = 500.0;

impl Form {
    /// A cone whose apex lies on the axis at `apex_mm`, opening upwards or downwards, of a half
    /// angle in degrees between 0 and 90.
    pub fn cone(apex_mm: f32, half_angle_deg: f32, upwards: bool) -> Self {
        let half = f64::from(half_angle_deg).to_radians();
        let down = if upwards { -1.0 } else { 1.0 };
        #[expect(clippy::cast_possible_truncation, reason = "a sine")]
        let (normal_r, normal_z) = (libm::cos(half) as f32, (down * libm::sin(half)) as f32);
        Self::Cone {
            normal_r,
            normal_z,
            offset_mm: normal_z * apex_mm,
        }
    }

    /// A cylinder about the axis, mm.
    pub fn cylinder(radius_mm: f32) -> Self {
        Self::Cone {
            normal_r: 1.0,
            normal_z: 0.0,
            offset_mm: radius_mm,
        }
    }

    /// Signed distance of (r, z), mm, to the face's whole surface; negative inside.
    pub fn distance(self, r: f32, z: f32) -> f32 {
        match self {
            Self::Plane { height_mm, up } => {
                let above = z - height_mm;
                if up { above } else { -above }
            }
            Self::Cone {
                normal_r,
                normal_z,
                offset_mm,
            } => normal_r * r + normal_z * z - offset_mm,
            Self::Ball {
                radius_mm,
                centre_mm,
            } => {
                let dz = z - centre_mm;
                (r * r + dz * dz).sqrt() - radius_mm
            }
            Self::Ring {
                disc_mm,
                centre_mm,
                radius_mm,
            } => {
                let dz = z - centre_mm;
                let beyond = (r - disc_mm).max(0.0);
                (beyond * beyond + dz * dz).sqrt() - radius_mm
            }
        }
    }

    /// By how much a carved face is grown, mm, so that the surface read from the cut, linearly between
    /// voxels, lies on it: h²∇²d/12, with the mean square spacing h² (mm²) and the Laplacian ∇²d of its
    /// distance at most 2/h. Cones are not grown: they would need more the nearer the axis.
    pub fn grown_mm(self, mean_square_spacing: f64) -> f64 {
        let laplacian = match self {
            Self::Cone {
                normal_z: 0.0,
                offset_mm,
                ..
            } => 1.0 / f64::from(offset_mm),
            Self::Plane { .. } | Self::Cone { .. } => return 0.0,
            Self::Ball { radius_mm, .. } => 2.0 / f64::from(radius_mm),
            Self::Ring {
                disc_mm, radius_mm, ..
            } => {
                // the second curvature falls from that of the rim to none: half of it
                let (disc, radius) = (f64::from(disc_mm), f64::from(radius_mm));
                let across = if disc > 0.0 { 0.5 } else { 1.0 };
                1.0 / radius + across / (disc + radius)
            }
        };
        let square = mean_square_spacing.max(0.0);
        (square * laplacian).min(2.0 * square.sqrt()) / 12.0
    }

    fn is_sound(self) -> bool {
        match self {
            Self::Plane { height_mm, .. } => height_mm.is_finite(),
            Self::Cone {
                normal_r,
                normal_z,
                offset_mm,
            } => {
                let unit = normal_r * normal_r + normal_z * normal_z - 1.0;
                normal_r > 0.0 && unit.abs() < 1e-4 && offset_mm.is_finite()
            }
            Self::Ball {
                radius_mm,
                centre_mm,
            } => radius_mm > 0.0 && radius_mm.is_finite() && centre_mm.is_finite(),
            Self::Ring {
                disc_mm,
                centre_mm,
                radius_mm,
            } => {
                disc_mm >= 0.0
                    && radius_mm > 0.0
                    && disc_mm.is_finite()
                    && radius_mm.is_finite()
                    && centre_mm.is_finite()
            }
        }
    }
}

impl Part {
    /// Signed distance of (r, z), mm; see the module for where it is a lower bound.
    pub fn distance(&self, r: f32, z: f32) -> f32 {
        let distances = self.faces.iter().map(|f| f.form.distance(r, z));
        distances.fold(f32::NEG_INFINITY, f32::max)
    }

    /// Radius of the cross-section at height `z`, mm; `None` where there is none.
    pub fn radius_at(&self, z: f32) -> Option<f32> {
        let mut radius = 2.0 * REACH_MM;
        for face in &self.faces {
            let here = match face.form {
                Form::Plane { .. } if face.form.distance(0.0, z) > 0.0 => return None,
                Form::Plane { .. } => continue,
                Form::Cone {
                    normal_r,
                    normal_z,
                    offset_mm,
                } => (offset_mm - normal_z * z) / normal_r,
                Form::Ball {
                    radius_mm,
                    centre_mm,
                } => chord(radius_mm, z - centre_mm)?,
                Form::Ring {
                    disc_mm,
                    centre_mm,
                    radius_mm,
                } => disc_mm + chord(radius_mm, z - centre_mm)?,
            };
            radius = radius.min(here);
        }
        (radius >= 0.0).then_some(radius)
    }

    /// Lowest and highest z and largest radius, mm; `None` where the part is empty or not closed.
    /// The radius of a convex part is concave in z, so ternary search finds all three.
    fn extent(&self) -> Option<[f32; 3]> {
        let radius = |z: f32| self.radius_at(z);
        // any height inside: the deepest point of the axis
        let (mut lo, mut hi) = (-REACH_MM, REACH_MM);
        for _ in 0..200 {
            let (a, b) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
            if self.distance(0.0, a) < self.distance(0.0, b) {
                hi = b;
            } else {
                lo = a;
            }
        }
        let inside = 0.5 * (lo + hi);
        if self.distance(0.0, inside) >= 0.0 {
            return None;
        }
        let end = |outside: f32| {
            let (mut inside, mut outside) = (inside, outside);
            for _ in 0..200 {
                let middle = 0.5 * (inside + outside);
                if self.distance(0.0, middle) <= 0.0 {
                    inside = middle;
                } else {
                    outside = middle;
                }
            }
            inside
        };
        let ends = [end(-REACH_MM), end(REACH_MM)];
        let (mut lo, mut hi) = (ends[0], ends[1]);
        for _ in 0..200 {
            let (a, b) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
            if radius(a)? > radius(b)? {
                hi = b;
            } else {
                lo = a;
            }
        }
        let widest = radius(0.5 * (lo + hi))?
            .max(radius(ends[0])?)
            .max(radius(ends[1])?);
        let closed = widest < REACH_MM && ends.iter().all(|z| z.abs() < 0.99 * REACH_MM);
        closed.then_some([ends[0], ends[1], widest])
    }
}

/// Half a ball's chord at height `dz` above its centre, mm.
fn chord(radius: f32, dz: f32) -> Option<f32> {
    let square = radius * radius - dz * dz;
    (square >= 0.0).then(|| square.sqrt())
}

impl Revolved {
    /// Checks the parts and finds their box.
    pub fn new(parts: Vec<Part>) -> Result<Self, RevolvedError> {
        let bounds = Self::box_around(&parts)?;
        Ok(Self { parts, bounds })
    }

    fn box_around(parts: &[Part]) -> Result<ToolBox, RevolvedError> {
        if parts.is_empty() || parts.len() > MAX_PARTS {
            return Err(RevolvedError::Parts(parts.len()));
        }
        let faces = parts.iter().map(|p| p.faces.len()).sum();
        if faces > MAX_ALL_FACES {
            return Err(RevolvedError::AllFaces(faces));
        }
        let mut lo = DVec3::INFINITY;
        let mut hi = DVec3::NEG_INFINITY;
        for (n, part) in parts.iter().enumerate() {
            if part.faces.is_empty() || part.faces.len() > MAX_FACES {
                return Err(RevolvedError::Faces(n));
            }
            if let Some(face) = part.faces.iter().position(|f| !f.form.is_sound()) {
                return Err(RevolvedError::Number(n, face));
            }
            let [low, high, radius] = part.extent().ok_or(RevolvedError::Open(n))?.map(f64::from);
            lo = lo.min(DVec3::new(-radius, -radius, low));
            hi = hi.max(DVec3::new(radius, radius, high));
        }
        Ok(ToolBox { lo, hi })
    }

    /// A shallow dome: a ball of the second radius cut by a cylinder of the first, up to a height; mm.
    pub fn dome([radius, face_radius, height]: [f32; 3]) -> Self {
        let ball = Form::Ball {
            radius_mm: face_radius,
            centre_mm: face_radius,
        };
        Self::one_part(&[ball], radius, height)
    }

    /// A cylinder with a conical point, its tip at the origin: radius (mm), half angle of the point
    /// (degrees), length (mm).
    pub fn drill([radius, half_angle_deg, length]: [f32; 3]) -> Self {
        let cone = Form::cone(0.0, half_angle_deg, true);
        Self::one_part(&[cone], radius, length)
    }

    /// A ball about the origin, mm: burrs, and the tests' simplest tool.
    pub fn ball(radius: f32) -> Self {
        let form = Form::Ball {
            radius_mm: radius,
            centre_mm: 0.0,
        };
        let r = f64::from(radius);
        Self {
            parts: vec![Part {
                faces: vec![Face {
                    form,
                    cutting: true,
                }],
            }],
            bounds: ToolBox {
                lo: DVec3::splat(-r),
                hi: DVec3::splat(r),
            },
        }
    }

    // cutting faces below, a smooth cylinder beside, a smooth plane on top; the tip at the origin
    fn one_part(tips: &[Form], radius: f32, height: f32) -> Self {
        let side = Form::cylinder(radius);
        let top = Form::Plane {
            height_mm: height,
            up: true,
        };
        let mut faces: Vec<Face> = tips
            .iter()
            .map(|&form| Face {
                form,
                cutting: true,
            })
            .collect();
        faces.extend([side, top].map(|form| Face {
            form,
            cutting: false,
        }));
        let (r, z) = (f64::from(radius), f64::from(height));
        let parts = vec![Part { faces }];
        // the same numbers, to a rounding, where they make no solid
        let bounds = Self::box_around(&parts).unwrap_or(ToolBox {
            lo: DVec3::new(-r, -r, 0.0),
            hi: DVec3::new(r, r, z),
        });
        Self { parts, bounds }
    }

    /// Signed distance of a point in the tool frame, mm, negative inside; see the module.
    pub fn signed_distance(&self, p: Vec3) -> f32 {
        let r = (p.x * p.x + p.y * p.y).sqrt();
        let distances = self.parts.iter().map(|part| part.distance(r, p.z));
        distances.fold(f32::INFINITY, f32::min)
    }

    /// Smallest radius of curvature of a face, mm (a cone counts as its radius at mid-height);
    /// [`f32::MAX`] where all are flat.
    pub fn smallest_radius_mm(&self) -> f32 {
        #[expect(clippy::cast_possible_truncation, reason = "below 500 mm")]
        let widest = self.bounds.hi.x as f32;
        let faces = self.parts.iter().flat_map(|part| &part.faces);
        faces.fold(f32::MAX, |least, face| match face.form {
            Form::Plane { .. } => least,
            Form::Cone {
                normal_z,
                offset_mm,
                ..
            } => least.min(if normal_z == 0.0 {
                offset_mm
            } else {
                0.5 * widest
            }),
            Form::Ball { radius_mm, .. } | Form::Ring { radius_mm, .. } => least.min(radius_mm),
        })
    }

    /// Radius of the cross-section at height `z`, mm; `None` where there is none.
    pub fn radius_at(&self, z: f32) -> Option<f32> {
        let radii = self.parts.iter().filter_map(|part| part.radius_at(z));
        radii.fold(None, |best, r| Some(best.map_or(r, |b: f32| b.max(r))))
    }
}
