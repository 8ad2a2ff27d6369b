//! The viewers of a session: a waiting room for connections that have not joined, a seat for each
//! viewer, and one in control. All of it is bounded, whatever comes in at the door.

mod complaints;
mod control;
mod dirty;
mod line;
mod pace;
mod seat;
mod sent;
#[cfg(test)]
mod tests;

pub(crate) use line::{Peer, Wire};
pub(crate) use seat::ViewerReport;

use super::mirror::Mirror;
use super::publisher::warn;
use complaints::Complaints;
use control::{Control, Standing};
use line::{Ended, Line};
use osteon_protocol::ipc::{
    Command, ControlState, Digest, FromViewer, Health, IPC_VERSION, Join, MAX_VIEWERS, PoseUpdate,
    RemovalEvent, Resume, Scene, ToViewer, ViewerInfo, capability,
};
use seat::Seat;
use std::time::{Duration, Instant};

const BATCH_BYTES: usize = 256 * 1024; // put together before they are written
const WAITING_ROOM: usize = 16; // connections that may wait to join
const JOIN_TIMEOUT: Duration = Duration::from_secs(3); // from the first byte to the seat
const SEAT_KEPT: Duration = Duration::from_secs(30); // for a viewer that was lost
const STUCK: Duration = Duration::from_secs(2); // who takes no byte holds nobody up who asks for control

/// What happened to the viewers.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ViewerCounts {
    /// Viewers that joined, resumed ones included.
    pub connected: u64,
    /// Of them: came back to their seat.
    pub resumed: u64,
    /// Connections of viewers that ended before the session did.
    pub lost: u64,
    /// Connections that were refused or dropped for what they sent.
    pub refused: u64,
    /// Wishes that were refused because another viewer is in control.
    pub denied: u64,
    /// Commands that found the servo's ring full.
    pub dropped_commands: u64,
    /// Most bytes of memory held for viewers at one time.
    pub peak_bytes: usize,
    /// Most viewers at one time, those included whose seat was kept.
    pub most: usize,
}

/// What the publisher has to tell at this moment.
pub(crate) struct News<'a> {
    pub mirror: &'a Mirror,
    pub pose: Option<&'a PoseUpdate>,
    pub health: Option<&'a Health>,
    /// Set at the session's end: the digest that viewers must answer.
    pub final_digest: Option<Digest>,
    pub control: &'a ControlState,
    /// Counts the changes of `control`.
    pub control_change: u64,
}

/// What the publisher knows, before the viewers add who is in control.
pub(crate) struct Facts<'a> {
    pub scene: &'a Scene,
    pub mirror: &'a Mirror,
    pub pose: Option<PoseUpdate>,
    pub health: Option<&'a Health>,
    pub final_digest: Option<Digest>,
}

/// A connection that has not joined.
struct Waiting {
    line: Line,
    peer: Peer,
    // said hello
    name: Option<String>,
}

/// All viewers.
pub(crate) struct Viewers {
    chunks: usize,
    session: u64,
    next_number: u16,
    waiting: Vec<Waiting>,
    seats: Vec<Seat>,
    control: Control,
    change: u64,
    pub counts: ViewerCounts,
    /// A viewer that held the clutch has gone, or is in control no more.
    pub let_go: bool,
    complaints: Complaints,
}

impl Viewers {
    /// None yet, over a bone of so many chunks.
    pub(crate) fn new(chunks: usize) -> Self {
        Self {
            chunks,
            session: random(),
            next_number: 1,
            waiting: Vec::new(),
            seats: Vec::new(),
            control: Control::default(),
            change: 1,
            counts: ViewerCounts::default(),
            let_go: false,
            complaints: Complaints::new(Instant::now()),
        }
    }

    /// A brick has changed.
    pub(crate) fn mark(&mut self, chunk: usize, brick: usize) {
        for seat in &mut self.seats {
            seat.dirty.mark(chunk, brick);
        }
    }

    /// A sub-step was carved.
    pub(crate) fn removal(&mut self, event: &RemovalEvent) {
        for seat in &mut self.seats {
            seat.removal(event);
        }
    }

    /// The cut was reset.
    pub(crate) fn reset(&mut self, epoch: u32) {
        for seat in &mut self.seats {
            seat.reset(epoch);
        }
    }

