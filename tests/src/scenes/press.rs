//! Deterministic trajectories, one pose a millisecond.
//!
//! Poses are `plan_from_tool`: the plan's origin lies on the joint face, z out of the joint, so that
//! they fit the built-in scapula and a patient's plan alike. Angles come from glam's libm: the same bits
//! on every machine.

use glam::{DQuat, DVec2, DVec3};
use osteon_sim_core::pose::Pose;
use std::f64::consts::TAU;

/// A tool's way: event *n* goes from `poses[n]` to `poses[n + 1]`, in one millisecond.
#[derive(Debug, Clone)]
pub struct Trajectory {
    /// Name in reports.
    pub name: &'static str,
    /// Poses, at least two.
    pub poses: Vec<Pose>,
}

/// Seconds of one event.
const TICK_S: f64 = 1e-3;
/// A fixed tilt against the plan's axis, rad: nothing of a trajectory lies along the lattice.
const TILT: DVec2 = DVec2::new(0.03, -0.02);

impl Trajectory {
    /// Number of events.
    pub fn events(&self) -> usize {
        self.poses.len().saturating_sub(1)
    }

    /// The same way in another frame.
    #[must_use]
    pub fn placed(&self, bone_from_plan: &Pose) -> Self {
        Self {
            name: self.name,
            poses: self.poses.iter().map(|p| bone_from_plan.then(p)).collect(),
        }
    }

    /// At most `events` events, spread over the whole way: what quick runs use. Each event then
    /// covers several milliseconds.
    #[must_use]
    pub fn thinned(&self, events: usize) -> Self {
        let all = self.events();
        let kept = events.clamp(1, all.max(1));
        Self {
            name: self.name,
            poses: (0..=kept).map(|n| self.poses[n * all / kept]).collect(),
        }
    }

    /// At most the first `events` events.
    #[must_use]
    pub fn first(&self, events: usize) -> Self {
        let kept = events.clamp(1, self.events().max(1));
        Self {
            name: self.name,
            poses: self.poses[..=kept].to_vec(),
        }
    }

    fn of(name: &'static str, events: u32, pose: impl Fn(u32) -> Pose) -> Self {
        Self {
            name,
            poses: (0..=events).map(pose).collect(),
        }
    }
}

/// A tool whose apex is at `apex` and whose axis leans by `tilt` (rad, towards x and y).
fn leaning(apex: DVec3, tilt: DVec2) -> Pose {
    let angle = tilt.length();
    let axis = DVec3::new(-tilt.y, tilt.x, 0.0);
    let rotation = axis
        .try_normalize()
        .map_or(DQuat::IDENTITY, |a| DQuat::from_axis_angle(a, angle));
    Pose::new(rotation, apex)
}

/// Distance after `t` seconds at 1 mm/s for a second, 2 mm/s for a second, then 5 mm/s for half a
/// second, then none.
fn press_depth(t: f64) -> f64 {
    let part = |from: f64, length: f64| (t - from).clamp(0.0, length);
    part(0.0, 1.0) + 2.0 * part(1.0, 1.0) + 5.0 * part(2.0, 0.5)
}

/// Reamer on the joint face: from 0.5 mm above it at 1, 2 and 5 mm/s, 5.5 mm in all, then it dwells;
/// the axis wobbles by 2° and the apex by 0.3 mm. 4000 events.
pub fn reamer_press() -> Trajectory {
    Trajectory::of("reamer-press", 4000, |n| {
        let t = f64::from(n) * TICK_S;
        let lean = DVec2::from_angle(TAU * 1.1 * t) * 2.0_f64.to_radians();
        let aside = DVec2::from_angle(TAU * 1.7 * t) * 0.3;
        leaning(aside.extend(0.5 - press_depth(t)), TILT + lean)
    })
}

/// Peg drill at 5 mm/s, 20 mm deep. 4000 events.
pub fn peg_press() -> Trajectory {
    Trajectory::of("peg-press", 4000, |n| {
        leaning(DVec3::NEG_Z * (5.0 * TICK_S * f64::from(n)), TILT)
    })
}

/// The tool circles 14 mm above the joint face at 50 mm/s. 1000 events.
pub fn free() -> Trajectory {
    Trajectory::of("free", 1000, |n| {
        let way = 50.0 * TICK_S * f64::from(n);
        leaning((DVec2::from_angle(way / 5.0) * 5.0).extend(14.0), TILT)
    })
}

