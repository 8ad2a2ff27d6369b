//! A glenoid component: the back that lies on the reamed bone, and its pegs.
//!
//! Component frame: origin at the middle of the back, z out of the bone, y superior, x towards the
//! superior axis' right (anterior on a right scapula); mm. The back is a convex sphere: it bulges into the
//! bone, and its points lie at z = R − √(R² − r²).

use super::face::{disc, first_surface};
use crate::bone::Bone;
use crate::cut::Cut;
use crate::pose::Pose;
use crate::sample::Sampler;
use glam::DVec3;

/// Share of the back that must lie over bone.
pub const LEAST_COVER: f64 = 0.9;
/// Least bone around a peg, mm.
pub const LEAST_WALL_MM: f64 = 1.0;
/// A point of the back is over bone where bone begins within this of it, mm, above or below.
const OVER_MM: f64 = 5.0;
/// Distance of the points that are looked at, mm.
const STEP_MM: f64 = 1.0;

/// A peg, along −z from the back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peg {
    /// Place of its axis, x and y, mm.
    pub at_mm: [f64; 2],
    /// Diameter of its hole, mm.
    pub diameter_mm: f64,
    /// Depth of its hole below the back's middle, mm.
    pub length_mm: f64,
}

/// A component.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Name for people.
    pub name: String,
    /// Identifier in reports.
    pub id: String,
    /// Radius of the back, mm.
    pub backside_radius_mm: f64,
    /// Extent along x, mm; the outline is an ellipse.
    pub width_mm: f64,
    /// Extent along y, mm.
    pub height_mm: f64,
    /// Thickness in the middle, mm.
    pub thickness_mm: f64,
    /// Diameter of the reamer that makes its bed, mm.
    pub reamer_mm: f64,
    /// Its pegs; the first is the central one.
    pub pegs: Vec<Peg>,
}

/// A point of the back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BackPoint {
    /// Component frame, mm.
    pub position: DVec3,
    /// Unit normal into the bone.
    pub inward: DVec3,
}

/// Why a component does not fit where it is planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Misfit {
    /// Too little of the back lies over bone: the share.
    Uncovered(f64),
    /// A peg comes too near to the bone's outside: its number from 0, the least bone around it, mm (below 0:
    /// it leaves the bone).
    Peg(usize, f64),
}

impl Peg {
    /// Least distance from its surface to the bone's outside, mm, behind the first 4 mm; saturated at
    /// the distance field's reach. Below 0 where it leaves the bone.
    pub fn wall_mm(&self, bone: &Bone, bone_from_component: &Pose) -> f64 {
        const FROM_MM: f64 = 4.0;
        let cut = Cut::new(bone);
        let sampler = Sampler::new(bone, &cut);
        let radius = 0.5 * self.diameter_mm;
        let mut least = f64::INFINITY;
        let steps = ((self.length_mm - FROM_MM).max(0.0) / 0.5).ceil();
        let mut n = 0.0;
        while n <= steps {
            let z = -(FROM_MM + (self.length_mm - FROM_MM) * n / steps.max(1.0));
            for turn in 0..24 {
                let (sin, cos) = libm::sincos(f64::from(turn) * core::f64::consts::TAU / 24.0);
                let p = DVec3::new(
                    self.at_mm[0] + radius * cos,
                    self.at_mm[1] + radius * sin,
                    z,
                );
                least = least.min(f64::from(
                    sampler.fields(bone_from_component.point(p)).solid,
                ));
            }
            n += 1.0;
        }
        least
    }
}

impl Component {
    /// Height of the back at a distance from its middle, mm.
    pub fn back_mm(&self, r: f64) -> f64 {
        let big = self.backside_radius_mm;
        big - (big * big - r * r).max(0.0).sqrt()
    }

    /// Points all over the back, `step_mm` apart.
    pub fn back_points(&self, step_mm: f64) -> Vec<BackPoint> {
        let (a, b) = (0.5 * self.width_mm, 0.5 * self.height_mm);
        let middle = DVec3::Z * self.backside_radius_mm;
        disc(a.max(b), step_mm)
            .filter(|(x, y)| (x / a).powi(2) + (y / b).powi(2) <= 1.0)
            .map(|(x, y)| {
                let position = DVec3::new(x, y, self.back_mm(x.hypot(y)));
                let inward = (position - middle) / self.backside_radius_mm;
                BackPoint { position, inward }
            })
            .collect()
    }

    /// Share of the back over bone, in [0, 1], with the component's frame at `bone_from_component`.
    pub fn cover(&self, bone: &Bone, bone_from_component: &Pose) -> f64 {
        let cut = Cut::new(bone);
        let sampler = Sampler::new(bone, &cut);
        let points = self.back_points(STEP_MM);
        let over = |p: &&BackPoint| {
            let from = bone_from_component.point(p.position - p.inward * OVER_MM);
            let along = bone_from_component.vector(p.inward);
            first_surface(&|p| f64::from(sampler.depth(p)), from, along, 2.0 * OVER_MM).is_some()
        };
        points.iter().filter(over).count() as f64 / points.len().max(1) as f64
    }

    /// Refuses a place where the back hangs over or a peg comes out.
    pub fn check(&self, bone: &Bone, bone_from_component: &Pose) -> Result<(), Misfit> {
        let cover = self.cover(bone, bone_from_component);
        if cover < LEAST_COVER {
            return Err(Misfit::Uncovered(cover));
        }
        for (n, peg) in self.pegs.iter().enumerate() {
            let wall = peg.wall_mm(bone, bone_from_component);
            // a coarse bone's distances end at its band
            let least = LEAST_WALL_MM.min(0.9 * bone.grid().band_mm());
            if wall < least {
                return Err(Misfit::Peg(n, wall));
            }
        }
        Ok(())
    }
}
