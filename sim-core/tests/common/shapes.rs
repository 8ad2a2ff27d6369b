//! Meshes with known answers.

use glam::Vec3;
use osteon_sim_core::tool::bvh::Triangle;

/// Signed distance of a ball about the origin.
pub fn ball(p: Vec3, radius: f32) -> f32 {
    p.length() - radius
}

/// Unit vectors, evenly spread.
pub fn cloud(count: u16) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |n| {
        let z = 1.0 - (2.0 * f32::from(n) + 1.0) / f32::from(count);
        let turn = 2.399_963_2 * f32::from(n);
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * libm::cosf(turn), r * libm::sinf(turn), z)
    })
}

/// An octahedron whose triangles were split in four `times` times and pushed out to a radius.
pub fn sphere(radius: f32, times: u32) -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut all: Vec<Triangle> = vec![
        [x, y, z],
        [y, -x, z],
        [-x, -y, z],
        [-y, x, z],
        [y, x, -z],
        [-x, y, -z],
        [-y, -x, -z],
        [x, -y, -z],
    ];
    for _ in 0..times {
        all = all
            .into_iter()
            .flat_map(|[a, b, c]| {
                let half = |p: Vec3, q: Vec3| (p + q) / (p + q).length();
                let (ab, bc, ca) = (half(a, b), half(b, c), half(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    all.into_iter().map(|t| t.map(|v| v * radius)).collect()
}

/// 32,768 triangles.
pub fn fine_sphere(radius: f32) -> Vec<Triangle> {
    sphere(radius, 6)
}

/// Without the triangles within `degrees` of +z.
pub fn holed(triangles: &[Triangle], degrees: f32) -> Vec<Triangle> {
    let limit = libm::cosf(degrees.to_radians());
    let outside = |t: &&Triangle| {
        let centre = t[0] + t[1] + t[2];
        centre.z <= limit * centre.length()
    };
    triangles.iter().filter(outside).copied().collect()
}

/// Inside out.
pub fn turned(triangles: &[Triangle]) -> Vec<Triangle> {
    triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect()
}

/// An outline of (r, z) points from the lower end of the axis to its upper end, turned about z in
/// `around` facets whose middles lie on the circle half-way between the inner and the outer one.
pub fn lathe(outline: &[[f32; 2]], around: u16) -> Vec<Triangle> {
    let half = std::f32::consts::PI / f32::from(around);
    let fit = 2.0 / (1.0 + libm::cosf(half));
    let at = |[r, z]: [f32; 2], n: u16| {
        let turn = 2.0 * half * f32::from(n % around);
        Vec3::new(fit * r * libm::cosf(turn), fit * r * libm::sinf(turn), z)
    };
    let mut all = Vec::new();
    for pair in outline.windows(2) {
        for n in 0..around {
            let [a, b] = [at(pair[0], n), at(pair[0], n + 1)];
            let [d, c] = [at(pair[1], n), at(pair[1], n + 1)];
            if pair[0][0] > 0.0 {
                all.push([a, b, c]);
            }
            if pair[1][0] > 0.0 {
                all.push([a, c, d]);
            }
        }
    }
    all
}

/// Volume inside, mm³, by the divergence theorem.
pub fn volume(triangles: &[Triangle]) -> f64 {
    let six: f64 = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(Vec3::as_dvec3);
            a.dot(b.cross(c))
        })
        .sum();
    six / 6.0
}
