//! Numbers at their ends: cases 19, 33, 34, 35 and 40.

use super::super::device::OMNI;
use super::super::setup::{Scene, Slab, Spec, ball, bone_of};
use super::carving::extreme_bone;
use super::odd::{Random, bits, carved, oddities, sample, still, way};
use super::wire::kept_cut;
use super::{Case, Worst};
use glam::{DQuat, DVec3};
use osteon_protocol::frame::is_newer;
use osteon_sim_core::bone::{Bone, BoneError, DenseBone, Occupancy};
use osteon_sim_core::carve::Carving;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::grid::{Grid, MAX_DIM};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::sample::{Sampler, fields};
use osteon_sim_core::servo::{Request, Servo, ServoSetup};
use osteon_sim_core::solid::signed_distance;
use std::sync::Arc;

/// Case 19.
pub(super) fn denormals() -> Case {
    let slab = Slab {
        extent_mm: DVec3::splat(14.0),
        ..Slab::default()
    };
    let mut servo = Spec::at(slab.scene(vec![ball(3.0)])).servo();
    let (mut denormal, mut numbers, mut iterations) = (0, 0, 0);
    // a press and a cut, then a long rest in bone and a long rest in the air: whatever decays does
    let place = |tick: u32| match tick {
        0..4000 => way(0.8, tick),
        4000..14_000 => way(0.8, 4000),
        _ => DVec3::Z * 10.0 + DVec3::X * (0.01 * f64::from((tick - 14_000).min(1000))),
    };
    for tick in 0..44_000u32 {
        let requests = [Request::Spindle((1800..3000).contains(&tick))];
        let output = servo.tick(
            Some(&sample(place(tick), DQuat::IDENTITY, tick * 1000)),
            &requests,
        );
        iterations = iterations.max(output.iterations);
        if tick % 997 == 0 {
            let found = oddities(&servo);
            denormal += found.denormal;
            numbers += found.numbers;
        }
    }
    Case {
        id: 19,
        name: "Denormals",
        criterion: "time is no criterion on a shared machine. In its place: fields are integers, so none can be stored there; and no value of the servo's \
                    whole state is ever below the smallest normal f32 (1.2e-38) without being 0, looked at 45 times in a cut, 10 s of rest in bone \
                    and 30 s in the air, where all that decays has decayed; so no tick works on one"
            .to_owned(),
        measured: format!("{denormal} of {numbers} numbers; at most {iterations} iterations in a tick"),
        pass: denormal == 0 && numbers > 1000,
    }
}

/// Torques of a cut with the bone at a place in the patient, mm; and the worst that a point of the bone
/// is off by after a way to the patient's frame and back.
fn far_away(offset: f64) -> (Vec<[i16; 3]>, f64) {
    let slab = Slab::default().scene(vec![ball(3.0)]);
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
    let lps_from_bone = Pose::new(turn, DVec3::new(offset, -offset, offset));
    let base = bone_from_base(&slab.bone_from_base, &lps_from_bone);
    let scene = Scene {
        bone_from_base: base,
        ..slab
    };
    let mut servo = Spec::at(scene).servo();
    let torques = (0..2600u32)
        .map(|tick| {
            let requests = [Request::Spindle(tick >= 1800)];
            let sample = sample(way(0.8, tick), DQuat::IDENTITY, tick * 1000);
            servo.tick(Some(&sample), &requests).torque
        })
        .collect();
    let mut random = Random(33);
    let worst = (0..2000)
        .map(|_| {
            let p = random.direction() * 200.0;
            (lps_from_bone.inverse().point(lps_from_bone.point(p)) - p).length()
        })
        .fold(0.0, f64::max);
    (torques, worst)
}

/// Case 33.
pub(super) fn far_coordinates() -> Case {
    let (near, _) = far_away(0.0);
    let mut worst = Worst::default();
    let mut differ = 0;
    for offset in [1e5, 1e6, 1e7] {
        let (torques, off) = far_away(offset);
        worst.note(off, || format!("{offset:.0e} mm"));
        differ += torques.iter().zip(&near).filter(|(a, b)| a != b).count();
    }
    let moved = near.iter().filter(|t| **t != [0; 3]).count();
    // the contrast: the same way in f32
    let there = 1e7f32 + 0.123;
    let single = f64::from(there) - 1e7 - 0.123;
    Case {
        id: 33,
        name: "Far from the origin",
        criterion: "a patient's frame 10⁵, 10⁶ and 10⁷ mm away: a point there and back is off by ≤ 1e-4 mm; every torque of a press and a cut is that of the \
                    bone at the origin, bit for bit (bone and tool are local)"
            .to_owned(),
        measured: format!(
            "{}; {differ} torques differ, {moved} of them are not zero; f32 would be off by {:.2} mm",
            worst.words("mm"),
            single.abs()
        ),
        pass: worst.value <= 1e-4 && differ == 0 && moved > 500,
    }
}

