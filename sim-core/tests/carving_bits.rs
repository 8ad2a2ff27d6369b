//! Carved bits: every vector unit against a scalar formula and against `f64`.

#![expect(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    clippy::panic,
    reason = "a test that shows its figures; radii are f32"
)]

mod common;

use common::random::{Random, grown_distance, random_solid, tool_of, touching};
use common::{bone_of, brute, shapes};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, Carving, Isa};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::mesh::Mesh;
use osteon_sim_core::tool::patches::TOLERANCE_MM;
use osteon_sim_core::tool::revolved::Revolved;
use osteon_sim_core::tool::sdf_grid::{SdfGrid, one_by_one};
use osteon_sim_core::tool::{Shape, Tool};
use std::sync::Arc;

fn units() -> impl Iterator<Item = Carving> {
    (Isa::ALL.into_iter().filter(|isa| isa.is_available())).map(|isa| Carving {
        isa,
        ..Carving::best()
    })
}

fn still(pose: Pose) -> CarveStep {
    CarveStep {
        tool: 0,
        before: pose,
        after: pose,
    }
}

/// A small bone of random size, spacing and place of its surface.
fn random_bone(random: &mut Random) -> Arc<Bone> {
    let dims = [(); 3].map(|()| 6 + random.below(36));
    let even = random.within(0.2, 1.2);
    let spacing = if random.below(3) == 0 {
        DVec3::splat(even)
    } else {
        DVec3::from_array([(); 3].map(|()| random.within(0.2, 1.2)))
    };
    let far = DVec3::from_array(dims.map(|n| n as f64)) * spacing;
    if random.below(2) == 0 {
        let (normal, middle) = (random.direction(), 0.5 * far);
        bone_of(dims, spacing, 1.0, |p| 1.0 - (p - middle).dot(normal))
    } else {
        let radius = 0.5 * far.length();
        bone_of(dims, spacing, 1.0, |p| radius - (p - 0.3 * far).length())
    }
}

/// What the values of a scene were off by against `f64`, stored units.
#[derive(Default)]
struct Oracle {
    voxels: u64,
    // everywhere; and where the square of r has room to be rounded
    worst: f64,
    worst_off_axis: f64,
}

/// The account of every step against the difference of the first state and the last.
fn account_is_right(bone: &Bone, cut: &Cut) {
    let whole = Cut::new(bone);
    let lost = |c| whole.solid_units(bone, c) - cut.solid_units(bone, c);
    let lost: i64 = (0..bone.chunk_count()).map(lost).sum();
    assert_eq!(cut.totals().by_tool[0], lost);
}

/// Carves poses one after the other with every unit and compares each voxel.
fn compare(bone: &Bone, tool: &Tool, poses: &[Pose], oracle: &mut Oracle) {
    let cuts: Vec<Cut> = units()
        .map(|carving| {
            let mut cut = Cut::new(bone);
            for pose in poses {
                carving.carve(bone, &mut cut, tool, &still(*pose), &mut |_, _| {});
            }
            cut
        })
        .collect();
    assert!(cuts.iter().all(|c| c.totals() == cuts[0].totals()));
    account_is_right(bone, &cuts[0]);
    let grid = bone.grid();
    let quantum = f64::from(grid.quantum_mm());
    let bounds = tool.shape.bounds();
    let reach = bounds.lo.abs().max(bounds.hi.abs()).length() / quantum;
    // what a smooth piece of a sampled tool may be from the samples
    let smooth = match tool.shape {
        Shape::Grid(_) => f64::from(TOLERANCE_MM) / quantum,
        Shape::Revolved(_) => 0.0,
    };
    for chunk in 0..bone.chunk_count() {
        let mut truth = brute::uncut();
        for pose in poses {
            let tool_from_bone = pose.inverse();
            brute::lower(
                bone,
                chunk,
                &mut truth,
                (&tool.shape, pose),
                |[i, j, k], v| {
                    let p = tool_from_bone.point(grid.centre(i, j, k));
                    let exact =
                        grown_distance(&tool.shape, grid.mean_square_spacing(), p) / quantum;
                    let exact = exact.clamp(-32767.0, 32767.0);
                    if exact.abs() >= 32767.0 && exact as i16 == v {
                        return;
                    }
                    let off = (exact - f64::from(v)).abs() - 1e-6 * reach - smooth;
                    oracle.voxels += 1;
                    oracle.worst = oracle.worst.max(off);
                    if p.truncate().length() > 1.5 * grid.spacing_mm.max_element() {
                        oracle.worst_off_axis = oracle.worst_off_axis.max(off);
                    }
                },
            );
        }
        for (cut, carving) in cuts.iter().zip(units()) {
            let differs = (0..truth.len()).find(|&n| cut.value(chunk, n) != truth[n]);
            if let Some(n) = differs {
                let (got, want) = (cut.value(chunk, n), truth[n]);
                let at = brute::place(bone.chunk_coord(chunk), n);
                panic!(
                    "{} {at:?}: {got}, formula {want}\n{:?}\n{poses:?}\n{grid:?}",
                    carving.isa.name(),
                    tool.shape
                );
            }
        }
    }
}

