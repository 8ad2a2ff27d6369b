//! Where the device sits in the patient: registration, motion scale, and the clutch.

use crate::pose::Pose;
use glam::{DMat3, DQuat, DVec3};

/// The point of the device's base frame that is laid on the plan's origin: the middle of its
/// workspace, mm.
pub const WORKSPACE_CENTRE_MM: DVec3 = DVec3::new(0.0, 0.0, 0.0);

/// `bone_from_base` for a plan: the workspace's centre lies on the plan's origin, the base's z (towards
/// the user) on the plan's z (out of the glenoid), and the patient's head as far up as that allows.
///
/// `bone_from_plan`: origin at the glenoid's centre, z outward. `lps_from_bone`: bone to DICOM LPS,
/// whose z points to the head. Motion scale 1.
pub fn bone_from_base(bone_from_plan: &Pose, lps_from_bone: &Pose) -> Pose {
    let outward = bone_from_plan.vector(DVec3::Z);
    let head = lps_from_bone.inverse().vector(DVec3::Z);
    let up = (head - outward * head.dot(outward))
        .try_normalize()
        .unwrap_or_else(|| outward.any_orthonormal_vector());
    let right = up.cross(outward);
    let rotation = DQuat::from_mat3(&DMat3::from_cols(right, up, outward));
    Pose::new(
        rotation,
        bone_from_plan.translation - rotation * WORKSPACE_CENTRE_MM,
    )
}

/// How the stylus moves the tool. Every change is made so that the tool stays where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Workspace {
    // bone from base, its translation in bone mm
    rotation: DQuat,
    origin: DVec3,
    scale: f64,
    // stylus from tool: what a clutch has turned
    grip: DQuat,
    // where the tool waits while the clutch is held
    clutched: Option<Pose>,
}

impl Workspace {
    /// Registered, and scaled about the base's origin.
    pub fn new(bone_from_base: &Pose, scale: f64) -> Self {
        Self {
            rotation: bone_from_base.rotation,
            origin: bone_from_base.translation,
            scale,
            grip: DQuat::IDENTITY,
            clutched: None,
        }
    }

    /// `bone_from_device` of a stylus; the waiting tool's while the clutch is held.
    pub fn place(&self, base_from_stylus: &Pose) -> Pose {
        self.clutched.unwrap_or_else(|| {
            Pose::new(
                (self.rotation * base_from_stylus.rotation * self.grip).normalize(),
                self.origin + self.rotation * (base_from_stylus.translation * self.scale),
            )
        })
    }

    /// A vector of the base frame in the bone frame; lengths are kept.
    pub fn bone_from_base(&self, v: DVec3) -> DVec3 {
        self.rotation * v
    }

    /// A vector of the bone frame in the base frame; lengths are kept.
    pub fn base_from_bone(&self, v: DVec3) -> DVec3 {
        self.rotation.conjugate() * v
    }

    /// Millimetres of the tool per millimetre of the stylus.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Whether the clutch is held.
    pub fn is_clutched(&self) -> bool {
        self.clutched.is_some()
    }

    /// Holds or lets go the clutch: the tool waits while the stylus finds a better place.
    pub fn clutch(&mut self, hold: bool, base_from_stylus: &Pose) {
        match (hold, self.clutched) {
            (true, None) => self.clutched = Some(self.place(base_from_stylus)),
            (false, Some(waiting)) => {
                self.clutched = None;
                self.anchor(&waiting, base_from_stylus);
            }
            _ => {}
        }
    }

    /// Another motion scale.
    pub fn set_scale(&mut self, scale: f64, base_from_stylus: &Pose) {
        let here = self.place(base_from_stylus);
        self.scale = scale;
        self.anchor(&here, base_from_stylus);
    }

    /// Turns the workspace about the base's z (the line of sight), rad.
    pub fn turn(&mut self, angle: f64, base_from_stylus: &Pose) {
        let here = self.place(base_from_stylus);
        let (s, c) = (libm::sin(0.5 * angle), libm::cos(0.5 * angle));
        self.rotation = (self.rotation * DQuat::from_xyzw(0.0, 0.0, s, c)).normalize();
        self.anchor(&here, base_from_stylus);
    }

    // makes `place(stylus)` the given pose
    fn anchor(&mut self, bone_from_tool: &Pose, base_from_stylus: &Pose) {
        if let Some(waiting) = &mut self.clutched {
            *waiting = *bone_from_tool;
            return;
        }
        let stylus = self.rotation * base_from_stylus.rotation;
        self.grip = (stylus.conjugate() * bone_from_tool.rotation).normalize();
        self.origin = bone_from_tool.translation
            - self.rotation * (base_from_stylus.translation * self.scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_users_z_is_the_glenoids_outward_normal() {
        let plan = Pose::from_origin_and_z(DVec3::new(10.0, 20.0, 30.0), DVec3::new(1.0, 0.2, 0.1));
        let bone_from_base = bone_from_base(&plan, &Pose::IDENTITY);
        assert!(bone_from_base.is_valid());
        let approach = bone_from_base.point(WORKSPACE_CENTRE_MM + DVec3::Z * 20.0);
        let expected = plan.point(DVec3::Z * 20.0);
        assert!((approach - expected).length() < 1e-9);
        // the patient's head is up
        assert!(bone_from_base.vector(DVec3::Y).z > 0.9);
    }

    fn close(a: &Pose, b: &Pose) -> bool {
        (a.translation - b.translation).length() < 1e-9
            && a.rotation.dot(b.rotation).abs() > 1.0 - 1e-12
    }

    #[test]
    fn no_change_of_the_workspace_moves_the_tool() {
        let registered =
            Pose::from_origin_and_z(DVec3::new(10.0, 20.0, 30.0), DVec3::new(1.0, 0.2, 0.1));
        let mut space = Workspace::new(&registered, 1.0);
        let stylus = |n: f64| {
            let axis = DVec3::new(0.3 * n, 0.1, 1.0);
            Pose::from_origin_and_z(DVec3::new(5.0 * n, -3.0, 2.0 + n), axis)
        };
        assert!(close(
            &space.place(&stylus(1.0)),
            &registered.then(&stylus(1.0))
        ));
        let mut here = space.place(&stylus(1.0));
        for round in 0..3 {
            space.set_scale(2.0 + f64::from(round), &stylus(1.0));
            assert!(close(&space.place(&stylus(1.0)), &here));
            space.turn(0.7, &stylus(1.0));
            assert!(close(&space.place(&stylus(1.0)), &here));
            space.clutch(true, &stylus(1.0));
            assert!(close(&space.place(&stylus(7.0)), &here));
            // what is changed while it waits leaves it where it is, too
            space.set_scale(0.5, &stylus(7.0));
            space.clutch(true, &stylus(7.0));
            space.clutch(false, &stylus(4.0));
            assert!(close(&space.place(&stylus(4.0)), &here));
            // and the tool follows again, scaled
            let moved = Pose::new(
                stylus(4.0).rotation,
                stylus(4.0).translation + DVec3::X * 3.0,
            );
            let way = space.place(&moved).translation - here.translation;
            assert!((way.length() - 1.5).abs() < 1e-9, "{way}");
            space.clutch(false, &stylus(4.0));
            space.clutch(true, &stylus(4.0));
            space.clutch(false, &stylus(1.0));
            here = space.place(&stylus(1.0));
        }
        assert!((space.base_from_bone(space.bone_from_base(DVec3::X)) - DVec3::X).length() < 1e-12);
    }
}
