//! The simulated hand: a mass, spring and damper that follow a stroke like a person who watches.
//!
//! The hand's spring ends in a *target* that runs along the straight line to the segment's goal.
//! The target never leads the true stylus by more than the push allows, slows down as the *stylus*
//! nears the goal, and goes beyond the goal while a reaction holds the stylus short of it. So
//! the force grows like a person's who wants to get there, and is bounded. The hand's mass is part
//! of the arm ([`super::plant::ArmParameters::grip_kg`]).

use super::plant::Motion;
use super::stroke::{Segment, Stroke};
use glam::{DQuat, DVec3};
use osteon_protocol::device::switch;
use osteon_sim_core::omni;

/// How the stylus is held. Its mass, spring and damper are those of [`Hold::mass_kg`],
/// [`Hold::stiffness_n_per_mm`] and [`Hold::damping_ns_per_mm`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Hold {
    /// Nobody: a soft thread draws the bare stylus, without a hand's mass and damping
    None,
    /// Two fingers
    Light,
    /// A firm grip
    #[default]
    Grip,
}

impl Hold {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::None, Self::Light, Self::Grip];

    /// Mass of the hand at the stylus, kg.
    pub const fn mass_kg(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Light => 0.02,
            Self::Grip => 0.1,
        }
    }

    /// Spring of the hand, N/mm: 30, 50 and 400 N/m.
    pub const fn stiffness_n_per_mm(self) -> f64 {
        match self {
            Self::None => 0.03,
            Self::Light => 0.05,
            Self::Grip => 0.4,
        }
    }

    /// Damper of the hand, N·s/mm: 0.2, 0.5 and 4 N·s/m. The thread's is what keeps a bare stylus from
    /// swinging for seconds.
    pub const fn damping_ns_per_mm(self) -> f64 {
        match self {
            Self::None => 0.0002,
            Self::Light => 0.0005,
            Self::Grip => 0.004,
        }
    }
}

/// The stylus has arrived when it is this near to the goal along the line, mm.
pub const ARRIVED_MM: f64 = 0.05;

/// How the hand speeds up and slows down, mm/s².
const ACCELERATION: f64 = 200.0;
/// Slowest approach, mm/s: the last hundredths end in finite time.
const CREEP: f64 = 0.3;
/// Fastest turn of the stylus, rad/s, and the time in which the last of a turn decays, s.
const TURN_RATE: f64 = 1.5;
const TURN_TAU_S: f64 = 0.05;
/// The stylus has turned when this near to the commanded axis, rad.
const TURNED_RAD: f64 = 0.005;
/// A button is down, then up, for these times, s.
const PRESS_S: f64 = 0.080;
const RELEASE_S: f64 = 0.120;

/// What the hand is at.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// In the dock, waiting for the drive.
    Docked,
    /// On the way.
    Moving,
    /// Arrived: button, then dwell.
    Arrived,
    /// Nothing left to do.
    Done,
}

/// The hand.
#[derive(Debug, Clone)]
pub struct Hand {
    segments: Vec<Segment>,
    hold: Hold,
    index: usize,
    phase: Phase,
    // since the phase began, s; does not run while the drive is not engaged and the hand moves
    elapsed_s: f64,
    start: DVec3,
    direction: DVec3,
    length: f64,
    along: f64,
    speed: f64,
    target: DVec3,
    target_velocity: DVec3,
    rotation: DQuat,
    engaged: bool,
    timeouts: u32,
}

impl Hand {
    /// A firm hand at rest in the dock; without segments it stays there.
    pub fn new(stroke: Stroke) -> Self {
        Self::holding(stroke, Hold::default())
    }

    /// As [`Self::new`], with a hand of this kind.
    pub fn holding(stroke: Stroke, hold: Hold) -> Self {
        let dock = omni::stylus(omni::DOCK, DVec3::ZERO);
        Self {
            segments: stroke.segments,
            hold,
            index: 0,
            phase: Phase::Docked,
            elapsed_s: 0.0,
            start: dock.translation,
            direction: DVec3::ZERO,
            length: 0.0,
            along: 0.0,
            speed: 0.0,
            target: dock.translation,
            target_velocity: DVec3::ZERO,
            rotation: dock.rotation,
            engaged: false,
            timeouts: 0,
        }
    }

    /// True until the hand takes the stylus out of its dock.
    pub fn docked(&self) -> bool {
        self.phase == Phase::Docked
    }

    /// True after the last segment.
    pub fn done(&self) -> bool {
        self.phase == Phase::Done
    }

    /// Index of the segment under way; −1 in the dock, the number of segments at the end.
    pub fn segment(&self) -> i32 {
        match self.phase {
            Phase::Docked => -1,
            _ => i32::try_from(self.index).unwrap_or(i32::MAX),
        }
    }

    /// Segments given up by their timeout.
    pub fn timeouts(&self) -> u32 {
        self.timeouts
    }

    /// `base_from_stylus` rotation.
    pub fn rotation(&self) -> DQuat {
        self.rotation
    }

