//! Whole scenes: a planted ball through a file, bad input, and the real CT where it is at hand.
#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "measured figures, and a skip that must be seen"
)]

use super::nifti::tests::{Spec, gzip};
use super::*;
use glam::DVec3;
use osteon_sim_core::bone::Occupancy;
use osteon_sim_core::grid::CHUNK_VOXELS;
use osteon_sim_core::tissue::Tissue;
use std::path::Path;
use std::time::Instant;

/// Radius of the planted ball, mm.
const RADIUS: f64 = 11.0;
/// Volume inside the real scapula's mesh, mm³.
const MESH_MM3: f64 = 71_700.0;

/// Trilinear reading of the solid distance at `p` (bone frame, mm).
fn solid_at(bone: &Bone, p: DVec3) -> f64 {
    let q = p / bone.grid().spacing_mm;
    let base = q.floor();
    let t = q - base;
    let quantum = f64::from(bone.grid().quantum_mm());
    let mut sum = 0.0;
    for corner in 0..8_u32 {
        let bit = [corner & 1, (corner >> 1) & 1, corner >> 2].map(f64::from);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "negative ones saturate at 0; the point is inside the lattice"
        )]
        let at = (base + DVec3::from_array(bit))
            .to_array()
            .map(|v| v as usize);
        let units = bone
            .locate(at)
            .map_or(-i16::MAX, |(chunk, voxel)| bone.chunk(chunk).solid[voxel]);
        let weight: f64 = (0..3)
            .map(|a| if bit[a] > 0.5 { t[a] } else { 1.0 - t[a] })
            .product();
        sum += weight * f64::from(units) * quantum;
    }
    sum
}

/// Points spread over the unit sphere (golden-angle spiral).
fn directions(count: u32) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |n| {
        let z = 1.0 - (2.0 * f64::from(n) + 1.0) / f64::from(count);
        let turn = f64::from(n) * 2.399_963;
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * turn.cos(), r * turn.sin(), z)
    })
}

struct Files {
    dir: tempfile::TempDir,
    centre_lps: DVec3,
}

impl Files {
    /// A ball of 900 HU in -100 HU (softened over a voxel, as a scanner does), with a label map
    /// (ball 1, a second structure 2) and a plan on its top, in a mirrored lattice.
    fn new() -> Self {
        let dims = [40_i16, 38, 36];
        let spacing = [0.8_f32, 0.8, 1.0];
        let (mut ct, mut labels) = (Vec::new(), Vec::new());
        let middle = DVec3::new(16.2, 15.1, 17.3);
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let p = DVec3::new(f64::from(i) * 0.8, f64::from(j) * 0.8, f64::from(k));
                    let depth = RADIUS - p.distance(middle);
                    ct.push((400.0 + 500.0 * (depth / 0.7).tanh()).round());
                    labels.push(match depth {
                        d if d > 0.3 => 1.0,
                        _ if p.z > middle.z + RADIUS + 1.0 => 2.0,
                        _ => 0.0,
                    });
                }
            }
        }
        let dir = tempfile::tempdir().expect("temporary directory");
        let mut spec = Spec::new(dims, spacing, ct);
        // i along +x of RAS: with j along -y and k along +z a left-handed lattice
        spec.sform = Some([
            [0.8, 0.0, 0.0, -7.0],
            [0.0, -0.8, 0.0, 20.0],
            [0.0, 0.0, 1.0, 30.0],
        ]);
        let ras = DVec3::new(-7.0 + middle.x, 20.0 - middle.y, 30.0 + middle.z);
        let centre_lps = DVec3::new(-ras.x, -ras.y, ras.z);
        std::fs::write(dir.path().join("ct.nii.gz"), gzip(&spec.bytes())).expect("written");
        (spec.values, spec.datatype) = (labels, 2);
        spec.write(&dir.path().join("labels.nii"));
        let top = centre_lps + DVec3::Z * RADIUS;
        let plan = format!(
            r#"{{"glenoid_centre": [{}, {}, {}], "glenoid_normal_outward": [0, 0, 1]}}"#,
            top.x, top.y, top.z
        );
        std::fs::write(dir.path().join("plan.json"), plan).expect("written");
        Self { dir, centre_lps }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn args(&self) -> SceneArgs {
        SceneArgs {
            bone: Some(self.path("ct.nii.gz")),
            labels: Some(self.path("labels.nii")),
            keep: vec![1],
            pose: Some(self.path("plan.json")),
            threshold: 400.0,
            ..SceneArgs::default()
        }
    }
}

