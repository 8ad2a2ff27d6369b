//! One fault in one session: what the plant shows.

use super::world::{Lab, World};
use crate::fake::device::{DeviceSetup, Truth};
use crate::fake::faults::{Direction, Fault, Planned, Where};
use crate::fake::hand::Hold;
use crate::fake::random::Random;
use crate::fake::{Segment, Stroke};
use osteon_protocol::device::DriveState;
use osteon_protocol::firmware::limits::SLEW_COUNTS_PER_MS;
use std::sync::{Arc, Mutex, PoisonError};

/// A torque below this is zero, N·mm: 4 mN at the stylus.
pub const ZERO_NMM: f64 = 0.5;
/// A firm torque, N·mm.
pub const FIRM_NMM: f64 = 20.0;
/// By then the torque must be zero where the link is not healthy, ms.
pub const ZERO_BY_MS: f64 = 20.0;
/// Most work that a fault may let the motors do on the arm, J. The impulse of 3.3 N, held for 5 ms and ramped
/// to zero by 20 ms, gives a bare arm of 45 g 19 mJ; the coupling stores 11 mJ at 3.3 N and gives them back
/// when the force returns; the rest is what a hand's own motion adds meanwhile.
pub const MOST_JOULES: f64 = 0.040;
/// After the fault's end the session must go on within this time, ms.
const RECOVERY_MS: u64 = 900;
const LONGEST_START_MS: u32 = 12_000;

/// What the hand does when the fault comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Presses a standing tool onto the bone.
    Press,
    /// Drills.
    Cut,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// From the first frame that the fault met, or its beginning, to zero torque that stays, ms. `None`
    /// where the torque did not go to zero.
    pub zero_ms: Option<f64>,
    /// Whether the torque stayed at zero until the fault's end.
    pub stayed_zero: bool,
    /// Most work that the motors did on the arm from the beginning of the fault on, J.
    pub joules: f64,
    /// Largest rise of a joint's torque at the converters in a millisecond over the drive's slew limit.
    pub slew_share: f64,
    /// Commands that were applied although they were broken, old or nobody's.
    pub wrongly_applied: u32,
    /// The drive left active and hold.
    pub stopped: bool,
    /// The session went on: drive active, servo running at the end.
    pub went_on: bool,
    /// The named fault in which it stands otherwise.
    pub named: Option<String>,
}

impl Outcome {
    /// Whether all holds that is asked of this fault.
    pub fn passes(&self, planned: Planned) -> bool {
        let entry = planned.fault.entry();
        let stop = if entry.benign {
            !self.stopped && self.went_on
        } else {
            self.stayed_zero && self.zero_ms.is_some_and(|ms| ms <= ZERO_BY_MS)
        };
        stop && self.wrongly_applied == 0
            && self.slew_share <= 1.0 + 1e-9
            && self.joules <= MOST_JOULES
            && (self.went_on || self.named.is_some())
    }
}

/// A stroke from the dock to the phantom's joint.
pub fn stroke(work: Work) -> Stroke {
    let segment = |name: &str, z: f64, y: f64, speed: f64, press, timeout_s| Segment {
        name: name.to_owned(),
        goal_mm: [0.0, y, z],
        axis: [0.0, 0.0, 1.0],
        speed_mm_s: speed,
        max_push_n: 2.0,
        press,
        dwell_s: 0.0,
        timeout_s,
    };
    let button = (work == Work::Cut).then_some(1);
    let speed = if work == Work::Cut { 5.0 } else { 40.0 };
    Stroke {
        segments: vec![
            segment("leave the dock", 60.0, -20.0, 200.0, None, 2.0),
            segment("before the joint", 15.0, 0.0, 150.0, None, 2.0),
            segment("near", 6.0, 0.0, 60.0, button, 2.0),
            segment("in", -14.0, 0.0, speed, None, 600.0),
        ],
    }
}

/// Largest torque of the joints, N·mm.
pub fn torque(truth: &Truth) -> f64 {
    truth.torque_nmm.abs().max_element()
}

/// Goes on until the torque has been firm for 100 ms in a row; an error where it does not become so.
pub fn until_firm(world: &mut World) -> anyhow::Result<()> {
    let mut firm = 0;
    for _ in 0..LONGEST_START_MS {
        firm = if torque(&world.tick()) > FIRM_NMM {
            firm + 1
        } else {
            0
        };
        if firm >= 100 {
            return Ok(());
        }
    }
    anyhow::bail!(
        "bench: the hand never pressed firmly ({})",
        world.over().unwrap_or("the session runs")
    )
}

/// Sessions that are firmly at work, to begin from: by hold and work.
#[derive(Debug, Default)]
pub struct Bases(Vec<Mutex<World>>);

impl Bases {
    /// Brings a session of every hold and work to firm contact.
    pub fn new(lab: &Arc<Lab>) -> anyhow::Result<Self> {
        let mut bases = Vec::new();
        for (work, hold) in kinds() {
            let setup = DeviceSetup {
                hold,
                ..DeviceSetup::new(stroke(work), 11)
            };
            let mut world = World::new(lab, setup, 0, 0);
            until_firm(&mut world)?;
            bases.push(Mutex::new(world));
        }
        Ok(Self(bases))
    }

    fn fork(&self, seed: u64) -> Option<World> {
        let count = self.0.len().max(1) as u64;
        #[expect(clippy::cast_possible_truncation, reason = "a handful")]
        let base = self.0.get((seed % count) as usize)?;
        base.lock().unwrap_or_else(PoisonError::into_inner).fork()
    }
}