#[test]
fn a_thousand_scenes_of_faces_are_the_formula_bit_for_bit_on_every_unit() {
    let mut random = Random(1);
    let mut oracle = Oracle::default();
    for _ in 0..350 {
        let bone = random_bone(&mut random);
        let far = bone.grid().centre(
            bone.grid().dims[0] - 1,
            bone.grid().dims[1] - 1,
            bone.grid().dims[2] - 1,
        );
        let h = bone.grid().spacing_mm.max_element();
        for _ in 0..3 {
            let voxels = 4.0 * 50.0f64.powf(random.within(0.0, 1.0));
            let solid = random_solid(&mut random, (voxels * h).min(240.0));
            let tool = tool_of(solid);
            let poses = [(); 2].map(|()| {
                let place = far * (DVec3::splat(0.5) + random.vector(0.5));
                touching(&mut random, &tool.shape, place)
            });
            compare(&bone, &tool, &poses, &mut oracle);
        }
    }
    println!(
        "{} values; against f64 at worst {:.2} units off the axis, {:.2} anywhere",
        oracle.voxels, oracle.worst_off_axis, oracle.worst
    );
    assert!(oracle.voxels > 1_000_000, "{}", oracle.voxels);
    assert!(oracle.worst_off_axis <= 2.0, "{}", oracle.worst_off_axis);
    // on the axis r is the root of a difference of squares, each of a chunk's radius
    assert!(oracle.worst <= 64.0, "{}", oracle.worst);
}

#[test]
fn what_the_stamp_before_leaves_to_do_is_done() {
    // a tool that wobbles, advances, retreats and stands: what is passed over because the last stamp
    // lies deeper must be no value of the formula
    let mut random = Random(4);
    let mut oracle = Oracle::default();
    for _ in 0..60 {
        let bone = random_bone(&mut random);
        let dims = bone.grid().dims;
        let far = bone.grid().centre(dims[0] - 1, dims[1] - 1, dims[2] - 1);
        let h = bone.grid().spacing_mm.max_element();
        let voxels = 4.0 * 50.0f64.powf(random.within(0.0, 1.0));
        let solid = random_solid(&mut random, (voxels * h).min(240.0));
        let tool = tool_of(solid);
        let place = far * (DVec3::splat(0.5) + random.vector(0.3));
        let mut poses = vec![touching(&mut random, &tool.shape, place)];
        for _ in 0..6 {
            let last = poses[poses.len() - 1];
            let size = h * 0.3 * 1e-4f64.powf(random.within(0.0, 1.0));
            let step = random.vector(size);
            let bounds = tool.shape.bounds();
            let reach = bounds.lo.abs().max(bounds.hi.abs()).length();
            let turn = glam::DQuat::from_scaled_axis(random.vector(size / reach));
            poses.push(match random.below(4) {
                // the same again
                0 => last,
                // along the axis
                1 => Pose::new(
                    last.rotation,
                    last.translation + last.vector(DVec3::Z) * step.z,
                ),
                _ => Pose::new(turn * last.rotation, last.translation + step),
            });
        }
        compare(&bone, &tool, &poses, &mut oracle);
    }
    println!("{} values", oracle.voxels);
    assert!(oracle.worst_off_axis <= 2.0, "{}", oracle.worst_off_axis);
}

