#![expect(clippy::print_stdout, reason = "the errors found are worth reading")]

use super::*;

const SPACINGS: [DVec3; 3] = [
    DVec3::splat(1.0),
    DVec3::splat(0.5),
    DVec3::new(0.78, 0.78, 1.0),
];

fn sample(grid: &Grid, f: impl Fn(DVec3) -> f64) -> Vec<f32> {
    let mut phi = Vec::with_capacity(grid.len());
    for k in 0..grid.dims[2] {
        for j in 0..grid.dims[1] {
            for i in 0..grid.dims[0] {
                phi.push(f(grid.centre(i, j, k)) as f32);
            }
        }
    }
    phi
}

/// A lattice whose box has edges of `mm`, and its middle.
fn lattice(spacing: DVec3, mm: f64) -> (Grid, DVec3) {
    let dims = (DVec3::splat(mm) / spacing).ceil().to_array();
    let grid = Grid::new(dims.map(|n| n as usize + 1), spacing).expect("valid");
    (grid, DVec3::splat(0.5 * mm) + 0.13 * spacing)
}

struct Error {
    rms: f64,
    max: f64,
    surface_rms: f64,
}

/// Distances in the band, and zero crossings on the lattice edges, against `truth` (mm,
/// positive inside), in units of the largest spacing. Voxels nearer than the reach to the
/// lattice's border are left out: the surface outside it is not known.
fn error(grid: &Grid, distance: &[f32], truth: impl Fn(DVec3) -> f64) -> Error {
    let margin = (REACH_BANDS * grid.band_mm() / grid.spacing_mm.min_element()).ceil() as usize;
    let (mut sum, mut count, mut max) = (0.0, 0.0, 0.0f64);
    let (mut surface, mut crossings) = (0.0, 0.0);
    let inner = |a: usize| margin..grid.dims[a] - margin;
    for (k, j, i) in
        inner(2).flat_map(|k| inner(1).flat_map(move |j| inner(0).map(move |i| (k, j, i))))
    {
        let p = grid.centre(i, j, k);
        let d = f64::from(distance[grid.dense_index(i, j, k)]);
        if truth(p).abs() <= grid.band_mm() {
            let e = (d - truth(p)).abs();
            (sum, count, max) = (sum + e * e, count + 1.0, max.max(e));
        }
        for step in [[1, 0, 0], [0, 1, 0], [0, 0, 1]] {
            let q = grid.centre(i + step[0], j + step[1], k + step[2]);
            let next = grid.dense_index(i + step[0], j + step[1], k + step[2]);
            let e = f64::from(distance[next]);
            if (d > 0.0) != (e > 0.0) {
                surface += truth(p.lerp(q, d / (d - e))).powi(2);
                crossings += 1.0;
            }
        }
    }
    let h = grid.spacing_mm.max_element();
    Error {
        rms: (sum / f64::max(count, 1.0)).sqrt() / h,
        max: max / h,
        surface_rms: (surface / f64::max(crossings, 1.0)).sqrt() / h,
    }
}

#[test]
fn spheres_lie_where_they_were_planted() {
    for spacing in SPACINGS {
        for radius in [6.0, 9.0, 20.0] {
            let (grid, centre) = lattice(spacing, 2.0 * radius + 12.0);
            let truth = |p: DVec3| radius - (p - centre).length();
            // another field with the same zero surface: curved across it, as a CT's edge is
            for (name, phi) in [
                ("distance", sample(&grid, truth)),
                (
                    "erf-like",
                    sample(&grid, |p| (truth(p) / 1.5).tanh() * 400.0),
                ),
            ] {
                let distance = signed_distance(&grid, &phi).expect("lengths fit");
                let e = error(&grid, &distance, truth);
                println!(
                    "sphere R={radius} h={spacing} {name}: band rms {:.4} h, max {:.4} h, \
                     surface rms {:.4} h",
                    e.rms, e.max, e.surface_rms
                );
                // chords: h²/(8 R) along an edge, up to three times that across a cell; the
                // rest is for the field's own curvature
                let chord = spacing.max_element() / radius;
                assert!(e.rms < 0.2 * chord + 0.002 && e.max < 0.4 * chord + 0.005);
                assert!(e.surface_rms < 0.15 * chord + 0.002);
            }
        }
    }
}

