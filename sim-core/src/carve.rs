//! Carving: `cut = min(cut, signed distance to the tool)` along a step of the tool, with the exact
//! removed volume by tissue class, structure and tool.
//!
//! Culling by Lipschitz bounds at two levels (8³ bricks, 4³ cells). The order of work is a function
//! of the arguments alone, so servo, publisher and replay get the same bits.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    reason = "voxel indices are below 4096; distances are clamped before the cast; f64 becomes f32 inside a tool"
)]

use crate::bone::{Bone, Occupancy, cell_origin};
use crate::broad::{Obb, chunk_range};
use crate::cut::{Cut, MAX_TOOLS, Totals};
use crate::grid::{BRICK, BRICK_VOXELS, CHUNK, brick_origin};
use crate::pose::Pose;
use crate::tissue::TISSUES;
use crate::tool::Tool;
use glam::{DMat3, DVec3, Vec3};

/// Most poses at which one step is stamped.
pub const MAX_STAMPS: u32 = 16;

/// One step of a tool through the bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarveStep {
    /// Index of the tool.
    pub tool: u8,
    /// `bone_from_tool` at the beginning.
    pub before: Pose,
    /// `bone_from_tool` at the end.
    pub after: Pose,
}

/// Number of poses at which a step is stamped, the last being its end: no point of the tool moves
/// more than a quarter of the smallest spacing between two of them, which leaves scallops of
/// s²/(8 R) < 1 µm on a face of R ≥ 4 mm at 0.5 mm spacing. At most [`MAX_STAMPS`].
pub fn stamps(bone: &Bone, tool: &Tool, step: &CarveStep) -> u32 {
    let reach = {
        let b = tool.shape.bounds();
        b.lo.abs().max(b.hi.abs()).length()
    };
    // |2 sin(θ/2)| of the turn between the two rotations
    let turn = 2.0
        * (step.before.rotation.conjugate() * step.after.rotation)
            .xyz()
            .length();
    let moved = (step.after.translation - step.before.translation).length() + reach * turn;
    let spacing = 0.25 * bone.grid().spacing_mm.min_element();
    let count = (moved / spacing).ceil();
    if count >= f64::from(MAX_STAMPS) {
        MAX_STAMPS
    } else {
        (count as u32).max(1)
    }
}

/// Carves one step and calls `changed(chunk, brick)` for each brick whose values changed (a brick
/// may come more than once).
///
/// Work is bounded by [`MAX_STAMPS`] × the bricks in the tool's box. A pose that is not finite, or a
/// tool index beyond [`MAX_TOOLS`], carves nothing.
pub fn carve(
    bone: &Bone,
    cut: &mut Cut,
    tool: &Tool,
    step: &CarveStep,
    changed: &mut impl FnMut(usize, usize),
) {
    cut.bump_revision();
    if !step.before.is_valid() || !step.after.is_valid() || usize::from(step.tool) >= MAX_TOOLS {
        return;
    }
    let count = stamps(bone, tool, step);
    for n in 1..=count {
        let pose = if n == count {
            step.after
        } else {
            step.before
                .interpolate(&step.after, f64::from(n) / f64::from(count))
        };
        stamp(bone, cut, tool, &pose, step.tool, changed);
    }
}

fn stamp(
    bone: &Bone,
    cut: &mut Cut,
    tool: &Tool,
    bone_from_tool: &Pose,
    tool_index: u8,
    changed: &mut impl FnMut(usize, usize),
) {
    let grid = bone.grid();
    let (lo, hi) = Obb::of_tool(&tool.shape.bounds(), bone_from_tool, grid.band_mm()).aabb();
    let range = chunk_range(bone, lo, hi);
    let scan = Scan::new(bone, tool, bone_from_tool, tool_index);
    for z in range.lo[2]..range.hi[2] {
        for y in range.lo[1]..range.hi[1] {
            for x in range.lo[0]..range.hi[0] {
                if let Some(chunk) = bone.chunk_at([x, y, z]) {
                    scan.chunk(cut, chunk, [x, y, z], changed);
                }
            }
        }
    }
}

