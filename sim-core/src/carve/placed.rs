//! A tool placed in the lattice, and its signed distance at 16 points at a time.
//!
//! All lengths here are in units of the stored distance ([`Grid::quantum_mm`]). The tool enters by its
//! apex and axis alone (it is a solid of revolution). A *node* is a chunk about its middle, or a brick
//! from its first voxel; its points are base + δ. With **w** = base − (a point c on the axis), the
//! square of a point's distance to c is
//!
//! ```text
//! q = (((|w|² + 2w.x δ.x) + 2w.y δ.y) + (δ.x² + δ.y²)) + (2w.z δ.z + δ.z²)
//! ```
//!
//! in `f32`. c is a ball's centre for a ball, and the foot of the chunk's middle on the axis for
//! everything else, so that nothing large cancels; there z = ((z₀ + a.x δ.x) + a.y δ.y) + a.z δ.z and
//! r = √max(q − z², 0); a ball's distance is √max(q, 0) less its radius. At a chunk |w|², 2**w** and z₀
//! are rounded from `f64`; a brick's are the chunk's
//! moved by its offset, in `f32` ([`Square::moved`]). A voxel's value is the smallest over the parts
//! of the largest over their faces, rounded to the nearest integer (ties to even) and clamped to
//! ±32767.
//!
//! **Wide faces**, balls and cylinders whose radius R is at least [`WIDE`] bands, need no root. With
//! e = (q − R²)/2R, of the same form as q with every term times 1/2R (rounded from `f64` at the chunk;
//! for a cylinder less (z/2R) z), the distance is √(R² + 2Re) − R = e (1 − u + 2u² − 5u³ …), u = e/2R, and is
//! stored as
//!
//! ```text
//! e (1 − e (m/2R − e/2R²)), m = 1 + 15/4 (band/2R)²
//! ```
//!
//! where m takes up what the term in u³ is on the average: off by at most 2e-5 of the band inside it,
//! and rising everywhere.
//!
//! **Curvature.** Reading a distance field linearly between voxels overestimates a convex one by
//! h²∇²d/12 on the average (h² = the mean square spacing), so balls, rings and cylinders are grown by
//! that: h²/6R for a ball, h²/12r for a cylinder, with ∇² at most 2/h ([`Form::grown_mm`]). A cone is not:
//! it would need more the nearer the axis, and its point is an edge anyway.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "lengths become f32 inside a node; what a job calls must melt into it"
)]

use super::node::{Frame, Node, NodeFace, Square};
use crate::grid::Grid;
use crate::pose::Pose;
use crate::tool::revolved::{Form, MAX_ALL_FACES, MAX_PARTS, Revolved};
use glam::DVec3;

/// Faces of a tool at most.
pub(super) const MAX_FLAT: usize = MAX_ALL_FACES;
/// What a bound leaves for rounding: units, and a share of the tool's reach.
const SLACK: (f64, f64) = (8.0, 1e-6);

/// Radius from which a ball or cylinder is wide, bands.
const WIDE: f64 = 18.5;

/// A face in units; what the fields mean depends on the kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FlatFace {
    kind: Kind,
    part: u8,
    // plane: sign; cone: nᵣ; ring: radius of the disc
    a: f64,
    // cone: n₂; ball, ring: z of the centre
    b: f64,
    // plane, cone: offset; ball, ring: radius
    c: f64,
    // wide: what e is bent by
    m: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Plane,
    Cone,
    Ball,
    Ring,
    WideBall,
    WideCylinder,
}

impl Kind {
    /// Whether a face has a square of its own.
    #[inline(always)]
    pub(super) fn has_square(self) -> bool {
        matches!(self, Self::Ball | Self::WideBall | Self::WideCylinder)
    }
}

/// The tool in the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Placed {
    faces: [FlatFace; MAX_FLAT],
    count: usize,
    parts: u8,
    apex: DVec3,
    axis: DVec3,
    axis32: [f32; 3],
    /// Voxel spacing, units.
    pub spacing: DVec3,
    /// The band, units.
    pub band: f32,
    /// What bounds leave for rounding, units.
    pub slack: f32,
}

impl Placed {
    /// Places the faces of `solid` in the lattice (none for a tool of another kind); `curvature`
    /// switches the curvature correction on.
    pub(super) fn new(
        grid: &Grid,
        solid: Option<&Revolved>,
        bone_from_tool: &Pose,
        curvature: bool,
    ) -> Self {
        let units = 1.0 / f64::from(grid.quantum_mm());
        let spacing = grid.spacing_mm * units;
        let bend = if curvature {
            grid.mean_square_spacing()
        } else {
            0.0
        };
        let mut placed = Self {
            faces: [FlatFace::NONE; MAX_FLAT],
            count: 0,
            parts: 0,
            apex: bone_from_tool.translation * units,
            axis: bone_from_tool.vector(DVec3::Z),
            axis32: [0.0; 3],
            spacing,
            band: (grid.band_mm() * units) as f32,
            slack: 0.0,
        };
        placed.axis32 = placed.axis.as_vec3().to_array();
        let Some(solid) = solid else {
            return placed;
        };
        let mut reach = solid.bounds.lo.abs().max(solid.bounds.hi.abs()).length();
        for part in &solid.parts {
            for face in &part.faces {
                let flat = FlatFace::new(face.form, units, bend, placed.parts)
                    .widened(f64::from(placed.band));
                // a square is rounded against the way to its face's centre
                reach = reach.max((flat.b.abs() + flat.c.abs()) / units);
                placed.faces[placed.count] = flat;
                placed.count += 1;
            }
            placed.parts += 1;
        }
        placed.slack = (SLACK.0 + SLACK.1 * reach * units) as f32;
        placed
    }

