//! Volumes of every kind with the same planted numbers in the same place, and refusals.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::too_many_lines,
    reason = "planted numbers are small; tables of cases are long"
)]

use super::*;
use crate::scene::nifti::{self, Volume};
use glam::DVec3;
use std::fmt::Write as _;

const DIMS: [usize; 3] = [4, 3, 5];

/// The number of voxel (i, j, k).
fn planted(i: usize, j: usize, k: usize) -> i16 {
    i16::try_from(100 * k + 10 * j + i).expect("small") - 150
}

fn bytes_le() -> Vec<u8> {
    let mut out = Vec::new();
    for k in 0..DIMS[2] {
        for j in 0..DIMS[1] {
            for i in 0..DIMS[0] {
                out.extend(planted(i, j, k).to_le_bytes());
            }
        }
    }
    out
}

fn imported(args: &ImportArgs) -> Result<(Summary, Volume), String> {
    let summary = import(args, &mut |_| {}, &mut |_, _| {})
        .map_err(|e| e.to_string())?
        .expect("a scene");
    let out = args.out.clone().expect("a folder");
    Ok((
        summary,
        nifti::read(&out.join("volume.nii")).expect("a volume"),
    ))
}

/// Every planted number is found at `lps_of(i, j, k)`.
fn check(volume: &Volume, lps_of: impl Fn(DVec3) -> DVec3) {
    assert_eq!(volume.values.len(), 60);
    let bone_from_lps = volume.lps_from_bone.inverse();
    for k in 0..DIMS[2] {
        for (j, i) in (0..DIMS[1]).flat_map(|j| (0..DIMS[0]).map(move |i| (j, i))) {
            let p = lps_of(DVec3::new(i as f64, j as f64, k as f64));
            let q = bone_from_lps.point(p) / volume.grid.spacing_mm;
            assert!(q.distance(q.round()) < 1e-4, "{q}");
            let [x, y, z] = q.round().to_array().map(|v| v as usize);
            let v = volume.values[volume.grid.dense_index(x, y, z)];
            assert_eq!(
                v.to_bits(),
                f32::from(planted(i, j, k)).to_bits(),
                "{i} {j} {k}"
            );
        }
    }
}

fn case(name: &str, bytes: &[u8]) -> (tempfile::TempDir, ImportArgs) {
    let dir = tempfile::tempdir().expect("a folder");
    let input = dir.path().join(name);
    std::fs::write(&input, bytes).expect("written");
    let args = ImportArgs::of(&input, &dir.path().join("out"));
    (dir, args)
}

const NRRD: &str =
    "NRRD0004\n# a comment\ntype: short\ndimension: 3\nsizes: 4 3 5\nendian: little\n";

#[test]
fn nrrd_in_ras_and_lps_raw_and_gzip() {
    let place = "space directions: (0.5,0,0) (0,-0.6,0) (0,0,0.7)\nspace origin: (-3,4,5)\n";
    let lps = |v: DVec3| DVec3::new(-3.0 + 0.5 * v.x, 4.0 - 0.6 * v.y, 5.0 + 0.7 * v.z);
    let raw = [
        format!("{NRRD}encoding: raw\nspace: left-posterior-superior\n{place}\n").as_bytes(),
        &bytes_le(),
    ]
    .concat();
    let (_dir, args) = case("a.nrrd", &raw);
    let (summary, volume) = imported(&args).expect("read");
    check(&volume, lps);
    assert_eq!(summary.source.kind, "NRRD");
    let mut z = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut z, &bytes_le()).expect("zipped");
    let zipped = z.finish().expect("zipped");
    let head = format!("{NRRD}encoding: gzip\nspace: RAS\n{place}\n");
    let (_dir, args) = case("b.nrrd", &[head.as_bytes(), &zipped].concat());
    let (_, volume) = imported(&args).expect("read");
    check(&volume, |v| lps(v) * DVec3::new(-1.0, -1.0, 1.0));
}

const META: &str = "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = 4 3 5\nElementType = MET_SHORT\n";

