//! The proxy: the tool as the bone holds it. It follows the hand through contact and cutting, in steps of
//! at most half a voxel, and carves what it sweeps.

use crate::bone::Bone;
use crate::carry::Carry;
use crate::carve::CarveStep;
use crate::contact::{Contacts, Coupling, Motion, ToolState, YIELD_EPS_MM};
use crate::cut::Cut;
use crate::feel::Feel;
use crate::pose::Pose;
use crate::tool::Tool;
use glam::{DQuat, DVec3};

/// Steps per tick at most.
pub const MAX_SUBSTEPS: usize = 8;
/// A turn further from the hand's than this is taken as this, rad: the linearised turn stays small.
const LONGEST_TURN: f64 = 0.5;

/// The proxy.
#[derive(Debug, Clone)]
pub struct Proxy {
    /// Where the bone holds the tool.
    pub bone_from_tool: Pose,
    contacts: Contacts,
    // where the solver begins: the last step's motion
    guess: Motion,
}

/// What the proxy moves in.
#[derive(Debug)]
pub struct Surroundings<'a> {
    /// The bone.
    pub bone: &'a Bone,
    /// What is cut of it.
    pub cut: &'a mut Cut,
    /// Budget and rest of the carving.
    pub carry: &'a mut Carry,
    /// All tools.
    pub tools: &'a [Tool],
    /// The one in hand.
    pub tool: u8,
    /// Its speed, rad/s.
    pub omega_rad_s: f64,
    /// The force limit in force, N.
    pub limit_n: f64,
    /// The feel.
    pub feel: &'a Feel,
}

/// What a tick did to the proxy.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "independent facts of a tick")]
pub struct Reaction {
    /// Force on the hand, bone frame, N at the stylus.
    pub force_n: DVec3,
    /// Torque that the bone needs to hold or turn the tool, bone frame, N·mm at the stylus. An arm with
    /// three motors cannot show it.
    pub torque_nmm: DVec3,
    /// Whether the coupling is saturated.
    pub saturated: bool,
    /// What the coupling in place stores, mJ at the stylus.
    pub stored_mj: f64,
    /// Work of the hand on the bone in this tick, mJ at the stylus; never negative.
    pub hand_mj: f64,
    /// Work of the spindle in this tick, mJ at a real tool.
    pub spindle_mj: f64,
    /// Mean torque of the cut, N·mm at a real tool.
    pub spindle_nmm: f64,
    /// Σ vibration share × cutting force, N at the stylus.
    pub vibration_n: f64,
    /// Whether an element is in reach of the bone.
    pub touching: bool,
    /// The proxy did not arrive within [`MAX_SUBSTEPS`].
    pub overrun: bool,
    /// A motion that is no number was dropped.
    pub not_finite: bool,
    /// Newton iterations of all steps.
    pub iterations: u32,
    /// Worst residual, N.
    pub residual_n: f64,
    /// Carved steps; the first `carved_len` count.
    pub carved: [CarveStep; MAX_SUBSTEPS],
    /// Number of carved steps.
    pub carved_len: usize,
}

impl Reaction {
    /// Nothing happened.
    pub const NONE: Self = Self {
        force_n: DVec3::ZERO,
        torque_nmm: DVec3::ZERO,
        saturated: false,
        stored_mj: 0.0,
        hand_mj: 0.0,
        spindle_mj: 0.0,
        spindle_nmm: 0.0,
        vibration_n: 0.0,
        touching: false,
        overrun: false,
        not_finite: false,
        iterations: 0,
        residual_n: 0.0,
        carved: [CarveStep {
            tool: 0,
            before: Pose::IDENTITY,
            after: Pose::IDENTITY,
        }; MAX_SUBSTEPS],
        carved_len: 0,
    };
}

impl Default for Proxy {
    fn default() -> Self {
        Self {
            bone_from_tool: Pose::IDENTITY,
            contacts: Contacts::new(),
            guess: Motion::ZERO,
        }
    }
}

/// How far a pose is from another, as shift and turn.
fn error(target: &Pose, from: &Pose, turning_radius_mm: f64) -> Motion {
    let apart = target.rotation * from.rotation.conjugate();
    let apart = if apart.w < 0.0 { -apart } else { apart };
    let turn = apart.to_scaled_axis();
    let angle = turn.length();
    let turn = if angle > LONGEST_TURN {
        turn * (LONGEST_TURN / angle)
    } else {
        turn
    };
    Motion {
        shift: target.translation - from.translation,
        turn: turn * turning_radius_mm,
    }
}

fn moved(pose: &Pose, motion: &Motion, turning_radius_mm: f64) -> Pose {
    let turn = DQuat::from_scaled_axis(motion.turn / turning_radius_mm);
    Pose::new(
        (turn * pose.rotation).normalize(),
        pose.translation + motion.shift,
    )
}

impl Proxy {
    /// Forgets what it holds on to.
    pub fn release(&mut self) {
        self.contacts.release();
        self.guess = Motion::ZERO;
    }

    /// Goes to where the hand is, whatever is there.
    pub fn jump(&mut self, bone_from_device: &Pose) {
        self.bone_from_tool = *bone_from_device;
        self.release();
    }

    /// Depth, mm, of the deepest element at the present pose.
    pub fn deepest_mm(&mut self, around: &Surroundings<'_>) -> f64 {
        self.gather(around, 0.0);
        self.contacts.deepest_mm()
    }