/// What one stamp knows.
struct Scan<'a> {
    bone: &'a Bone,
    tool: &'a Tool,
    tool_index: u8,
    tool_from_bone: Pose,
    // tool-frame steps from voxel to voxel, mm
    step: [Vec3; 3],
    band: f32,
    units_per_mm: f32,
    // half diagonals of a brick and of a 4³ cell of voxel centres, mm
    brick_radius: f32,
    cell_radius: f32,
    occupancy: Occupancy,
}

/// Volume removed by one brick's update.
#[derive(Default)]
struct Removed {
    by_class: [i64; TISSUES],
    units: i64,
    moment: [i64; 3],
}

impl<'a> Scan<'a> {
    fn new(bone: &'a Bone, tool: &'a Tool, bone_from_tool: &Pose, tool_index: u8) -> Self {
        let grid = bone.grid();
        let tool_from_bone = bone_from_tool.inverse();
        let axes = DMat3::from_quat(tool_from_bone.rotation);
        let h = grid.spacing_mm;
        Self {
            bone,
            tool,
            tool_index,
            tool_from_bone,
            step: [
                (axes.x_axis * h.x).as_vec3(),
                (axes.y_axis * h.y).as_vec3(),
                (axes.z_axis * h.z).as_vec3(),
            ],
            band: grid.band_mm() as f32,
            units_per_mm: 1.0 / grid.quantum_mm(),
            brick_radius: (3.5 * h.length()) as f32 + 1e-3,
            cell_radius: (1.5 * h.length()) as f32 + 1e-3,
            occupancy: Occupancy::new(grid),
        }
    }

    fn chunk(
        &self,
        cut: &mut Cut,
        chunk: usize,
        coord: [usize; 3],
        changed: &mut impl FnMut(usize, usize),
    ) {
        let mut bricks = self.bone.bony_bricks(chunk) & !cut.emptied(chunk);
        while bricks != 0 {
            let brick = bricks.trailing_zeros() as usize;
            bricks &= bricks - 1;
            let o = brick_origin(brick);
            let origin: [usize; 3] = core::array::from_fn(|a| coord[a] * CHUNK + o[a]);
            let first = self.in_tool(origin);
            let centre = first + (self.step[0] + self.step[1] + self.step[2]) * 3.5;
            let d = self.tool.shape.signed_distance(centre);
            if d - self.brick_radius >= self.band {
                continue;
            }
            let emptied = d + self.brick_radius <= -self.band;
            if self.brick(cut, (chunk, brick), origin, first) {
                changed(chunk, brick);
            }
            if emptied {
                cut.set_emptied(chunk, brick);
            }
        }
    }

    /// Tool-frame position of a voxel's centre: the difference in f64, so that f32 keeps 1e-4 mm
    /// however far the bone lies from the origin.
    fn in_tool(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        let p: DVec3 = self.bone.grid().centre(i, j, k);
        self.tool_from_bone.point(p).as_vec3()
    }

    /// Updates one brick, cell by cell; true where a value changed.
    fn brick(
        &self,
        cut: &mut Cut,
        (chunk, brick): (usize, usize),
        origin: [usize; 3],
        first: Vec3,
    ) -> bool {
        let mut removed = Removed::default();
        let mut any = false;
        let mut cells = self.bone.bony_cells(chunk, brick);
        while cells != 0 {
            let cell = cells.trailing_zeros() as usize;
            cells &= cells - 1;
            let at = cell_origin(cell);
            let corner = first
                + self.step[0] * at[0] as f32
                + self.step[1] * at[1] as f32
                + self.step[2] * at[2] as f32;
            let centre = corner + (self.step[0] + self.step[1] + self.step[2]) * 1.5;
            let d = self.tool.shape.signed_distance(centre);
            if d - self.cell_radius >= self.band {
                continue;
            }
            let inside = d + self.cell_radius <= -self.band;
            let place = Place {
                chunk,
                brick,
                at,
                origin,
            };
            any |= self.cell(cut, &place, (!inside).then_some(corner), &mut removed);
        }
        removed.book(&mut cut.totals, self.tool_index);
        any
    }

