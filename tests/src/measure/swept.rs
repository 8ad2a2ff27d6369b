//! The exact solid that a tool sweeps: the union of its exact distance function over many poses.
//!
//! Distances are the tool's own `f32` ones (about 10⁻⁵ mm); poses are `f64`. Between two poses of the
//! union the tool moves at most [`STEP_MM`]: scallops of s²/(8 R), 0.1 µm for the reamer at speed; slow tools
//! and burrs move less than that in an event.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts of poses"
)]

use glam::DVec3;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Shape;

/// Most movement of a tool's point between two poses of the union, mm.
pub const STEP_MM: f64 = 0.1;
/// Most poses that are left out where the tool moves slowly: an extreme between two poses that are
/// 4 ms apart is missed by ½ a (2 ms)², below 0.1 µm at hand's accelerations.
const MOST_SKIPPED: usize = 4;
/// Poses of one group of [`Swept`].
const GROUP: usize = 16;

/// A tool's swept solid.
#[derive(Debug, Clone)]
pub struct Swept {
    shape: Shape,
    reach: f64,
    tool_from_bone: Vec<Pose>,
    bone_from_tool: Vec<Pose>,
    groups: Vec<Group>,
}

/// Poses that lie close together.
#[derive(Debug, Clone)]
struct Group {
    first: usize,
    end: usize,
    // the pose that stands for the group
    middle: usize,
    // most translation, mm, and turn, rad, from the middle pose to another
    moved: f64,
    turned: f64,
}

/// Nearest surface of the union.
#[derive(Debug, Clone, Copy)]
pub struct Nearest {
    /// Signed distance, mm, negative inside the swept solid.
    pub distance: f64,
    /// Number of the pose whose tool is nearest.
    pub pose: usize,
}

fn turn(a: &Pose, b: &Pose) -> f64 {
    2.0 * (a.rotation.conjugate() * b.rotation).xyz().length()
}

fn reach(shape: &Shape) -> f64 {
    let b = shape.bounds();
    b.lo.abs().max(b.hi.abs()).length()
}

impl Swept {
    /// The solid swept along `way` (`bone_from_tool`, straight steps between neighbours), from its second
    /// pose on: an event stamps where it ends.
    pub fn new(shape: Shape, way: &[Pose]) -> Self {
        let reach = reach(&shape);
        let moved = |a: &Pose, b: &Pose| a.translation.distance(b.translation) + reach * turn(a, b);
        let mut poses = Vec::new();
        let mut last = 0;
        for n in 1..way.len() {
            let step = moved(&way[last], &way[n]);
            let more = n + 1 < way.len() && n - last < MOST_SKIPPED;
            if more && step < 0.2 * STEP_MM && last > 0 {
                continue;
            }
            let pieces = ((step / STEP_MM).ceil() as u32).max(1);
            for m in 1..pieces {
                let t = f64::from(m) / f64::from(pieces);
                poses.push(way[last].interpolate(&way[n], t));
            }
            poses.push(way[n]);
            last = n;
        }
        Self::of_poses(shape, poses)
    }

    /// The union over just these poses.
    pub fn of_poses(shape: Shape, bone_from_tool: Vec<Pose>) -> Self {
        let groups = (0..bone_from_tool.len())
            .step_by(GROUP)
            .map(|first| {
                let end = (first + GROUP).min(bone_from_tool.len());
                let middle = usize::midpoint(first, end);
                let at = &bone_from_tool[middle];
                let most = |f: &dyn Fn(&Pose) -> f64| {
                    bone_from_tool[first..end].iter().map(f).fold(0.0, f64::max)
                };
                Group {
                    first,
                    end,
                    middle,
                    moved: most(&|p| p.translation.distance(at.translation)),
                    turned: most(&|p| turn(p, at)),
                }
            })
            .collect();
        Self {
            reach: reach(&shape),
            shape,
            tool_from_bone: bone_from_tool.iter().map(Pose::inverse).collect(),
            bone_from_tool,
            groups,
        }
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.bone_from_tool.len()
    }

    /// True without a pose.
    pub fn is_empty(&self) -> bool {
        self.bone_from_tool.is_empty()
    }

    /// Pose number `pose`.
    pub fn bone_from_tool(&self, pose: usize) -> &Pose {
        &self.bone_from_tool[pose]
    }

    /// The tool's shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Distance to the tool at one pose, mm.
    pub fn at(&self, pose: usize, p: DVec3) -> f64 {
        let q = self.tool_from_bone[pose].point(p);
        f64::from(self.shape.signed_distance(q.as_vec3()))
    }

