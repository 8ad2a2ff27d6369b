//! The simulated arm: rigid links and motors in joint space, at 20 kHz.
//!
//! Structure of Çavuşoğlu, Feygin and Tendick (2002) for a parallelogram arm:
//! `M11 = a1 + a2 cos 2t2 + a3 cos 2t3 + a4 cos t2 sin t3`, `M22`, `M33` constant,
//! `M23 = −a4/2 sin(t2 − t3)`, Coriolis and centrifugal terms from Christoffel's symbols. The
//! constants follow from link masses chosen so that each of the two arm joints shows 45 g at the
//! stylus (8.0e-4 kg·m², the data sheet's apparent mass). Units inside: rad, kg, N·m, m, s.

use core::f64::consts::TAU;
use glam::{DMat3, DVec3};
use osteon_protocol::firmware::limits::{
    COUNTS_PER_REV, GIMBAL_COUNTS_PER_REV, MICRO_NM_PER_COUNT,
};
use osteon_sim_core::omni::{self, DOCK, JOINT_LIMITS, LINK_MM};

/// Integration steps in each millisecond.
pub const SUBSTEPS: u32 = 20;
/// One integration step, s.
pub const STEP_S: f64 = 1e-3 / SUBSTEPS as f64;

const LINK_M: f64 = LINK_MM * 1e-3;
const LINK2: f64 = LINK_M * LINK_M;
/// Upper arm and forearm as uniform rods, gimbal with stylus as a point, kg.
const UPPER_KG: f64 = 0.012;
const FORE_KG: f64 = 0.012;
const GIMBAL_KG: f64 = 0.015;
/// Turret with the waist's motor, kg·m².
const TURRET_KGM2: f64 = 4.0e-4;
/// What the links leave of 8.0e-4 kg·m² is the motor, capstan and parallelogram of that joint.
const JOINT_KGM2: f64 = 8.0e-4;
/// Actuator's first-order lag, s.
const LAG_S: f64 = 0.4e-3;
/// Joint stops: N·m/rad and N·m·s/rad.
const STOP_STIFFNESS: f64 = 10.0;
const STOP_DAMPING: f64 = 0.1;
/// Below this speed Coulomb friction is smoothed, rad/s (7 mm/s at one link's length).
const FRICTION_SPEED: f64 = 0.05;
/// Winding model: ambient °C, rise in K at the continuous torque (0.88 N at the stylus through each
/// joint's longest lever, N·m), time constant s.
const AMBIENT_C: f64 = 25.0;
const RISE_K: f64 = 40.0;
const CONTINUOUS_NM: [f64; 3] = [0.229, 0.117, 0.117];
const THERMAL_S: f64 = 120.0;

/// What may differ between two arms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmParameters {
    /// Coulomb friction of each joint, N·m. 0.013 = 0.1 N at the stylus: typical; the data sheet's
    /// 0.26 N (0.035 N·m) is the upper bound of back-drive friction.
    pub coulomb_nm: f64,
    /// Viscous friction of each joint, N·m·s/rad; 1.8e-3 = 0.1 N·s/m at the stylus.
    pub viscous_nms: f64,
    /// Weight at the stylus that the counterweight leaves over, N.
    pub weight_n: f64,
    /// Mass of the hand that holds the stylus, at the gimbal's centre, kg.
    pub grip_kg: f64,
}

impl Default for ArmParameters {
    fn default() -> Self {
        Self {
            coulomb_nm: 0.013,
            viscous_nms: 1.8e-3,
            weight_n: 0.04,
            grip_kg: 0.0,
        }
    }
}

/// Position and velocity of the gimbal's centre, base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// mm.
    pub position: DVec3,
    /// mm/s.
    pub velocity: DVec3,
}

/// Constants of the mass matrix, kg·m².
#[derive(Debug, Clone, Copy, PartialEq)]
struct Inertia {
    a1: f64,
    a2: f64,
    a3: f64,
    a4: f64,
    m22: f64,
    m33: f64,
}

impl Inertia {
    fn new(grip_kg: f64) -> Self {
        let end = GIMBAL_KG + grip_kg;
        let cos2_t2 = (UPPER_KG / 3.0 + FORE_KG + end) * LINK2;
        let sin2_t3 = (FORE_KG / 3.0 + end) * LINK2;
        Self {
            a1: TURRET_KGM2 + 0.5 * (cos2_t2 + sin2_t3),
            a2: 0.5 * cos2_t2,
            a3: -0.5 * sin2_t3,
            a4: (FORE_KG + 2.0 * end) * LINK2,
            m22: JOINT_KGM2 + grip_kg * LINK2,
            m33: JOINT_KGM2 + grip_kg * LINK2,
        }
    }

