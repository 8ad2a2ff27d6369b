//! The scapula's outer form as an implicit function: smooth unions of plates, beams and a head.
//!
//! Every part returns a distance-like value in mm, positive inside. Landmarks are in the phantom
//! frame (x anterior, y superior, z lateral; origin on the joint face).

use glam::{DVec2, DVec3, DVec4};

/// Upper bound of the gradient's length anywhere.
pub const LIPSCHITZ: f64 = 1.2;
/// Radius of the concave joint face, mm; its centre is on the z axis.
pub const FACE_RADIUS_MM: f64 = 34.0;

/// Outline of the blade in its plane, (y, z), mm, before rounding by [`OUTLINE_ROUNDING`].
const OUTLINE: [DVec2; 12] = [
    DVec2::new(11.0, -14.0), // under the coracoid
    DVec2::new(15.0, -27.0), // suprascapular notch
    DVec2::new(27.0, -48.0),
    DVec2::new(36.0, -72.0),
    DVec2::new(38.0, -82.0), // superior angle
    DVec2::new(29.0, -92.0),
    DVec2::new(10.0, -98.0), // root of the spine
    DVec2::new(-30.0, -95.0),
    DVec2::new(-72.0, -86.0),
    DVec2::new(-94.0, -75.0), // inferior angle
    DVec2::new(-88.0, -66.0),
    DVec2::new(-12.0, -14.0), // infraglenoid
];
const OUTLINE_ROUNDING: f64 = 4.0;
/// Width of the fillets between the parts, mm.
const BLEND: f64 = 5.0;

/// A straight beam with a radius that changes from end to end.
#[derive(Debug)]
struct Beam {
    from: DVec3,
    to: DVec3,
    radius: [f64; 2],
}

/// A flat triangle thickened to both sides.
#[derive(Debug)]
struct Plate {
    corners: [DVec3; 3],
    half_thickness: f64,
}

/// Parts of one kind with a box around them.
#[derive(Debug)]
struct Group<T> {
    parts: Vec<T>,
    lo: DVec3,
    hi: DVec3,
}

/// The scapula's parts.
#[derive(Debug)]
pub struct Scapula {
    outline: Vec<DVec2>,
    pillar: Group<Beam>,
    // crest of the spine and the acromion's outer edge
    ridge: Group<Beam>,
    // wall of the spine and roof of the acromion
    walls: Group<Plate>,
    coracoid: Group<Beam>,
    // centre of the eroded face's ball, mm
    eroded: Option<DVec3>,
}

impl Group<Beam> {
    fn of_beams(parts: Vec<Beam>) -> Self {
        let balls = parts
            .iter()
            .flat_map(|b| [(b.from, b.radius[0]), (b.to, b.radius[1])]);
        let (lo, hi) = bounds(balls);
        Self { parts, lo, hi }
    }

    /// The union's value, or some value below `floor` where it is below.
    fn value(&self, p: DVec3, floor: f64) -> f64 {
        let most = -p.distance(p.clamp(self.lo, self.hi));
        if most < floor {
            return most;
        }
        let values = self.parts.iter().map(|b| b.value(p));
        values.fold(f64::NEG_INFINITY, f64::max)
    }
}

impl Group<Plate> {
    fn of_plates(parts: Vec<Plate>) -> Self {
        let balls = parts
            .iter()
            .flat_map(|t| t.corners.map(|c| (c, t.half_thickness)));
        let (lo, hi) = bounds(balls);
        Self { parts, lo, hi }
    }

