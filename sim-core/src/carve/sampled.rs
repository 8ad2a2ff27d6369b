//! A tool that is sampled on a grid ([`SdfGrid`]), placed in the lattice.
//!
//! A voxel's value is the grid's trilinear value at ((p + i s.x) + j s.y) + k s.z, p = the brick's first
//! voxel and **s** the steps from voxel to voxel in the tool frame (`f32`, p from `f64`), in units of the
//! stored distance, rounded as for any tool. It has no curvature correction: a mesh does not say what
//! its facets stand for.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "lengths in mm become f32 inside a brick; lanes must melt into the job"
)]

use crate::grid::{BRICKS_PER_CHUNK, Grid, LINES_PER_BRICK, brick_origin, line_origin};
use crate::lanes::Lanes;
use crate::pose::Pose;
use crate::tool::sdf_grid::{BAND_MM, SdfGrid};
use glam::{DMat3, Vec3};

/// The tool in the lattice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampled<'a> {
    samples: &'a SdfGrid,
    tool_from_bone: Pose,
    lattice: &'a Grid,
    // from voxel to voxel, tool frame, mm
    step: [Vec3; 3],
    units_per_mm: f32,
    band_mm: f32,
    // from a box's middle to its farthest voxel, mm
    chunk_radius: f32,
    brick_radius: f32,
    line_radius: f32,
}

/// What is to be done with a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Box3 {
    /// Farther than the band outside the tool.
    Skip,
    /// Deeper than the band inside.
    Fill,
    /// In between.
    Look,
}

impl<'a> Sampled<'a> {
    pub(super) fn new(lattice: &'a Grid, samples: &'a SdfGrid, bone_from_tool: &Pose) -> Self {
        let tool_from_bone = bone_from_tool.inverse();
        let axes = DMat3::from_quat(tool_from_bone.rotation);
        let h = lattice.spacing_mm;
        let diagonal = |edge: [f64; 3]| (glam::DVec3::from_array(edge) * h).length() as f32;
        Self {
            samples,
            tool_from_bone,
            lattice,
            step: [
                (axes.x_axis * h.x).as_vec3(),
                (axes.y_axis * h.y).as_vec3(),
                (axes.z_axis * h.z).as_vec3(),
            ],
            units_per_mm: 1.0 / lattice.quantum_mm(),
            band_mm: lattice.band_mm() as f32,
            chunk_radius: diagonal([15.5; 3]),
            brick_radius: diagonal([3.5; 3]),
            line_radius: diagonal([1.5, 1.5, 0.5]),
        }
    }

    /// First voxel of a brick in the tool frame, mm.
    #[inline(always)]
    pub(super) fn first(&self, coord: [usize; 3], brick: usize) -> Vec3 {
        let o = brick_origin(brick % BRICKS_PER_CHUNK);
        let at = |a: usize| coord[a] * crate::grid::CHUNK + o[a];
        let p = self.lattice.centre(at(0), at(1), at(2));
        self.tool_from_bone.point(p).as_vec3()
    }

    fn offset(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.step[0] * x + self.step[1] * y + self.step[2] * z
    }

    /// Sorts a box of voxels. A sample lies within `near` of the distance itself, or both lie beyond
    /// [`BAND_MM`]; however far away, within [`SdfGrid::slack_mm`].
    fn sort(&self, middle: Vec3, radius: f32) -> Box3 {
        let value = self.samples.signed_distance(middle);
        let near = self.samples.near_slack_mm();
        let size = value.abs();
        let distance = (size.min(BAND_MM) - near).max(size - self.samples.slack_mm());
        // in a lattice whose band is wider than the samples' own, the coarse ones matter too
        let off = if self.band_mm + near > BAND_MM {
            self.samples.slack_mm()
        } else {
            near
        };
        let reach = self.band_mm + radius + off + 1e-3;
        if distance < reach {
            Box3::Look
        } else if value > 0.0 {
            Box3::Skip
        } else {
            Box3::Fill
        }
    }

    /// Whether the tool reaches a chunk at all.
    pub(super) fn reaches(&self, coord: [usize; 3]) -> bool {
        let middle = self.first(coord, 0) + self.offset(15.5, 15.5, 15.5);
        self.sort(middle, self.chunk_radius) != Box3::Skip
    }

    /// Sorts a brick whose first voxel lies at `first`.
    pub(super) fn brick(&self, first: Vec3) -> Box3 {
        self.sort(first + self.offset(3.5, 3.5, 3.5), self.brick_radius)
    }

    /// Sorts a brick's lines: those to be filled and those to be computed.
    pub(super) fn lines(&self, first: Vec3, live: u16) -> [u16; 2] {
        let (mut full, mut near) = (0, 0);
        for line in (0..LINES_PER_BRICK).filter(|line| live >> line & 1 == 1) {
            let o = line_origin(line).map(|v| v as f32);
            let middle = first + self.offset(o[0] + 1.5, o[1] + 1.5, o[2] + 0.5);
            match self.sort(middle, self.line_radius) {
                Box3::Skip => {}
                Box3::Fill => full |= 1 << line,
                Box3::Look => near |= 1 << line,
            }
        }
        [full, near]
    }

    /// The stored values of a line.
    #[inline(always)]
    pub(super) fn line<L: Lanes>(&self, l: L, first: Vec3, line: usize) -> L::I {
        let low = self.layer(l, first, line, 0);
        l.round(low, self.layer(l, first, line, 1))
    }

    #[inline(always)]
    fn layer<L: Lanes>(&self, l: L, first: Vec3, line: usize, layer: usize) -> L::F {
        let o = line_origin(line % LINES_PER_BRICK);
        let rise = self.step[2] * (o[2] + layer) as f32;
        let mut values = [0.0; 16];
        for y in 0..4 {
            for x in 0..4 {
                let across = first + self.step[0] * (o[0] + x) as f32;
                let p = (across + self.step[1] * (o[1] + y) as f32) + rise;
                values[4 * y + x] = self.samples.signed_distance(p) * self.units_per_mm;
            }
        }
        l.load(&values)
    }
}