#[test]
fn oblique_planes_are_exact_at_any_spacing() {
    let normals = [
        DVec3::new(0.8, 0.6, 0.0),
        DVec3::new(0.6, 0.0, 0.8),
        DVec3::new(2.0, -1.0, 2.0) / 3.0,
        DVec3::new(-6.0, 2.0, 3.0) / 7.0,
    ];
    for spacing in SPACINGS {
        let (grid, centre) = lattice(spacing, 24.0);
        for normal in normals {
            let truth = |p: DVec3| (p - centre).dot(normal);
            let phi = sample(&grid, |p| 370.0 * truth(p));
            let distance = signed_distance(&grid, &phi).expect("lengths fit");
            let e = error(&grid, &distance, truth);
            println!("plane {normal} h={spacing}: max {:.2e} h", e.max);
            assert!(e.max < 2e-5 && e.surface_rms < 2e-5);
        }
    }
}

/// White noise crosses every edge kind and every ambiguous face.
fn noise(grid: &Grid, mut seed: u32) -> Vec<f32> {
    (0..grid.len())
        .map(|_| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 16_777_216.0 - 0.6
        })
        .collect()
}

#[test]
fn neighbours_never_differ_by_more_than_their_spacing() {
    let grid = Grid::new([21, 19, 17], DVec3::new(0.78, 0.6, 1.0)).expect("valid");
    let distance = signed_distance(&grid, &noise(&grid, 7)).expect("lengths fit");
    for k in 0..16 {
        for j in 0..18 {
            for i in 0..20 {
                let d = distance[grid.dense_index(i, j, k)];
                let next = [
                    (distance[grid.dense_index(i + 1, j, k)], 0.78),
                    (distance[grid.dense_index(i, j + 1, k)], 0.6),
                    (distance[grid.dense_index(i, j, k + 1)], 1.0),
                ];
                assert!(next.iter().all(|(n, h)| (n - d).abs() <= h + 1e-5));
            }
        }
    }
}

#[test]
fn every_crossing_of_an_edge_is_on_the_surface() {
    let grid = Grid::new([9, 9, 9], DVec3::ONE).expect("valid");
    let phi = noise(&grid, 3);
    let distance = signed_distance(&grid, &phi).expect("lengths fit");
    for k in 0..9 {
        for j in 0..9 {
            for i in 0..8 {
                let at = grid.dense_index(i, j, k);
                let (a, b) = (phi[at], phi[at + 1]);
                assert_eq!(distance[at] > 0.0, a > 0.0);
                if (a > 0.0) != (b > 0.0) {
                    let t = a / (a - b);
                    assert!(distance[at].abs() <= t + 1e-5);
                    assert!(distance[at + 1].abs() <= 1.0 - t + 1e-5);
                }
            }
        }
    }
}

#[test]
fn layers_apart_are_the_same_bits_as_together() {
    let grid = Grid::new([14, 13, 23], DVec3::new(0.5, 0.7, 0.9)).expect("valid");
    let phi = noise(&grid, 11);
    let whole = signed_distance(&grid, &phi).expect("lengths fit");
    let reach = REACH_BANDS * grid.band_mm();
    let mut parts = Vec::new();
    for layers in [0..5, 5..6, 6..19, 19..23] {
        let mut part = vec![0.0; layers.len() * 14 * 13];
        signed_distance_layers(&grid, &phi, layers, reach, &mut part).expect("lengths fit");
        parts.extend(part);
    }
    assert!(
        whole
            .iter()
            .zip(&parts)
            .all(|(a, b)| a.to_bits() == b.to_bits())
    );
}

#[test]
fn nonsense_gives_finite_distances_or_an_error() {
    let grid = Grid::new([4, 4, 4], DVec3::ONE).expect("valid");
    assert!(signed_distance(&grid, &[1.0; 63]).is_err());
    let mut phi = vec![f32::NAN; 64];
    phi[21] = f32::INFINITY;
    phi[22] = f32::NEG_INFINITY;
    phi[42] = f32::MAX;
    let distance = signed_distance(&grid, &phi).expect("lengths fit");
    assert!(distance.iter().all(|d| d.is_finite()));
    assert!(distance[21] > 0.0 && distance[22] < 0.0);
    let thin = Grid::new([1, 4, 1], DVec3::ONE).expect("valid");
    let flat = signed_distance(&thin, &[1.0; 4]).expect("lengths fit");
    assert!(flat.iter().all(|&d| d > 1.0));
}
