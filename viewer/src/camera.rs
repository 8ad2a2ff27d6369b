//! The orbit camera.
//!
//! View frame: x right, y up, z from the target to the eye. `up` is the patient's superior
//! direction in the bone frame; the angles turn about it, starting at the glenoid's normal.
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use glam::{DMat3, DVec2, DVec3, Mat4};
use osteon_sim_core::pose::Pose;

/// Vertical field of view, rad.
const FIELD_OF_VIEW: f64 = 0.52;
/// Steepest look from above or below, rad: short of the pole.
const MOST_PITCH: f64 = 1.54;
/// Where a session begins: this far round from the glenoid's normal, rad.
const FIRST_YAW: f64 = 0.62;
/// And this far up.
const FIRST_PITCH: f64 = 0.30;
/// Share of the picture that a fitted bone fills.
const FILL: f64 = 0.92;
/// Half height of a close-up, mm.
const CLOSE_UP_MM: f64 = 30.0;

/// Where from and in which direction the bone is seen. All in the bone frame, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Camera {
    // columns: right, up, towards the eye at zero angles
    frame: DMat3,
    yaw: f64,
    pitch: f64,
    target: DVec3,
    // target to eye, positive
    distance: f64,
}

/// The usual places to look from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Preset {
    /// Obliquely onto the joint, as a session begins.
    Surgeon,
    /// Straight onto the joint's face.
    Lateral,
    /// Along the tool, from its shank to its tip.
    Tool,
}

/// Half the turn between both eyes, rad: a convergence of 1.9°, comfortable on a screen.
const HALF_CONVERGENCE: f64 = 1.0 / 60.0;

/// The camera's axes in the bone frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axes {
    /// The eye, mm.
    pub(crate) eye: DVec3,
    /// Unit, to the right of the picture.
    pub(crate) right: DVec3,
    /// Unit, to its top.
    pub(crate) up: DVec3,
    /// Unit, into it.
    pub(crate) forward: DVec3,
}

impl Camera {
    /// Looks at the glenoid obliquely, so that its face and the blade behind it are seen. `up`
    /// need not be at right angles to the plan's axis.
    pub(crate) fn at_plan(bone_from_plan: &Pose, up: DVec3) -> Self {
        let normal = bone_from_plan.vector(DVec3::Z);
        let up = up.try_normalize().unwrap_or(DVec3::Z);
        let towards = (normal - up * normal.dot(up))
            .try_normalize()
            .unwrap_or_else(|| up.any_orthonormal_vector());
        Self {
            frame: DMat3::from_cols(up.cross(towards), up, towards),
            yaw: FIRST_YAW,
            pitch: FIRST_PITCH,
            target: bone_from_plan.translation,
            distance: 300.0,
        }
    }

    /// Right, up, forward and eye.
    pub(crate) fn axes(&self) -> Axes {
        let (sy, cy) = self.yaw.sin_cos();
        let (sp, cp) = self.pitch.sin_cos();
        let back = self.frame * DVec3::new(sy * cp, sp, cy * cp);
        let right = self.frame * DVec3::new(cy, 0.0, -sy);
        Axes {
            eye: self.target + back * self.distance,
            right,
            up: back.cross(right),
            forward: -back,
        }
    }

    /// Half width and half height of the picture at unit depth.
    pub(crate) fn half_extent(aspect: f64) -> DVec2 {
        let half = (0.5 * FIELD_OF_VIEW).tan();
        DVec2::new(half * aspect, half)
    }