    /// The union's value, or some value below `floor` where it is below.
    fn value(&self, p: DVec3, floor: f64) -> f64 {
        let most = -p.distance(p.clamp(self.lo, self.hi));
        if most < floor {
            return most;
        }
        let values = self.parts.iter().map(|t| t.value(p));
        values.fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The box around balls of (centre, radius).
fn bounds(balls: impl Iterator<Item = (DVec3, f64)>) -> (DVec3, DVec3) {
    balls.fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(lo, hi), (c, r)| (lo.min(c - r), hi.max(c + r)),
    )
}

/// Beams along a smooth curve (centripetal enough: Catmull–Rom) through points (x, y, z, radius).
fn chain(points: &[[f64; 4]]) -> Vec<Beam> {
    const PIECES: usize = 4;
    let at = |n: usize| DVec4::from_array(points[n.clamp(1, points.len()) - 1]);
    let curve = |n: usize, t: f64| {
        // at(0) repeats the first point, at(len + 1) the last
        let [a, b, c, d] = [at(n), at(n + 1), at(n + 2), at(n + 3)];
        0.5 * (2.0 * b
            + t * (c - a)
            + t * t * (2.0 * a - 5.0 * b + 4.0 * c - d)
            + t * t * t * (3.0 * b - a - 3.0 * c + d))
    };
    let samples: Vec<DVec4> = (0..points.len() - 1)
        .flat_map(|n| (0..PIECES).map(move |m| (n, m as f64 / PIECES as f64)))
        .map(|(n, t)| curve(n, t))
        .chain([at(points.len())])
        .collect();
    let beam = |ends: &[DVec4]| Beam {
        from: ends[0].truncate(),
        to: ends[1].truncate(),
        radius: [ends[0].w, ends[1].w],
    };
    samples.windows(2).map(beam).collect()
}

/// A closed outline with its corners cut at a quarter of each side (Chaikin).
fn cut_corners(outline: &[DVec2]) -> Vec<DVec2> {
    let next = outline.iter().cycle().skip(1);
    outline
        .iter()
        .zip(next)
        .flat_map(|(a, b)| [a.lerp(*b, 0.25), a.lerp(*b, 0.75)])
        .collect()
}

const fn plate(a: [f64; 3], b: [f64; 3], c: [f64; 3], half_thickness: f64) -> Plate {
    Plate {
        corners: [
            DVec3::from_array(a),
            DVec3::from_array(b),
            DVec3::from_array(c),
        ],
        half_thickness,
    }
}

impl Default for Scapula {
    fn default() -> Self {
        let root = [-5.0, 12.0, -98.0];
        let notch = [-6.0, 14.0, -27.0];
        let middle = [-21.0, 19.0, -62.0];
        let crest = [-34.0, 27.0, -18.0];
        // corners of the acromion's roof
        let (angle, inner, tip) = ([-33.0, 33.0, 4.0], [-12.0, 37.0, -2.0], [-3.0, 38.0, 19.0]);
        let outer = [-20.0, 37.0, 17.0];
        Self {
            outline: cut_corners(&OUTLINE),
            eroded: None,
            pillar: Group::of_beams(chain(&[
                [-1.0, -15.0, -12.0, 6.0],
                [-5.0, -38.0, -32.0, 5.0],
                [-5.0, -68.0, -55.0, 4.4],
                [-2.0, -92.0, -75.0, 3.2],
            ])),
            ridge: Group::of_beams(chain(&[
                [root[0], root[1], root[2], 2.4],
                [middle[0], middle[1], middle[2], 4.0],
                [crest[0], crest[1], crest[2], 5.0],
                [angle[0], angle[1], angle[2], 4.8],
                [outer[0], outer[1], outer[2], 4.4],
                [tip[0], tip[1], tip[2], 4.0],
            ])),
            walls: Group::of_plates(vec![
                plate(root, notch, middle, 2.0),
                plate(notch, middle, crest, 2.4),
                plate(crest, angle, inner, 3.8),
                plate(angle, inner, outer, 3.8),
                plate(inner, outer, tip, 3.8),
            ]),
            coracoid: Group::of_beams(chain(&[
                [3.0, 14.0, -18.0, 8.5],
                [11.0, 28.0, -17.0, 7.2],
                [23.0, 34.0, -9.0, 5.8],
                [35.0, 28.0, 5.0, 4.8],
            ])),
        }
    }
}

impl Scapula {
    /// The implicit function at `p` (phantom frame, mm), positive inside; near the surface about
    /// the distance to it.
    pub fn value(&self, p: DVec3) -> f64 {
        // a part that is more than the blend's width below the rest changes nothing
        let mut v = smooth_max(head(p), neck(p), 4.0);
        v = smooth_max(v, self.blade(p, v - BLEND), BLEND);
        v = smooth_max(v, self.pillar.value(p, v - BLEND), BLEND);
        v = smooth_max(v, self.coracoid.value(p, v - BLEND), BLEND);
        let floor = v - BLEND - 1.0;
        let ridge = self.ridge.value(p, floor);
        // two equal values gain a quarter of their blend
        let spine = smooth_max(self.walls.value(p, floor), ridge, 3.0);
        v = smooth_max(v, spine, BLEND);
        // the humeral head's place is free of bone: this is what makes the face concave
        smooth_min(v, self.face_depth(p), 1.0)
    }

    /// The blade: a bent sheet, hollow in front, thicker along its borders. Some value below
    /// `floor` where it is below.
    fn blade(&self, p: DVec3, floor: f64) -> f64 {
        // hollow in front: the middle bulges backward (-x)
        let u = ((p.z + 55.0) / 50.0).clamp(-1.3, 1.3);
        let w = ((p.y + 28.0) / 75.0).clamp(-1.3, 1.3);
        let bulge = -7.0 * (1.0 - u * u).max(-0.6) * (1.0 - 0.6 * w * w) - 1.0;
        let aside = (p.x - bulge).abs();
        let most = 0.92 * (2.8 - aside);
        if most < floor {
            return most;
        }
        let edge = signed_outline(&self.outline, DVec2::new(p.y, p.z)) + OUTLINE_ROUNDING;
        let border = 1.0 - (edge / 9.0).clamp(0.0, 1.0);
        let half = 1.3 + 1.5 * border * border;
        smooth_min(half - aside, edge, 2.0) * 0.92
    }

    /// A scapula whose posterior half of the face is eroded (biconcave, as Walch's type B2): a second ball of
    /// the face's radius, `mm` deep in its middle, which looks `deg` backwards.
    pub fn eroded(deg: f64, mm: f64) -> Self {
        // the middle of the eroded half
        let middle = DVec3::new(-7.0, 0.0, 0.0);
        let (sin, cos) = libm::sincos(deg.to_radians());
        let out = DVec3::new(-sin, 0.0, cos);
        let on_face =
            middle.with_z(FACE_RADIUS_MM - (FACE_RADIUS_MM * FACE_RADIUS_MM - 49.0).sqrt());
        Self {
            eroded: (mm > 0.0).then(|| on_face - DVec3::Z * mm + out * FACE_RADIUS_MM),
            ..Self::default()
        }
    }

