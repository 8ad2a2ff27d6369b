//! What a session file shows in JSON: poses and forces a hundred times a second, events, health.

use super::entry::drive_of;
use crate::fake::truth::drive_name;
use osteon_protocol::ipc::WirePose;
use osteon_protocol::session::{Request, Tick, flag};
use serde_json::{Value, json};

/// A channel for people.
pub(super) struct Topic {
    pub(super) topic: &'static str,
    pub(super) schema: &'static str,
    pub(super) json: &'static str,
}

/// The channels; their places are [`POSE`], [`FORCE`], [`EVENT`], [`HEALTH`].
pub(super) const TOPICS: [Topic; 4] = [
    Topic {
        topic: "/pose",
        schema: "osteon.Pose",
        json: include_str!("schema/pose.json"),
    },
    Topic {
        topic: "/force",
        schema: "osteon.Force",
        json: include_str!("schema/force.json"),
    },
    Topic {
        topic: "/events",
        schema: "osteon.Event",
        json: include_str!("schema/event.json"),
    },
    Topic {
        topic: "/health",
        schema: "osteon.Health",
        json: include_str!("schema/health.json"),
    },
];
pub(super) const POSE: usize = 0;
pub(super) const FORCE: usize = 1;
pub(super) const EVENT: usize = 2;
pub(super) const HEALTH: usize = 3;

/// Ticks between two poses: a hundred a second.
const EVERY: u64 = 10;
/// Names of the flags whose changes are events.
const FLAGS: [(u8, &str); 5] = [
    (flag::SPINDLE_ON, "spindle"),
    (flag::PAUSED, "paused"),
    (flag::EMBEDDED, "tool appeared inside bone"),
    (flag::WAITING, "waiting for the tool in front of the joint"),
    (flag::CLUTCHED, "clutch"),
];

/// What was shown last.
#[derive(Debug, Default)]
pub(crate) struct Readable {
    last: Option<Tick>,
    peak_n: f64,
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

fn pose(pose: &WirePose) -> Value {
    json!({ "position_mm": pose.translation_mm, "rotation_xyzw": pose.rotation })
}

impl Readable {
    /// The messages of a tick, each with its place in [`TOPICS`].
    pub(super) fn of_tick(&mut self, tick: &Tick) -> Vec<(usize, Value)> {
        let mut shown = Vec::new();
        let outcome = &tick.outcome;
        self.peak_n = self.peak_n.max(length(outcome.force_n));
        for (what, detail) in self.events(tick) {
            shown.push((
                EVENT,
                json!({ "tick": tick.tick, "event": what, "detail": detail }),
            ));
        }
        if tick.tick.is_multiple_of(EVERY) {
            shown.push((
                POSE,
                json!({
                    "tick": tick.tick,
                    "tool": outcome.tool,
                    "bone_from_tool": pose(&outcome.bone_from_tool),
                    "bone_from_device": pose(&outcome.bone_from_device),
                }),
            ));
            shown.push((FORCE, self.force(tick)));
        }
        shown
    }

    fn force(&mut self, tick: &Tick) -> Value {
        let outcome = &tick.outcome;
        json!({
            "tick": tick.tick,
            "force_n": outcome.force_n,
            "largest_n": core::mem::take(&mut self.peak_n),
            "real_tool_n": outcome.physical_force_n,
            "spindle_rpm": outcome.spindle_rad_s * 60.0 / std::f64::consts::TAU,
            "spindle_nmm": outcome.spindle_nmm,
        })
    }

    /// The force of the last ticks, which no message has told yet, and when it was, ns.
    pub(super) fn rest(&mut self) -> Option<(u64, Value)> {
        let last = self.last.take()?;
        let told = last.tick.is_multiple_of(EVERY);
        (!told).then(|| (last.started_ns, self.force(&last)))
    }

    /// What happened in a tick, the next one: names and details.
    pub(crate) fn events(&mut self, tick: &Tick) -> Vec<(&'static str, String)> {
        let happened = events(self.last.as_ref(), tick);
        self.last = Some(tick.clone());
        happened
    }
}

/// What happened in a tick: name and detail.
fn events(last: Option<&Tick>, tick: &Tick) -> Vec<(&'static str, String)> {
    let mut events: Vec<(&'static str, String)> = tick
        .requests
        .iter()
        .map(|r| ("request", request(*r)))
        .collect();
    if tick.skipped > 0 {
        events.push(("periods skipped", tick.skipped.to_string()));
    }
    let drive = |tick: &Tick| {
        let state = drive_of(tick.link.drive);
        state.map_or("no device", drive_name).to_owned()
    };
    let (out, link) = (&tick.outcome, &tick.link);
    let Some(last) = last else {
        events.push(("begin", format!("drive {}", drive(tick))));
        return events;
    };
    let (old, before) = (&last.outcome, &last.link);
    if out.tool != old.tool {
        events.push(("tool", out.tool.to_string()));
    }
    for (bit, name) in FLAGS {
        if (out.flags ^ old.flags) & bit != 0 {
            let state = if out.flags & bit == 0 { "off" } else { "on" };
            events.push((name, state.to_owned()));
        }
    }
    if out.epoch != old.epoch || out.checkpoints != old.checkpoints {
        let text = format!("epoch {}, {} checkpoints", out.epoch, out.checkpoints);
        events.push(("cut", text));
    }
    if link.drive != before.drive {
        events.push(("drive", drive(tick)));
    }
    if link.faults != before.faults {
        events.push(("device faults", format!("{:#06x}", link.faults)));
    }
    if link.trips != before.trips {
        events.push(("watchdog trip", link.trips.to_string()));
    }
    for (name, now, then) in [
        ("frames damaged", link.crc_errors, before.crc_errors),
        ("frames missing", link.gaps, before.gaps),
        ("frames stale", link.stale, before.stale),
        (
            "commands dropped",
            link.dropped_commands,
            before.dropped_commands,
        ),
    ] {
        if now != then {
            events.push((name, now.wrapping_sub(then).to_string()));
        }
    }
    events
}

fn request(request: Request) -> String {
    match request {
        Request::SelectTool(tool) => format!("tool {tool}"),
        Request::Spindle(on) => format!("spindle {}", if on { "on" } else { "off" }),
        Request::Pause(on) => format!("pause {}", if on { "on" } else { "off" }),
        Request::Reset => "reset".to_owned(),
        Request::Clutch(on) => format!("clutch {}", if on { "on" } else { "off" }),
        Request::MotionScale(scale) => format!("motion scale {scale}"),
        Request::TurnWorkspace(angle) => format!("turn of the workspace {angle} rad"),
        Request::Checkpoint => "checkpoint".to_owned(),
        Request::Undo => "undo".to_owned(),
        Request::Reconnected => "device connected again".to_owned(),
    }
}
