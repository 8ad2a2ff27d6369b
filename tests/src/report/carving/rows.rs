//! One scene measured with several methods: the report's rows.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a stride of at most some thousands"
)]

use super::lineup::Carvers;
use crate::measure::intrinsic::{self, Replay as _, Subject, Timing};
use crate::measure::surface::{self, SurfaceError};
use crate::measure::swept::Swept;
use crate::measure::volume::{self, Account, Removed};
use crate::report::carver::{Along, Carver};
use crate::scenes::press::Trajectory;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::tool::Shape;
use serde::Serialize;
use std::time::Instant;

/// One method on one scene. Unknown is `null`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Scene, e.g. `reamer-press-0.47`.
    pub scene: String,
    /// Spacing along x, mm.
    pub voxel_mm: f64,
    /// Method.
    pub method: String,
    /// Instructions.
    pub isa: String,
    /// Events that were run, each at least three times.
    pub events: usize,
    /// Events of the whole scene; where it is more than `events`, the others were not carved, and the
    /// error holds the scallops that they leave.
    pub events_total: usize,
    /// Events that changed something.
    pub contact_events: usize,
    /// Median intrinsic time of a contact event.
    pub p50_us: Option<f64>,
    /// Its 99th percentile.
    pub p99_us: Option<f64>,
    /// Worst intrinsic event.
    pub max_us: Option<f64>,
    /// Mean over all events.
    pub mean_us: Option<f64>,
    /// RMS of the surface's error away from creases.
    pub surface_rms_um: Option<f64>,
    /// Its largest.
    pub surface_max_um: Option<f64>,
    /// Removed volume over the exact one, less one.
    pub volume_rel_err: Option<f64>,
    /// Voxels that should be gone and are not, over those that should.
    pub missed_frac: Option<f64>,
    /// Voxels that are gone and should not, over the same.
    pub excess_frac: Option<f64>,
    /// Mean time of `thesis-32` over this method's, over common events.
    pub ratio_thesis_scalar: Option<f64>,
    /// The same of `thesis-32-simd`.
    pub ratio_thesis_simd: Option<f64>,
    /// Memory held.
    pub bytes: usize,
    /// Mean of the surface's error, positive = too much was cut.
    pub surface_mean_um: Option<f64>,
    /// Points of the surface figures.
    pub surface_points: usize,
    /// Points where no surface was found.
    pub surface_lost: usize,
    /// RMS at creases.
    pub crease_rms_um: Option<f64>,
    /// Largest error at creases.
    pub crease_max_um: Option<f64>,
    /// Median of all samples, noise included.
    pub raw_p50_us: Option<f64>,
    /// Their 99th percentile.
    pub raw_p99_us: Option<f64>,
    /// Their largest.
    pub raw_max_us: Option<f64>,
}

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Replays; the least time of an event is over these.
    pub replays: usize,
    /// Seconds for one of our methods on one scene, all replays.
    pub ours_s: f64,
    /// Seconds for a rival.
    pub theirs_s: f64,
    /// Points of a surface.
    pub points: usize,
    /// Most events of a scene.
    pub events: usize,
    /// Offsets against the lattice of an accuracy run.
    pub offsets: u32,
    /// Whether scenes are made small.
    pub quick: bool,
}

impl Effort {
    /// A measurement.
    pub const FULL: Self = Self {
        replays: intrinsic::REPLAYS,
        ours_s: 4.0,
        theirs_s: 0.8,
        points: 2000,
        events: usize::MAX,
        offsets: 3,
        quick: false,
    };
    /// A check.
    pub const QUICK: Self = Self {
        replays: intrinsic::REPLAYS,
        ours_s: 0.6,
        theirs_s: 0.3,
        points: 300,
        events: 120,
        offsets: 1,
        quick: true,
    };
}

/// A tool's way through a bone.
#[derive(Debug)]
pub struct Case<'a> {
    /// Name of the scene.
    pub scene: String,
    /// The bone.
    pub bone: &'a Bone,
    /// The exact tool.
    pub shape: Shape,
    /// Its way in the bone frame.
    pub way: &'a Trajectory,
    /// Whether errors are measured.
    pub errors: bool,
}

/// Measures all carvers on a scene, interleaved, and the error of what they carved.
pub fn measure(case: &Case<'_>, effort: &Effort, mut carvers: Carvers<'_>) -> Vec<Row> {
    let timings = time(case, effort, &mut carvers);
    let (errors, accounts) = if case.errors {
        let (e, a) = judge(case, effort, &carvers);
        (Some(e), Some(a))
    } else {
        (None, None)
    };
    let named = |name: &str| {
        let at = carvers.iter().position(|c| c.name() == name)?;
        Some(&timings[at])
    };
    let (scalar, simd) = (named("thesis-32"), named("thesis-32-simd"));
    carvers
        .iter()
        .enumerate()
        .map(|(n, carver)| {
            let timing = &timings[n];
            let mut row = row(case, carver.as_ref(), timing);
            row.ratio_thesis_scalar = scalar.and_then(|t| t.mean_over(timing));
            row.ratio_thesis_simd = simd.and_then(|t| t.mean_over(timing));
            if let Some(e) = errors.as_ref().map(|e| e[n]) {
                add_errors(&mut row, &e);
            }
            if let Some(a) = accounts.as_ref().map(|a| a[n]) {
                row.volume_rel_err = some(carver.removed_mm3() / a.mm3 - 1.0);
                row.missed_frac = a.missed_frac();
                row.excess_frac = a.excess_frac();
            }
            row
        })
        .collect()
}

