//! The rules on random volumes against brute-force readings of them.

use super::*;
use crate::scene::dense::distance;
use glam::DVec3;
use osteon_sim_core::bone::Occupancy;

const DIMS: [usize; 3] = [17, 15, 13];

struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 33) % n
    }
}

/// A hollow kept ball (label 1) with unlabelled and foreign voids, next to another structure (2).
fn volume(seed: u64) -> (Vec<u8>, Vec<f32>) {
    let mut random = Random(seed);
    let lattice = Lattice { dims: DIMS };
    let n = DIMS.iter().product();
    let mut labels = vec![0; n];
    let mut hu = vec![0.0; n];
    for at in 0..n {
        let c = lattice.coord(at).map(|v| v as f64);
        let r = DVec3::from_array(c).distance(DVec3::new(6.0, 7.0, 6.0));
        if (2.2..4.6).contains(&r) {
            labels[at] = 1;
        } else if c[0] > 10.5 && c[0] < 14.0 {
            labels[at] = 2;
        }
        // a hole in the wall now and then, and specks of a third structure
        match random.below(60) {
            0 => labels[at] = 0,
            1 => labels[at] = 3,
            _ => {}
        }
        hu[at] = random.below(900) as f32 - 300.0;
    }
    (labels, hu)
}

fn coords(dims: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..dims[2])
        .flat_map(move |k| (0..dims[1]).flat_map(move |j| (0..dims[0]).map(move |i| [i, j, k])))
}

/// Enclosed voxels by repeated relaxation over the whole lattice: slow and independent.
fn enclosed(labels: &[u8]) -> Vec<bool> {
    let lattice = Lattice { dims: DIMS };
    let mut outside = vec![false; labels.len()];
    loop {
        let mut changed = false;
        for c in coords(DIMS) {
            let at = lattice.index(c);
            if outside[at] || labels[at] == 1 {
                continue;
            }
            let on_border = (0..3).any(|a| c[a] == 0 || c[a] + 1 == DIMS[a]);
            let open = (0..3).any(|a| {
                [c[a].wrapping_sub(1), c[a] + 1].into_iter().any(|v| {
                    let mut d = c;
                    d[a] = v;
                    v < DIMS[a] && outside[lattice.index(d)]
                })
            });
            if on_border || open {
                outside[at] = true;
                changed = true;
            }
        }
        if !changed {
            return (0..labels.len())
                .map(|at| !outside[at] && labels[at] != 1)
                .collect();
        }
    }
}

fn beside_kept(labels: &[u8], c: [usize; 3]) -> bool {
    let lattice = Lattice { dims: DIMS };
    coords([3, 3, 3]).any(|d| {
        let n: [usize; 3] = core::array::from_fn(|a| (c[a] + d[a]).wrapping_sub(1));
        (0..3).all(|a| n[a] < DIMS[a]) && labels[lattice.index(n)] == 1
    })
}

#[test]
fn each_voxel_gets_what_the_rules_say() {
    let lattice = Lattice { dims: DIMS };
    let keep = Keep::new(&[1]);
    let mut filled = 0;
    for seed in 0..20 {
        let (before, hu) = volume(seed);
        let voids = enclosed(&before);
        let mut solid = before.clone();
        for (l, &void) in solid.iter_mut().zip(&voids) {
            if void && *l == 0 {
                *l = 1;
                filled += 1;
            }
        }
        let mut labels = before.clone();
        let phi = segment(lattice, &hu, &mut labels, &keep, 150.0);
        for c in coords(DIMS) {
            let at = lattice.index(c);
            let above = hu[at] - 150.0;
            match solid[at] {
                1 => {
                    assert!(phi[at] > 0.0 && labels[at] == 1, "seed {seed}");
                    assert!(above < FLOOR_HU || (phi[at] - above).abs() < 1e-6);
                }
                0 if beside_kept(&solid, c) => {
                    assert!(
                        (phi[at] - above).abs() < 1e-6 && labels[at] == 1,
                        "seed {seed}"
                    );
                }
                0 => assert!(phi[at] < 0.0 && labels[at] == 0, "seed {seed}"),
                other => assert!(phi[at] <= -CEILING_HU && labels[at] == other, "seed {seed}"),
            }
        }
    }
    assert!(filled > 100, "the voids were there: {filled}");
}