pub(crate) fn quiet(args: &SceneArgs) -> Result<Scene, SceneError> {
    load(args, &mut |_, _| ())
}

/// RMS and largest |distance| that the bone shows on the planted ball.
fn ball_error(scene: &Scene, centre_lps: DVec3) -> (f64, f64) {
    let bone_from_lps = scene.bone.lps_from_bone().inverse();
    let errors: Vec<f64> = directions(4000)
        .map(|d| solid_at(&scene.bone, bone_from_lps.point(centre_lps + d * RADIUS)))
        .collect();
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    let max = errors.iter().fold(0.0, |m: f64, e| m.max(e.abs()));
    ((squares / errors.len() as f64).sqrt(), max)
}

#[test]
fn a_planted_ball_is_found_where_it_is_with_and_without_labels_and_resampled() {
    let files = Files::new();
    for (labelled, voxel_mm) in [
        (true, None),
        (false, None),
        (true, Some(0.5)),
        (true, Some(1.3)),
    ] {
        let mut args = files.args();
        args.voxel_mm = voxel_mm;
        if !labelled {
            (args.labels, args.keep) = (None, Vec::new());
        }
        let scene = quiet(&args).expect("a scene");
        let (rms, max) = ball_error(&scene, files.centre_lps);
        let volume = scene.summary.solid_mm3;
        let planted = 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
        println!(
            "labels {labelled} h {voxel_mm:?}: rms {rms:.4} max {max:.4} mm, volume {:+.2} %, {:?}",
            100.0 * (volume / planted - 1.0),
            scene.summary.resample_error
        );
        // flat pieces on a ball, at 1.3 mm twice over
        assert!(rms < 0.07 && max < 0.2);
        assert!((volume / planted - 1.0).abs() < 0.02);
        assert_eq!(scene.kept_labels, if labelled { vec![1] } else { vec![] });
        if let Some(error) = &scene.summary.resample_error {
            assert!(error.surface_points > 1000 && error.surface_rms_mm < 0.06);
            assert!(error.hu_rms.is_some_and(|e| e > 0.0 && e < 60.0));
        }
        let top = scene
            .bone
            .lps_from_bone()
            .point(scene.bone_from_plan.translation);
        assert!(top.distance(files.centre_lps + DVec3::Z * RADIUS) < 1e-4);
        assert!(scene.bone_from_plan.vector(DVec3::Z).distance(DVec3::Z) < 1e-6);
    }
}

#[test]
fn tissue_classes_follow_the_plan() {
    let files = Files::new();
    let mut args = files.args();
    args.threshold = 300.0;
    let scene = quiet(&args).expect("a scene");
    let bone_from_lps = scene.bone.lps_from_bone().inverse();
    let class = |height: f64| {
        let p = bone_from_lps.point(files.centre_lps + DVec3::Z * height);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "inside the lattice"
        )]
        let at = (p / scene.bone.grid().spacing_mm)
            .round()
            .to_array()
            .map(|v| v as usize);
        let (chunk, voxel) = scene.bone.locate(at).expect("a chunk");
        scene.bone.chunk(chunk).class[voxel]
    };
    assert_eq!(class(RADIUS - 1.5), Tissue::Subchondral as u8);
    assert_eq!(class(RADIUS - 4.5), Tissue::Cortical as u8);
    assert_eq!(class(-RADIUS + 1.5), Tissue::Cortical as u8);
    assert_eq!(class(RADIUS + 2.5), Tissue::Air as u8);
}

