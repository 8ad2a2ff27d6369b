//! One recorded tick after the other through the servo's pure step.

use crate::recording::{outcome, request_of, sample_of};
use osteon_protocol::ipc::WirePose;
use osteon_protocol::session::{self, Outcome, Tick};
use osteon_sim_core::cut::CutDigest;
use osteon_sim_core::servo::{MAX_REQUESTS, Request, Servo, TickOutput};

/// What a replay does otherwise than the recording.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Difference {
    pub tick: u64,
    pub what: &'static str,
    pub recorded: String,
    pub replayed: String,
}

/// A session that is played again.
#[derive(Debug, Clone)]
pub(crate) struct Player {
    pub servo: Servo,
    /// Ticks that are over.
    pub ticks: u64,
}

impl Player {
    pub(crate) fn new(servo: Servo) -> Self {
        Self { servo, ticks: 0 }
    }

    /// Plays a tick, the next one; where it came out otherwise, that as well.
    pub(crate) fn play(&mut self, tick: &Tick) -> (TickOutput, Option<Difference>) {
        let mut requests = [Request::Reset; MAX_REQUESTS];
        let mut count = 0;
        if tick.requests.contains(&session::Request::Reconnected) {
            self.servo.reconnect();
        }
        let asked = tick.requests.iter().filter_map(|r| request_of(*r));
        for (to, from) in requests.iter_mut().zip(asked) {
            *to = from;
            count += 1;
        }
        let sample = tick.sample.as_ref().map(sample_of);
        let output = self.servo.tick(sample.as_ref(), &requests[..count]);
        self.ticks += 1;
        let replayed = outcome(&output, &self.servo);
        let differs = difference(&tick.outcome, &replayed).map(|what| Difference {
            tick: tick.tick,
            what,
            recorded: format!("{:?}", tick.outcome),
            replayed: format!("{replayed:?}"),
        });
        (output, differs)
    }

    /// A copy whose steps are all carved whole that have begun. For between two ticks.
    pub(crate) fn whole(&self) -> Servo {
        let mut whole = self.servo.clone();
        whole.finish_carving();
        whole
    }

    /// The cut of [`Self::whole`].
    pub(crate) fn digest(&self) -> CutDigest {
        let whole = self.whole();
        whole.cut().digest(whole.bone())
    }
}

/// What differs in a single bit, by name.
fn difference(a: &Outcome, b: &Outcome) -> Option<&'static str> {
    let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
    let pose = |a: &WirePose, b: &WirePose| {
        same(&a.rotation, &b.rotation) && same(&a.translation_mm, &b.translation_mm)
    };
    let checks = [
        (
            "the stylus's pose",
            pose(&a.bone_from_device, &b.bone_from_device),
        ),
        (
            "the tool's pose",
            pose(&a.bone_from_tool, &b.bone_from_tool),
        ),
        ("the force", same(&a.force_n, &b.force_n)),
        (
            "the force at a real tool",
            same(&a.physical_force_n, &b.physical_force_n),
        ),
        ("the torque command", a.torque == b.torque),
        (
            "the spindle",
            same(
                &[a.spindle_rad_s, a.spindle_nmm],
                &[b.spindle_rad_s, b.spindle_nmm],
            ),
        ),
        ("the energy account", same(&[a.energy_mj], &[b.energy_mj])),
        (
            "the removed volume",
            a.removed_by_class == b.removed_by_class,
        ),
        (
            "the state of the cut",
            (a.epoch, a.revision, a.work, a.checkpoints)
                == (b.epoch, b.revision, b.work, b.checkpoints),
        ),
        ("tool or switches", (a.tool, a.flags) == (b.tool, b.flags)),
    ];
    checks
        .into_iter()
        .find(|(_, same)| !same)
        .map(|(what, _)| what)
}
