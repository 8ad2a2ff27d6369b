//! A tool of any shape: the signed distance on a cubic grid around its mesh.
//!
//! Node values are rounded to [`UNIT_MM`] and held within ±[`LIMIT_MM`]; between nodes they are
//! interpolated trilinearly. Within [`BAND_MM`] of the surface a node holds the true distance to the
//! nearest triangle; farther away only every fourth node along each axis does, and those between are
//! interpolated. The sign is that of the winding number less ½, so a hole is closed by the surface
//! where that is zero. Bodies that overlap are one solid; beside a face that another body buries,
//! points are called less deep than they are.

use super::ToolBox;
use super::bvh::{Bvh, Triangle};
use super::mesh::{Mesh, MeshError};
use super::patches::{Patch, Patches};
use glam::Vec3;

/// One unit of a stored value, mm.
pub const UNIT_MM: f32 = 1.0 / 2048.0;
/// Largest stored distance, mm.
pub const LIMIT_MM: f32 = 32767.0 * UNIT_MM;
/// Spacing where none is asked for, mm; a tool too large for it gets a larger one.
pub const SPACING_MM: f32 = 0.25;
/// Room around the mesh, mm, at least.
pub const MARGIN_MM: f32 = 2.75;
/// Nodes nearer to the surface than this hold true distances, mm.
pub const BAND_MM: f32 = 2.5;
/// Every so many nodes hold a true distance everywhere.
const STRIDE: usize = 4;
/// Most nodes: 64 MiB of values.
pub const MAX_NODES: usize = 32 << 20;
/// Points of the grid's own check, and how far from the surface they lie, mm.
const CHECKS: u16 = 8192;
const CHECK_MM: f32 = 2.0;

/// Runs a pure function for every number below the first argument; results in order. The function
/// for one core is [`one_by_one`]; with more the values are the same, bit for bit.
pub type Layers<'a> = dyn Fn(usize, &(dyn Fn(usize) -> Vec<i16> + Sync)) -> Vec<Vec<i16>> + 'a;

/// [`Layers`] on the calling thread.
pub fn one_by_one(count: usize, layer: &(dyn Fn(usize) -> Vec<i16> + Sync)) -> Vec<Vec<i16>> {
    (0..count).map(layer).collect()
}

/// The signed distance of a tool, sampled; tool frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SdfGrid {
    /// Place of the first node, mm.
    pub origin: Vec3,
    /// Edge of a cell, mm.
    pub spacing_mm: f32,
    /// Nodes along x, y, z; at least 2 each.
    pub dims: [usize; 3],
    /// Signed distances, negative inside, [`UNIT_MM`] each; x runs fastest.
    pub values: Vec<i16>,
    /// Largest difference to the mesh's own distance found at off-grid points within 2 mm of the
    /// surface, mm.
    pub error_mm: f32,
    /// The same at points on the surface, root of the mean square, mm.
    pub surface_rms_mm: f32,
    /// Box around the mesh, mm.
    pub bounds: ToolBox,
    // of the places of the last nodes in cells; and cells per mm
    last: Vec3,
    per_mm: f32,
    patches: Patches,
}

/// Every [`STRIDE`]-th node's value.
struct Coarse {
    values: Vec<i16>,
    row: usize,
    layer: usize,
    /// Units from the surface beyond which a cell of this grid is far from it.
    far: f32,
}

impl Coarse {
    /// The value of a node far from the surface, from the corners of the coarse cell around it.
    fn far_value(&self, node: [usize; 3]) -> Option<i16> {
        let cell = node.map(|n| n / STRIDE);
        let t = node.map(|n| (n % STRIDE) as f32 / STRIDE as f32);
        let first = cell[2] * self.layer + cell[1] * self.row + cell[0];
        let steps = [1, self.row, self.layer];
        let (mut sum, mut least, mut most) = (0.0, f32::MAX, f32::MIN);
        for corner in 0..8usize {
            let mut at = first;
            let mut weight = 1.0;
            for a in 0..3 {
                if corner >> a & 1 == 0 {
                    weight *= 1.0 - t[a];
                } else {
                    // on the last face the neighbour beyond has no weight
                    at += if t[a] > 0.0 { steps[a] } else { 0 };
                    weight *= t[a];
                }
            }
            let value = f32::from(self.values[at]);
            least = least.min(value);
            most = most.max(value);
            sum += weight * value;
        }
        (least > self.far || most < -self.far).then(|| quantise(sum * UNIT_MM))
    }
}