fn refused(args: &SceneArgs) -> String {
    let outcome = quiet(args).map(|scene| scene.summary);
    let error = outcome.expect_err("must be refused").to_string();
    assert!(!error.contains('\n'), "{error}");
    println!("{error}");
    error
}

#[test]
fn bad_input_is_one_line_with_what_where_and_the_remedy() {
    let files = Files::new();
    let with = |change: &dyn Fn(&mut SceneArgs)| {
        let mut args = files.args();
        change(&mut args);
        refused(&args)
    };
    assert!(with(&|a| a.pose = None).contains("ct.nii.gz: a CT needs a plan; give --pose"));
    assert!(with(&|a| a.threshold = 950.0).contains("no bone above 950 HU in labels [1]"));
    assert!(with(&|a| a.threshold = f32::NAN).contains("--threshold NaN HU"));
    assert!(
        with(&|a| a.keep = vec![7])
            .contains("labels.nii: no voxel has label 7; --keep one of: 1, 2")
    );
    assert!(with(&|a| a.labels = None).contains("--keep needs --labels"));
    assert!(with(&|a| a.bone = None).contains("--labels needs --bone"));
    assert!(with(&|a| a.voxel_mm = Some(0.0)).contains("--voxel-mm 0"));
    assert!(with(&|a| a.bone = Some(files.path("no.nii"))).contains("no.nii: cannot be read"));
    assert!(with(&|a| a.pose = Some(files.path("labels.nii"))).contains("labels.nii: cannot be"));

    let far = r#"{"glenoid_centre": [900, 0, 0], "glenoid_normal_outward": [0, 0, 1]}"#;
    std::fs::write(files.path("far.json"), far).expect("written");
    assert!(with(&|a| a.pose = Some(files.path("far.json"))).contains("mm outside the bone"));

    let other = |name: &str, dims: [i16; 3], x: f32| {
        let count: usize = dims
            .iter()
            .map(|&n| usize::from(n.unsigned_abs()))
            .product();
        let mut spec = Spec::new(dims, [0.8, 0.8, 1.0], Vec::new());
        spec.values = vec![1.0; count];
        spec.sform = Some([
            [0.8, 0.0, 0.0, x],
            [0.0, -0.8, 0.0, 20.0],
            [0.0, 0.0, 1.0, 30.0],
        ]);
        spec.write(&files.path(name));
        with(&|a| a.labels = Some(files.path(name)))
    };
    let dims = other("dims.nii", [39, 38, 36], -7.0);
    assert!(dims.contains("dims.nii: not on the grid of") && dims.contains("ct.nii.gz"));
    assert!(other("moved.nii", [40, 38, 36], -6.9).contains("affines differ by 0.1"));
}

#[test]
fn the_phantom_needs_no_file_and_its_lattice_follows_the_voxel_size() {
    let scene = quiet(&SceneArgs {
        voxel_mm: Some(1.6),
        ..SceneArgs::default()
    })
    .expect("a scene");
    assert_eq!(scene.kept_labels, [phantom::LABEL]);
    assert!((scene.bone.grid().spacing_mm - 1.6).abs().max_element() < 1e-12);
}

/// A folder of the real data; `None`, said aloud, where there is none.
pub(crate) fn real_data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("OSTEON_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let dir = root.join(name);
    if dir.is_dir() {
        return Some(dir);
    }
    eprintln!("SKIPPED: no data at {}; set OSTEON_DATA", dir.display());
    None
}

fn data() -> Option<PathBuf> {
    real_data("lidc0314_shoulders")
}

fn real_args(dir: &Path) -> SceneArgs {
    SceneArgs {
        bone: Some(dir.join("right_shoulder_ct.nii.gz")),
        labels: Some(dir.join("right_shoulder_labels.nii.gz")),
        keep: vec![1],
        pose: Some(dir.join("right_glenoid_pose.json")),
        threshold: 120.0,
        ..SceneArgs::default()
    }
}

