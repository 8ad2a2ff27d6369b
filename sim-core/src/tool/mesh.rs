//! Triangle meshes of any quality: what is wrong with them is found, mended where that is certain
//! and refused where it is not; inside is where the generalised winding number says so.

use super::Element;
use super::bvh::{Bvh, Triangle, area_vector};
use super::elements::RELIEF_MM;
use glam::Vec3;

/// Most triangles of a tool.
pub const MAX_TRIANGLES: usize = 2_000_000;
/// Largest extent of a tool, mm.
pub const MAX_EXTENT_MM: f32 = 200.0;
/// Smallest extent of a tool, mm.
pub const MIN_EXTENT_MM: f32 = 0.5;
/// Farthest that a tool reaches from its origin, mm.
pub const MAX_REACH_MM: f32 = 500.0;
/// A triangle below this area is a line or a point, mm².
const ZERO_MM2: f64 = 1e-10;
/// Clusters farther than so many radii are dipoles: for a sign, and for a measurement.
const FAR: f32 = 2.0;
const FAR_EXACT: f32 = 8.0;
/// Probes of the orientation, and their distance from the surface, mm.
const PROBES: u16 = 256;
const PROBE_MM: f32 = 0.01;
/// A face with solid this far in front of it is buried in another body, mm.
const BURIED_MM: f32 = 0.25;
/// Elements of a tool made of triangles.
const ELEMENTS: u16 = 448;

/// Why a mesh is no tool; one line with the remedy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeshError {
    /// Fewer triangles (of any area) than a solid has; how many.
    TooFew(usize),
    /// More than [`MAX_TRIANGLES`]; how many.
    TooMany(usize),
    /// A corner that is not finite; the triangle's number, from 1.
    NotFinite(usize),
    /// Larger than [`MAX_EXTENT_MM`]; its extent, mm.
    TooLarge(f32),
    /// Smaller than [`MIN_EXTENT_MM`]; its extent, mm.
    TooSmall(f32),
    /// Farther from the origin than [`MAX_REACH_MM`]; how far, mm.
    TooFar(f32),
    /// Normals that point both ways, or a mesh so open that it encloses nothing.
    Torn,
    /// No node of the grid lies inside; the grid's spacing, mm.
    Thin(f32),
}

impl core::fmt::Display for MeshError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::TooFew(n) => write!(
                f,
                "{n} triangles with an area enclose nothing (at least 4 do); export the whole solid"
            ),
            Self::TooMany(n) => write!(
                f,
                "{n} triangles (at most {MAX_TRIANGLES}); decimate it, 100000 are plenty for a tool"
            ),
            Self::NotFinite(n) => write!(
                f,
                "triangle {n} has a corner that is no finite number; repair or export it again"
            ),
            Self::TooLarge(mm) => write!(
                f,
                "{mm:.4} mm large (at most {MAX_EXTENT_MM}); set scale (25.4 for inches, 1000 for metres, 0.001 for micrometres) or crop it to the head"
            ),
            Self::TooSmall(mm) => write!(
                f,
                "{mm:.4} mm small (at least {MIN_EXTENT_MM}); set scale (25.4 for inches, 1000 for metres)"
            ),
            Self::TooFar(mm) => write!(
                f,
                "it reaches {mm:.4} mm from the tool's origin (at most {MAX_REACH_MM}); set apex_mm to the tip's place in the mesh"
            ),
            Self::Torn => write!(
                f,
                "its normals point both ways or it encloses nothing; unify the normals and close it"
            ),
            Self::Thin(h) => write!(
                f,
                "it has no inside on a grid of {h:.3} mm; give it thickness, or a smaller spacing_mm"
            ),
        }
    }
}

impl core::error::Error for MeshError {}

/// What was found in a mesh and mended.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Findings {
    /// Triangles kept.
    pub triangles: usize,
    /// Triangles without area, left out.
    pub zero_area: usize,
    /// Triangles that were there twice, left out.
    pub duplicates: usize,
    /// All normals pointed inwards and were turned.
    pub turned: bool,
    /// Edges whose triangles do not match up, as in holes, cracks and flipped faces; 0: closed.
    pub open_edges: usize,
    /// Largest distance of the winding number from a whole number beside the surface; 0: closed.
    pub winding_gap: f32,
}

/// A checked mesh, its normals outwards.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    tree: Bvh,
    findings: Findings,
    lo: Vec3,
    hi: Vec3,
}

