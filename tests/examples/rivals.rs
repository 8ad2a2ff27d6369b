//! The rivals on one scene: time of an event, what they missed and took in excess, memory.
//!
//! `cargo run --release -p osteon-tests --example rivals [VOXEL_MM [EVENTS [PASSES]]]`. Each event's
//! time is the least of the passes: what the method costs without the machine's other work.
#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a program for people; what goes wrong ends it"
)]

use glam::{DQuat, DVec3, Vec3};
use osteon_firmware_bridge::scene::{SceneArgs, load};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use osteon_tests::baselines::{
    Baseline, Brute, Reza, THESIS_VOXEL_MM, Thesis, Truth, VoxelTool, all, surface_error,
};
use std::time::Instant;

const HEADER: &str = "                 press: us an event                                        | standing, once            |
method           p50      mean       p99       max  missed%  excess% | miss%   exc%  rms um   max |       MB";

/// The tool pressed along the plan's axis from 1 mm above the joint to `depth_mm` below, with a
/// wobble of 2° and 0.3 mm.
fn press(bone_from_plan: &Pose, depth_mm: f64, events: u32) -> Vec<Pose> {
    (0..events)
        .map(|n| {
            let t = f64::from(n) / f64::from(events);
            let turn = DQuat::from_axis_angle(DVec3::X, 2f64.to_radians() * (7.0 * t).sin());
            let shift = DVec3::new(0.3 * (11.0 * t).sin(), 0.3 * (13.0 * t).cos(), 0.0);
            let down = DVec3::Z * (1.0 - (1.0 + depth_mm) * t);
            bone_from_plan.then(&Pose::new(turn, shift + down))
        })
        .collect()
}

/// Least time of each event over the passes, µs, ascending.
fn times(method: &mut dyn Baseline, poses: &[Pose], passes: u32) -> Vec<f64> {
    let mut best = vec![f64::INFINITY; poses.len()];
    for _ in 0..passes {
        method.restore();
        for (pose, best) in poses.iter().zip(&mut best) {
            let from = Instant::now();
            std::hint::black_box(method.event(pose));
            *best = best.min(from.elapsed().as_secs_f64() * 1e6);
        }
    }
    best.sort_by(f64::total_cmp);
    best
}

struct Run<'a> {
    bone: &'a Bone,
    tool: &'a VoxelTool,
    poses: &'a [Pose],
    truth: Truth<'a>,
    passes: u32,
}

fn row(method: &mut dyn Baseline, run: &Run<'_>) {
    let times = times(method, run.poses, run.passes);
    let errors = run.truth.errors(method);
    let middle = &run.poses[run.poses.len() * 2 / 3];
    let [missed, excess, rms, max] = standing(method, run.bone, run.tool, middle);
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    println!(
        "{:15} {:9.1} {:9.1} {:9.1} {:9.1} {:8.2} {:8.2} | {missed:6.2} {excess:6.2} {rms:6.0} {max:6.0} | {:8.2}",
        method.name(),
        times[times.len() / 2],
        mean,
        times[times.len() * 99 / 100],
        times[times.len() - 1],
        100.0 * errors.missed_fraction(),
        100.0 * errors.excess_fraction(),
        method.bytes() as f64 / 1e6,
    );
}

/// One event of a standing tool in the untouched bone: missed and excess, %, and the surface's RMS
/// and largest error away from the tool's creases, µm.
fn standing(method: &mut dyn Baseline, bone: &Bone, tool: &VoxelTool, pose: &Pose) -> [f64; 4] {
    method.restore();
    method.event(pose);
    let errors = Truth::new(bone, tool, core::slice::from_ref(pose)).errors(method);
    // the reamer's face, the drill's flank
    let smooth = |p: Vec3| match p.truncate().length() {
        r if tool.bounds().hi.x > 10.0 => r < 16.0 && p.z < 5.0,
        _ => p.z > 3.5,
    };
    let surface = surface_error(bone, tool, pose, method, &smooth);
    [
        100.0 * errors.missed_fraction(),
        100.0 * errors.excess_fraction(),
        1e3 * surface.rms_mm,
        1e3 * surface.max_mm,
    ]
}

fn main() {
    let mut words = std::env::args().skip(1);
    let voxel_mm = words
        .next()
        .map_or(0.47, |w| w.parse().expect("a size, mm"));
    let events = words.next().map_or(300, |w| w.parse().expect("a number"));
    let passes = words.next().map_or(5, |w| w.parse().expect("a number"));
    let args = SceneArgs {
        voxel_mm: Some(voxel_mm),
        ..SceneArgs::default()
    };
    let scene = load(&args, &mut |_, _| ()).expect("the phantom");
    println!(
        "{:?}, {} chunks",
        scene.summary.dims, scene.summary.chunks_active
    );
    for (tool, depth_mm) in [(Tool::glenoid_reamer(), 2.5), (Tool::peg_drill(), 15.0)] {
        let poses = press(&scene.bone_from_plan, depth_mm, events);
        let voxels = VoxelTool::of_shape(THESIS_VOXEL_MM, tool.shape).expect("a tool");
        let truth = Truth::new(&scene.bone, &voxels, &poses);
        let simd = Thesis::simd(&scene.bone, &voxels);
        let hit: usize = poses.iter().map(|p| simd.chunks_hit(p)).sum();
        println!(
            "\n{}: {events} events, {} voxels truly removed, {:.1} chunks of 32³ an event, {:?}, {voxels:?}",
            tool.name,
            truth.count(),
            hit as f64 / f64::from(events),
            simd.isa(),
        );
        println!("{HEADER}");
        let bone = &*scene.bone;
        let run = Run {
            bone,
            tool: &voxels,
            poses: &poses,
            truth,
            passes,
        };
        for mut method in all(bone, &voxels) {
            row(&mut *method, &run);
        }
        row(&mut Reza::solid(bone, &voxels), &run);
        row(&mut Brute::new(bone, &voxels), &run);
    }
}
