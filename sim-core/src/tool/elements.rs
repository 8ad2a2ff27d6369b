//! Surface elements of a solid of revolution: equal areas along each exposed piece of its outline,
//! turned by the golden angle from one to the next, so that neighbours never line up.

use super::revolved::{Face, Form, Revolved};
use super::{Element, MAX_ELEMENTS};
use core::f32::consts::{FRAC_PI_2, PI, TAU};
use glam::Vec3;

/// Clearance of a smooth flank behind its cutting edge, mm (drills and reamers are relieved so
/// that they do not rub).
pub const RELIEF_MM: f32 = 0.05;

/// The golden angle, rad.
const GOLDEN_ANGLE: f32 = 2.399_963_2;
/// Area per cutting element, mm², and fewest and most of them on a tool.
const CUTTING: (f32, u16, u16) = (3.5, 240, 320);
/// The same for smooth elements.
const SMOOTH: (f32, u16, u16) = (4.0, 96, 176);
/// Fewest elements of an exposed piece: a ring of three would leave a tool room to slip between.
const LEAST: u16 = 4;
/// Smooth elements keep this far from other faces, mm: beside its edge a relieved flank would rub.
const EDGE_MM: f32 = 0.5;
/// A smooth face that looks up along the axis more steeply than this is a tool's back: nothing
/// touches it.
const BACK: f32 = 0.9;
/// A tip's own element, mm²: small against any face, and the point that a standing drill rests on.
const TIP_MM2: f32 = 0.05;
/// Steps of the search for exposed pieces, along one curve.
const STEPS: u16 = 2000;
/// Distances of the tests for what lies on which side, mm.
const SIDE_MM: f32 = 1e-3;

/// A piece of an outline in the (r, z) half plane, mm, run through by a parameter that area grows
/// with.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Curve {
    /// Flat at a height, looking up or down; the parameter is r, mm.
    Flat { height: f32, up: bool },
    /// A line `normal · (r, z) = offset`; the parameter is the way along it, upwards, mm.
    Line { normal: [f32; 2], offset: f32 },
    /// An arc about (`disc`, `centre`); the parameter is its latitude, rad.
    Arc { disc: f32, centre: f32, radius: f32 },
}

/// A point of an outline and the normal there: r, z, normal r, normal z.
type Spot = [f32; 4];

impl Curve {
    fn at(self, u: f32) -> Spot {
        match self {
            Self::Flat { height, up } => [u, height, 0.0, if up { 1.0 } else { -1.0 }],
            Self::Line {
                normal: [nr, nz],
                offset,
            } => [offset * nr - u * nz, offset * nz + u * nr, nr, nz],
            Self::Arc {
                disc,
                centre,
                radius,
            } => {
                let (nr, nz) = (libm::cosf(u), libm::sinf(u));
                [disc + radius * nr, centre + radius * nz, nr, nz]
            }
        }
    }

    /// Area of the surface between the parameter's zero and `u`, mm², up to a constant.
    fn area(self, u: f32) -> f32 {
        match self {
            Self::Flat { .. } => PI * u * u,
            Self::Line {
                normal: [nr, nz],
                offset,
            } => TAU * (offset * nr * u - 0.5 * nz * u * u),
            // Pappus: the arc's length times the way of its centroid
            Self::Arc { disc, radius, .. } => TAU * radius * (disc * u + radius * libm::sinf(u)),
        }
    }

