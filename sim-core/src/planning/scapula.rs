//! The scapula's frame from three landmarks, and a direction's version and inclination in it.
//!
//! The transverse axis runs from the trigonum spinae (the medial end of the spine) to the glenoid's
//! centre: Friedman's axis in three dimensions (Friedman et al., J Bone Joint Surg Am 74:1032, 1992). The
//! scapular plane holds it and the inferior angle (Ganapathi et al. and Budge et al., J Shoulder Elbow
//! Surg 2011, use the same three points).

use crate::pose::Pose;
use glam::{DMat3, DQuat, DVec3};

/// Landmarks nearer to a line than this, mm, have no plane.
const COLLINEAR_MM: f64 = 5.0;
/// Landmarks nearer to each other than this, mm, have no direction.
const NEAREST_MM: f64 = 20.0;

/// Three landmarks of one scapula, LPS, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmarks {
    /// Middle of the joint face.
    pub glenoid_centre: DVec3,
    /// Medial end of the scapular spine.
    pub trigonum_spinae: DVec3,
    /// Lowest point of the blade.
    pub inferior_angle: DVec3,
}

/// Which shoulder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The patient's right.
    Right,
    /// The patient's left.
    Left,
}

/// Why landmarks make no frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LandmarkError {
    /// Two landmarks are almost one point: their distance, mm.
    Near(f64),
    /// The inferior angle lies almost on the axis of the other two: its distance from it, mm.
    Collinear(f64),
}

impl core::fmt::Display for LandmarkError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Near(mm) => write!(
                f,
                "two landmarks are {mm:.1} mm apart (at least {NEAREST_MM}); pick glenoid centre, trigonum spinae and inferior angle anew"
            ),
            Self::Collinear(mm) => write!(
                f,
                "the landmarks are collinear: the inferior angle lies {mm:.1} mm from the axis of the other two (at least {COLLINEAR_MM}); pick them anew"
            ),
        }
    }
}

impl core::error::Error for LandmarkError {}

/// The scapula's frame: x anterior, y superior, z lateral along Friedman's axis, origin at the glenoid's
/// centre. For a left scapula x is posterior in a right-handed frame, so anterior is kept apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scapula {
    /// Which shoulder.
    pub side: Side,
    /// The glenoid's centre, LPS, mm.
    pub origin: DVec3,
    /// Unit vectors in LPS.
    pub anterior: DVec3,
    /// In the scapular plane, at right angles to the axis.
    pub superior: DVec3,
    /// Along Friedman's axis, out of the joint.
    pub lateral: DVec3,
}

/// Version and inclination, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angles {
    /// Anteversion positive, retroversion negative.
    pub version_deg: f64,
    /// Superior positive.
    pub inclination_deg: f64,
}

impl Scapula {
    /// The frame of three landmarks.
    pub fn of(landmarks: &Landmarks) -> Result<Self, LandmarkError> {
        let centre = landmarks.glenoid_centre;
        let to_centre = centre - landmarks.trigonum_spinae;
        let up = landmarks.trigonum_spinae - landmarks.inferior_angle;
        let shortest = to_centre
            .length()
            .min(up.length())
            .min(centre.distance(landmarks.inferior_angle));
        let lateral = to_centre
            .try_normalize()
            .filter(|_| shortest >= NEAREST_MM)
            .ok_or(LandmarkError::Near(shortest))?;
        let upright = up.reject_from_normalized(lateral);
        let superior = upright
            .try_normalize()
            .filter(|_| upright.length() >= COLLINEAR_MM)
            .ok_or(LandmarkError::Collinear(upright.length()))?;
        // LPS: x grows to the patient's left
        let side = if lateral.x < 0.0 {
            Side::Right
        } else {
            Side::Left
        };
        let anterior = match side {
            Side::Right => superior.cross(lateral),
            Side::Left => lateral.cross(superior),
        };
        Ok(Self {
            side,
            origin: centre,
            anterior,
            superior,
            lateral,
        })
    }

    /// Version and inclination of an outward direction (LPS): the angles of its projections on the
    /// transverse and on the scapular plane with Friedman's axis.
    pub fn angles(&self, outward: DVec3) -> Angles {
        let along = outward.dot(self.lateral);
        let angle = |aside: f64| libm::atan2(aside, along).to_degrees();
        Angles {
            version_deg: angle(outward.dot(self.anterior)),
            inclination_deg: angle(outward.dot(self.superior)),
        }
    }

