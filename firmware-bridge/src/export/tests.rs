//! Planted bones and a recorded session, read back by other readers.

use super::*;
use crate::import::read_nrrd;
use crate::recording::tests::{recorded, ticks_of};
use crate::scene::nifti;
use crate::tools::stl;
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::collections::HashMap;
use std::path::Path;

const RADIUS: f64 = 9.0;

/// A ball of bone across eight chunks, in a turned frame.
#[expect(
    clippy::cast_possible_truncation,
    reason = "millimetres and numbers of voxels"
)]
fn ball() -> (Bone, DVec3) {
    let dims = [46, 40, 42];
    let grid = Grid::new(dims, DVec3::new(0.5, 0.6, 0.55)).expect("a grid");
    let middle = DVec3::new(11.3, 11.9, 11.2);
    let mut solid = vec![0.0; grid.len()];
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let away = (grid.centre(i, j, k) - middle).length();
                solid[grid.dense_index(i, j, k)] = (RADIUS - away) as f32;
            }
        }
    }
    let hu: Vec<i16> = (0..grid.len())
        .map(|n| 200 + i16::try_from(n % 1000).unwrap_or(0))
        .collect();
    let dense = DenseBone {
        density_hu: &hu,
        solid_mm: &solid,
        class: &vec![3; grid.len()],
        label: &vec![1; grid.len()],
    };
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0) / 6f64.sqrt(), 0.7);
    let place = Pose::new(turn, DVec3::new(-50.0, 20.0, 130.0));
    (
        Bone::from_dense(grid, place, &dense).expect("a bone"),
        middle,
    )
}

/// The ball with a peg hole 6 mm deep.
fn drilled() -> (Bone, DVec3, Cut) {
    let (bone, middle) = ball();
    let mut cut = Cut::new(&bone);
    let drill = &Tool::standard_set()[0];
    let at = |z: f64| Pose::new(DQuat::IDENTITY, middle + DVec3::Z * z);
    for n in 0..40 {
        let z = RADIUS + 2.0 - 0.2 * f64::from(n);
        let step = CarveStep {
            tool: 0,
            before: at(z),
            after: at(z - 0.2),
        };
        carve(&bone, &mut cut, drill, &step, &mut |_, _| {});
    }
    (bone, middle, cut)
}