    /// The curves of a face, each with the range of its parameter inside a reach in mm.
    fn of(form: Form, reach: f32) -> Vec<(Self, [f32; 2])> {
        match form {
            Form::Plane { height_mm, up } => {
                let height = height_mm;
                vec![(Self::Flat { height, up }, [0.0, reach])]
            }
            Form::Cone {
                normal_r,
                normal_z,
                offset_mm,
            } => {
                let line = Self::Line {
                    normal: [normal_r, normal_z],
                    offset: offset_mm,
                };
                // where r is not negative
                let axis = offset_mm * normal_r / normal_z;
                let range = match normal_z {
                    z if z < -1e-6 => [axis.max(-2.0 * reach), 2.0 * reach],
                    z if z > 1e-6 => [-2.0 * reach, axis.min(2.0 * reach)],
                    _ => [-2.0 * reach, 2.0 * reach],
                };
                vec![(line, range)]
            }
            Form::Ball {
                radius_mm,
                centre_mm,
            } => {
                let arc = Self::Arc {
                    disc: 0.0,
                    centre: centre_mm,
                    radius: radius_mm,
                };
                vec![(arc, [-FRAC_PI_2, FRAC_PI_2])]
            }
            Form::Ring {
                disc_mm,
                centre_mm,
                radius_mm,
            } => {
                let flat = |side: f32| Self::Flat {
                    height: centre_mm + side * radius_mm,
                    up: side > 0.0,
                };
                let arc = Self::Arc {
                    disc: disc_mm,
                    centre: centre_mm,
                    radius: radius_mm,
                };
                vec![
                    (flat(-1.0), [0.0, disc_mm]),
                    (arc, [-FRAC_PI_2, FRAC_PI_2]),
                    (flat(1.0), [0.0, disc_mm]),
                ]
            }
        }
    }
}

/// An exposed piece of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    curve: Curve,
    range: [f32; 2],
    cutting: bool,
}

impl Piece {
    fn area(&self) -> f32 {
        self.curve.area(self.range[1]) - self.curve.area(self.range[0])
    }

    /// Parameter below which a share of the area lies.
    fn share(&self, share: f32) -> f32 {
        let goal = self.curve.area(self.range[0]) + share * self.area();
        let [mut lo, mut hi] = self.range;
        for _ in 0..40 {
            let middle = 0.5 * (lo + hi);
            if self.curve.area(middle) < goal {
                lo = middle;
            } else {
                hi = middle;
            }
        }
        0.5 * (lo + hi)
    }

    /// Where the piece begins in a point on the axis that a tool can stand on (a cone's tip, a dome's
    /// pole): the height there of what lies `depth` below the surface, mm.
    fn tip(&self, depth: f32) -> Option<f32> {
        let [r, z, nr, nz] = self.curve.at(self.range[0]);
        let stands = match self.curve {
            Curve::Line { .. } => nz < -0.1 && nr > 0.2,
            Curve::Arc { .. } => nz < -0.99,
            Curve::Flat { .. } => false,
        };
        (stands && r < SIDE_MM).then(|| z - depth / nz)
    }
}

/// The elements of a solid, at most [`MAX_ELEMENTS`]: on cutting faces their areas sum to the exposed
/// area; smooth ones lie [`RELIEF_MM`] below the surface and keep away from edges and backs.
pub fn of_revolved(solid: &Revolved) -> Vec<Element> {
    let pieces = exposed(solid);
    let mut elements = Vec::new();
    for (cutting, (each, least, most)) in [(true, CUTTING), (false, SMOOTH)] {
        let of_kind: Vec<Piece> = pieces
            .iter()
            .filter(|p| p.cutting == cutting && p.area() > 0.0)
            .copied()
            .collect();
        let total: f32 = of_kind.iter().map(Piece::area).sum();
        // room for the fewest of every piece
        let room = MAX_ELEMENTS.saturating_sub(elements.len() + usize::from(LEAST) * of_kind.len());
        let wanted = (total / each).clamp(f32::from(least), f32::from(most));
        let budget = wanted.min(room as f32);
        for piece in of_kind {
            let count = (budget * piece.area() / total).round();
            place(&piece, count.max(f32::from(LEAST)), &mut elements);
        }
    }
    elements.truncate(MAX_ELEMENTS);
    elements
}