#[test]
fn plans_stand_while_the_tool_creeps_and_fall_when_it_has_gone_too_far() {
    // a slow drift with a wobble: chunks keep their plans for some steps, each for another number of them
    let mut random = Random(5);
    let mut oracle = Oracle::default();
    for _ in 0..40 {
        let bone = random_bone(&mut random);
        let dims = bone.grid().dims;
        let far = bone.grid().centre(dims[0] - 1, dims[1] - 1, dims[2] - 1);
        let h = bone.grid().spacing_mm.min_element();
        let voxels = 4.0 * 50.0f64.powf(random.within(0.0, 1.0));
        let tool = tool_of(random_solid(&mut random, (voxels * h).min(240.0)));
        let bounds = tool.shape.bounds();
        let reach = bounds.lo.abs().max(bounds.hi.abs()).length();
        let place = far * (DVec3::splat(0.5) + random.vector(0.3));
        let mut poses = vec![touching(&mut random, &tool.shape, place)];
        let size = h * 0.06 * 0.02f64.powf(random.within(0.0, 1.0));
        let drift = random.direction() * size;
        let turn = random.vector(size / reach);
        for n in 0..30 {
            let last = poses[poses.len() - 1];
            // to and fro: the second half of the way back is cut already
            let sign = if n % 20 < 13 { 1.0 } else { -1.0 };
            let step = sign * drift + random.vector(0.2 * size);
            let turn = glam::DQuat::from_scaled_axis(sign * turn);
            poses.push(Pose::new(turn * last.rotation, last.translation + step));
        }
        compare(&bone, &tool, &poses, &mut oracle);
    }
    println!("{} values", oracle.voxels);
    assert!(oracle.worst_off_axis <= 2.0, "{}", oracle.worst_off_axis);
}

#[test]
fn balls_about_voxels_and_middles_of_boxes_are_the_formula() {
    // at a ball's centre the square of the distance is a difference of large numbers: it may come
    // out below zero
    let mut random = Random(3);
    let mut oracle = Oracle::default();
    for _ in 0..4 {
        let spacing = DVec3::from_array([(); 3].map(|()| random.within(0.2, 1.2)));
        let bone = bone_of([40, 36, 34], spacing, 1.0, |_| 5.0);
        for _ in 0..40 {
            let radius = random.within(0.5, 8.0) * spacing.min_element();
            let tool = tool_of(Revolved::ball(radius as f32));
            let poses = [(); 2].map(|()| {
                let voxel = [40, 36, 34].map(|n| random.below(n) as f64);
                let brick = [3, 3, 3].map(|n| 8.0 * random.below(n) as f64);
                let at = match random.below(4) {
                    0 => DVec3::from_array(voxel),
                    // the middle of a brick, of a line, and the last voxel of a chunk
                    1 => DVec3::from_array(brick) + 3.5,
                    2 => DVec3::from_array(brick) + DVec3::new(5.5, 1.5, 4.5),
                    _ => DVec3::splat(31.0),
                };
                Pose::new(random.rotation(), at * spacing)
            });
            compare(&bone, &tool, &poses, &mut oracle);
        }
    }
    println!("{} values, {:.2} units", oracle.voxels, oracle.worst);
    assert!(oracle.worst_off_axis <= 2.0, "{}", oracle.worst_off_axis);
    // the root of what the square is rounded by: 1 % of a voxel at the centre itself
    assert!(oracle.worst <= 300.0, "{}", oracle.worst);
}

#[test]
fn scenes_of_sampled_tools_are_the_formula_bit_for_bit_on_every_unit() {
    let mut random = Random(2);
    let mut oracle = Oracle::default();
    let outlines = [
        shapes::sphere(5.0, 3),
        shapes::lathe(&[[0.0, 0.0], [4.0, 2.4], [4.0, 14.0], [0.0, 14.0]], 24),
    ];
    let tools = outlines.map(|triangles| {
        let mesh = Mesh::new(triangles).expect("a mesh");
        let grid = SdfGrid::new(&mesh, Some(0.4), &one_by_one).expect("a grid");
        Tool {
            shape: Shape::Grid(Arc::new(grid)),
            ..Tool::peg_drill()
        }
    });
    for n in 0..60 {
        let bone = random_bone(&mut random);
        let dims = bone.grid().dims;
        let far = bone.grid().centre(dims[0] - 1, dims[1] - 1, dims[2] - 1);
        let tool = &tools[n % 2];
        let poses = [(); 2].map(|()| {
            let place = far * (DVec3::splat(0.5) + random.vector(0.5));
            touching(&mut random, &tool.shape, place)
        });
        compare(&bone, tool, &poses, &mut oracle);
    }
    println!("{} values, {:.2} units", oracle.voxels, oracle.worst);
    assert!(oracle.voxels > 20_000, "{}", oracle.voxels);
    // the trilinear reading of a grid is f32: a rounding of the place, in mm
    assert!(oracle.worst <= 2.0, "{}", oracle.worst);
}
