//! Tools and steps out of all proportion: cases 36 and 38.

use super::super::setup::{ball, bone_of};
use super::Case;
use super::carving::{block, centred};
use super::odd::{Random, bits, carved, flat_ended, leap_of_the_device, still};
use glam::{DQuat, DVec3};
use osteon_firmware_bridge::haptics::small_tools;
use osteon_sim_core::carve::{CarveStep, Carving, MAX_STAMPS};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::fields;
use std::f64::consts::PI;

/// A burr of `radius` drawn through a block of voxels of `h` in ten steps: volumes after each by the
/// account, and in the end that of the groove as it is read between voxels, mm³.
fn drawn(h: f64, radius: f64, length: f64) -> (Vec<f64>, f64) {
    let wide = 2.0 * radius + 8.0 * h;
    let extent = DVec3::new(length + wide, wide, wide);
    let bone = bone_of(extent, DVec3::splat(h), 1.0, |_| 9.0);
    #[expect(clippy::cast_possible_truncation, reason = "a radius")]
    let tool = ball(radius as f32);
    let mut cut = Cut::new(&bone);
    let from = DVec3::new(0.5 * wide, 0.5 * wide + 0.13 * h, 0.5 * wide + 0.29 * h);
    let at = |n: u32| centred(radius, from + DVec3::X * (length * f64::from(n) / 10.0));
    let account = (0..=10u32)
        .map(|n| {
            let step = CarveStep {
                tool: 0,
                before: at(n.saturating_sub(1)),
                after: at(n),
            };
            Carving::best().carve(&bone, &mut cut, &tool, &step, &mut |_, _| {});
            Cut::mm3(bone.grid(), cut.totals().units())
        })
        .collect();
    let mut random = Random(36);
    let count = 400_000u32;
    let hit = (0..count).filter(|_| {
        let p = DVec3::from_array(extent.to_array().map(|e| random.within(0.0, e - h)));
        fields(&bone, &cut, p).cut < 0.0
    });
    let box_mm3 = extent.to_array().map(|e| e - h).iter().product::<f64>();
    let read = hit.count() as f64 / f64::from(count) * box_mm3;
    (account, read)
}

/// Case 36.
pub(super) fn scales() -> Case {
    // R/h = 200: only the cap of the ball lies in bone
    let (h, radius, depth) = (0.1, 20.0, 0.8);
    let bone = bone_of(DVec3::new(13.0, 13.0, 3.0), DVec3::splat(h), 1.0, |p| {
        2.03 - p.z
    });
    let large = ball(20.0);
    let mut cut = Cut::new(&bone);
    let mut caps = Vec::new();
    for n in 0..=8u32 {
        let place = DVec3::new(6.5, 6.5, 2.03 - depth * f64::from(n) / 8.0);
        let step = still(Pose::new(DQuat::IDENTITY, place));
        Carving::best().carve(&bone, &mut cut, &large, &step, &mut |_, _| {});
        caps.push(Cut::mm3(bone.grid(), cut.totals().units()));
    }
    let cap = PI * depth * depth * (radius - depth / 3.0);
    let cap_off = caps[8] / cap - 1.0;
    // R/h = 0.5
    let (h, radius, length) = (0.5, 0.25, 6.0);
    let (burr, read) = drawn(h, radius, length);
    let capsule = 4.0 / 3.0 * PI * radius.powi(3) + PI * radius * radius * length;
    let [burr_off, counted] = [read, burr[10]].map(|v| v / capsule - 1.0);
    let grows = |v: &[f64]| v[0] >= 0.0 && v.windows(2).all(|w| w[1] >= w[0]);
    let warned = !small_tools(&bone_voxels(h), &[ball(0.25)]).is_empty();
    let spared = small_tools(&bone_voxels(h), &[ball(3.0)]).is_empty();
    Case {
        id: 36,
        name: "Very large and very small tools",
        criterion: "a ball of 200 voxels' radius 0.8 mm into a plane, and a burr of half a voxel's radius through bone: volume ≥ 0 \
                    and never falling; the cap within 1 %, the burr's groove as it is read between voxels within \
                    50 % (the account counts by its ramp of one voxel, which a groove of one voxel's width does not fill); the session warns of the burr and of \
                    no larger ball"
            .to_owned(),
        measured: format!(
            "cap off by {:.2} %, groove by {:.1} %, its account by {:.0} %; warned: {warned}",
            100.0 * cap_off,
            100.0 * burr_off,
            100.0 * counted
        ),
        pass: grows(&caps)
            && grows(&burr)
            && cap_off.abs() <= 0.01
            && burr_off.abs() <= 0.5
            && warned
            && spared,
    }
}

/// A lattice of voxels of `h`.
fn bone_voxels(h: f64) -> Grid {
    Grid::new([8; 3], DVec3::splat(h)).expect("a lattice")
}

/// Case 38.
pub(super) fn leap() -> Case {
    let bone = block([150, 60, 60]);
    let tool = flat_ended(3.0, 10.0);
    let before = Pose::new(DQuat::IDENTITY, DVec3::new(7.0, 15.0, 10.0));
    let leaps: Vec<CarveStep> = [170f64, 180.0, -180.0]
        .map(|degrees| CarveStep {
            tool: 0,
            before,
            after: Pose::new(
                DQuat::from_rotation_x(degrees.to_radians()),
                before.translation + DVec3::X * 60.0,
            ),
        })
        .to_vec();
    let (mut most, mut differ, mut broken) = (0, 0, 0);
    for step in &leaps {
        most = most.max(Carving::best().stamps(&bone, &tool, step));
        let run = || bits(&bone, &carved(&bone, &tool, std::slice::from_ref(step)));
        differ += u32::from(run() != run());
        for n in 0..=16u32 {
            let pose = step.before.interpolate(&step.after, f64::from(n) / 16.0);
            broken += u32::from(!pose.is_valid());
        }
    }
    let row = leap_of_the_device();
    Case {
        id: 38,
        name: "A leap of 60 mm and 170°",
        criterion: "as one step (and one with half a turn to either side): at most 16 stamps, valid poses in between, the same bits again. The \
                    servo makes no such step: a device that leaps so is refused, and believed only where it stays, and then the tool \
                    begins anew there; nothing is carved along the way and the refusals are counted (in place of a log line: the \
                    servo logs nothing)"
            .to_owned(),
        measured: format!(
            "{most} stamps, {differ} runs differ, {broken} broken poses; servo: {} samples refused, longest carved step {:.3} mm, \
             carved to {:.2} mm from where it was",
            row.refused, row.longest_mm, row.farthest_mm
        ),
        pass: most == MAX_STAMPS
            && differ == 0
            && broken == 0
            && row.refused > 0
            && row.longest_mm <= 1.0
            && row.farthest_mm <= 5.0,
    }
}
