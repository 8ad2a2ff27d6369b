//! Removal of the first N overlapped voxels of a tick, in the order of memory.
//!
//! The tool is a ball on a prescribed way; a voxel is overlapped where its centre is in the ball. The
//! force is the overlap's: from each overlapped voxel that still stands towards the tool's centre.

use glam::DVec3;
use serde::Serialize;

/// Voxels that stand, in a cube around the origin.
#[derive(Debug, Clone)]
pub struct Voxels {
    edge: i32,
    spacing_mm: f64,
    stands: Vec<bool>,
}

/// A ball, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Its centre.
    pub centre: DVec3,
    /// Its radius.
    pub radius: f64,
}

/// What a tick did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bite {
    /// Voxels removed.
    pub removed: u64,
    /// Sum of their centres, mm.
    pub centres: DVec3,
    /// Mean direction from what still stands in the ball to its centre, mm: the overlap's force up to a
    /// factor.
    pub force: DVec3,
}

impl Voxels {
    /// The half space `inward · p > 0`, by voxel centres, in a cube of ±`reach_mm`.
    pub fn half_space(inward: DVec3, spacing_mm: f64, reach_mm: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "some hundred voxels")]
        let edge = 2 * (reach_mm / spacing_mm).ceil() as i32;
        let mut voxels = Self {
            edge,
            spacing_mm,
            stands: Vec::new(),
        };
        let all =
            (0..edge).flat_map(|k| (0..edge).flat_map(move |j| (0..edge).map(move |i| [i, j, k])));
        voxels.stands = all.map(|at| voxels.centre(at).dot(inward) > 0.0).collect();
        voxels
    }

    fn centre(&self, at: [i32; 3]) -> DVec3 {
        let half = 0.5 * f64::from(self.edge - 1);
        DVec3::from_array(at.map(|n| (f64::from(n) - half) * self.spacing_mm))
    }

    /// Removes the first `most` standing voxels in the ball, x fastest and z slowest.
    pub fn bite(&mut self, ball: &Ball, most: u64) -> Bite {
        let half = 0.5 * f64::from(self.edge - 1);
        let middle = ball.centre / self.spacing_mm + half;
        let reach = ball.radius / self.spacing_mm;
        #[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
        let clamped = |v: DVec3| v.to_array().map(|n| (n as i32).clamp(0, self.edge - 1));
        let (lo, hi) = (
            clamped((middle - reach).ceil()),
            clamped((middle + reach).floor()),
        );
        let mut bite = Bite::default();
        let mut still = 0.0;
        for k in lo[2]..=hi[2] {
            for j in lo[1]..=hi[1] {
                for i in lo[0]..=hi[0] {
                    let p = self.centre([i, j, k]);
                    let at = usize::try_from((k * self.edge + j) * self.edge + i).unwrap_or(0);
                    if !self.stands[at]
                        || p.distance_squared(ball.centre) > ball.radius * ball.radius
                    {
                        continue;
                    }
                    if bite.removed < most {
                        self.stands[at] = false;
                        bite.removed += 1;
                        bite.centres += p;
                    } else {
                        bite.force += ball.centre - p;
                        still += 1.0;
                    }
                }
            }
        }
        if still > 0.0 {
            bite.force /= still;
        }
        bite
    }
}

/// One row of the rates.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RateRow {
    /// Whose rule.
    pub rule: String,
    /// Voxels a tick at most.
    pub cap: u64,
    /// Loop's rate, Hz.
    pub rate_hz: u32,
    /// Removed in the whole plunge, mm³.
    pub removed_mm3: f64,
    /// The same over its time, mm³/s.
    pub removed_mm3_s: f64,
    /// Share of the swept bone that still stands at the end.
    pub left_share: f64,
}

