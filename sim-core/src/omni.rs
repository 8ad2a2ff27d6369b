//! Kinematics of an Omni-class arm: three actuated joints and a passive wrist.
//!
//! Base frame: x to the right, y up, z towards the user; mm. Joint angles are *motor* angles
//! `t = (waist, shoulder, elbow)` in rad: the elbow's motor sits in the base and turns the forearm
//! through a parallelogram, so `t.z` is the forearm's absolute angle and `t.z − t.y` the bend.
//!
//! ```text
//!   side view at t1 = 0            r = L1 cos t2 + L2 sin t3   (distance from the waist's axis)
//!        o elbow                   x = −r sin t1
//!   L1 ／  |                       y = L1 sin t2 − L2 cos t3 + 23.3
//!    ／t2  | L2                    z =  r cos t1 − 168.35
//!   o---   o gimbal centre         t3 = 0: the forearm hangs straight down
//! ```
//!
//! All trigonometry is `libm`'s: the same bits on every machine.

use crate::pose::Pose;
use core::f64::consts::{FRAC_PI_2, TAU};
use glam::{DMat3, DQuat, DVec3};

/// Length of the upper arm and of the forearm, mm.
pub const LINK_MM: f64 = 133.35;
/// Height of the shoulder in the base frame, mm.
pub const SHOULDER_Y_MM: f64 = 23.3;
/// The waist's axis in the base frame: z, mm (behind the origin).
pub const WAIST_Z_MM: f64 = -168.35;
/// Motor angles while the stylus is in its dock, rad; encoders count from here.
pub const DOCK: DVec3 = DVec3::new(0.0, 0.23, -0.37);
/// Joint stops, rad: waist `t.x`, shoulder `t.y`, and the *bend* of the elbow `t.z − t.y`.
pub const JOINT_LIMITS: [[f64; 2]; 3] = [[-0.98, 0.98], [0.0, 1.75], [-0.81, 1.25]];

/// Sine and cosine of one angle, from `libm`.
fn sin_cos(angle: f64) -> (f64, f64) {
    (libm::sin(angle), libm::cos(angle))
}

/// The gimbal's centre in the base frame, mm, for motor angles `t` (rad, any value).
pub fn forward(t: DVec3) -> DVec3 {
    let (s1, c1) = sin_cos(t.x);
    let (s2, c2) = sin_cos(t.y);
    let (s3, c3) = sin_cos(t.z);
    let r = LINK_MM * (c2 + s3);
    DVec3::new(
        -s1 * r,
        LINK_MM * (s2 - c3) + SHOULDER_Y_MM,
        c1 * r + WAIST_Z_MM,
    )
}

/// Derivative of [`forward`] in mm/rad; column *i* belongs to joint *i*. Singular where the bend is
/// ±90° (beyond the stops) and where the gimbal is on the waist's axis (arm folded back and up).
pub fn jacobian(t: DVec3) -> DMat3 {
    let (s1, c1) = sin_cos(t.x);
    let (s2, c2) = sin_cos(t.y);
    let (s3, c3) = sin_cos(t.z);
    let r = c2 + s3;
    let waist = DVec3::new(-r * c1, 0.0, -r * s1);
    let shoulder = DVec3::new(s1 * s2, c2, -c1 * s2);
    let elbow = DVec3::new(-s1 * c3, s3, c1 * c3);
    DMat3::from_cols(waist * LINK_MM, shoulder * LINK_MM, elbow * LINK_MM)
}

/// Joint torques in N·mm that show `force_n` (N, base frame) at the gimbal's centre: Jᵀ F.
pub fn torque_from_force(t: DVec3, force_n: DVec3) -> DVec3 {
    jacobian(t).transpose() * force_n
}

/// True where every joint is between its stops.
pub fn within_limits(t: DVec3) -> bool {
    let inside = |value: f64, [lo, hi]: [f64; 2]| (lo..=hi).contains(&value);
    inside(t.x, JOINT_LIMITS[0])
        && inside(t.y, JOINT_LIMITS[1])
        && inside(t.z - t.y, JOINT_LIMITS[2])
}

/// Motor angles that put the gimbal's centre at `p_mm` (base frame), in front of the waist's axis.
/// `None` where `p_mm` is out of reach, outside the stops or not finite. The bend's range lies on
/// one side of the stretched arm, so there is at most one answer.
pub fn inverse(p_mm: DVec3) -> Option<DVec3> {
    let (forth, up) = (p_mm.z - WAIST_Z_MM, p_mm.y - SHOULDER_Y_MM);
    let r = libm::hypot(p_mm.x, forth);
    let reach = libm::hypot(r, up) / (2.0 * LINK_MM);
    // Equal links: the elbow is above the chord, each link at ± `half` from it.
    if !(reach > 0.0 && reach <= 1.0) {
        return None;
    }
    let half = libm::acos(reach);
    let chord = libm::atan2(up, r);
    let t = DVec3::new(
        libm::atan2(-p_mm.x, forth),
        chord + half,
        chord - half + FRAC_PI_2,
    );
    within_limits(t).then_some(t)
}