/// Strokes of 30 mm to and fro at 200 mm/s, from 1 to 8 mm deep. 2400 events.
pub fn sweep() -> Trajectory {
    const STROKE_MS: u32 = 150;
    const STROKES: u32 = 16;
    Trajectory::of("sweep", STROKE_MS * STROKES, |n| {
        let stroke = (n / STROKE_MS).min(STROKES - 1);
        let along = f64::from(n - stroke * STROKE_MS) / f64::from(STROKE_MS);
        let x = if stroke.is_multiple_of(2) {
            along
        } else {
            1.0 - along
        };
        let depth = 1.0 + 7.0 * f64::from(n) / f64::from(STROKE_MS * STROKES);
        leaning(DVec3::new(30.0 * x - 15.0, 0.0, -depth), TILT)
    })
}

/// Straight through head, neck and blade at 50 mm/s, 60 mm: stress. 1200 events.
pub fn plunge() -> Trajectory {
    Trajectory::of("plunge", 1200, |n| {
        leaning(DVec3::Z * (2.0 - 50.0 * TICK_S * f64::from(n)), TILT)
    })
}

/// A burr paints the joint face at 50 mm/s: rows of 20 mm, 1.6 mm apart, 0.5 mm below the face's
/// sphere (radius `face_radius_mm`). 4752 events.
pub fn burr_paint(face_radius_mm: f64) -> Trajectory {
    const ALONG_MS: u32 = 400;
    const OVER_MS: u32 = 32;
    const ROWS: u32 = 11;
    Trajectory::of("burr-paint", (ALONG_MS + OVER_MS) * ROWS, |n| {
        let row = (n / (ALONG_MS + OVER_MS)).min(ROWS - 1);
        let ms = n - row * (ALONG_MS + OVER_MS);
        let along = f64::from(ms.min(ALONG_MS)) / f64::from(ALONG_MS);
        let over = f64::from(ms.saturating_sub(ALONG_MS)) / f64::from(OVER_MS);
        let x = if row.is_multiple_of(2) {
            along
        } else {
            1.0 - along
        };
        let at = DVec2::new(20.0 * x - 10.0, 1.6 * (f64::from(row) + over - 5.0));
        let face = face_radius_mm - (face_radius_mm * face_radius_mm - at.length_squared()).sqrt();
        leaning(at.extend(face - 0.5), TILT)
    })
}

/// A straight press of `depth_mm` into a flat surface at z = 0 in `events` events, the axis leaning by
/// `tilt`: for accuracy, where a closed form knows the volume.
pub fn straight(depth_mm: f64, tilt: DVec2, events: u32) -> Trajectory {
    Trajectory::of("straight", events, |n| {
        let pose = leaning(DVec3::ZERO, tilt);
        let back = depth_mm * f64::from(n) / f64::from(events);
        Pose::new(pose.rotation, -pose.vector(DVec3::Z) * back)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Trajectory> {
        vec![
            reamer_press(),
            peg_press(),
            free(),
            sweep(),
            plunge(),
            burr_paint(34.0),
            straight(2.0, TILT, 100),
        ]
    }

    #[test]
    fn trajectories_are_the_same_each_time_and_move_as_fast_as_they_say() {
        let speeds = [30.0, 5.0, 50.0, 202.0, 50.0, 70.0, 21.0];
        for ((a, b), fastest) in all().iter().zip(all()).zip(speeds) {
            assert_eq!(a.poses, b.poses, "{}", a.name);
            assert!(a.poses.iter().all(Pose::is_valid));
            for pair in a.poses.windows(2) {
                let moved = pair[0].translation.distance(pair[1].translation);
                assert!(moved <= 1.000_001 * fastest * TICK_S, "{}: {moved}", a.name);
            }
        }
        assert_eq!(reamer_press().events(), 4000);
    }

    #[test]
    fn the_press_ends_at_its_depth_and_dwells() {
        assert!((press_depth(9.0) - 5.5).abs() < 1e-12);
        let press = reamer_press();
        assert!((press.poses[4000].translation.z + 5.0).abs() < 1e-12);
        assert!((press.poses[2500].translation.z + 5.0).abs() < 1e-12);
    }

    #[test]
    fn thinning_keeps_both_ends() {
        let (whole, thin) = (peg_press(), peg_press().thinned(30));
        assert_eq!(thin.events(), 30);
        assert_eq!(thin.poses[0], whole.poses[0]);
        assert_eq!(thin.poses.last(), whole.poses.last());
        assert_eq!(peg_press().first(30).poses, whole.poses[..31]);
    }
}