/// Every edge belongs to two triangles that run along it in opposite ways.
fn assert_closed(triangles: &[[u32; 3]]) {
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for t in triangles {
        for n in 0..3 {
            let (a, b) = (t[n], t[(n + 1) % 3]);
            *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    assert!(edges.values().all(|&balance| balance == 0));
}

#[test]
fn the_surface_of_a_ball_is_its_surface_and_is_closed() {
    let (bone, middle) = ball();
    let surface = surface::of(&bone, &Cut::new(&bone));
    assert_closed(&surface.triangles);
    let middle = bone.lps_from_bone().point(middle);
    for v in &surface.vertices {
        let off = (*v - middle).length() - RADIUS;
        assert!(off.abs() < 0.03, "{off} mm");
    }
    let truth = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    let volume = surface.volume_mm3();
    assert!((volume / truth - 1.0).abs() < 5e-3, "{volume} {truth}");
}

#[test]
fn what_is_cut_away_is_missing_from_surface_and_volumes() {
    let (bone, middle, cut) = drilled();
    let whole = surface::of(&bone, &Cut::new(&bone));
    let left = surface::of(&bone, &cut);
    assert_closed(&left.triangles);
    let removed = Cut::mm3(bone.grid(), cut.totals().units());
    let gone = whole.volume_mm3() - left.volume_mm3();
    assert!(
        removed > 150.0 && (gone / removed - 1.0).abs() < 0.02,
        "{gone} {removed}"
    );
    // volumes: the bone's own CT numbers, air in the hole and outside
    let dir = tempfile::tempdir().expect("a folder");
    let (nii, nrrd) = (dir.path().join("b.nii"), dir.path().join("b.nrrd"));
    volume::nifti(&nii, &bone, &cut).expect("written");
    volume::nrrd(&nrrd, &bone, &cut).expect("written");
    let nifti = nifti::read(&nii).expect("NIfTI");
    let (other, notes) = read_nrrd(&nrrd).expect("NRRD");
    assert!(notes.is_empty(), "{notes:?}");
    let grid = bone.grid();
    let in_bone = |v: DVec3| (v - middle).length() < RADIUS - 0.5;
    let in_hole = |v: DVec3| (v - middle).truncate().length() < 3.5 && v.z > middle.z + 5.5;
    let (mut kept, mut cleared) = (0, 0);
    for k in 0..grid.dims[2] {
        for j in 0..grid.dims[1] {
            for i in 0..grid.dims[0] {
                let n = grid.dense_index(i, j, k);
                let v = grid.centre(i, j, k);
                let hu = nifti.values[n];
                assert!((hu - other.values[n]).abs() < 1e-6);
                let (chunk, at) = bone.locate([i, j, k]).expect("a voxel");
                if in_hole(v) || (v - middle).length() > RADIUS + 0.1 {
                    assert!((hu + 1000.0).abs() < 1e-6, "{v}");
                    cleared += 1;
                } else if in_bone(v) && (v - middle).z < 2.0 {
                    assert!((hu - f32::from(bone.chunk(chunk).density_hu[at])).abs() < 1e-6);
                    kept += 1;
                }
            }
        }
    }
    assert!(kept > 8000 && cleared > 8000, "{kept} {cleared}");
    // both lie where the bone lies in the patient
    for (read_grid, place) in [
        (nifti.grid, nifti.lps_from_bone),
        (other.grid, other.lps_from_bone),
    ] {
        let p = DVec3::new(3.0, 7.0, 11.0);
        assert!((place.point(p) - bone.lps_from_bone().point(p)).length() < 1e-3);
        assert!((read_grid.spacing_mm - grid.spacing_mm).length() < 1e-6);
    }
    // the file of triangles holds the same surface
    let path = dir.path().join("b.stl");
    left.write_stl(&path).expect("written");
    let soup = stl::read(&path).expect("STL");
    assert_eq!(
        (soup.triangles.len(), soup.trailing),
        (left.triangles.len(), 0)
    );
}

fn export(file: &Path, dir: &Path) -> ExportArgs {
    ExportArgs {
        file: file.to_owned(),
        csv: Some(dir.join("tables")),
        nifti: Some(dir.join("bone.nii")),
        nrrd: None,
        stl: Some(dir.join("bone.stl")),
        at: None,
        moved: Moved::default(),
    }
}

#[test]
fn a_session_becomes_tables_that_hold_every_tick() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("session.mcap");
    recorded(&file);
    run(&export(&file, dir.path())).expect("exported");
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).expect("a table");
    let ticks = ticks_of(&file);
    let table = read("tables/ticks.csv");
    let mut lines = table.lines();
    let columns: Vec<&str> = lines.next().expect("columns").split(',').collect();
    let of = |name: &str| columns.iter().position(|c| *c == name).expect("a column");
    let (force, removed, encoder) = (of("force_z_n"), of("removed_units"), of("encoder_2"));
    let mut count = 0;
    for (line, tick) in lines.zip(&ticks) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), columns.len(), "{line}");
        // numbers read back to the same bits
        let n: f64 = cells[force].parse().expect("a number");
        assert_eq!(n.to_bits(), tick.outcome.force_n[2].to_bits());
        let units: i64 = cells[removed].parse().expect("a number");
        assert_eq!(units, tick.outcome.removed_by_class.iter().sum::<i64>());
        let sample = tick.sample.expect("a sample");
        assert_eq!(cells[encoder], sample.encoders[1].to_string());
        count += 1;
    }
    assert_eq!(count, ticks.len());
    let events = read("tables/events.csv");
    for event in [
        "300,request,\"checkpoint\"",
        "850,request,\"undo\"",
        "1500,request,\"reset\"",
        "4000,end,\"as asked",
    ] {
        assert!(events.contains(event), "no {event} in {events}");
    }
    let setup: serde_json::Value = serde_json::from_str(&read("tables/setup.json")).expect("JSON");
    assert_eq!(setup["force_limit_n"], 3.3);
    // the bone of an earlier time has lost less
    let late = stl::read(&dir.path().join("bone.stl"))
        .expect("STL")
        .triangles
        .len();
    let early = ExportArgs {
        csv: None,
        nifti: None,
        stl: Some(dir.path().join("early.stl")),
        at: Some(0.7),
        ..export(&file, dir.path())
    };
    run(&early).expect("exported");
    let early = stl::read(&dir.path().join("early.stl"))
        .expect("STL")
        .triangles
        .len();
    assert_ne!(late, early);
    let nothing = ExportArgs {
        csv: None,
        nifti: None,
        stl: None,
        ..export(&file, dir.path())
    };
    let error = run(&nothing).expect_err("nothing is asked for").to_string();
    assert!(error.contains("--csv"), "{error}");
}
