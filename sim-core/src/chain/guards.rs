//! What the guards had to do: counted, and when last.

/// Interventions, in the order of their place in the tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Guard {
    /// A sample was refused: no hand can have moved so.
    Implausible,
    /// A value that is no number became zero.
    NotFinite,
    /// The tool appeared inside bone: no force until it is free.
    Embedded,
    /// The proxy did not arrive within a tick's steps; it goes on in the next.
    Overrun,
    /// The solver stopped above the accepted residual.
    Unsolved,
    /// The loop had made energy: the passivity controller damped it.
    Passivity,
    /// The force limit of the user, or of a ramp.
    Clamp,
    /// The rise of the force was slowed down.
    Slew,
    /// The limit that the motors' heat has lowered.
    Thermal,
    /// Samples were missing for so long that the force was reduced.
    Hold,
}

/// Number of [`Guard`]s.
pub const GUARDS: usize = 10;

impl Guard {
    /// All of them in the order of their values.
    pub const ALL: [Self; GUARDS] = [
        Self::Implausible,
        Self::NotFinite,
        Self::Embedded,
        Self::Overrun,
        Self::Unsolved,
        Self::Passivity,
        Self::Clamp,
        Self::Slew,
        Self::Thermal,
        Self::Hold,
    ];

    /// Name in reports and on the screen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Implausible => "implausible sample",
            Self::NotFinite => "not a number",
            Self::Embedded => "embedded",
            Self::Overrun => "overrun",
            Self::Unsolved => "unsolved",
            Self::Passivity => "passivity",
            Self::Clamp => "clamp",
            Self::Slew => "slew",
            Self::Thermal => "thermal",
            Self::Hold => "hold",
        }
    }
}

/// Ticks in which each guard intervened, and the last of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GuardCounts {
    counts: [u64; GUARDS],
    last_tick: [u64; GUARDS],
    now: u64,
}

impl GuardCounts {
    /// A new tick begins; ticks count from 1.
    pub(crate) fn begin_tick(&mut self) {
        self.now += 1;
    }

    /// Ticks so far.
    pub fn ticks(&self) -> u64 {
        self.now
    }

    /// Notes an intervention in this tick; once a tick at most.
    pub(crate) fn note(&mut self, guard: Guard) {
        let at = guard as usize;
        if self.counts[at] == 0 || self.last_tick[at] != self.now {
            self.counts[at] += 1;
            self.last_tick[at] = self.now;
        }
    }

    /// Ticks in which a guard intervened.
    pub fn of(&self, guard: Guard) -> u64 {
        self.counts[guard as usize]
    }

    /// The last tick in which it did, from 1; `None` where it never did.
    pub fn last(&self, guard: Guard) -> Option<u64> {
        (self.of(guard) > 0).then_some(self.last_tick[guard as usize])
    }

    /// All interventions.
    pub fn total(&self) -> u64 {
        self.counts.iter().sum()
    }
}
