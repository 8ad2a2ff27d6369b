//! The piece of surface that an element stands for: how it bends and how far it reaches. Where bone is
//! sharp, what touches is not the element's own point but the deepest one of its facet
//! (`contact/deepest.rs`).

use super::{Element, Shape};
use glam::{DVec2, Vec3};

/// How far a facet reaches beyond the disc of its area's size, so that neighbours meet.
const OVERLAP: f32 = 1.3;
/// A facet ends where it lies this far off the tool's surface, mm, and more by [`SLACK`] of the way.
const OFF_MM: f32 = 3e-3;
const SLACK: f32 = 3e-3;
/// Steps of the search for a facet's end.
const STEPS: u16 = 16;
/// A smooth face's facets keep this far from its edges, mm, as its elements do.
const EDGE_MM: f32 = 0.5;

/// A facet, in the frame of its element: two directions along the surface and the normal. Its points are
/// `position + u·along + v·across − ½(κᵤu² + κᵥv²)·normal`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Along the surface, away from the tip where the tool is round; unit length, tool frame.
    pub along: Vec3,
    /// Curvatures in both directions, 1/mm; positive where the tool is convex.
    pub curvature: [f32; 2],
    /// How far it reaches: against and along the first direction, against and along the second, mm.
    pub room_mm: [[f32; 2]; 2],
    /// Which of these ends are edges of the tool; at the others a neighbour goes on.
    pub edge: [[bool; 2]; 2],
}

impl Facet {
    /// A point alone.
    pub const POINT: Self = Self {
        along: Vec3::X,
        curvature: [0.0; 2],
        room_mm: [[0.0; 2]; 2],
        edge: [[true; 2]; 2],
    };

    /// The facet of an element of a shape.
    pub fn of(element: &Element, shape: &Shape) -> Self {
        let (p, n) = (element.position, element.normal);
        let radial = Vec3::new(p.x, p.y, 0.0);
        let around = Vec3::Z.cross(radial).try_normalize();
        let along = around
            .map(|a| a.cross(n))
            .and_then(Vec3::try_normalize)
            .unwrap_or_else(|| n.any_orthonormal_vector());
        let reach = OVERLAP * (element.area_mm2 / core::f32::consts::PI).sqrt();
        let own = shape.signed_distance(p);
        let mut facet = Self {
            along,
            ..Self::POINT
        };
        for (axis, way) in [along, n.cross(along)].into_iter().enumerate() {
            let probe = 0.5 * reach;
            let bend = [-1.0, 1.0].map(|side| {
                let off = shape.signed_distance(p + way * (side * probe)) - own;
                2.0 * off / (probe * probe)
            });
            // beside an edge one side says more than how the face bends
            let bend = if bend[0].abs() < bend[1].abs() {
                bend[0]
            } else {
                bend[1]
            };
            facet.curvature[axis] = bend;
            for (end, side) in [-1.0, 1.0].into_iter().enumerate() {
                let at = |s: f32| p + way * (side * s) - n * (0.5 * bend * s * s);
                let on = |s: f32| (shape.signed_distance(at(s)) - own).abs() <= OFF_MM + SLACK * s;
                let beyond = if element.cutting { 0.0 } else { EDGE_MM };
                let step = |n: u16| reach * f32::from(n) / f32::from(STEPS);
                let last = (1..=STEPS).take_while(|&n| on(step(n)) && on(step(n) + beyond));
                let last = last.last().unwrap_or(0);
                facet.room_mm[axis][end] = step(last);
                facet.edge[axis][end] = last < STEPS;
            }
        }
        facet.draw_in(element, shape, own);
        facet
    }

    /// Smaller until its corners lie on the surface, too.
    fn draw_in(&mut self, element: &Element, shape: &Shape, own: f32) {
        let across = element.normal.cross(self.along);
        let [ku, kv] = self.curvature;
        for _ in 0..STEPS {
            let mut off = false;
            for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let side = |end: usize| if end == 0 { -1.0 } else { 1.0 };
                let (u, v) = (side(a) * self.room_mm[0][a], side(b) * self.room_mm[1][b]);
                let sag = 0.5 * (ku * u * u + kv * v * v);
                let at = element.position + self.along * u + across * v - element.normal * sag;
                let slack = OFF_MM + SLACK * (u.abs() + v.abs());
                if (shape.signed_distance(at) - own).abs() > slack {
                    self.room_mm[0][a] *= 0.85;
                    self.room_mm[1][b] *= 0.85;
                    off = true;
                }
            }
            if !off {
                break;
            }
        }
    }

    /// How far its farthest point may be from its middle, mm.
    pub fn reach_mm(&self) -> f32 {
        let [u, v] = self.room_mm.map(|[a, b]| a.max(b));
        (u * u + v * v).sqrt()
    }

    /// How far it goes on from a place in a direction of unit length, mm.
    pub(crate) fn room(&self, at: DVec2, way: DVec2) -> f64 {
        let axis = |at: f64, way: f64, [back, ahead]: [f32; 2]| {
            if way > 1e-9 {
                (f64::from(ahead) - at) / way
            } else if way < -1e-9 {
                (-f64::from(back) - at) / way
            } else {
                f64::INFINITY
            }
        };
        let [u, v] = self.room_mm;
        axis(at.x, way.x, u).min(axis(at.y, way.y, v)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Tool;
    use super::super::revolved::Revolved;
    use super::*;

    /// A point of a facet, tool frame.
    fn point(e: &Element, f: &Facet, u: f32, v: f32) -> Vec3 {
        let [ku, kv] = f.curvature;
        let across = e.normal.cross(f.along);
        e.position + f.along * u + across * v - e.normal * (0.5 * (ku * u * u + kv * v * v))
    }

    #[test]
    fn facets_of_a_ball_cover_it() {
        let shape = Shape::Revolved(Revolved::ball(3.0));
        let tool = Tool {
            shape: shape.clone(),
            ..Tool::revolved(["", ""], Revolved::ball(3.0), (1.0, 1), [0; 3])
        };
        let facets: Vec<Facet> = tool.elements.iter().map(|e| Facet::of(e, &shape)).collect();
        for i in 0..2000u16 {
            let z = (2.0 * f32::from(i) + 1.0) / 2000.0 - 1.0;
            let (s, c) = libm::sincosf(1.7 * f32::from(i));
            let r = (1.0 - z * z).sqrt();
            let p = Vec3::new(r * c, r * s, z) * 3.0;
            let mut nearest = f32::MAX;
            for (e, f) in tool.elements.iter().zip(&facets) {
                let d = p - e.position;
                let u = d.dot(f.along).clamp(-f.room_mm[0][0], f.room_mm[0][1]);
                let across = e.normal.cross(f.along);
                let v = d.dot(across).clamp(-f.room_mm[1][0], f.room_mm[1][1]);
                nearest = nearest.min((point(e, f, u, v) - p).length());
            }
            assert!(nearest < 0.06, "{p} is {nearest} mm off");
        }
    }

    #[test]
    fn no_facet_leaves_its_tool() {
        for tool in Tool::standard_set() {
            for e in &tool.elements {
                let f = Facet::of(e, &tool.shape);
                let own = tool.shape.signed_distance(e.position);
                for u in [-f.room_mm[0][0], 0.0, f.room_mm[0][1]] {
                    for v in [-f.room_mm[1][0], 0.0, f.room_mm[1][1]] {
                        let off = tool.shape.signed_distance(point(e, &f, u, v)) - own;
                        assert!(off.abs() < 0.012, "{}: {e:?} {f:?}: {off}", tool.id);
                    }
                }
            }
        }
    }
}