/// The kept inputs of a cut, their device clock shifted by `micros`: how many outputs differ from those
/// without a shift.
fn shifted(micros: u32) -> usize {
    let (spec, bench) = kept_cut();
    let (mut plain, mut late) = (spec.servo(), spec.servo());
    let inputs = bench.kept.unwrap_or_default();
    inputs
        .iter()
        .filter(|input| {
            let a = plain.tick(input.sample.as_ref(), &input.requests);
            let sample = input.sample.map(|s| osteon_sim_core::servo::Sample {
                time_micros: s.time_micros.wrapping_add(micros),
                ..s
            });
            a != late.tick(sample.as_ref(), &input.requests)
        })
        .count()
}

/// Small bites out of a block: what the account, an `f32` sum of its steps, and an independent count of
/// what is left say, mm³.
fn bites() -> [f64; 3] {
    let bone = bone_of(DVec3::splat(23.75), DVec3::splat(0.5), 1.0, |_| 9.0);
    let grid = *bone.grid();
    let occupancy = Occupancy::new(&grid);
    let tool = ball(2.0);
    let mut cut = Cut::new(&bone);
    let mut random = Random(34);
    // as though 2²⁴ units had been summed before: where f32 begins to lose
    let mut single = 16_777_216.0f32;
    let mut before = 0i64;
    for _ in 0..20_000 {
        let place = DVec3::from_array([(); 3].map(|()| random.within(3.0, 20.0)));
        let step = still(Pose::new(DQuat::IDENTITY, place));
        Carving::best().carve(&bone, &mut cut, &tool, &step, &mut |_, _| {});
        let now = cut.totals().units();
        single += (now - before) as f32;
        before = now;
    }
    let whole: i64 = (0..bone.chunk_count())
        .flat_map(|c| bone.chunk(c).solid)
        .map(|&d| occupancy.units(d))
        .sum();
    let left: i64 = (0..bone.chunk_count())
        .map(|c| cut.solid_units(&bone, c))
        .sum();
    let mm3 = |units| Cut::mm3(&grid, units);
    [
        mm3(before),
        f64::from(single - 16_777_216.0) * mm3(1),
        mm3(whole - left),
    ]
}

/// Case 34.
pub(super) fn long_session() -> Case {
    // the clock wraps 0.5, 1.6 and 3.9 s after its beginning
    let wraps: usize = [500_000u32, 1_600_500, 3_900_001]
        .map(|micros| shifted(micros.wrapping_neg()))
        .iter()
        .sum();
    let [account, single, counted] = bites();
    // frames' and commands' numbers over ten hours
    let (mut seq, mut out_of_order) = (0u16, 0u32);
    for _ in 0..36_000_000u32 {
        let next = seq.wrapping_add(1);
        out_of_order += u32::from(!is_newer(next, seq));
        seq = next;
    }
    let full =
        i128::from(Occupancy::new(&Grid::new([1; 3], DVec3::ONE).expect("a lattice")).full());
    let voxels = i128::try_from(MAX_DIM).unwrap_or(0).pow(3);
    let room = i128::from(i64::MAX) / (voxels * full);
    // where the tool is follows from the newest sample, whatever was before
    let (spec, bench) = kept_cut();
    let inputs = bench.kept.unwrap_or_default();
    let mut fresh = spec.servo();
    let last = inputs.last().and_then(|i| i.sample);
    let anew = last.map(|s| fresh.tick(Some(&s), &[]).bone_from_device);
    let absolute = anew == bench.output.map(|o| o.bone_from_device);
    Case {
        id: 34,
        name: "Ten hours",
        criterion: "not as ten hours in a test (`report stability --soak` has them) but at the counters' ends: the device clock wraps in a press and twice in \
                    a cut: every output as without, bit for bit; frame numbers over 36,000,000 frames are each newer than the last; the account of \
                    20,000 bites is the independent count to the unit; an i64 of occupancy holds the largest lattice 1,000 times; the tool's \
                    place is that of a servo that never ran before"
            .to_owned(),
        measured: format!(
            "{wraps} outputs differ; {out_of_order} frames out of order; {account:.3} and {counted:.3} mm³ (an f32 sum would say {single:.3}); \
             room for {room} lattices; place equal: {absolute}"
        ),
        pass: wraps == 0
            && out_of_order == 0
            && (account - counted).abs() <= 0.0
            && account > 1000.0
            && room >= 1000
            && absolute,
    }
}

