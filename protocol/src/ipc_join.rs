//! How a viewer joins a session, who is in control of it, and how it resumes after a break.

use serde::{Deserialize, Serialize};

/// Most viewers of a session, those included that may still resume.
pub const MAX_VIEWERS: usize = 64;

/// Most bytes of the payload of a viewer's message. A haptics process bounds its memory by it.
pub const MAX_FROM_VIEWER: usize = 1024;

/// Pose rates that can be asked for, Hz.
pub const POSE_HZ: std::ops::RangeInclusive<u16> = 1..=250;

/// What a viewer asks for and is granted: one bit each. Bits that a side does not know it leaves
/// unset in its answer, so that a later version can add some.
pub mod capability {
    /// May be in control: its wishes change the session.
    pub const CONTROL: u32 = 1;
    /// Wants [`Removals`](super::super::ipc::ToViewer::Removals).
    pub const REMOVALS: u32 = 1 << 1;
    /// Wants [`Health`](super::super::ipc::ToViewer::Health).
    pub const HEALTH: u32 = 1 << 2;
    /// Answers [`Digest`](super::super::ipc::ToViewer::Digest).
    pub const DIGEST: u32 = 1 << 3;
    /// Its seat is kept for a while after a break.
    pub const RESUME: u32 = 1 << 4;
    /// All bits of this version.
    pub const ALL: u32 = CONTROL | REMOVALS | HEALTH | DIGEST | RESUME;
}

/// Who sits before a viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Role {
    /// Works with the stylus.
    Trainee,
    /// Watches over a trainee; may take control from one.
    Trainer,
    /// Shows the session to others; never in control.
    Projector,
}

impl Role {
    /// Its name, for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trainee => "trainee",
            Self::Trainer => "trainer",
            Self::Projector => "projector",
        }
    }
}

/// A viewer's second message: as what it joins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Join {
    /// Who sits before it.
    pub role: Role,
    /// Bits of [`capability`] that it asks for.
    pub capabilities: u32,
    /// Most poses a second that it wants, in [`POSE_HZ`].
    pub pose_hz: u16,
    /// The seat that it held before a break, if any.
    pub resume: Option<Resume>,
}

/// What a viewer has of a session that it was in before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resume {
    /// [`Welcome::session`].
    pub session: u64,
    /// [`Welcome::seat`].
    pub seat: u64,
    /// Bone pieces that it has, from the first on.
    pub pieces: u32,
    /// Messages of bricks that it has taken over since it was welcomed as new.
    pub batches: u64,
    /// Epoch of its cut.
    pub epoch: u32,
}

/// The answer to [`Join`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Welcome {
    /// A random number of this session.
    pub session: u64,
    /// A random number of this viewer's seat: with it, and only with it, the seat can be resumed.
    pub seat: u64,
    /// Number of this viewer in [`ControlState`], from 1.
    pub number: u16,
    /// Bits of [`capability`] that are granted.
    pub granted: u32,
    /// The seat was kept: what the viewer has still holds, and only the rest follows. Else it
    /// begins empty.
    pub resumed: bool,
}

/// One viewer, as all others see it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViewerInfo {
    /// Its number.
    pub number: u16,
    /// Who sits before it.
    pub role: Role,
    /// Whether it is connected; one that is not may still resume.
    pub present: bool,
    /// Program and adapter, for people; at most 200 bytes.
    pub name: String,
}

/// Who is here and who is in control; sent at the beginning and after every change.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ControlState {
    /// Number of the viewer in control, if any is.
    pub holder: Option<u16>,
    /// Number of the viewer that asks for it, if any does: the one in control may hand over.
    pub asking: Option<u16>,
    /// All viewers, at most [`MAX_VIEWERS`].
    pub viewers: Vec<ViewerInfo>,
}
