//! The phantom against what its documentation promises.

use super::*;
use crate::scene::load;
use crate::scene::resample::trilinear;

fn fields(voxel_mm: f64, seed: u64) -> Dense {
    let grid = grid(voxel_mm).expect("valid");
    let shape = Scapula::default();
    let solid = distance(&grid, &field(&grid, &shape)).expect("lengths fit");
    tissues(grid, (&shape, 1.0), solid, seed)
}

/// Dense index of the voxel nearest to `p` (phantom frame, mm).
fn voxel(grid: &Grid, p: DVec3) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "inside the box"
    )]
    let at = ((p - BOX.0) / grid.spacing_mm)
        .round()
        .to_array()
        .map(|v| v as usize);
    Lattice::of(grid).index(at)
}

#[test]
fn culling_changes_no_value_near_the_surface() {
    let grid = grid(1.5).expect("valid");
    let shape = Scapula::default();
    let culled = field(&grid, &shape);
    let lattice = Lattice::of(&grid);
    let mut near = 0;
    for (at, &value) in culled.iter().enumerate() {
        let [i, j, k] = lattice.coord(at);
        let whole = narrow(shape.value(BOX.0 + grid.centre(i, j, k)));
        assert_eq!(value > 0.0, whole > 0.0);
        if f64::from(whole.abs()) < grid.band_mm() {
            assert_eq!(value.to_bits(), whole.to_bits());
            near += 1;
        }
    }
    assert!(near > 10_000);
}

#[test]
fn the_implicit_function_is_no_steeper_than_it_says_and_stays_inside_its_box() {
    let shape = Scapula::default();
    let span = BOX.1 - BOX.0;
    for n in 0..200_000_u32 {
        let unit = |axis: f64| 0.5 + 0.5 * random([f64::from(n), axis, 0.0], 5);
        let mut p = BOX.0 + span * DVec3::new(unit(1.0), unit(2.0), unit(3.0));
        assert!(shape.gradient(p).length() < shape::LIPSCHITZ, "{p}");
        // onto a side of the box
        let axis = n as usize % 3;
        p[axis] = if n % 2 == 0 { BOX.0[axis] } else { BOX.1[axis] };
        assert!(shape.value(p) < -3.0, "{p}");
    }
}

#[test]
fn the_face_is_a_hollow_sphere_with_its_layers_in_order() {
    let dense = fields(0.4, 1);
    let centre = DVec3::Z * shape::FACE_RADIUS_MM;
    for (x, y) in [
        (0.0, 0.0),
        (9.0, 3.0),
        (-8.0, -7.0),
        (2.0, 13.0),
        (-3.0, -14.0),
    ] {
        let root = (shape::FACE_RADIUS_MM.powi(2) - x * x - y * y).sqrt();
        let on_face = DVec3::new(x, y, shape::FACE_RADIUS_MM - root);
        let distance = trilinear(&dense.grid, &dense.solid_mm, on_face - BOX.0);
        assert!(distance.abs() < 0.02, "({x}, {y}): {distance}");
        let inward = (on_face - centre) / shape::FACE_RADIUS_MM;
        for (depth, tissue) in [
            (0.4, Tissue::Cartilage),
            (CARTILAGE_MM - 0.4, Tissue::Cartilage),
            (CARTILAGE_MM + 0.4, Tissue::Subchondral),
            (CARTILAGE_MM + PLATE_MM - 0.4, Tissue::Subchondral),
            (CARTILAGE_MM + PLATE_MM + 0.4, Tissue::Cancellous),
        ] {
            let at = voxel(&dense.grid, on_face + inward * depth);
            assert_eq!(dense.class[at], tissue as u8, "({x}, {y}) depth {depth}");
        }
    }
    // side of the head, away from the joint
    let side = voxel(&dense.grid, DVec3::new(10.6, 0.0, -9.0));
    assert!(dense.solid_mm[side] > 0.0 && dense.class[side] == Tissue::Cortical as u8);
}

#[test]
fn the_vault_holds_the_peg_hole_and_the_approach_is_free() {
    let shape = Scapula::default();
    for n in 0..64 {
        let (sin, cos) = (f64::from(n) * 0.0982).sin_cos();
        for along in 0..=18 {
            // 3 mm of bone around a hole of 8 mm in diameter and 18 mm deep
            let p = DVec3::new(7.0 * cos, 7.0 * sin, -f64::from(along).max(0.1));
            assert!(shape.value(p) > 0.0, "{p}");
        }
        assert!(shape.value(DVec3::Z * -21.0) > 0.0);
        for along in 6..=40 {
            for radius in [4.0, 10.0, 18.0, 20.0] {
                let p = DVec3::new(radius * cos, radius * sin, f64::from(along));
                assert!(shape.value(p) < -0.5, "{p}");
            }
        }
    }
}

#[test]
fn the_seed_changes_the_texture_and_nothing_else() {
    let (a, b, c) = (fields(1.0, 1), fields(1.0, 1), fields(1.0, 2));
    assert_eq!(a.density_hu, b.density_hu);
    assert_ne!(a.density_hu, c.density_hu);
    assert_eq!(a.solid_mm, c.solid_mm);
    assert_eq!(a.class, c.class);
}

#[test]
fn the_spongiosa_has_its_mean_density_and_a_band_limited_texture() {
    let sample = |p: DVec3| noise(p / 3.0, 9);
    let (mut sum, mut squares, mut near, mut far) = (0.0, 0.0, 0.0, 0.0);
    let count = 20_000;
    for n in 0..count {
        let p = 400.0 * DVec3::new(0.0, 1.0, 2.0).map(|a| random([f64::from(n), a, 1.0], 3));
        let v = sample(p);
        sum += v;
        squares += v * v;
        near += v * sample(p + DVec3::X * 0.3);
        far += v * sample(p + DVec3::X * 9.0);
    }
    let count = f64::from(count);
    assert!((sum / count).abs() < 0.02);
    assert!(squares / count > 0.05);
    assert!(
        near / squares > 0.95,
        "smooth below its shortest wavelength"
    );
    assert!((far / squares).abs() < 0.05, "free of its own past");
}

#[test]
fn the_scene_is_the_same_bone_at_any_voxel_size_in_a_right_handed_patient_frame() {
    let at = |voxel_mm| {
        let args = SceneArgs {
            voxel_mm: Some(voxel_mm),
            ..SceneArgs::default()
        };
        load(&args, &mut |_, _| ()).expect("a scene")
    };
    let (coarse, fine) = (at(1.2), at(0.6));
    let ratio = coarse.bone.solid_mm3() / fine.bone.solid_mm3();
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    for scene in [&coarse, &fine] {
        let error = scene.summary.resample_error.expect("measured");
        assert!(error.surface_rms_mm < 0.06, "{error:?}");
        assert_eq!(scene.kept_labels, [LABEL]);
        let lps_from_plan = scene.bone.lps_from_bone().then(&scene.bone_from_plan);
        assert!(
            lps_from_plan
                .translation
                .distance(DVec3::new(-160.0, 20.0, -120.0))
                < 1e-9
        );
        // a right shoulder's face looks to the patient's right and forward
        let outward = lps_from_plan.vector(DVec3::Z);
        assert!(outward.x < -0.8 && outward.y < -0.5 && outward.z.abs() < 1e-9);
        assert!(lps_from_plan.vector(DVec3::Y).distance(DVec3::Z) < 1e-9);
    }
}
