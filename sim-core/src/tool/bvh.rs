//! A tree of boxes over triangles: distance to the nearest one, and the generalised winding number.
//!
//! Winding number: A. Jacobson, L. Kavan, O. Sorkine-Hornung, "Robust inside-outside segmentation
//! using generalized winding numbers", ACM Trans. Graph. 32(4), 2013: the sum of the triangles' solid
//! angles over 4π, 1 inside and 0 outside of a closed mesh and smooth where it is open. Far clusters
//! count as one dipole each (the first order of G. Barill, N. Dickson, R. Schmidt, D. Levin,
//! A. Jacobson, "Fast winding numbers for soups and clouds", ACM Trans. Graph. 37(4), 2018).

use core::f64::consts::TAU;
use glam::{DVec3, Vec3};

/// Corners of a triangle, mm, counter-clockwise seen from outside.
pub type Triangle = [Vec3; 3];

/// Most triangles of a leaf.
const LEAF: usize = 4;

#[derive(Debug, Clone, PartialEq)]
struct Node {
    lo: Vec3,
    hi: Vec3,
    /// Area-weighted centre, and a radius about it that holds all triangles, mm.
    centre: Vec3,
    radius: f32,
    /// Sum of the area vectors, mm².
    dipole: Vec3,
    /// Unit normal of a slab about the centre that holds all triangles, and half its thickness, mm:
    /// for a small piece of a smooth surface much thinner than the box.
    normal: Vec3,
    depth: f32,
    /// A leaf's first triangle, or a branch's right child (the left one follows it in the list).
    at: u32,
    /// A leaf's number of triangles; 0 for a branch.
    count: u32,
}

/// The tree. Empty where there is no triangle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

/// Area vector of a triangle (along its normal, as long as its area), mm².
pub fn area_vector(t: &Triangle) -> DVec3 {
    let [a, b, c] = t.map(Vec3::as_dvec3);
    0.5 * (b - a).cross(c - a)
}

impl Bvh {
    /// Builds the tree; the order of `triangles` and the numbers in them decide it alone. At most
    /// 2³¹ triangles.
    pub fn new(triangles: &[Triangle]) -> Self {
        let mut items: Vec<(Vec3, u32)> = triangles
            .iter()
            .zip(0u32..)
            .map(|(t, n)| ((t[0] + t[1] + t[2]) / 3.0, n))
            .collect();
        let mut tree = Self {
            nodes: Vec::with_capacity(triangles.len()),
            triangles: Vec::with_capacity(triangles.len()),
        };
        if !items.is_empty() {
            tree.grow(&mut items, triangles);
        }
        tree
    }

