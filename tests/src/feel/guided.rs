//! A servo whose device is where it is told to be: no mechanics, no hand, no delay.

use super::setup::Spec;
use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::omni;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Request, Sample, Servo, TickOutput};

/// A guided servo. Places are in the base frame.
#[derive(Debug)]
pub struct Guided {
    /// The servo.
    pub servo: Servo,
    /// The last output.
    pub output: TickOutput,
    /// Where the device is, mm.
    pub place_mm: DVec3,
    /// How it is turned.
    pub rotation: DQuat,
    /// Work of the hand so far, mJ at the stylus.
    pub hand_mj: f64,
    /// Work of the spindle so far, mJ at a real tool.
    pub spindle_mj: f64,
    /// The least work of the hand in a tick, mJ.
    pub least_hand_mj: f64,
    /// Most iterations in a tick.
    pub iterations: u32,
    /// Worst residual, N.
    pub residual_n: f64,
    spec: Spec,
    base_from_bone: Pose,
    micros: f64,
    // how far the proxy went along the push in the last tick, mm
    advance_mm: f64,
}

impl Guided {
    /// A servo that has run in with its device at `place_mm`, in the air; the spindle is on or off.
    pub fn new(spec: &Spec, place_mm: DVec3, spindle: bool) -> Self {
        let mut servo = spec.servo();
        let output = servo.tick(None, &[]);
        let mut guided = Self {
            servo,
            output,
            place_mm,
            rotation: DQuat::IDENTITY,
            hand_mj: 0.0,
            spindle_mj: 0.0,
            least_hand_mj: 0.0,
            iterations: 0,
            residual_n: 0.0,
            base_from_bone: spec.scene.bone_from_base.inverse(),
            spec: spec.clone(),
            micros: 0.0,
            advance_mm: 0.0,
        };
        guided.ask(&[Request::Spindle(spindle)]);
        guided.rest(1.1);
        guided
    }

    fn sample(&mut self) -> Sample {
        self.micros += 1e6 * self.spec.feel.tick_s;
        let scale = self.spec.scale;
        let joints = omni::inverse(self.place_mm).expect("in reach");
        let gimbal = omni::gimbal_for(joints, self.rotation).unwrap_or(DVec3::ZERO);
        let per_rad = f64::from(scale.counts_per_rev) / TAU;
        let gimbal_per_rad = f64::from(scale.gimbal_counts_per_rev) / TAU;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the casts saturate"
        )]
        Sample {
            time_micros: (self.micros.round() as u64 & 0xffff_ffff) as u32,
            encoders: ((joints - omni::DOCK) * per_rad)
                .to_array()
                .map(|v| v.round() as i32),
            gimbal: (gimbal * gimbal_per_rad)
                .to_array()
                .map(|v| v.round() as i16),
            buttons: 0,
            drive_active: true,
            docked: false,
            applied: [0; 3],
            ack_age: 0,
        }
    }

    /// One tick.
    pub fn ask(&mut self, requests: &[Request]) {
        let sample = self.sample();
        let output = self.servo.tick(Some(&sample), requests);
        self.hand_mj += output.hand_mj;
        self.spindle_mj += output.spindle_mj;
        self.least_hand_mj = self.least_hand_mj.min(output.hand_mj);
        self.iterations = self.iterations.max(output.iterations);
        self.residual_n = self.residual_n.max(output.residual_n);
        self.output = output;
    }

    /// One tick with the device elsewhere.
    pub fn tick_at(&mut self, place_mm: DVec3) {
        self.place_mm = place_mm;
        self.ask(&[]);
    }

    fn ticks(&self, seconds: f64) -> u32 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "some minutes"
        )]
        let ticks = (seconds / self.spec.feel.tick_s).round().max(1.0) as u32;
        ticks
    }

    /// Stays.
    pub fn rest(&mut self, seconds: f64) {
        for _ in 0..self.ticks(seconds) {
            self.ask(&[]);
        }
    }

    /// In a straight line at a speed, mm/s; `each` sees every tick.
    pub fn glide_seen(&mut self, to_mm: DVec3, speed_mm_s: f64, mut each: impl FnMut(&Self)) {
        let from = self.place_mm;
        let ticks = self.ticks(from.distance(to_mm) / speed_mm_s);
        for n in 1..=ticks {
            self.tick_at(from.lerp(to_mm, f64::from(n) / f64::from(ticks)));
            each(self);
        }
    }

    /// In a straight line at a speed, mm/s.
    pub fn glide(&mut self, to_mm: DVec3, speed_mm_s: f64) {
        self.glide_seen(to_mm, speed_mm_s, |_| {});
    }

    /// The proxy's place.
    pub fn proxy_mm(&self) -> DVec3 {
        self.base_from_bone
            .point(self.output.bone_from_tool.translation)
    }

    /// The coupling's force on the hand before the output chain, N at the stylus.
    pub fn coupling_n(&self) -> DVec3 {
        self.base_from_bone
            .vector(self.output.physical_force_n * self.spec.feel.force_scale)
    }

    /// The force on the hand, N.
    pub fn force_n(&self) -> DVec3 {
        self.base_from_bone.vector(self.output.force_n)
    }

    /// One tick in which `push_n` along −z acts on the proxy: the device is ahead of it by the push over
    /// the coupling's stiffness, and by what the proxy went in the last tick, so that the push is what it
    /// should be when the tick is over. Across, the device stays on its axis.
    pub fn push(&mut self, push_n: f64) {
        let before = self.proxy_mm();
        let lead = push_n / self.spec.feel.coupling.stiffness_n_per_mm + self.advance_mm;
        self.tick_at(self.place_mm.with_z(before.z - lead));
        self.advance_mm = (before.z - self.proxy_mm().z).clamp(0.0, 0.2);
    }

    /// The push from zero to `push_n` within `seconds`.
    pub fn push_up_to(&mut self, push_n: f64, seconds: f64) {
        let ticks = self.ticks(seconds);
        for n in 1..=ticks {
            self.push(push_n * f64::from(n) / f64::from(ticks));
        }
    }

    /// The same push for a time.
    pub fn push_for(&mut self, push_n: f64, seconds: f64) {
        for _ in 0..self.ticks(seconds) {
            self.push(push_n);
        }
    }

    /// Bone removed so far, mm³; what is not yet carved of a step is carved first.
    pub fn removed_mm3(&mut self) -> f64 {
        self.servo.finish_carving();
        let units: i64 = self.servo.cut().totals().by_class.iter().sum();
        Cut::mm3(self.servo.bone().grid(), units)
    }

    /// Centroid of what was removed.
    pub fn removed_centroid(&self) -> Option<DVec3> {
        let centroid = self.servo.cut().centroid(self.servo.bone())?;
        Some(self.base_from_bone.point(centroid))
    }
}
