//! From a text CT to a bone: a planted ball, options that do not fit, chunks on all cores.

use crate::scene::dense::Dense;
use crate::scene::{Scene, SceneArgs, SceneError, load};
use glam::DVec3;
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use std::fmt::Write as _;
use std::path::Path;

const RADIUS: f64 = 9.0;
const CENTRE: DVec3 = DVec3::new(-31.3, 20.9, 104.2);
const SPACING: DVec3 = DVec3::new(0.47, 0.47, 1.0);

/// A ball of 900 HU in 0 HU, softened over a voxel as a scanner does; only what is above `least`.
fn ball(dir: &Path, least: f64) -> SceneArgs {
    let mut text = String::from("x,y,z,density\n");
    for k in 0..26 {
        for j in 0..50 {
            for i in 0..50 {
                let at = DVec3::new(f64::from(i), f64::from(j), f64::from(k)) * SPACING;
                let p = (CENTRE - DVec3::splat(12.0) + at) * 1000.0;
                let p = p.round() / 1000.0;
                let hu = 450.0 + 450.0 * ((RADIUS - p.distance(CENTRE)) / 0.7).tanh();
                if hu > least {
                    writeln!(text, "{},{},{},{hu:.0}", p.x, p.y, p.z).expect("a string");
                }
            }
        }
    }
    std::fs::write(dir.join("ball.csv"), text).expect("written");
    let [x, y, z] = (CENTRE + DVec3::Z * RADIUS).to_array();
    let plan =
        format!(r#"{{"glenoid_centre": [{x}, {y}, {z}], "glenoid_normal_outward": [0, 0, 1]}}"#);
    std::fs::write(dir.join("plan.json"), plan).expect("written");
    SceneArgs {
        bone: Some(dir.join("ball.csv")),
        pose: Some(dir.join("plan.json")),
        threshold: 450.0,
        ..SceneArgs::default()
    }
}

fn quiet(args: &SceneArgs) -> Result<Scene, SceneError> {
    load(args, &mut |_, _| ())
}

#[test]
fn a_ball_is_found_whether_the_file_holds_all_voxels_or_only_its_own() {
    let dir = tempfile::tempdir().expect("a folder");
    let planted = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    let volume = |least: f64, voxel_mm: Option<f64>| {
        let mut args = ball(dir.path(), least);
        args.voxel_mm = voxel_mm;
        let scene = quiet(&args).expect("a scene");
        let top = scene
            .bone
            .lps_from_bone()
            .point(scene.bone_from_plan.translation);
        assert!(top.distance(CENTRE + DVec3::Z * RADIUS) < 1e-6);
        let middle = scene.bone_from_plan.translation - DVec3::Z * RADIUS;
        let at = |p: DVec3| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "inside the lattice"
            )]
            let c = (p / scene.bone.grid().spacing_mm)
                .round()
                .to_array()
                .map(|v| v as usize);
            scene.bone.locate(c).map_or(-i16::MAX, |(chunk, voxel)| {
                scene.bone.chunk(chunk).solid[voxel]
            })
        };
        // solid just inside, empty just outside, on all six sides
        for axis in [
            DVec3::X,
            DVec3::Y,
            DVec3::Z,
            -DVec3::X,
            -DVec3::Y,
            -DVec3::Z,
        ] {
            assert!(at(middle + axis * (RADIUS - 1.1)) > 0, "{axis}");
            assert!(at(middle + axis * (RADIUS + 1.1)) < 0, "{axis}");
        }
        (
            scene.summary.solid_mm3 / planted,
            scene.summary.absent_voxels,
        )
    };
    let (all, absent) = volume(-1.0, None);
    assert!((all - 1.0).abs() < 0.02 && absent == 0, "{all} {absent}");
    let (cubes, _) = volume(-1.0, Some(0.47));
    assert!((cubes - 1.0).abs() < 0.02, "{cubes}");
    // the voxel outside the outermost one is known to be below the threshold and no more
    let (own, absent) = volume(450.0, None);
    assert!((own - 1.0).abs() < 0.08 && absent > 1000, "{own} {absent}");
}

#[test]
fn options_that_do_not_fit_a_text_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let args = ball(dir.path(), 450.0);
    let refused = |change: &dyn Fn(&mut SceneArgs)| {
        let mut args = args.clone();
        change(&mut args);
        let error = quiet(&args)
            .map(|s| s.summary)
            .expect_err("must be refused");
        error.to_string()
    };
    let low = refused(&|a| a.threshold = -100.0);
    assert!(
        low.contains("--threshold -100 HU") && low.contains("ball.csv leaves out count as 0 HU"),
        "{low}"
    );
    assert!(refused(&|a| a.threshold = 950.0).contains("ball.csv: no bone above 950 HU"));
    assert!(refused(&|a| a.pose = None).contains("ball.csv: a CT needs a plan"));
    std::fs::write(dir.path().join("bad.txt"), "0 0 0 1\n0 0 one 1\n").expect("written");
    let bad = refused(&|a| a.bone = Some(dir.path().join("bad.txt")));
    assert!(bad.contains("bad.txt: line 2: `one` is no number"), "{bad}");
}

/// Everything that a bone shows.
fn assert_same(a: &Bone, b: &Bone) {
    assert_eq!(a.chunk_count(), b.chunk_count());
    for chunk in 0..a.chunk_count() {
        assert_eq!(a.chunk_coord(chunk), b.chunk_coord(chunk));
        assert_eq!(a.bony_bricks(chunk), b.bony_bricks(chunk));
        let (p, q) = (a.chunk(chunk), b.chunk(chunk));
        assert_eq!(p.density_hu, q.density_hu);
        assert_eq!((p.solid, p.class, p.label), (q.solid, q.class, q.label));
    }
    // the rest, private parts too
    assert_eq!(format!("{a:?}"), format!("{b:?}"));
}

#[test]
fn chunks_made_on_all_cores_are_those_of_one_core() {
    for (n, dims) in [[70, 65, 40], [33, 1, 97], [32, 32, 32], [400, 300, 35]]
        .into_iter()
        .enumerate()
    {
        let grid = Grid::new(dims, DVec3::new(0.5, 0.4, 0.9)).expect("a grid");
        let wave = |at: usize, f: f64| ((at * (n + 3)) as f64 * f).sin();
        let count = grid.len();
        #[expect(clippy::cast_possible_truncation, reason = "test values")]
        let dense = Dense {
            grid,
            lps_from_bone: Pose::IDENTITY,
            density_hu: (0..count).map(|v| (wave(v, 0.1) * 3e4) as i16).collect(),
            // bone in some chunks only
            solid_mm: (0..count)
                .map(|v| (9.0 * (v as f64 * 9.0 / count as f64).sin() + wave(v, 0.3) - 8.0) as f32)
                .collect(),
            class: (0..count).map(|v| (v % 5) as u8).collect(),
            label: (0..count).map(|v| (v % 251) as u8).collect(),
        };
        let arrays = DenseBone {
            density_hu: &dense.density_hu,
            solid_mm: &dense.solid_mm,
            class: &dense.class,
            label: &dense.label,
        };
        let serial = Bone::from_dense(grid, dense.lps_from_bone, &arrays).expect("a bone");
        let parallel = dense.clone().into_bone().expect("a bone");
        assert!(serial.chunk_count() > 0);
        assert_same(&serial, &parallel);
    }
}