    /// The triangles, neighbours near each other.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    // halves by count along the longest axis of the centres, so that equal triangles split as well
    // and the depth is at most the logarithm of their number
    fn grow(&mut self, items: &mut [(Vec3, u32)], all: &[Triangle]) {
        let own = self.nodes.len();
        self.nodes.push(summary(items, all));
        if items.len() <= LEAF {
            self.nodes[own].at = index(self.triangles.len());
            self.nodes[own].count = index(items.len());
            self.triangles
                .extend(items.iter().map(|(_, n)| all[*n as usize]));
            return;
        }
        let (lo, hi) = items
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), (c, _)| {
                (lo.min(*c), hi.max(*c))
            });
        let extent = hi - lo;
        let axis = if extent.x >= extent.y.max(extent.z) {
            0
        } else if extent.y >= extent.z {
            1
        } else {
            2
        };
        let middle = items.len() / 2;
        items.select_nth_unstable_by(middle, |a, b| {
            a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1))
        });
        let (left, right) = items.split_at_mut(middle);
        self.grow(left, all);
        self.nodes[own].at = index(self.nodes.len());
        self.grow(right, all);
    }

    /// Distance from `p` to the nearest triangle that is nearer than `bound`, mm; `bound` where none
    /// is.
    pub fn nearest(&self, p: Vec3, bound: f32) -> f32 {
        let bound2 = f64::from(bound) * f64::from(bound);
        millimetres(self.search(p, (bound2, 0)).0)
    }

    /// Distance from `p` to the nearest triangle, mm, and its number in [`Self::triangles`]; `hint`
    /// is the number of one that is near. Infinity where there is no triangle.
    pub fn nearest_from(&self, p: Vec3, hint: usize) -> (f32, usize) {
        let known = self
            .triangles
            .get(hint)
            .map_or(f64::INFINITY, |t| triangle_distance2(t, p.as_dvec3()));
        let (distance2, found) = self.search(p, (known, hint));
        (millimetres(distance2), found)
    }

    /// The nearest triangle's squared distance and number, where it is nearer than the one given.
    fn search(&self, p: Vec3, mut best: (f64, usize)) -> (f64, usize) {
        let mut stack = [(0u32, 0f32); 64];
        let mut height = usize::from(!self.nodes.is_empty());
        let q = p.as_dvec3();
        while height > 0 {
            height -= 1;
            let (own, away2) = stack[height];
            if f64::from(away2) > best.0 {
                continue;
            }
            let node = &self.nodes[own as usize];
            if node.count > 0 {
                for (t, n) in self.leaf(node).iter().zip(node.at as usize..) {
                    let distance2 = triangle_distance2(t, q);
                    if distance2 < best.0 {
                        best = (distance2, n);
                    }
                }
                continue;
            }
            // the nearer child on top
            let [left, right] =
                [own + 1, node.at].map(|n| (n, least_distance2(&self.nodes[n as usize], p)));
            let pair = if left.1 <= right.1 {
                [right, left]
            } else {
                [left, right]
            };
            stack[height..height + 2].copy_from_slice(&pair);
            height += 2;
        }
        best
    }

    /// Generalised winding number at `p`; clusters farther than `far` times their radius count as
    /// dipoles (2 for a sign, more for a measurement).
    pub fn winding(&self, p: Vec3, far: f32) -> f32 {
        let q = p.as_dvec3();
        let mut sum = 0.0f64;
        let mut stack = [0u32; 64];
        let mut height = usize::from(!self.nodes.is_empty());
        while height > 0 {
            height -= 1;
            let own = stack[height];
            let node = &self.nodes[own as usize];
            let away = node.centre.as_dvec3() - q;
            let distance2 = away.length_squared();
            let limit = f64::from(far * node.radius);
            if distance2 > limit * limit {
                sum += node.dipole.as_dvec3().dot(away) / (distance2 * distance2.sqrt());
            } else if node.count > 0 {
                sum += self
                    .leaf(node)
                    .iter()
                    .map(|t| solid_angle(t, q))
                    .sum::<f64>();
            } else {
                stack[height] = own + 1;
                stack[height + 1] = node.at;
                height += 2;
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "a small number of turns")]
        let turns = (sum / (2.0 * TAU)) as f32;
        turns
    }

    fn leaf(&self, node: &Node) -> &[Triangle] {
        &self.triangles[node.at as usize..(node.at + node.count) as usize]
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a distance in mm")]
fn millimetres(distance2: f64) -> f32 {
    distance2.sqrt() as f32
}

fn index(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

fn summary(items: &[(Vec3, u32)], all: &[Triangle]) -> Node {
    let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (mut dipole, mut weighted, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (centre, n) in items {
        let t = &all[*n as usize];
        for v in t {
            lo = lo.min(*v);
            hi = hi.max(*v);
        }
        let vector = area_vector(t);
        dipole += vector;
        weighted += centre.as_dvec3() * vector.length();
        area += vector.length();
    }
    let centre = if area > 0.0 {
        (weighted / area).as_vec3()
    } else {
        0.5 * (lo + hi)
    };
    let normal = dipole.normalize_or_zero().as_vec3();
    let off = |v: &Vec3| (*v - centre).dot(normal).abs();
    let corners = items.iter().flat_map(|(_, n)| &all[*n as usize]);
    let depth = corners.map(off).fold(0.0, f32::max);
    Node {
        lo,
        hi,
        centre,
        normal,
        depth,
        // the farthest corner of the box holds for every triangle in it
        radius: (centre - lo).max(hi - centre).length(),
        dipole: dipole.as_vec3(),
        at: 0,
        count: 0,
    }
}

/// Lower bound of the squared distance to a node's triangles: to its box and to its slab, less
/// rounding errors, so that neither hides a triangle that touches its side.
fn least_distance2(node: &Node, p: Vec3) -> f32 {
    let beyond = (node.lo - p).max(p - node.hi).max(Vec3::ZERO);
    let way = p - node.centre;
    let slab = way.dot(node.normal).abs() - node.depth - 2e-6 * (way.length() + node.radius);
    let slab = slab.max(0.0);
    beyond.length_squared().max(slab * slab) * (1.0 - 1e-6)
}

/// Squared distance to a triangle: to its plane where the foot lies inside, else to an edge. A point
/// or a line has edges only.
fn triangle_distance2(t: &Triangle, p: DVec3) -> f64 {
    let [a, b, c] = t.map(|v| v.as_dvec3() - p);
    let (ab, bc, ca) = (b - a, c - b, a - c);
    let normal = ab.cross(bc);
    // across each edge, in the plane, outwards where negative
    let across = [
        ab.cross(normal).dot(a),
        bc.cross(normal).dot(b),
        ca.cross(normal).dot(c),
    ];
    if across.iter().all(|s| *s >= 0.0) {
        let length2 = normal.length_squared();
        if length2 > 0.0 {
            let height = normal.dot(a);
            return height * height / length2;
        }
    }
    // the foot lies beyond one edge, or two at a corner: the others are farther
    let mut best = f64::INFINITY;
    for (beyond, from, along) in [(across[0], a, ab), (across[1], b, bc), (across[2], c, ca)] {
        if beyond <= 0.0 {
            best = best.min(edge_distance2(from, along));
        }
    }
    best
}

/// Squared distance from the origin to an edge.
fn edge_distance2(from: DVec3, along: DVec3) -> f64 {
    let length2 = along.length_squared();
    let share = if length2 > 0.0 {
        (-from.dot(along) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (from + along * share).length_squared()
}

/// Solid angle of a triangle seen from `p`, sr, positive from inside: A. van Oosterom, J. Strackee,
/// "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30(2), 1983, equation 8.
fn solid_angle(t: &Triangle, p: DVec3) -> f64 {
    let [a, b, c] = t.map(|v| v.as_dvec3() - p);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let volume = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * libm::atan2(volume, denominator)
}