/// Readings of extreme fields that leave their range, of some thousand; and the volume's sign.
fn extremes(random: &mut Random) -> (u32, bool) {
    let edge = 24;
    let count = edge * edge * edge;
    let hu = [i16::MAX, i16::MIN, 119, 120, 121, -1000, 0];
    let mm = [
        1e30,
        -1e30,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        0.0,
        1e-40,
        0.3,
        -0.3,
    ];
    let hu: Vec<i16> = (0..count).map(|_| hu[random.below(hu.len())]).collect();
    let solid: Vec<f32> = (0..count).map(|_| mm[random.below(mm.len())]).collect();
    let Some(bone) = extreme_bone(&hu, &solid, edge) else {
        return (u32::MAX, false);
    };
    let mut cut = Cut::new(&bone);
    let tool = ball(2.0);
    let mut wrong = 0;
    let mut before = 0;
    let mut grows = true;
    #[expect(clippy::cast_possible_truncation, reason = "millimetres")]
    let band = bone.grid().band_mm() as f32 * 1.001;
    for _ in 0..60 {
        let p = DVec3::from_array([(); 3].map(|()| random.within(-1.0, 13.0)));
        Carving::best().carve(
            &bone,
            &mut cut,
            &tool,
            &still(Pose::new(DQuat::IDENTITY, p)),
            &mut |_, _| {},
        );
        let now = cut.totals().units();
        grows &= now >= before;
        before = now;
        for _ in 0..100 {
            let q = DVec3::from_array([(); 3].map(|()| random.within(-2.0, 14.0)));
            let f = fields(&bone, &cut, q);
            let matter = Sampler::new(&bone, &cut).matter(q);
            let inside = f.solid.abs() <= band && f.cut.abs() <= band && f.gradient.is_finite();
            let hu = matter.is_none_or(|m| (-32768.0..=32767.0).contains(&m.hu));
            wrong += u32::from(!(inside && hu));
        }
    }
    (wrong, grows)
}

/// Solid voxels whose CT number is at or below the threshold, or air above it, on a lattice of numbers at
/// the ends of their range and around 120.
fn threshold(random: &mut Random) -> u32 {
    let grid = Grid::new([20; 3], DVec3::splat(0.5)).expect("a lattice");
    let numbers = [i16::MAX, i16::MIN, 119, 120, 121];
    let hu: Vec<i16> = (0..grid.len()).map(|_| numbers[random.below(5)]).collect();
    let phi: Vec<f32> = hu.iter().map(|&v| f32::from(v) - 120.0).collect();
    let Ok(distance) = signed_distance(&grid, &phi) else {
        return u32::MAX;
    };
    let wrong = hu
        .iter()
        .zip(&distance)
        .filter(|&(&hu, &d)| (hu > 120) != (d > 0.0) || !d.is_finite());
    u32::try_from(wrong.count()).unwrap_or(u32::MAX)
}

/// Case 35.
pub(super) fn saturation() -> Case {
    let mut random = Random(35);
    let grid = Grid::new([8; 3], DVec3::splat(0.5)).expect("a lattice");
    let ends = [f32::MAX, f32::INFINITY, 1e9, 0.8661];
    let stored = ends.map(|mm| [grid.quantise(mm), grid.quantise(-mm)]);
    let ends_hold =
        stored.iter().all(|v| *v == [i16::MAX, -i16::MAX]) && grid.quantise(f32::NAN) == -i16::MAX;
    let mut trips = 0;
    for v in -i16::MAX..=i16::MAX {
        trips += u32::from(grid.quantise(f32::from(v) * grid.quantum_mm()) != v);
    }
    let occupancy = Occupancy::new(&grid);
    let volumes = [i16::MIN, -i16::MAX, 0, i16::MAX].map(|d| occupancy.units(d));
    let full = occupancy.full();
    let (wrong, grows) = extremes(&mut random);
    let missed = threshold(&mut random);
    Case {
        id: 35,
        name: "Ends of the ranges",
        criterion: "distances beyond ± the band, infinite and NaN: ± 32767, never wrapped; all 65,535 stored distances come back; a field of random \
                    ends (CT 32767, −32768, distances 1e30, inf, NaN, 1e-40) is carved and read 6,000 times within its range, its volume \
                    never falling; 119 and 120 HU are not bone, 121 is, beside −32768 and 32767"
            .to_owned(),
        measured: format!(
            "ends hold: {ends_hold}; {trips} do not come back; occupancy {volumes:?} of {full}; {wrong} readings out of range, volume grows: {grows}; \
             {missed} voxels on the wrong side"
        ),
        pass: ends_hold && trips == 0 && volumes == [0, 0, full / 2, full] && wrong == 0 && grows && missed == 0,
    }
}

