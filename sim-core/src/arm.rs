//! The arms that the servo knows, as data: what their counts mean, where they put the stylus, what
//! torque shows a force.
//!
//! Three coordinates `q` move the gimbal's centre, three more turn the stylus about it. Raw counts
//! become `q` through [`DeviceScale`] and the arm's own gears; the torque for a force is `Jᵀ F`, whatever
//! the coordinates are (N·mm for angles, N for lengths). Base frame as in [`crate::omni`]: x right, y up,
//! z to the user.

use crate::omni;
use crate::pose::Pose;
use crate::servo::DeviceScale;
use core::f64::consts::{FRAC_PI_2, TAU};
use glam::{DMat3, DVec3};

/// A kinematic model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Arm {
    /// Omni, Touch: [`crate::omni`]. Encoders sit at the joints and count from the dock.
    Omni,
    /// Phantom-class arm with other links, motors behind capstans, encoders at the motors.
    Phantom(&'static Phantom),
    /// A device that tells positions and takes forces itself: `q` is the gimbal's centre in mm, its
    /// "torques" are newtons; the gimbal's angles are those of [`omni::stylus`] with a forearm at rest.
    Cartesian,
}

/// A Phantom-class arm: waist, upper arm, forearm behind a parallelogram (as [`crate::omni`]), three
/// gimbal angles. The lists are in the order waist, shoulder, elbow; yaw, pitch, roll.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phantom {
    /// For people.
    pub name: &'static str,
    /// Where the numbers come from.
    pub source: &'static str,
    /// Length of the upper arm, mm.
    pub upper_mm: f64,
    /// Length of the forearm, mm.
    pub fore_mm: f64,
    /// Where the shoulder is in the base frame, mm. A choice of this program: the origin is put where the
    /// Omni's is, in the middle of the workspace.
    pub shoulder_mm: DVec3,
    /// Turns of the motor for one turn of the joint; negative where they turn against each other.
    pub gear: [f64; 3],
    /// Joint angles in the pose in which encoders are set to zero, rad.
    pub home: [f64; 3],
    /// Sense of the gimbal's encoders; 0 where the device has none.
    pub gimbal_sense: [f64; 3],
    /// Counts of a motor's encoder in one of its turns.
    pub counts_per_rev: u32,
    /// Counts of a gimbal encoder in one turn.
    pub gimbal_counts_per_rev: u16,
    /// Torque constant of the motors, N·mm/A.
    pub nmm_per_ampere: f64,
    /// Largest current, mA.
    pub most_milliamps: i16,
}

impl Phantom {
    /// What its numbers mean; commands are in mA.
    pub const fn scale(&'static self) -> DeviceScale {
        DeviceScale {
            arm: Arm::Phantom(self),
            counts_per_rev: self.counts_per_rev,
            gimbal_counts_per_rev: self.gimbal_counts_per_rev,
            dac_max: self.most_milliamps,
            nmm_per_count: self.nmm_per_ampere * 1e-3,
        }
    }
}

/// A Phantom of the nineties with an open controller in place of its electronics (hfab model 2).
pub const VINTAGE: Phantom = Phantom {
    name: "vintage Phantom with an open controller",
    source: "forsslund/hfabapi hfab_math.h (vintage), hfab_api.cpp (home counts 0, 7700, 0)",
    upper_mm: 138.0,
    fore_mm: 112.0,
    shoulder_mm: DVec3::new(0.0, 62.0, -138.0),
    // pulley over capstan, mm; the public code says that motors a and c turn with their bodies
    gear: [117.0 / 13.0, -77.0 / 10.0, -77.0 / 10.0],
    // 7700 counts of 4000 through 10/77: a quarter turn of body b, the upper arm is level
    home: [0.0, 0.0, 0.0],
    gimbal_sense: [-1.0, 1.0, -1.0],
    counts_per_rev: 4000,
    gimbal_counts_per_rev: 2000,
    nmm_per_ampere: 23.4,
    most_milliamps: 3000,
};

