//! A session file as a film: played tick by tick into a publisher, from any moment on.

use super::player::Player;
use super::survey::Survey;
use crate::haptics::{Felt, Flags, Publisher, Record, TickRecord, wire_digest};
use crate::link::LinkStats;
use crate::recording::{Entry, Reader, drive_of};
use anyhow::bail;
use osteon_protocol::session::Tick;
use osteon_sim_core::servo::{CutEvent, Servo, TickOutput};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Copies of the session that are kept to go back to.
const KEYFRAMES: u64 = 12;
/// Shortest time between two of them, ticks.
const LEAST_APART: u64 = 5000;
/// Ticks that are played on the way to a moment between two visits of the viewers.
const AT_ONCE: u64 = 1000;

/// Longest wait for a viewer's last digest.
const ANSWER: Duration = Duration::from_secs(10);

/// The film.
pub(super) struct Film {
    path: PathBuf,
    reader: Reader,
    player: Player,
    // the session before its first tick, and at moments that were reached
    keyframes: Vec<Player>,
    publisher: Publisher,
    survey: Survey,
    now_ns: u64,
    // added to the session's own epochs: viewers know nothing of going back but that epochs rise
    epochs: u32,
}

impl Film {
    pub(super) fn new(path: &Path, servo: Servo, publisher: Publisher) -> anyhow::Result<Self> {
        let player = Player::new(servo);
        Ok(Self {
            path: path.to_owned(),
            reader: Reader::open(path)?,
            keyframes: vec![player.clone()],
            player,
            publisher,
            survey: Survey::of(path)?,
            now_ns: 0,
            epochs: 0,
        })
    }

    /// Length, s.
    pub(super) fn seconds(&self) -> f64 {
        self.survey.seconds()
    }

    /// The present moment of the session, ns.
    pub(super) fn now_ns(&self) -> f64 {
        self.now_ns as f64
    }

    /// Talks to the viewers; true where one of them ends it.
    pub(super) fn visit(&mut self) -> bool {
        self.publisher.visit(None)
    }

    /// Plays the next tick and shows it; false at the end.
    pub(super) fn play_next(&mut self) -> anyhow::Result<bool> {
        let Some((tick, output)) = self.next()? else {
            return Ok(false);
        };
        self.show(&tick, &output);
        Ok(true)
    }

    /// So many ticks on, or back.
    pub(super) fn step(&mut self, ticks: i64) -> anyhow::Result<()> {
        if ticks < 0 {
            let to = self.player.ticks.saturating_sub(ticks.unsigned_abs());
            return self.go_to(to);
        }
        for _ in 0..ticks {
            if !self.play_next()? {
                break;
            }
        }
        Ok(())
    }

    /// To a moment of the session, s.
    pub(super) fn seek(&mut self, seconds: f64) -> anyhow::Result<()> {
        let times = &self.survey.times_ns;
        let tick = times.partition_point(|ns| (*ns as f64) < seconds * 1e9);
        self.go_to(tick as u64)
    }

    /// Compares every viewer's bone with the film's and says farewell.
    pub(super) fn end(mut self) -> anyhow::Result<()> {
        let whole = self.player.whole();
        let mut cut = whole.cut().clone();
        cut.set_epoch(self.publisher.mirror.cut.epoch());
        let digest = wire_digest(cut.digest(whole.bone()));
        let began = Instant::now();
        while began.elapsed() < ANSWER {
            self.publisher.visit(Some(digest));
            if self.publisher.viewers.all_answered() {
                break;
            }
            std::thread::sleep(Duration::from_millis(4));
        }
        let strayed = self
            .publisher
            .viewers
            .reports()
            .filter(|r| r.digest != digest)
            .count();
        self.publisher.viewers.farewell("the replay has ended");
        if strayed > 0 {
            bail!("{strayed} viewers hold another bone than the replay");
        }
        Ok(())
    }