impl SdfGrid {
    /// Samples a mesh at `spacing_mm` (default [`SPACING_MM`]), coarser where that would be more than
    /// [`MAX_NODES`].
    pub fn new(
        mesh: &Mesh,
        spacing_mm: Option<f32>,
        layers: &Layers<'_>,
    ) -> Result<Self, MeshError> {
        let [lo, hi] = mesh.corners();
        let mut grid = Self {
            origin: lo - Vec3::splat(MARGIN_MM),
            spacing_mm: spacing_mm.unwrap_or(SPACING_MM).clamp(0.02, 2.0),
            dims: [0; 3],
            values: Vec::new(),
            error_mm: 0.0,
            surface_rms_mm: 0.0,
            bounds: ToolBox {
                lo: lo.as_dvec3(),
                hi: hi.as_dvec3(),
            },
            last: Vec3::ZERO,
            per_mm: 0.0,
            patches: Patches::default(),
        };
        let extent = hi - lo + Vec3::splat(2.0 * MARGIN_MM);
        loop {
            let cells = (extent / grid.spacing_mm).ceil().to_array();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most 205.5 mm in steps of at least 0.02 mm"
            )]
            let cells = cells.map(|n| n as usize);
            grid.dims = cells.map(|n| n.next_multiple_of(STRIDE) + 1);
            if grid.dims.iter().product::<usize>() <= MAX_NODES {
                break;
            }
            grid.spacing_mm *= 1.05;
        }
        grid.last = Vec3::from_array(grid.dims.map(|n| (n - 1) as f32));
        grid.per_mm = 1.0 / grid.spacing_mm;
        let [nx, ny, nz] = grid.dims.map(|n| (n - 1) / STRIDE + 1);
        let coarse = layers(nz, &|k| {
            grid.sample(mesh, [nx, ny], STRIDE, (k, &|_, _| None))
        });
        let coarse = Coarse {
            values: coarse.concat(),
            row: nx,
            layer: nx * ny,
            // the nearest node of the coarse grid is at most half a diagonal away
            far: (BAND_MM + 0.8661 * STRIDE as f32 * grid.spacing_mm) / UNIT_MM,
        };
        let [nx, ny, nz] = grid.dims;
        grid.values = layers(nz, &|k| {
            grid.sample(mesh, [nx, ny], 1, (k, &|i, j| coarse.far_value([i, j, k])))
        })
        .concat();
        if !grid.values.iter().any(|v| *v < 0) {
            return Err(MeshError::Thin(grid.spacing_mm));
        }
        grid.finish(mesh, layers);
        Ok(grid)
    }

    /// Closes holes, and finds what is known only when all values are there.
    fn finish(&mut self, mesh: &Mesh, layers: &Layers<'_>) {
        let lids = if mesh.is_closed() {
            Bvh::default()
        } else {
            self.lids(mesh)
        };
        if !lids.triangles().is_empty() {
            self.values = layers(self.dims[2], &|k| self.with_lids(&lids, k)).concat();
        }
        self.check(mesh, &lids);
        self.patches = Patches::new(self);
    }

    /// Place of a node, mm.
    pub fn node(&self, [i, j, k]: [usize; 3]) -> Vec3 {
        self.origin + Vec3::new(i as f32, j as f32, k as f32) * self.spacing_mm
    }

    /// Value of a node, mm.
    pub(crate) fn node_mm(&self, node: [usize; 3]) -> f32 {
        f32::from(self.values[self.index(node)]) * UNIT_MM
    }

    /// The smooth piece about a point (tool frame, mm) that holds as far as `radius` mm around it, and
    /// the point from its middle; within [`super::patches::TOLERANCE_MM`] of the grid's values.
    pub(crate) fn patch(&self, p: Vec3, radius: f32) -> Option<(&Patch, Vec3)> {
        self.patches.about(p, radius)
    }

    /// The value that carving gives a point `p` (mm) of a box about the point `middle`, of which no
    /// point is farther from it than `radius`.
    pub fn carved(&self, (middle, radius): (Vec3, f32), offset: Vec3, p: Vec3) -> f32 {
        match self.patch(middle, radius) {
            Some((patch, from)) => patch.at(from + offset),
            None => self.signed_distance(p),
        }
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    /// Signed distance at `p`, mm: trilinear on the grid; beyond it a lower bound, from the nearest
    /// point of the grid's box (the way to the box and the way from there to the tool are at least at
    /// right angles). A NaN gives a NaN or the value of a corner.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "in a loop over the voxels of a line")]
    pub fn signed_distance(&self, p: Vec3) -> f32 {
        let q = (p - self.origin) * self.per_mm;
        let inside = q.cmpge(Vec3::ZERO) & q.cmple(self.last);
        if inside.all() {
            self.trilinear(q)
        } else {
            self.outside(q)
        }
    }

    #[cold]
    fn outside(&self, q: Vec3) -> f32 {
        let inside = q.clamp(Vec3::ZERO, self.last);
        let value = self.trilinear(inside).max(0.0);
        let beyond = (q - inside).length() * self.spacing_mm;
        (value * value + beyond * beyond).sqrt()
    }

    // at grid coordinates inside the grid
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "in a loop over the voxels of a line")]
    fn trilinear(&self, q: Vec3) -> f32 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "inside the grid, of fewer than 2^25 nodes along an edge; a NaN becomes 0"
        )]
        let at = |a: usize| (q[a] as i32 as usize).min(self.dims[a] - 2);
        let cell = [at(0), at(1), at(2)];
        let t = q - Vec3::new(cell[0] as f32, cell[1] as f32, cell[2] as f32);
        let (row, layer) = (self.dims[0], self.dims[0] * self.dims[1]);
        let first = cell[2] * layer + cell[1] * row + cell[0];
        let along = |n: usize| {
            let pair = &self.values[n..n + 2];
            let (a, b) = (f32::from(pair[0]), f32::from(pair[1]));
            a + (b - a) * t.x
        };
        let face = |n: usize| {
            let (a, b) = (along(n), along(n + row));
            a + (b - a) * t.y
        };
        let (a, b) = (face(first), face(first + layer));
        (a + (b - a) * t.z) * UNIT_MM
    }

    /// One layer of every `stride`-th node; `known` gives the value of a node that need not be looked
    /// for. Where two neighbours' distances together exceed the way between them no triangle parts
    /// them, so in a closed mesh both lie on the same side.
    fn sample(
        &self,
        mesh: &Mesh,
        [nx, ny]: [usize; 2],
        stride: usize,
        (k, known): (usize, &dyn Fn(usize, usize) -> Option<i16>),
    ) -> Vec<i16> {
        let mut layer = Vec::with_capacity(nx * ny);
        let h = self.spacing_mm * stride as f32 * 1.001;
        let mut hint = 0;
        // of the first node in the row before
        let mut below: Option<(f32, bool)> = None;
        for j in 0..ny {
            let mut before = below;
            for i in 0..nx {
                if let Some(value) = known(i, j) {
                    layer.push(value);
                    before = Some((BAND_MM, value < 0));
                    below = if i == 0 { before } else { below };
                    continue;
                }
                let p = self.node([i * stride, j * stride, k * stride]);
                let (distance, near) = mesh.distance(p, hint);
                hint = near;
                let inside = match before {
                    Some((d, inside)) if mesh.is_closed() && d + distance > h => inside,
                    _ => mesh.winding(p) > 0.5,
                };
                before = Some((distance, inside));
                below = if i == 0 { before } else { below };
                layer.push(quantise(if inside { -distance } else { distance }));
            }
        }
        layer
    }

    /// Where the winding number passes ½ between two nodes that no triangle parts: points of the
    /// surfaces that close the holes.
    fn lids(&self, mesh: &Mesh) -> Bvh {
        let (nx, ny) = (self.dims[0], self.dims[1]);
        let strides = [1, nx, nx * ny];
        let h = self.spacing_mm / UNIT_MM;
        let mut points: Vec<Triangle> = Vec::new();
        for n in 0..self.values.len() {
            let node = [n % nx, n / nx % ny, n / (nx * ny)];
            for axis in (0..3).filter(|&a| node[a] + 1 < self.dims[a]) {
                let pair = [n, n + strides[axis]].map(|m| f32::from(self.values[m]));
                let parted = (pair[0] < 0.0) != (pair[1] < 0.0);
                if !parted || pair[0].abs() + pair[1].abs() <= 1.01 * h + 2.0 {
                    continue;
                }
                let mut next = node;
                next[axis] += 1;
                let (a, b) = (self.node(node), self.node(next));
                let w = [a, b].map(|p| mesh.winding(p));
                let share = ((0.5 - w[0]) / (w[1] - w[0])).clamp(0.0, 1.0);
                points.push([a + (b - a) * share; 3]);
            }
        }
        Bvh::new(&points)
    }

    fn with_lids(&self, lids: &Bvh, k: usize) -> Vec<i16> {
        let (nx, ny) = (self.dims[0], self.dims[1]);
        let first = self.index([0, 0, k]);
        (0..nx * ny)
            .map(|n| {
                let value = self.values[first + n];
                let d = f32::from(value) * UNIT_MM;
                let p = self.node([n % nx, n / nx, k]);
                let nearest = lids.nearest(p, d.abs());
                quantise(nearest.copysign(d))
            })
            .collect()
    }

    /// Compares the grid with the mesh at points on the surface and up to [`CHECK_MM`] beside it.
    fn check(&mut self, mesh: &Mesh, lids: &Bvh) {
        let (mut worst, mut squares) = (0.0f32, 0.0f64);
        let points = mesh.spread(CHECKS);
        let mut hint = 0;
        for (n, (p, normal)) in points.iter().enumerate() {
            let on_surface = f64::from(self.signed_distance(*p));
            squares += on_surface * on_surface;
            let aside = CHECK_MM * ((n % 41) as f32 / 20.0 - 1.0);
            let q = *p + *normal * aside;
            let (distance, near) = mesh.distance(q, hint);
            hint = near;
            let distance = lids.nearest(q, distance);
            let truth = if mesh.winding(q) > 0.5 {
                -distance
            } else {
                distance
            };
            worst = worst.max((self.signed_distance(q) - truth).abs());
        }
        self.error_mm = worst;
        #[expect(clippy::cast_possible_truncation, reason = "a distance in mm")]
        let rms = (squares / points.len().max(1) as f64).sqrt() as f32;
        self.surface_rms_mm = rms;
    }

    /// Bound on how far a value lies from the distance that it samples, mm, nearer to the surface than
    /// [`BAND_MM`], where it is a mean over one cell ([`Self::slack_mm`] holds farther away too).
    pub fn near_slack_mm(&self) -> f32 {
        0.8661 * self.spacing_mm + UNIT_MM
    }

    /// Bound on how far a value lies from the distance that it samples, mm, however far from the
    /// surface: a mean over the corners of a cell, of a field that changes by at most 1 mm per mm.
    /// Culling takes it off.
    pub fn slack_mm(&self) -> f32 {
        // √3/2 of a cell's edge: the root mean square way from its centre to its corners; far from
        // the surface a value is a mean of means
        0.8661 * self.spacing_mm * (1 + STRIDE) as f32 + UNIT_MM
    }

    /// Largest radius about the axis at height `z`, mm; 0 where there is none.
    pub fn radius_at(&self, z: f32) -> f32 {
        let mut widest = 0.0f32;
        for j in 0..self.dims[1] {
            for i in 0..self.dims[0] {
                let p = self.node([i, j, 0]).with_z(z);
                let d = self.signed_distance(p);
                if d < 0.0 {
                    // a disc of that radius lies inside as well
                    widest = widest.max(p.truncate().length() - d);
                }
            }
        }
        widest
    }

    /// Volume of the solid, mm³: each node stands for a cube of the spacing, cut by a plane across
    /// it at the node's distance.
    pub fn volume_mm3(&self) -> f64 {
        let h = self.spacing_mm;
        let cell = f64::from(h) * f64::from(h) * f64::from(h);
        let units: f64 = self
            .values
            .iter()
            .map(|v| f64::from((0.5 - f32::from(*v) * UNIT_MM / h).clamp(0.0, 1.0)))
            .sum();
        units * cell
    }
}

fn quantise(d: f32) -> i16 {
    let units = (d / UNIT_MM).clamp(-32767.0, 32767.0);
    // never a zero with the wrong side
    let rounded = if units < 0.0 {
        units.round().min(-1.0)
    } else {
        units.round()
    };
    #[expect(clippy::cast_possible_truncation, reason = "within the range")]
    let value = rounded as i16;
    value
}