fn some(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

fn row(case: &Case<'_>, carver: &dyn Carver, timing: &Timing) -> Row {
    let (all, contact, raw) = (timing.all(), timing.contact(), timing.raw());
    Row {
        scene: case.scene.clone(),
        voxel_mm: case.bone.grid().spacing_mm.x,
        method: carver.name().to_owned(),
        isa: carver.isa().to_owned(),
        events: all.count,
        events_total: case.way.events(),
        contact_events: contact.count,
        p50_us: some(contact.p50_us),
        p99_us: some(contact.p99_us),
        max_us: some(all.max_us),
        mean_us: some(all.mean_us),
        surface_rms_um: None,
        surface_max_um: None,
        volume_rel_err: None,
        missed_frac: None,
        excess_frac: None,
        ratio_thesis_scalar: None,
        ratio_thesis_simd: None,
        bytes: carver.bytes(),
        surface_mean_um: None,
        surface_points: 0,
        surface_lost: 0,
        crease_rms_um: None,
        crease_max_um: None,
        raw_p50_us: some(raw.p50_us),
        raw_p99_us: some(raw.p99_us),
        raw_max_us: some(raw.max_us),
    }
}

fn add_errors(row: &mut Row, e: &SurfaceError) {
    let if_any = |points: usize, v: f64| (points > 0).then_some(v);
    row.surface_rms_um = if_any(e.smooth.points, e.smooth.rms_um);
    row.surface_max_um = if_any(e.smooth.points, e.smooth.max_um);
    row.surface_mean_um = if_any(e.smooth.points, e.smooth.mean_um);
    row.surface_points = e.smooth.points;
    row.surface_lost = e.smooth.lost;
    row.crease_rms_um = if_any(e.crease.points, e.crease.rms_um);
    row.crease_max_um = if_any(e.crease.points, e.crease.max_um);
}

/// Times all carvers, those that are too slow for their share of time on every n-th event only.
fn time(case: &Case<'_>, effort: &Effort, carvers: &mut Carvers<'_>) -> Vec<Timing> {
    let poses = &case.way.poses;
    let events = case.way.events();
    let strides: Vec<usize> = carvers
        .iter_mut()
        .map(|carver| {
            let share = if carver.ours() {
                effort.ours_s
            } else {
                effort.theirs_s
            };
            let mut along = Along::new(carver.as_mut(), poses);
            let each = probe(&mut along, events);
            // powers of two: a coarser choice of events is part of every finer one, so that ratios over
            // common events are over all that the slower method ran
            ((each * (events * effort.replays) as f64 / share).ceil() as usize).next_power_of_two()
        })
        .collect();
    let mut ways: Vec<Along<'_, '_>> = carvers
        .iter_mut()
        .map(|c| Along::new(c.as_mut(), poses))
        .collect();
    let mut subjects: Vec<Subject<'_>> = ways
        .iter_mut()
        .zip(strides)
        .map(|(replay, stride)| Subject {
            replay,
            events,
            stride,
        })
        .collect();
    intrinsic::interleaved(&mut subjects, effort.replays)
}

/// Mean seconds of an event, of about a dozen; also touches the memory.
fn probe(along: &mut Along<'_, '_>, events: usize) -> f64 {
    let every = events.div_ceil(12).max(1);
    along.reset();
    let start = Instant::now();
    let mut count = 0;
    for n in (0..events).step_by(every) {
        along.event(n);
        count += 1;
    }
    start.elapsed().as_secs_f64() / f64::from(count.max(1))
}

/// Errors of what stands after the timed run.
fn judge(
    case: &Case<'_>,
    effort: &Effort,
    carvers: &Carvers<'_>,
) -> (Vec<SurfaceError>, Vec<Account>) {
    let swept = Swept::new(case.shape.clone(), &case.way.poses);
    let points = surface::envelope(&swept, case.bone, effort.points);
    let spacing = case.bone.grid().spacing_mm;
    // a tool voxel and two bone voxels
    let reach = 1.0 + 2.0 * spacing.max_element();
    let errors = carvers
        .iter()
        .map(|c| surface::errors(&points, spacing, reach, &|p| c.cut_mm(p)))
        .collect();
    let removed: Vec<Box<dyn Fn([usize; 3]) -> bool + Sync + '_>> = carvers
        .iter()
        .map(|c| -> Box<dyn Fn([usize; 3]) -> bool + Sync + '_> { Box::new(|v| c.is_removed(v)) })
        .collect();
    let refs: Vec<Removed<'_>> = removed.iter().map(AsRef::as_ref).collect();
    (errors, volume::accounts(&swept, case.bone, &refs))
}
