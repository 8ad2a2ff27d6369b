//! Tools of triangles: sampled distances against closed forms, and meshes that are broken in known
//! ways.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a test that shows its figures"
)]

mod common;

use common::shapes::{ball, fine_sphere, holed, lathe, sphere, turned, volume};
use common::slab;
use glam::{DVec3, Vec3};
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::bvh::{Bvh, Triangle};
use osteon_sim_core::tool::mesh::{Mesh, MeshError};
use osteon_sim_core::tool::sdf_grid::{BAND_MM, SdfGrid, UNIT_MM, one_by_one};
use osteon_sim_core::tool::{MAX_ELEMENTS, Tool};
use std::f64::consts::PI;
use std::sync::Arc;

const R: f32 = 6.0;

fn mesh(triangles: Vec<Triangle>) -> Mesh {
    Mesh::new(triangles).expect("a mesh")
}

fn grid(mesh: &Mesh) -> SdfGrid {
    SdfGrid::new(mesh, None, &one_by_one).expect("a grid")
}

#[test]
fn a_tessellated_ball_is_the_ball_within_the_stated_error() {
    let m = mesh(fine_sphere(R));
    let g = grid(&m);
    println!(
        "{} triangles, {:?} nodes: error {:.4} mm within 2 mm, {:.4} mm RMS on the surface",
        m.findings().triangles,
        g.dims,
        g.error_mm,
        g.surface_rms_mm
    );
    // the facets' own sagitta
    let facets = 0.004;
    let mut worst = 0.0f32;
    for (n, p) in common::shapes::cloud(20_000).enumerate() {
        let p = p * (R - 2.0 + 4.0 * (n % 97) as f32 / 97.0);
        let d = g.signed_distance(p) - ball(p, R);
        worst = worst.max(d.abs());
    }
    println!("against the ball: {worst:.4} mm");
    assert!(worst <= g.error_mm + facets, "{worst}");
    assert!(g.error_mm < 0.03);
    // beyond the grid: never more than the truth, and most of it
    for p in common::shapes::cloud(2000) {
        for far in [9.0, 30.0, 200.0] {
            let p = p * far;
            let (d, truth) = (g.signed_distance(p), ball(p, R));
            assert!(d <= truth + 0.03 && d > 0.7 * truth, "{p} {d} {truth}");
        }
    }
}

/// Volume of the sphere as faceted, and of the grid made of a spoilt one.
fn volumes(spoilt: Vec<Triangle>) -> [f64; 2] {
    [volume(&sphere(R, 4)), grid(&mesh(spoilt)).volume_mm3()]
}

#[test]
fn a_sphere_with_holes_keeps_its_volume_within_one_percent() {
    let whole = sphere(R, 4);
    let mut one_missing = whole.clone();
    one_missing.remove(77);
    // a cap of 20° is 0.27 % of a ball
    for (name, spoilt) in [("one", one_missing), ("cap", holed(&whole, 20.0))] {
        let open = mesh(spoilt.clone()).findings();
        let [truth, got] = volumes(spoilt);
        println!("{name} missing: {got:.2} of {truth:.2} mm³, {open:?}");
        assert!((got / truth - 1.0).abs() < 0.01, "{got} {truth}");
        assert!(open.open_edges > 0 && open.winding_gap > 0.001);
    }
    // the lid is a surface like any other: no jump of the distance beside it
    let g = grid(&mesh(holed(&whole, 35.0)));
    let row = g.dims[0];
    let h = g.spacing_mm * 1.1 + 2e-3;
    for n in 0..g.values.len() - row * g.dims[1] {
        for next in [n + 1, n + row, n + row * g.dims[1]] {
            let wraps = next == n + 1 && next % row == 0
                || next == n + row && (next / row).is_multiple_of(g.dims[1]);
            let pair = [n, next].map(|m| f32::from(g.values[m]) * UNIT_MM);
            let far = pair[0].abs() > BAND_MM;
            let step = (pair[0] - pair[1]).abs();
            assert!(wraps || far || step < h, "{n} {next} {step}");
        }
    }
}