    /// Depth below the joint face, mm, the eroded part included.
    fn face_depth(&self, p: DVec3) -> f64 {
        let whole = face_depth(p);
        match self.eroded {
            Some(centre) => whole.min(p.distance(centre) - FACE_RADIUS_MM),
            None => whole,
        }
    }

    /// Depth below the joint face, mm, where a cartilage-covered face lies above `p`; the oval ends a
    /// little inside the rim.
    pub fn depth_under_face(&self, p: DVec3) -> Option<f64> {
        (oval(p.x, p.y, 0.0) > 1.2 && p.z > -14.0).then(|| self.face_depth(p))
    }

    /// Its gradient by central differences.
    pub fn gradient(&self, p: DVec3) -> DVec3 {
        const STEP: f64 = 0.05;
        let along = |d: DVec3| (self.value(p + d) - self.value(p - d)) / (2.0 * STEP);
        DVec3::new(
            along(DVec3::X * STEP),
            along(DVec3::Y * STEP),
            along(DVec3::Z * STEP),
        )
    }
}

/// Depth below the sphere of the joint face, mm.
fn face_depth(p: DVec3) -> f64 {
    (p - DVec3::Z * FACE_RADIUS_MM).length() - FACE_RADIUS_MM
}

/// Distance-like value inside the pear-shaped oval of the face (14 × 18 mm half axes, narrower
/// above), shrunk by `shrink` mm.
fn oval(x: f64, y: f64, shrink: f64) -> f64 {
    // narrower above, wider below
    let pear = 1.0 - 0.10 * (y / 18.0).clamp(-1.2, 1.2);
    let half = DVec2::new(14.0 * pear, 18.0) - shrink;
    // exact on the rim, too small by at most the ratio of the axes elsewhere
    (1.0 - (DVec2::new(x, y) / half).length()) * half.min_element()
}

/// The head: under the face an oval column that narrows towards the neck.
fn head(p: DVec3) -> f64 {
    let back = (-p.z / 17.0).clamp(0.0, 1.0);
    let side = oval(p.x, p.y, 5.0 * back * back * (3.0 - 2.0 * back)) * 0.85;
    let ends = (5.0 - p.z).min(p.z + 22.0);
    smooth_min(side, ends, 2.5)
}

/// The neck: from the head's middle into the blade, flattened from front to back.
fn neck(p: DVec3) -> f64 {
    let flat = DVec3::new(p.x * 1.15, p.y * 0.8, p.z);
    let cone = Beam {
        from: DVec3::new(-1.0, 1.0, -12.0),
        to: DVec3::new(-8.0, 0.0, -50.0),
        // below zero: the tip fades out inside the blade
        radius: [9.5, -2.5],
    };
    cone.value(flat) * 0.87
}

/// Signed distance to the blade's outline in its plane, mm, positive inside (even–odd rule).
fn signed_outline(outline: &[DVec2], p: DVec2) -> f64 {
    let mut nearest = f64::INFINITY;
    let mut inside = false;
    for (n, &a) in outline.iter().enumerate() {
        let b = outline[(n + 1) % outline.len()];
        let along = b - a;
        let t = ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        nearest = nearest.min(p.distance_squared(a + along * t));
        let crosses = (a.y > p.y) != (b.y > p.y);
        if crosses && p.x < a.x + along.x * (p.y - a.y) / along.y {
            inside = !inside;
        }
    }
    if inside {
        nearest.sqrt()
    } else {
        -nearest.sqrt()
    }
}

impl Beam {
    fn value(&self, p: DVec3) -> f64 {
        let along = self.to - self.from;
        let t = ((p - self.from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        let radius = self.radius[0] + t * (self.radius[1] - self.radius[0]);
        radius - p.distance(self.from + along * t)
    }
}

impl Plate {
    fn value(&self, p: DVec3) -> f64 {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        let beside = |from: DVec3, to: DVec3| (to - from).cross(p - from).dot(normal) < 0.0;
        let distance = if beside(a, b) || beside(b, c) || beside(c, a) {
            let side = |from, to| {
                Beam {
                    from,
                    to,
                    radius: [0.0; 2],
                }
                .value(p)
            };
            -side(a, b).max(side(b, c)).max(side(c, a))
        } else {
            (p - a).dot(normal).abs() / normal.length()
        };
        self.half_thickness - distance
    }
}

/// Union of two bodies with a fillet of about `k` mm: a polynomial blend, exact where the two
/// values are more than `k` apart.
fn smooth_max(a: f64, b: f64, k: f64) -> f64 {
    let overlap = (k - (a - b).abs()).max(0.0);
    a.max(b) + overlap * overlap / (4.0 * k)
}

/// Intersection with a rounded edge.
fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    -smooth_max(-a, -b, k)
}
