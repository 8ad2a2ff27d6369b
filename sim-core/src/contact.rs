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
mod law;
mod solve;
mod terms;

pub use coupling::{Coupling, Saturating};
pub use law::{Cutter, Resistance};
pub use solve::{MAX_ITERATIONS, RESIDUAL_N, Solution};
pub use terms::{Deed, MAX_TERMS, Motion, Term, Terms};

use crate::bone::Bone;
use crate::cut::Cut;
use crate::feel::Feel;
use crate::pose::Pose;
use crate::sample::Sampler;
use crate::tool::Tool;
use glam::DMat3;

/// Width of the regularised corner of the yield term, mm.
pub const YIELD_EPS_MM: f64 = 1e-6;
/// Stiffness of a rigid element per area, N/mm³.
pub const RIGID_N_PER_MM3: f64 = 1e4;
/// A cutting element takes hold below this gap and lets go above four times it, mm: wider than the
/// stored distance's unit, so that quantisation cannot chatter. Both grow by twice what the tool's
/// faces are grown by when they are carved ([`crate::tool::Shape::grown_mm`]): right on a voxel the cut
/// lies ahead of the surface by that, and more where three voxels' errors meet.
const GRIP_MM: f64 = 1e-3;
/// Largest slope of an interpolated distance: 1 along each axis.
const STEEPEST: f64 = 1.733;
/// A spindle below this share of its full speed counts as standing.
pub const STANDING_SHARE: f64 = 0.1;
/// … and one that is slower than this, rad/s, whatever its full speed.
pub const STANDING_RAD_S: f64 = 0.1;

/// The elements in reach of the bone, and the memory of which cutting elements hold it. Allocates
/// only when made.
#[derive(Debug, Clone)]
pub struct Contacts {
    terms: Terms,
    gripping: Vec<bool>,
    deepest_mm: f64,
    // way of the tool's farthest point since the last release, mm, and where it was then
    odometer_mm: f64,
    last: Option<Pose>,
    // an element far outside needs no look before the odometer reads this
    sleeps_to_mm: Vec<f64>,
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
            gripping: vec![false; MAX_TERMS],
            deepest_mm: f64::NEG_INFINITY,
            odometer_mm: 0.0,
            last: None,
            sleeps_to_mm: vec![0.0; MAX_TERMS],
        }
    }

    /// Forgets which elements hold the bone.
    pub fn release(&mut self) {
        self.gripping.fill(false);
        self.terms.clear();
        self.deepest_mm = f64::NEG_INFINITY;
        self.odometer_mm = 0.0;
        self.last = None;
        self.sleeps_to_mm.fill(0.0);
    }

    /// True where no element is in reach of the bone.
    pub fn is_free(&self) -> bool {
        self.terms.is_empty()
    }

    /// What was gathered last.
    pub fn terms(&self) -> &Terms {
        &self.terms
    }

    /// Depth of the deepest element inside what is left of the bone, mm; negative outside.
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

    /// Reads the fields at every element of the tool (at most [`MAX_TERMS`]) and keeps those that
    /// a step of half the smallest spacing could bring into contact. An element that is farther out than
    /// the tool has travelled since is not looked at: bone never comes nearer, and the slope of an
    /// interpolated distance is at most √3.
    pub fn gather(&mut self, bone: &Bone, cut: &Cut, state: &ToolState<'_>, feel: &Feel) {
        self.terms.clear();
        self.deepest_mm = f64::NEG_INFINITY;
        let h = bone.grid().spacing_mm.min_element();
        let ahead = 2.0 * state.tool.shape.grown_mm(bone.grid());
        self.travel(state);
        let sampler = Sampler::new(bone, cut);
        let cutter = Cutter::new(sampler, h, state, feel);
        let outermost = -0.6 * h;
        let turning_radius = feel.coupling.turning_radius_mm;
        let turns = state.turns();
        let turn = DMat3::from_quat(state.bone_from_tool.rotation);
        for (i, e) in state.tool.elements.iter().take(MAX_TERMS).enumerate() {
            if self.odometer_mm < self.sleeps_to_mm[i] {
                continue;
            }
            let arm = turn * e.position.as_dvec3();
            let p = state.bone_from_tool.translation + arm;
            let depth = f64::from(sampler.depth(p));
            self.deepest_mm = self.deepest_mm.max(depth);
            if depth < outermost {
                self.gripping[i] = false;
                self.sleeps_to_mm[i] = self.odometer_mm + (outermost - depth) / STEEPEST;
                continue;
            }
            let area = f64::from(e.area_mm2);
            if turns && e.cutting {
                let normal = turn * e.normal.as_dvec3();
                let gap = self.gap(i, depth, ahead);
                let law = cutter.resistance(p, normal, f64::from(e.radius_mm));
                self.terms.push(&Term {
                    normal,
                    lever: arm.cross(normal) / turning_radius,
                    offset: -gap,
                    cut: Some((area, law)),
                    rigid: 0.0,
                });
            } else {
                self.gripping[i] = false;
                let gradient = sampler.fields(p).gradient.as_dvec3();
                let steepness = gradient.length();
                if steepness > 1e-3 {
                    let normal = gradient / steepness;
                    self.terms.push(&Term {
                        normal,
                        lever: arm.cross(normal) / turning_radius,
                        offset: (depth / steepness).clamp(-h, h),
                        cut: None,
                        rigid: area * RIGID_N_PER_MM3,
                    });
                }
            }
        }
    }

    // clearance of cutting element i, mm, with hysteresis; a cut may lie `ahead` of its tool
    fn gap(&mut self, i: usize, depth: f64, ahead: f64) -> f64 {
        let grip = if self.gripping[i] {
            4.0 * GRIP_MM
        } else {
            GRIP_MM
        };
        self.gripping[i] = -depth < grip + ahead;
        if self.gripping[i] { 0.0 } else { -depth }
    }

    /// Sets the time, s, that [`Terms::deed`] counts with.
    pub fn set_time(&mut self, time_s: f64) {
        self.terms.set_time(time_s);
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
