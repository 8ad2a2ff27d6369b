//! The reader against files planted byte by byte, and against real ones with oracles of their own.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_possible_wrap,
    clippy::too_many_lines,
    reason = "planted numbers are small; tables of cases are long"
)]

use super::planted::{Planted, Syntax};
use super::*;
use crate::import::{ImportArgs, Summary, import};
use crate::scene::nifti::{self, Volume};
use crate::scene::tests::real_data;
use glam::DVec3;

const POSITION: (u16, u16) = (0x0020, 0x0032);
const SYNTAXES: [Syntax; 5] = [
    Syntax::Implicit,
    Syntax::Explicit,
    Syntax::BigEndian,
    Syntax::Deflated,
    Syntax::Rle,
];

fn args(input: &Path, out: &Path) -> ImportArgs {
    ImportArgs::of(input, out)
}

/// Imports a folder; the summary and the volume as the scene's own reader sees it.
fn imported(args: &ImportArgs) -> Result<(Summary, Volume), String> {
    let summary = import(args, &mut |_| {}, &mut |_, _| {})
        .map_err(|e| e.to_string())?
        .expect("a scene");
    let out = args.out.clone().expect("a folder");
    let volume = nifti::read(&out.join("volume.nii")).expect("a volume");
    Ok((summary, volume))
}

/// A stack of `count` slices every 0.8 mm, in shuffled files; pixel (i, j) of slice k holds f(i, j, k).
fn stack_in(dir: &Path, count: u16, syntax: Syntax, change: impl Fn(u16, &mut Planted)) {
    for k in 0..count {
        let mut d = Planted::ct(7, 5, [10.0, -20.0, 30.0 + 0.8 * f64::from(k)]);
        d.pixels((0..35).map(|n| value(n % 7, n / 7, k)).collect());
        change(k, &mut d);
        d.write(&dir.join(format!("{:03}.dcm", k * 37 % 101)), syntax);
    }
}

fn value(i: u16, j: u16, k: u16) -> u16 {
    1000 + 100 * k + 10 * j + i
}

/// Every voxel is the planted number, less the intercept of −1000.
fn check_planted(volume: &Volume, count: u16) {
    assert_eq!(volume.grid.dims, [7, 5, usize::from(count)]);
    assert!(volume.grid.spacing_mm.distance(DVec3::new(0.5, 0.5, 0.8)) < 1e-5);
    assert!(
        volume
            .lps_from_bone
            .translation
            .distance(DVec3::new(10.0, -20.0, 30.0))
            < 1e-4
    );
    for k in 0..count {
        for j in 0..5 {
            for i in 0..7 {
                let at = volume.grid.dense_index(i.into(), j.into(), k.into());
                let expected = f32::from(value(i, j, k)) - 1000.0;
                assert_eq!(
                    volume.values[at].to_bits(),
                    expected.to_bits(),
                    "{i} {j} {k}"
                );
            }
        }
    }
}

#[test]
fn every_way_of_writing_gives_the_planted_numbers() {
    for syntax in SYNTAXES {
        let dir = tempfile::tempdir().expect("a folder");
        let input = dir.path().join("in");
        std::fs::create_dir(&input).expect("a folder");
        stack_in(&input, 6, syntax, |_, _| {});
        std::fs::write(input.join("readme.txt"), "no slice").expect("written");
        let (summary, volume) = imported(&args(&input, &dir.path().join("out"))).expect("read");
        check_planted(&volume, 6);
        assert_eq!(summary.ignored_files, 1, "{syntax:?}");
        let text = std::fs::read_to_string(dir.path().join("out/scene.toml")).expect("a scene");
        assert!(
            !text.contains("Secret") && !text.contains("ID-17"),
            "{text}"
        );
    }
}

