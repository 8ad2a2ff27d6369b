use super::*;
use glam::{DQuat, DVec3, Vec3};
use osteon_sim_core::bone::DenseBone;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::tool::{Tool, ToolBox};

/// A bone that is solid where `inside` (mm, positive inside, by the voxel's centre in mm) says so.
fn bone(dims: [usize; 3], spacing: DVec3, inside: impl Fn(DVec3) -> f64) -> Bone {
    let grid = Grid::new(dims, spacing).expect("a grid");
    let mut solid_mm = Vec::with_capacity(grid.len());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                #[expect(clippy::cast_possible_truncation, reason = "f32 is the field's")]
                solid_mm.push(inside(grid.centre(i, j, k)) as f32);
            }
        }
    }
    // some below the thesis's threshold, some air that is denser
    let density_hu: Vec<i16> = (0..1700).cycle().take(grid.len()).collect();
    let zeros = vec![0u8; grid.len()];
    let dense = DenseBone {
        density_hu: &density_hu,
        solid_mm: &solid_mm,
        class: &zeros,
        label: &zeros,
    };
    Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone")
}

fn block(dims: [usize; 3], h: f64) -> Bone {
    bone(dims, DVec3::splat(h), |_| 1.0)
}

/// Rods and holes of some millimetres, with empty chunks beside it.
fn sponge(spacing: DVec3) -> Bone {
    bone([100, 75, 70], spacing, |p| {
        let holes = (0.9 * p.x).sin() + (1.1 * p.y).sin() + (0.7 * p.z).sin() + 0.8;
        holes.min(22.0 - p.y)
    })
}

fn reamer() -> VoxelTool {
    VoxelTool::of_shape(THESIS_VOXEL_MM, Tool::glenoid_reamer().shape).expect("a tool")
}

fn drill() -> VoxelTool {
    VoxelTool::of_shape(THESIS_VOXEL_MM, Tool::peg_drill().shape).expect("a tool")
}

fn ball(size_mm: f64) -> VoxelTool {
    let bounds = ToolBox {
        lo: DVec3::splat(-6.0),
        hi: DVec3::splat(6.0),
    };
    VoxelTool::new(size_mm, bounds, |p| p.length() - 6.0).expect("a tool")
}

/// Poses all over and around a bone, some beyond its edges, a step back in between.
fn poses(bone: &Bone) -> Vec<Pose> {
    let (lo, hi) = bone.bounds();
    (0..12u8)
        .map(|n| {
            let t = f64::from(n);
            let at = DVec3::new(0.37 * t, 0.61 * t, 0.83 * t).fract() * 1.2 - 0.1;
            let axis = DVec3::new((3.0 * t).sin(), (5.0 * t).cos(), 0.4).normalize_or_zero();
            Pose::new(DQuat::from_axis_angle(axis, 2.0 * t), lo + at * (hi - lo))
        })
        .collect()
}

