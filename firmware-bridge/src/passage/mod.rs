//! Passages: how long a tool's tip takes through each tissue along the planned axis, and what the hand
//! feels there. Kept by the publisher from the servo's records; the servo knows nothing of it.

mod expected;
mod layers;

pub use expected::expected_s;
pub use layers::{Layer, Layers, TIMED_MM};

use crate::haptics::record::TickRecord;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use serde::Serialize;

/// A tip farther than this from the planned axis is not in the layers along it, mm.
const OFF_AXIS_MM: f64 = 3.0;
/// A tool is reported once its tip has come this near to the bone on the axis, mm.
const NEAR_MM: f64 = 1.0;
/// The tip has entered the first layer this far in front of it, mm: a standing tool rests there.
const TOUCH_MM: f64 = 0.1;

/// One layer and one tool, as reported.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Passage {
    /// The tool's id.
    pub tool: String,
    /// Tissue class.
    pub tissue: &'static str,
    /// Where the layer begins, mm along the planned axis below the bone's surface.
    pub from_mm: f64,
    /// Where it ends, or where its timing ends ([`TIMED_MM`]).
    pub to_mm: f64,
    /// From the tip's entry to its exit, s; `None` where it was not passed.
    pub seconds: Option<f64>,
    /// How long the tip has been in it, s; `None` where it was not entered.
    pub inside_s: Option<f64>,
    /// How deep the tip came, mm below the bone's surface, this layer's end at most; `None` where it
    /// was not entered.
    pub reached_mm: Option<f64>,
    /// Mean force at the stylus while the tip was in it, N.
    pub mean_force_n: Option<f64>,
    /// Largest one, N.
    pub peak_force_n: Option<f64>,
}

/// The account of one layer and one tool.
#[derive(Debug, Clone, Copy, Default)]
struct Crossing {
    entered_ms: Option<u64>,
    passed_ms: Option<u64>,
    deepest_mm: f64,
    ticks: u32,
    force_sum_n: f64,
    peak_n: f64,
}

/// The account of one tool.
#[derive(Debug, Clone, Default)]
struct Account {
    near: bool,
    crossings: Vec<Crossing>,
}

/// The account of a session. A reset begins it anew.
#[derive(Debug)]
pub(crate) struct Passages {
    layers: Layers,
    plan_from_bone: Pose,
    tools: Vec<Account>,
    epoch: u32,
    skipped: u64,
}

impl Passages {
    pub(crate) fn new(layers: Layers, plan_from_bone: Pose, tools: usize) -> Self {
        let account = Account {
            near: false,
            crossings: vec![Crossing::default(); layers.layers.len()],
        };
        Self {
            layers,
            plan_from_bone,
            tools: vec![account; tools],
            epoch: 0,
            skipped: 0,
        }
    }

    /// Takes one tick into account. Time is counted in periods of the servo, skipped ones included.
    pub(crate) fn add(&mut self, tick: &TickRecord) {
        self.skipped += tick.skipped;
        if tick.epoch != self.epoch {
            self.epoch = tick.epoch;
            for account in &mut self.tools {
                account.near = false;
                account.crossings.fill(Crossing::default());
            }
        }
        // without contact the tool is wherever the hand is
        if tick.flags.waiting || tick.flags.embedded || tick.flags.paused {
            return;
        }
        let tip = self.plan_from_bone.point(tick.bone_from_tool.translation);
        let depth = self.layers.surface_mm - tip.z;
        let Some(account) = self.tools.get_mut(usize::from(tick.tool)) else {
            return;
        };
        if tip.truncate().length() > OFF_AXIS_MM || depth < -NEAR_MM {
            return;
        }
        account.near = true;
        let now = tick.tick + self.skipped;
        let force = tick.force_n.length();
        for (layer, crossing) in self.layers.layers.iter().zip(&mut account.crossings) {
            let inside = depth >= layer.from_mm - TOUCH_MM;
            if crossing.passed_ms.is_some() {
                continue;
            }
            if !inside {
                break;
            }
            crossing.feel(now, depth.min(layer.to_mm), force);
            if depth < layer.to_mm {
                break;
            }
            crossing.passed_ms = Some(now);
        }
    }

    /// What there is to say of every tool that has come near, layer by layer.
    pub(crate) fn report(&self, tools: &[Tool]) -> Vec<Passage> {
        let near = tools.iter().zip(&self.tools).filter(|(_, a)| a.near);
        near.flat_map(|(tool, account)| {
            let both = self.layers.layers.iter().zip(&account.crossings);
            both.map(|(layer, crossing)| crossing.report(&tool.id, layer))
        })
        .collect()
    }
}

impl Crossing {
    fn feel(&mut self, now: u64, depth: f64, force: f64) {
        self.entered_ms.get_or_insert(now);
        self.deepest_mm = self.deepest_mm.max(depth);
        self.ticks += 1;
        self.force_sum_n += force;
        self.peak_n = self.peak_n.max(force);
    }

    fn report(&self, tool: &str, layer: &Layer) -> Passage {
        let entered = self.entered_ms.is_some();
        let seconds = self.entered_ms.zip(self.passed_ms);
        Passage {
            tool: tool.to_owned(),
            tissue: layer.tissue.name(),
            from_mm: layer.from_mm,
            to_mm: layer.to_mm,
            seconds: seconds.map(|(from, to)| (to - from) as f64 * 1e-3),
            inside_s: entered.then(|| f64::from(self.ticks) * 1e-3),
            reached_mm: entered.then_some(self.deepest_mm),
            mean_force_n: entered.then(|| self.force_sum_n / f64::from(self.ticks.max(1))),
            peak_force_n: entered.then_some(self.peak_n),
        }
    }
}

#[cfg(test)]
mod tests;
