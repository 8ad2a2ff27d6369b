//! Carving in pieces, in any order, across chunk borders; and what the account says of it.

#![expect(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::expect_used,
    reason = "small numbers become bytes and indices"
)]

mod common;

use common::motley::{motley, random_step, tools};
use common::random::{Random, random_solid, tool_of, touching};
use common::{bone_of, brute};
use glam::DVec3;
use osteon_sim_core::bone::{Bone, Occupancy};
use osteon_sim_core::carve::{CarveStep, Carving, Progress, Work};
use osteon_sim_core::cut::{Cut, UNCUT};
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::fields;

fn assert_same(bone: &Bone, a: &Cut, b: &Cut) {
    for chunk in 0..bone.chunk_count() {
        assert_eq!(a.chunk_hash(chunk), b.chunk_hash(chunk), "chunk {chunk}");
    }
}

#[test]
fn any_partition_of_the_work_is_the_same_cut_and_account() {
    let mut random = Random(21);
    let bone = motley(&mut random);
    let tools = tools(&mut random);
    let middle = bone.grid().centre(22, 20, 19);
    let steps: Vec<CarveStep> = (0..60)
        .map(|_| random_step(&mut random, &tools, middle))
        .collect();
    let carving = Carving::best();
    let mut whole = Cut::new(&bone);
    for step in &steps {
        let tool = &tools[usize::from(step.tool)];
        carving.carve(&bone, &mut whole, tool, step, &mut |_, _| {});
    }
    let mut pauses = 0;
    for _ in 0..4 {
        let mut cut = Cut::new(&bone);
        for step in &steps {
            let tool = &tools[usize::from(step.tool)];
            let mut progress = Progress::default();
            loop {
                let given = 1 + random.below(100) as i64;
                let mut budget = given;
                let mut work = Work {
                    bone: &bone,
                    cut: &mut cut,
                    changed: &mut |_, _| {},
                };
                let done = carving.carve_some(&mut work, tool, step, (&mut progress, &mut budget));
                // a chunk is finished: 1,024 lines, its bricks' and its own bounds
                assert!(budget > -1200, "{budget}");
                if done {
                    break;
                }
                pauses += 1;
            }
        }
        assert_eq!(cut.digest(&bone), whole.digest(&bone));
        assert_eq!(cut.totals(), whole.totals());
    }
    assert!(pauses > 400, "{pauses}");
}

#[test]
fn any_order_and_repetition_is_the_same_cut_and_volume() {
    let mut random = Random(22);
    let bone = motley(&mut random);
    let tools = tools(&mut random);
    let middle = bone.grid().centre(22, 20, 19);
    let steps: Vec<CarveStep> = (0..60)
        .map(|_| random_step(&mut random, &tools, middle))
        .collect();
    let carved = |order: &[usize]| {
        let mut cut = Cut::new(&bone);
        for &n in order {
            let tool = &tools[usize::from(steps[n].tool)];
            Carving::best().carve(&bone, &mut cut, tool, &steps[n], &mut |_, _| {});
        }
        cut
    };
    let mut order: Vec<usize> = (0..steps.len()).collect();
    let reference = carved(&order);
    for _ in 0..4 {
        for n in 0..steps.len() {
            order.swap(n, random.below(steps.len()));
            order.push(random.below(steps.len()));
        }
        let cut = carved(&order);
        assert_same(&bone, &reference, &cut);
        // who took a voxel depends on the order, what was taken does not
        assert_eq!(reference.totals().by_class, cut.totals().by_class);
        assert_eq!(reference.totals().by_label, cut.totals().by_label);
    }
}

#[test]
fn after_thousands_of_steps_the_account_is_what_the_fields_have_lost() {
    let mut random = Random(23);
    let bone = motley(&mut random);
    let occupancy = Occupancy::new(bone.grid());
    let middle = bone.grid().centre(22, 20, 19);
    let before: i64 = (0..bone.chunk_count())
        .flat_map(|c| bone.chunk(c).solid)
        .map(|&d| occupancy.units(d))
        .sum();
    let mut cut = Cut::new(&bone);
    for round in 0..25 {
        let tools = tools(&mut random);
        for _ in 0..100 {
            let step = random_step(&mut random, &tools, middle);
            let tool = &tools[usize::from(step.tool)];
            Carving::best().carve(&bone, &mut cut, tool, &step, &mut |_, _| {});
        }
        let after: i64 = (0..bone.chunk_count())
            .map(|c| cut.solid_units(&bone, c))
            .sum();
        let totals = cut.totals();
        assert_eq!(totals.units(), before - after, "round {round}");
        assert_eq!(totals.by_tool.iter().sum::<i64>(), before - after);
        assert_eq!(totals.by_label.iter().sum::<i64>(), before - after);
        // and by kind, voxel by voxel
        let (mut class, mut label) = ([0; 8], [0; 256]);
        for chunk in 0..bone.chunk_count() {
            let data = bone.chunk(chunk);
            for (n, &solid) in data.solid.iter().enumerate() {
                let left = occupancy.units(solid.min(cut.value(chunk, n)));
                let lost = occupancy.units(solid) - left;
                class[usize::from(data.class[n])] += lost;
                label[usize::from(data.label[n])] += lost;
            }
        }
        assert_eq!(totals.by_class, class);
        assert_eq!(*totals.by_label, label);
        if round % 5 == 4 {
            cut.reset(round);
        }
    }
}

