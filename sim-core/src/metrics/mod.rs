//! What a session achieved against its plan, and how: numbers with units and uncertainties.
//!
//! Results are read from the cut field in the *plan's* frame: origin where the planned component's back has
//! its middle, z out of the bone, y superior. So they do not depend on how the bone lies in its lattice, but
//! for what its voxels round; the uncertainty says how much that can be.

pub mod process;
pub mod result;
pub mod smooth;
pub mod surface;
pub mod trace;
pub mod volumes;

/// One number of a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Metric {
    /// Name, stable between releases.
    pub name: &'static str,
    /// `None` where it cannot be said; `note` says why.
    pub value: Option<f64>,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Half width within which voxels and fits may have moved it; `None` where it is counted or recorded.
    pub uncertainty: Option<f64>,
    /// What the plan asks for.
    pub plan: Option<f64>,
    /// What it is, or why it is missing.
    pub note: &'static str,
}

impl Metric {
    /// A number without a plan.
    pub fn new(name: &'static str, value: f64, unit: &'static str, note: &'static str) -> Self {
        Self {
            name,
            value: value.is_finite().then_some(value),
            unit,
            uncertainty: None,
            plan: None,
            note,
        }
    }

    /// One that cannot be said.
    pub fn missing(name: &'static str, unit: &'static str, note: &'static str) -> Self {
        Self {
            name,
            value: None,
            unit,
            uncertainty: None,
            plan: None,
            note,
        }
    }

    /// With its uncertainty.
    #[must_use]
    pub fn within(mut self, uncertainty: f64) -> Self {
        self.uncertainty = Some(uncertainty);
        self
    }

    /// With what the plan asks for.
    #[must_use]
    pub fn planned(mut self, plan: f64) -> Self {
        self.plan = Some(plan);
        self
    }
}
