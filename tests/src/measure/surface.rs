//! The error of a carved surface against the exact tool: signed distances along exact normals.
//!
//! Points are spread over the exact surface of the swept solid where it lies inside the bone. From each
//! the carved surface is sought along the exact normal. Positive errors: the cut went too far.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a place in a list; voxel indices inside the lattice"
)]

use super::swept::Swept;
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::tool::Shape;
use rayon::prelude::*;

/// Distance from a corner of the profile, from an edge between two cuts and from the bone's surface
/// within which a point counts as *at a crease*, voxels.
pub const CREASE_VOXELS: f64 = 1.5;
/// Normals that turn by more than this within [`CREASE_VOXELS`] make a crease, cosine (30°).
const CREASE_COS: f64 = 0.866;
/// Golden ratio less one, and its square: a low-discrepancy lattice.
const GOLDEN: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_2,
    0.549_700_477_901_970_4,
];

/// A point of the exact swept surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// Bone frame, mm.
    pub position: DVec3,
    /// Unit normal, out of the swept solid.
    pub normal: DVec3,
    /// Within [`CREASE_VOXELS`] of a corner of the tool or an edge between two cuts.
    pub crease: bool,
}

/// Statistics of signed errors, µm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    /// Points where the surface was found.
    pub points: usize,
    /// Points where no surface was found within reach: failures, not in the other figures.
    pub lost: usize,
    /// Root mean square.
    pub rms_um: f64,
    /// Largest absolute value.
    pub max_um: f64,
    /// Mean (bias), positive = too much was cut.
    pub mean_um: f64,
}

/// Errors away from creases and at them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SurfaceError {
    /// Away from creases.
    pub smooth: Errors,
    /// At creases.
    pub crease: Errors,
}

impl Errors {
    /// Of signed distances in mm; `None` = not found.
    pub fn of(errors_mm: impl Iterator<Item = Option<f64>>) -> Self {
        let (mut e, mut sum, mut square) = (Self::default(), 0.0, 0.0);
        for error in errors_mm {
            let Some(mm) = error else {
                e.lost += 1;
                continue;
            };
            e.points += 1;
            sum += mm;
            square += mm * mm;
            e.max_um = e.max_um.max(1e3 * mm.abs());
        }
        if e.points > 0 {
            e.mean_um = 1e3 * sum / e.points as f64;
            e.rms_um = 1e3 * (square / e.points as f64).sqrt();
        }
        e
    }
}

/// The solid distance at a point, interpolated as the program does; −band where there is no chunk.
pub fn solid_mm(bone: &Bone, p: DVec3) -> f64 {
    let grid = bone.grid();
    trilinear(bone, p, -grid.band_mm(), |chunk, voxel| {
        f64::from(bone.chunk(chunk).solid[voxel]) * f64::from(grid.quantum_mm())
    })
}

/// Trilinear reading of a voxel field at a point of the bone frame.
fn trilinear(bone: &Bone, p: DVec3, outside: f64, read: impl Fn(usize, usize) -> f64) -> f64 {
    let index = p / bone.grid().spacing_mm;
    let low = index.floor();
    let f = index - low;
    let mut sum = 0.0;
    for corner in 0..8u8 {
        let bit = DVec3::new(
            f64::from(corner & 1),
            f64::from((corner >> 1) & 1),
            f64::from(corner >> 2),
        );
        let weight = (f * bit + (1.0 - f) * (1.0 - bit)).to_array();
        let at = low + bit;
        let inside =
            at.min_element() >= 0.0 && at.max_element() < osteon_sim_core::grid::MAX_DIM as f64;
        let value = inside
            .then(|| bone.locate(at.to_array().map(|v| v as usize)))
            .flatten()
            .map_or(outside, |(chunk, voxel)| read(chunk, voxel));
        sum += weight.iter().product::<f64>() * value;
    }
    sum
}

/// At most `count` points of the exact swept surface that lie at least [`CREASE_VOXELS`] deep inside the
/// bone. Fewer where most of the tool is outside of it.
pub fn envelope(swept: &Swept, bone: &Bone, count: usize) -> Vec<SurfacePoint> {
    let h = bone.grid().spacing_mm;
    // stored distances end at the band
    let enough = (CREASE_VOXELS * h.max_element()).min(0.95 * bone.grid().band_mm());
    // a third of the candidates is inside the bone in a typical press
    let candidates = 6 * count;
    let mut found: Vec<SurfacePoint> = (0..candidates)
        .into_par_iter()
        .filter_map(|n| {
            let point = exact_point(swept, bone, n, candidates)?;
            (solid_mm(bone, point.position) > enough).then_some(point)
        })
        .collect();
    let every = found.len().div_ceil(count.max(1)).max(1);
    found = found.into_iter().step_by(every).collect();
    found.par_iter_mut().for_each(|point| {
        point.crease = is_crease(swept, point, h.max_element());
    });
    found
}

