//! Tables and volumes of a session file for other programs.

mod surface;
mod table;
#[cfg(test)]
mod tests;
mod volume;

use crate::progress::Progress;
use crate::recording::{Entry, Moved, Reader, restore};
use crate::replay::{Player, Survey};
use anyhow::{Context as _, bail};
use osteon_sim_core::servo::Servo;
use std::path::PathBuf;

/// Options of an export.
#[derive(Debug, Clone, clap::Args)]
pub struct ExportArgs {
    /// Session file, as 'osteon haptics --record FILE' writes it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Tables of every tick, every event and what the session began with: ticks.csv, events.csv,
    /// setup.json
    #[arg(long, value_name = "DIR")]
    pub csv: Option<PathBuf>,
    /// The bone as it was left: CT numbers, -1000 HU where it is cut away or was never solid; NIfTI (.nii)
    #[arg(long, value_name = "FILE")]
    pub nifti: Option<PathBuf>,
    /// The same as NRRD (.nrrd)
    #[arg(long, value_name = "FILE")]
    pub nrrd: Option<PathBuf>,
    /// The surface of the bone as it was left; binary STL, DICOM LPS, mm
    #[arg(long, value_name = "FILE")]
    pub stl: Option<PathBuf>,
    /// The bone as it was at this time of the session, s [default: at its end]
    #[arg(long, value_name = "S", value_parser = crate::haptics::positive)]
    pub at: Option<f64>,
    /// Where its files are now.
    #[command(flatten)]
    pub moved: Moved,
}

/// Exports what is asked for.
#[expect(
    clippy::print_stdout,
    reason = "what a command-line program has written"
)]
pub fn run(args: &ExportArgs) -> anyhow::Result<()> {
    let wants_bone = args.nifti.is_some() || args.nrrd.is_some() || args.stl.is_some();
    if !wants_bone && args.csv.is_none() {
        bail!("nothing to export; give --csv DIR, --nifti FILE, --nrrd FILE or --stl FILE");
    }
    if let Some(dir) = &args.csv {
        let rows = table::write(&args.file, dir)?;
        println!("{}: {rows} ticks", dir.display());
    }
    if !wants_bone {
        return Ok(());
    }
    let servo = bone_at(args)?;
    let (bone, cut) = (servo.bone(), servo.cut());
    if let Some(path) = &args.nifti {
        volume::nifti(path, bone, cut)?;
        println!("{}: {:?} voxels", path.display(), bone.grid().dims);
    }
    if let Some(path) = &args.nrrd {
        volume::nrrd(path, bone, cut)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        println!("{}: {:?} voxels", path.display(), bone.grid().dims);
    }
    if let Some(path) = &args.stl {
        let mesh = surface::of(bone, cut);
        mesh.write_stl(path)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        println!(
            "{}: {} triangles, {:.1} mm³",
            path.display(),
            mesh.triangles.len(),
            mesh.volume_mm3()
        );
    }
    Ok(())
}

/// The servo as it was at the time asked for: the session is played again up to there, and compared.
fn bone_at(args: &ExportArgs) -> anyhow::Result<Servo> {
    let survey = Survey::of(&args.file)?;
    let mut reader = Reader::open(&args.file)?;
    let mut player = Player::new(restore(reader.setup(), &args.moved)?.servo);
    let until_ns = args.at.map_or(f64::INFINITY, |s| s * 1e9);
    let mut progress = Progress::new("replaying");
    while player.ticks < survey.ticks {
        let Some(entry) = reader.next() else {
            break;
        };
        let Entry::Tick(tick) = entry? else {
            continue;
        };
        if tick.started_ns as f64 > until_ns {
            break;
        }
        if let (_, Some(difference)) = player.play(&tick) {
            bail!(
                "{}: tick {}: {} differs from the recorded one, so the bone would be another; see 'osteon replay --verify'",
                args.file.display(),
                difference.tick,
                difference.what
            );
        }
        if player.ticks.is_multiple_of(1024) {
            progress.show("", player.ticks as f32 / survey.ticks as f32);
        }
    }
    progress.finish();
    player.servo.finish_carving();
    Ok(player.servo)
}
