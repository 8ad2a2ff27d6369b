//! The stand-ins have the thesis's sizes, and its files come back from text.
#![expect(clippy::print_stdout, reason = "measured figures")]

use super::*;
use osteon_firmware_bridge::scene::text_ct::{self, EMPTY_HU, Options};
use std::time::Instant;

/// Farthest that a count may be from the thesis's.
const NEAR: f64 = 0.02;

fn near(ours: usize, theirs: usize) -> bool {
    (ours as f64 / theirs as f64 - 1.0).abs() <= NEAR
}

#[test]
fn the_printed_figures_agree_with_each_other() {
    for object in Object::ALL {
        let t = object.theirs();
        assert_eq!(t.dims.iter().product::<usize>(), t.voxels, "{object:?}");
        assert_eq!(t.chunk_dims.iter().product::<usize>(), t.chunks);
        assert_eq!(t.chunk_dims.map(|n| n * 32), t.chunked_dims);
        let mb = |bytes: usize| bytes as f64 / 1e6;
        assert!((mb(t.voxels * 2) - t.dense_mb).abs() < 0.06);
        assert!((mb(t.active_chunks * 65_536) - t.active_chunks_mb).abs() < 0.06);
        // the derivation of the active voxels
        let lines = match listed(object) {
            Listed::Active => t.active,
            Listed::All => t.voxels,
        };
        let text_mb = mb(lines) * LINE_BYTES as f64;
        assert!((text_mb / t.text_mb - 1.0).abs() < 0.006, "{text_mb}");
        let mb_per_ms = t.text_mb / t.phases_ms[1];
        assert!((27.0..=30.0).contains(&mb_per_ms), "{mb_per_ms}");
    }
    let [one, two] = [Object::TrabecularCore1, Object::TrabecularCore2].map(Object::theirs);
    assert!((one.active_ratio() - two.active_ratio()).abs() < 1e-6);
}

#[test]
fn every_stand_in_has_its_grid_its_active_voxels_and_about_its_chunks() {
    let begun = Instant::now();
    for object in Object::ALL {
        let theirs = object.theirs();
        let volume = object.stand_in(1);
        let rect = figures(&volume);
        assert_eq!(rect.dims, theirs.dims);
        assert_eq!(rect.voxels, theirs.voxels);
        assert!(near(rect.active, theirs.active), "{object:?}: {rect:?}");
        let cubic = figures(&cubes(&volume).expect("cubes"));
        println!(
            "{}: {} of {} active ({:.3}, thesis {}), chunks of 16, 32, 64: {:?}, 32 in cubes {} of {} (thesis {} of {})",
            object.name(),
            rect.active,
            rect.voxels,
            rect.active_ratio(),
            theirs.active,
            rect.chunks.map(|c| (c.active, c.total())),
            cubic.chunks[1].active,
            cubic.chunks[1].total(),
            theirs.active_chunks,
            theirs.chunks,
        );
        assert_eq!(cubic.chunks[1].dims, theirs.chunk_dims);
        // a smaller chunk fits the object more closely
        let bytes = rect.chunks.map(|c| c.active_bytes());
        assert!(
            bytes.is_sorted() && bytes[0] >= 2 * rect.active,
            "{bytes:?}"
        );
        if object == Object::Scapula {
            assert_eq!(rect.chunks[1].total(), SCAPULA_RECT_CHUNKS.0);
            // another shape with as many voxels
            let ratio = cubic.chunks[1].active as f64 / theirs.active_chunks as f64;
            assert!((0.8..1.25).contains(&ratio), "{ratio}");
        } else {
            assert!(near(cubic.chunks[1].active, theirs.active_chunks));
        }
    }
    println!("all five: {:.1} s", begun.elapsed().as_secs_f64());
}

#[test]
fn a_stand_in_depends_on_its_seed_and_on_nothing_else() {
    let once = Object::TrabecularCore1.stand_in(5);
    assert_eq!(once, Object::TrabecularCore1.stand_in(5));
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let alone = alone
        .expect("a pool")
        .install(|| Object::TrabecularCore1.stand_in(5));
    assert_eq!(once, alone);
    assert_ne!(once, Object::TrabecularCore1.stand_in(6));
}

#[test]
fn a_stand_in_comes_back_from_its_text_file() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("glenoid.txt");
    let volume = Object::Glenoid.stand_in(1);
    for listed in [Listed::All, Listed::Active] {
        let lines = write_text(&volume, listed, &path).expect("written");
        let bytes = std::fs::metadata(&path).expect("a file").len();
        assert_eq!(bytes, lines * LINE_BYTES);
        let back = text_ct::read(&path, Options::default(), &mut |_| ()).expect("a volume");
        assert_eq!(back.grid, volume.grid);
        let kept = |hu: i16| match listed {
            Listed::Active if hu < ACTIVE_HU => EMPTY_HU,
            _ => hu,
        };
        let expected: Vec<i16> = volume.density_hu.iter().map(|&hu| kept(hu)).collect();
        let same = expected == back.density_hu;
        // the corners are listed whatever they are
        assert!(same || expected[1..expected.len() - 1] == back.density_hu[1..expected.len() - 1]);
        assert_eq!(back.absent as u64, volume.grid.len() as u64 - lines);
    }
}

#[test]
fn the_phases_are_timed_on_a_file_that_is_gone_afterwards() {
    let dir = tempfile::tempdir().expect("a folder");
    let phases = phases(Object::Glenoid, 1, dir.path()).expect("timed");
    println!("{phases:?}");
    assert!(phases.chunks > 0 && phases.read_mb_per_s() > 0.0);
    assert_eq!(phases.text_bytes, phases.lines * LINE_BYTES);
    assert_eq!(std::fs::read_dir(dir.path()).expect("a folder").count(), 0);
}

#[test]
#[ignore = "writes up to 1.4 GB and takes minutes: a measurement, not a check"]
fn all_five_phases() {
    let dir = tempfile::tempdir().expect("a folder");
    for object in Object::ALL {
        let phases = phases(object, 1, dir.path()).expect("timed");
        println!(
            "{}: {:.0} MB/s, {phases:?}, thesis {:?} ms",
            object.name(),
            phases.read_mb_per_s(),
            object.theirs().phases_ms
        );
    }
}
