//! Contact and cutting in one solve: the massless proxy's step.
//!
//! Each tick minimises, over the proxy's translation δ (bone frame, mm),
//!
//! ```text
//! U(|e − δ|) + Σ_i [ Y_i h(s_i) + V_i/2 · max(s_i, 0)² ],   s_i = n_i·δ + o_i
//! ```
//!
//! `e` = device − proxy; `U` = the virtual coupling, ½ K r² up to the force limit and linear beyond
//! (so that a lag of 40 mm cuts no harder than the limit that is shown); the sum runs over the
//! tool's surface elements in reach. A cutting element is a Bingham medium: yield force `Y`, viscous
//! term `V` over one tick. A smooth one, or any when the spindle stands, is rigid: `Y = 0`, `V`
//! stiff, `o` the signed depth, `n` the bone's own normal. Strictly convex, so one minimum;
//! semi-smooth Newton with Armijo steps finds it.

use crate::bone::Bone;
use crate::cut::Cut;
use crate::pose::Pose;
use crate::sample::{density_hu, fields};
use crate::tissue::density_g_cm3;
use crate::tool::{MAX_ELEMENTS, Tool};
use glam::{DMat3, DVec3};

/// Width of the regularised corner of the yield term, mm.
pub const YIELD_EPS_MM: f64 = 1e-6;
/// Stiffness of a rigid element per area and tick, N/mm³.
const RIGID_N_PER_MM3: f64 = 1e4;
/// Newton iterations at most.
pub const MAX_ITERATIONS: u32 = 60;
/// Accepted residual, N.
const RESIDUAL_N: f64 = 1e-5;
/// A cutting element takes hold below this gap and lets go above four times it, mm: wider than the
/// stored distance's unit, so that quantisation cannot chatter. Both grow by twice what the tool's
/// faces are grown by when they are carved ([`crate::tool::Shape::grown_mm`]): right on a voxel the cut
/// lies ahead of the surface by that, and more where three voxels' errors meet.
const GRIP_MM: f64 = 1e-3;

/// Constants of the coupling and of the cutting law (`sim-core` units: mm, N, s, g/cm³).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactConfig {
    /// Stiffness of the virtual coupling, N/mm.
    pub stiffness_n_per_mm: f64,
    /// Newtons at the stylus per newton at a real tool.
    pub force_scale: f64,
    /// Yield pressure at 1 g/cm³, N/mm².
    pub yield_n_per_mm2: f64,
    /// Specific cutting energy at 1 g/cm³, N/mm² (= mJ/mm³).
    pub energy_n_per_mm2: f64,
    /// Share of the tangential traction that also resists the feed.
    pub feed_ratio: f64,
    /// Smallest effective radius as a share of the tool's, for the centre that hardly moves.
    pub min_radius: f64,
    /// Length of a tick, s.
    pub tick_s: f64,
}

impl Default for ContactConfig {
    fn default() -> Self {
        Self {
            stiffness_n_per_mm: 0.5,
            force_scale: 0.03,
            yield_n_per_mm2: 0.005,
            energy_n_per_mm2: 40.0,
            feed_ratio: 1.0,
            min_radius: 0.1,
            tick_s: 1e-3,
        }
    }
}

/// One element's term in the minimisation.
#[derive(Debug, Clone, Copy)]
struct Term {
    normal: DVec3,
    // s = normal·δ + offset, mm
    offset: f64,
    // Y, N
    yield_n: f64,
    // V, N/mm
    viscous: f64,
}

/// The elements in reach of the bone, and the memory of which cutting elements hold it. Allocates
/// only when made.
#[derive(Debug, Clone)]
pub struct Contacts {
    terms: Vec<Term>,
    gripping: Vec<bool>,
    deepest_mm: f64,
}

/// The tool as the contact sees it.
#[derive(Debug, Clone, Copy)]
pub struct ToolState<'a> {
    /// The tool.
    pub tool: &'a Tool,
    /// Where the proxy holds it.
    pub bone_from_tool: Pose,
    /// Spindle speed, rad/s; at most a tenth of full speed counts as standing.
    pub omega_rad_s: f64,
}

