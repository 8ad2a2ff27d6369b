//! Contact and cutting in one solve: the massless proxy's step.
//!
//! Each step minimises, over the proxy's shift δ and turn θ about the tool's origin (bone frame),
//!
//! ```text
//! U(|e − δ|) + U(|ε − ψ|) + Σ_i [ Y_i h(s_i) + V_i/2 · max(s_i, 0)² ]
//! ψ = r_g θ,   s_i = n_i·(δ + θ × r_i) + o_i
//! ```
//!
//! `e`, `ε` = what device and proxy differ by in place and turn (times `r_g`); `U` = the virtual
//! coupling, ½ K r² up to the force limit and linear beyond (so that a lag of 40 mm cuts no harder than
//! the limit that is shown); the sum runs over the tool's surface elements in reach. A cutting element is
//! a Bingham medium: yield force `Y`, viscous term `V` over the time of the step. A smooth one, or any
//! when the spindle stands, is rigid: `Y = 0`, `V` stiff, `o` the signed depth, `n` the bone's own normal.
//! Strictly convex, so one minimum (`contact/solve.rs` finds it).

mod coupling;
mod deepest;
mod law;
mod solve;
mod terms;

pub use coupling::{Coupling, Saturating};
pub use law::{Cutter, Resistance};
pub use solve::{MAX_ITERATIONS, RESIDUAL_N, Solution};
pub use terms::{Deed, MAX_TERMS, Motion, Term, Terms};

use crate::bone::Bone;
use crate::cut::Cut;
use crate::feel::{Feel, GripFeel};
use crate::pose::Pose;
use crate::sample::Sampler;
use crate::tool::{Element, Facet, Tool};
use deepest::Face;
use glam::{DMat3, DVec3};

/// Width of the regularised corner of the yield term, mm.
pub const YIELD_EPS_MM: f64 = 1e-6;
/// Stiffness of a rigid element per area, N/mm³.
pub const RIGID_N_PER_MM3: f64 = 1e4;
/// Elements farther out than this are not in reach of a step, voxels.
const OUTERMOST_VOXELS: f64 = -0.6;
/// A distance that is interpolated about a curved tool is off by up to this, voxels.
const FIELD_ERROR_VOXELS: f64 = 0.04;
/// Largest slope of an interpolated distance: 1 along each axis.
const STEEPEST: f64 = 1.733;
/// A spindle below this share of its full speed counts as standing.
pub const STANDING_SHARE: f64 = 0.1;
/// … and one that is slower than this, rad/s, whatever its full speed.
pub const STANDING_RAD_S: f64 = 0.1;

/// What an element met is read again after this way, voxels.
const STALE_VOXELS: f64 = 0.05;

/// What is remembered of an element. Ways are the odometer's readings, mm.
#[derive(Debug, Clone, Copy)]
struct Memory {
    // far outside the bone it needs no look before this
    sleeps_to_mm: f64,
    // inside the solid bone of the CT at least up to this
    inside_to_mm: f64,
    // density and class hold up to this
    met_to_mm: f64,
    density_g_cm3: f64,
    class: u8,
    gripping: bool,
    // it went into bone in the step that led here, so that bone is right before it
    cut_here: bool,
}

impl Memory {
    const NONE: Self = Self {
        sleeps_to_mm: 0.0,
        inside_to_mm: -1.0,
        met_to_mm: -1.0,
        density_g_cm3: 0.0,
        class: 0,
        gripping: false,
        cut_here: false,
    };
}

/// The elements in reach of the bone, and the memory of which cutting elements hold it. Allocates
/// only when made.
#[derive(Debug, Clone)]
pub struct Contacts {
    terms: Terms,
    // the element of each term
    element: Vec<u16>,
    memory: Vec<Memory>,
    deepest_mm: f64,
    // way of the tool's farthest point since the last release, mm, and where it was then
    odometer_mm: f64,
    last: Option<Pose>,
}

/// What a gathering looks with.
struct Look<'a> {
    sampler: Sampler<'a>,
    cutter: Cutter<'a>,
    grip: GripFeel,
    // mm; twice what the tool's faces are grown by when they are carved: right on a voxel the cut lies
    // ahead of the surface by that, and more where three voxels' errors meet
    ahead: f64,
    spacing_mm: f64,
    outermost: f64,
    turning_radius: f64,
    origin: DVec3,
    turn: DMat3,
}

/// The tool as the contact sees it.
#[derive(Debug, Clone, Copy)]
pub struct ToolState<'a> {
    /// The tool.
    pub tool: &'a Tool,
    /// Where the proxy holds it.
    pub bone_from_tool: Pose,
    /// Spindle speed, rad/s.
    pub omega_rad_s: f64,
}

