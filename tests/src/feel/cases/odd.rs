//! What the odd cases share: random numbers, carved bits, samples by hand, and a servo's whole state.

use super::super::bench::scrambled;
use super::super::device::OMNI;
use super::super::setup::Spec;
use core::f64::consts::TAU;
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, Carving};
use osteon_sim_core::chain::Guard;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::omni;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Request, Sample, Servo};
use osteon_sim_core::tool::revolved::{Face, Form, Part, Revolved};
use osteon_sim_core::tool::{STEEL, Tool};

/// A seeded generator.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x1_0000_0001);
        scrambled(self.0)
    }

    pub(super) fn within(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.next() >> 11) as f64 / (1u64 << 53) as f64;
        low + (high - low) * unit
    }

    pub(super) fn below(&mut self, count: usize) -> usize {
        usize::try_from(self.next() % count.max(1) as u64).unwrap_or(0)
    }

    /// A unit vector.
    pub(super) fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::from_array([(); 3].map(|()| self.within(-1.0, 1.0)));
            let length = v.length();
            if length <= 1.0
                && let Some(unit) = v.try_normalize()
            {
                return unit;
            }
        }
    }
}

/// A tool that stands.
pub(super) fn still(pose: Pose) -> CarveStep {
    CarveStep {
        tool: 0,
        before: pose,
        after: pose,
    }
}

/// A fresh bone's cut after some steps.
pub(super) fn carved(bone: &Bone, tool: &Tool, steps: &[CarveStep]) -> Cut {
    let mut cut = Cut::new(bone);
    for step in steps {
        Carving::best().carve(bone, &mut cut, tool, step, &mut |_, _| {});
    }
    cut
}

/// All stored values, as a hash of each chunk.
pub(super) fn bits(bone: &Bone, cut: &Cut) -> Vec<Option<u64>> {
    (0..bone.chunk_count()).map(|c| cut.chunk_hash(c)).collect()
}

/// A cylinder along z whose flat ends lie at 0 and `length`; all of it cuts.
pub(super) fn flat_ended(radius: f32, length: f32) -> Tool {
    let plane = |height_mm, up| Form::Plane { height_mm, up };
    let faces = [
        Form::cylinder(radius),
        plane(0.0, false),
        plane(length, true),
    ]
    .map(|form| Face {
        form,
        cutting: true,
    })
    .to_vec();
    let solid = Revolved::new(vec![Part { faces }]).expect("closed");
    Tool::revolved(["Cylinder", "cylinder"], solid, (1000.0, 6), STEEL)
}

/// 1,500 unit vectors, evenly spread.
pub(super) fn directions() -> impl Iterator<Item = DVec3> {
    (0..1500u32).map(|n| {
        let z = 1.0 - (2.0 * f64::from(n) + 1.0) / 1500.0;
        let (sine, cosine) = (2.399_963_229_728_653 * f64::from(n)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cosine, r * sine, z)
    })
}