/// A point of the swept surface, from candidate `n` of `count`: from a point of one pose's surface out
/// of all tools, then back to the nearest surface.
fn exact_point(swept: &Swept, bone: &Bone, n: usize, count: usize) -> Option<SurfacePoint> {
    let h = bone.grid().spacing_mm.min_element();
    let fraction = |g: f64| (n as f64 * g).fract();
    // half of the candidates at the last pose, which shapes most of what a press leaves
    let last = swept.len() - 1;
    let pose = if n.is_multiple_of(2) {
        last
    } else {
        ((n as f64 / count as f64) * last as f64) as usize
    };
    let (q, out) = on_outline(swept.shape(), fraction(GOLDEN[0]), fraction(GOLDEN[1]))?;
    let at = swept.bone_from_tool(pose);
    let (mut p, out) = (at.point(q), at.vector(out));
    // far outside of the bone: the walk outward will hardly lead into it
    if solid_mm(bone, p) <= -0.9 * bone.grid().band_mm() {
        return None;
    }
    p += out * (0.3 * h);
    for _ in 0..24 {
        let nearest = swept.nearest(p);
        if nearest.distance > 0.02 * h {
            let normal = swept.normal(nearest.pose, p)?;
            let position = p - normal * nearest.distance;
            // the foot of a point outside is on the surface, or rounding at an edge spoiled it
            return (swept.nearest(position).distance.abs() < 2e-4).then_some(SurfacePoint {
                position,
                normal,
                crease: false,
            });
        }
        p += out * (-nearest.distance).max(0.2 * h);
    }
    None
}

/// A point of the outline turned on a lathe, chosen by area, and the outward normal there; the tool's
/// flat back is left out.
pub(crate) fn on_outline(shape: &Shape, along: f64, around: f64) -> Option<(DVec3, DVec3)> {
    let outline = shape.outline();
    let pairs = || {
        let n = outline.len().saturating_sub(2);
        outline.windows(2).take(n).map(|p| {
            let [a, b] = [p[0].map(f64::from), p[1].map(f64::from)];
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            (a, b, length, 0.5 * (a[0] + b[0]) * length)
        })
    };
    let mut left = along * pairs().map(|p| p.3).sum::<f64>();
    for (a, b, length, area) in pairs() {
        if left <= area && length > 0.0 && area > 0.0 {
            let t = left / area;
            let (r, z) = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
            let turn = glam::DVec2::from_angle(std::f64::consts::TAU * around);
            let side = turn.extend(0.0);
            let normal = side * ((b[1] - a[1]) / length) - DVec3::Z * ((b[0] - a[0]) / length);
            return Some((side * r + DVec3::Z * z, normal));
        }
        left -= area;
    }
    None
}

/// Whether the exact normal turns by more than 30° within [`CREASE_VOXELS`]: a corner of the tool or an
/// edge between two cuts, whatever the shape.
fn is_crease(swept: &Swept, point: &SurfacePoint, h: f64) -> bool {
    let radius = CREASE_VOXELS * h;
    let (u, v) = point.normal.any_orthonormal_pair();
    (0..12u8).any(|n| {
        let ring = if n < 8 { 1.0 } else { 0.5 };
        let turn = glam::DVec2::from_angle(std::f64::consts::TAU * f64::from(n) / 8.0) * ring;
        let lift = point.normal * (0.05 * h);
        let p = point.position + (u * turn.x + v * turn.y) * radius + lift;
        let nearest = swept.nearest(p);
        swept
            .normal(nearest.pose, p)
            .is_none_or(|other| other.dot(point.normal) < CREASE_COS)
    })
}

/// Errors of the surface where `cut_mm` (positive outside the cut, at a point of the bone frame)
/// changes sign, at the points of [`envelope`]. The surface is sought within `reach_mm`.
pub fn errors(
    points: &[SurfacePoint],
    spacing: DVec3,
    reach_mm: f64,
    cut_mm: &(dyn Fn(DVec3) -> f32 + Sync),
) -> SurfaceError {
    let found: Vec<(bool, Option<f64>)> = points
        .par_iter()
        .map(|p| (p.crease, along_normal(p, spacing, reach_mm, cut_mm)))
        .collect();
    let of = |crease: bool| {
        let those = found.iter().filter(|(c, _)| *c == crease);
        Errors::of(those.map(|(_, e)| *e))
    };
    SurfaceError {
        smooth: of(false),
        crease: of(true),
    }
}

/// Where the cut's sign changes from cut to uncut along the normal, nearest to the exact surface.
fn along_normal(
    point: &SurfacePoint,
    spacing: DVec3,
    reach_mm: f64,
    cut_mm: &(dyn Fn(DVec3) -> f32 + Sync),
) -> Option<f64> {
    let step = 0.125 * spacing.min_element();
    let uncut = |s: f64| cut_mm(point.position + point.normal * s) > 0.0;
    let refine = |mut low: f64, mut high: f64| {
        for _ in 0..20 {
            let middle = f64::midpoint(low, high);
            if uncut(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        f64::midpoint(low, high)
    };
    // outward and inward in turns: the nearest change wins
    let (mut low, mut high) = (0.0, 0.0);
    let (mut low_uncut, mut high_uncut) = (uncut(0.0), uncut(0.0));
    while high < reach_mm {
        let next = uncut(high + step);
        if !high_uncut && next {
            return Some(refine(high, high + step));
        }
        (high, high_uncut) = (high + step, next);
        let before = uncut(low - step);
        if !before && low_uncut {
            return Some(refine(low - step, low));
        }
        (low, low_uncut) = (low - step, before);
    }
    None
}

#[cfg(test)]
mod tests;