impl Mesh {
    /// Checks triangles in the tool frame (mm) and mends what can be mended.
    pub fn new(mut triangles: Vec<Triangle>) -> Result<Self, MeshError> {
        if triangles.len() > MAX_TRIANGLES {
            return Err(MeshError::TooMany(triangles.len()));
        }
        if triangles.len() < 4 {
            return Err(MeshError::TooFew(triangles.len()));
        }
        let [lo, hi] = checked_box(&triangles)?;
        let given = triangles.len();
        let names = weld(&triangles);
        let duplicates = leave_out_duplicates(&mut triangles, names);
        let open_edges = open_edges(&weld(&triangles));
        triangles.retain(|t| area_vector(t).length() > ZERO_MM2);
        if triangles.len() < 4 {
            return Err(MeshError::TooFew(triangles.len()));
        }
        let findings = Findings {
            triangles: triangles.len(),
            zero_area: given - duplicates - triangles.len(),
            duplicates,
            open_edges,
            ..Findings::default()
        };
        let tree = Bvh::new(&triangles);
        let mut mesh = Self {
            tree,
            findings,
            lo,
            hi,
        };
        mesh.orient()?;
        Ok(mesh)
    }

    /// What was found.
    pub fn findings(&self) -> Findings {
        self.findings
    }

    /// Lowest and highest corner, mm.
    pub fn corners(&self) -> [Vec3; 2] {
        [self.lo, self.hi]
    }

    /// Whether every edge has its counterpart: then the winding number is whole everywhere.
    pub fn is_closed(&self) -> bool {
        self.findings.open_edges == 0
    }

    /// Distance from `p` to the nearest triangle, mm, and that triangle's number; `hint` is the number
    /// of one that is near, any number will do.
    pub fn distance(&self, p: Vec3, hint: usize) -> (f32, usize) {
        self.tree.nearest_from(p, hint)
    }

    /// Generalised winding number at `p`; see [`super::bvh`].
    pub fn winding(&self, p: Vec3) -> f32 {
        self.tree.winding(p, FAR)
    }

    /// `count` points of equal area shares: position and outward unit normal, in the tree's order, so
    /// that neighbours come after each other.
    pub fn spread(&self, count: u16) -> Vec<(Vec3, Vec3)> {
        let areas: Vec<f64> = self
            .tree
            .triangles()
            .iter()
            .map(|t| area_vector(t).length())
            .collect();
        let share = areas.iter().sum::<f64>() / f64::from(count);
        let mut points = Vec::with_capacity(usize::from(count));
        let mut passed = 0.0;
        for (t, area) in self.tree.triangles().iter().zip(areas) {
            passed += area;
            while points.len() < usize::from(count) && (points.len() as f64 + 0.5) * share <= passed
            {
                points.push((spot(t, points.len()), unit_normal(t)));
            }
        }
        points
    }

    /// Area of all triangles, mm².
    pub fn area_mm2(&self) -> f64 {
        let areas = self.tree.triangles().iter().map(area_vector);
        areas.map(glam::DVec3::length).sum()
    }

    /// Surface elements: those at or below `cutting_below_mm` (z) cut, those above are smooth and
    /// relieved. Faces buried in another body have none.
    #[expect(clippy::cast_possible_truncation, reason = "an area in mm²")]
    pub fn elements(&self, cutting_below_mm: f32) -> Vec<Element> {
        let area_mm2 = (self.area_mm2() / f64::from(ELEMENTS)) as f32;
        self.spread(ELEMENTS)
            .into_iter()
            .filter(|(p, n)| self.winding(*p + *n * BURIED_MM) < 0.5)
            .map(|(p, normal)| {
                let cutting = p.z <= cutting_below_mm;
                let relief = if cutting { 0.0 } else { RELIEF_MM };
                let position = p - normal * relief;
                Element {
                    position,
                    normal,
                    area_mm2,
                    radius_mm: position.truncate().length(),
                    cutting,
                }
            })
            .collect()
    }

    /// Turns a mesh whose normals point inwards: beside a triangle of a right one the mean of the
    /// winding numbers in front and behind is ½, of an inverted one −½.
    fn orient(&mut self) -> Result<(), MeshError> {
        let mut mean = 0.0;
        let mut gap = 0.0f32;
        let probes = self.spread(PROBES);
        for (p, n) in &probes {
            for side in [PROBE_MM, -PROBE_MM] {
                let w = self.tree.winding(*p + *n * side, FAR_EXACT);
                mean += 0.5 * w / f32::from(PROBES);
                gap = gap.max((w - w.round()).abs());
            }
        }
        // half of it: what a hemisphere without its disc still has
        if mean.abs() < 0.25 {
            return Err(MeshError::Torn);
        }
        self.findings.winding_gap = if self.is_closed() { 0.0 } else { gap };
        if mean < 0.0 {
            self.findings.turned = true;
            let mut turned = self.tree.triangles().to_vec();
            for t in &mut turned {
                t.swap(1, 2);
            }
            self.tree = Bvh::new(&turned);
        }
        Ok(())
    }
}