/// Corners of a binary STL's triangles, mm.
fn stl_vertices(path: &Path) -> Vec<DVec3> {
    let bytes = std::fs::read(path).expect("readable");
    let (triangles, _) = bytes[84..].as_chunks::<50>();
    let number = |t: &[u8; 50], at: usize| {
        f64::from(f32::from_le_bytes([t[at], t[at + 1], t[at + 2], t[at + 3]]))
    };
    triangles
        .iter()
        .flat_map(|t| {
            [12, 24, 36].map(|at| DVec3::new(number(t, at), number(t, at + 4), number(t, at + 8)))
        })
        .collect()
}

/// Mean and RMS of the distance that the bone shows at the mesh's vertices, mm.
fn mesh_error(scene: &Scene, vertices: &[DVec3]) -> (f64, f64) {
    let bone_from_lps = scene.bone.lps_from_bone().inverse();
    let errors: Vec<f64> = vertices
        .iter()
        .map(|&v| solid_at(&scene.bone, bone_from_lps.point(v)))
        .collect();
    let count = errors.len() as f64;
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    (errors.iter().sum::<f64>() / count, (squares / count).sqrt())
}

/// The mesh was made from the label alone, which was made at 200 HU: there it must agree. A lower
/// threshold lies farther out in the partial volume; the volume must grow by that shift times the
/// mesh's area.
#[test]
fn the_real_scapula_has_its_known_volume_and_surface_and_nothing_of_its_neighbours() {
    let Some(dir) = data() else { return };
    let vertices = stl_vertices(&dir.join("right_scapula_surface_40k.stl"));
    assert_eq!(vertices.len(), 120_000);
    let area: f64 = vertices
        .chunks_exact(3)
        .map(|t| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length())
        .sum();
    for (threshold, voxel_mm) in [(200.0, None), (120.0, None), (120.0, Some(0.5))] {
        let mut args = real_args(&dir);
        (args.threshold, args.voxel_mm) = (threshold, voxel_mm);
        let begun = Instant::now();
        let scene = quiet(&args).expect("a scene");
        let took = begun.elapsed();
        let (mean, rms) = mesh_error(&scene, &vertices);
        let volume = scene.summary.solid_mm3;
        println!(
            "{threshold} HU, h {voxel_mm:?}: {took:.2?}, mesh vertices rms {rms:.3} mm, mean \
             {mean:+.3} mm, volume {:+.1} %; {:?}",
            100.0 * (volume / MESH_MM3 - 1.0),
            scene.summary
        );
        assert!((volume / (MESH_MM3 + mean * area) - 1.0).abs() < 0.02);
        assert!(rms < 0.3);
        if threshold > 199.0 {
            assert!((volume / MESH_MM3 - 1.0).abs() < 0.03 && rms < 0.16);
        }
        if let Some(error) = &scene.summary.resample_error {
            // specks of the noisy rim are lost on another lattice: they make the maximum
            assert!(
                error.surface_rms_mm < 0.1 && error.surface_p99_mm < 0.3,
                "{error:?}"
            );
        }
        let (other, own) = occupied(&scene);
        assert_eq!(other, 0, "voxels of excluded structures with an occupancy");
        assert!(own > 50_000);
    }
    let mut args = real_args(&dir);
    args.threshold = 3000.0;
    assert!(refused(&args).contains("no bone above 3000 HU in labels [1]"));
}

/// Voxels with an occupancy: of other labels than 0 and 1, and of label 1.
fn occupied(scene: &Scene) -> (usize, usize) {
    let occupancy = Occupancy::new(scene.bone.grid());
    let (mut other, mut own) = (0, 0);
    for chunk in 0..scene.bone.chunk_count() {
        let data = scene.bone.chunk(chunk);
        for voxel in (0..CHUNK_VOXELS).filter(|&v| occupancy.units(data.solid[v]) > 0) {
            match data.label[voxel] {
                0 => {}
                1 => own += 1,
                _ => other += 1,
            }
        }
    }
    (other, own)
}