#[test]
fn a_multi_frame_file_is_a_stack() {
    let dir = tempfile::tempdir().expect("a folder");
    let input = dir.path().join("in");
    std::fs::create_dir(&input).expect("a folder");
    let mut d = Planted::ct(7, 5, [0.0; 3]);
    for tag in [
        POSITION,
        (0x0020, 0x0037),
        (0x0028, 0x0030),
        (0x0028, 0x1052),
        (0x0028, 0x1053),
    ] {
        d.remove(tag);
    }
    let group = |tag, inner: &dyn Fn(&mut Planted)| {
        let (mut item, mut outer) = (Planted::default(), Planted::default());
        inner(&mut item);
        outer.items(tag, vec![item]);
        outer
    };
    // frames from the top down
    let frames = (0..4).rev().map(|k| {
        group((0x0020, 0x9113), &|d| {
            d.numbers(POSITION, &[10.0, -20.0, 30.0 + 0.8 * f64::from(k)]);
        })
    });
    d.items((0x5200, 0x9230), frames.collect());
    let mut shared = group((0x0020, 0x9116), &|d| {
        d.numbers((0x0020, 0x0037), &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    });
    let (mut measures, mut transform) = (Planted::default(), Planted::default());
    measures.numbers((0x0028, 0x0030), &[0.5, 0.5]);
    transform.text((0x0028, 0x1052), "DS", "-1000");
    transform.text((0x0028, 0x1053), "DS", "1");
    shared.items((0x0028, 0x9110), vec![measures]);
    shared.items((0x0028, 0x9145), vec![transform]);
    d.items((0x5200, 0x9229), vec![shared]);
    d.text((0x0028, 0x0008), "IS", "4");
    let pixels = (0..4)
        .rev()
        .flat_map(|k| (0..35).map(move |n| value(n % 7, n / 7, k)));
    d.pixels(pixels.collect());
    d.write(&input.join("all.dcm"), Syntax::Explicit);
    let (summary, volume) = imported(&args(&input, &dir.path().join("out"))).expect("read");
    check_planted(&volume, 4);
    assert_eq!(summary.source.slices, Some(4));
}

#[test]
fn signs_slopes_and_padding() {
    let dir = tempfile::tempdir().expect("a folder");
    let input = dir.path().join("in");
    std::fs::create_dir(&input).expect("a folder");
    let stored: Vec<i16> = (0..35)
        .map(|n| if n == 4 { -2000 } else { n * 9 - 150 })
        .collect();
    stack_in(&input, 3, Syntax::Explicit, |_, d| {
        d.word((0x0028, 0x0103), 1);
        d.text((0x0028, 0x1053), "DS", "0.5");
        d.text((0x0028, 0x1052), "DS", "12.25");
        // padding is often written as unsigned
        d.word((0x0028, 0x0120), (-2000_i16).cast_unsigned());
        d.pixels(stored.iter().map(|v| v.cast_unsigned()).collect());
    });
    let (summary, volume) = imported(&args(&input, &dir.path().join("out"))).expect("read");
    assert_eq!(summary.source.padding_voxels, 3);
    for (n, v) in volume.values.iter().enumerate() {
        let expected = match stored[n % 35] {
            -2000 => -1000.0,
            s => f32::from(s) * 0.5 + 12.25,
        };
        assert_eq!(v.to_bits(), expected.to_bits(), "{n}");
    }
}

/// A patient that is a quadratic function of LPS, through a gantry tilted by 18°.
#[test]
fn a_tilted_gantry_is_resampled_where_the_bone_is() {
    let (sin, cos) = 18.0_f64.to_radians().sin_cos();
    let patient =
        |p: DVec3| 300.0 + 4.0 * p.x - 3.0 * p.y + 2.0 * p.z + 0.05 * p.y * p.y - 0.04 * p.x * p.y;
    for sign in [1.0, -1.0] {
        let dir = tempfile::tempdir().expect("a folder");
        let input = dir.path().join("in");
        std::fs::create_dir(&input).expect("a folder");
        let (row, column) = (DVec3::X, DVec3::new(0.0, cos, sign * sin));
        for k in 0..20_u16 {
            let origin = DVec3::new(-10.0, -15.0, 1.5 * f64::from(k));
            let mut d = Planted::ct(40, 60, origin.to_array());
            d.numbers((0x0020, 0x0037), &[1.0, 0.0, 0.0, 0.0, cos, sign * sin]);
            let pixel = |n: u16| {
                let (i, j) = (f64::from(n % 40), f64::from(n / 40));
                let p = origin + row * (0.5 * i) + column * (0.5 * j);
                (patient(p) + 1000.0).round() as u16
            };
            d.pixels((0..2400).map(pixel).collect());
            d.write(&input.join(format!("{k}.dcm")), Syntax::Implicit);
        }
        let (summary, volume) = imported(&args(&input, &dir.path().join("out"))).expect("read");
        let tilt = summary.source.tilt_deg.expect("a tilt");
        assert!((tilt - 18.0).abs() < 1e-3, "{tilt}");
        let grid = volume.grid;
        assert!((grid.spacing_mm.z - 1.5 * cos).abs() < 1e-5);
        let mut compared = 0;
        for (at, &v) in volume.values.iter().enumerate() {
            let [i, j, k] = [
                at % grid.dims[0],
                at / grid.dims[0] % grid.dims[1],
                at / (grid.dims[0] * grid.dims[1]),
            ];
            let p = volume.lps_from_bone.point(grid.centre(i, j, k));
            // the patient was imaged where a slice's own pixels are, two from its border
            let in_slice = p - DVec3::new(-10.0, -15.0, 1.5 * k as f64);
            let (across, along) = (in_slice.dot(row) / 0.5, in_slice.dot(column) / 0.5);
            if (2.0..57.0).contains(&along) && (2.0..37.0).contains(&across) {
                let error = f64::from(v) - patient(p);
                // half a unit when planted, half a unit when stored
                assert!(error.abs() < 1.3, "{i} {j} {k}: {error}");
                compared += 1;
            }
        }
        assert!(compared > 30_000, "{compared}");
    }
}

#[test]
fn what_is_no_volume_is_refused_by_slice() {
    let refusal = |syntax: Syntax, words: &[&str], change: &dyn Fn(u16, &mut Planted)| {
        let dir = tempfile::tempdir().expect("a folder");
        let input = dir.path().join("in");
        std::fs::create_dir(&input).expect("a folder");
        stack_in(&input, 6, syntax, change);
        let out = dir.path().join("out");
        let error = imported(&args(&input, &out)).expect_err("refused");
        assert!(!error.contains('\n'));
        for word in words {
            assert!(error.contains(word), "{word}: {error}");
        }
        assert!(!out.exists(), "nothing half-written");
        let left = std::fs::read_dir(dir.path()).expect("a folder").count();
        assert_eq!(left, 1, "only the input is left");
    };
    let place = |k: u16| [10.0, -20.0, 30.0 + 0.8 * f64::from(k)];
    // slice 3 is file 010.dcm, slice 4 is 047.dcm
    let moved = |z: f64| {
        move |k: u16, d: &mut Planted| {
            if k == 3 {
                let [x, y, at] = place(k);
                d.numbers(POSITION, &[x, y, at + z]);
            }
        }
    };
    let e = Syntax::Explicit;
    refusal(e, &["uneven", "mm"], &moved(0.3));
    refusal(e, &["same place", "mm"], &moved(0.8));
    refusal(e, &["010.dcm", "beside the line"], &|k, d| {
        if k == 3 {
            d.numbers(POSITION, &[11.0, -20.0, place(3)[2]]);
        }
    });
    refusal(e, &["orientation"], &|k, d| {
        if k == 3 {
            d.numbers((0x0020, 0x0037), &[1.0, 0.0, 0.0, 0.0, 0.0, -1.0]);
        }
    });
    refusal(e, &["010.dcm", "truncated", "70 bytes", "40"], &|k, d| {
        if k == 3 {
            d.pixels(vec![0; 20]);
        }
    });
    refusal(e, &["size"], &|k, d| {
        if k == 3 {
            d.word((0x0028, 0x0011), 6);
        }
    });
    refusal(e, &["time point"], &|k, d| {
        d.text((0x0020, 0x0100), "IS", &format!("{}", k % 2));
    });
    refusal(e, &["another patient"], &|k, d| {
        if k == 3 {
            d.text((0x0010, 0x0020), "LO", "ID-18");
        }
    });
    refusal(e, &["colour"], &|_, d| {
        d.word((0x0028, 0x0002), 3);
        d.text((0x0028, 0x0004), "CS", "RGB");
    });
    refusal(e, &["8-bit"], &|_, d| d.word((0x0028, 0x0100), 8));
    refusal(e, &["PixelSpacing", "-0.5"], &|_, d| {
        d.numbers((0x0028, 0x0030), &[-0.5, 0.5]);
    });
    refusal(e, &["ImagePositionPatient"], &|_, d| d.remove(POSITION));
    refusal(Syntax::JpegLs, &["JPEG-LS", "gdcmconv"], &|_, _| {});
}

#[test]
fn folders_without_a_volume() {
    let dir = tempfile::tempdir().expect("a folder");
    let input = dir.path().join("in");
    std::fs::create_dir(&input).expect("a folder");
    let out = dir.path().join("out");
    let error = imported(&args(&input, &out)).expect_err("empty");
    assert!(error.contains("no DICOM image among 0 files"), "{error}");
    stack_in(&input, 2, Syntax::Explicit, |_, _| {});
    let error = imported(&args(&input, &out)).expect_err("two slices");
    assert!(error.contains("2 slices are no volume"), "{error}");
    // a second series of four slices is the only volume; a third makes a choice necessary
    let series = |uid: &'static str, patient: &'static str, first: u16| {
        for k in 0..4 {
            let mut d = Planted::ct(7, 5, [10.0, -20.0, 30.0 + 0.8 * f64::from(k)]);
            d.pixels((0..35).map(|n| value(n % 7, n / 7, k)).collect());
            d.text((0x0020, 0x000e), "UI", uid);
            d.text((0x0010, 0x0020), "LO", patient);
            d.write(
                &input.join(format!("{}.dcm", 500 + first + k)),
                Syntax::Explicit,
            );
        }
    };
    series("9.1", "ID-17", 0);
    let (_, volume) = imported(&args(&input, &out)).expect("one volume");
    check_planted(&volume, 4);
    let error = imported(&args(&input, &out)).expect_err("there already");
    assert!(error.contains("is there already"), "{error}");
    series("9.2", "ID-17", 10);
    let again = ImportArgs {
        replace: true,
        ..args(&input, &out)
    };
    let error = imported(&again).expect_err("two volumes");
    assert!(
        error.contains("3 series") && error.contains("--series"),
        "{error}"
    );
    let third = ImportArgs {
        series: Some(3),
        ..again.clone()
    };
    let (_, volume) = imported(&third).expect("the third");
    check_planted(&volume, 4);
    series("9.3", "ID-99", 20);
    let error = imported(&again).expect_err("two patients");
    assert!(error.contains("2 patients"), "{error}");
}

#[test]
fn a_gap_is_refused_or_filled_and_recorded() {
    let Some(data) = real_data("dicom_odd/missing_slice") else {
        return;
    };
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("out");
    let error = imported(&args(&data, &out)).expect_err("a gap");
    assert!(
        error.contains("1 slice is missing") && error.contains("IM-0001-00"),
        "{error}"
    );
    let accept = ImportArgs {
        accept_gap: true,
        ..args(&data, &out)
    };
    let (summary, volume) = imported(&accept).expect("filled");
    assert_eq!(volume.grid.dims[2], 5);
    assert_eq!(summary.source.gaps.len(), 1);
    let layer = volume.grid.dims[0] * volume.grid.dims[1];
    let gap = summary.source.gaps[0];
    assert_eq!(gap.missing, 1);
    let at = |k: usize, n: usize| volume.values[k * layer + n];
    for n in 0..layer {
        let between = f32::midpoint(at(gap.first - 1, n), at(gap.first + 1, n));
        assert!((at(gap.first, n) - between).abs() <= 0.5, "{n}");
    }
}

/// The pixels at the end of an uncompressed file, taken as bytes.
fn tail_words(path: &Path, count: usize) -> Vec<i32> {
    let bytes = std::fs::read(path).expect("a file");
    // the pixel data's tag, little-endian, and its length just before the words
    let length = u32::try_from(2 * count).expect("short").to_le_bytes();
    let at = (0..bytes.len() - 12)
        .rfind(|&n| {
            bytes[n..n + 4] == [0xe0, 0x7f, 0x10, 0]
                && (bytes[n + 4..n + 8] == length || bytes[n + 8..n + 12] == length)
        })
        .expect("pixel data");
    let from = if bytes[at + 4..at + 8] == length {
        at + 8
    } else {
        at + 12
    };
    bytes[from..from + 2 * count]
        .as_chunks::<2>()
        .0
        .iter()
        .map(|w| i32::from(i16::from_le_bytes(*w)))
        .collect()
}

/// Stored numbers of a file's only frame, by the reader under test.
fn stored(path: &Path) -> Result<Vec<i32>, String> {
    let object = header::open(path, false)?.expect("DICOM");
    let kind = header::stored(&object)?;
    pixels::open(path)?.frame(0, &kind)
}

#[test]
fn real_odd_files_are_read_exactly_or_refused() {
    let Some(odd) = real_data("dicom_odd") else {
        return;
    };
    let plain = tail_words(&odd.join("transfer_syntax/1.dcm"), 384 * 384);
    assert_eq!(plain.iter().max(), Some(&2362));
    for name in ["1", "4", "5", "9"] {
        let read = stored(&odd.join(format!("transfer_syntax/{name}.dcm"))).expect(name);
        assert!(read == plain, "{name}.dcm differs");
    }
    let small = odd.join("single/CT_small.dcm");
    assert!(stored(&small).expect("small") == tail_words(&small, 128 * 128));
    // a byte before the data set: no DICOM; without it the bare data set is read
    let no_meta = std::fs::read(odd.join("single/no_meta.dcm")).expect("a file");
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("no_meta.dcm");
    std::fs::write(&path, &no_meta).expect("written");
    let error = imported(&args(dir.path(), &dir.path().join("out"))).expect_err("no image");
    assert!(error.contains("no DICOM image among 1 files"), "{error}");
    std::fs::write(&path, &no_meta[1..]).expect("written");
    assert!(stored(&path).expect("bare") == tail_words(&path, 128 * 128));
    let error = stored(&odd.join("single/MR_truncated.dcm")).expect_err("truncated");
    assert!(
        error.contains("damaged") || error.contains("truncated"),
        "{error}"
    );
}

#[test]
fn the_shared_slices_and_the_nifti_of_the_same_scan_are_equal() {
    let Some(data) = real_data("lidc0314_shoulders") else {
        return;
    };
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("out");
    let (summary, dicom) = imported(&args(&data.join("dicom_right_glenoid"), &out)).expect("read");
    assert_eq!(dicom.grid.dims, [512, 512, 41]);
    assert_eq!(summary.source.tilt_deg, None);
    let whole = nifti::read(&data.join("right_shoulder_ct.nii.gz")).expect("read");
    let dicom_from_whole = dicom.lps_from_bone.inverse().then(&whole.lps_from_bone);
    let [nx, ny, nz] = whole.grid.dims;
    let (mut compared, mut layers) = (0_usize, 0);
    for k in 0..nz {
        let before = compared;
        for (j, i) in (0..ny).flat_map(|j| (0..nx).map(move |i| (j, i))) {
            let p = dicom_from_whole.point(whole.grid.centre(i, j, k)) / dicom.grid.spacing_mm;
            let near = p.round();
            assert!(p.distance(near) < 1e-2, "the grids share their places: {p}");
            let at = near.to_array().map(|v| v as i64);
            let inside = (0..3).all(|a| at[a] >= 0 && at[a] < dicom.grid.dims[a] as i64);
            if inside {
                let [x, y, z] = at.map(|v| v as usize);
                let a = dicom.values[dicom.grid.dense_index(x, y, z)];
                let b = whole.values[whole.grid.dense_index(i, j, k)];
                assert_eq!(a.to_bits(), b.to_bits(), "{i} {j} {k}");
                compared += 1;
            }
        }
        layers += usize::from(compared > before);
    }
    assert_eq!((layers, compared), (41, 41 * nx * ny));
}
