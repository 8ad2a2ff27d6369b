//! The servo step: one pure function of state, raw device sample and requests.
//!
//! counts → joint angles → `base_from_stylus` → `bone_from_device` → contact and cutting → carve → force
//! → output chain → Jᵀ → DAC counts.
//!
//! [`Servo::tick`] allocates nothing and its loops are bounded: at most [`MAX_SUBSTEPS`] proxy steps
//! of at most [`crate::tool::MAX_ELEMENTS`] elements and [`crate::contact::MAX_ITERATIONS`]
//! iterations each, and [`TICK_WORK`] units of carving: what is left of a step is carried over.

use crate::bone::Bone;
use crate::broad::Obb;
use crate::carry::Carry;
pub use crate::carry::TICK_WORK;
use crate::carve::CarveStep;
use crate::chain::{GAP_RAMP_TICKS, GuardCounts, OutputChain, ZERO_TICKS};
use crate::contact::{Contacts, ToolState, YIELD_EPS_MM, coupling_force};
use crate::cut::{Cut, MAX_TOOLS};
use crate::omni;
use crate::pose::Pose;
pub use crate::servo_io::{DeviceScale, Request, Sample, ServoSetup, TickOutput, button};
use core::f64::consts::TAU;
use glam::DVec3;
use std::sync::Arc;

/// Proxy steps per tick at most; each at most half the smallest spacing long.
pub const MAX_SUBSTEPS: usize = 8;
/// A sample is implausible where its second difference exceeds this, mm/ms² (2000 m/s²): no hand can
/// do that, a broken encoder can.
const MAX_ACCELERATION_MM_MS2: f64 = 2.0;
/// Implausible samples in a row after which the new place is believed.
const RESYNC_AFTER: u32 = 5;
/// A hand that moved less than this during a gap goes on where it was, mm.
const GAP_TRUST_MM: f64 = 10.0;
/// A tool that appears deeper than this in bone is embedded: no force until it is free, mm.
const EMBEDDED_MM: f64 = 0.25;
/// Spindle run-up, s.
const SPIN_UP_S: f64 = 0.3;
/// Turning of the proxy while it touches bone, rad per tick at most (3 rad/s).
const TURN_RAD_PER_TICK: f64 = 0.003;
/// The tool enters the scene in front of the joint: nearer to the plan's axis than this, mm …
const GATE_RADIUS_MM: f64 = 30.0;
/// … and at least this far outside the plan's origin, mm.
const GATE_HEIGHT_MM: f64 = 4.0;
/// Ticks that a button is deaf after an edge (contact bounce).
const BUTTON_DEAF_TICKS: u32 = 30;

/// A past, plausible position.
#[derive(Debug, Clone, Copy)]
struct Track {
    time_micros: u32,
    position: DVec3,
    velocity_mm_s: DVec3,
}

/// The state of the servo.
#[derive(Debug, Clone)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "independent facts about the session"
)]
pub struct Servo {
    setup: ServoSetup,
    cut: Cut,
    carry: Carry,
    contacts: Contacts,
    chain: OutputChain,
    track: Option<Track>,
    angles: DVec3,
    bone_from_device: Pose,
    proxy: Pose,
    missing: u32,
    implausible_run: u32,
    tool: u8,
    spindle_on: bool,
    spindle_share: f64,
    paused: bool,
    check_embedded: bool,
    embedded: bool,
    waiting: bool,
    buttons: u8,
    deaf: [u32; 2],
}

impl Servo {
    /// Allocates all that the ticks need. `None` where there is no tool or more than [`MAX_TOOLS`].
    pub fn new(setup: ServoSetup) -> Option<Self> {
        if setup.tools.is_empty() || setup.tools.len() > MAX_TOOLS {
            return None;
        }
        Some(Self {
            cut: Cut::new(&setup.bone),
            carry: Carry::default(),
            contacts: Contacts::new(),
            chain: OutputChain::new(setup.force_limit_n),
            track: None,
            angles: omni::DOCK,
            bone_from_device: Pose::IDENTITY,
            proxy: Pose::IDENTITY,
            missing: 0,
            implausible_run: 0,
            tool: 0,
            spindle_on: false,
            spindle_share: 0.0,
            paused: false,
            check_embedded: true,
            embedded: false,
            waiting: true,
            buttons: 0,
            deaf: [0; 2],
            setup,
        })
    }

    /// The bone.
    pub fn bone(&self) -> &Arc<Bone> {
        &self.setup.bone
    }

    /// The cut as the servo has it.
    pub fn cut(&self) -> &Cut {
        &self.cut
    }

