//! The closed loop on a virtual clock: device, cable, servo, hand.

use super::device::{Device, Glitch};
use super::hand::{Hand, Pull};
use super::plant::Plant;
use super::setup::Spec;
use super::trace::{Record, Trace};
use super::wall::Wall;
use glam::DVec3;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Request, Sample, Servo, TickOutput};

/// Where a bench begins, base frame, mm: above the face, in front of the gate.
pub const START_MM: DVec3 = DVec3::new(0.0, 0.0, 10.0);
/// Time in which the ramp after the start has ended, s.
const RUN_IN_S: f64 = 1.1;
/// Period of the loop, µs.
const PERIOD_MICROS: u32 = 1000;

/// Samples that are missing: `length` ticks of every `every`, from tick `from` on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gaps {
    /// First tick without a sample.
    pub from: u64,
    /// From one gap's beginning to the next, ticks.
    pub every: u64,
    /// Ticks without a sample.
    pub length: u64,
}

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// Missing samples.
    pub gaps: Option<Gaps>,
    /// A broken sample.
    pub glitch: Option<Glitch>,
    /// A tick is shorter or longer by up to this, µs, evenly distributed.
    pub jitter_micros: u32,
    /// Every so many ticks one lasts so many µs: (ticks, µs).
    pub stall: Option<(u64, u32)>,
}

impl Faults {
    /// Whether a tick gets no sample.
    pub fn drops(&self, tick: u64) -> bool {
        self.gaps
            .is_some_and(|g| tick >= g.from && (tick - g.from) % g.every.max(1) < g.length)
    }

    fn period_micros(&self, tick: u64) -> u32 {
        if let Some((every, micros)) = self.stall
            && tick % every.max(1) == every / 2
        {
            return micros;
        }
        let width = u64::from(2 * self.jitter_micros + 1);
        let off = u32::try_from(scrambled(tick) % width).unwrap_or(0);
        PERIOD_MICROS - self.jitter_micros.min(PERIOD_MICROS) + off
    }
}

/// A number that looks random and depends on `n` alone (`SplitMix64`).
pub fn scrambled(n: u64) -> u64 {
    let mut z = n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// What went into a tick of the servo.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// The sample, where one came.
    pub sample: Option<Sample>,
    /// What was asked for.
    pub requests: Vec<Request>,
}

/// Who answers the samples.
#[derive(Debug, Clone)]
enum Control {
    Servo(Box<Servo>),
    Wall(Wall),
}

/// What a tick said.
struct Answer {
    torque: [i16; 3],
    force_in_base: DVec3,
    proxy_in_base: DVec3,
}

/// The closed loop.
#[derive(Debug, Clone)]
pub struct Bench {
    /// Mechanics.
    pub plant: Plant,
    /// Electronics and cable.
    pub device: Device,
    /// Who holds the stylus.
    pub hand: Hand,
    /// What the hand does.
    pub pull: Pull,
    /// Where the hand's target goes, mm, and how fast, mm/s.
    pub goal: Option<(DVec3, f64)>,
    /// What goes wrong.
    pub faults: Faults,
    /// For the next tick.
    pub requests: Vec<Request>,
    /// One record a tick.
    pub trace: Trace,
    /// The servo's last output.
    pub output: Option<TickOutput>,
    /// Every input so far, where it is kept for a replay.
    pub kept: Option<Vec<Input>>,
    control: Control,
    base_from_bone: Pose,
    ticks: u64,
}

impl Bench {
    /// A bench at [`START_MM`] with the servo that a specification describes.
    pub fn new(spec: &Spec) -> Self {
        Self::controlled(spec, Control::Servo(Box::new(spec.servo())))
    }

    /// The same with a linear wall instead of the servo: its stiffness is the coupling's.
    pub fn with_wall(spec: &Spec) -> Self {
        let wall = Wall {
            stiffness_n_per_mm: spec.feel.coupling.stiffness_n_per_mm,
            scale: spec.scale,
        };
        Self::controlled(spec, Control::Wall(wall))
    }

    fn controlled(spec: &Spec, control: Control) -> Self {
        Self {
            plant: Plant::new(spec.plant, START_MM).expect("in reach"),
            device: Device::new(spec.scale, spec.delay_ticks),
            hand: spec.hand,
            pull: Pull::at(START_MM),
            goal: None,
            faults: Faults::default(),
            requests: Vec::new(),
            trace: Trace::default(),
            output: None,
            kept: None,
            control,
            base_from_bone: spec.scene.bone_from_base.inverse(),
            ticks: 0,
        }
    }