fn unit_normal(t: &Triangle) -> Vec3 {
    area_vector(t).normalize_or_zero().as_vec3()
}

/// A point of a triangle: the plane sequence of M. Roberts ("The unreasonable effectiveness of
/// quasirandom sequences", 2018), folded into the triangle.
fn spot([a, b, c]: &Triangle, n: usize) -> Vec3 {
    let n = n as f64 + 0.5;
    let part = |step: f64| {
        let v = n * step;
        #[expect(clippy::cast_possible_truncation, reason = "between 0 and 1")]
        let part = (v - v.floor()) as f32;
        part
    };
    let (mut u, mut v) = (part(0.754_877_666_246_693), part(0.569_840_290_998_053));
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    *a + (*b - *a) * u + (*c - *a) * v
}

fn checked_box(triangles: &[Triangle]) -> Result<[Vec3; 2], MeshError> {
    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for (n, t) in triangles.iter().enumerate() {
        if !t.iter().all(|v| v.is_finite()) {
            return Err(MeshError::NotFinite(n + 1));
        }
        for v in t {
            lo = lo.min(*v);
            hi = hi.max(*v);
        }
    }
    let extent = (hi.as_dvec3() - lo.as_dvec3()).max_element();
    #[expect(clippy::cast_possible_truncation, reason = "said to people")]
    let (extent, reach) = (extent as f32, hi.abs().max(lo.abs()).max_element());
    if extent > MAX_EXTENT_MM {
        return Err(MeshError::TooLarge(extent));
    }
    if reach > MAX_REACH_MM {
        return Err(MeshError::TooFar(reach));
    }
    if extent < MIN_EXTENT_MM {
        return Err(MeshError::TooSmall(extent));
    }
    Ok([lo, hi])
}

/// The same number for corners of the same place, three for each triangle.
fn weld(triangles: &[Triangle]) -> Vec<[u32; 3]> {
    // −0 and 0 are one place
    let key = |v: Vec3| v.to_array().map(|x| (x + 0.0).to_bits());
    let mut corners: Vec<([u32; 3], u32)> = triangles
        .iter()
        .flatten()
        .map(|v| key(*v))
        .zip(0u32..)
        .collect();
    corners.sort_unstable();
    let mut names = vec![[0; 3]; triangles.len()];
    let mut name = 0;
    let mut last = None;
    for (place, n) in corners {
        if last != Some(place) {
            name = n;
            last = Some(place);
        }
        names[n as usize / 3][n as usize % 3] = name;
    }
    names
}

/// Leaves out all but the first of equal triangles (the same corners in the same sense); how many
/// went.
fn leave_out_duplicates(triangles: &mut Vec<Triangle>, names: Vec<[u32; 3]>) -> usize {
    let mut sorted: Vec<([u32; 3], u32)> = names
        .into_iter()
        .map(|mut name| {
            let least = (0..3).min_by_key(|&i| name[i]).unwrap_or(0);
            name.rotate_left(least);
            name
        })
        .zip(0u32..)
        .collect();
    sorted.sort_unstable();
    let mut keep = vec![true; triangles.len()];
    for pair in sorted.windows(2) {
        if pair[0].0 == pair[1].0 {
            keep[pair[1].1 as usize] = false;
        }
    }
    let before = triangles.len();
    let mut kept = keep.iter();
    triangles.retain(|_| kept.next().copied().unwrap_or(true));
    before - triangles.len()
}

/// Number of edges that are not run through as often one way as the other: 0 means that the
/// triangles bound a region, whatever else is wrong with them.
fn open_edges(names: &[[u32; 3]]) -> usize {
    let mut edges: Vec<(u32, u32, i8)> = Vec::with_capacity(3 * names.len());
    for [a, b, c] in names {
        for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
            if from != to {
                let way = if from < to { 1 } else { -1 };
                edges.push((from.min(to), from.max(to), way));
            }
        }
    }
    edges.sort_unstable();
    edges
        .chunk_by(|x, y| (x.0, x.1) == (y.0, y.1))
        .filter(|same| same.iter().map(|e| i64::from(e.2)).sum::<i64>() != 0)
        .count()
}
