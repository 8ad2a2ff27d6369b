//! Tools from files with planted faults and planted answers.

mod stl_files;
mod toml_files;

use glam::Vec3;
use osteon_sim_core::tool::bvh::Triangle;
use std::fmt::Write as _;

/// A ball about (0, 0, `radius`), of 2048 triangles.
fn ball(radius: f32) -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let corners = [[x, y], [y, -x], [-x, -y], [-y, x]];
    let mut all: Vec<Triangle> = corners
        .iter()
        .flat_map(|&[a, b]| [[a, b, z], [b, a, -z]])
        .collect();
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
    let place = |v: Vec3| (v + Vec3::Z) * radius;
    all.into_iter().map(|t| t.map(place)).collect()
}

/// A binary STL whose header begins with `title`.
fn binary(title: &str, triangles: &[Triangle]) -> Vec<u8> {
    let mut bytes = vec![0u8; 80];
    bytes[..title.len()].copy_from_slice(title.as_bytes());
    let count = u32::try_from(triangles.len()).expect("few");
    bytes.extend(count.to_le_bytes());
    for t in triangles {
        bytes.extend([0u8; 12]);
        for v in t {
            bytes.extend(v.to_array().iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes.extend([0u8; 2]);
    }
    bytes
}

/// An ASCII STL.
fn ascii(triangles: &[Triangle]) -> String {
    let mut text = String::from("solid a facet of a name\n");
    for t in triangles {
        text.push_str(" facet normal 0 0 0\n  outer loop\n");
        for v in t {
            writeln!(text, "   vertex {:e} {} {}", v.x, v.y, v.z).expect("text");
        }
        text.push_str("  endloop\n endfacet\n");
    }
    text.push_str("endsolid\n");
    text
}
