//! Feed under a constant push beside the law's closed form, and the ledgers of energy on the way.

use super::device::FINE;
use super::guided::Guided;
use super::setup::{Scene, Spec, ball, socket};
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::tissue::Tissue;
use osteon_sim_core::tool::Tool;
use rayon::prelude::*;
use serde::Serialize;

/// Pushes at a real tool, N.
pub const PUSHES_N: [f64; 3] = [20.0, 30.0, 50.0];
/// Densities, g/cm³.
pub const DENSITIES: [f64; 2] = [0.45, 1.9];
/// Slices of the quadrature over a face.
const SLICES: u32 = 20_000;

/// A tool whose face is known as a formula.
#[derive(Debug, Clone)]
pub struct Faced {
    /// The tool.
    pub tool: Tool,
    /// Radius of the face, mm.
    pub radius_mm: f64,
    /// How deep it stands in its socket so that the whole face is engaged, mm.
    pub depth_mm: f64,
    /// Radius of the ball that the face is a part of, mm, or the sine of a cone's half angle.
    form: Form,
}

#[derive(Debug, Clone, Copy)]
enum Form {
    Ball(f64),
    Cone(f64),
}

impl Faced {
    /// The peg drill.
    pub fn drill() -> Self {
        Self {
            tool: Tool::peg_drill(),
            radius_mm: 4.0,
            depth_mm: 3.0,
            form: Form::Cone(59f64.to_radians().sin()),
        }
    }

    /// The glenoid reamer.
    pub fn reamer() -> Self {
        Self {
            tool: Tool::glenoid_reamer(),
            radius_mm: 18.0,
            depth_mm: 6.5,
            form: Form::Ball(30.0),
        }
    }

    /// A ball of 3 mm.
    pub fn ball() -> Self {
        Self {
            tool: ball(3.0),
            radius_mm: 3.0,
            depth_mm: 3.0,
            form: Form::Ball(3.0),
        }
    }

    /// All of them.
    pub fn all() -> [Self; 3] {
        [Self::drill(), Self::reamer(), Self::ball()]
    }

    fn normal_z(&self, r: f64) -> f64 {
        match self.form {
            Form::Ball(radius) => (1.0 - (r / radius).powi(2)).max(0.0).sqrt(),
            Form::Cone(sine) => sine,
        }
    }

    fn over_face(&self, of: impl Fn(f64) -> f64) -> f64 {
        let step = self.radius_mm / f64::from(SLICES);
        (0..SLICES)
            .map(|n| of((f64::from(n) + 0.5) * step) * step)
            .sum()
    }

    /// Projected area, mm².
    pub fn area_mm2(&self) -> f64 {
        PI * self.radius_mm * self.radius_mm
    }

    /// `∫ n_z²/max(r, r_min) dA` over the face, mm: what the feed's resistance goes with.
    fn drag_mm(&self, law: &Law) -> f64 {
        let least = law.min_radius * self.radius_mm;
        self.over_face(|r| self.normal_z(r) * TAU * r / r.max(least))
    }

    /// ∫ r dA over the face, mm³: what the edges' torque goes with.
    fn moment_mm3(&self) -> f64 {
        self.over_face(|r| TAU * r * r / self.normal_z(r).max(1e-9))
    }
}

/// The law's numbers.
#[derive(Debug, Clone, Copy)]
pub struct Law {
    yield_n_per_mm2: f64,
    energy_n_per_mm2: f64,
    feed_ratio: f64,
    edge_friction: f64,
    min_radius: f64,
}

impl Law {
    /// For cancellous bone of a density, g/cm³.
    pub fn of(feel: &Feel, density: f64) -> Self {
        let material = feel.materials[Tissue::Cancellous as usize];
        let rho2 = density * density;
        Self {
            yield_n_per_mm2: material.yield_n_per_mm2 * rho2,
            energy_n_per_mm2: material.energy_n_per_mm2 * rho2,
            feed_ratio: feel.law.feed_ratio,
            edge_friction: feel.law.edge_friction,
            min_radius: feel.law.min_radius,
        }
    }

    /// Push, N at a real tool, below which the whole face does not bite.
    pub fn yield_n(&self, faced: &Faced) -> f64 {
        faced.area_mm2() * self.yield_n_per_mm2
    }

    /// `v(F) = (F − A p₁ρ²) ω/(λ u₁ρ² ∫ n_z²/r dA)`, mm/s.
    pub fn feed_mm_s(&self, faced: &Faced, push_n: f64, omega_rad_s: f64) -> f64 {
        let over = (push_n - self.yield_n(faced)).max(0.0);
        over * omega_rad_s / (self.feed_ratio * self.energy_n_per_mm2 * faced.drag_mm(self))
    }
}

/// Feed under a push.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FeedRow {
    /// Its id.
    pub tool: String,
    /// g/cm³.
    pub density: f64,
    /// At a real tool, N.
    pub push_n_physical: f64,
    /// Measured, mm/s.
    pub feed_mm_s: f64,
    /// By the closed form at the spindle's speed under this load, mm/s.
    pub closed_form_mm_s: f64,
    /// Measured over closed form, less 1; where the push is below yield, 0 if the tool stands.
    pub rel: f64,
    /// The spindle's speed, rad/s.
    pub omega_rad_s: f64,
}