fn place(piece: &Piece, count: f32, elements: &mut Vec<Element>) {
    let relief = if piece.cutting { 0.0 } else { RELIEF_MM };
    let mut area = piece.area();
    if let Some(z) = piece.tip(relief) {
        let area_mm2 = TIP_MM2.min(0.01 * area);
        area -= area_mm2;
        elements.push(Element {
            position: Vec3::new(0.0, 0.0, z),
            normal: Vec3::NEG_Z,
            area_mm2,
            radius_mm: 0.0,
            cutting: piece.cutting,
        });
    }
    let mut n = 0.0;
    while n < count {
        let [r, z, nr, nz] = piece.curve.at(piece.share((n + 0.5) / count));
        let (r, z) = (r - relief * nr, z - relief * nz);
        let (cos, sin) = (libm::cosf(n * GOLDEN_ANGLE), libm::sinf(n * GOLDEN_ANGLE));
        n += 1.0;
        if r < 0.0 {
            // the relief of a point on the axis
            continue;
        }
        elements.push(Element {
            position: Vec3::new(r * cos, r * sin, z),
            normal: Vec3::new(nr * cos, nr * sin, nz),
            area_mm2: area / count,
            radius_mm: r,
            cutting: piece.cutting,
        });
    }
}

/// The pieces of every face that lie on the solid's own surface.
fn exposed(solid: &Revolved) -> Vec<Piece> {
    let reach = [solid.bounds.lo, solid.bounds.hi]
        .iter()
        .map(|corner| corner.abs().max_element())
        .fold(1.0, f64::max);
    #[expect(clippy::cast_possible_truncation, reason = "a tool is below 500 mm")]
    let reach = reach as f32;
    let mut pieces = Vec::new();
    for (part, shape) in solid.parts.iter().enumerate() {
        for (face, &Face { form, cutting }) in shape.faces.iter().enumerate() {
            for (curve, range) in Curve::of(form, reach) {
                let back = matches!(curve, Curve::Flat { up: true, .. });
                if back && !cutting {
                    continue;
                }
                let seen = |u: f32| {
                    let spot = curve.at(u);
                    (cutting || spot[3] < BACK) && is_exposed(solid, (part, face), spot)
                };
                for range in runs(range, &seen) {
                    pieces.push(Piece {
                        curve,
                        range,
                        cutting,
                    });
                }
            }
        }
    }
    pieces
}

/// The runs of a parameter on which `seen` holds, their ends found to a float's precision.
fn runs([lo, hi]: [f32; 2], seen: &impl Fn(f32) -> bool) -> Vec<[f32; 2]> {
    let edge = |mut inside: f32, mut outside: f32| {
        for _ in 0..40 {
            let middle = 0.5 * (inside + outside);
            if seen(middle) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        inside
    };
    let at = |i: u16| lo + (hi - lo) * f32::from(i) / f32::from(STEPS);
    let mut runs = Vec::new();
    let mut begun: Option<f32> = None;
    for i in 0..=STEPS {
        match (begun, seen(at(i))) {
            (None, true) if i == 0 => begun = Some(lo),
            (None, true) => begun = Some(edge(at(i), at(i - 1))),
            (Some(from), false) => {
                runs.push([from, edge(at(i - 1), at(i))]);
                begun = None;
            }
            _ => {}
        }
    }
    if let Some(from) = begun {
        runs.push([from, hi]);
    }
    runs.retain(|[from, to]| to - from > SIDE_MM * 1e-2);
    runs
}

/// Whether a spot of a face lies on its part's surface and no other part covers it. A smooth face
/// counts only away from edges.
fn is_exposed(solid: &Revolved, (part, face): (usize, usize), [r, z, nr, nz]: Spot) -> bool {
    let own = &solid.parts[part];
    let margin = if own.faces[face].cutting {
        -1e-5
    } else {
        EDGE_MM
    };
    let clear = |(n, f): (usize, &Face)| n == face || f.form.distance(r, z) <= -margin;
    if r < 0.0 || !own.faces.iter().enumerate().all(clear) {
        return false;
    }
    // rounding of a distance
    let touch = 2.4e-7 * (r + z.abs());
    solid.parts.iter().enumerate().all(|(n, other)| {
        if n == part {
            return true;
        }
        let distance = other.distance(r, z);
        if distance.abs() > touch {
            return distance >= margin.max(0.0);
        }
        let along = |way: f32| other.distance((r + way * nr).max(0.0), z + way * nz);
        // two parts that touch bury each other's faces; of a face that they share the first has it
        let buried = along(SIDE_MM) < 0.5 * SIDE_MM;
        let shared = n < part && along(-SIDE_MM) < 0.0;
        !buried && !shared
    })
}