    /// The outward unit direction (LPS) with these angles, each within ± 80°.
    pub fn direction(&self, angles: Angles) -> DVec3 {
        let tangent = |deg: f64| libm::tan(deg.clamp(-80.0, 80.0).to_radians());
        let v = self.lateral
            + self.anterior * tangent(angles.version_deg)
            + self.superior * tangent(angles.inclination_deg);
        v.try_normalize().unwrap_or(self.lateral)
    }

    /// A frame at `origin` (LPS, mm) with z along `outward` and y as near to superior as can be, turned
    /// about z by `roll_deg` (superior towards x): the plan's frame.
    pub fn lps_from_plan(&self, origin: DVec3, outward: DVec3, roll_deg: f64) -> Pose {
        let z = outward.try_normalize().unwrap_or(self.lateral);
        let y = self
            .superior
            .reject_from_normalized(z)
            .try_normalize()
            .unwrap_or_else(|| z.any_orthonormal_vector());
        let upright = DQuat::from_mat3(&DMat3::from_cols(y.cross(z), y, z)).normalize();
        let roll = DQuat::from_rotation_z(-roll_deg.to_radians());
        Pose::new((upright * roll).normalize(), origin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A right scapula in the coronal plane.
    const RIGHT: Landmarks = Landmarks {
        glenoid_centre: DVec3::new(-160.0, 10.0, -50.0),
        trigonum_spinae: DVec3::new(-60.0, 10.0, -50.0),
        inferior_angle: DVec3::new(-70.0, 10.0, -150.0),
    };

    #[test]
    fn axes_and_signs_for_both_sides() {
        let right = Scapula::of(&RIGHT).expect("a frame");
        assert_eq!(right.side, Side::Right);
        assert!(right.lateral.distance(-DVec3::X) < 1e-12);
        assert!(
            right.anterior.distance(-DVec3::Y) < 1e-12,
            "LPS: y grows to the back"
        );
        let mirror = |p: DVec3| DVec3::new(-p.x, p.y, p.z);
        let left = Scapula::of(&Landmarks {
            glenoid_centre: mirror(RIGHT.glenoid_centre),
            trigonum_spinae: mirror(RIGHT.trigonum_spinae),
            inferior_angle: mirror(RIGHT.inferior_angle),
        })
        .expect("a frame");
        assert_eq!(left.side, Side::Left);
        let tilted = DVec3::new(-0.9, -0.3, 0.2);
        let (a, b) = (right.angles(tilted), left.angles(mirror(tilted)));
        assert!((a.version_deg - b.version_deg).abs() < 1e-12);
        assert!(
            a.version_deg > 0.0 && a.inclination_deg > 0.0,
            "forward and up are positive"
        );
        let by_hand = (0.3_f64 / 0.9).atan().to_degrees();
        assert!((a.version_deg - by_hand).abs() < 1e-9);
    }

    #[test]
    fn direction_and_angles_undo_each_other() {
        let frame = Scapula::of(&RIGHT).expect("a frame");
        for (version_deg, inclination_deg) in [(0.0, 0.0), (-12.0, 7.0), (25.0, -18.0)] {
            let angles = Angles {
                version_deg,
                inclination_deg,
            };
            let back = frame.angles(frame.direction(angles));
            assert!((back.version_deg - version_deg).abs() < 1e-9);
            assert!((back.inclination_deg - inclination_deg).abs() < 1e-9);
        }
        let pose = frame.lps_from_plan(DVec3::ONE, frame.lateral, 90.0);
        // turned by 90° the frame's y looks where its x did
        assert!(
            pose.vector(DVec3::Y)
                .distance(frame.superior.cross(frame.lateral))
                < 1e-12
        );
    }

    #[test]
    fn landmarks_on_a_line_or_in_one_place_are_refused() {
        let near = Landmarks {
            trigonum_spinae: RIGHT.glenoid_centre + DVec3::X,
            ..RIGHT
        };
        assert!(matches!(Scapula::of(&near), Err(LandmarkError::Near(d)) if d < 1.01));
        let line = Landmarks {
            inferior_angle: DVec3::new(40.0, 10.0, -51.0),
            ..RIGHT
        };
        let error = Scapula::of(&line).expect_err("collinear");
        assert!(error.to_string().contains("collinear"));
    }
}