/// A servo in a bone of its own, the base's origin in the lattice's middle: forces that are not finite or
/// too large, and the units it removed.
fn lived_through(bone: Bone, middle: DVec3) -> (u32, i64) {
    let setup = ServoSetup {
        bone: Arc::new(bone),
        tools: vec![ball(3.0)],
        bone_from_base: Pose::new(DQuat::IDENTITY, middle),
        bone_from_plan: Pose::new(DQuat::IDENTITY, middle),
        device: OMNI,
        force_limit_n: 3.3,
        feel: Feel::default(),
    };
    let mut servo = Servo::new(setup).expect("a tool");
    let mut unsound = 0;
    for tick in 0..3000u32 {
        let requests = [Request::Spindle(true)];
        let requests = if tick == 0 { &requests[..] } else { &[] };
        let output = servo.tick(
            Some(&sample(way(2.0, tick), DQuat::IDENTITY, tick * 1000)),
            requests,
        );
        let force = output.force_n.length();
        unsound += u32::from(!(force <= 3.3 + 1e-9 && output.bone_from_tool.is_valid()));
    }
    unsound += u32::from(oddities(&servo).not_finite > 0);
    (unsound, servo.cut().totals().units())
}

/// Case 40.
pub(super) fn degenerate_volumes() -> Case {
    let grid = |n: usize| Grid::new([n; 3], DVec3::splat(0.5)).expect("a lattice");
    let dense = |n: usize, mm: f32| {
        let len = n * n * n;
        let dense = DenseBone {
            density_hu: &vec![400; len],
            solid_mm: &vec![mm; len],
            class: &vec![2; len],
            label: &vec![1; len],
        };
        Bone::from_dense(grid(n), Pose::IDENTITY, &dense)
    };
    let empty = matches!(dense(16, -9.0), Err(BoneError::Empty));
    let no_chunks = lived_through(Bone::new(grid(16), Pose::IDENTITY), DVec3::splat(4.0));
    let solid = dense(48, 9.0).expect("a bone");
    let all = carved(
        &solid,
        &ball(100.0),
        &[still(Pose::new(
            DQuat::IDENTITY,
            DVec3::new(12.0, 12.0, -80.0),
        ))],
    );
    let left: i64 = (0..solid.chunk_count())
        .map(|c| all.solid_units(&solid, c))
        .sum();
    let in_solid = lived_through(solid, DVec3::splat(11.75));
    let one = dense(1, 0.4).expect("a bone of one voxel");
    let full = Occupancy::new(one.grid()).full();
    let gone = carved(
        &one,
        &ball(3.0),
        &[still(Pose::new(DQuat::IDENTITY, DVec3::Z * -3.0))],
    );
    let kept = bits(&one, &gone).len();
    let units = gone.totals().units();
    let in_one = lived_through(one, DVec3::ZERO);
    let field = [-1.0f32, 1.0].map(|v| signed_distance(&grid(8), &vec![v; 512]));
    let fields_hold = field
        .iter()
        .all(|f| f.as_ref().is_ok_and(|d| d.iter().all(|v| v.is_finite())));
    Case {
        id: 40,
        name: "Nothing, everything, one voxel",
        criterion: "a volume without bone is refused with its reason; a lattice without chunks, one all of bone and one of a single voxel: a servo pushes a \
                    turning ball into each for 3 s, forces ≤ 3.3 N, no NaN in its state; a ball about all of the solid lattice leaves nothing; the \
                    one voxel is taken once and whole; distances of a field without a surface are finite"
            .to_owned(),
        measured: format!(
            "refused: {empty}; unsound ticks {}, {}, {}; {left} units left of the solid; {units} of {full} of the voxel; fields hold: {fields_hold}",
            no_chunks.0, in_solid.0, in_one.0
        ),
        pass: empty
            && no_chunks == (0, 0)
            && in_solid.0 == 0
            && in_one.0 == 0
            && left == 0
            && units == full
            && kept == 1
            && fields_hold,
    }
}