/// Energy of a cut, from two sides each.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LedgerRow {
    /// Its id.
    pub tool: String,
    /// g/cm³.
    pub density: f64,
    /// At a real tool, N.
    pub push_n_physical: f64,
    /// Removed, mm³.
    pub removed_mm3: f64,
    /// The servo's sum over the elements, mJ at the stylus.
    pub hand_mj: f64,
    /// Coupling's force times the proxy's way, mJ.
    pub force_way_mj: f64,
    /// The one over the other, less 1.
    pub hand_rel: f64,
    /// The spindle's work, mJ at a real tool.
    pub spindle_mj: f64,
    /// u dV, mJ.
    pub cut_mj: f64,
    /// Work of the edges against their friction, by the closed form, mJ.
    pub edge_mj: f64,
    /// Spindle's work over cut and edges, less 1.
    pub spindle_rel: f64,
    /// The least work of the hand in a tick, mJ.
    pub least_hand_mj: f64,
}

/// A bone in which a tool already stands, spindle on or off, its device in the socket.
pub fn seated(faced: &Faced, density: f64, spindle: bool) -> (Guided, Spec) {
    seated_with(&Feel::default(), faced, density, spindle)
}

/// The same with a feel of one's own.
pub fn seated_with(feel: &Feel, faced: &Faced, density: f64, spindle: bool) -> (Guided, Spec) {
    let wide = 2.0 * faced.radius_mm + 5.0;
    let extent = DVec3::new(wide, wide, faced.depth_mm + 12.0);
    let scene = socket(&faced.tool, extent, faced.depth_mm, density, 0.5);
    seated_as(feel, scene, spindle)
}

/// A tool at the base frame's origin of a scene, in a socket of its own shape.
pub fn seated_in(scene: Scene, spindle: bool) -> (Guided, Spec) {
    seated_as(&Feel::default(), scene, spindle)
}

fn seated_as(feel: &Feel, scene: Scene, spindle: bool) -> (Guided, Spec) {
    let mut spec = Spec::at(scene);
    spec.feel = *feel;
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 10.0, spindle);
    guided.glide(DVec3::Z * 0.01, 40.0);
    (guided, spec)
}

/// A tool under a constant push in a bone of one density.
pub fn fed(faced: &Faced, density: f64, push_n_physical: f64) -> (FeedRow, LedgerRow) {
    fed_in(
        seated(faced, density, true),
        faced,
        density,
        push_n_physical,
    )
}

/// The same of a tool that stands in its bone already.
pub fn fed_in(
    (mut guided, spec): (Guided, Spec),
    faced: &Faced,
    density: f64,
    push_n_physical: f64,
) -> (FeedRow, LedgerRow) {
    let law = Law::of(&spec.feel, density);
    let push = push_n_physical * spec.feel.force_scale;
    guided.push_up_to(push, 0.1);
    let from = guided.proxy_mm().z;
    let mut ticks = 0;
    while ticks < 300 && from - guided.proxy_mm().z < 0.8 {
        guided.push(push);
        ticks += 1;
    }
    let before = guided.removed_mm3();
    (guided.hand_mj, guided.spindle_mj, guided.least_hand_mj) = (0.0, 0.0, 0.0);
    let (from, mut at) = (guided.proxy_mm().z, guided.proxy_mm());
    let (mut seconds, mut omega, mut way_mj) = (0.0, 0.0, 0.0);
    while seconds < 1.0 && from - at.z < 2.0 {
        guided.push(push);
        seconds += spec.feel.tick_s;
        omega += guided.output.spindle_rad_s * spec.feel.tick_s;
        way_mj += guided.coupling_n().dot(at - guided.proxy_mm());
        at = guided.proxy_mm();
    }
    let removed_mm3 = guided.removed_mm3() - before;
    let omega = omega / seconds;
    let feed = (from - at.z) / seconds;
    let closed = law.feed_mm_s(faced, push_n_physical, omega);
    let rel = if closed > 0.0 {
        feed / closed - 1.0
    } else {
        feed
    };
    let cut_mj = law.energy_n_per_mm2 * removed_mm3;
    let edge = law.edge_friction * law.yield_n_per_mm2 * faced.moment_mm3() * omega * seconds;
    let edge_mj = if feed > 0.0 { edge } else { 0.0 };
    let tool = faced.tool.id.clone();
    let ledger = LedgerRow {
        tool: tool.clone(),
        density,
        push_n_physical,
        removed_mm3,
        hand_mj: guided.hand_mj,
        force_way_mj: way_mj,
        hand_rel: ratio(guided.hand_mj, way_mj),
        spindle_mj: guided.spindle_mj,
        cut_mj,
        edge_mj,
        spindle_rel: ratio(guided.spindle_mj, cut_mj + edge_mj),
        least_hand_mj: guided.least_hand_mj,
    };
    let row = FeedRow {
        tool,
        density,
        push_n_physical,
        feed_mm_s: feed,
        closed_form_mm_s: closed,
        rel,
        omega_rad_s: omega,
    };
    (row, ledger)
}

fn ratio(a: f64, b: f64) -> f64 {
    if a.abs() < 1e-12 && b.abs() < 1e-9 {
        0.0
    } else {
        a / b - 1.0
    }
}

/// Every tool in every density under every push.
pub fn all_fed() -> Vec<(FeedRow, LedgerRow)> {
    let mut all = Vec::new();
    for faced in Faced::all() {
        for density in DENSITIES {
            all.extend(PUSHES_N.map(|push| (faced.clone(), density, push)));
        }
    }
    all.into_par_iter()
        .map(|(faced, density, push)| fed(&faced, density, push))
        .collect()
}
