//! What of the bone can be in the picture.

use glam::{DVec3, Mat4, Vec4};

/// The six planes of a view, pointing inward.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frustum {
    planes: [Vec4; 6],
}

impl Frustum {
    /// Of a projection whose depth runs from 0 to 1.
    pub(crate) fn new(clip_from_bone: &Mat4) -> Self {
        let rows = clip_from_bone.transpose();
        let (x, y, z, w) = (rows.x_axis, rows.y_axis, rows.z_axis, rows.w_axis);
        Self {
            planes: [w + x, w - x, w + y, w - y, z, w - z],
        }
    }

    /// Whether a box can be seen: false only where all of it is outside one plane.
    pub(crate) fn touches(&self, lo: DVec3, hi: DVec3) -> bool {
        let (lo, hi) = (lo.as_vec3(), hi.as_vec3());
        self.planes.iter().all(|plane| {
            // the corner farthest along the plane's normal
            let n = plane.truncate();
            let corner = glam::Vec3::select(n.cmpge(glam::Vec3::ZERO), hi, lo);
            n.dot(corner) + plane.w >= 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use glam::DVec2;
    use osteon_sim_core::pose::Pose;

    #[test]
    fn a_box_with_a_visible_point_is_never_culled_and_one_far_beside_is() {
        let mut camera = Camera::at_plan(&Pose::IDENTITY, DVec3::Z);
        let (mut seen, mut culled) = (0, 0);
        for step in 0..400 {
            let t = f64::from(step);
            camera.orbit(DVec2::new(0.1, 0.03 * (0.2 * t).sin()));
            let clip = camera.clip_from_bone(1.6);
            let frustum = Frustum::new(&clip);
            let middle = DVec3::new((1.3 * t).sin(), (0.7 * t).cos(), (0.4 * t).sin()) * 260.0;
            let (lo, hi) = (middle - 16.0, middle + 16.0);
            let visible = (0..729).any(|n| {
                let at = DVec3::new(f64::from(n % 9), f64::from(n / 9 % 9), f64::from(n / 81));
                let c = clip * (lo + at * 4.0).as_vec3().extend(1.0);
                c.w > 0.0 && c.x.abs() <= c.w && c.y.abs() <= c.w && (0.0..=c.w).contains(&c.z)
            });
            let touches = frustum.touches(lo, hi);
            assert!(touches || !visible, "step {step}");
            seen += u32::from(visible);
            culled += u32::from(!touches);
        }
        assert!(seen > 50 && culled > 50, "{seen} {culled}");
    }
}