#[test]
fn meta_image_in_one_file_and_in_two() {
    let place =
        "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 1 2 3\nElementSpacing = 0.5 0.6 0.7\n";
    let lps = |v: DVec3| DVec3::new(1.0 - 0.6 * v.y, 2.0 + 0.5 * v.x, 3.0 + 0.7 * v.z);
    let head = format!("{META}CompressedData = False\n{place}ElementDataFile = LOCAL\n");
    let (_dir, args) = case("a.mha", &[head.as_bytes(), &bytes_le()].concat());
    let (summary, volume) = imported(&args).expect("read");
    check(&volume, lps);
    assert_eq!(summary.axes[0], "posterior");
    let head = format!("{META}CompressedData = True\n{place}ElementDataFile = a.zraw\n");
    let (dir, args) = case("a.mhd", head.as_bytes());
    let mut z = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut z, &bytes_le()).expect("zipped");
    std::fs::write(dir.path().join("a.zraw"), z.finish().expect("zipped")).expect("written");
    check(&imported(&args).expect("read").1, lps);
}

#[test]
fn text_and_nifti_go_the_same_way() {
    let lps = |v: DVec3| v * DVec3::new(0.5, 0.6, 0.7) + DVec3::new(1.0, 2.0, 3.0);
    let mut text = String::new();
    for k in 0..DIMS[2] {
        for (j, i) in (0..DIMS[1]).flat_map(|j| (0..DIMS[0]).map(move |i| (j, i))) {
            let p = lps(DVec3::new(i as f64, j as f64, k as f64));
            writeln!(text, "{} {} {} {}", p.x, p.y, p.z, planted(i, j, k)).expect("a string");
        }
    }
    let (dir, args) = case("a.txt", text.as_bytes());
    check(&imported(&args).expect("read").1, lps);
    // the scene's own volume is a NIfTI file
    let again = ImportArgs::of(
        &dir.path().join("out/volume.nii"),
        &dir.path().join("again"),
    );
    let (summary, volume) = imported(&again).expect("read");
    check(&volume, lps);
    let bytes = |p: &str| std::fs::read(dir.path().join(p)).expect("a file");
    assert_eq!(bytes("out/volume.nii"), bytes("again/volume.nii"));
    assert_eq!(
        summary.xxh3,
        hash_file(&dir.path().join("again/volume.nii")).expect("a hash")
    );
}

#[test]
fn pictures_need_their_spacing() {
    let dir = tempfile::tempdir().expect("a folder");
    let input = dir.path().join("in");
    std::fs::create_dir(&input).expect("a folder");
    for k in 0..DIMS[2] {
        // slice 10 comes after slice 9
        let file = std::fs::File::create(input.join(format!("s{}.png", k + 8))).expect("a file");
        let mut encoder = png::Encoder::new(file, 4, 3);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        let mut writer = encoder.write_header().expect("a header");
        let pixels = (0..12).flat_map(|n| (planted(n % 4, n / 4, k) + 1000).to_be_bytes());
        writer
            .write_image_data(&pixels.collect::<Vec<u8>>())
            .expect("written");
    }
    let bare = ImportArgs::of(&input, &dir.path().join("out"));
    let error = imported(&bare).expect_err("no spacing");
    assert!(error.contains("--spacing"), "{error}");
    let args = ImportArgs {
        spacing: Some(vec![0.5, 0.6, 0.7]),
        intercept: -1000.0,
        ..bare.clone()
    };
    check(&imported(&args).expect("read").1, |v| {
        v * DVec3::new(0.5, 0.6, 0.7)
    });
    let negative = ImportArgs {
        spacing: Some(vec![0.5, -0.6, 0.7]),
        replace: true,
        ..args
    };
    let error = imported(&negative).expect_err("negative");
    assert!(error.contains("-0.6 mm is no spacing"), "{error}");
    let file = std::fs::File::create(input.join("s9.tif")).expect("a file");
    let mut tiff = tiff::encoder::TiffEncoder::new(file).expect("a file");
    tiff.write_image::<tiff::encoder::colortype::RGB8>(4, 3, &[0; 36])
        .expect("written");
    let args = ImportArgs {
        spacing: Some(vec![0.5, 0.6, 0.7]),
        replace: true,
        ..bare
    };
    let error = imported(&args).expect_err("a colour picture");
    assert!(
        error.contains("s9.tif") && error.contains("colour"),
        "{error}"
    );
}