fn voxels(bone: &Bone) -> impl Iterator<Item = [usize; 3]> {
    let [nx, ny, nz] = bone.grid().dims;
    (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
}

fn removed(bone: &Bone, method: &dyn Baseline) -> u64 {
    voxels(bone).map(|v| u64::from(method.is_removed(v))).sum()
}

/// Both remove as many voxels in every event, and the same ones in the end.
fn same(bone: &Bone, poses: &[Pose], a: &mut dyn Baseline, b: &mut dyn Baseline) {
    let mut sum = 0;
    for pose in poses {
        let cut = a.event(pose);
        assert_eq!(b.event(pose), cut, "{} {}", a.name(), b.name());
        sum += cut;
    }
    assert!(sum > 1000, "{} removes only {sum}", a.name());
    assert_eq!(removed(bone, a), sum, "{}", a.name());
    for voxel in voxels(bone) {
        assert_eq!(
            a.is_removed(voxel),
            b.is_removed(voxel),
            "{} {} at {voxel:?}",
            a.name(),
            b.name()
        );
    }
}

/// Runs `check` for bones and tools of several kinds.
fn for_each_scene(check: impl Fn(&Bone, &VoxelTool, &[Pose])) {
    for spacing in [DVec3::splat(0.47), DVec3::new(0.47, 0.52, 1.0)] {
        let bone = sponge(spacing);
        for tool in [reamer(), drill(), ball(0.3)] {
            check(&bone, &tool, &poses(&bone));
        }
    }
}

#[test]
fn the_grid_of_alg_2_1_is_that_of_table_3_5() {
    // a hemisphere of Ø 36 mm with 2.5 mm of cylinder above: the thesis's reamer
    let head = |p: Vec3| {
        let below = Vec3::new(p.x, p.y, (p.z - 18.0).min(0.0));
        (below.length() - 18.0).max(p.z - 20.5)
    };
    let bounds = ToolBox {
        lo: DVec3::new(-18.0, -18.0, 0.0),
        hi: DVec3::new(18.0, 18.0, 20.5),
    };
    // 38·38·23, 50·50·30 and 74·73·43 in the thesis, whose mesh is not quite round
    let grids = [
        (1.0, [38, 38, 23]),
        (0.75, [50, 50, 30]),
        (0.5, [74, 74, 44]),
    ];
    let mm3 = core::f64::consts::PI * 18.0 * 18.0 * (12.0 + 2.5);
    for (size, dims) in grids {
        let tool = VoxelTool::new(size, bounds, head).expect("a tool");
        assert_eq!(tool.dims(), dims, "{size} mm");
        let solid = tool.solid().len() as f64 * size.powi(3);
        // a layer whose centres lie on the top face is missing
        assert!((solid / mm3 - 1.0).abs() < 0.04, "{solid} mm³ of {mm3}");
        assert!(4 * tool.surface().len() < 3 * tool.solid().len());
        let ones: u32 = tool.bits().iter().map(|w| w.count_ones()).sum();
        assert_eq!(ones as usize, tool.solid().len());
        let reach = tool.grid_box();
        assert!((reach.lo + size).cmple(bounds.lo).all());
        assert!((reach.hi - 0.5 * size).cmpge(bounds.hi).all());
    }
}

#[test]
fn nonsense_is_no_tool_and_removes_nothing() {
    let bounds = ball(0.5).bounds();
    for size in [0.0, -1.0, f64::NAN, f64::INFINITY, 0.011] {
        assert!(VoxelTool::new(size, bounds, |_| 0.0).is_none(), "{size}");
    }
    let turned = ToolBox {
        lo: bounds.hi,
        hi: bounds.lo,
    };
    assert!(VoxelTool::new(0.5, turned, |_| 0.0).is_none());
    // larger than its box says
    let cut_off = VoxelTool::new(0.5, bounds, |_| -1.0).expect("a tool");
    let inner: usize = cut_off.dims().iter().map(|n| n - 2).product();
    assert_eq!(cut_off.solid().len(), inner);
    let (bone, tool) = (sponge(DVec3::splat(0.47)), ball(0.5));
    let nan = Pose::new(DQuat::IDENTITY, DVec3::splat(f64::NAN));
    let far = Pose::new(DQuat::IDENTITY, DVec3::splat(1e6));
    for mut method in all(&bone, &tool) {
        assert_eq!(method.event(&nan) + method.event(&far), 0);
        assert!(!method.is_removed([usize::MAX; 3]));
    }
}

#[test]
fn the_names_are_those_of_the_table_and_each_says_whose_it_is() {
    let (bone, tool) = (sponge(DVec3::splat(0.47)), ball(0.5));
    let all = all(&bone, &tool);
    let names: Vec<_> = all.iter().map(|m| m.name()).collect();
    let expected = "thesis-16 thesis-32 thesis-64 thesis-32-simd reza zheng yau octree";
    assert_eq!(names.join(" "), expected);
    for method in all {
        assert!(method.theirs().len() > 40 && method.inferred().len() > 40);
        assert!(method.bytes() > 1000);
    }
}

#[test]
fn wide_scans_remove_the_scalar_scans_voxels() {
    for isa in [Isa::Scalar, Isa::Avx2, Isa::Avx512] {
        if !isa.is_here() {
            crate::skipped(&format!("scans on {isa:?}: this machine has none"));
            continue;
        }
        for_each_scene(|bone, tool, poses| {
            let mut wide = Thesis::simd_on(isa, bone, tool);
            assert_eq!(wide.isa(), isa);
            same(
                bone,
                poses,
                &mut Thesis::chunks_of_32(bone, tool),
                &mut wide,
            );
        });
    }
}

#[test]
fn the_size_of_chunks_and_the_octree_change_no_voxel() {
    for_each_scene(|bone, tool, poses| {
        let mut chunks = Thesis::chunks_of_32(bone, tool);
        same(
            bone,
            poses,
            &mut Thesis::chunks_of_16(bone, tool),
            &mut chunks,
        );
        chunks.restore();
        same(
            bone,
            poses,
            &mut Thesis::chunks_of_64(bone, tool),
            &mut chunks,
        );
        chunks.restore();
        same(bone, poses, &mut Octree::new(bone, tool), &mut chunks);
    });
}

#[test]
fn an_implicit_tool_on_an_octree_is_brute_force_and_the_truth() {
    for_each_scene(|bone, tool, poses| {
        let mut brute = Brute::new(bone, tool);
        same(bone, poses, &mut Yau::new(bone, tool), &mut brute);
        let truth = Truth::new(bone, tool, poses);
        let errors = truth.errors(&brute);
        assert_eq!((errors.missed, errors.excess), (0, 0));
        assert_eq!(
            (errors.truly, errors.removed),
            (truth.count(), removed(bone, &brute))
        );
    });
}

#[test]
fn culling_the_tools_layers_loses_no_voxel() {
    for_each_scene(|bone, tool, poses| {
        let mut zheng = Zheng::new(bone, tool);
        same(bone, poses, &mut Reza::surface(bone, tool), &mut zheng);
    });
}

#[test]
fn a_restored_bone_is_cut_the_same_again() {
    let (bone, tool) = (sponge(DVec3::splat(0.47)), reamer());
    let poses = poses(&bone);
    let truth = Truth::new(&bone, &tool, &poses);
    for mut method in all(&bone, &tool) {
        let mut run = || {
            let cut: Vec<u64> = poses.iter().map(|pose| method.event(pose)).collect();
            let again: u64 = poses.iter().map(|pose| method.event(pose)).sum();
            assert_eq!(again, 0, "{}", method.name());
            let errors = truth.errors(&*method);
            let sum: u64 = cut.iter().sum();
            assert_eq!(removed(&bone, &*method), sum, "{}", method.name());
            // none lies beyond where the errors are looked for
            assert_eq!(errors.removed, sum, "{}", method.name());
            method.restore();
            assert_eq!(removed(&bone, &*method), 0, "{}", method.name());
            (cut, errors)
        };
        assert_eq!(run(), run());
    }
}

#[test]
fn a_standing_tool_tells_the_methods_apart() {
    let bone = block([110, 110, 50], 0.47);
    let tilt = DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 0.2);
    let pose = [Pose::new(tilt, DVec3::new(26.0, 25.0, 8.0))];
    let tool = reamer();
    let truth = Truth::new(&bone, &tool, &pose);
    let errors = |mut method: Box<dyn Baseline + '_>| {
        method.event(&pose[0]);
        let errors = truth.errors(&*method);
        (errors.missed_fraction(), errors.excess_fraction())
    };
    let (missed, excess) = errors(Box::new(Thesis::chunks_of_32(&bone, &tool)));
    assert!((0.001..0.05).contains(&missed), "{missed}");
    assert!((0.001..0.05).contains(&excess), "{excess}");
    // a shell of half a millimetre: the inside stays
    let (missed, _) = errors(Box::new(Reza::surface(&bone, &tool)));
    assert!((0.5..0.95).contains(&missed), "{missed}");
    // 0.5 mm points into 0.47 mm voxels: about one of five is skipped
    let (missed, _) = errors(Box::new(Reza::solid(&bone, &tool)));
    assert!((0.1..0.3).contains(&missed), "{missed}");
}