#[test]
fn an_inverted_sphere_is_the_sphere() {
    let whole = sphere(R, 4);
    let (a, b) = (mesh(whole.clone()), mesh(turned(&whole)));
    assert!(!a.findings().turned && b.findings().turned);
    assert!(a.is_closed() && b.is_closed());
    let (a, b) = (grid(&a), grid(&b));
    assert_eq!(a.dims, b.dims);
    let worst = (a.values.iter().zip(&b.values)).map(|(x, y)| (x - y).abs());
    assert!(worst.max() <= Some(1));
    for e in mesh(turned(&whole)).elements(9.0) {
        assert!(e.normal.dot(e.position) > 0.9 * R, "outwards");
    }
}

#[test]
fn broken_triangles_change_nothing() {
    let whole = sphere(R, 4);
    let truth = grid(&mesh(whole.clone()));
    let mut unwelded = whole.clone();
    for (n, t) in unwelded.iter_mut().enumerate() {
        let off = 1e-5 * ((n * 7) % 5) as f32;
        *t = t.map(|v| v + Vec3::new(off, -off, off));
    }
    let mut doubled = whole.clone();
    doubled.extend(whole.iter().step_by(3).map(|[a, b, c]| [*b, *c, *a]));
    let mut dots = whole.clone();
    dots.extend(whole.iter().step_by(5).map(|t| [t[0]; 3]));
    dots.extend(whole.iter().step_by(7).map(|t| [t[0], t[1], t[0]]));
    // a needle of aspect 10⁶ on either side of an edge
    let mut needles = whole.clone();
    let [a, b, c] = needles.swap_remove(9);
    let beside = a + (b - a) * 0.5 + (c - a) * 1e-6;
    needles.extend([[a, b, beside], [b, c, beside], [c, a, beside]]);
    for (name, spoilt, gone) in [
        ("unwelded", unwelded, [0, 0]),
        ("doubled", doubled, [683, 0]),
        // 410 and 293 were put in; dots at one corner are each other's doubles
        ("dots", dots, [11, 692]),
        ("needles", needles, [0, 0]),
    ] {
        let m = mesh(spoilt);
        let f = m.findings();
        println!("{name}: {f:?}");
        assert_eq!([f.duplicates, f.zero_area], gone, "{name}");
        assert_eq!(f.open_edges > 0, name == "unwelded", "{name}");
        let g = grid(&m);
        assert_eq!(g.dims, truth.dims);
        let same = (g.values.iter().zip(&truth.values)).filter(|(x, y)| {
            (**x - **y).abs() <= 1 || name == "unwelded" && (**x - **y).abs() <= 8
        });
        assert_eq!(same.count(), g.values.len(), "{name}");
    }
}

#[test]
fn bodies_that_overlap_are_one() {
    let (one, d) = (sphere(R, 4), 5.0);
    let other = one.iter().map(|t| t.map(|v| v + Vec3::X * d));
    let both: Vec<Triangle> = one.iter().copied().chain(other).collect();
    let g = grid(&mesh(both));
    let (r, d) = (f64::from(R), f64::from(d));
    let lens = PI * (4.0 * r + d) * (2.0 * r - d).powi(2) / 12.0;
    let truth = 2.0 * volume(&one) - lens;
    let got = g.volume_mm3();
    println!("two balls: {got:.1} of {truth:.1} mm³");
    // beside the buried faces the depth is called too small, which costs the cubes there a part
    let inside = (0..g.values.len()).filter(|&n| g.values[n] < 0).count();
    let counted = inside as f64 * f64::from(g.spacing_mm).powi(3);
    assert!((counted / truth - 1.0).abs() < 0.01, "{counted} {truth}");
}