/// `WoodenHaptics` as of 2015 (hfab model 3); it has no gimbal encoders.
pub const WOODEN: Phantom = Phantom {
    name: "WoodenHaptics",
    source: "forsslund/hfabapi hfab_math.h (woodenhaptics_v2015), hfab_api.cpp (home counts 0, 0, -6000)",
    upper_mm: 205.0,
    fore_mm: 245.0,
    shoulder_mm: DVec3::new(0.0, -120.0, -245.0),
    gear: [-16.0, 12.0, -12.0],
    // upper arm upright, forearm level
    home: [0.0, FRAC_PI_2, FRAC_PI_2],
    gimbal_sense: [0.0; 3],
    counts_per_rev: 2000,
    gimbal_counts_per_rev: 2000,
    nmm_per_ampere: 25.9,
    most_milliamps: 6000,
};

impl Arm {
    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Omni => "Omni-class arm",
            Self::Phantom(phantom) => phantom.name,
            Self::Cartesian => "device with a library of its own",
        }
    }

    /// The arm of a [`Self::name`].
    pub fn of_name(name: &str) -> Option<Self> {
        let all = [
            Self::Omni,
            Self::Phantom(&VINTAGE),
            Self::Phantom(&WOODEN),
            Self::Cartesian,
        ];
        all.into_iter().find(|arm| arm.name() == name)
    }

    /// Coordinates at which a session begins, before a sample has come.
    pub fn rest(self) -> DVec3 {
        match self {
            Self::Omni => omni::DOCK,
            Self::Phantom(phantom) => DVec3::from_array(phantom.home),
            Self::Cartesian => omni::forward(omni::DOCK),
        }
    }

    /// Coordinates of raw encoder counts: rad, or mm. The middle of the count, as encoders floor. A scale
    /// of 0 counts is read as 1.
    pub fn coordinates(self, counts: [i32; 3], scale: &DeviceScale) -> DVec3 {
        let middle = DVec3::from_array(counts.map(|n| f64::from(n) + 0.5));
        let turn = f64::from(scale.counts_per_rev.max(1));
        match self {
            Self::Omni => omni::angles_from_counts(counts, scale.counts_per_rev),
            Self::Phantom(p) => {
                DVec3::from_array(p.home) + middle * (TAU / turn) / DVec3::from_array(p.gear)
            }
            Self::Cartesian => middle / turn,
        }
    }

    /// Gimbal angles (yaw, pitch, roll), rad, of raw counts.
    pub fn gimbal(self, counts: [i16; 3], scale: &DeviceScale) -> DVec3 {
        let angles = omni::gimbal_from_counts(counts, scale.gimbal_counts_per_rev);
        match self {
            Self::Phantom(p) => angles * DVec3::from_array(p.gimbal_sense),
            Self::Omni | Self::Cartesian => angles,
        }
    }

    /// `base_from_stylus` at coordinates `q` and gimbal angles (yaw, pitch, roll), rad.
    pub fn stylus(self, q: DVec3, gimbal: DVec3) -> Pose {
        let turned = match self {
            Self::Omni | Self::Phantom(_) => q,
            Self::Cartesian => DVec3::ZERO,
        };
        Pose::new(omni::stylus(turned, gimbal).rotation, self.forward(q))
    }

    /// The gimbal's centre in the base frame, mm.
    pub fn forward(self, q: DVec3) -> DVec3 {
        match self {
            Self::Omni => omni::forward(q),
            Self::Phantom(p) => {
                let (s, c) = sines(q);
                let r = p.upper_mm * c.y + p.fore_mm * s.z;
                let up = p.upper_mm * s.y - p.fore_mm * c.z;
                p.shoulder_mm + DVec3::new(-s.x * r, up, c.x * r)
            }
            Self::Cartesian => q,
        }
    }

    /// Derivative of [`Self::forward`], mm per unit of `q`; column *i* belongs to coordinate *i*.
    pub fn jacobian(self, q: DVec3) -> DMat3 {
        match self {
            Self::Omni => omni::jacobian(q),
            Self::Phantom(p) => {
                let (s, c) = sines(q);
                let r = p.upper_mm * c.y + p.fore_mm * s.z;
                DMat3::from_cols(
                    DVec3::new(-r * c.x, 0.0, -r * s.x),
                    DVec3::new(s.x * s.y, c.y, -c.x * s.y) * p.upper_mm,
                    DVec3::new(-s.x * c.z, s.z, c.x * c.z) * p.fore_mm,
                )
            }
            Self::Cartesian => DMat3::IDENTITY,
        }
    }

    /// Torques (N·mm, or N where coordinates are lengths) that show `force_n` (base frame) at the
    /// gimbal's centre: Jᵀ F.
    pub fn torque(self, q: DVec3, force_n: DVec3) -> DVec3 {
        match self {
            Self::Omni => omni::torque_from_force(q, force_n),
            Self::Phantom(_) => self.jacobian(q).transpose() * force_n,
            Self::Cartesian => force_n,
        }
    }

    /// Torque of one command count at the motors → at the coordinates: torque of the joint for each
    /// N·mm of its motor.
    pub fn gear(self) -> DVec3 {
        match self {
            Self::Phantom(p) => DVec3::from_array(p.gear),
            Self::Omni | Self::Cartesian => DVec3::ONE,
        }
    }
}