    /// The cut is a checkpoint's again.
    pub(crate) fn undone(&mut self, epoch: u32, removed_mm3_by_class: [f64; 8]) {
        for seat in &mut self.seats {
            seat.undone(epoch, removed_mm3_by_class);
        }
    }

    /// What the viewers answered to the last digest.
    pub(crate) fn reports(&self) -> impl Iterator<Item = ViewerReport> {
        self.seats.iter().filter_map(|s| s.report)
    }

    /// Whether every connected viewer that answers digests has.
    pub(crate) fn all_answered(&self) -> bool {
        let mut here = self.seats.iter().filter(|s| s.line.is_some());
        here.all(|s| s.report.is_some() || !s.has(capability::DIGEST))
    }

    /// Lets a connection into the waiting room. Where that is full, the one that has waited longest
    /// goes: a viewer says at once what it wants.
    pub(crate) fn admit(&mut self, wire: Box<dyn Wire>, peer: Peer) {
        if self.waiting.len() >= WAITING_ROOM {
            self.waiting.remove(0);
            self.refuse(
                "a connection",
                "was too slow to join while many others came",
            );
        }
        self.waiting.push(Waiting {
            line: Line::new(wire),
            peer,
            name: None,
        });
    }

    /// Counts a connection that was refused at the door.
    pub(crate) fn refuse(&mut self, who: &str, why: &str) {
        self.counts.refused += 1;
        self.complain(format!("{who} {why}"));
    }

    fn complain(&mut self, line: String) {
        for line in self.complaints.line(line, Instant::now()) {
            warn(&line);
        }
    }

    /// Talks to all of them; the wishes of the one in control.
    pub(crate) fn visit(&mut self, facts: &Facts<'_>) -> Vec<Command> {
        self.greet(facts);
        let state = self.state();
        let news = News {
            mirror: facts.mirror,
            pose: facts.pose.as_ref(),
            health: facts.health,
            final_digest: facts.final_digest,
            control: &state,
            control_change: self.change,
        };
        let mut wishes = Vec::new();
        let mut ended = Vec::new();
        for seat in &mut self.seats {
            match seat.visit(&news) {
                Ok(commands) => wishes.extend(commands.into_iter().map(|c| (seat.number, c))),
                Err(end) => ended.push((seat.number, end)),
            }
        }
        for (number, end) in ended {
            self.lost(number, &end);
        }
        self.forget_the_absent();
        self.counts.peak_bytes = self.counts.peak_bytes.max(self.held());
        self.counts.most = self.counts.most.max(self.seats.len());
        wishes
            .into_iter()
            .filter_map(|(number, command)| self.wish(number, command))
            .collect()
    }

    /// Says goodbye to all.
    pub(crate) fn farewell(&mut self, reason: &str) {
        let bye = ToViewer::Bye {
            reason: reason.to_owned(),
        };
        let mut lines = Vec::new();
        for seat in &mut self.seats {
            if let Some(line) = &mut seat.line
                && let Err(e) = line.say_last(&bye)
            {
                lines.push(format!("viewer '{}': {e}", seat.name));
            }
        }
        lines.extend(self.complaints.rest());
        for line in lines {
            warn(&line);
        }
    }

    /// Bytes of memory held for viewers.
    pub(crate) fn held(&self) -> usize {
        let waiting: usize = self.waiting.iter().map(|w| w.line.held()).sum();
        waiting + self.seats.iter().map(Seat::held).sum::<usize>()
    }

    /// Most bytes that [`Self::held`] can give with so many viewers, whatever they do.
    pub(crate) fn most_held(chunks: usize, viewers: usize) -> usize {
        WAITING_ROOM * Line::MOST_HELD + viewers.min(MAX_VIEWERS) * Seat::most_held(chunks)
    }