/// Result of one solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// Step of the proxy, mm.
    pub delta: DVec3,
    /// Newton iterations.
    pub iterations: u32,
    /// Length of the gradient where it stopped, N.
    pub residual_n: f64,
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
            terms: Vec::with_capacity(MAX_ELEMENTS),
            gripping: vec![false; MAX_ELEMENTS],
            deepest_mm: f64::NEG_INFINITY,
        }
    }

    /// Forgets which elements hold the bone.
    pub fn release(&mut self) {
        self.gripping.fill(false);
        self.terms.clear();
        self.deepest_mm = f64::NEG_INFINITY;
    }

    /// True where no element is in reach of the bone.
    pub fn is_free(&self) -> bool {
        self.terms.is_empty()
    }

    /// Depth of the deepest element inside what is left of the bone, mm; negative outside.
    pub fn deepest_mm(&self) -> f64 {
        self.deepest_mm
    }

    /// Reads the fields at every element of the tool (at most [`MAX_ELEMENTS`]) and keeps those that
    /// a step of half the smallest spacing could bring into contact.
    pub fn gather(
        &mut self,
        bone: &Bone,
        cut: &Cut,
        state: &ToolState<'_>,
        config: &ContactConfig,
    ) {
        self.terms.clear();
        self.deepest_mm = f64::NEG_INFINITY;
        let h = bone.grid().spacing_mm.min_element();
        let ahead = 2.0 * state.tool.shape.grown_mm(bone.grid());
        let full = state.tool.rpm * core::f64::consts::TAU / 60.0;
        let turning = state.omega_rad_s > 0.1 * full;
        for (i, e) in state.tool.elements.iter().take(MAX_ELEMENTS).enumerate() {
            let p = state.bone_from_tool.point(e.position.as_dvec3());
            let f = fields(bone, cut, p);
            let depth = f64::from(f.depth());
            self.deepest_mm = self.deepest_mm.max(depth);
            if depth < -0.6 * h {
                self.gripping[i] = false;
                continue;
            }
            let area = f64::from(e.area_mm2);
            if turning && e.cutting {
                let normal = state.bone_from_tool.vector(e.normal.as_dvec3());
                let gap = self.gap(i, depth, ahead);
                let law = cutting_law(bone, p, normal, f64::from(e.radius_mm), state, config);
                self.terms.push(Term {
                    normal,
                    offset: -gap,
                    yield_n: area * law.0,
                    viscous: area * law.1,
                });
            } else {
                self.gripping[i] = false;
                let gradient = f.gradient.as_dvec3();
                let steepness = gradient.length();
                if steepness > 1e-3 {
                    self.terms.push(Term {
                        normal: gradient / steepness,
                        offset: (depth / steepness).clamp(-h, h),
                        yield_n: 0.0,
                        viscous: area * RIGID_N_PER_MM3,
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

    fn energy(&self, coupling: &Coupling, delta: DVec3) -> f64 {
        let mut sum = coupling.energy(delta);
        for t in &self.terms {
            let s = t.normal.dot(delta) + t.offset;
            if s > 0.0 {
                let corner = if s < YIELD_EPS_MM {
                    0.5 * s * s / YIELD_EPS_MM
                } else {
                    s - 0.5 * YIELD_EPS_MM
                };
                sum += t.yield_n * corner + 0.5 * t.viscous * s * s;
            }
        }
        sum
    }

    fn derivatives(&self, coupling: &Coupling, delta: DVec3) -> (DVec3, DMat3) {
        let (mut gradient, mut hessian) = coupling.derivatives(delta);
        for t in &self.terms {
            let s = t.normal.dot(delta) + t.offset;
            if s > 0.0 {
                let (slope, curvature) = if s < YIELD_EPS_MM {
                    (s / YIELD_EPS_MM, 1.0 / YIELD_EPS_MM)
                } else {
                    (1.0, 0.0)
                };
                gradient += t.normal * (t.yield_n * slope + t.viscous * s);
                hessian += outer(t.normal, t.yield_n * curvature + t.viscous);
            }
        }
        (gradient, hessian)
    }

    /// The proxy's step towards the device: `error_mm` = device − proxy. At most
    /// [`MAX_ITERATIONS`]; a step longer than `longest_mm` is cut back along its direction (the
    /// caller goes on from there).
    pub fn solve(&self, error_mm: DVec3, limit_n: f64, config: &ContactConfig) -> Solution {
        let coupling = Coupling {
            error: error_mm,
            stiffness: config.stiffness_n_per_mm,
            limit: limit_n.max(0.05),
        };
        if self.terms.is_empty() {
            return Solution {
                delta: error_mm,
                iterations: 0,
                residual_n: 0.0,
            };
        }
        let mut delta = DVec3::ZERO;
        let mut energy = self.energy(&coupling, delta);
        let mut iterations = 0;
        let mut residual_n;
        loop {
            let (gradient, hessian) = self.derivatives(&coupling, delta);
            residual_n = gradient.length();
            if residual_n < RESIDUAL_N || iterations == MAX_ITERATIONS {
                break;
            }
            iterations += 1;
            let Some(step) = newton_step(&hessian, gradient) else {
                break;
            };
            let slope = gradient.dot(step);
            let mut t = 1.0;
            let mut next = energy;
            while t > 1e-9 {
                next = self.energy(&coupling, delta + step * t);
                if next <= energy + 1e-4 * t * slope {
                    break;
                }
                t *= 0.5;
            }
            if next >= energy {
                break; // round-off floor
            }
            delta += step * t;
            energy = next;
        }
        Solution {
            delta,
            iterations,
            residual_n,
        }
    }

    /// The longest way, mm, that a gripping cutting element goes into bone on a step `delta`.
    pub fn advance_mm(&self, delta: DVec3) -> f64 {
        self.terms
            .iter()
            .filter(|t| t.yield_n > 0.0)
            .map(|t| t.normal.dot(delta) + t.offset)
            .fold(0.0, f64::max)
    }

    /// A step below yield without the regularised corner's creep: components into gripped bone are
    /// taken out, so that the proxy sticks exactly.
    pub fn without_creep(&self, delta: DVec3) -> DVec3 {
        if delta.length() <= 4.0 * YIELD_EPS_MM {
            return DVec3::ZERO;
        }
        let mut d = delta;
        for _ in 0..3 {
            for t in self.terms.iter().filter(|t| t.yield_n > 0.0) {
                let s = t.normal.dot(d) + t.offset;
                if s > 0.0 {
                    d -= t.normal * s;
                }
            }
        }
        d
    }
}

/// Yield pressure (N/mm²) and viscous coefficient per tick (N/mm³) at an element, at the stylus.
/// The density is read ahead of the surface, from the bone as it was, so that a cut that lags by a
/// tick changes nothing.
fn cutting_law(
    bone: &Bone,
    p: DVec3,
    normal: DVec3,
    radius_mm: f64,
    state: &ToolState<'_>,
    config: &ContactConfig,
) -> (f64, f64) {
    let h = bone.grid().spacing_mm.min_element();
    let mut density = 0.0;
    let mut count = 0.0;
    for ahead in [0.75, 1.25] {
        if let Some(hu) = density_hu(bone, p + normal * (ahead * h)) {
            density += density_g_cm3(f64::from(hu));
            count += 1.0;
        }
    }
    if count == 0.0 {
        density = density_g_cm3(f64::from(density_hu(bone, p).unwrap_or(-1000.0)));
        count = 1.0;
    }
    let rho2 = (density / count) * (density / count);
    let smallest = config.min_radius * state.tool.shape.bounds().reach_mm();
    let speed = state.omega_rad_s * radius_mm.max(smallest);
    let viscous = config.feed_ratio * config.energy_n_per_mm2 * rho2 / (speed * config.tick_s);
    (
        config.force_scale * config.yield_n_per_mm2 * rho2,
        // a spindle that hardly turns is a rigid tool
        (config.force_scale * viscous).min(RIGID_N_PER_MM3),
    )
}

/// The virtual coupling between device and proxy.
#[derive(Debug, Clone, Copy)]
struct Coupling {
    error: DVec3,
    stiffness: f64,
    limit: f64,
}

impl Coupling {
    fn energy(&self, delta: DVec3) -> f64 {
        let r = (self.error - delta).length();
        let knee = self.limit / self.stiffness;
        if r <= knee {
            0.5 * self.stiffness * r * r
        } else {
            self.limit * (r - 0.5 * knee)
        }
    }

    fn derivatives(&self, delta: DVec3) -> (DVec3, DMat3) {
        let v = self.error - delta;
        let r = v.length();
        if r * self.stiffness <= self.limit {
            return (
                v * -self.stiffness,
                DMat3::from_diagonal(DVec3::splat(self.stiffness)),
            );
        }
        let unit = v / r;
        let across = self.limit / r;
        // flat along the pull: a thousandth of K keeps the matrix regular and leaves the minimum
        let hessian = DMat3::from_diagonal(DVec3::splat(across))
            + outer(unit, 1e-3 * self.stiffness - across);
        (unit * -self.limit, hessian)
    }
}

fn outer(n: DVec3, weight: f64) -> DMat3 {
    DMat3::from_cols(n * (n.x * weight), n * (n.y * weight), n * (n.z * weight))
}

// −H⁻¹ g; at most 1 mm long (a trust region for the flat part of the coupling)
fn newton_step(hessian: &DMat3, gradient: DVec3) -> Option<DVec3> {
    let step = -(hessian.inverse() * gradient);
    if !step.is_finite() {
        return None;
    }
    let length = step.length();
    Some(if length > 1.0 { step / length } else { step })
}

/// Force on the hand, N, bone frame: the coupling's pull from the device towards the proxy, limited
/// to `limit_n`.
pub fn coupling_force(error_mm: DVec3, limit_n: f64, config: &ContactConfig) -> DVec3 {
    let pull = -error_mm * config.stiffness_n_per_mm;
    let length = pull.length();
    if length > limit_n {
        pull * (limit_n / length)
    } else {
        pull
    }
}
