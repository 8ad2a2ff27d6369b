//! Broken meshes: case 32.

use super::Case;
use glam::Vec3;
use osteon_sim_core::tool::bvh::Triangle;
use osteon_sim_core::tool::mesh::{MAX_TRIANGLES, Mesh, MeshError};
use osteon_sim_core::tool::sdf_grid::{SdfGrid, one_by_one};

const RADIUS: f32 = 6.0;

/// An octahedron split four times and pushed out to a ball: 2,048 triangles.
fn sphere(radius: f32, centre: Vec3) -> Vec<Triangle> {
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
    for _ in 0..4 {
        all = all
            .into_iter()
            .flat_map(|[a, b, c]| {
                let half = |p: Vec3, q: Vec3| (p + q) / (p + q).length();
                let (ab, bc, ca) = (half(a, b), half(b, c), half(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let place = |v: Vec3| centre + v * radius;
    all.into_iter().map(|t| t.map(place)).collect()
}

/// Volume inside a closed mesh, mm³, by the divergence theorem.
fn volume(triangles: &[Triangle]) -> f64 {
    let six = triangles.iter().map(|t| {
        let [a, b, c] = t.map(Vec3::as_dvec3);
        a.dot(b.cross(c))
    });
    six.sum::<f64>() / 6.0
}

/// What became of a mesh: its volume, or why it was refused.
fn outcome(triangles: Vec<Triangle>) -> Result<f64, MeshError> {
    let mesh = Mesh::new(triangles)?;
    Ok(SdfGrid::new(&mesh, Some(0.5), &one_by_one)?.volume_mm3())
}

/// Volume inside, mm³, by the sign alone of the sampled distance at points 0.3 mm apart: what a tool cuts.
fn cut_volume(triangles: Vec<Triangle>) -> Result<f64, MeshError> {
    const STEP: f32 = 0.3;
    let mesh = Mesh::new(triangles)?;
    let grid = SdfGrid::new(&mesh, Some(0.5), &one_by_one)?;
    let [lo, hi] = mesh.corners();
    let along = |lo: f32, hi: f32| {
        let count = ((hi - lo) / STEP).ceil().clamp(0.0, 1000.0);
        (0u16..1000)
            .map(f32::from)
            .take_while(move |n| *n < count)
            .map(move |n| lo + STEP * (n + 0.37))
    };
    let mut inside = 0u32;
    for z in along(lo.z, hi.z) {
        for y in along(lo.y, hi.y) {
            let row = along(lo.x, hi.x).filter(|&x| grid.signed_distance(Vec3::new(x, y, z)) < 0.0);
            inside += u32::try_from(row.count()).unwrap_or(0);
        }
    }
    Ok(f64::from(inside) * f64::from(STEP).powi(3))
}

/// Spoilt spheres that are to keep their volume.
fn mended(whole: &[Triangle]) -> Vec<(&'static str, Vec<Triangle>)> {
    let with = |more: &[Triangle]| [whole, more].concat();
    let [a, b, _] = whole[0];
    // 12 mm long and 12 nm wide
    let needle = [Vec3::X * -6.0, Vec3::X * 6.0, Vec3::Y * 1.2e-5];
    let mut unwelded = whole.to_vec();
    for (n, t) in unwelded.iter_mut().enumerate() {
        t[n % 3] += Vec3::splat(if n % 2 == 0 { 1e-6 } else { -1e-6 });
    }
    let mut missing = whole.to_vec();
    missing.remove(77);
    let turned = whole.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let limit = 20f32.to_radians().cos();
    let holed = |t: &&Triangle| {
        let centre = t[0] + t[1] + t[2];
        centre.z <= limit * centre.length()
    };
    vec![
        (
            "zero area",
            with(&[[a, b, b], [a, a, a], [a, b, 0.5 * (a + b)]]),
        ),
        ("duplicates", with(&whole[..100])),
        ("needle", with(&[needle])),
        ("unwelded", unwelded),
        ("inverted", turned),
        ("one missing", missing),
        ("20° hole", whole.iter().filter(holed).copied().collect()),
    ]
}

/// Case 32.
pub(super) fn degenerate() -> Case {
    let whole = sphere(RADIUS, Vec3::ZERO);
    let truth = volume(&whole);
    let mut words = Vec::new();
    let mut pass = true;
    for (name, triangles) in mended(&whole) {
        let found = outcome(triangles);
        let off = found.as_ref().map(|v| v / truth - 1.0);
        pass &= off.is_ok_and(|off| off.abs() <= 0.01);
        words.push(match off {
            Ok(off) => format!("{name} {:+.2} %", 100.0 * off),
            Err(e) => format!("{name} refused ({e})"),
        });
    }
    // two balls that run through each other: the union, by the lens of two equal balls
    let (r, d) = (f64::from(RADIUS), 5.0);
    let two = [whole.clone(), sphere(RADIUS, Vec3::X * 5.0)].concat();
    let lens = core::f64::consts::PI * (4.0 * r + d) * (2.0 * r - d).powi(2) / 12.0;
    let scale = truth / (4.0 / 3.0 * core::f64::consts::PI * r.powi(3));
    let union = cut_volume(two).map(|v| v / (2.0 * truth - lens * scale) - 1.0);
    pass &= union.is_ok_and(|off| off.abs() <= 0.01);
    words.push(format!(
        "self-intersection {:+.2} %",
        100.0 * union.unwrap_or(f64::NAN)
    ));
    let mut broken = whole.clone();
    broken[5][1].y = f32::NAN;
    let refused = [
        ("0 triangles", Vec::new()),
        ("1 triangle", whole[..1].to_vec()),
        ("NaN", broken),
        (
            "10,000,000 triangles",
            vec![[Vec3::ZERO; 3]; 5 * MAX_TRIANGLES],
        ),
    ];
    for (name, triangles) in refused {
        let found = outcome(triangles);
        pass &= found.is_err();
        words.push(match found {
            Ok(v) => format!("{name} **taken** ({v:.1} mm³)"),
            Err(e) => format!("{name}: {e}"),
        });
    }
    Case {
        id: 32,
        name: "Broken meshes",
        criterion: "a ball with triangles of no area, doubled, a needle of 1:10⁶, unwelded, inside out, one triangle missing, a hole of 20°, \
                    and two balls that run through each other (by the sign \
                    alone): volume within 1 %; 0, 1 and 10,000,000 triangles and a NaN: refused with a \
                    reason; the case itself is the proof that nothing hangs"
            .to_owned(),
        measured: words.join("; "),
        pass,
    }
}
