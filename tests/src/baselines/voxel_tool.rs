//! A tool as the thesis keeps it: a dense grid of cubic voxels (Alg. 2.1), and the lists that other
//! methods make of it.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the number of cells is bounded before anything is cast"
)]

use glam::{DVec3, Vec3};
use osteon_sim_core::tool::{Shape, ToolBox};
use std::sync::Arc;

/// Edge of a tool voxel that the thesis takes, mm (ch. 2.3).
pub const THESIS_VOXEL_MM: f64 = 0.5;

/// Most cells of a tool's grid: indices fit in an `i32`, coordinates are exact in an `f32`.
const MAX_CELLS: usize = 1 << 24;

/// Signed distance in the tool frame, mm, negative inside.
pub type Distance = Arc<dyn Fn(Vec3) -> f32 + Send + Sync>;

/// A voxelised tool, and the exact one that it was made of.
///
/// Theirs (thesis, Alg. 2.1): cubic voxels, a dense grid that is aligned to multiples of the voxel's
/// edge and reaches one voxel beyond the model, `i16` values 0 (empty) and 1 (solid). Inferred: a
/// tie rounds to the even multiple (this alone gives the grids of Table 3.5 but for one layer), and
/// a cell is solid where its centre is inside (the thesis leaves that to its references).
#[derive(Clone)]
pub struct VoxelTool {
    size_mm: f64,
    lo: DVec3,
    dims: [usize; 3],
    cells: Vec<i16>,
    bits: Vec<u32>,
    solid: Vec<[u16; 3]>,
    surface: Vec<[u16; 3]>,
    bounds: ToolBox,
    distance: Distance,
}

impl core::fmt::Debug for VoxelTool {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("VoxelTool")
            .field("size_mm", &self.size_mm)
            .field("dims", &self.dims)
            .field("solid", &self.solid.len())
            .field("surface", &self.surface.len())
            .finish_non_exhaustive()
    }
}

impl VoxelTool {
    /// Voxelises the tool whose signed distance (tool frame, mm, negative inside) is `distance` and
    /// which lies in `bounds` (tool frame, mm), with voxels of edge `size_mm`. The distance must not
    /// change faster than the point moves, or nodes are settled wrongly. `None` where the size
    /// or the box is no positive number, or the grid would have more than 2²⁴ cells.
    pub fn new(
        size_mm: f64,
        bounds: ToolBox,
        distance: impl Fn(Vec3) -> f32 + Send + Sync + 'static,
    ) -> Option<Self> {
        let (lo, dims) = grid_of(size_mm, &bounds)?;
        let mut tool = Self {
            size_mm,
            lo,
            dims,
            cells: vec![0; dims[0] * dims[1] * dims[2]],
            bits: vec![0; (dims[0] * dims[1] * dims[2]).div_ceil(32)],
            solid: Vec::new(),
            surface: Vec::new(),
            bounds,
            distance: Arc::new(distance),
        };
        tool.fill();
        Some(tool)
    }

    /// One of the product's shapes, voxelised.
    pub fn of_shape(size_mm: f64, shape: Shape) -> Option<Self> {
        Self::new(size_mm, shape.bounds(), move |p| shape.signed_distance(p))
    }

    fn fill(&mut self) {
        let coords = |dims: [usize; 3]| {
            (0..dims[2]).flat_map(move |k| {
                (0..dims[1]).flat_map(move |j| (0..dims[0]).map(move |i| [i, j, k]))
            })
        };
        for (at, c) in coords(self.dims).enumerate() {
            let centre = self.lo + (DVec3::from_array(c.map(|n| n as f64)) + 0.5) * self.size_mm;
            // the padding stays empty, whatever the distance says there
            let border = (0..3).any(|a| c[a] == 0 || c[a] + 1 == self.dims[a]);
            if !border && (self.distance)(centre.as_vec3()) < 0.0 {
                self.cells[at] = 1;
                self.bits[at / 32] |= 1 << (at % 32);
                self.solid.push(c.map(|n| n as u16));
            }
        }
        let [dx, dy, _] = self.dims;
        // every solid cell has six neighbours: none lies on the border
        for &c in &self.solid {
            let at = self.index(c.map(usize::from));
            let steps = [1, dx, dx * dy];
            if steps
                .iter()
                .any(|s| self.cells[at - s] == 0 || self.cells[at + s] == 0)
            {
                self.surface.push(c);
            }
        }
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    /// Edge of a cell, mm.
    pub fn size_mm(&self) -> f64 {
        self.size_mm
    }

    /// Cells along x, y, z, the padding included.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The tool's box of Alg. 2.1, tool frame, mm: the grid's outer faces.
    pub fn grid_box(&self) -> ToolBox {
        let dims = DVec3::from_array(self.dims.map(|n| n as f64));
        ToolBox {
            lo: self.lo,
            hi: self.lo + dims * self.size_mm,
        }
    }

    /// The exact tool's box, tool frame, mm.
    pub fn bounds(&self) -> ToolBox {
        self.bounds
    }

    /// Exact signed distance of a point in the tool frame, mm, negative inside.
    pub fn distance(&self, p: Vec3) -> f32 {
        (self.distance)(p)
    }

    /// All cells, x fastest, 1 = solid: what the thesis keeps.
    pub fn cells(&self) -> &[i16] {
        &self.cells
    }

    /// The same, one bit a cell, 32 cells a word.
    pub fn bits(&self) -> &[u32] {
        &self.bits
    }

    /// Coordinates of the solid cells, in the grid's order.
    pub fn solid(&self) -> &[[u16; 3]] {
        &self.solid
    }

    /// Coordinates of the solid cells that have an empty one beside a face, in the grid's order.
    pub fn surface(&self) -> &[[u16; 3]] {
        &self.surface
    }
}

/// Lowest corner (tool frame, mm) and dimensions of the grid, Alg. 2.1.
fn grid_of(size_mm: f64, bounds: &ToolBox) -> Option<(DVec3, [usize; 3])> {
    let sound = bounds.lo.is_finite() && bounds.hi.is_finite() && bounds.lo.cmple(bounds.hi).all();
    if !sound || !(0.01..=20.0).contains(&size_mm) {
        return None;
    }
    let to_multiple = |v: DVec3| v.to_array().map(|c| (c / size_mm).round_ties_even());
    let lo = to_multiple(bounds.lo - 0.5 * size_mm).map(|n| n - 1.0);
    let hi = to_multiple(bounds.hi + 0.5 * size_mm).map(|n| n + 1.0);
    // both are whole numbers of cells: the thesis's ceiling has nothing left to round
    let dims: [f64; 3] = core::array::from_fn(|a| hi[a] - lo[a]);
    (dims[0] * dims[1] * dims[2] <= MAX_CELLS as f64).then(|| {
        let lo = DVec3::from_array(lo) * size_mm;
        (lo, dims.map(|n| n as usize))
    })
}