    fn m11(&self, t: DVec3) -> f64 {
        self.a1
            + self.a2 * libm::cos(2.0 * t.y)
            + self.a3 * libm::cos(2.0 * t.z)
            + self.a4 * libm::cos(t.y) * libm::sin(t.z)
    }

    fn m23(&self, t: DVec3) -> f64 {
        -0.5 * self.a4 * libm::sin(t.y - t.z)
    }

    /// The mass matrix.
    fn matrix(&self, t: DVec3) -> DMat3 {
        let m23 = self.m23(t);
        DMat3::from_cols(
            DVec3::new(self.m11(t), 0.0, 0.0),
            DVec3::new(0.0, self.m22, m23),
            DVec3::new(0.0, m23, self.m33),
        )
    }

    /// Coriolis and centrifugal torques, N·m.
    fn coriolis(&self, t: DVec3, v: DVec3) -> DVec3 {
        let (s2, c2) = (libm::sin(t.y), libm::cos(t.y));
        let (s3, c3) = (libm::sin(t.z), libm::cos(t.z));
        // Slopes of M11 along t2 and t3, and of M23 along t3 (along t2 it is the negative).
        let m11_2 = -4.0 * self.a2 * s2 * c2 - self.a4 * s2 * s3;
        let m11_3 = -4.0 * self.a3 * s3 * c3 + self.a4 * c2 * c3;
        let m23_3 = 0.5 * self.a4 * libm::cos(t.y - t.z);
        DVec3::new(
            (m11_2 * v.y + m11_3 * v.z) * v.x,
            m23_3 * v.z * v.z - 0.5 * m11_2 * v.x * v.x,
            -m23_3 * v.y * v.y - 0.5 * m11_3 * v.x * v.x,
        )
    }
}

/// The arm.
#[derive(Debug, Clone)]
pub struct Plant {
    parameters: ArmParameters,
    inertia: Inertia,
    joints: DVec3,
    speed: DVec3,
    // asked of the amplifiers, and what the lagging motors give, N·m
    wanted: DVec3,
    torque: DVec3,
    motors_on: bool,
    clamped: bool,
    power_up: [i32; 3],
    heat: DVec3,
    motor_work: f64,
}

/// Middle of encoder count zero: here the dock clamps the arm, so that the count read in the dock
/// is the same every time.
fn dock_pose() -> DVec3 {
    DOCK + DVec3::splat(0.5 * TAU / f64::from(COUNTS_PER_REV))
}

impl Plant {
    /// An arm clamped in its dock. Encoders read `power_up` there.
    pub fn new(parameters: ArmParameters, power_up: [i32; 3]) -> Self {
        Self {
            parameters,
            inertia: Inertia::new(parameters.grip_kg),
            joints: dock_pose(),
            speed: DVec3::ZERO,
            wanted: DVec3::ZERO,
            torque: DVec3::ZERO,
            motors_on: false,
            clamped: true,
            power_up,
            heat: DVec3::ZERO,
            motor_work: 0.0,
        }
    }

    /// The encoders lose their count and read `power_up` in the dock from here on.
    pub fn power_up(&mut self, power_up: [i32; 3]) {
        self.power_up = power_up;
    }

    /// Work that the motors have done on the arm since the start, J. Negative where they brake.
    pub fn motor_work(&self) -> f64 {
        self.motor_work
    }

    /// Lets the arm out of the dock.
    pub fn release(&mut self) {
        self.clamped = false;
    }

    /// What the drive asks: DAC counts, and whether the amplifiers are on. Off opens the bridges:
    /// no torque from that moment.
    pub fn set_drive(&mut self, dac: [i16; 3], motors_on: bool) {
        let nm = f64::from(MICRO_NM_PER_COUNT) * 1e-6;
        self.wanted = DVec3::from_array(dac.map(|n| f64::from(n) * nm));
        self.motors_on = motors_on;
        if !motors_on {
            self.torque = DVec3::ZERO;
        }
    }

    /// Motor angles, rad.
    pub fn joints(&self) -> DVec3 {
        self.joints
    }

    /// Torque of the motors at this moment, N·mm.
    pub fn torque_nmm(&self) -> DVec3 {
        self.torque * 1e3
    }

    /// Motion of the gimbal's centre.
    pub fn motion(&self) -> Motion {
        Motion {
            position: omni::forward(self.joints),
            velocity: omni::jacobian(self.joints) * self.speed,
        }
    }