impl ToolState<'_> {
    /// Whether it cuts: above [`STANDING_SHARE`] of full speed and [`STANDING_RAD_S`].
    pub fn turns(&self) -> bool {
        let full = self.tool.rpm * core::f64::consts::TAU / 60.0;
        self.omega_rad_s > (STANDING_SHARE * full).max(STANDING_RAD_S)
    }
}

impl Default for Contacts {
    fn default() -> Self {
        Self::new()
    }
}

impl Contacts {
    /// Room for every element of any tool.
    pub fn new() -> Self {
        Self {
            terms: Terms::new(),
            element: Vec::with_capacity(MAX_TERMS),
            memory: vec![Memory::NONE; MAX_TERMS],
            deepest_mm: f64::NEG_INFINITY,
            odometer_mm: 0.0,
            last: None,
        }
    }

    /// Forgets which elements hold the bone.
    pub fn release(&mut self) {
        self.memory.fill(Memory::NONE);
        self.element.clear();
        self.terms.clear();
        self.deepest_mm = f64::NEG_INFINITY;
        self.odometer_mm = 0.0;
        self.last = None;
    }

    /// True where no element is in reach of the bone.
    pub fn is_free(&self) -> bool {
        self.terms.is_empty()
    }

    /// What was gathered last.
    pub fn terms(&self) -> &Terms {
        &self.terms
    }

    /// Depth of the deepest element inside what is left of the bone, mm, of those that were looked at;
    /// negative outside.
    pub fn deepest_mm(&self) -> f64 {
        self.deepest_mm
    }

    /// Adds the way since the last gather: no point of the tool has gone farther.
    fn travel(&mut self, state: &ToolState<'_>) {
        let here = state.bone_from_tool;
        if let Some(last) = self.last {
            let shift = (here.translation - last.translation).length();
            let turn = here.rotation * last.rotation.conjugate();
            let chord = 2.0 * turn.xyz().length();
            self.odometer_mm += shift + chord * state.tool.shape.bounds().radius_mm();
        }
        self.last = Some(here);
    }

    /// Finds the elements (at most [`MAX_TERMS`]) that a step of half the smallest spacing could bring into
    /// contact. An element that is farther out than the tool has travelled since is not looked at: bone
    /// never comes nearer, and the slope of an interpolated distance is at most √3. One that has just gone
    /// into bone, deep inside the CT's, has bone right before it: only there could a look say otherwise.
    pub fn gather(&mut self, bone: &Bone, cut: &Cut, state: &ToolState<'_>, feel: &Feel) {
        self.terms.clear();
        self.element.clear();
        self.deepest_mm = f64::NEG_INFINITY;
        self.travel(state);
        let sampler = Sampler::new(bone, cut);
        let h = bone.grid().spacing_mm.min_element();
        let look = Look {
            sampler,
            cutter: Cutter::new(sampler, h, state, feel),
            grip: feel.grip,
            ahead: 2.0 * state.tool.shape.grown_mm(bone.grid()),
            spacing_mm: h,
            outermost: OUTERMOST_VOXELS * h,
            turning_radius: feel.coupling.turning_radius_mm,
            origin: state.bone_from_tool.translation,
            turn: DMat3::from_quat(state.bone_from_tool.rotation),
        };
        let turns = state.turns();
        let mut creases = deepest::CREASES;
        for (i, e) in state.tool.elements.iter().take(MAX_TERMS).enumerate() {
            if self.odometer_mm < self.memory[i].sleeps_to_mm {
                continue;
            }
            let facet = state.tool.facets.get(i).unwrap_or(&Facet::POINT);
            let term = if turns && e.cutting {
                self.cutting(i, e, facet, &look)
            } else {
                self.rigid(i, e, facet, &look, &mut creases)
            };
            if let Some(term) = term {
                self.terms.push(&term);
                self.element.push(u16::try_from(i).unwrap_or(u16::MAX));
            }
        }
    }

    /// Depth of an element, mm; `None` where it is so far outside that it may sleep.
    fn depth(&mut self, i: usize, p: DVec3, facet: &Facet, look: &Look<'_>) -> Option<f64> {
        let memory = &mut self.memory[i];
        memory.cut_here = false;
        let (solid, cut) = look.sampler.both(p);
        let depth = f64::from(solid.min(cut));
        memory.inside_to_mm = self.odometer_mm + f64::from(solid) / STEEPEST;
        self.deepest_mm = self.deepest_mm.max(depth);
        let asleep = look.outermost - f64::from(facet.reach_mm());
        if depth < asleep {
            memory.gripping = false;
            memory.sleeps_to_mm = self.odometer_mm + (asleep - depth) / STEEPEST;
            return None;
        }
        Some(depth)
    }