    fn greet(&mut self, facts: &Facts<'_>) {
        for mut waiting in std::mem::take(&mut self.waiting) {
            match waiting.hear() {
                Ok(None) if waiting.line.since.elapsed() > JOIN_TIMEOUT => {
                    let name = waiting.name.unwrap_or_else(|| "viewer".to_owned());
                    self.refuse(
                        &format!("viewer '{name}':"),
                        "said nothing for 3 s; is it an Osteon viewer?",
                    );
                }
                Ok(None) => self.waiting.push(waiting),
                Ok(Some(join)) => self.join(waiting, &join, facts),
                // somebody only looked whether we are there
                Err(Ended::Left(_)) if waiting.name.is_none() => {}
                Err(end) => {
                    let name = waiting.name.unwrap_or_else(|| "viewer".to_owned());
                    self.refuse(&format!("viewer '{name}':"), &end.to_string());
                }
            }
        }
    }

    fn join(&mut self, waiting: Waiting, join: &Join, facts: &Facts<'_>) {
        let Waiting {
            mut line,
            name,
            peer,
        } = waiting;
        let name = name.unwrap_or_default();
        let kept = join
            .resume
            .and_then(|resume| Some((self.kept(&resume, peer)?, resume)));
        let outcome = if let Some((at, resume)) = kept {
            self.counts.resumed += 1;
            self.seats[at].welcome_back(line, self.session, join, &resume, facts.mirror)
        } else {
            if self.seats.len() >= MAX_VIEWERS && !self.give_up_an_empty_seat() {
                let reason = format!("{MAX_VIEWERS} viewers are connected; close one first");
                self.refuse(&format!("viewer '{name}':"), &reason);
                // it may not hear it
                line.say_last(&ToViewer::Refused { reason }).unwrap_or(());
                return;
            }
            let number = self.new_number();
            let mut seat = Seat::new((number, random(), peer), name, join, self.chunks);
            let epoch = facts.mirror.cut.epoch();
            let outcome = seat.welcome(line, self.session, facts.scene, epoch);
            let holder = self.holder();
            self.control.joined(standing(&seat), holder);
            self.seats.push(seat);
            outcome
        };
        self.counts.connected += 1;
        self.change += 1;
        if let Err(end) = outcome {
            self.complain(format!("a viewer: {end}"));
        }
    }

    /// Where the seat is that a viewer wants back.
    fn kept(&self, resume: &Resume, peer: Peer) -> Option<usize> {
        let ours = resume.session == self.session;
        let is_it = |s: &Seat| s.token == resume.seat && s.peer == peer;
        let at = self.seats.iter().position(is_it);
        at.filter(|_| ours)
    }

    fn new_number(&mut self) -> u16 {
        loop {
            let number = self.next_number;
            self.next_number = self.next_number.checked_add(1).unwrap_or(1);
            if self.seats.iter().all(|s| s.number != number) {
                return number;
            }
        }
    }

    /// A connection is over; the seat is kept for one that may come back.
    fn lost(&mut self, number: u16, end: &Ended) {
        let Some(at) = self.seats.iter().position(|s| s.number == number) else {
            return;
        };
        let seat = &mut self.seats[at];
        seat.left_at = Some(Instant::now());
        self.let_go |= std::mem::take(&mut seat.holds_clutch);
        let text = format!("viewer '{}': {end}", seat.name);
        if seat.is_live() && matches!(end, Ended::Left(_)) {
            self.counts.lost += 1;
        } else {
            self.counts.refused += 1;
        }
        self.control.left(number);
        if matches!(end, Ended::Rude(_)) || !self.seats[at].has(capability::RESUME) {
            self.give_up(at);
        }
        self.change += 1;
        self.complain(text);
    }

    fn give_up(&mut self, at: usize) {
        let seat = self.seats.remove(at);
        self.control.gone(seat.number);
        self.change += 1;
    }

    fn give_up_an_empty_seat(&mut self) -> bool {
        let empty = self
            .seats
            .iter()
            .enumerate()
            .filter(|(_, s)| s.line.is_none());
        let longest = empty.min_by_key(|(_, s)| s.left_at).map(|(at, _)| at);
        if let Some(at) = longest {
            self.give_up(at);
        }
        longest.is_some()
    }

    fn forget_the_absent(&mut self) {
        let over = |s: &Seat| s.line.is_none() && s.left_at.is_none_or(|t| t.elapsed() > SEAT_KEPT);
        while let Some(at) = self.seats.iter().position(over) {
            self.give_up(at);
        }
    }

    fn holder(&self) -> Option<Standing> {
        self.control.holder.and_then(|n| self.standing_of(n))
    }