    /// Joint encoders, counts: floored, as encoders count edges.
    #[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
    pub fn encoders(&self) -> [i32; 3] {
        let counts = (self.joints - DOCK) * (f64::from(COUNTS_PER_REV) / TAU);
        let counts = counts.to_array();
        core::array::from_fn(|j| (counts[j].floor() as i32).wrapping_add(self.power_up[j]))
    }

    /// Winding temperatures, °C.
    #[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
    pub fn temperature(&self) -> [i8; 3] {
        self.heat.to_array().map(|rise| (AMBIENT_C + rise) as i8)
    }

    /// Which joints touch their stop (the elbow's stop is on the bend).
    pub fn at_stop(&self) -> [bool; 3] {
        let travel = self.travel();
        core::array::from_fn(|j| !(JOINT_LIMITS[j][0]..=JOINT_LIMITS[j][1]).contains(&travel[j]))
    }

    // The angles that the stops limit.
    fn travel(&self) -> [f64; 3] {
        [self.joints.x, self.joints.y, self.joints.z - self.joints.y]
    }

    /// One integration step (semi-implicit Euler) of `dt_s` under `force_n`, an outer force at the
    /// gimbal's centre in the base frame.
    pub fn step(&mut self, dt_s: f64, force_n: DVec3) {
        self.move_motors(dt_s);
        if self.clamped {
            self.speed = DVec3::ZERO;
            return;
        }
        let outer = omni::torque_from_force(self.joints, force_n) * 1e-3;
        let net = self.torque + outer + self.stops()
            - self.friction()
            - self.weight()
            - self.inertia.coriolis(self.joints, self.speed);
        self.speed += self.accelerate(net) * dt_s;
        self.joints += self.speed * dt_s;
        self.motor_work += self.torque.dot(self.speed) * dt_s;
    }

    fn move_motors(&mut self, dt_s: f64) {
        if self.motors_on {
            self.torque += (self.wanted - self.torque) * (1.0 - libm::exp(-dt_s / LAG_S));
        }
        let load = self.torque / DVec3::from_array(CONTINUOUS_NM);
        self.heat += (load * load * RISE_K - self.heat) * (dt_s / THERMAL_S);
    }

    // M⁻¹ · torque; M is one number and a 2 × 2 block.
    fn accelerate(&self, torque: DVec3) -> DVec3 {
        let m = &self.inertia;
        let m23 = m.m23(self.joints);
        let det = m.m22 * m.m33 - m23 * m23;
        DVec3::new(
            torque.x / m.m11(self.joints),
            (m.m33 * torque.y - m23 * torque.z) / det,
            (m.m22 * torque.z - m23 * torque.y) / det,
        )
    }

    fn friction(&self) -> DVec3 {
        let coulomb = self
            .speed
            .to_array()
            .map(|v| libm::tanh(v / FRICTION_SPEED) * self.parameters.coulomb_nm);
        DVec3::from_array(coulomb) + self.speed * self.parameters.viscous_nms
    }

    fn weight(&self) -> DVec3 {
        let moment = self.parameters.weight_n * LINK_M;
        DVec3::new(
            0.0,
            moment * libm::cos(self.joints.y),
            moment * libm::sin(self.joints.z),
        )
    }

    fn stops(&self) -> DVec3 {
        let rates = [self.speed.x, self.speed.y, self.speed.z - self.speed.y];
        let travel = self.travel();
        let push: [f64; 3] = core::array::from_fn(|j| {
            let [lo, hi] = JOINT_LIMITS[j];
            let into = travel[j] - travel[j].clamp(lo, hi);
            let damping = if into == 0.0 { 0.0 } else { STOP_DAMPING };
            -STOP_STIFFNESS * into - damping * rates[j]
        });
        DVec3::new(push[0], push[1] - push[2], push[2])
    }

    /// Kinetic energy plus that of the remaining weight, J.
    pub fn energy(&self) -> f64 {
        let kinetic = 0.5
            * self
                .speed
                .dot(self.inertia.matrix(self.joints) * self.speed);
        let height = omni::forward(self.joints).y * 1e-3;
        kinetic + self.parameters.weight_n * height
    }

    /// Sets joint angles (rad) and speeds (rad/s) of a released arm.
    pub fn place(&mut self, joints: DVec3, speed: DVec3) {
        self.clamped = false;
        self.joints = joints;
        self.speed = speed;
    }
}

/// Counts of the absolute gimbal sensors for angles in (−π, π] rad.
#[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
pub fn gimbal_counts(angles: DVec3) -> [i16; 3] {
    let per_rad = f64::from(GIMBAL_COUNTS_PER_REV) / TAU;
    angles
        .to_array()
        .map(|angle| (angle * per_rad).floor() as i16)
}

#[cfg(test)]
mod tests;
