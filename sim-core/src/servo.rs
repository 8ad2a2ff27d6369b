//! The servo step: one pure function of state, raw device sample and requests.
//!
//! counts → joint angles → `base_from_stylus` → `bone_from_device` → contact and cutting → carve → force
//! → output chain → Jᵀ → DAC counts.
//!
//! [`Servo::tick`] allocates nothing and its loops are bounded: at most [`MAX_SUBSTEPS`] proxy steps
//! ([`crate::proxy`]), and [`TICK_WORK`] units of carving: what is left of a step is carried over.

mod intake;
mod io;
mod undo;

pub use crate::carry::TICK_WORK;
pub use crate::proxy::MAX_SUBSTEPS;
pub use io::{
    CutEvent, CutEvents, DeviceScale, MAX_REQUESTS, Request, Sample, ServoSetup, TickOutput, button,
};

use crate::bone::Bone;
use crate::broad::Obb;
use crate::carry::Carry;
use crate::chain::{Guard, GuardCounts, OutputChain};
use crate::cut::{Cut, MAX_TOOLS, journal_bricks};
use crate::feel::FIELDS;
use crate::pose::Pose;
use crate::proxy::{Proxy, Reaction, Surroundings};
use crate::register::Workspace;
use crate::spindle::Spindle;
use crate::vibration::Vibration;
use glam::DVec3;
use intake::{Intake, Verdict};
use std::sync::Arc;

/// A tool that appears deeper than this in bone is embedded: no force until it is free, mm.
const EMBEDDED_MM: f64 = 0.25;
/// The tool enters the scene in front of the joint: nearer to the plan's axis than this, mm …
const GATE_RADIUS_MM: f64 = 30.0;
/// … and at least this far outside the plan's origin, mm.
const GATE_HEIGHT_MM: f64 = 4.0;
/// Accepted residual of the contact solve, N.
const ACCEPTED_N: f64 = 1e-4;
/// Commands whose vibration is remembered.
const REMEMBERED: usize = 16;

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
    chain: OutputChain,
    intake: Intake,
    workspace: Workspace,
    bone_from_device: Pose,
    proxy: Proxy,
    spindle: Spindle,
    vibration: Vibration,
    // vibration's part of the newest commands, N·mm, newest first
    buzzed: [DVec3; REMEMBERED],
    // of the last tick
    cut_nmm: f64,
    missing: u32,
    tool: u8,
    spindle_on: bool,
    paused: bool,
    check_embedded: bool,
    embedded: bool,
    waiting: bool,
    // a checkpoint waits for the pending step
    checkpoint_wanted: bool,
    events: CutEvents,
}