#[test]
fn what_is_no_solid_is_refused() {
    let whole = sphere(R, 4);
    let spoilt = |f: &dyn Fn(&mut Vec<Triangle>)| {
        let mut copy = whole.clone();
        f(&mut copy);
        Mesh::new(copy).expect_err("a refusal")
    };
    let refusal = |triangles: Vec<Triangle>| Mesh::new(triangles).expect_err("a refusal");
    assert_eq!(refusal(Vec::new()), MeshError::TooFew(0));
    assert_eq!(refusal(whole[..1].to_vec()), MeshError::TooFew(1));
    assert_eq!(refusal(vec![[Vec3::X; 3]; 50]), MeshError::TooSmall(0.0));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(spoilt(&|m| m[40][1].y = bad), MeshError::NotFinite(41));
    }
    let scaled = |s: f32| spoilt(&|m| m.iter_mut().flatten().for_each(|v| *v *= s));
    assert!(matches!(scaled(1e3), MeshError::TooLarge(_)));
    assert!(matches!(scaled(1e37), MeshError::TooLarge(_)));
    assert!(matches!(scaled(1e-3), MeshError::TooSmall(_)));
    let far = spoilt(&|m| m.iter_mut().flatten().for_each(|v| v.x += 1e6));
    assert!(matches!(far, MeshError::TooFar(_)), "{far}");
    // half of the faces look inwards
    let half = spoilt(&|m| {
        for t in m.iter_mut().filter(|t| t[0].z + t[1].z + t[2].z > 0.0) {
            t.swap(1, 2);
        }
    });
    assert_eq!(half, MeshError::Torn);
    // a sheet
    let sheet = whole.iter().map(|t| t.map(|v| v.with_z(0.0))).collect();
    assert_eq!(refusal(sheet), MeshError::Torn);
    let many = vec![[Vec3::ZERO; 3]; 2_000_001];
    assert_eq!(refusal(many), MeshError::TooMany(2_000_001));
    // a plate of a quarter of the grid's spacing
    let plate = whole
        .iter()
        .map(|t| t.map(|v| v * Vec3::new(1.0, 1.0, 5e-3)));
    let m = mesh(plate.map(|t| t.map(|v| v + Vec3::Z * 0.1)).collect());
    assert!(matches!(
        SdfGrid::new(&m, None, &one_by_one),
        Err(MeshError::Thin(_))
    ));
}

#[test]
fn the_order_of_the_layers_changes_no_bit() {
    let m = mesh(holed(&sphere(R, 4), 20.0));
    let backwards = SdfGrid::new(&m, Some(0.4), &|n, layer| {
        let mut all: Vec<_> = (0..n).rev().map(layer).collect();
        all.reverse();
        all
    });
    let forwards = SdfGrid::new(&m, Some(0.4), &one_by_one);
    assert_eq!(backwards, forwards);
}

#[test]
fn the_drill_of_triangles_is_the_drill_of_faces() {
    let drill = Tool::peg_drill();
    let point = 4.0 / libm::tanf(59f32.to_radians());
    let triangles = lathe(&[[0.0, 0.0], [4.0, point], [4.0, 40.0], [0.0, 40.0]], 256);
    let m = mesh(triangles);
    let g = Arc::new(grid(&m));
    println!(
        "drill: {:?} nodes, error {:.4} mm within 2 mm, {:.4} mm RMS on the surface",
        g.dims, g.error_mm, g.surface_rms_mm
    );
    let facets = 4.0 * (1.0 - libm::cosf(std::f32::consts::PI / 256.0));
    let mut compared = 0;
    for i in 0..60u16 {
        for j in 0..400u16 {
            let (r, z) = (0.117 * f32::from(i), 0.117 * f32::from(j) - 3.0);
            let p = Vec3::new(0.6 * r, 0.8 * r, z);
            let [sampled, exact] = [g.signed_distance(p), drill.shape.signed_distance(p)];
            if exact.abs() > 2.0 {
                continue;
            }
            compared += 1;
            // beside an edge the faces give a lower bound
            assert!(
                sampled > exact - g.error_mm - facets,
                "{p} {sampled} {exact}"
            );
            if exact <= 0.0 {
                assert!(
                    sampled < exact + g.error_mm + facets,
                    "{p} {sampled} {exact}"
                );
            }
        }
    }
    assert!(compared > 5000, "{compared}");
    let tool = Tool::meshed(["Drill", "drill"], &m, g, (1500.0, 2), [0; 3], point);
    assert!(tool.elements.len() <= MAX_ELEMENTS && tool.elements.len() > 400);
    let area: f32 = tool.elements.iter().map(|e| e.area_mm2).sum();
    assert!((f64::from(area) / m.area_mm2() - 1.0).abs() < 1e-3);
    for e in &tool.elements {
        let d = drill.shape.signed_distance(e.position);
        assert!(d.abs() < 0.06 && (e.normal.length() - 1.0).abs() < 1e-5);
        assert_eq!(e.cutting, e.position.z <= point);
    }
    let outline = tool.shape.outline();
    let widest = outline.iter().map(|[r, _]| *r).fold(0.0, f32::max);
    assert!((widest - 4.0).abs() < 0.02, "{widest}");
}