    fn next(&mut self) -> anyhow::Result<Option<(Tick, TickOutput)>> {
        if self.player.ticks == self.survey.ticks {
            return Ok(None);
        }
        let tick = loop {
            match self.reader.next() {
                Some(entry) => {
                    if let Entry::Tick(tick) = entry? {
                        break tick;
                    }
                }
                None => bail!("{}: has changed; start anew", self.path.display()),
            }
        };
        self.keep();
        let (output, difference) = self.player.play(&tick);
        if let Some(difference) = difference {
            bail!(
                "{}: tick {}: {} differs from the recorded one; see 'osteon replay --verify'",
                self.path.display(),
                difference.tick,
                difference.what
            );
        }
        self.now_ns = tick.started_ns;
        Ok(Some((*tick, output)))
    }

    /// Keeps the session as it is, where a copy is due.
    fn keep(&mut self) {
        let apart = (self.survey.ticks / KEYFRAMES).max(LEAST_APART);
        let due = self
            .keyframes
            .last()
            .is_none_or(|last| self.player.ticks >= last.ticks + apart);
        if due {
            self.keyframes.push(self.player.clone());
        }
    }

    /// Makes the moment before tick `to` the present one.
    fn go_to(&mut self, to: u64) -> anyhow::Result<()> {
        let to = to.min(self.survey.ticks);
        let known = self.keyframes.iter().rfind(|k| k.ticks <= to);
        let near = self.player.ticks <= to && known.is_none_or(|k| k.ticks <= self.player.ticks);
        if let Some(known) = known.filter(|_| !near) {
            self.player = known.clone();
            self.reader = Reader::open(&self.path)?;
            self.reader.pass_over(self.player.ticks)?;
        }
        let mut last = None;
        while self.player.ticks < to {
            last = self.next()?;
            if self.player.ticks.is_multiple_of(AT_ONCE) {
                self.publisher.visit(None);
            }
        }
        let begun = usize::try_from(to).ok().and_then(|n| n.checked_sub(1));
        let time = begun.and_then(|n| self.survey.times_ns.get(n));
        self.now_ns = time.copied().unwrap_or(0);
        self.epochs = self.publisher.mirror.cut.epoch() + 1;
        let whole = self.player.whole();
        let epoch = self.epoch(whole.cut().epoch());
        self.publisher.leap(whole.cut(), epoch);
        if let Some((tick, output)) = last {
            self.show_tick(&tick, &output);
        }
        Ok(())
    }

    fn epoch(&self, own: u32) -> u32 {
        self.epochs.wrapping_add(own)
    }

    fn show(&mut self, tick: &Tick, output: &TickOutput) {
        for event in output.events.iter() {
            let record = match event {
                CutEvent::Reset { epoch } => Record::Reset {
                    epoch: self.epoch(epoch),
                },
                CutEvent::Checkpoint { id } => Record::Checkpoint { id },
                CutEvent::Undone { id, epoch } => Record::Undone {
                    id,
                    epoch: self.epoch(epoch),
                },
            };
            self.publisher.take(&record);
        }
        for step in &output.carved[..output.carved_len] {
            self.publisher.take(&Record::Carved {
                tick: tick.tick,
                step: *step,
            });
        }
        self.show_tick(tick, output);
    }

    fn show_tick(&mut self, tick: &Tick, output: &TickOutput) {
        let servo = &self.player.servo;
        let record = TickRecord {
            tick: tick.tick,
            wake_ns: tick.late_ns,
            duration_ns: 0,
            read_ns: 0,
            compute_ns: 0,
            roundtrip_ns: None,
            skipped: tick.skipped,
            state: tick.sample.map(|s| (s.seq, s.time_micros)),
            stylus_in_base: output.stylus_in_base,
            bone_from_device: output.bone_from_device,
            bone_from_tool: output.bone_from_tool,
            force_n: output.force_n,
            felt: Felt::of(output, servo),
            tool: output.tool,
            flags: Flags::of(output),
            removed_by_class: output.removed_by_class,
            epoch: self.epoch(output.epoch),
            checkpoints: output.checkpoints,
            revision: servo.cut().revision() + u64::from(servo.carving()),
            drive: drive_of(tick.link.drive),
            trips: tick.link.trips,
            guards: servo.guards(),
            link: LinkStats {
                frames: tick.link.frames,
                crc_errors: tick.link.crc_errors,
                gaps: tick.link.gaps,
                stale: tick.link.stale,
                dropped_commands: tick.link.dropped_commands,
            },
            ring_overflows: 0,
        };
        self.publisher.take(&Record::Tick(record));
    }
}