/// Where rays from `centre` find a field's zero between two radii, mm.
pub(super) fn touch_points(
    centre: DVec3,
    between: [f64; 2],
    field: impl Fn(DVec3) -> f32,
) -> Vec<f64> {
    directions()
        .map(|ray| {
            let [mut low, mut high] = between;
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if field(centre + ray * middle) > 0.0 {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            0.5 * (low + high)
        })
        .collect()
}

/// The sample of an OMNI-like device at a place (base frame), its stylus turned by `rotation`.
#[expect(clippy::cast_possible_truncation, reason = "the casts saturate")]
pub(super) fn sample(tip: DVec3, rotation: DQuat, time_micros: u32) -> Sample {
    let joints = omni::inverse(tip).expect("in reach");
    let gimbal = omni::gimbal_for(joints, rotation).unwrap_or(DVec3::ZERO);
    let per_rad = f64::from(OMNI.counts_per_rev) / TAU;
    let gimbal_per_rad = f64::from(OMNI.gimbal_counts_per_rev) / TAU;
    Sample {
        time_micros,
        encoders: ((joints - omni::DOCK) * per_rad)
            .to_array()
            .map(|v| v.floor() as i32),
        gimbal: (gimbal * gimbal_per_rad)
            .to_array()
            .map(|v| v.floor() as i16),
        buttons: 0,
        drive_active: true,
        docked: false,
        applied: [0; 3],
        ack_age: 0,
    }
}

/// A way from in front of the face to `depth_mm` under it and along it, then rest: (place, ticks).
pub(super) fn way(depth_mm: f64, tick: u32) -> DVec3 {
    // a ramp of 1.1 s after the start, then down at 20 mm/s
    let down = (10.0 - 0.02 * (f64::from(tick) - 1200.0).max(0.0)).max(-depth_mm);
    let along = 0.002 * (f64::from(tick) - 1800.0).clamp(0.0, 1000.0);
    DVec3::new(along, 0.3 * along, down)
}

/// What a servo did with a device that leaps.
pub(super) struct Leap {
    pub(super) refused: u64,
    pub(super) longest_mm: f64,
    pub(super) farthest_mm: f64,
}

/// A cut 1 mm deep, then the device is 60 mm away and turned by 170°, and stays there.
pub(super) fn leap_of_the_device() -> Leap {
    let mut servo = Spec::flat().servo();
    let mut leap = Leap {
        refused: 0,
        longest_mm: 0.0,
        farthest_mm: 0.0,
    };
    let mut last = DVec3::ZERO;
    for tick in 0..2100u32 {
        let there = tick >= 2000;
        let (tip, turn) = if there {
            (
                way(1.0, 2000) + DVec3::Y * 60.0,
                DQuat::from_rotation_z(170f64.to_radians()),
            )
        } else {
            (way(1.0, tick), DQuat::IDENTITY)
        };
        let requests = [Request::Spindle(true)];
        let requests = if tick == 0 { &requests[..] } else { &[] };
        let output = servo.tick(Some(&sample(tip, turn, tick * 1000)), requests);
        for step in &output.carved[..output.carved_len] {
            let moved = step.after.translation - step.before.translation;
            leap.longest_mm = leap.longest_mm.max(moved.length());
            if there {
                let off = (step.after.translation - last).length();
                leap.farthest_mm = leap.farthest_mm.max(off);
            }
        }
        if !there {
            last = output.bone_from_tool.translation;
        }
    }
    leap.refused = servo.guards().of(Guard::Implausible);
    leap
}

/// What is odd in a servo's state, all of which its debug text shows: values that are no numbers, and
/// values so small that arithmetic on them is slow (`f32`'s or `f64`'s denormals).
pub(super) struct Oddities {
    pub(super) not_finite: usize,
    pub(super) denormal: usize,
    pub(super) numbers: usize,
}

/// The deepest element so far is −∞ where none was looked at: meant so.
const SENTINEL: &str = "deepest_mm";

/// Reads them out of the state.
pub(super) fn oddities(servo: &Servo) -> Oddities {
    let text = format!("{servo:?}");
    let mut found = Oddities {
        not_finite: 0,
        denormal: 0,
        numbers: 0,
    };
    let part_of_number = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '+' | '_');
    let mut last = "";
    for word in text.split(|c| !part_of_number(c)) {
        match word {
            "NaN" | "inf" | "-inf" => found.not_finite += usize::from(last != SENTINEL),
            _ if word.contains('.') || word.contains("e-") => {
                if let Ok(value) = word.parse::<f64>() {
                    found.numbers += 1;
                    let small = value != 0.0 && value.abs() < f64::from(f32::MIN_POSITIVE);
                    found.denormal += usize::from(small);
                }
            }
            _ => {}
        }
        if !word.is_empty() {
            last = word;
        }
    }
    found
}