    /// The apex-to-voxel vector of a voxel, units.
    pub(super) fn apex_to(&self, voxel: [usize; 3]) -> DVec3 {
        DVec3::from_array(voxel.map(|v| v as f64)) * self.spacing - self.apex
    }

    /// Signed distance at one point, units from the apex: for bounds.
    pub(super) fn distance(&self, v: DVec3) -> f64 {
        let z = v.dot(self.axis);
        let r = (v.length_squared() - z * z).max(0.0).sqrt();
        let mut parts = [f64::NEG_INFINITY; MAX_PARTS];
        for face in &self.faces[..self.count] {
            let part = &mut parts[usize::from(face.part)];
            *part = part.max(face.distance(r, z));
        }
        parts[..usize::from(self.parts)]
            .iter()
            .fold(f64::INFINITY, |d, &p| d.min(p))
    }

    /// Moves a chunk's node to a chunk whose middle lies `middle` from the apex.
    #[inline(always)]
    pub(super) fn enter(&self, node: &mut Node, middle: DVec3) {
        let foot = middle.dot(self.axis);
        node.count = self.count;
        node.frame = Frame {
            axis: self.axis32,
            z0: 0.0,
            square: Square::new(middle - foot * self.axis),
        };
        node.needs_r = false;
        for n in 0..self.count {
            let face = &self.faces[n];
            node.faces[n] = face.at(middle, self.axis, foot);
            node.needs_r |= matches!(face.kind, Kind::Cone | Kind::Ring);
        }
    }

    /// Whether this is the same tool in the same lattice, wherever it is.
    pub(super) fn is_the_tool_of(&self, other: &Self) -> bool {
        let faces = &self.faces[..self.count];
        self.spacing == other.spacing
            && self.parts == other.parts
            && Some(faces) == other.faces.get(..other.count)
    }

    /// The apex, bone frame, units.
    pub(super) fn apex(&self) -> DVec3 {
        self.apex
    }

    /// The axis, bone frame.
    pub(super) fn axis(&self) -> DVec3 {
        self.axis
    }

    /// Number of faces.
    pub(super) fn count(&self) -> usize {
        self.count
    }
}

impl FlatFace {
    const NONE: Self = Self {
        kind: Kind::Plane,
        part: 0,
        a: 0.0,
        b: 0.0,
        c: 0.0,
        m: 0.0,
    };

    fn new(form: Form, units: f64, bend: f64, part: u8) -> Self {
        let len = |mm: f32| f64::from(mm) * units;
        let grown = form.grown_mm(bend) * units;
        let mut flat = Self { part, ..Self::NONE };
        match form {
            Form::Plane { height_mm, up } => {
                flat.a = if up { 1.0 } else { -1.0 };
                flat.c = flat.a * len(height_mm);
            }
            Form::Cone {
                normal_r,
                normal_z,
                offset_mm,
            } => {
                flat.kind = Kind::Cone;
                flat.a = f64::from(normal_r);
                flat.b = f64::from(normal_z);
                flat.c = len(offset_mm) + grown;
            }
            Form::Ball {
                radius_mm,
                centre_mm,
            } => {
                flat.kind = Kind::Ball;
                flat.b = len(centre_mm);
                flat.c = len(radius_mm) + grown;
            }
            Form::Ring {
                disc_mm,
                centre_mm,
                radius_mm,
            } => {
                flat.kind = Kind::Ring;
                flat.a = len(disc_mm);
                flat.b = len(centre_mm);
                flat.c = len(radius_mm) + grown;
            }
        }
        flat
    }

    fn widened(mut self, band: f64) -> Self {
        let wide = self.c >= WIDE * band;
        match self.kind {
            Kind::Ball if wide => self.kind = Kind::WideBall,
            Kind::Cone if wide && self.b == 0.0 => self.kind = Kind::WideCylinder,
            _ => {}
        }
        self.m = 1.0 + 3.75 * (0.5 * band / self.c) * (0.5 * band / self.c);
        self
    }

    fn distance(&self, r: f64, z: f64) -> f64 {
        match self.kind {
            Kind::Plane => self.a * z - self.c,
            Kind::Cone | Kind::WideCylinder => self.a * r + self.b * z - self.c,
            Kind::Ball | Kind::WideBall => (r * r + (z - self.b) * (z - self.b)).sqrt() - self.c,
            Kind::Ring => {
                let beyond = (r - self.a).max(0.0);
                (beyond * beyond + (z - self.b) * (z - self.b)).sqrt() - self.c
            }
        }
    }

    #[inline(always)]
    fn at(&self, base: DVec3, axis: DVec3, foot: f64) -> NodeFace {
        let mut face = NodeFace {
            kind: self.kind,
            part: self.part,
            a: self.a as f32,
            b: self.b as f32,
            c: self.c as f32,
            square: Square::ZERO,
        };
        match self.kind {
            Kind::Plane => face.c = (self.c - self.a * foot) as f32,
            Kind::Cone => face.c = (self.c - self.b * foot) as f32,
            Kind::Ball => face.square = Square::new(base - self.b * axis),
            Kind::Ring => face.b = (self.b - foot) as f32,
            Kind::WideBall => face.square = Square::less(base - self.b * axis, self.c),
            Kind::WideCylinder => face.square = Square::less(base - foot * axis, self.c),
        }
        if matches!(self.kind, Kind::WideBall | Kind::WideCylinder) {
            face.a = (0.5 * self.m / self.c) as f32;
            face.b = (0.5 / (self.c * self.c)) as f32;
        }
        face
    }
}