    /// Pressed buttons, [`switch`] bits.
    pub fn buttons(&self) -> u8 {
        let press = self.segments.get(self.index).and_then(|s| s.press);
        match (self.phase, press) {
            (Phase::Arrived, Some(1)) if self.elapsed_s < PRESS_S => switch::BUTTON_1,
            (Phase::Arrived, Some(2)) if self.elapsed_s < PRESS_S => switch::BUTTON_2,
            _ => 0,
        }
    }

    /// Force of the hand on the stylus, N, base frame. Zero in the dock, which bears the stylus.
    pub fn force(&self, motion: &Motion) -> DVec3 {
        if self.docked() {
            return DVec3::ZERO;
        }
        (self.target - motion.position) * self.hold.stiffness_n_per_mm()
            + (self.target_velocity - motion.velocity) * self.hold.damping_ns_per_mm()
    }

    /// Plans the next `dt_s`. `engaged`: the drive lets torque flow. Without it the hand stops
    /// pushing and waits where the stylus is; with it, it takes up its segment again.
    pub fn plan(&mut self, dt_s: f64, motion: &Motion, engaged: bool) {
        let resumes = engaged && !self.engaged;
        let pauses = !engaged && self.engaged;
        self.engaged = engaged;
        if pauses {
            self.rest(motion.position);
        }
        match self.phase {
            Phase::Docked if engaged && !self.segments.is_empty() => self.begin_segment(),
            Phase::Moving if resumes => self.begin_line(),
            Phase::Moving if engaged => self.advance(dt_s, motion),
            // A press or dwell runs to its end: a button must not bounce with the drive.
            Phase::Arrived => self.dwell(dt_s),
            _ => {}
        }
    }

    fn begin_segment(&mut self) {
        self.elapsed_s = 0.0;
        self.phase = Phase::Moving;
        self.begin_line();
    }

    // The line starts at the target, not at the stylus: the force has no step there.
    fn begin_line(&mut self) {
        let way = self.segments[self.index].goal() - self.target;
        self.start = self.target;
        self.length = way.length();
        self.direction = way.try_normalize().unwrap_or(DVec3::ZERO);
        self.along = 0.0;
        self.speed = 0.0;
    }

    fn rest(&mut self, at: DVec3) {
        self.target = at;
        self.target_velocity = DVec3::ZERO;
        self.speed = 0.0;
    }

    fn advance(&mut self, dt_s: f64, motion: &Motion) {
        self.elapsed_s += dt_s;
        let turned = self.turn(dt_s);
        let segment = &self.segments[self.index];
        let stylus = (motion.position - self.start).dot(self.direction);
        let left = self.length - stylus;
        let late = self.elapsed_s >= segment.timeout_s;
        if late || (left <= ARRIVED_MM && turned) {
            self.timeouts += u32::from(late);
            self.arrive();
            return;
        }
        let braking = (2.0 * ACCELERATION * left.max(0.0)).sqrt() + CREEP;
        let wish = if left <= ARRIVED_MM { 0.0 } else { braking };
        self.speed = (self.speed + ACCELERATION * dt_s)
            .min(segment.speed_mm_s)
            .min(wish);
        let leash = stylus + segment.max_push_n / self.hold.stiffness_n_per_mm();
        let ahead = self.along + self.speed * dt_s;
        // At the leash's end the damper works against the stylus's own speed: push, less damping.
        let pace = if ahead > leash { 0.0 } else { self.speed };
        self.along = ahead.min(leash);
        self.target = self.start + self.direction * self.along;
        self.target_velocity = self.direction * pace;
    }

    // Turns the stylus towards the segment's axis; true when there.
    fn turn(&mut self, dt_s: f64) -> bool {
        let axis = DVec3::from_array(self.segments[self.index].axis);
        let Some(wanted) = axis.try_normalize() else {
            return true;
        };
        // The shortest arc adds no turn about the stylus, so that roll stays continuous.
        let arc = DQuat::from_rotation_arc(self.rotation * DVec3::Z, wanted);
        let gap = 2.0 * libm::atan2(arc.xyz().length(), arc.w.abs());
        if gap > 1e-9 {
            let step = (TURN_RATE * dt_s).min(gap * dt_s / TURN_TAU_S);
            let part = DQuat::IDENTITY.slerp(arc, step / gap);
            self.rotation = (part * self.rotation).normalize();
        }
        gap < TURNED_RAD
    }

    fn arrive(&mut self) {
        self.phase = Phase::Arrived;
        self.elapsed_s = 0.0;
        self.target_velocity = DVec3::ZERO;
        self.speed = 0.0;
    }

    fn dwell(&mut self, dt_s: f64) {
        self.elapsed_s += dt_s;
        let segment = &self.segments[self.index];
        let press = segment.press.map_or(0.0, |_| PRESS_S + RELEASE_S);
        if self.elapsed_s < press + segment.dwell_s {
            return;
        }
        self.index += 1;
        if self.index < self.segments.len() {
            self.begin_segment();
        } else {
            self.phase = Phase::Done;
        }
    }
}

#[cfg(test)]
mod tests;