    fn standing_of(&self, number: u16) -> Option<Standing> {
        let seat = self.seats.iter().find(|s| s.number == number);
        seat.map(standing)
    }

    fn state(&self) -> ControlState {
        let info = |s: &Seat| ViewerInfo {
            number: s.number,
            role: s.role,
            present: s.line.is_some(),
            name: s.name.clone(),
        };
        ControlState {
            holder: self.control.holder,
            asking: self.control.asking,
            viewers: self.seats.iter().map(info).collect(),
        }
    }

    /// A wish of a viewer: what of it goes to the servo.
    fn wish(&mut self, number: u16, command: Command) -> Option<Command> {
        let who = self.standing_of(number)?;
        let before = self.control;
        let outcome = match command {
            Command::AskControl => self.control.asked(who, self.holder()),
            Command::HandOver(to) => {
                let to = self.standing_of(to);
                self.control.handed_over(number, to)
            }
            _ if self.control.is_held_by(number) => {
                if let (Command::Clutch(hold), Some(seat)) = (command, self.seat(number)) {
                    seat.holds_clutch = hold;
                }
                return Some(command);
            }
            _ => Err(match before.holder {
                Some(holder) => format!("viewer {holder} is in control; ask for it first"),
                None => "nobody is in control; ask for it first".to_owned(),
            }),
        };
        if self.control != before {
            self.change += 1;
            self.release_clutch(before.holder);
        }
        if let Err(reason) = outcome {
            self.counts.denied += 1;
            if let Some(seat) = self.seat(number) {
                seat.deny(reason);
            }
        }
        None
    }

    fn seat(&mut self, number: u16) -> Option<&mut Seat> {
        self.seats.iter_mut().find(|s| s.number == number)
    }

    /// One that is in control no more holds no clutch.
    fn release_clutch(&mut self, before: Option<u16>) {
        if before != self.control.holder
            && let Some(seat) = before.and_then(|n| self.seat(n))
        {
            let held = std::mem::take(&mut seat.holds_clutch);
            self.let_go |= held;
        }
    }
}

fn standing(seat: &Seat) -> Standing {
    Standing {
        number: seat.number,
        role: seat.role,
        may: seat.has(capability::CONTROL),
        present: seat.line.is_some(),
        stuck: seat.line.as_ref().is_some_and(|l| l.stuck_for() > STUCK),
    }
}

impl Waiting {
    /// Reads what has come; the viewer's second message, once it is here.
    fn hear(&mut self) -> Result<Option<Join>, Ended> {
        self.line.read()?;
        while let Some(message) = self.line.next()? {
            match (message, self.name.is_some()) {
                (FromViewer::Hello { version, name }, false) => self.hello(version, name)?,
                (FromViewer::Join(join), true) => return Ok(Some(join)),
                (FromViewer::Hello { .. }, true) => {
                    return Err(Ended::Rude("said hello twice".to_owned()));
                }
                (_, false) => return Err(Ended::Rude("spoke before its hello".to_owned())),
                (_, true) => return Err(Ended::Rude("spoke before it joined".to_owned())),
            }
        }
        self.line.flush()?;
        Ok(None)
    }

    fn hello(&mut self, version: u16, name: String) -> Result<(), Ended> {
        self.name = Some(name);
        self.line.put(&ToViewer::Hello {
            version: IPC_VERSION,
        })?;
        if version == IPC_VERSION {
            return Ok(());
        }
        let reason = format!(
            "this viewer speaks version {version} of the viewer link, the haptics process version {IPC_VERSION}; update the older of the two"
        );
        self.line.say_last(&ToViewer::Refused {
            reason: reason.clone(),
        })?;
        Err(Ended::Rude(reason))
    }
}

/// A number that nobody can guess.
fn random() -> u64 {
    let mut bytes = [0u8; 8];
    let flags = rustix::rand::GetRandomFlags::empty();
    match rustix::rand::getrandom(&mut bytes[..], flags) {
        Ok(8) => u64::from_le_bytes(bytes),
        // before the kernel has randomness: what the hash maps use
        _ => std::hash::BuildHasher::hash_one(&std::hash::RandomState::new(), Instant::now()),
    }
}