#[test]
fn half_millimetre_points_leave_a_comb_in_finer_bone() {
    let (bone, tool) = (block([64; 3], 0.25), ball(0.5));
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.5);
    let pose = [Pose::new(turn, DVec3::splat(7.9))];
    let mut method = Reza::solid(&bone, &tool);
    method.event(&pose[0]);
    let errors = Truth::new(&bone, &tool, &pose).errors(&method);
    // one point for eight voxels
    let left = errors.missed_fraction();
    assert!((0.85..0.9).contains(&left), "{left}");
}

#[test]
fn tool_voxels_set_a_floor_to_the_surface_error() {
    let mut floors = Vec::new();
    for h in [0.5, 0.25] {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small lattice"
        )]
        let (bone, tool) = (block([(16.0 / h) as usize; 3], h), ball(0.5));
        let (mut thesis, mut exact) = (0.0, 0.0);
        for n in 0..6u8 {
            let t = f64::from(n);
            let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), t);
            let pose = Pose::new(turn, DVec3::new(7.9, 8.0 + 0.07 * t, 8.1 - 0.11 * t));
            let error = |method: &mut dyn Baseline| {
                method.event(&pose);
                let error = surface_error(&bone, &tool, &pose, method, &|_| true);
                assert!(error.faces > 1000 && error.max_mm > error.rms_mm);
                error.rms_mm / 6.0
            };
            thesis += error(&mut Thesis::chunks_of_32(&bone, &tool));
            exact += error(&mut Brute::new(&bone, &tool));
        }
        assert!(thesis >= 0.1, "{thesis} mm at {h}");
        // a voxel's own coarseness goes with h
        assert!((0.2..0.35).contains(&(exact / h)), "{exact} mm at {h}");
        floors.push(thesis);
    }
    assert!(floors[1] > 0.6 * floors[0], "no floor: {floors:?}");
    // the filter leaves out what it is told to
    let (bone, tool) = (block([32; 3], 0.5), ball(0.5));
    let pose = Pose::new(DQuat::IDENTITY, DVec3::splat(8.0));
    let mut brute = Brute::new(&bone, &tool);
    brute.event(&pose);
    let half = surface_error(&bone, &tool, &pose, &brute, &|p| p.x > 0.0);
    let whole = surface_error(&bone, &tool, &pose, &brute, &|_| true);
    assert!(half.faces > 0 && 2 * half.faces <= whole.faces + 300);
    assert_eq!(
        surface_error(&bone, &tool, &pose, &brute, &|_| false).faces,
        0
    );
}
