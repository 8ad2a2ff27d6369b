//! A tool that is sampled on a grid ([`SdfGrid`]), placed in the lattice.
//!
//! A voxel's value is the grid's trilinear value at ((p + i s.x) + j s.y) + k s.z, p = the brick's first
//! voxel and **s** the steps from voxel to voxel in the tool frame (`f32`, p from `f64`), in units of the
//! stored distance, rounded as for any tool. Where one smooth piece of the grid ([`Patch`]) holds for a
//! whole line, it is that polynomial's value instead, at the line's middle from the piece's plus
//! (i s.x + j s.y) + k s.z from there; within 4 µm of the other. There is no curvature correction: a mesh
//! does not say what its facets stand for.
#![expect(
    clippy::cast_possible_truncation,
    clippy::inline_always,
    reason = "lengths in mm become f32 inside a brick; lanes must melt into the job"
)]

use crate::grid::{BRICKS_PER_CHUNK, Grid, LINES_PER_BRICK, brick_origin, line_origin};
use crate::lanes::Lanes;
use crate::pose::Pose;
use crate::tool::patches::{Patch, TOLERANCE_MM};
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
    #[inline(never)]
    fn sort(&self, middle: Vec3, radius: f32) -> Box3 {
        let value = self.samples.signed_distance(middle);
        let near = self.samples.near_slack_mm() + 2.0 * TOLERANCE_MM;
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

    /// Middle of a line of the brick whose first voxel lies at `first`.
    #[inline(always)]
    fn middle(&self, first: Vec3, line: usize) -> Vec3 {
        let [x, y, z] = line_origin(line % LINES_PER_BRICK).map(|v| v as f32);
        let across = first + self.step[0] * (x + 1.5);
        (across + self.step[1] * (y + 1.5)) + self.step[2] * (z + 0.5)
    }

    /// What is to be done with a line, and its values where they are to be computed.
    #[inline(always)]
    pub(super) fn line<L: Lanes>(
        &self,
        l: L,
        offsets: &Offsets<L::F>,
        first: Vec3,
        line: usize,
    ) -> (Box3, L::I) {
        let middle = self.middle(first, line);
        if let Some((patch, from)) = self.samples.patch(middle, self.line_radius) {
            let value = patch.at(from);
            let reach = self.band_mm + patch.steep * self.line_radius + 1e-3;
            if value > reach {
                return (Box3::Skip, l.splat_i(0));
            }
            if value < -reach {
                return (Box3::Fill, l.splat_i(-i16::MAX));
            }
            return (Box3::Look, self.smooth(l, offsets, patch, from));
        }
        let what = self.sort(middle, self.line_radius);
        let values = match what {
            Box3::Skip => l.splat_i(0),
            Box3::Fill => l.splat_i(-i16::MAX),
            Box3::Look => {
                let [low, high] = self.look_up(first, line);
                l.round(l.load(&low), l.load(&high))
            }
        };
        (what, values)
    }

    /// The values of a line about the point `from` of a patch.
    #[inline(always)]
    fn smooth<L: Lanes>(&self, l: L, offsets: &Offsets<L::F>, patch: &Patch, from: Vec3) -> L::I {
        let units = l.splat(self.units_per_mm);
        let low = of_patch(l, patch, from, &offsets.0[0]);
        let high = of_patch(l, patch, from, &offsets.0[1]);
        l.round(l.mul(low, units), l.mul(high, units))
    }

    /// The values of a line's two layers, units, each read from the grid.
    #[inline(never)]
    fn look_up(&self, first: Vec3, line: usize) -> [[f32; 16]; 2] {
        let o = line_origin(line % LINES_PER_BRICK);
        let mut values = [[0.0; 16]; 2];
        for (layer, values) in values.iter_mut().enumerate() {
            let rise = self.step[2] * (o[2] + layer) as f32;
            for (n, value) in values.iter_mut().enumerate() {
                let across = first + self.step[0] * (o[0] + (n & 3)) as f32;
                let p = (across + self.step[1] * (o[1] + (n >> 2)) as f32) + rise;
                *value = self.samples.signed_distance(p) * self.units_per_mm;
            }
        }
        values
    }
}

/// Voxels of a line's two layers from its middle, tool frame, mm.
pub(super) struct Offsets<F>([[F; 3]; 2]);

impl<F: Copy> Offsets<F> {
    /// For a placed tool; nothing of use for none.
    #[inline(always)]
    pub(super) fn new<L: Lanes<F = F>>(l: L, sampled: Option<&Sampled<'_>>) -> Self {
        let step = sampled.map_or([Vec3::ZERO; 3], |s| s.step);
        let layer = |rise: f32| {
            let points: [Vec3; 16] = core::array::from_fn(|n| {
                let across = step[0] * ((n & 3) as f32 - 1.5) + step[1] * ((n >> 2) as f32 - 1.5);
                across + step[2] * rise
            });
            let [x, y, z] = [0, 1, 2].map(|a| points.map(|p| p[a]));
            [l.load(&x), l.load(&y), l.load(&z)]
        };
        Self([layer(-0.5), layer(0.5)])
    }
}

/// [`Patch::at`] at 16 points.
#[inline(always)]
fn of_patch<L: Lanes>(l: L, patch: &Patch, from: Vec3, offsets: &[L::F; 3]) -> L::F {
    let p = [
        l.add(l.splat(from.x), offsets[0]),
        l.add(l.splat(from.y), offsets[1]),
        l.add(l.splat(from.z), offsets[2]),
    ];
    let [xx, xy, xz, yy, yz, zz] = patch.second;
    let by = |v: f32, p: L::F| l.mul(p, l.splat(v));
    let a = l.add(by(xx, p[0]), by(xy, p[1]));
    let a = l.mul(l.add(a, l.add(by(xz, p[2]), l.splat(patch.first[0]))), p[0]);
    let b = l.add(by(yy, p[1]), by(yz, p[2]));
    let b = l.mul(l.add(b, l.splat(patch.first[1])), p[1]);
    let c = l.mul(l.add(by(zz, p[2]), l.splat(patch.first[2])), p[2]);
    l.add(l.add(a, b), l.add(c, l.splat(patch.value)))
}