/// Rotation of the forearm: y points from the gimbal's centre back to the elbow.
fn base_from_forearm(t: DVec3) -> DQuat {
    axis_turn(DVec3::Y, -t.x) * axis_turn(DVec3::X, -t.z)
}

/// A turn by `angle` rad about a unit axis, by `libm`.
fn axis_turn(axis: DVec3, angle: f64) -> DQuat {
    let (s, c) = sin_cos(0.5 * angle);
    let v = axis * s;
    DQuat::from_xyzw(v.x, v.y, v.z, c)
}

/// `base_from_stylus` for motor angles `t` and gimbal angles `gimbal = (yaw, pitch, roll)`, rad.
///
/// Stylus frame: origin at the gimbal's centre, z along the stylus from its tip to its rear end (so
/// it is the tool frame's z). `R = Ry(−t1)·Rx(−t3)·Ry(yaw)·Rx(pitch)·Rz(roll)`: yaw turns about
/// the forearm, pitch lifts (negative) or lowers the rear end, roll is about the stylus. All zero:
/// forearm down, rear end towards the user.
pub fn stylus(t: DVec3, gimbal: DVec3) -> Pose {
    let wrist = axis_turn(DVec3::Y, gimbal.x)
        * axis_turn(DVec3::X, gimbal.y)
        * axis_turn(DVec3::Z, gimbal.z);
    Pose::new(base_from_forearm(t) * wrist, forward(t))
}

/// Gimbal angles (yaw, pitch, roll) that give the stylus this rotation: yaw and roll in (−π, π],
/// pitch in [−π/2, π/2]. Where the stylus lies along the forearm (gimbal lock) roll is zero. `None`
/// for a quaternion that is not finite or not of unit length within 1e-6. The mechanical range of a
/// real wrist is not enforced.
pub fn gimbal_for(t: DVec3, base_from_stylus: DQuat) -> Option<DVec3> {
    if !(t.is_finite() && (base_from_stylus.length_squared() - 1.0).abs() < 1e-6) {
        return None;
    }
    let wrist = DMat3::from_quat(base_from_forearm(t).conjugate() * base_from_stylus);
    let (x, y, z) = (wrist.x_axis, wrist.y_axis, wrist.z_axis);
    let flat = libm::hypot(z.x, z.z);
    let pitch = libm::atan2(-z.y, flat);
    Some(if flat > 1e-9 {
        DVec3::new(libm::atan2(z.x, z.z), pitch, libm::atan2(x.y, y.y))
    } else {
        DVec3::new(libm::atan2(-x.z, x.x), pitch, 0.0)
    })
}

/// Motor angles, rad, of encoder counts since homing in the dock. Encoders floor, so the middle of
/// the count is the best estimate. `counts_per_rev` of 0 is read as 1.
pub fn angles_from_counts(counts: [i32; 3], counts_per_rev: u32) -> DVec3 {
    let rad = TAU / f64::from(counts_per_rev.max(1));
    DOCK + DVec3::from_array(counts.map(|n| (f64::from(n) + 0.5) * rad))
}

