//! Playing a session again as fast as it goes, and comparing every tick bit for bit.

use super::player::{Difference, Player};
use super::survey::Survey;
use crate::progress::Progress;
use crate::recording::{Entry, Moved, Reader, restore};
use anyhow::{anyhow, bail};
use osteon_protocol::ipc::Digest;
use osteon_sim_core::cut::{Cut, CutDigest};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What was compared, and found equal.
#[derive(Debug, Clone, Serialize)]
pub struct Verified {
    /// The file.
    pub file: PathBuf,
    /// What recorded it.
    pub recorded_by: String,
    /// Where its bone is from.
    pub bone: String,
    /// Ticks whose poses, forces, torques and sums are equal bit for bit.
    pub ticks: u64,
    /// Length of the session, s.
    pub seconds: f64,
    /// Time that playing it took, s; loading is not in it.
    pub took_s: f64,
    /// How many times faster than real time.
    pub times_real_time: f64,
    /// Digests of the cut that are equal.
    pub digests: u64,
    /// Whether the digest at the session's end is among them.
    pub end_digest: bool,
    /// Volume removed in the end, mm³.
    pub removed_mm3: f64,
    /// Why the session ended; absent where the file was cut short before its end.
    pub ended: Option<String>,
    /// Why the file has no end.
    pub cut_short: Option<String>,
}

/// Plays `path` and compares; an error names the first tick that differs, or the file that is not the
/// recorded one.
pub fn verify(path: &Path, moved: &Moved) -> anyhow::Result<Verified> {
    let survey = Survey::of(path)?;
    let mut reader = Reader::open(path)?;
    let setup = reader.setup().clone();
    let restored = restore(&setup, moved)?;
    let mut player = Player::new(restored.servo);
    let began = Instant::now();
    let mut digests = play_all(path, &mut reader, &mut player, &survey)?;
    let took_s = began.elapsed().as_secs_f64();
    if survey.lost > 0 {
        bail!(
            "{}: the first {} ticks are equal bit for bit; then {} are missing, because the disk was too slow while recording, and the rest cannot be played",
            path.display(),
            player.ticks,
            survey.lost
        );
    }
    player.servo.finish_carving();
    let (cut, bone) = (player.servo.cut(), player.servo.bone());
    let end = survey.end.as_ref().and_then(|(_, digest)| *digest);
    if let Some(recorded) = end {
        compare(path, player.ticks, recorded, cut.digest(bone))?;
        digests += 1;
    }
    let seconds = survey.seconds();
    Ok(Verified {
        file: path.to_owned(),
        recorded_by: setup.software,
        bone: restored.scene.source,
        ticks: player.ticks,
        seconds,
        took_s,
        times_real_time: seconds / took_s,
        digests,
        end_digest: end.is_some(),
        removed_mm3: Cut::mm3(bone.grid(), cut.totals().units()),
        ended: survey.end.map(|(reason, _)| reason),
        cut_short: survey.cut_short,
    })
}

/// Plays all ticks that the file holds without a gap; the number of digests on the way.
fn play_all(
    path: &Path,
    reader: &mut Reader,
    player: &mut Player,
    survey: &Survey,
) -> anyhow::Result<u64> {
    let mut progress = Progress::new("replaying");
    let mut digests = 0;
    while player.ticks < survey.ticks {
        let Some(entry) = reader.next() else {
            bail!("{}: changed while it was read; try again", path.display());
        };
        let Entry::Tick(tick) = entry? else {
            continue;
        };
        if let (_, Some(difference)) = player.play(&tick) {
            progress.finish();
            return Err(differs(path, &reader.setup().software, &difference));
        }
        if let Some(recorded) = survey.digests.get(&player.ticks) {
            compare(path, player.ticks, *recorded, player.digest())?;
            digests += 1;
        }
        if player.ticks.is_multiple_of(1024) {
            progress.show("", player.ticks as f32 / survey.ticks as f32);
        }
    }
    progress.finish();
    Ok(digests)
}

fn differs(path: &Path, software: &str, difference: &Difference) -> anyhow::Error {
    anyhow!(
        "{}: tick {} ({:.3} s): {} differs from the recorded one (recorded by {software}, this is {})\n  recorded: {}\n  replayed: {}",
        path.display(),
        difference.tick,
        difference.tick as f64 * 1e-3,
        difference.what,
        env!("CARGO_PKG_VERSION"),
        difference.recorded,
        difference.replayed
    )
}

fn compare(path: &Path, ticks: u64, recorded: Digest, replayed: CutDigest) -> anyhow::Result<()> {
    let replayed = crate::haptics::wire_digest(replayed);
    if recorded == replayed {
        return Ok(());
    }
    bail!(
        "{}: after {ticks} ticks the bone differs: recorded {recorded:?}, replayed {replayed:?}",
        path.display()
    )
}

impl Verified {
    /// In one or two lines.
    pub fn in_words(&self) -> String {
        let end = match (&self.ended, &self.cut_short) {
            (Some(reason), _) => format!("ended {reason}"),
            (None, Some(why)) => format!("cut short ({why}): what was recorded is played whole"),
            (None, None) => "without an end: the recording process was killed".to_owned(),
        };
        format!(
            "{}: {} ticks equal bit for bit (poses, forces, torques, sums), {} digests of the bone equal{}; {:.1} mm³ removed\n{:.1} s of session in {:.2} s, {:.1} times real time; {end}",
            self.file.display(),
            self.ticks,
            self.digests,
            if self.end_digest {
                ", the last at its end"
            } else {
                ""
            },
            self.removed_mm3,
            self.seconds,
            self.took_s,
            self.times_real_time
        )
    }
}