    /// Least distance that a pose of the group can have at `p`, and the middle pose's.
    fn bound(&self, group: &Group, p: DVec3) -> (f64, f64) {
        let middle = self.at(group.middle, p);
        let arm = self.tool_from_bone[group.middle].point(p).length();
        (middle - group.moved - group.turned * arm, middle)
    }

    /// The nearest surface of the union at `p`, bone frame.
    pub fn nearest(&self, p: DVec3) -> Nearest {
        let mut best = Nearest {
            distance: f64::INFINITY,
            pose: 0,
        };
        let bounds: Vec<f64> = self
            .groups
            .iter()
            .map(|g| {
                let (bound, middle) = self.bound(g, p);
                if middle < best.distance {
                    best = Nearest {
                        distance: middle,
                        pose: g.middle,
                    };
                }
                bound
            })
            .collect();
        for (group, bound) in self.groups.iter().zip(bounds) {
            if bound < best.distance {
                for pose in group.first..group.end {
                    let distance = self.at(pose, p);
                    if distance < best.distance {
                        best = Nearest { distance, pose };
                    }
                }
            }
        }
        best
    }

    /// Unit gradient of the distance to the tool at one pose: out of the tool.
    pub fn normal(&self, pose: usize, p: DVec3) -> Option<DVec3> {
        const STEP: f64 = 0.01;
        let along = |d: DVec3| self.at(pose, p + d) - self.at(pose, p - d);
        DVec3::new(
            along(DVec3::X * STEP),
            along(DVec3::Y * STEP),
            along(DVec3::Z * STEP),
        )
        .try_normalize()
    }

    /// Distance at `p`, and the poses that can be nearest anywhere within `radius` of it, out of `among`
    /// (all where it is `None`). Distances change by at most the way: a pose that is more than two radii
    /// behind at the middle is behind everywhere.
    pub(super) fn near(&self, among: Option<&[u32]>, p: DVec3, radius: f64) -> (f64, Vec<u32>) {
        let mut least = f64::INFINITY;
        let mut found: Vec<(f64, u32)> = Vec::new();
        let mut take = |pose: usize| {
            let d = self.at(pose, p);
            least = least.min(d);
            if d <= least + 2.0 * radius {
                found.push((d, pose as u32));
            }
        };
        if let Some(list) = among {
            for &pose in list {
                take(pose as usize);
            }
        } else {
            let most = self.nearest(p).distance + 2.0 * radius;
            for group in &self.groups {
                if self.bound(group, p).0 <= most {
                    (group.first..group.end).for_each(&mut take);
                }
            }
        }
        let most = least + 2.0 * radius + 1e-4;
        found.retain(|f| f.0 <= most);
        (least, found.into_iter().map(|f| f.1).collect())
    }

    /// Lowest and highest corner of a box around all of it, bone frame, mm.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let reach = DVec3::splat(self.reach);
        self.bone_from_tool
            .iter()
            .map(|p| p.translation)
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), t| {
                (lo.min(t - reach), hi.max(t + reach))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::press;
    use osteon_sim_core::tool::Tool;

    #[test]
    fn the_grouped_search_finds_what_a_search_of_all_poses_finds() {
        let way = press::reamer_press().thinned(300);
        let swept = Swept::new(Tool::glenoid_reamer().shape, &way.poses);
        for n in 0..200 {
            let n = f64::from(n);
            let p = DVec3::new(
                20.0 * (n * 0.7).sin(),
                20.0 * (n * 1.3).cos(),
                8.0 * (n * 0.3).sin(),
            );
            let all = (0..swept.len())
                .map(|k| swept.at(k, p))
                .fold(f64::INFINITY, f64::min);
            assert!((swept.nearest(p).distance - all).abs() < 1e-5);
        }
    }

    #[test]
    fn fast_ways_are_filled_in_and_slow_ones_thinned() {
        let shape = Tool::glenoid_reamer().shape;
        let fast = Swept::new(shape.clone(), &press::sweep().poses);
        assert!(fast.len() > 2 * 2400, "{}", fast.len());
        let slow = Swept::new(shape, &press::reamer_press().poses);
        assert!(slow.len() < 3000, "{}", slow.len());
        let end = press::reamer_press().poses[4000];
        assert_eq!(*slow.bone_from_tool(slow.len() - 1), end);
    }
}
