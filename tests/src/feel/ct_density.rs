//! From a scanner's CT numbers to the force: a CT of a known density, its calibration, the loaded bone, the servo,
//! the feed; beside the law's closed form for that density.

use super::feed::{Faced, fed_in, seated_in};
use super::setup::Scene;
use glam::{DQuat, DVec3};
use osteon_firmware_bridge::scene::recipe::{Calibration, Recipe};
use osteon_firmware_bridge::scene::{SceneArgs, load};
use osteon_sim_core::pose::Pose;
use std::path::Path;

/// A scanner of its own: neither slope nor offset is the law's.
const SLOPE: f64 = 0.000_9;
const OFFSET: f64 = 0.05;
const H_MM: f64 = 0.5;
const N: usize = 60;
/// Where the tool's tip stands, lattice frame, mm.
const FOOT_MM: DVec3 = DVec3::new(14.76, 14.77, 16.53);

/// The CT of a block of one density with a socket for the tool, partial volume at its surface.
#[expect(
    clippy::cast_possible_truncation,
    reason = "CT numbers and lengths fit"
)]
fn write_ct(path: &Path, faced: &Faced, density: f64) {
    let bone_hu = (density - OFFSET) / SLOPE;
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, b: &[u8]| bytes[at..at + b.len()].copy_from_slice(b);
    put(0, &348_i32.to_le_bytes());
    for (n, d) in [3, 60, 60, 50, 1, 1, 1, 1_i16].into_iter().enumerate() {
        put(40 + 2 * n, &d.to_le_bytes());
    }
    put(70, &16_i16.to_le_bytes());
    for (n, v) in [1.0, H_MM as f32, H_MM as f32, H_MM as f32]
        .into_iter()
        .enumerate()
    {
        put(76 + 4 * n, &v.to_le_bytes());
    }
    put(108, &352.0_f32.to_le_bytes());
    put(254, &1_i16.to_le_bytes());
    // LPS is the lattice
    for (row, sign) in [-1.0_f32, -1.0, 1.0].into_iter().enumerate() {
        put(
            280 + 16 * row + 4 * row,
            &(sign * H_MM as f32).to_le_bytes(),
        );
    }
    put(344, b"n+1\0");
    for at in 0..N * N * 50 {
        let p = DVec3::new((at % N) as f64, (at / N % N) as f64, (at / (N * N)) as f64) * H_MM;
        let own = f64::from(faced.tool.shape.signed_distance((p - FOOT_MM).as_vec3()));
        let depth = own.min(FOOT_MM.z + faced.depth_mm - p.z);
        let share = (0.5 + depth / (2.0 * H_MM)).clamp(0.0, 1.0);
        let hu = -1000.0 + (bone_hu + 1000.0) * share;
        bytes.extend((hu as f32).to_le_bytes());
    }
    std::fs::write(path, bytes).expect("written");
}

#[test]
#[expect(clippy::print_stderr, reason = "measured figures are told")]
fn three_densities_through_a_ct_feed_as_the_closed_form_says() {
    let dir = tempfile::tempdir().expect("a folder");
    for density in [0.30, 0.45, 0.70] {
        let faced = Faced::drill();
        let ct = dir.path().join("ct.nii");
        write_ct(&ct, &faced, density);
        let bone_hu = (density - OFFSET) / SLOPE;
        #[expect(clippy::cast_possible_truncation, reason = "a CT number")]
        let threshold = ((bone_hu - 1000.0) / 2.0) as f32;
        // the plan is far above: nothing under it is called a plate
        let plan = FOOT_MM + DVec3::Z * 25.0;
        let scene = load(
            &SceneArgs {
                bone: Some(ct),
                threshold,
                recipe: Recipe {
                    lps_from_plan: Some(Pose::new(DQuat::IDENTITY, plan)),
                    density: Some(Calibration {
                        slope: SLOPE,
                        offset: OFFSET,
                        source: "planted".to_owned(),
                    }),
                    ..Recipe::default()
                },
                ..SceneArgs::default()
            },
            &mut |_, _| {},
        )
        .expect("a scene");
        let foot = scene.bone_from_plan.translation - DVec3::Z * 25.0;
        let seated = seated_in(
            Scene {
                bone: scene.bone,
                bone_from_base: Pose::new(DQuat::IDENTITY, foot),
                tools: vec![faced.tool.clone()],
            },
            true,
        );
        let (row, _) = fed_in(seated, &faced, density, 30.0);
        eprintln!(
            "{density} g/cm³: {:.3} mm/s, closed form {:.3}, {:+.2} %",
            row.feed_mm_s,
            row.closed_form_mm_s,
            100.0 * row.rel
        );
        assert!(
            row.closed_form_mm_s > 0.0 && row.rel.abs() < 0.05,
            "{row:?}"
        );
    }
}
