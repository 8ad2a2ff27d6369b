//! Broad phase: oriented boxes by the separating-axis test, and the range of chunks in reach.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the lattice before the cast"
)]

use crate::bone::Bone;
use crate::grid::CHUNK;
use crate::pose::Pose;
use crate::tool::ToolBox;
use glam::{DMat3, DVec3};

/// An oriented box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obb {
    /// Centre, mm.
    pub centre: DVec3,
    /// Half edges along the box's own axes, mm, none negative.
    pub half: DVec3,
    /// Columns: the box's axes, orthonormal.
    pub axes: DMat3,
}

impl Obb {
    /// A box along the axes of the frame.
    pub fn aligned(lo: DVec3, hi: DVec3) -> Self {
        Self {
            centre: 0.5 * (lo + hi),
            half: 0.5 * (hi - lo),
            axes: DMat3::IDENTITY,
        }
    }

    /// A tool's box at a pose, grown by `margin_mm` on all sides.
    pub fn of_tool(tool: &ToolBox, bone_from_tool: &Pose, margin_mm: f64) -> Self {
        Self {
            centre: bone_from_tool.point(0.5 * (tool.lo + tool.hi)),
            half: 0.5 * (tool.hi - tool.lo) + DVec3::splat(margin_mm),
            axes: DMat3::from_quat(bone_from_tool.rotation),
        }
    }

    /// Lowest and highest corner of the axis-aligned box around this one.
    pub fn aabb(&self) -> (DVec3, DVec3) {
        let a = self.axes;
        let reach = a.x_axis.abs() * self.half.x
            + a.y_axis.abs() * self.half.y
            + a.z_axis.abs() * self.half.z;
        (self.centre - reach, self.centre + reach)
    }

    fn reach_along(&self, axis: DVec3) -> f64 {
        self.half.x * axis.dot(self.axes.x_axis).abs()
            + self.half.y * axis.dot(self.axes.y_axis).abs()
            + self.half.z * axis.dot(self.axes.z_axis).abs()
    }

    /// True unless one of the 15 axes of the separating-axis theorem (Gottschalk, Lin, Manocha
    /// 1996) separates the boxes. Touching boxes overlap; for parallel edges the cross product
    /// vanishes and cannot separate, which is right.
    pub fn overlaps(&self, other: &Self) -> bool {
        let between = other.centre - self.centre;
        let separated = |axis: DVec3| {
            between.dot(axis).abs() > self.reach_along(axis) + other.reach_along(axis) + 1e-9
        };
        let mine = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis];
        let theirs = [other.axes.x_axis, other.axes.y_axis, other.axes.z_axis];
        if mine.into_iter().chain(theirs).any(separated) {
            return false;
        }
        !mine
            .into_iter()
            .any(|a| theirs.into_iter().any(|b| separated(a.cross(b))))
    }
}

/// Range of chunk coordinates, half open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChunkRange {
    /// First coordinate, x, y, z.
    pub lo: [usize; 3],
    /// One past the last.
    pub hi: [usize; 3],
}

/// The chunks that a box of the bone frame (mm) can touch: those that hold a voxel inside it.
/// Empty (`lo == hi`) where it misses the lattice or is not finite.
pub fn chunk_range(bone: &Bone, lo: DVec3, hi: DVec3) -> ChunkRange {
    let grid = bone.grid();
    let mut range = ChunkRange {
        lo: [0; 3],
        hi: [0; 3],
    };
    let (first, last) = (
        (lo / grid.spacing_mm).ceil().to_array(),
        (hi / grid.spacing_mm).floor().to_array(),
    );
    for a in 0..3 {
        let top = grid.dims[a] as f64 - 1.0;
        // written so that a NaN fails it
        let overlaps = first[a] <= top && last[a] >= 0.0 && first[a] <= last[a];
        if !overlaps {
            return ChunkRange {
                lo: [0; 3],
                hi: [0; 3],
            };
        }
        range.lo[a] = first[a].max(0.0) as usize / CHUNK;
        range.hi[a] = last[a].min(top) as usize / CHUNK + 1;
    }
    range
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Independent oracle: the boxes overlap where alternating projection brings two points, one of
    /// each box, together (convex sets: it converges to the distance).
    fn distance_by_projection(a: &Obb, b: &Obb) -> f64 {
        let clamp_into = |o: &Obb, p: DVec3| {
            let local = o.axes.transpose() * (p - o.centre);
            o.centre + o.axes * local.clamp(-o.half, o.half)
        };
        let mut p = a.centre;
        let mut q = b.centre;
        for _ in 0..3000 {
            q = clamp_into(b, p);
            p = clamp_into(a, q);
        }
        (p - q).length()
    }

    #[test]
    fn separating_axis_agrees_with_the_distance_of_the_boxes() {
        let mut seed = 7u64;
        let mut random = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((seed >> 33) as f64) / f64::from(1u32 << 31)
        };
        let mut both = [0; 2];
        for _ in 0..400 {
            let mut boxed = |spread: f64| Obb {
                centre: DVec3::new(random(), random(), random()) * spread,
                half: DVec3::new(random(), random(), random()) + 0.1,
                axes: DMat3::from_quat(DQuat::from_euler(
                    glam::EulerRot::XYZ,
                    random() * 6.0,
                    random() * 6.0,
                    random() * 6.0,
                )),
            };
            let (a, b) = (boxed(0.0), boxed(1.8));
            let distance = distance_by_projection(&a, &b);
            if distance > 1e-3 {
                assert!(!a.overlaps(&b), "apart by {distance}");
                both[0] += 1;
            } else if distance < 1e-7 {
                assert!(a.overlaps(&b) && b.overlaps(&a));
                both[1] += 1;
            }
        }
        assert!(both[0] > 50 && both[1] > 50, "{both:?}");
    }
}