fn kinds() -> impl Iterator<Item = (Work, Hold)> {
    [Work::Press, Work::Cut]
        .into_iter()
        .flat_map(|work| Hold::ALL.map(|hold| (work, hold)))
}

/// Plays one fault with one seed.
pub fn play(lab: &Arc<Lab>, bases: &Bases, planned: Planned, seed: u64) -> anyhow::Result<Outcome> {
    let mut random = Random::new(seed ^ 0xfa17);
    let world = match planned.fault {
        Fault::WrongSchema | Fault::WrongVersion => {
            let mut world = World::new(lab, DeviceSetup::new(stroke(Work::Press), seed), 0, 0);
            world.inject(planned, seed);
            Some(world)
        }
        _ if planned.entry().place == Where::Setup => Some(built(lab, planned, seed)?),
        _ => {
            let mut world = bases.fork(seed);
            if let Some(world) = &mut world {
                for _ in 0..random.below(100) {
                    world.tick();
                }
                world.inject(planned, seed);
            }
            world
        }
    };
    let world = world.ok_or_else(|| anyhow::anyhow!("bench: no session to begin from"))?;
    Ok(watch(world, planned))
}

// a session whose device or host was made so that it meets its wrap, or whose clocks differ
fn built(lab: &Arc<Lab>, planned: Planned, seed: u64) -> anyhow::Result<World> {
    let (work, hold) = kinds()
        .nth((seed % 6) as usize)
        .unwrap_or((Work::Press, Hold::Grip));
    let mut setup = DeviceSetup {
        hold,
        ..DeviceSetup::new(stroke(work), seed)
    };
    // a first run says when the session is at work
    let mut scout = World::new(lab, setup.clone(), 0, 0);
    until_firm(&mut scout)?;
    let at = scout.device().now_micros() / 1000;
    let ahead = u16::try_from((at + 60 + seed * 7) & 0xffff).unwrap_or(0);
    let wrap = 0_u16.wrapping_sub(ahead);
    let (mut ppm, mut first_command) = (0, 0);
    match (planned.fault, planned.direction) {
        (Fault::SeqWrap, Direction::ToDevice) => first_command = wrap,
        (Fault::SeqWrap, _) => setup.first_seq = wrap,
        (Fault::EncoderWrap, _) => {
            // counts in the dock such that the way to the bone crosses the end of 32 bits
            let counts = scout.device().plant().encoders();
            setup.power_up = [0, 1, 2].map(|j| {
                let way = counts[j] - setup.power_up[j];
                i32::MAX - way / 2
            });
        }
        (Fault::DriftFast, _) => ppm = 100,
        _ => ppm = -100,
    }
    let mut world = World::new(lab, setup, ppm, first_command);
    until_firm(&mut world)?;
    Ok(world)
}

/// Lets the session run from the beginning of the fault to some time after its end.
pub fn watch(mut world: World, planned: Planned) -> Outcome {
    let lasts = u64::from(planned.entry().lasts_ms);
    let begun = world.now_ns();
    let work_before = world.device().plant().motor_work();
    let mut last = world.device().firmware().dac();
    let mut trace = Vec::new();
    let (mut joules, mut slew_share) = (0.0_f64, 0.0_f64);
    let mut stopped = false;
    let mut truth = None;
    for _ in 0..lasts + RECOVERY_MS {
        let now = world.tick();
        joules = joules.max(world.device().plant().motor_work() - work_before);
        let dac = world.device().firmware().dac();
        for joint in 0..3 {
            slew_share = slew_share
                .max(rise(last[joint], dac[joint]) / f64::from(SLEW_COUNTS_PER_MS[joint]));
        }
        last = dac;
        stopped |= !matches!(now.drive, DriveState::Active | DriveState::Hold);
        trace.push((world.now_ns(), torque(&now)));
        truth = Some(now);
    }
    let met = world.met_ns().unwrap_or(begun).max(begun);
    let until = begun + lasts * 1_000_000;
    let (zero_ms, stayed_zero) = zero(&trace, met, until);
    let drive = truth.map(|t| t.drive);
    let running = world.running();
    let named = world.over().map(str::to_owned).or_else(|| {
        (drive == Some(DriveState::Fault)).then(|| "the drive stands in its fault".to_owned())
    });
    Outcome {
        zero_ms,
        stayed_zero,
        joules,
        slew_share,
        wrongly_applied: world.wrongly_applied(),
        stopped,
        went_on: running && drive == Some(DriveState::Active),
        named,
    }
}

// how much further from zero, counts; a change of sign starts from zero
fn rise(from: i16, to: i16) -> f64 {
    let base = if from.signum() == to.signum() {
        from.unsigned_abs()
    } else {
        0
    };
    f64::from(to.unsigned_abs()) - f64::from(base)
}

/// When the torque became zero for 5 ms or more, and whether it stayed so until the fault's end.
fn zero(trace: &[(u64, f64)], met: u64, until: u64) -> (Option<f64>, bool) {
    let from = trace.partition_point(|(t, _)| *t < met);
    let tail = &trace[from..];
    let found = (0..tail.len()).find(|&n| {
        let rest = &tail[n..tail.len().min(n + 5)];
        rest.iter().all(|(_, torque)| *torque <= ZERO_NMM)
    });
    let Some(at) = found else {
        return (None, false);
    };
    let stays = tail[at..]
        .iter()
        .take_while(|(t, _)| *t <= until)
        .all(|(_, torque)| *torque <= ZERO_NMM);
    (Some((tail[at].0 - met) as f64 * 1e-6), stays)
}

#[cfg(test)]
mod tests;
