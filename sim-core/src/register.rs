//! Where the device sits in the patient: the registration between base frame and bone frame.

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
}
