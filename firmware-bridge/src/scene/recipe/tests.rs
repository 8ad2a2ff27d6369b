//! Parts, boxes, cartilage and walls planted in small volumes.

use super::super::tests::quiet;
use super::*;
use crate::scene::cartilage::lay;
use crate::scene::dense::{Dense, distance};
use crate::scene::{Scene, SceneArgs};
use glam::DQuat;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::tissue::Tissue;

const N: usize = 40;

/// Boxes of bone (800 HU) in air, voxels of 1 mm; a NIfTI file and a plan far from them.
fn boxes(dir: &Path, parts: &[([usize; 3], [usize; 3])]) -> SceneArgs {
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, b: &[u8]| bytes[at..at + b.len()].copy_from_slice(b);
    put(0, &348_i32.to_le_bytes());
    for (n, d) in [3, 40, 40, 40, 1, 1, 1, 1_i16].into_iter().enumerate() {
        put(40 + 2 * n, &d.to_le_bytes());
    }
    put(70, &4_i16.to_le_bytes());
    for n in 0..4 {
        put(76 + 4 * n, &1.0_f32.to_le_bytes());
    }
    put(108, &352.0_f32.to_le_bytes());
    put(254, &1_i16.to_le_bytes());
    // sform: LPS is the lattice
    for (row, v) in [-1.0_f32, -1.0, 1.0].into_iter().enumerate() {
        put(280 + 16 * row + 4 * row, &v.to_le_bytes());
    }
    put(344, b"n+1\0");
    for at in 0..N * N * N {
        let c = [at % N, at / N % N, at / (N * N)];
        let inside =
            |(lo, hi): &([usize; 3], [usize; 3])| (0..3).all(|a| (lo[a]..hi[a]).contains(&c[a]));
        let hu: i16 = if parts.iter().any(inside) { 800 } else { -900 };
        bytes.extend(hu.to_le_bytes());
    }
    std::fs::write(dir.join("ct.nii"), bytes).expect("written");
    SceneArgs {
        bone: Some(dir.join("ct.nii")),
        recipe: Recipe {
            lps_from_plan: Some(Pose::new(DQuat::IDENTITY, DVec3::splat(20.0))),
            ..Recipe::default()
        },
        ..SceneArgs::default()
    }
}

const BIG: ([usize; 3], [usize; 3]) = ([5, 5, 5], [20, 20, 20]);
// touches the big one by an edge only
const BY_EDGE: ([usize; 3], [usize; 3]) = ([20, 20, 5], [30, 30, 15]);
const SPECK: ([usize; 3], [usize; 3]) = ([34, 34, 34], [36, 36, 36]);

fn with(args: &SceneArgs, change: impl Fn(&mut Recipe)) -> SceneArgs {
    let mut args = args.clone();
    change(&mut args.recipe);
    args
}

/// Solid voxels' volume, mm³, about.
fn volume(scene: &Scene) -> f64 {
    scene.summary.solid_mm3
}

#[test]
fn parts_touch_by_faces_and_fragments_are_counted() {
    let dir = tempfile::tempdir().expect("a folder");
    let args = boxes(dir.path(), &[BIG, BY_EDGE, SPECK]);
    let all = quiet(&args).expect("a scene");
    assert_eq!(all.summary.parts.found, 0, "not looked for");
    let largest = quiet(&with(&args, |r| r.part = Part::Largest)).expect("a scene");
    assert_eq!(largest.summary.parts.found, 3);
    assert!((largest.summary.parts.left_out_mm3 - 1008.0).abs() < 1e-9);
    // a box's surface lies half way between the samples: about its own volume
    assert!(
        (volume(&largest) - 3375.0).abs() < 0.12 * 3375.0,
        "{}",
        volume(&largest)
    );
    let seed = quiet(&with(&args, |r| r.part = Part::Seed([25.0, 25.0, 10.0]))).expect("a scene");
    assert!(
        (volume(&seed) - 1000.0).abs() < 0.15 * 1000.0,
        "{}",
        volume(&seed)
    );
    let clean = quiet(&with(&args, |r| r.fragments_mm3 = 50.0)).expect("a scene");
    assert_eq!(clean.summary.parts.fragments, 1);
    assert!((clean.summary.parts.fragments_mm3 - 8.0).abs() < 1e-9);
    let error = quiet(&with(&args, |r| r.part = Part::Seed([1.0, 1.0, 38.0]))).expect_err("air");
    assert!(
        error
            .to_string()
            .contains("no bone within 3 mm of the seed"),
        "{error}"
    );
}