    /// Updates a 4³ cell row by row; `corner` is its lowest voxel in the tool frame, `None` where
    /// the cell lies deeper than the band inside the tool.
    fn cell(
        &self,
        cut: &mut Cut,
        place: &Place,
        corner: Option<Vec3>,
        removed: &mut Removed,
    ) -> bool {
        let mut any = false;
        for z in 0..4 {
            for y in 0..4 {
                let new = match corner {
                    None => [-i16::MAX; 4],
                    Some(corner) => {
                        let row = corner + self.step[1] * y as f32 + self.step[2] * z as f32;
                        [0.0f32, 1.0, 2.0, 3.0].map(|n| {
                            let p = row + self.step[0] * n;
                            self.quantise(self.tool.shape.signed_distance(p))
                        })
                    }
                };
                let local = ((place.at[2] + z) * BRICK + place.at[1] + y) * BRICK + place.at[0];
                any |= self.row(cut, place, (local, new), removed);
            }
        }
        any
    }

    /// Takes the smaller value for four voxels in a row and books what that removes.
    fn row(
        &self,
        cut: &mut Cut,
        place: &Place,
        (local, new): (usize, [i16; 4]),
        removed: &mut Removed,
    ) -> bool {
        let voxel = place.brick * BRICK_VOXELS + local;
        let old = cut.row(place.chunk, voxel);
        if (0..4).all(|n| new[n] >= old[n]) {
            return false;
        }
        let values = cut.brick_mut(place.chunk, place.brick);
        for n in 0..4 {
            values[local + n] = old[n].min(new[n]);
        }
        let data = self.bone.chunk(place.chunk);
        for n in 0..4 {
            let solid = data.solid[voxel + n];
            let before = self.occupancy.units(solid.min(old[n]));
            let units = before - self.occupancy.units(solid.min(old[n].min(new[n])));
            if units != 0 {
                let at = [local & 7, (local >> 3) & 7, local >> 6];
                let index = [
                    place.origin[0] + at[0] + n,
                    place.origin[1] + at[1],
                    place.origin[2] + at[2],
                ];
                cut.totals.by_label[usize::from(data.label[voxel + n])] += units;
                removed.add(data.class[voxel + n], units, index);
            }
        }
        true
    }

    // adding 32768.5 before the cast rounds to nearest without a library call; a NaN becomes 0 − 32768
    // and is clamped like any other value
    fn quantise(&self, d: f32) -> i16 {
        let units = (d * self.units_per_mm).clamp(-32767.0, 32767.0);
        ((units + 32768.5) as i32 - 32768) as i16
    }
}

/// Where a cell lies.
struct Place {
    chunk: usize,
    brick: usize,
    // lowest voxel of the cell inside its brick
    at: [usize; 3],
    // lowest voxel of the brick in the lattice
    origin: [usize; 3],
}

impl Removed {
    fn add(&mut self, class: u8, units: i64, index: [usize; 3]) {
        self.units += units;
        self.by_class[usize::from(class) % TISSUES] += units;
        for (sum, index) in self.moment.iter_mut().zip(index) {
            *sum += units * index as i64;
        }
    }

    fn book(&self, totals: &mut Totals, tool: u8) {
        if self.units == 0 {
            return;
        }
        for (sum, units) in totals.by_class.iter_mut().zip(self.by_class) {
            *sum += units;
        }
        totals.by_tool[usize::from(tool)] += self.units;
        for (sum, moment) in totals.moment.iter_mut().zip(self.moment) {
            *sum += moment;
        }
    }
}