    /// Whether a step is not carved to its end: the cut then lacks a part of what was listed in
    /// [`TickOutput::carved`].
    pub fn carving(&self) -> bool {
        self.carry.is_pending()
    }

    /// Carves what is left of a step, whatever it costs: after the last tick, before the digest. Not
    /// for the servo's loop.
    pub fn finish_carving(&mut self) {
        self.carry
            .finish(&self.setup.bone, &mut self.cut, &self.setup.tools);
    }

    /// What the output guards had to do so far.
    pub fn guards(&self) -> GuardCounts {
        self.chain.counts
    }

    /// One servo tick of 1 ms. `sample` is the newest one that has not been used yet, `None` where
    /// none came.
    pub fn tick(&mut self, sample: Option<&Sample>, requests: &[Request]) -> TickOutput {
        for request in requests {
            self.request(*request);
        }
        let mut output = self.blank_output();
        self.carry.grant(0);
        let accepted = sample.and_then(|s| self.accept(s).map(|v| (s, v)));
        let force_in_base = if let Some((sample, velocity)) = accepted {
            self.missing = 0;
            self.carry.grant(TICK_WORK);
            self.carry
                .go_on(&self.setup.bone, &mut self.cut, &self.setup.tools);
            self.press_buttons(sample.buttons);
            self.spin();
            self.pass_gate(sample.docked);
            let spring = self.interact(&mut output);
            self.emit(spring, velocity, sample.drive_active)
        } else {
            self.missing = self.missing.saturating_add(1);
            self.chain.hold(self.missing)
        };
        output.fresh = accepted.is_some();
        self.finish(output, force_in_base)
    }

    fn request(&mut self, request: Request) {
        match request {
            Request::SelectTool(tool) if usize::from(tool) < self.setup.tools.len() => {
                if tool != self.tool {
                    self.tool = tool;
                    self.start_over();
                }
            }
            Request::SelectTool(_) => {}
            Request::Spindle(on) => self.spindle_on = on,
            Request::Pause(paused) => {
                self.paused = paused;
                self.start_over();
            }
            Request::Reset => {
                self.carry.forget();
                self.cut.reset(self.cut.epoch().wrapping_add(1));
                self.start_over();
            }
        }
    }

    /// The proxy begins anew at the device, and the force from zero. A pending step stays: the
    /// publisher has been told of it.
    fn start_over(&mut self) {
        self.contacts.release();
        self.chain.off(GAP_RAMP_TICKS);
        self.check_embedded = true;
    }

    /// Kinematics and plausibility of a sample; its velocity in mm/s, or `None` where it is refused.
    fn accept(&mut self, sample: &Sample) -> Option<DVec3> {
        let device = self.setup.device;
        let angles = omni::angles_from_counts(sample.encoders, device.counts_per_rev);
        let gimbal = omni::gimbal_from_counts(sample.gimbal, device.gimbal_counts_per_rev);
        let base_from_stylus = omni::stylus(angles, gimbal);
        let position = base_from_stylus.translation;
        if !base_from_stylus.is_valid() {
            self.chain.counts.not_finite += 1;
            return None;
        }
        let velocity = match self.track {
            Some(track) => {
                let ms = f64::from(sample.time_micros.wrapping_sub(track.time_micros)) * 1e-3;
                let ms = ms.clamp(0.1, 1000.0);
                let expected = track.position + track.velocity_mm_s * (ms * 1e-3);
                let plausible = (position - expected).length() <= MAX_ACCELERATION_MM_MS2 * ms * ms;
                if !plausible && self.implausible_run < RESYNC_AFTER {
                    self.implausible_run += 1;
                    self.chain.counts.implausible += 1;
                    return None;
                }
                if plausible {
                    (position - track.position) / (ms * 1e-3)
                } else {
                    self.start_over();
                    DVec3::ZERO
                }
            }
            None => DVec3::ZERO,
        };
        if self.missing >= ZERO_TICKS && self.moved_in_gap(position) {
            self.start_over();
        }
        self.implausible_run = 0;
        self.track = Some(Track {
            time_micros: sample.time_micros,
            position,
            velocity_mm_s: velocity,
        });
        self.angles = angles;
        self.bone_from_device = self.setup.bone_from_base.then(&base_from_stylus);
        Some(velocity)
    }

    /// Whether the hand is somewhere else after a gap. If not, the proxy stays where it was: it alone
    /// knows on which side of the bone the tool is. (The force has been zero and ramps up.)
    fn moved_in_gap(&self, position: DVec3) -> bool {
        self.track
            .is_none_or(|track| (position - track.position).length() > GAP_TRUST_MM)
    }

