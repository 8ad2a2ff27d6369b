//! The joint face as rays along a direction find it, and its best sphere and plane.

use super::fit::{Plane, Sphere, plane, sphere};
use crate::bone::Bone;
use crate::cut::Cut;
use crate::pose::Pose;
use crate::sample::Sampler;
use glam::DVec3;

/// Shortest step of a ray, mm; longer ones are what the distance field allows.
const LEAST_STEP_MM: f64 = 0.02;
/// Halvings after a crossing.
const HALVINGS: usize = 40;
/// Distance of the rays, mm.
const RAYS_MM: f64 = 1.0;
/// A point farther from the face's sphere than so many times its spread is rim or beyond …
const SPREADS: f64 = 2.5;
/// … but within these bounds, mm.
const LEAST_RIM_MM: f64 = 0.4;
const RIM_MM: f64 = 2.0;
/// Fewest points that make a face.
const FEWEST: usize = 60;

/// Distance along a ray, mm, from `from` in the unit direction `along` to where what is left of the bone
/// begins, within `reach_mm`. 0 where the ray begins inside.
///
/// `depth` is the distance into the bone at a point, mm, positive inside, nowhere farther from 0 than the
/// surface is.
pub fn first_surface(
    depth: &dyn Fn(DVec3) -> f64,
    from: DVec3,
    along: DVec3,
    reach_mm: f64,
) -> Option<f64> {
    let depth = |t: f64| depth(from + along * t);
    let mut t = 0.0;
    let mut outside = 0.0;
    while t <= reach_mm {
        let d = depth(t);
        if d > 0.0 {
            return Some(crossing(outside, t, |t| depth(t) > 0.0));
        }
        outside = t;
        t += (-d).max(LEAST_STEP_MM);
    }
    None
}

/// Where `inside` becomes true between `outside` and `inside_at`.
fn crossing(mut outside: f64, mut inside_at: f64, inside: impl Fn(f64) -> bool) -> f64 {
    if outside >= inside_at {
        return inside_at;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (outside + inside_at);
        if inside(middle) {
            inside_at = middle;
        } else {
            outside = middle;
        }
    }
    0.5 * (outside + inside_at)
}

/// A joint face.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// Points on it, bone frame, mm.
    pub points: Vec<DVec3>,
    /// Their sphere; the centre lies outside the bone on a hollow face.
    pub sphere: Sphere,
    /// Their plane; the normal looks out of the bone.
    pub plane: Plane,
}

/// The joint face about the z axis of `bone_from_guess` (outward), within `radius_mm` of it: where rays
/// along −z first meet bone, without what lies off their common sphere (the rim and what is beyond). `None`
/// where there is no such face.
pub fn find(bone: &Bone, bone_from_guess: &Pose, radius_mm: f64) -> Option<Face> {
    let cut = Cut::new(bone);
    let sampler = Sampler::new(bone, &cut);
    find_by(&|p| f64::from(sampler.depth(p)), bone_from_guess, radius_mm)
}

/// The same on any distance field, as for [`first_surface`].
pub fn find_by(
    depth: &dyn Fn(DVec3) -> f64,
    bone_from_guess: &Pose,
    radius_mm: f64,
) -> Option<Face> {
    const ABOVE_MM: f64 = 12.0;
    const REACH_MM: f64 = 24.0;
    let inward = -bone_from_guess.vector(DVec3::Z);
    let mut points = Vec::new();
    for (x, y) in disc(radius_mm, RAYS_MM) {
        let from = bone_from_guess.point(DVec3::new(x, y, ABOVE_MM));
        if let Some(t) = first_surface(depth, from, inward, REACH_MM) {
            points.push(from + inward * t);
        }
    }
    let outward = -inward;
    let mut kept = points.clone();
    for _ in 0..8 {
        if kept.len() < FEWEST {
            return None;
        }
        let ball = sphere(&kept)?;
        let near = (SPREADS * ball.rms_mm).clamp(LEAST_RIM_MM, RIM_MM);
        let next: Vec<DVec3> = points
            .iter()
            .copied()
            .filter(|p| (p.distance(ball.centre) - ball.radius_mm).abs() < near)
            .collect();
        if next.len() == kept.len() {
            break;
        }
        kept = next;
    }
    let sphere = sphere(&kept)?;
    let mut plane = plane(&kept)?;
    if plane.normal.dot(outward) < 0.0 {
        plane.normal = -plane.normal;
    }
    Some(Face {
        points: kept,
        sphere,
        plane,
    })
}

/// Points of a square grid inside a disc about the origin, mm.
pub fn disc(radius_mm: f64, step_mm: f64) -> impl Iterator<Item = (f64, f64)> {
    #[expect(clippy::cast_possible_truncation, reason = "a few dozen")]
    let n = (radius_mm / step_mm).floor() as i32;
    (-n..=n)
        .flat_map(move |j| (-n..=n).map(move |i| (f64::from(i) * step_mm, f64::from(j) * step_mm)))
        .filter(move |(x, y)| x * x + y * y <= radius_mm * radius_mm)
}
