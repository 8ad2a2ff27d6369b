//! Force and depth of the last seconds, for the plots.

use osteon_protocol::ipc::PoseUpdate;
use std::collections::VecDeque;

/// Length of the plots, s.
pub(crate) const PLOT_S: f64 = 20.0;
/// Least distance of two kept points, s; bounds their number.
const LEAST_STEP_S: f64 = 0.01;
/// Time over which the feed is taken, s.
pub(crate) const FEED_S: f64 = 0.2;
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
    /// Torque of the cut about the spindle, N·mm at a real tool.
    pub(crate) torque_nmm: f64,
    /// Speed along the planned axis over the last [`FEED_S`], mm/s; positive into the bone.
    pub(crate) feed_mm_s: f64,
    /// Volume removed since the last reset, mm³.
    pub(crate) removed_mm3: f64,
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
        let (time_s, depth_mm) = (pose.tick as f64 / TICKS_PER_S, f64::from(pose.depth_mm));
        let point = Point {
            time_s,
            force_n: (x * x + y * y + z * z).sqrt(),
            depth_mm,
            torque_nmm: f64::from(pose.spindle_nmm),
            feed_mm_s: self.feed(time_s, depth_mm),
            removed_mm3: pose.removed_mm3,
        };
        let values = [point.force_n, depth_mm, point.torque_nmm, point.removed_mm3];
        if values.iter().any(|v| !v.is_finite()) {
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

    /// Speed of the depth since the newest point that is [`FEED_S`] old, mm/s.
    fn feed(&self, time_s: f64, depth_mm: f64) -> f64 {
        let mut from_newest = self.points.iter().rev();
        let before = from_newest.find(|p| p.time_s <= time_s - FEED_S);
        // an older one, as after a pause, says nothing of now
        let before = before.filter(|p| p.time_s >= time_s - 2.0 * FEED_S);
        before.map_or(0.0, |p| (depth_mm - p.depth_mm) / (time_s - p.time_s))
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
    fn the_feed_of_a_steady_motion_is_its_speed() {
        let mut history = History::default();
        for tick in 0..3000u16 {
            let mut pose = pose_at([0.0; 3]);
            pose.tick = u64::from(tick);
            // 3 mm/s into the bone, then out again
            let t = f32::from(tick) / 1000.0;
            pose.depth_mm = if t < 1.5 { 3.0 * t } else { 9.0 - 3.0 * t };
            history.push(&pose);
        }
        let feed = |at: f64| {
            history
                .points()
                .find(|p| p.time_s >= at)
                .map(|p| p.feed_mm_s)
        };
        assert!(
            feed(1.0).is_some_and(|f| (f - 3.0).abs() < 0.01),
            "{:?}",
            feed(1.0)
        );
        assert!(feed(2.5).is_some_and(|f| (f + 3.0).abs() < 0.01));
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