    fn press_buttons(&mut self, buttons: u8) {
        for (i, bit) in [button::SPINDLE, button::NEXT_TOOL].into_iter().enumerate() {
            self.deaf[i] = self.deaf[i].saturating_sub(1);
            let changed = (buttons ^ self.buttons) & bit != 0;
            if !changed || self.deaf[i] > 0 {
                continue;
            }
            self.buttons ^= bit;
            self.deaf[i] = BUTTON_DEAF_TICKS;
            if buttons & bit == 0 {
                continue;
            }
            if bit == button::SPINDLE {
                self.spindle_on = !self.spindle_on;
            } else {
                let next = self.tool + 1;
                let known = usize::from(next) < self.setup.tools.len();
                self.request(Request::SelectTool(if known { next } else { 0 }));
            }
        }
    }

    /// From the dock the hand reaches the joint through the bone's own place in the workspace (the
    /// patient is virtual, the way is not): contact begins when the tip has come in front of the
    /// joint.
    fn pass_gate(&mut self, docked: bool) {
        let plan_from_bone = self.setup.bone_from_plan.inverse();
        let tip = plan_from_bone.point(self.bone_from_device.translation);
        if docked {
            self.waiting = true;
        } else if self.waiting && tip.z > GATE_HEIGHT_MM && tip.truncate().length() < GATE_RADIUS_MM
        {
            self.waiting = false;
            self.start_over();
        }
    }

    fn spin(&mut self) {
        let step = self.setup.contact.tick_s / SPIN_UP_S;
        // it stops at once: a tool that runs down does not cut
        self.spindle_share = if self.spindle_on && !self.paused {
            (self.spindle_share + step).min(1.0)
        } else {
            0.0
        };
    }

    /// Moves the proxy towards the device and carves; the coupling's force in the bone frame, N.
    fn interact(&mut self, output: &mut TickOutput) -> DVec3 {
        let bone = Arc::clone(&self.setup.bone);
        let idle = self.paused || self.waiting;
        if idle || !self.in_reach(&bone) {
            self.proxy = self.bone_from_device;
            self.contacts.release();
            if !idle {
                self.check_embedded = false;
                self.embedded = false;
            }
            return DVec3::ZERO;
        }
        if (self.check_embedded || self.embedded) && self.still_embedded(&bone) {
            return DVec3::ZERO;
        }
        self.turn_proxy();
        for _ in 0..MAX_SUBSTEPS {
            if self.substep(&bone, output) {
                break;
            }
        }
        let error = self.bone_from_device.translation - self.proxy.translation;
        coupling_force(error, self.chain.limit_n(), &self.setup.contact)
    }

    /// Broad phase: could the tool, anywhere between proxy and device, touch the bone's box?
    fn in_reach(&self, bone: &Bone) -> bool {
        let tool = &self.setup.tools[usize::from(self.tool)];
        let (lo, hi) = bone.bounds();
        let bone_box = Obb::aligned(lo, hi);
        let way = (self.bone_from_device.translation - self.proxy.translation).length();
        let way = if self.check_embedded { 0.0 } else { way };
        let margin = bone.grid().band_mm() + way;
        Obb::of_tool(&tool.shape.bounds(), &self.bone_from_device, margin).overlaps(&bone_box)
    }

    /// After a jump, a tool change or a reset: the proxy stays with the hand, without force, while
    /// the tool is inside bone.
    fn still_embedded(&mut self, bone: &Bone) -> bool {
        self.proxy = self.bone_from_device;
        self.gather(bone, 0.0);
        self.embedded = self.contacts.deepest_mm() > EMBEDDED_MM;
        self.check_embedded = false;
        if self.embedded {
            self.chain.off(GAP_RAMP_TICKS);
            self.contacts.release();
        }
        self.embedded
    }

    /// The proxy's rotation follows the hand's: freely in air, at most
    /// [`TURN_RAD_PER_TICK`] while it touches.
    fn turn_proxy(&mut self) {
        let target = self.bone_from_device.rotation;
        let turn = self.proxy.rotation.angle_between(target);
        self.proxy.rotation = if self.contacts.is_free() || turn <= TURN_RAD_PER_TICK {
            target
        } else {
            self.proxy.rotation.slerp(target, TURN_RAD_PER_TICK / turn)
        };
    }

    fn gather(&mut self, bone: &Bone, share: f64) {
        let tool = &self.setup.tools[usize::from(self.tool)];
        let state = ToolState {
            tool,
            bone_from_tool: self.proxy,
            omega_rad_s: share * tool.rpm * TAU / 60.0,
        };
        self.contacts
            .gather(bone, &self.cut, &state, &self.setup.contact);
    }