fn sines(q: DVec3) -> (DVec3, DVec3) {
    (
        DVec3::new(libm::sin(q.x), libm::sin(q.y), libm::sin(q.z)),
        DVec3::new(libm::cos(q.x), libm::cos(q.y), libm::cos(q.z)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An Omni written as a Phantom: the general formulas against the special ones.
    const AS_PHANTOM: Phantom = Phantom {
        upper_mm: omni::LINK_MM,
        fore_mm: omni::LINK_MM,
        shoulder_mm: DVec3::new(0.0, omni::SHOULDER_Y_MM, omni::WAIST_Z_MM),
        gear: [1.0; 3],
        home: [omni::DOCK.x, omni::DOCK.y, omni::DOCK.z],
        gimbal_sense: [1.0; 3],
        counts_per_rev: 15_000,
        gimbal_counts_per_rev: 16_384,
        ..WOODEN
    };

    fn poses() -> impl Iterator<Item = DVec3> {
        (0..500).map(|n| {
            let at = |k: f64| libm::sin(f64::from(n) * k);
            DVec3::new(at(0.7) * 0.9, 0.9 + at(1.1) * 0.8, 0.3 + at(1.7) * 0.8)
        })
    }

    #[test]
    fn equal_links_give_the_omni() {
        let (general, scale) = (Arm::Phantom(&AS_PHANTOM), AS_PHANTOM.scale());
        let omni_scale = DeviceScale {
            arm: Arm::Omni,
            ..scale
        };
        for q in poses() {
            let gimbal = q * 0.5;
            let (a, b) = (general.stylus(q, gimbal), Arm::Omni.stylus(q, gimbal));
            assert!((a.translation - b.translation).length() < 1e-9);
            assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-14);
            let force = DVec3::new(1.0, -2.0, 0.5);
            let gap = general.torque(q, force) - Arm::Omni.torque(q, force);
            assert!(gap.length() < 1e-9, "{gap}");
        }
        let counts = [1234, -77, 15_000];
        let gap = general.coordinates(counts, &scale) - Arm::Omni.coordinates(counts, &omni_scale);
        assert!(gap.length() < 1e-12, "{gap}");
    }

    #[test]
    fn torques_do_the_work_of_the_force_through_the_gears() {
        for (arm, scale) in [
            (Arm::Phantom(&VINTAGE), VINTAGE.scale()),
            (Arm::Phantom(&WOODEN), WOODEN.scale()),
        ] {
            for q in poses() {
                let force = DVec3::new(q.y, q.x, -1.0);
                let step = DVec3::new(1.0, -2.0, 3.0) * 1e-6;
                let work = force.dot(arm.forward(q + step) - arm.forward(q - step));
                let joints = arm.torque(q, force).dot(2.0 * step);
                assert!((work - joints).abs() < 1e-9, "{work} {joints}");
                // the same work at the motors: their turn is the joint's through the gear
                let motors = (arm.torque(q, force) / arm.gear()).dot(2.0 * step * arm.gear());
                assert!((work - motors).abs() < 1e-9, "{work} {motors}");
            }
            // one turn of the waist's motor turns the waist by 1/gear
            let turn = [i32::try_from(scale.counts_per_rev).unwrap_or(0), 0, 0];
            let way = arm.coordinates(turn, &scale) - arm.coordinates([0; 3], &scale);
            assert!((way.x * arm.gear().x - TAU).abs() < 1e-12, "{way}");
        }
    }

    /// Oracle: the position formula of the public hfab code, in its own frame (x to the user, y right,
    /// z up), its own angles and its own home counts.
    fn published(
        [capstan, body]: [[f64; 3]; 2],
        lengths: [f64; 2],
        cpr: f64,
        sense: [f64; 3],
        counts: [f64; 3],
    ) -> DVec3 {
        let angle = |n: usize| sense[n] * TAU * counts[n] / cpr * capstan[n] / body[n];
        let (a, b, c) = (angle(0), angle(1), angle(2));
        let r = lengths[0] * b.sin() + lengths[1] * c.sin();
        let up = lengths[0] * b.cos() - lengths[1] * c.cos();
        // into this program's frame
        DVec3::new(a.sin() * r, up, a.cos() * r)
    }

    #[test]
    fn positions_are_those_of_the_public_code() {
        for n in 0..200_i32 {
            let counts = [
                (n * 37) % 900 - 450,
                (n * 53) % 700 - 350,
                (n * 71) % 600 - 300,
            ];
            let middle = counts.map(|c| f64::from(c) + 0.5);
            let vintage = published(
                [[13.0, 10.0, 10.0], [117.0, 77.0, 77.0]],
                [138.0, 112.0],
                4000.0,
                [-1.0, 1.0, -1.0],
                [middle[0], middle[1] + 7700.0, middle[2]],
            );
            let wooden = published(
                [[10.0; 3], [160.0, 120.0, 120.0]],
                [205.0, 245.0],
                2000.0,
                [1.0, -1.0, -1.0],
                [middle[0], middle[1], middle[2] - 6000.0],
            );
            for (arm, truth) in [(&VINTAGE, vintage), (&WOODEN, wooden)] {
                let here = Arm::Phantom(arm);
                let q = here.coordinates(counts, &arm.scale());
                let gap = here.forward(q) - arm.shoulder_mm - truth;
                assert!(gap.length() < 1e-9, "{} {counts:?}: {gap}", arm.name);
            }
        }
    }

    #[test]
    fn a_cartesian_device_tells_and_takes_base_coordinates() {
        let scale = DeviceScale {
            arm: Arm::Cartesian,
            counts_per_rev: 1000,
            gimbal_counts_per_rev: 32_768,
            dac_max: 3300,
            nmm_per_count: 1e-3,
        };
        let q = scale.arm.coordinates([1000, -2000, 3500], &scale);
        assert!((q - DVec3::new(1.0005, -1.9995, 3.5005)).length() < 1e-12);
        assert_eq!(scale.arm.torque(q, DVec3::X), DVec3::X);
        let gimbal = scale.arm.gimbal([8192, 0, 0], &scale);
        let pose = scale.arm.stylus(q, gimbal);
        assert!((pose.vector(DVec3::Z) - DVec3::X).length() < 1e-3);
        assert_eq!(pose.translation, q);
    }
}