/// Reads the cut of a dense array as [`fields`] does, mm.
fn dense_reading(grid: &Grid, values: &[i16], p: DVec3) -> f32 {
    let index = p / grid.spacing_mm;
    let floor = index.floor();
    let f = (index - floor).as_vec3();
    let [i, j, k] = floor.to_array().map(|v| v as i64);
    let read = |dx: i64, dy: i64, dz: i64| {
        let at = [i + dx, j + dy, k + dz];
        let inside = (0..3).all(|a| (0..grid.dims[a] as i64).contains(&at[a]));
        let [x, y, z] = at.map(|v| v.unsigned_abs() as usize);
        f32::from(if inside {
            values[grid.dense_index(x, y, z)]
        } else {
            UNCUT
        })
    };
    let along = |dy, dz| {
        let (a, b) = (read(0, dy, dz), read(1, dy, dz));
        a + f.x * (b - a)
    };
    let face = |dz| {
        let (a, b) = (along(0, dz), along(1, dz));
        a + f.y * (b - a)
    };
    let (a, b) = (face(0), face(1));
    (a + f.z * (b - a)) * grid.quantum_mm()
}

/// Voxels that are cut; how far the values of one cut are at most from those of the other, `shift`
/// voxels farther on; and the same near the tool's axis.
fn apart(
    bone: &Bone,
    (cut, moved): (&Cut, &Cut),
    shift: [usize; 3],
    pose: &Pose,
) -> (u32, i32, i32) {
    let grid = bone.grid();
    let (mut compared, mut worst, mut on_axis) = (0, 0, 0);
    let tool_from_bone = pose.inverse();
    for z in 0..36 {
        for y in 20..45 {
            for x in 20..45 {
                let a = bone.locate([x, y, z]).expect("kept");
                let b = [x + shift[0], y + shift[1], z + shift[2]];
                let b = bone.locate(b).expect("kept");
                let (a, b) = (cut.value(a.0, a.1), moved.value(b.0, b.1));
                compared += u32::from(a != UNCUT);
                let apart = (i32::from(a) - i32::from(b)).abs();
                let p = tool_from_bone.point(grid.centre(x, y, z));
                if p.truncate().length() > 1.5 * 0.6 {
                    worst = worst.max(apart);
                } else {
                    on_axis = on_axis.max(apart);
                }
            }
        }
    }
    (compared, worst, on_axis)
}

#[test]
fn chunks_are_read_as_one_dense_lattice_and_their_alignment_is_no_matter() {
    let mut random = Random(24);
    let spacing = DVec3::new(0.5, 0.6, 0.55);
    let bone = bone_of([70, 70, 68], spacing, 1.0, |p| 24.0 - p.z);
    let grid = *bone.grid();
    for _ in 0..12 {
        let size = random.within(2.0, 9.0);
        let tool = tool_of(random_solid(&mut random, size));
        // about the chunk corner at voxel 32
        let pose = touching(&mut random, &tool.shape, grid.centre(32, 32, 32));
        let carve = |pose: Pose| {
            let mut cut = Cut::new(&bone);
            let step = CarveStep {
                tool: 0,
                before: pose,
                after: pose,
            };
            Carving::best().carve(&bone, &mut cut, &tool, &step, &mut |_, _| {});
            cut
        };
        let cut = carve(pose);
        let mut dense = vec![UNCUT; grid.len()];
        for chunk in 0..bone.chunk_count() {
            let mut values = brute::uncut();
            let placed = (&tool.shape, &pose);
            brute::lower(&bone, chunk, &mut values, placed, |_, _| {});
            for (n, &value) in values.iter().enumerate() {
                let [x, y, z] = brute::place(bone.chunk_coord(chunk), n);
                if x < grid.dims[0] && y < grid.dims[1] && z < grid.dims[2] {
                    dense[grid.dense_index(x, y, z)] = value;
                }
            }
        }
        for _ in 0..4000 {
            let near = random.vector(2.5) + DVec3::new(32.0, 32.0, random.within(8.0, 40.0));
            let p = near * spacing;
            let got = fields(&bone, &cut, p).cut;
            let want = dense_reading(&grid, &dense, p);
            assert_eq!(got.to_bits(), want.to_bits(), "{p}");
        }
        // the same cut some voxels farther on: chunks round differently
        let shift = [7usize, 13, 5];
        let by = grid.centre(shift[0], shift[1], shift[2]);
        let moved = carve(Pose::new(pose.rotation, pose.translation + by));
        let (compared, worst, on_axis) = apart(&bone, (&cut, &moved), shift, &pose);
        assert!(compared > 100 && worst <= 2, "{compared} {worst}");
        // on the axis r is the root of a difference of squares
        assert!(on_axis <= 64, "{on_axis}");
        println!("{compared} voxels, {worst} units apart, {on_axis} on the axis");
    }
}