    /// Moves target and distance so that all `points` are just seen.
    pub(crate) fn fit(&mut self, points: &[DVec3], aspect: f64) {
        let axes = self.axes();
        let tangent = Self::half_extent(aspect) * FILL;
        let mut lo = DVec3::splat(f64::INFINITY);
        let mut hi = -lo;
        for p in points {
            let q = DVec3::new(p.dot(axes.right), p.dot(axes.up), p.dot(axes.forward));
            lo = lo.min(q);
            hi = hi.max(q);
        }
        if !(lo.is_finite() && hi.is_finite()) {
            return;
        }
        let mid = 0.5 * (lo + hi);
        self.target = axes.right * mid.x + axes.up * mid.y + axes.forward * mid.z;
        let mut distance = 10.0_f64;
        for p in points {
            let d = *p - self.target;
            let depth = d.dot(axes.forward);
            let need = (d.dot(axes.right).abs() / tangent.x).max(d.dot(axes.up).abs() / tangent.y);
            distance = distance.max(need - depth);
        }
        self.distance = distance;
    }

    /// Looks closely at a point.
    pub(crate) fn close_up(&mut self, point: DVec3) {
        self.target = point;
        self.distance = CLOSE_UP_MM / (0.5 * FIELD_OF_VIEW).tan();
    }

    /// Looks from one of the usual places: at the tool's tip along the tool, else at the joint.
    pub(crate) fn look_from(
        &mut self,
        preset: Preset,
        bone_from_plan: &Pose,
        bone_from_tool: Option<Pose>,
    ) {
        let joint = bone_from_plan.translation;
        let (target, yaw, pitch) = match (preset, bone_from_tool) {
            (Preset::Surgeon, _) => (joint, FIRST_YAW, FIRST_PITCH),
            (Preset::Tool, Some(tool)) => {
                let back = self.frame.transpose() * tool.vector(DVec3::Z);
                let pitch = back.y.clamp(-1.0, 1.0).asin();
                (
                    tool.translation,
                    back.x.atan2(back.z),
                    pitch.clamp(-MOST_PITCH, MOST_PITCH),
                )
            }
            (Preset::Lateral, _) | (Preset::Tool, None) => (joint, 0.0, 0.0),
        };
        (self.yaw, self.pitch) = (yaw, pitch);
        self.close_up(target);
        // the joint and what is around it
        self.distance *= 1.6;
    }

    /// The same, seen by an eye half the convergence to the left (−1) or to the right (1).
    pub(crate) fn eye(mut self, side: f64) -> Self {
        self.yaw += side * HALF_CONVERGENCE;
        self
    }

    /// Turns by a drag, in heights of the picture.
    pub(crate) fn orbit(&mut self, drag: DVec2) {
        self.yaw -= drag.x * 3.0;
        self.pitch = (self.pitch + drag.y * 3.0).clamp(-MOST_PITCH, MOST_PITCH);
    }

    /// Shifts by a drag, in heights of the picture.
    pub(crate) fn pan(&mut self, drag: DVec2) {
        let axes = self.axes();
        let height = 2.0 * self.distance * (0.5 * FIELD_OF_VIEW).tan();
        self.target += (axes.up * drag.y - axes.right * drag.x) * height;
    }

    /// Comes nearer (positive) or goes away, in notches of a wheel.
    pub(crate) fn zoom(&mut self, notches: f64) {
        self.distance = (self.distance * (-0.12 * notches).exp()).clamp(5.0, 5000.0);
    }

    /// Projection times view: bone frame to clip space, depth 0 at the near plane.
    pub(crate) fn clip_from_bone(&self, aspect: f64) -> Mat4 {
        let axes = self.axes();
        let view = glam::camera::rh::view::look_at_mat4(
            axes.eye.as_vec3(),
            self.target.as_vec3(),
            axes.up.as_vec3(),
        );
        // the reach of the depth buffer follows the distance: near enough for a tool at the eye
        let (near, far) = (0.02 * self.distance, 20.0 * self.distance + 1000.0);
        let projection = glam::camera::rh::proj::directx::perspective(
            FIELD_OF_VIEW as f32,
            aspect as f32,
            near as f32,
            far as f32,
        );
        projection * view
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let plan =
            Pose::from_origin_and_z(DVec3::new(10.0, 20.0, 30.0), DVec3::new(0.9, -0.3, 0.2));
        Camera::at_plan(&plan, DVec3::Z)
    }