#[test]
fn nothing_of_an_excluded_structure_can_ever_be_removed() {
    let keep = Keep::new(&[1]);
    let mut beside = 0;
    for seed in 0..10 {
        let grid = Grid::new(DIMS, DVec3::new(0.78, 0.78, 1.0)).expect("valid");
        let (mut labels, hu) = volume(seed);
        let phi = segment(Lattice::of(&grid), &hu, &mut labels, &keep, 150.0);
        let plain = distance(&grid, &phi).expect("lengths fit");
        let mut solid = plain.clone();
        clear_excluded(&grid, &mut solid, &labels, &keep);
        let occupancy = Occupancy::new(&grid);
        let excluded: Vec<usize> = (0..labels.len())
            .filter(|&at| keep.excludes(labels[at]))
            .collect();
        for &at in &excluded {
            beside += usize::from(occupancy.units(grid.quantise(plain[at])) > 0);
            assert_eq!(occupancy.units(grid.quantise(solid[at])), 0, "seed {seed}");
        }
        // by its definition: the lesser of the plain distance and that to the nearest ball
        let lattice = Lattice::of(&grid);
        let place = |at: usize| {
            let [i, j, k] = lattice.coord(at);
            grid.centre(i, j, k).as_vec3()
        };
        for at in (0..labels.len()).step_by(7) {
            let nearest = excluded
                .iter()
                .map(|&e| place(e).distance(place(at)))
                .fold(f32::INFINITY, f32::min);
            let expected = plain[at].min(nearest - free_radius_mm(&grid));
            assert!((solid[at] - expected).abs() < 1e-5, "seed {seed}");
        }
    }
    assert!(beside > 50, "bones touched: {beside}");
}

#[test]
fn the_rim_puts_the_surface_where_the_partial_volume_says() {
    // a plane at x = 6.3: 700 HU inside, -50 outside, the sixth voxel (5.5 to 6.5) in parts
    let grid = Grid::new([12, 8, 8], DVec3::ONE).expect("valid");
    let part = |i: usize| (6.3 - (i as f32 - 0.5)).clamp(0.0, 1.0);
    let lattice = Lattice::of(&grid);
    let hu: Vec<f32> = (0..grid.len())
        .map(|at| -50.0 + 750.0 * part(lattice.coord(at)[0]))
        .collect();
    // the labels stop short of the partly filled voxel; inside there is marrow
    let mut labels: Vec<u8> = (0..grid.len())
        .map(|at| u8::from(lattice.coord(at)[0] < 6))
        .collect();
    let mut marrow = hu.clone();
    for at in (0..grid.len()).filter(|&at| lattice.coord(at)[0] == 3) {
        marrow[at] = -60.0;
    }
    let keep = Keep::new(&[1]);
    let phi = segment(lattice, &marrow, &mut labels, &keep, 325.0);
    let solid = distance(&grid, &phi).expect("lengths fit");
    for at in (0..grid.len()).filter(|&at| (5..8).contains(&lattice.coord(at)[0])) {
        let x = lattice.coord(at)[0] as f32;
        // half-maximum threshold: exact but for the ramp's shape within a voxel
        assert!((solid[at] - (6.3 - x)).abs() < 0.12, "x {x}: {}", solid[at]);
    }
    assert!(
        (0..grid.len())
            .filter(|&at| lattice.coord(at)[0] <= 5)
            .all(|at| solid[at] > 0.5)
    );
}

#[test]
fn labels_beyond_a_byte_and_fractions_are_refused() {
    let volume = |values: Vec<f32>| Volume {
        grid: Grid::new([values.len(), 1, 1], DVec3::ONE).expect("valid"),
        lps_from_bone: osteon_sim_core::pose::Pose::IDENTITY,
        values,
    };
    let path = Path::new("labels.nii");
    let (bytes, present) = label_bytes(path, &volume(vec![0.0, 255.0, 3.0, 3.0])).expect("fine");
    assert_eq!(bytes, [0, 255, 3, 3]);
    assert_eq!(present.into_iter().collect::<Vec<_>>(), [(3, 2), (255, 1)]);
    for bad in [256.0, -1.0, 0.5, f32::NAN, f32::INFINITY] {
        let error = label_bytes(path, &volume(vec![0.0, bad])).expect_err("refused");
        assert!(error.to_string().starts_with("labels.nii: a label of"));
    }
}
