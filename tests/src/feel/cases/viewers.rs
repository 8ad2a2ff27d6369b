//! Viewers that stall: case 37.

use super::Case;
use osteon_firmware_bridge::haptics::rehearsal::{Viewer, rehearse};

/// Ticks of a rehearsal.
const TICKS: u32 = 9000;

/// Case 37.
pub(super) fn stalled() -> Case {
    let alone = rehearse(TICKS, Viewer::Prompt);
    let runs = [
        ("stalled 5 s", Viewer::Stalled { ticks: 5000 }),
        ("killed", Viewer::Killed { at_tick: 2000 }),
        ("queue always full", Viewer::Slow),
    ]
    .map(|(name, viewer)| (name, rehearse(TICKS, viewer)));
    let mut words = Vec::new();
    let mut pass = alone.mirror_equal && alone.lost == 0 && alone.removed > 0;
    for (name, run) in &runs {
        let differ = run
            .torques
            .iter()
            .zip(&alone.torques)
            .filter(|(a, b)| a != b)
            .count();
        let same =
            differ == 0 && run.torques.len() == alone.torques.len() && run.digest == alone.digest;
        pass &= same && run.mirror_equal && run.lost > 0;
        words.push(format!(
            "{name}: {differ} torques differ, {} records did not fit, field equal: {}",
            run.lost, run.mirror_equal
        ));
    }
    Case {
        id: 37,
        name: "Viewers that stall",
        criterion: "time is no criterion on a shared machine. In its place: of 9,000 beats of the servo thread through a cut, with a publisher that stops taking \
                    records for 5 s, one that is gone from tick 2000 on, and one whose queue is full all along, every torque sent and the cut are \
                    bit for bit those with a prompt one, so no work was done for it that the loop waits for; and in the end the publisher's field is the \
                    servo's (of one that is gone: after the session's catching up)"
            .to_owned(),
        measured: words.join("; "),
        pass,
    }
}