    /// The servo.
    pub fn servo(&self) -> Option<&Servo> {
        match &self.control {
            Control::Servo(servo) => Some(servo),
            Control::Wall(_) => None,
        }
    }

    /// Ticks so far.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Waits in the air until the ramp after the start has ended. A wall has none.
    pub fn run_in(&mut self) {
        if self.servo().is_some() {
            self.rest(RUN_IN_S);
        }
    }

    /// Holds the device where it is, s.
    pub fn rest(&mut self, seconds: f64) {
        self.guide(DVec3::ZERO, ticks_of(seconds));
    }

    /// Moves the device in a straight line at `speed_mm_s`, whatever the forces.
    pub fn glide(&mut self, to_mm: DVec3, speed_mm_s: f64) {
        let way = to_mm - self.plant.position_mm;
        self.guide(way, ticks_of(way.length() / speed_mm_s));
    }

    fn guide(&mut self, way_mm: DVec3, ticks: u64) {
        let step = way_mm / ticks as f64;
        for _ in 0..ticks {
            self.step(Some(step));
        }
        self.pull = Pull::at(self.plant.position_mm);
    }

    /// Lets the forces move the device, s.
    pub fn run(&mut self, seconds: f64) {
        for _ in 0..ticks_of(seconds) {
            self.step(None);
        }
    }

    /// One tick in which the forces move the device.
    pub fn tick(&mut self) {
        self.step(None);
    }

    fn step(&mut self, guided: Option<DVec3>) {
        let jump = self.faults.glitch.filter(|g| g.tick == self.ticks);
        let sample = self
            .device
            .sample(&self.plant, jump.map_or(0.0, |g| g.jump_mm));
        let sample = (!self.faults.drops(self.ticks)).then_some(sample);
        if let Some(kept) = &mut self.kept {
            kept.push(Input {
                sample,
                requests: self.requests.clone(),
            });
        }
        let answer = self.answer(sample.as_ref());
        self.device.command(answer.torque);
        self.record(&answer);
        let micros = self.faults.period_micros(self.ticks);
        let whole = f64::from(micros) * 1e-6;
        let (plant, hand) = (&mut self.plant, self.hand);
        let (pull, goal) = (&mut self.pull, self.goal);
        self.device.pass(micros, |dt, torque| {
            if let Some(way) = guided {
                plant.carry(way * (dt / whole), dt, torque);
            } else {
                plant.step(dt, torque, &hand, pull);
                pursue(pull, goal, dt);
            }
        });
        self.ticks += 1;
    }

    fn answer(&mut self, sample: Option<&Sample>) -> Answer {
        match &mut self.control {
            Control::Servo(servo) => {
                let output = servo.tick(sample, &self.requests);
                self.requests.clear();
                self.output = Some(output);
                Answer {
                    torque: output.torque,
                    force_in_base: self.base_from_bone.vector(output.force_n),
                    proxy_in_base: self.base_from_bone.point(output.bone_from_tool.translation),
                }
            }
            Control::Wall(wall) => {
                let (force_in_base, torque) = match sample {
                    Some(sample) => wall.tick(sample),
                    None => (DVec3::ZERO, [0; 3]),
                };
                Answer {
                    torque,
                    force_in_base,
                    proxy_in_base: self.plant.position_mm.max(DVec3::NEG_INFINITY.with_z(0.0)),
                }
            }
        }
    }

    fn record(&mut self, answer: &Answer) {
        self.trace.records.push(Record {
            time_s: self.device.time_s(),
            position_mm: self.plant.position_mm,
            velocity_mm_s: self.plant.velocity_mm_s,
            force_n: self.plant.force_of(self.device.torque_nmm()),
            asked_n: answer.force_in_base,
            proxy_mm: answer.proxy_in_base,
            absorbed_mj: self.plant.absorbed_mj,
        });
    }
}

/// Moves the hand's target towards its goal.
fn pursue(pull: &mut Pull, goal: Option<(DVec3, f64)>, dt_s: f64) {
    let Some((goal, speed)) = goal else {
        return;
    };
    let way = goal - pull.target_mm;
    let left = way.length();
    if left <= speed * dt_s {
        pull.target_mm = goal;
        pull.target_mm_s = DVec3::ZERO;
    } else {
        pull.target_mm_s = way * (speed / left);
        pull.target_mm += pull.target_mm_s * dt_s;
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "at most some hours"
)]
fn ticks_of(seconds: f64) -> u64 {
    (seconds * 1000.0).round().max(1.0) as u64
}
