//! Rigid transforms, named `a_from_b`.

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform `a_from_b`: takes a point given in frame *b* to frame *a*.
///
/// Translation in millimetres. Composition reads from the left: `a_from_b.then(b_from_c)` is
/// `a_from_c`. Poses are absolute and never integrated, so rotations do not drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Unit quaternion.
    pub rotation: DQuat,
    /// Origin of *b* in *a*, mm.
    pub translation: DVec3,
}

impl Pose {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// From a unit quaternion and a translation in mm.
    pub const fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self {
            rotation,
            translation,
        }
    }

    /// The pose in *a* of a frame whose origin is `origin` and whose z axis is `z_axis` (any
    /// length; a zero vector gives the identity rotation). The turn about z is arbitrary but a
    /// function of `z_axis` alone.
    pub fn from_origin_and_z(origin: DVec3, z_axis: DVec3) -> Self {
        let z = z_axis.try_normalize().unwrap_or(DVec3::Z);
        let (x, y) = z.any_orthonormal_pair();
        Self::new(DQuat::from_mat3(&DMat3::from_cols(x, y, z)), origin)
    }

    /// A point from *b* to *a*, mm.
    pub fn point(&self, p_in_b: DVec3) -> DVec3 {
        self.rotation * p_in_b + self.translation
    }

    /// A direction (no translation) from *b* to *a*.
    pub fn vector(&self, v_in_b: DVec3) -> DVec3 {
        self.rotation * v_in_b
    }

    /// `a_from_c` for `self = a_from_b`.
    #[must_use]
    pub fn then(&self, b_from_c: &Self) -> Self {
        Self::new(
            self.rotation * b_from_c.rotation,
            self.point(b_from_c.translation),
        )
    }

    /// `b_from_a` for `self = a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self::new(rotation, -(rotation * self.translation))
    }

    /// True where every component is finite and the quaternion is of unit length within 1e-6.
    pub fn is_valid(&self) -> bool {
        self.translation.is_finite()
            && self.rotation.is_finite()
            && (self.rotation.length_squared() - 1.0).abs() < 1e-6
    }

    /// Translation interpolated linearly, rotation by slerp, `t` in [0, 1].
    #[must_use]
    pub fn interpolate(&self, to: &Self, t: f64) -> Self {
        Self::new(
            self.rotation.slerp(to.rotation, t),
            self.translation.lerp(to.translation, t),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn composition_and_inverse_undo_each_other() {
        let a_from_b = Pose::new(
            DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7),
            DVec3::new(1.0, -2.0, 3.0),
        );
        let p = DVec3::new(4.0, 5.0, 6.0);
        let back = a_from_b.inverse().then(&a_from_b).point(p);
        assert!((back - p).length() < 1e-12, "{back}");
    }

    #[test]
    fn z_axis_is_where_it_was_asked_for() {
        let z = DVec3::new(-3.0, 2.0, 0.5);
        let pose = Pose::from_origin_and_z(DVec3::ONE, z);
        assert!((pose.vector(DVec3::Z) - z / z.length()).length() < 1e-12);
        assert!(pose.is_valid());
    }
}