#[test]
fn what_cannot_be_is_refused_in_one_line_and_nothing_is_left() {
    let float_nan: Vec<u8> = (0..60)
        .flat_map(|n| if n == 7 { f32::NAN } else { 1.5 }.to_le_bytes())
        .collect();
    let nrrd = |change: &str, by: &str, data: &[u8]| {
        let head = format!(
            "{NRRD}encoding: raw\nspace: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n\n"
        );
        [head.replace(change, by).as_bytes(), data].concat()
    };
    let meta = |change: &str, by: &str| {
        let head = format!("{META}ElementSpacing = 1 1 1\nElementDataFile = LOCAL\n");
        [head.replace(change, by).as_bytes(), &bytes_le()].concat()
    };
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "nan.nrrd",
            nrrd("type: short", "type: float", &float_nan),
            "1 voxels are no number",
        ),
        ("short.nrrd", nrrd("", "", &bytes_le()[..50]), "truncated"),
        (
            "kind.nrrd",
            nrrd("type: short", "type: block", &[]),
            "type: block",
        ),
        (
            "sheared.nrrd",
            nrrd("(0,1,0)", "(0.3,1,0)", &bytes_le()),
            "sheared",
        ),
        (
            "space.nrrd",
            nrrd("space: LPS", "space: scanner-xyz", &[]),
            "space: scanner-xyz",
        ),
        (
            "sizes.nrrd",
            nrrd("sizes: 4 3 5", "sizes: 4 3 99999", &[]),
            "99999 voxels",
        ),
        ("words.nrrd", b"words".to_vec(), "no NRRD"),
        (
            "spacing.mha",
            meta("1 1 1", "1 -1 1"),
            "-1 mm is no spacing",
        ),
        (
            "rgb.mha",
            meta("NDims", "ElementNumberOfChannels = 3\nNDims"),
            "colours",
        ),
        (
            "type.mha",
            meta("MET_SHORT", "MET_LONG_LONG"),
            "MET_LONG_LONG",
        ),
        ("words.mha", b"words".to_vec(), "no MetaImage"),
        ("words.bin", b"words".to_vec(), "ends in none of"),
    ];
    for (name, bytes, expected) in cases {
        let (dir, args) = case(name, &bytes);
        let error = imported(&args).expect_err(name);
        assert!(
            error.contains(name) && error.contains(expected),
            "{name}: {error}"
        );
        assert!(!error.contains('\n'));
        assert_eq!(
            std::fs::read_dir(dir.path()).expect("a folder").count(),
            1,
            "{name}"
        );
    }
    let (_dir, args) = case("nan.nrrd", &nrrd("type: short", "type: float", &float_nan));
    let args = ImportArgs {
        nan_is_air: true,
        ..args
    };
    let (summary, volume) = imported(&args).expect("mended");
    assert_eq!(summary.source.non_finite_voxels, 1);
    assert_eq!(volume.values[7].to_bits(), (-1000.0_f32).to_bits());
}

#[test]
fn a_label_map_of_another_grid_is_refused() {
    let head = |origin: &str| {
        format!("{META}ElementSpacing = 1 1 1\nOffset = {origin}\nElementDataFile = LOCAL\n")
    };
    let (dir, args) = case("ct.mha", &[head("0 0 0").as_bytes(), &bytes_le()].concat());
    let labels: Vec<u8> = (0..60_i16).flat_map(|n| (n % 3).to_le_bytes()).collect();
    let put = |name: &str, origin: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, [head(origin).as_bytes(), &labels].concat()).expect("written");
        Some(path)
    };
    let far = ImportArgs {
        labels: put("far.mha", "0 0 0.5"),
        ..args.clone()
    };
    let error = imported(&far).expect_err("another grid");
    assert!(
        error.contains("far.mha") && error.contains("not on the grid"),
        "{error}"
    );
    let no_label = ImportArgs {
        labels: put("good.mha", "0 0 0"),
        keep: vec![7],
        ..args.clone()
    };
    let error = imported(&no_label).expect_err("no such label");
    assert!(error.contains("no voxel has label 7"), "{error}");
    let good = ImportArgs {
        keep: vec![2],
        ..no_label
    };
    imported(&good).expect("a scene");
    let scene = file::read(&dir.path().join("out")).expect("a scene");
    assert_eq!(scene.labels.expect("labels").keep, [2]);
}