#[test]
fn the_drill_of_triangles_removes_what_the_drill_of_faces_does() {
    let faces = Tool::peg_drill();
    let point = 4.0 / libm::tanf(59f32.to_radians());
    let m = mesh(lathe(
        &[[0.0, 0.0], [4.0, point], [4.0, 40.0], [0.0, 40.0]],
        256,
    ));
    let g = Arc::new(grid(&m));
    let triangles = Tool::meshed(["Drill", "drill"], &m, g, (1500.0, 2), [0; 3], point);
    let bone = slab(DVec3::new(14.0, 14.0, 14.0), DVec3::splat(0.5), 10.3, 1.0);
    let removed = |tool: &Tool, axis: DVec3| {
        let mut cut = Cut::new(&bone);
        let mut at = Pose::from_origin_and_z(DVec3::new(7.0, 7.0, 10.4), axis);
        for _ in 0..60 {
            let before = at;
            at.translation -= axis * 0.1;
            let step = CarveStep {
                tool: 0,
                before,
                after: at,
            };
            carve(&bone, &mut cut, tool, &step, &mut |_, _| {});
        }
        Cut::mm3(bone.grid(), cut.totals().units())
    };
    for axis in [DVec3::Z, DVec3::new(0.28, 0.0, 0.96)] {
        let [got, truth] = [removed(&triangles, axis), removed(&faces, axis)];
        println!("{got:.2} mm³ by triangles, {truth:.2} by faces");
        assert!((got / truth - 1.0).abs() < 0.01, "{got} {truth}");
    }
}

#[test]
fn the_tree_agrees_with_every_triangle_by_itself() {
    let point = 4.0 / libm::tanf(59f32.to_radians());
    let drill = lathe(&[[0.0, 0.0], [4.0, point], [4.0, 40.0], [0.0, 40.0]], 90);
    for triangles in [sphere(R, 3), holed(&sphere(R, 4), 40.0), drill] {
        let tree = Bvh::new(&triangles);
        let alone: Vec<Bvh> = triangles.iter().map(|t| Bvh::new(&[*t])).collect();
        let (mut off, mut hint) = (0.0f32, 0);
        for (n, p) in common::shapes::cloud(400).enumerate() {
            let p = p * (0.3 + (n % 61) as f32 * 0.25);
            let nearest = alone.iter().map(|t| t.nearest(p, f32::MAX));
            let truth = nearest.fold(f32::MAX, f32::min);
            let (got, number) = tree.nearest_from(p, hint);
            hint = number;
            assert_eq!((got, tree.nearest(p, f32::MAX)), (truth, truth));
            assert!((tree.nearest(p, 0.5 * truth) - 0.5 * truth).abs() < 1e-6);
            let turns: f32 = alone.iter().map(|t| t.winding(p, f32::MAX)).sum();
            off = off.max((tree.winding(p, 2.0) - turns).abs());
        }
        println!(
            "{} triangles: winding number off by {off:.4}",
            triangles.len()
        );
        assert!(off < 0.05, "{off}");
    }
}