    /// A cutting element of a tool that turns.
    fn cutting(&mut self, i: usize, e: &Element, facet: &Facet, look: &Look<'_>) -> Option<Term> {
        let arm = look.turn * e.position.as_dvec3();
        let p = look.origin + arm;
        let known = &self.memory[i];
        let mut gap = 0.0;
        if !(known.cut_here && self.odometer_mm < known.inside_to_mm) {
            let depth = self.depth(i, p, facet, look)?;
            let memory = &mut self.memory[i];
            if depth < look.outermost {
                memory.gripping = false;
                return None;
            }
            // the clearance has hysteresis; a cut may lie ahead of its tool
            let factor = if memory.gripping {
                look.grip.release
            } else {
                1.0
            };
            memory.gripping = -depth < factor * look.grip.take_mm + look.ahead;
            gap = if memory.gripping { 0.0 } else { -depth };
        }
        let normal = look.turn * e.normal.as_dvec3();
        let memory = &mut self.memory[i];
        if self.odometer_mm >= memory.met_to_mm {
            (memory.density_g_cm3, memory.class) = look.cutter.met(p, normal);
            memory.met_to_mm = self.odometer_mm + STALE_VOXELS * look.spacing_mm;
        }
        let radius = f64::from(e.radius_mm);
        let law = look.cutter.of(memory.density_g_cm3, memory.class, radius);
        Some(Term {
            normal,
            lever: arm.cross(normal) / look.turning_radius,
            offset: -gap,
            cut: Some((f64::from(e.area_mm2), law)),
            rigid: 0.0,
        })
    }

    /// A smooth element, or any of a tool that stands.
    fn rigid(
        &mut self,
        i: usize,
        e: &Element,
        facet: &Facet,
        look: &Look<'_>,
        creases: &mut u32,
    ) -> Option<Term> {
        let origin = look.origin + look.turn * e.position.as_dvec3();
        self.depth(i, origin, facet, look)?;
        self.memory[i].gripping = false;
        let face = Face {
            sampler: look.sampler,
            facet,
            origin,
            along: look.turn * facet.along.as_dvec3(),
            across: look.turn * e.normal.cross(facet.along).as_dvec3(),
            normal: look.turn * e.normal.as_dvec3(),
        };
        let middle = face.middle();
        if !face.may_reach(&middle, look.outermost) {
            return None;
        }
        let spot = face.deepest(middle, creases);
        let (push, share) = face.push(&spot);
        let steepness = push.length();
        // in a socket of its own shape a facet is everywhere as deep but for the field's own error, which
        // would press from all sides
        let depth = middle
            .depth
            .max(spot.depth - FIELD_ERROR_VOXELS * look.spacing_mm);
        if depth < look.outermost || steepness <= 1e-3 || share <= 0.0 {
            return None;
        }
        let normal = push / steepness;
        let arm = face.point(&spot) - look.origin;
        Some(Term {
            normal,
            lever: arm.cross(normal) / look.turning_radius,
            offset: (depth / steepness).clamp(-look.spacing_mm, look.spacing_mm),
            cut: None,
            rigid: share * f64::from(e.area_mm2) * RIGID_N_PER_MM3,
        })
    }

    /// Places the terms after a motion within a time, s: what [`Terms::deed`] and [`Terms::advance_mm`] are
    /// about.
    pub fn place(&mut self, motion: &Motion, time_s: f64) {
        self.terms.set_time(time_s);
        self.terms.place(motion);
    }

    /// The tool makes the motion that the terms are placed after; elements that go into bone have bone before
    /// them then.
    pub fn advance(&mut self) {
        for (term, &i) in self.element.iter().enumerate() {
            self.memory[usize::from(i)].cut_here = self.terms.cuts(term, 2.0 * YIELD_EPS_MM);
        }
    }

    /// The tool goes elsewhere without cutting.
    pub fn slide(&mut self) {
        for &i in &self.element {
            self.memory[usize::from(i)].cut_here = false;
        }
    }

    /// The proxy's motion towards the device within `time_s`; all of the way where nothing
    /// is in reach.
    pub fn solve(&mut self, coupling: &Coupling, time_s: f64, guess: &Motion) -> Solution {
        if self.terms.is_empty() {
            return Solution {
                motion: coupling.error,
                iterations: 0,
                residual_n: 0.0,
            };
        }
        self.terms.set_time(time_s);
        solve::minimum(&mut self.terms, coupling, guess)
    }
}