    #[test]
    fn axes_are_orthonormal_and_right_handed() {
        let mut camera = camera();
        camera.orbit(DVec2::new(0.7, -0.4));
        let a = camera.axes();
        let m = DMat3::from_cols(a.right, a.up, -a.forward);
        assert!((m.determinant() - 1.0).abs() < 1e-12);
        assert!(
            (m.transpose() * m - DMat3::IDENTITY)
                .to_cols_array()
                .iter()
                .all(|v| v.abs() < 1e-12)
        );
    }

    #[test]
    fn fitted_points_are_inside_the_picture_and_fill_it() {
        let mut camera = camera();
        let points: Vec<DVec3> = (0..8)
            .map(|c| {
                DVec3::new(
                    f64::from(c & 1) * 80.0,
                    f64::from(c >> 1 & 1) * 50.0,
                    f64::from(c >> 2) * 120.0,
                )
            })
            .collect();
        camera.fit(&points, 1.5);
        let clip = camera.clip_from_bone(1.5);
        let reach = points.iter().map(|p| {
            let c = clip.project_point3(p.as_vec3());
            assert!((0.0..1.0).contains(&c.z), "{c}");
            c.x.abs().max(c.y.abs())
        });
        let reach = reach.fold(0.0f32, f32::max);
        assert!((0.85..=0.93).contains(&reach), "{reach}");
    }

    #[test]
    fn the_ray_of_a_pixel_and_its_projection_agree() {
        let camera = camera();
        let axes = camera.axes();
        let half = Camera::half_extent(1.6);
        let ray = axes.forward + axes.right * (half.x * 0.4) - axes.up * (half.y * 0.7);
        let clip = camera
            .clip_from_bone(1.6)
            .project_point3((axes.eye + ray * 200.0).as_vec3());
        assert!(
            (clip.x - 0.4).abs() < 1e-4 && (clip.y + 0.7).abs() < 1e-4,
            "{clip}"
        );
    }

    #[test]
    fn the_tools_eye_looks_along_the_tool_and_the_lateral_one_onto_the_face() {
        let plan = Pose::from_origin_and_z(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.9, -0.3, 0.0));
        let mut camera = Camera::at_plan(&plan, DVec3::Z);
        let tool = Pose::from_origin_and_z(DVec3::new(4.0, 0.0, 9.0), DVec3::new(0.4, 0.7, 0.5));
        camera.look_from(Preset::Tool, &plan, Some(tool));
        let axes = camera.axes();
        assert!((axes.forward + tool.vector(DVec3::Z)).length() < 1e-9);
        let to_tip = tool.translation - axes.eye;
        assert!(
            to_tip.cross(axes.forward).length() < 1e-9,
            "the tip is in the middle"
        );
        camera.look_from(Preset::Lateral, &plan, None);
        assert!((camera.axes().forward + plan.vector(DVec3::Z)).length() < 1e-9);
    }

    #[test]
    fn both_eyes_see_the_target_in_the_middle_from_either_side() {
        let camera = camera();
        let [left, right] = [-1.0, 1.0].map(|side| camera.eye(side).axes());
        let across = (right.eye - left.eye).dot(camera.axes().right);
        let distance = (camera.axes().eye - DVec3::new(10.0, 20.0, 30.0)).length();
        assert!(across > 0.0 && across < distance / 20.0, "{across}");
        for axes in [left, right] {
            let to_target = DVec3::new(10.0, 20.0, 30.0) - axes.eye;
            assert!(to_target.cross(axes.forward).length() < 1e-9 * distance);
        }
    }

    #[test]
    fn a_plan_along_the_up_axis_is_no_special_case() {
        let plan = Pose::from_origin_and_z(DVec3::ZERO, DVec3::Z);
        let axes = Camera::at_plan(&plan, DVec3::Z).axes();
        assert!(axes.eye.is_finite() && axes.right.is_finite());
    }
}
