//! CSV of every tick and every event, and the setup as JSON.

use crate::recording::{Entry, Readable, Reader};
use anyhow::Context as _;
use osteon_protocol::session::{Mark, Tick};
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// The columns of `ticks.csv`; units at the end of a name.
const COLUMNS: &str = "tick,started_s,late_us,skipped,sample,device_us,encoder_1,encoder_2,encoder_3,gimbal_1,gimbal_2,gimbal_3,buttons,drive_active,docked,applied_1,applied_2,applied_3,ack_age,torque_1,torque_2,torque_3,tool_x_mm,tool_y_mm,tool_z_mm,tool_qx,tool_qy,tool_qz,tool_qw,hand_x_mm,hand_y_mm,hand_z_mm,hand_qx,hand_qy,hand_qz,hand_qw,force_x_n,force_y_n,force_z_n,real_tool_x_n,real_tool_y_n,real_tool_z_n,spindle_rad_s,spindle_nmm,energy_mj,tool,flags,epoch,revision,checkpoints,work,removed_units";

/// Writes the tables into `dir`; the number of ticks.
pub(super) fn write(file: &Path, dir: &Path) -> anyhow::Result<u64> {
    let mut reader = Reader::open(file)?;
    let cannot = |name: &str| format!("{}: cannot be written", dir.join(name).display());
    fs::create_dir_all(dir).with_context(|| cannot(""))?;
    let create = |name: &str| {
        let file = File::create(dir.join(name)).with_context(|| cannot(name))?;
        anyhow::Ok(BufWriter::new(file))
    };
    serde_json::to_writer_pretty(create("setup.json")?, reader.setup())
        .with_context(|| cannot("setup.json"))?;
    let (mut ticks, mut events) = (create("ticks.csv")?, create("events.csv")?);
    let mut showing = Readable::default();
    let mut count = 0;
    let mut put = || -> anyhow::Result<()> {
        writeln!(ticks, "{COLUMNS}")?;
        writeln!(events, "tick,event,detail")?;
        for entry in reader.by_ref() {
            match entry? {
                Entry::Tick(tick) => {
                    writeln!(ticks, "{}", row(&tick))?;
                    for (event, detail) in showing.events(&tick) {
                        writeln!(events, "{},{event},\"{detail}\"", tick.tick)?;
                    }
                    count += 1;
                }
                Entry::Mark(mark) => writeln!(events, "{}", mark_row(&mark))?,
            }
        }
        ticks.flush()?;
        events.flush()?;
        Ok(())
    };
    put().with_context(|| format!("{}: the tables are not whole", dir.display()))?;
    Ok(count)
}

fn mark_row(mark: &Mark) -> String {
    match mark {
        Mark::Digest { ticks, digest } => {
            format!(
                "{ticks},digest,\"{:016x}, epoch {}, revision {}\"",
                digest.hash, digest.epoch, digest.revision
            )
        }
        Mark::Lost { first, count } => format!("{first},lost,\"{count} ticks are missing\""),
        Mark::End {
            ticks,
            digest,
            reason,
        } => {
            let hash = digest.map_or(String::new(), |d| format!(", digest {:016x}", d.hash));
            format!("{ticks},end,\"{}{hash}\"", reason.replace('"', "'"))
        }
    }
}

/// A tick as a line. A tick without a sample leaves its columns empty.
fn row(tick: &Tick) -> String {
    let out = &tick.outcome;
    let mut cells: Vec<String> = vec![
        tick.tick.to_string(),
        format!("{:.9}", tick.started_ns as f64 * 1e-9),
        format!("{:.3}", tick.late_ns as f64 * 1e-3),
        tick.skipped.to_string(),
        u8::from(tick.sample.is_some()).to_string(),
    ];
    if let Some(s) = &tick.sample {
        cells.push(s.time_micros.to_string());
        cells.extend(s.encoders.iter().map(ToString::to_string));
        cells.extend(s.gimbal.iter().map(ToString::to_string));
        cells.push(s.buttons.to_string());
        cells.extend([s.drive_active, s.docked].map(|b| u8::from(b).to_string()));
        cells.extend(s.applied.iter().map(ToString::to_string));
        cells.push(s.ack_age.to_string());
    } else {
        cells.extend(std::iter::repeat_n(String::new(), 14));
    }
    cells.extend(out.torque.iter().map(ToString::to_string));
    for pose in [&out.bone_from_tool, &out.bone_from_device] {
        cells.extend(pose.translation_mm.iter().map(ToString::to_string));
        cells.extend(pose.rotation.iter().map(ToString::to_string));
    }
    let numbers = [
        &out.force_n[..],
        &out.physical_force_n,
        &[out.spindle_rad_s, out.spindle_nmm, out.energy_mj],
    ];
    cells.extend(numbers.concat().iter().map(ToString::to_string));
    cells.extend([out.tool, out.flags].map(|v| v.to_string()));
    cells.push(out.epoch.to_string());
    cells.push(out.revision.to_string());
    cells.push(out.checkpoints.to_string());
    cells.push(out.work.to_string());
    cells.push(out.removed_by_class.iter().sum::<i64>().to_string());
    cells.join(",")
}