    /// One proxy step of at most half a voxel; true where the proxy has arrived, or is held by bone
    /// that there was no budget to carve.
    fn substep(&mut self, bone: &Bone, output: &mut TickOutput) -> bool {
        let longest = 0.5 * bone.grid().spacing_mm.min_element();
        let error = self.bone_from_device.translation - self.proxy.translation;
        self.gather(bone, self.spindle_share);
        let limit = self.chain.limit_n();
        let solution = self.contacts.solve(error, limit, &self.setup.contact);
        let length = solution.delta.length();
        let arrived = length <= longest;
        let delta = if arrived {
            solution.delta
        } else {
            solution.delta * (longest / length)
        };
        if !delta.is_finite() {
            self.chain.counts.not_finite += 1;
            return true;
        }
        if self.contacts.advance_mm(delta) > 2.0 * YIELD_EPS_MM {
            if self.carry.is_pending() {
                return true;
            }
            self.advance(bone, delta, output);
            return arrived || self.carry.is_pending();
        }
        self.proxy.translation += self.contacts.without_creep(delta);
        arrived
    }

    /// The proxy goes through bone: carve what it sweeps, as far as the budget reaches.
    fn advance(&mut self, bone: &Bone, delta: DVec3, output: &mut TickOutput) {
        let mut after = self.proxy;
        after.translation += delta;
        let step = CarveStep {
            tool: self.tool,
            before: self.proxy,
            after,
        };
        self.carry
            .begin(bone, &mut self.cut, &self.setup.tools, step);
        self.proxy = after;
        output.carved[output.carved_len] = step;
        output.carved_len += 1;
    }

    /// Force for the hand through the output chain, base frame, N.
    fn emit(&mut self, spring_in_bone: DVec3, velocity: DVec3, drive_active: bool) -> DVec3 {
        if !drive_active {
            // the first ramp is the long one; after a trip the short one
            let ramp = if self.chain.limit_n() > 0.0 {
                Some(GAP_RAMP_TICKS)
            } else {
                None
            };
            if let Some(ticks) = ramp {
                self.chain.off(ticks);
            }
            return DVec3::ZERO;
        }
        let base_from_bone = self.setup.bone_from_base.inverse();
        self.chain
            .step(base_from_bone.vector(spring_in_bone), velocity)
    }

    fn blank_output(&self) -> TickOutput {
        TickOutput {
            torque: [0; 3],
            stylus_in_base: DVec3::ZERO,
            bone_from_device: self.bone_from_device,
            bone_from_tool: self.proxy,
            force_n: DVec3::ZERO,
            tool: self.tool,
            spindle_on: self.spindle_on,
            paused: self.paused,
            embedded: self.embedded,
            waiting: self.waiting,
            fresh: false,
            epoch: self.cut.epoch(),
            carved: [CarveStep {
                tool: 0,
                before: Pose::IDENTITY,
                after: Pose::IDENTITY,
            }; MAX_SUBSTEPS],
            carved_len: 0,
            work: 0,
            removed_by_class: self.cut.totals().by_class,
        }
    }

    fn finish(&mut self, mut output: TickOutput, force_in_base: DVec3) -> TickOutput {
        output.torque = self.torque_counts(force_in_base);
        output.stylus_in_base = omni::forward(self.angles);
        output.bone_from_device = self.bone_from_device;
        output.bone_from_tool = self.proxy;
        output.force_n = self.setup.bone_from_base.vector(force_in_base);
        output.tool = self.tool;
        output.spindle_on = self.spindle_on;
        output.embedded = self.embedded;
        output.waiting = self.waiting;
        output.epoch = self.cut.epoch();
        output.work = self.carry.spent();
        output.removed_by_class = self.cut.totals().by_class;
        output
    }

    /// Jᵀ F in DAC counts; the vector is scaled into the range, never an axis alone.
    fn torque_counts(&mut self, force_in_base: DVec3) -> [i16; 3] {
        let device = self.setup.device;
        let torque = omni::torque_from_force(self.angles, force_in_base) / device.nmm_per_count;
        if !torque.is_finite() {
            self.chain.counts.not_finite += 1;
            return [0; 3];
        }
        let largest = torque.abs().max_element();
        let most = f64::from(device.dac_max);
        let scale = if largest > most { most / largest } else { 1.0 };
        #[expect(clippy::cast_possible_truncation, reason = "|value| ≤ dac_max")]
        let counts = (torque * scale).round().to_array().map(|v| v as i16);
        counts
    }
}