#[test]
fn a_box_to_keep_is_in_patient_coordinates() {
    let dir = tempfile::tempdir().expect("a folder");
    let args = boxes(dir.path(), &[BIG, SPECK]);
    let speck = [[33.0, 33.0, 33.0], [37.0, 37.0, 37.0]];
    let kept = quiet(&with(&args, |r| r.crop_mm = Some(speck))).expect("a scene");
    assert!(volume(&kept) < 20.0);
    let far = [[80.0, 0.0, 0.0], [90.0, 9.0, 9.0]];
    let error = quiet(&with(&args, |r| r.crop_mm = Some(far))).expect_err("nothing there");
    assert!(error.to_string().contains("holds no voxel"), "{error}");
}

#[test]
fn a_calibration_keeps_the_density_it_means() {
    let c = Calibration {
        slope: 0.0008,
        offset: 0.02,
        source: "a phantom".to_owned(),
    };
    for hu in [0.0_f32, 250.0, 1500.0] {
        let means = 0.0008 * f64::from(hu) + 0.02;
        let by_law = osteon_sim_core::tissue::density_g_cm3(f64::from(c.standard_hu(hu)));
        assert!((by_law - means.max(0.05)).abs() < 1e-6, "{hu}");
    }
    let bad = Recipe {
        density: Some(Calibration {
            source: " ".to_owned(),
            ..c
        }),
        ..Recipe::default()
    };
    assert!(
        bad.check(Path::new("s"))
            .expect_err("no source")
            .to_string()
            .contains("source")
    );
}

/// A slab with a hollow joint face of 34 mm radius; cartilage is as thick as asked over the middle.
#[test]
fn cartilage_is_as_thick_as_asked_and_ends_at_the_rim() {
    let grid = Grid::new([60, 60, 40], DVec3::splat(0.7)).expect("a grid");
    let middle = DVec3::new(20.65, 20.65, 0.0);
    let lattice = Lattice::of(&grid);
    let phi: Vec<f32> = (0..grid.len())
        .map(|at| {
            let [i, j, k] = lattice.coord(at);
            let p = grid.centre(i, j, k) - middle;
            let column = 15.0 - p.truncate().length();
            let face = p.distance(DVec3::Z * (34.0 + 12.0)) - 34.0;
            #[expect(clippy::cast_possible_truncation, reason = "lengths in mm")]
            let v = column.min(face).min(p.z - 2.0) as f32;
            v
        })
        .collect();
    let mut dense = Dense {
        grid,
        lps_from_bone: Pose::IDENTITY,
        density_hu: vec![300; grid.len()],
        solid_mm: distance(&grid, &phi).expect("distances"),
        class: vec![Tissue::Cancellous as u8; grid.len()],
        label: vec![1; grid.len()],
    };
    let bone_from_plan = Pose::new(DQuat::IDENTITY, middle + DVec3::Z * 12.0);
    let wanted = Cartilage {
        thickness_mm: 1.8,
        radius_mm: 20.0,
    };
    let mm3 = lay(&mut dense, &bone_from_plan, wanted).expect("laid");
    // a sheet of 1.8 mm on a disc of about 14 mm, thinner at its rim
    let disc = core::f64::consts::PI * 14.0 * 14.0 * 1.8;
    assert!((0.7 * disc..1.15 * disc).contains(&mm3), "{mm3} {disc}");
    let bone = dense.into_bone().expect("a bone");
    let cut = osteon_sim_core::cut::Cut::new(&bone);
    let sampler = osteon_sim_core::sample::Sampler::new(&bone, &cut);
    for (x, y) in disc_points() {
        let from = middle + DVec3::new(x, y, 30.0);
        let t = osteon_sim_core::planning::face::first_surface(
            &|p| f64::from(sampler.depth(p)),
            from,
            -DVec3::Z,
            40.0,
        )
        .expect("a surface");
        // from the bone's face along the sphere's radius
        let p = from - DVec3::Z * t - middle;
        let thick = 34.0 - p.distance(DVec3::Z * 46.0);
        assert!((thick - 1.8).abs() < 0.08, "{x} {y}: {thick}");
    }
}

fn disc_points() -> impl Iterator<Item = (f64, f64)> {
    osteon_sim_core::planning::face::disc(9.0, 3.0)
}
