//! A recorded session as the judge takes it: played again, so that the cut and every force are the recorded ones
//! bit for bit, or an error says where they are not.

use super::session::Played;
use super::target::{Target, plan_of};
use crate::recording::{Entry, Moved, Reader, restore};
use crate::replay::Player;
use anyhow::{anyhow, bail};
use osteon_protocol::session::Tick;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::metrics::trace::{SessionTrace, TraceTick};
use osteon_sim_core::servo::TickOutput;
use std::path::{Path, PathBuf};

/// Plays the recording at `path`; where its files are now is in `moved`.
pub(super) fn replayed(path: &Path, moved: &Moved) -> anyhow::Result<(Target, Played)> {
    let mut reader = Reader::open(path)?;
    let setup = reader.setup().clone();
    let recorded = setup.scene.scene.as_ref().map(PathBuf::from);
    let dir = moved.scene.clone().or(recorded).ok_or_else(|| {
        anyhow!(
            "{}: its scene has no plan of a component; record with --scene DIR",
            path.display()
        )
    })?;
    let restored = restore(&setup, moved)?;
    let plan = plan_of(&dir)?;
    let tools = restored.tools.iter();
    let mut trace = SessionTrace {
        ticks: Vec::new(),
        tools: tools.map(|t| (t.id.clone(), t.name.clone())).collect(),
    };
    let target = Target::of(restored.scene, plan)?;
    let grid = *target.scene.bone.grid();
    let mut player = Player::new(restored.servo);
    for entry in reader.by_ref() {
        let Entry::Tick(tick) = entry? else {
            continue;
        };
        if tick.tick != player.ticks {
            bail!(
                "{}: tick {} is missing, because the disk was too slow while recording; the session cannot be judged",
                path.display(),
                player.ticks
            );
        }
        let (output, difference) = player.play(&tick);
        if let Some(d) = difference {
            bail!(
                "{}: tick {}: {} differs from the recorded one; judge it with the release that recorded it ({})",
                path.display(),
                d.tick,
                d.what,
                setup.software
            );
        }
        trace.ticks.push(trace_tick(&grid, &tick, &output));
    }
    player.servo.finish_carving();
    let cut = player.servo.cut().clone();
    Ok((target, Played { trace, cut }))
}

fn trace_tick(grid: &Grid, tick: &Tick, output: &TickOutput) -> TraceTick {
    TraceTick {
        tick: tick.tick,
        bone_from_tool: output.bone_from_tool,
        shown_n: output.force_n,
        physical_n: output.physical_force_n.length(),
        tool: output.tool,
        spindle_on: output.spindle_on,
        removed_mm3: output.removed_by_class.map(|units| Cut::mm3(grid, units)),
    }
}