    fn gather(&mut self, around: &Surroundings<'_>, omega_rad_s: f64) {
        let state = ToolState {
            tool: &around.tools[usize::from(around.tool)],
            bone_from_tool: self.bone_from_tool,
            omega_rad_s,
        };
        self.contacts
            .gather(around.bone, around.cut, &state, around.feel);
    }

    /// Follows the hand for one tick: at most [`MAX_SUBSTEPS`] steps, each of at most
    /// [`crate::contact::MAX_TERMS`] elements and [`crate::contact::MAX_ITERATIONS`] iterations.
    pub fn follow(&mut self, bone_from_device: &Pose, around: &mut Surroundings<'_>) -> Reaction {
        let mut reaction = Reaction::NONE;
        let mut time_s = around.feel.tick_s;
        reaction.overrun = true;
        for _ in 0..MAX_SUBSTEPS {
            if self.step(bone_from_device, around, &mut time_s, &mut reaction) {
                reaction.overrun = false;
                break;
            }
        }
        let feel = around.feel;
        let radius = feel.coupling.turning_radius_mm;
        let apart = error(bone_from_device, &self.bone_from_tool, radius);
        let spring = spring(feel, around.limit_n);
        reaction.force_n = -spring.pull(apart.shift);
        reaction.torque_nmm = -spring.pull(apart.turn) * radius;
        reaction.saturated = apart.shift.length() * spring.stiffness > spring.limit;
        // the hand has gone 1/scale of the way in the bone
        reaction.stored_mj = spring.energy(apart.shift.length()) / feel.motion_scale;
        reaction.touching = !self.contacts.is_free();
        if around.omega_rad_s > 0.0 {
            reaction.spindle_nmm += reaction.spindle_mj / (around.omega_rad_s * feel.tick_s);
            reaction.spindle_mj = reaction.spindle_nmm * around.omega_rad_s * feel.tick_s;
        }
        reaction
    }

    /// One step of at most half a voxel within what is left of the tick's time; true where the proxy has
    /// arrived, or is held by bone that there was no budget to carve.
    fn step(
        &mut self,
        target: &Pose,
        around: &mut Surroundings<'_>,
        time_s: &mut f64,
        reaction: &mut Reaction,
    ) -> bool {
        let feel = around.feel;
        let radius = feel.coupling.turning_radius_mm;
        let longest = 0.5 * around.bone.grid().spacing_mm.min_element();
        let tool = &around.tools[usize::from(around.tool)];
        let reach = tool.shape.bounds().radius_mm();
        self.gather(around, around.omega_rad_s);
        let room = longest * (radius / reach).max(1.0);
        let stiffness = spring(feel, around.limit_n).stiffness;
        let apart = error(target, &self.bone_from_tool, radius);
        let coupling = Coupling::new(apart, stiffness, around.limit_n, room);
        let solution = self.contacts.solve(&coupling, *time_s, &self.guess);
        reaction.iterations += solution.iterations;
        reaction.residual_n = reaction.residual_n.max(solution.residual_n);
        if !solution.motion.is_finite() {
            reaction.not_finite = true;
            self.guess = Motion::ZERO;
            return true;
        }
        self.guess = solution.motion;
        let way = solution.motion.shift.length() + solution.motion.turn.length() / radius * reach;
        let arrived = way <= longest;
        let share = if arrived { 1.0 } else { longest / way };
        let motion = solution.motion * share;
        let spent = *time_s * share;
        *time_s = (*time_s - spent).max(1e-3 * feel.tick_s);
        self.contacts.place(&motion, spent);
        let deed = self.contacts.terms().deed();
        if self.contacts.terms().advance_mm() > 2.0 * YIELD_EPS_MM {
            if around.carry.is_pending() {
                return true;
            }
            self.contacts.advance();
            reaction.hand_mj += deed.hand_mj;
            reaction.spindle_mj += deed.spindle_mj;
            self.advance(around, &motion, reaction);
        } else {
            let motion = self.contacts.terms().without_creep(motion);
            if motion != Motion::ZERO {
                self.contacts.slide();
            }
            self.bone_from_tool = moved(&self.bone_from_tool, &motion, radius);
        }
        reaction.spindle_nmm += deed.edge_nmm * (spent / feel.tick_s).min(1.0);
        reaction.vibration_n = deed.vibration_n;
        arrived || around.carry.is_pending()
    }

    /// Goes through bone: carves what it sweeps, as far as the budget reaches.
    fn advance(&mut self, around: &mut Surroundings<'_>, motion: &Motion, out: &mut Reaction) {
        let radius = around.feel.coupling.turning_radius_mm;
        let after = moved(&self.bone_from_tool, motion, radius);
        let step = CarveStep {
            tool: around.tool,
            before: self.bone_from_tool,
            after,
        };
        around
            .carry
            .begin(around.bone, around.cut, around.tools, step);
        self.bone_from_tool = after;
        out.carved[out.carved_len] = step;
        out.carved_len += 1;
    }
}

/// The coupling's spring in the bone: a hand whose motion is scaled up feels the declared stiffness.
fn spring(feel: &Feel, limit_n: f64) -> crate::contact::Saturating {
    crate::contact::Saturating {
        stiffness: feel.coupling.stiffness_n_per_mm / feel.motion_scale,
        limit: limit_n,
    }
}