/// A ball of 2 mm plunged 2 mm deep at 1 mm/s into voxels of 0.1 mm.
pub fn rate_row(rule: &str, cap: u64, rate_hz: u32) -> RateRow {
    const RADIUS: f64 = 2.0;
    const SECONDS: f64 = 2.0;
    let spacing = 0.1;
    let mut voxels = Voxels::half_space(DVec3::NEG_Z, spacing, 2.5);
    let ticks = SECONDS * f64::from(rate_hz);
    let mut removed = 0;
    let mut n = 0.0;
    while n < ticks {
        n += 1.0;
        let depth = n / f64::from(rate_hz);
        removed += voxels
            .bite(&ball_at(DVec3::NEG_Z, RADIUS, depth), cap)
            .removed;
    }
    let left = voxels
        .bite(&ball_at(DVec3::NEG_Z, RADIUS, SECONDS), u64::MAX)
        .removed;
    let volume = removed as f64 * spacing * spacing * spacing;
    RateRow {
        rule: rule.to_owned(),
        cap,
        rate_hz,
        removed_mm3: volume,
        removed_mm3_s: volume / SECONDS,
        left_share: left as f64 / (left + removed) as f64,
    }
}

fn ball_at(inward: DVec3, radius: f64, depth: f64) -> Ball {
    Ball {
        centre: inward * (depth - radius),
        radius,
    }
}

/// One row of the symmetry.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SideRow {
    /// Whose rule.
    pub rule: String,
    /// Direction of the plunge, not of unit length.
    pub direction: [i8; 3],
    /// Mean force across the plunge over that along it.
    pub lateral_share: f64,
    /// Centroid of what was removed off the axis, mm.
    pub off_axis_mm: f64,
}

/// The 26 directions to a cube's faces, edges and corners.
pub fn directions() -> Vec<[i8; 3]> {
    let all = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| [x, y, z])));
    all.filter(|d| *d != [0; 3]).collect()
}

/// A ball of 3 mm plunged 1 mm deep at 1 mm/s and 1 kHz into voxels of 0.1 mm along a direction.
pub fn side_row(rule: &str, cap: u64, direction: [i8; 3]) -> SideRow {
    let inward = DVec3::from_array(direction.map(f64::from))
        .try_normalize()
        .unwrap_or(DVec3::NEG_Z);
    let mut voxels = Voxels::half_space(inward, 0.1, 3.5);
    let (mut force, mut centres, mut removed) = (DVec3::ZERO, DVec3::ZERO, 0);
    for n in 1..=1000 {
        let bite = voxels.bite(&ball_at(inward, 3.0, f64::from(n) * 1e-3), cap);
        force += bite.force;
        centres += bite.centres;
        removed += bite.removed;
    }
    let across = |v: DVec3| (v - inward * v.dot(inward)).length();
    SideRow {
        rule: rule.to_owned(),
        direction,
        lateral_share: across(force) / force.dot(inward).abs().max(f64::MIN_POSITIVE),
        off_axis_mm: across(centres / (removed.max(1) as f64)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capped_removal_depends_on_the_rate_and_uncapped_removal_does_not() {
        let slow = rate_row("ten", 10, 250);
        let fast = rate_row("ten", 10, 4000);
        assert!(
            fast.removed_mm3 > 3.0 * slow.removed_mm3,
            "{slow:?} {fast:?}"
        );
        let all = [250, 4000].map(|rate| rate_row("all", u64::MAX, rate));
        assert!((all[0].removed_mm3 / all[1].removed_mm3 - 1.0).abs() < 1e-12);
        // π p² (R − p/3)
        let exact = core::f64::consts::PI * 4.0 * (2.0 - 2.0 / 3.0);
        assert!((all[0].removed_mm3 / exact - 1.0).abs() < 0.02, "{all:?}");
    }

    #[test]
    fn the_order_of_memory_shows_in_the_side_force() {
        let capped = side_row("ten", 10, [1, 0, 0]);
        assert!(
            capped.lateral_share > 0.1 && capped.off_axis_mm > 0.1,
            "{capped:?}"
        );
        let along = side_row("ten", 10, [0, 0, -1]);
        assert!(along.off_axis_mm < capped.off_axis_mm, "{along:?}");
        assert_eq!(directions().len(), 26);
    }
}