impl Servo {
    /// Allocates all that the ticks need. `None` where there is no tool or more than [`MAX_TOOLS`].
    pub fn new(setup: ServoSetup) -> Option<Self> {
        if setup.tools.is_empty() || setup.tools.len() > MAX_TOOLS {
            return None;
        }
        Some(Self {
            cut: Cut::with_journal(&setup.bone, journal_bricks(&setup.bone)),
            carry: Carry::default(),
            chain: OutputChain::new(setup.force_limit_n, &setup.feel),
            intake: Intake::new(setup.device.arm),
            workspace: Workspace::new(&setup.bone_from_base, setup.feel.motion_scale),
            bone_from_device: Pose::IDENTITY,
            proxy: Proxy::default(),
            spindle: Spindle::default(),
            vibration: Vibration::default(),
            buzzed: [DVec3::ZERO; REMEMBERED],
            cut_nmm: 0.0,
            missing: 0,
            tool: 0,
            spindle_on: false,
            paused: false,
            check_embedded: true,
            embedded: false,
            waiting: true,
            checkpoint_wanted: false,
            events: CutEvents::NONE,
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

    /// Restores what is left of an undo and carves what is left of a step, whatever it costs: after the last tick, before the digest. Not
    /// for the servo's loop.
    pub fn finish_carving(&mut self) {
        self.carry
            .finish(&self.setup.bone, &mut self.cut, &self.setup.tools);
    }

    /// The device was away and is connected again: force and proxy begin anew where the stylus is now.
    /// Call it between two ticks. What was cut stays.
    pub fn reconnect(&mut self) {
        self.intake.forget();
        self.start_over();
    }

    /// What the guards had to do so far.
    pub fn guards(&self) -> GuardCounts {
        self.chain.counts
    }

    /// Millimetres of the tool per millimetre of the stylus.
    pub fn motion_scale(&self) -> f64 {
        self.workspace.scale()
    }

    /// One servo tick. `sample` is the newest one that has not been used yet, `None` where none came.
    /// Of `requests` the first [`MAX_REQUESTS`] are heard.
    pub fn tick(&mut self, sample: Option<&Sample>, requests: &[Request]) -> TickOutput {
        self.chain.counts.begin_tick();
        self.events = CutEvents::NONE;
        for request in requests.iter().take(MAX_REQUESTS) {
            self.request(*request);
        }
        // an undo goes on with or without samples, and shares the tick's budget
        let undoing = self.cut.is_undoing();
        self.carry.grant(if undoing { TICK_WORK } else { 0 });
        self.carry.undo(&mut self.cut);
        let accepted = sample.and_then(|s| self.accept(s).map(|v| (s, v)));
        let mut reaction = Reaction::NONE;
        let mut buzz = DVec3::ZERO;
        let force = if let Some((sample, velocity)) = accepted {
            self.missing = 0;
            if !undoing {
                self.carry.grant(TICK_WORK);
            }
            self.carry
                .go_on(&self.setup.bone, &mut self.cut, &self.setup.tools);
            self.take_checkpoint();
            self.press_buttons(sample.buttons);
            self.spin();
            self.pass_gate(sample.docked);
            reaction = self.interact();
            self.emit(&reaction, velocity, sample, &mut buzz)
        } else {
            self.missing = self.missing.saturating_add(1);
            self.chain.hold(self.missing)
        };
        self.output(&reaction, force, buzz, accepted.is_some())
    }

    fn request(&mut self, request: Request) {
        let stylus = *self.intake.base_from_stylus();
        match request {
            Request::SelectTool(tool) if usize::from(tool) < self.setup.tools.len() => {
                if tool != self.tool {
                    self.tool = tool;
                    self.spindle.stop();
                    self.start_over();
                }
            }
            Request::SelectTool(_) => {}
            Request::Spindle(on) => self.spindle_on = on,
            Request::Pause(paused) => {
                self.paused = paused;
                self.start_over();
            }
            Request::Reset => self.reset(),
            Request::Checkpoint => {
                self.checkpoint_wanted = true;
                self.take_checkpoint();
            }
            Request::Undo => self.undo(),
            Request::Clutch(hold) => {
                if hold != self.workspace.is_clutched() {
                    self.workspace.clutch(hold, &stylus);
                    self.chain.off();
                }
            }
            Request::MotionScale(scale) => {
                let known = FIELDS.iter().find(|field| field.key == "motion_scale");
                if known.is_some_and(|field| field.set(&mut self.setup.feel, scale).is_ok()) {
                    self.workspace.set_scale(scale, &stylus);
                    self.chain.off();
                }
            }
            Request::TurnWorkspace(angle) => {
                if angle.is_finite() {
                    self.workspace.turn(angle, &stylus);
                    self.chain.off();
                }
            }
        }
    }

    /// The proxy begins anew at the device, and the force from zero. A pending step stays: the
    /// publisher has been told of it.
    fn start_over(&mut self) {
        self.proxy.release();
        self.chain.off();
        self.check_embedded = true;
    }

    /// A sample's velocity in mm/s, or `None` where it is refused.
    fn accept(&mut self, sample: &Sample) -> Option<DVec3> {
        let silent = self.chain.is_silent(self.missing);
        let most = self.setup.feel.guard.acceleration_mm_ms2;
        let verdict = self.intake.take(sample, self.setup.device, silent, most);
        let (velocity, jumped) = match verdict {
            Verdict::Accepted {
                velocity_mm_s,
                jumped,
            } => (velocity_mm_s, jumped),
            Verdict::NotFinite => {
                self.chain.counts.note(Guard::NotFinite);
                return None;
            }
            Verdict::Implausible | Verdict::Stale => {
                self.chain.counts.note(Guard::Implausible);
                return None;
            }
        };
        if jumped {
            self.start_over();
        }
        self.bone_from_device = self.workspace.place(self.intake.base_from_stylus());
        self.observe_energy(sample);
        Some(velocity)
    }

    /// The energy account: the torque in force from this sample on, without its vibration.
    fn observe_energy(&mut self, sample: &Sample) {
        let device = &self.setup.device;
        let counts = DVec3::from_array(sample.applied.map(f64::from));
        let applied = counts * device.nmm_per_count * device.arm.gear();
        let buzz = match usize::from(sample.ack_age) {
            age @ 1..=REMEMBERED => self.buzzed[age - 1],
            _ => DVec3::ZERO,
        };
        self.chain
            .passivity
            .observe(self.intake.angles(), applied - buzz, buzz);
    }

    fn press_buttons(&mut self, buttons: u8) {
        let pressed = self.intake.pressed(buttons, self.setup.feel.tick_s);
        if pressed & button::SPINDLE != 0 {
            self.spindle_on = !self.spindle_on;
        }
        if pressed & button::NEXT_TOOL != 0 {
            let next = self.tool + 1;
            let known = usize::from(next) < self.setup.tools.len();
            self.request(Request::SelectTool(if known { next } else { 0 }));
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
        let feel = &self.setup.feel;
        let tool = &self.setup.tools[usize::from(self.tool)];
        let on = self.spindle_on && !self.paused;
        self.spindle
            .turn(on, tool, self.cut_nmm, feel.spindle, feel.tick_s);
    }

    /// Moves the proxy towards the device and carves.
    fn interact(&mut self) -> Reaction {
        let bone = Arc::clone(&self.setup.bone);
        let idle = self.paused || self.waiting || self.cut.is_undoing();
        if idle || !self.in_reach(&bone) {
            self.proxy.jump(&self.bone_from_device);
            self.cut_nmm = 0.0;
            if !idle {
                self.check_embedded = false;
                self.embedded = false;
                self.chain.passivity.settle(0.0);
            }
            return Reaction::NONE;
        }
        if (self.check_embedded || self.embedded) && self.still_embedded(&bone) {
            return Reaction::NONE;
        }
        if self.workspace.is_clutched() {
            self.cut_nmm = 0.0;
            return Reaction::NONE;
        }
        let omega = self.spindle.omega_rad_s();
        let device = self.bone_from_device;
        let (proxy, mut around) = self.surroundings(&bone, omega);
        let reaction = proxy.follow(&device, &mut around);
        self.cut_nmm = reaction.spindle_nmm;
        self.note(&reaction);
        reaction
    }

    fn surroundings<'a>(
        &'a mut self,
        bone: &'a Bone,
        omega_rad_s: f64,
    ) -> (&'a mut Proxy, Surroundings<'a>) {
        let around = Surroundings {
            bone,
            cut: &mut self.cut,
            carry: &mut self.carry,
            tools: &self.setup.tools,
            tool: self.tool,
            omega_rad_s,
            limit_n: self.chain.limit_n(),
            feel: &self.setup.feel,
        };
        (&mut self.proxy, around)
    }

    fn note(&mut self, reaction: &Reaction) {
        let counts = &mut self.chain.counts;
        for (happened, guard) in [
            (reaction.not_finite, Guard::NotFinite),
            (reaction.overrun, Guard::Overrun),
            (reaction.residual_n > ACCEPTED_N, Guard::Unsolved),
        ] {
            if happened {
                counts.note(guard);
            }
        }
        self.chain.passivity.settle(reaction.stored_mj);
    }

    /// Broad phase: could the tool, anywhere between proxy and device, touch the bone's box?
    fn in_reach(&self, bone: &Bone) -> bool {
        let tool = &self.setup.tools[usize::from(self.tool)];
        let (lo, hi) = bone.bounds();
        let bone_box = Obb::aligned(lo, hi);
        let proxy = self.proxy.bone_from_tool.translation;
        let way = (self.bone_from_device.translation - proxy).length();
        let way = if self.check_embedded { 0.0 } else { way };
        let margin = bone.grid().band_mm() + way;
        Obb::of_tool(&tool.shape.bounds(), &self.bone_from_device, margin).overlaps(&bone_box)
    }

    /// After a jump, a tool change or a reset: the proxy stays with the hand, without force, while
    /// the tool is inside bone.
    fn still_embedded(&mut self, bone: &Bone) -> bool {
        self.proxy.jump(&self.bone_from_device);
        let (proxy, around) = self.surroundings(bone, 0.0);
        let deepest = proxy.deepest_mm(&around);
        self.embedded = deepest > EMBEDDED_MM;
        self.check_embedded = false;
        if self.embedded {
            self.chain.counts.note(Guard::Embedded);
            self.chain.off();
            self.proxy.release();
            self.cut_nmm = 0.0;
        }
        self.embedded
    }

    /// Force for the hand through the output chain, base frame, N; `buzz`: the vibration in it.
    fn emit(
        &mut self,
        reaction: &Reaction,
        velocity: DVec3,
        sample: &Sample,
        buzz: &mut DVec3,
    ) -> DVec3 {
        if !sample.drive_active {
            self.chain.disengage();
            return DVec3::ZERO;
        }
        let spring = self.workspace.base_from_bone(reaction.force_n);
        let force = self.chain.step(spring, velocity, sample.ack_age.min(8));
        let tool = &self.setup.tools[usize::from(self.tool)];
        let feel = &self.setup.feel;
        let turning = (self.spindle.omega_rad_s(), tool.lips);
        let most = feel.guard.vibration_n;
        let size = self
            .vibration
            .next(reaction.vibration_n, turning, most, feel.tick_s);
        let axis = self.proxy.bone_from_tool.vector(DVec3::Z);
        let shown = self
            .chain
            .vibrate(force, self.workspace.base_from_bone(axis) * size);
        *buzz = shown - force;
        shown
    }

    fn output(
        &mut self,
        reaction: &Reaction,
        force_in_base: DVec3,
        buzz: DVec3,
        fresh: bool,
    ) -> TickOutput {
        let torque = self.torque_counts(force_in_base);
        self.buzzed.rotate_right(1);
        let arm = self.setup.device.arm;
        self.buzzed[0] = arm.torque(self.intake.angles(), buzz);
        TickOutput {
            torque,
            stylus_in_base: arm.forward(self.intake.angles()),
            bone_from_device: self.bone_from_device,
            bone_from_tool: self.proxy.bone_from_tool,
            force_n: self.workspace.bone_from_base(force_in_base),
            physical_force_n: reaction.force_n / self.setup.feel.force_scale,
            saturated: reaction.saturated,
            holding_torque_nmm: reaction.torque_nmm / self.setup.feel.force_scale,
            spindle_rad_s: self.spindle.omega_rad_s(),
            spindle_nmm: self.spindle.torque_nmm(),
            spindle_load: self.spindle.load(),
            vibration_n: self.workspace.bone_from_base(buzz),
            hand_mj: reaction.hand_mj,
            spindle_mj: reaction.spindle_mj,
            energy_mj: self.chain.passivity.energy_mj(),
            iterations: reaction.iterations,
            residual_n: reaction.residual_n,
            tool: self.tool,
            spindle_on: self.spindle_on,
            paused: self.paused,
            embedded: self.embedded,
            waiting: self.waiting,
            clutched: self.workspace.is_clutched(),
            fresh,
            epoch: self.cut.epoch(),
            events: self.events,
            checkpoints: u8::try_from(self.cut.checkpoints()).unwrap_or(u8::MAX),
            carved: reaction.carved,
            carved_len: reaction.carved_len,
            work: self.carry.spent(),
            removed_by_class: self.cut.totals().by_class,
        }
    }

    /// Jᵀ F in DAC counts; the vector is scaled into the range, never an axis alone.
    fn torque_counts(&mut self, force_in_base: DVec3) -> [i16; 3] {
        let device = self.setup.device;
        let joints = device.arm.torque(self.intake.angles(), force_in_base);
        let torque = joints / device.arm.gear() / device.nmm_per_count;
        if !torque.is_finite() {
            self.chain.counts.note(Guard::NotFinite);
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
