//! Force and depth of the last seconds, for the plots.

use osteon_protocol::ipc::PoseUpdate;
use std::collections::VecDeque;

/// Length of the plots, s.
pub(crate) const PLOT_S: f64 = 20.0;
/// Least distance of two kept points, s; bounds their number.
const LEAST_STEP_S: f64 = 0.01;
/// Servo ticks a second.
const TICKS_PER_S: f64 = 1000.0;

/// One point of the plots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    /// Session time, s.
    pub(crate) time_s: f64,
    /// Force at the stylus, N.
    pub(crate) force_n: f64,
    /// Depth along the planned axis, mm.
    pub(crate) depth_mm: f64,
}

/// The points, oldest first; at most [`PLOT_S`] / [`LEAST_STEP_S`] + 1.
#[derive(Debug, Default)]
pub(crate) struct History {
    points: VecDeque<Point>,
}

impl History {
    /// Forgets all points.
    pub(crate) fn clear(&mut self) {
        self.points.clear();
    }

    /// Adds a pose's force and depth. A point within [`LEAST_STEP_S`] of the newest only raises
    /// its force, so that a short peak is not lost.
    pub(crate) fn push(&mut self, pose: &PoseUpdate) {
        let [x, y, z] = pose.force_n.map(f64::from);
        let point = Point {
            time_s: pose.tick as f64 / TICKS_PER_S,
            force_n: (x * x + y * y + z * z).sqrt(),
            depth_mm: f64::from(pose.depth_mm),
        };
        if !(point.force_n.is_finite() && point.depth_mm.is_finite()) {
            return;
        }
        if let Some(last) = self.points.back_mut() {
            if point.time_s < last.time_s {
                self.points.clear();
            } else if point.time_s < last.time_s + LEAST_STEP_S {
                last.force_n = last.force_n.max(point.force_n);
                return;
            }
        }
        self.points.push_back(point);
        while self
            .points
            .front()
            .is_some_and(|p| p.time_s < point.time_s - PLOT_S)
        {
            self.points.pop_front();
        }
    }

    /// The points, oldest first.
    pub(crate) fn points(&self) -> impl Iterator<Item = &Point> {
        self.points.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::messages::pose_at;

    #[test]
    fn keeps_twenty_seconds_and_every_peak() {
        let mut history = History::default();
        for tick in 0..60_000u64 {
            let mut pose = pose_at([0.0; 3]);
            pose.tick = tick;
            pose.force_n = [if tick == 50_003 { 3.0 } else { 1.0 }, 0.0, 0.0];
            history.push(&pose);
        }
        let points: Vec<_> = history.points().collect();
        assert!(points.len() <= 2001, "{}", points.len());
        let first = points.first().map(|p| p.time_s);
        assert!(
            first.is_some_and(|t| (39.9..40.1).contains(&t)),
            "{first:?}"
        );
        let peak = points.iter().map(|p| p.force_n).fold(0.0, f64::max);
        assert!((peak - 3.0).abs() < 1e-12, "{peak}");
    }

    #[test]
    fn a_session_that_begins_again_begins_a_new_plot() {
        let mut history = History::default();
        for tick in [5000, 6000, 10] {
            let mut pose = pose_at([0.0; 3]);
            pose.tick = tick;
            history.push(&pose);
        }
        assert_eq!(history.points().count(), 1);
    }
}
