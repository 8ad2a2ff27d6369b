//! The surface that is read from a cut against the one that was meant.

use super::random::{Random, face_distance};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, Carving};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::fields;
use osteon_sim_core::tool::Tool;
use osteon_sim_core::tool::revolved::Revolved;

/// One pose out of an uncut bone.
pub fn stamped(carving: Carving, bone: &Bone, tool: &Tool, pose: &Pose) -> Cut {
    let mut cut = Cut::new(bone);
    let step = CarveStep {
        tool: 0,
        before: *pose,
        after: *pose,
    };
    carving.carve(bone, &mut cut, tool, &step, &mut |_, _| {});
    cut
}

/// How far the surface that is read lies outside `p` along the outward unit normal, mm; `None` where it
/// is not within one and a half spacings.
pub fn offset(bone: &Bone, cut: &Cut, p: DVec3, normal: DVec3) -> Option<f64> {
    let h = bone.grid().spacing_mm.max_element();
    let at = |t: f64| f64::from(fields(bone, cut, p + normal * t).cut);
    let (mut lo, mut hi) = (-1.5 * h, 1.5 * h);
    if at(lo) > 0.0 || at(hi) < 0.0 {
        return None;
    }
    for _ in 0..40 {
        let middle = 0.5 * (lo + hi);
        if at(middle) < 0.0 {
            lo = middle;
        } else {
            hi = middle;
        }
    }
    Some(0.5 * (lo + hi))
}

/// A sample of offsets, mm.
#[derive(Default, Clone, Copy)]
pub struct Errors {
    pub count: u32,
    square: f64,
    sum: f64,
    pub max: f64,
}

impl Errors {
    pub fn add(&mut self, offset: f64) {
        self.count += 1;
        self.square += offset * offset;
        self.sum += offset;
        self.max = self.max.max(offset.abs());
    }

    pub fn rms(&self) -> f64 {
        (self.square / f64::from(self.count)).sqrt()
    }

    pub fn mean(&self) -> f64 {
        self.sum / f64::from(self.count)
    }
}

/// Distances of (r, z) to each face of the only part of a solid, mm.
pub fn faces_of(solid: &Revolved, r: f64, z: f64) -> Vec<f64> {
    let faces = solid.parts[0].faces.iter();
    faces.map(|f| face_distance(f.form, r, z)).collect()
}

/// Random points on the surface of a solid of one part with their outward normals, tool frame, `clear`
/// mm from every crease and from the axis where `clear_axis`.
pub fn smooth_point(
    random: &mut Random,
    solid: &Revolved,
    (clear, axis): (f64, f64),
) -> (DVec3, DVec3) {
    let b = solid.bounds;
    loop {
        let p = DVec3::new(
            random.within(b.lo.x, b.hi.x),
            random.within(b.lo.y, b.hi.y),
            random.within(b.lo.z, b.hi.z),
        );
        let d = |p: DVec3| faces_of(solid, p.truncate().length(), p.z);
        let largest = |d: &[f64]| d.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        // onto the face that decides: twice along its gradient
        let mut q = p;
        let (mut normal, mut on) = (DVec3::Z, 0);
        for _ in 0..3 {
            let here = d(q);
            let top = largest(&here);
            let face = here.iter().position(|&v| v >= top).unwrap_or(0);
            on = face;
            let e = 1e-5;
            let slope = |v: DVec3| (d(q + v)[face] - d(q - v)[face]) / (2.0 * e);
            normal = DVec3::new(
                slope(DVec3::X * e),
                slope(DVec3::Y * e),
                slope(DVec3::Z * e),
            );
            if normal.length() < 0.9 {
                break;
            }
            normal /= normal.length();
            q -= normal * top;
        }
        let here = d(q);
        let others = here.iter().enumerate().filter(|&(n, _)| n != on);
        let near = others.fold(f64::NEG_INFINITY, |m, (_, &v)| m.max(v));
        let on = here[on].abs() < 1e-6;
        if on && normal.length() > 0.9 && near < -clear && q.truncate().length() > axis {
            return (q, normal);
        }
    }
}
