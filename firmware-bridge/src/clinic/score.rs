//! Score bands over metrics, as data; and a session's numbers as they are filed.

use super::ClinicError;
use super::session::{Played, tool_axis};
use super::target::Target;
use osteon_sim_core::metrics::Metric;
use osteon_sim_core::metrics::process::{Event, events, metrics};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The built-in bands' file.
pub const STANDARD: &str = include_str!("../../components/bands.toml");

/// A band: within `good` of the plan is good, within `acceptable` acceptable, beyond poor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Band {
    /// The metric's name.
    pub metric: String,
    /// How a value is compared.
    pub by: By,
    /// Limit of what is good.
    pub good: f64,
    /// Limit of what is acceptable.
    pub acceptable: f64,
}

/// How a value is compared with a band.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// Its distance from the plan, at most.
    Difference,
    /// Itself, at most.
    AtMost,
    /// Itself, at least.
    AtLeast,
}

/// Bands with where they are from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bands {
    /// Where they are from, shown with every score.
    pub source: String,
    /// Whether they were validated; the built-in ones were not.
    pub validated: bool,
    /// A real tool's force above which time is counted, N.
    pub force_limit_n: f64,
    /// One a metric.
    pub band: Vec<Band>,
}

/// A verdict on one metric.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Within the inner band.
    Good,
    /// Within the outer one.
    Acceptable,
    /// Beyond.
    Poor,
}

impl Bands {
    /// Bands of a file, or the built-in ones.
    pub fn load(path: Option<&Path>) -> Result<Self, ClinicError> {
        let refuse = |problem: String| ClinicError::File {
            path: path.unwrap_or(Path::new("bands.toml")).to_path_buf(),
            problem,
        };
        let text = match path {
            None => STANDARD.to_owned(),
            Some(p) => std::fs::read_to_string(p)
                .map_err(|e| refuse(format!("cannot be read ({e}); check the path")))?,
        };
        let bands: Self = toml::from_str(&text)
            .map_err(|e| refuse(format!("{}; correct it", e.message().replace('\n', " "))))?;
        for b in &bands.band {
            let order = match b.by {
                By::AtLeast => b.good >= b.acceptable,
                _ => b.good <= b.acceptable,
            };
            if !order || !b.good.is_finite() || !b.acceptable.is_finite() {
                return Err(refuse(format!(
                    "band of {}: good = {}, acceptable = {}: good must be the narrower",
                    b.metric, b.good, b.acceptable
                )));
            }
        }
        Ok(bands)
    }

    /// The verdict on a metric, where there is a band and a value.
    pub fn verdict(&self, metric: &Metric) -> Option<Verdict> {
        let band = self.band.iter().find(|b| b.metric == metric.name)?;
        let value = metric.value?;
        let within = |limit: f64| match band.by {
            By::Difference => (value - metric.plan.unwrap_or(0.0)).abs() <= limit,
            By::AtMost => value <= limit,
            By::AtLeast => value >= limit,
        };
        Some(if within(band.good) {
            Verdict::Good
        } else if within(band.acceptable) {
            Verdict::Acceptable
        } else {
            Verdict::Poor
        })
    }
}

/// One number as it is filed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Filed {
    /// Name.
    pub name: &'static str,
    /// `null` where it cannot be said.
    pub value: Option<f64>,
    /// Unit.
    pub unit: &'static str,
    /// Half width; `null` where it is counted or recorded.
    pub uncertainty: Option<f64>,
    /// What the plan asks for.
    pub plan: Option<f64>,
    /// Verdict of a band, unvalidated unless `bands.validated`.
    pub verdict: Option<Verdict>,
    /// What it is, or why it is missing.
    pub note: &'static str,
}

/// A session as it is filed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// Who and when, as the lab names it.
    pub session: String,
    /// The scene.
    pub scene: String,
    /// The component.
    pub component: String,
    /// Hash of the cut, hexadecimal.
    pub cut: String,
    /// Where the bands are from.
    pub bands: String,
    /// Whether they were validated.
    pub bands_validated: bool,
    /// All metrics.
    pub metrics: Vec<Filed>,
    /// What happened when.
    pub events: Vec<(f64, String)>,
}

impl Judged {
    /// Judges a session by its plan and bands.
    pub fn of(target: &Target, played: &Played, bands: &Bands, session: &str) -> Self {
        let axis = tool_axis(&played.trace, &target.bone_from_component);
        let mut all = target.judge(&played.cut, axis);
        all.extend(metrics(
            &played.trace,
            &target.bone_from_component,
            bands.force_limit_n,
        ));
        let filed = |m: &Metric| Filed {
            name: m.name,
            value: m.value.map(rounded),
            unit: m.unit,
            uncertainty: m.uncertainty.map(rounded),
            plan: m.plan.map(rounded),
            verdict: bands.verdict(m),
            note: m.note,
        };
        let happened = |e: Event| (rounded(e.at_s), e.what);
        let digest = played.cut.digest(&target.scene.bone);
        Self {
            session: session.to_owned(),
            scene: target.scene.source.clone(),
            component: target.component.id.clone(),
            cut: format!("{:016x}", digest.hash),
            bands: bands.source.clone(),
            bands_validated: bands.validated,
            metrics: all.iter().map(filed).collect(),
            events: events(&played.trace, &target.bone_from_component)
                .into_iter()
                .map(happened)
                .collect(),
        }
    }

    /// A metric's value.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.metrics.iter().find(|m| m.name == name)?.value
    }

    /// The JSON that is filed.
    pub fn json(&self) -> Result<String, ClinicError> {
        serde_json::to_string_pretty(self)
            .map(|t| t + "\n")
            .map_err(|e| {
                ClinicError::Plan(format!(
                    "the session cannot be written as JSON ({e}); report this"
                ))
            })
    }
}

/// Six digits after the point: below every uncertainty, and the same text every time.
fn rounded(v: f64) -> f64 {
    (v * 1e6).round() / 1e6 + 0.0
}