/// Gimbal angles (yaw, pitch, roll), rad, in [−π, π], of the absolute gimbal sensors' counts; the middle of
/// the count, as in [`angles_from_counts`]. Counts that are a whole turn apart give the same angle bit for
/// bit.
pub fn gimbal_from_counts(counts: [i16; 3], counts_per_rev: u16) -> DVec3 {
    let turn = i32::from(counts_per_rev.max(1));
    let rad = TAU / f64::from(turn);
    DVec3::from_array(counts.map(|n| {
        let within = (i32::from(n) + turn / 2).rem_euclid(turn) - turn / 2;
        (f64::from(within) + 0.5) * rad
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A seeded generator of uniform numbers in [0, 1) (`SplitMix64`).
    struct Uniform(u64);

    impl Uniform {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        }

        fn within(&mut self, [lo, hi]: [f64; 2]) -> f64 {
            lo + (hi - lo) * self.next()
        }

        fn joints(&mut self) -> DVec3 {
            let [waist, shoulder, bend] = JOINT_LIMITS.map(|limit| self.within(limit));
            DVec3::new(waist, shoulder, shoulder + bend)
        }
    }

    #[test]
    fn the_dock_is_where_the_data_say() {
        let p = forward(DOCK);
        assert!((p - DVec3::new(0.0, -70.6, -86.7)).length() < 0.1, "{p}");
        assert!(within_limits(DOCK));
    }

    #[test]
    fn a_right_angled_arm_is_read_off_the_drawing() {
        // Upper arm level towards the user, forearm hanging: no trigonometry needed.
        let p = forward(DVec3::ZERO);
        assert_eq!(p, DVec3::new(0.0, 23.3 - 133.35, 133.35 - 168.35));
    }

    #[test]
    fn the_jacobian_is_the_slope_of_forward() {
        let mut random = Uniform(2);
        for _ in 0..2000 {
            let t = random.joints();
            let analytic = jacobian(t);
            for joint in 0..3 {
                let mut step = DVec3::ZERO;
                step[joint] = 1e-5;
                let slope = (forward(t + step) - forward(t - step)) / 2e-5;
                let gap = (slope - analytic.col(joint)).length();
                assert!(gap < 1e-6, "joint {joint} at {t}: {gap}");
            }
        }
    }

    #[test]
    fn torque_does_the_work_of_the_force() {
        let mut random = Uniform(3);
        for _ in 0..200 {
            let t = random.joints();
            let force = DVec3::new(random.next(), random.next(), random.next()) * 3.0;
            let step = DVec3::new(random.next(), random.next(), random.next()) * 1e-6;
            let work = force.dot(forward(t + step) - forward(t - step));
            let joint_work = torque_from_force(t, force).dot(2.0 * step);
            assert!((work - joint_work).abs() < 1e-9, "{work} {joint_work}");
        }
    }

    #[test]
    fn inverse_undoes_forward_in_the_whole_workspace() {
        let mut random = Uniform(4);
        let mut seen = 0;
        for _ in 0..5000 {
            let t = random.joints();
            // Behind the waist's axis the waist would have to turn by more than its stops.
            if libm::cos(t.y) + libm::sin(t.z) < 1e-3 {
                continue;
            }
            seen += 1;
            let p = forward(t);
            let back = inverse(p).unwrap_or(DVec3::NAN);
            assert!((back - t).length() < 1e-9, "{t} -> {p} -> {back}");
        }
        assert!(seen > 4500, "{seen}");
    }

    #[test]
    fn out_of_reach_is_refused() {
        for p in [
            DVec3::new(0.0, 0.0, 200.0),
            DVec3::new(0.0, SHOULDER_Y_MM, WAIST_Z_MM),
            DVec3::new(0.0, SHOULDER_Y_MM, WAIST_Z_MM + 40.0),
            DVec3::new(160.0, 0.0, -100.0),
            DVec3::NAN,
            DVec3::INFINITY,
        ] {
            assert_eq!(inverse(p), None, "{p}");
        }
    }

    #[test]
    fn gimbal_angles_give_the_rotation_back() {
        let mut random = Uniform(5);
        for round in 0..2000 {
            let t = random.joints();
            let mut angle = || random.within([-3.1, 3.1]);
            let mut gimbal = DVec3::new(angle(), angle() / 2.0, angle());
            if round % 10 == 0 {
                gimbal.y = FRAC_PI_2;
            }
            let pose = stylus(t, gimbal);
            let found = gimbal_for(t, pose.rotation).unwrap_or(DVec3::NAN);
            let again = stylus(t, found).rotation;
            assert!(again.dot(pose.rotation).abs() > 1.0 - 1e-12, "{gimbal}");
            if round % 10 != 0 {
                assert!((found - gimbal).length() < 1e-6, "{gimbal} {found}");
            }
        }
        assert_eq!(gimbal_for(DOCK, DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0)), None);
    }

    #[test]
    fn gimbal_axes_lie_where_they_are_documented() {
        // Yaw leaves the forearm's direction alone, and pitch −90° points the rear end up at it.
        let t = DVec3::new(0.4, 0.3, 0.2);
        let up_the_forearm = forward(t) - DVec3::new(0.0, SHOULDER_Y_MM, WAIST_Z_MM);
        let (s1, c1) = sin_cos(t.x);
        let (s2, c2) = sin_cos(t.y);
        let elbow = DVec3::new(-s1 * c2, s2, c1 * c2) * LINK_MM;
        let along = (elbow - up_the_forearm) / LINK_MM;
        let rear = stylus(t, DVec3::new(0.7, -FRAC_PI_2, 0.3)).vector(DVec3::Z);
        assert!((rear - along).length() < 1e-12, "{rear} {along}");
        let rest = stylus(DVec3::ZERO, DVec3::ZERO).vector(DVec3::Z);
        assert_eq!(rest, DVec3::Z);
    }

    #[test]
    fn counts_are_read_at_their_middle() {
        let t = angles_from_counts([0, 15_000, -1], 15_000);
        let half = TAU / 30_000.0;
        let expected = DOCK + DVec3::new(half, TAU + half, -half);
        assert!((t - expected).length() < 1e-12, "{t}");
        let g = gimbal_from_counts([0, 4096, -4097], 16_384);
        assert!((g.y - g.x - FRAC_PI_2).abs() < 1e-12);
        assert!((g.z + g.y).abs() < 1e-12);
    }
}
