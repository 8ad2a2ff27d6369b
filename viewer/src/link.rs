//! The connection to the haptics process: one thread reads, one writes, nobody else waits. A
//! connection that breaks is made again, and goes on where it was.

mod reader;
mod transport;

pub(crate) use transport::Place;
pub use transport::Remote;

use crate::mirror::{End, Mirror};
use osteon_protocol::ipc::{Command, FromViewer, IPC_VERSION, Join, Resume, Role, capability};
use osteon_protocol::ipc_frame::encode_into;
use reader::Reader;
use std::path::PathBuf;
use std::sync::atomic::AtomicU64;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use transport::Out;

/// Messages that may wait to be written.
const OUTGOING: usize = 64;
/// Longest name that the hello carries, bytes.
const NAME_BYTES: usize = 200;

/// Why the link could not be made or has ended.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LinkError {
    /// The path is no socket name.
    #[error(
        "{path} cannot name a socket ({reason}); give the path that the haptics process printed to --socket"
    )]
    Name {
        /// The path.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// Nobody listens.
    #[error("no haptics process listens on {path} ({reason}); start one first or correct --socket")]
    Connect {
        /// The socket.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// The other machine cannot be reached, or is not the one whose key is known.
    #[error(
        "no haptics process at {address} ({reason}); start one there with --listen, and let both trust each other's key ('osteon key')"
    )]
    Remote {
        /// Where to.
        address: String,
        /// Why.
        reason: std::io::Error,
    },
    /// A thread could not be started.
    #[error("the link to {place} cannot start a thread ({reason}); close other programs")]
    Thread {
        /// Where to.
        place: Box<Place>,
        /// Why.
        reason: std::io::Error,
    },
}

/// What link, user interface and renderer share.
pub(crate) struct Shared {
    mirror: Mutex<Mirror>,
    changed: Condvar,
    /// Frames of the 3-D view drawn.
    pub(crate) frames: AtomicU64,
    wake: OnceLock<Box<dyn Fn() + Send + Sync>>,
}

impl core::fmt::Debug for Shared {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Shared")
            .field("frames", &self.frames)
            .finish_non_exhaustive()
    }
}

impl Shared {
    /// An empty mirror.
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            mirror: Mutex::new(Mirror::default()),
            changed: Condvar::new(),
            frames: AtomicU64::new(0),
            wake: OnceLock::new(),
        })
    }

    /// The mirror. A thread that panicked with it leaves it usable: every message is taken over
    /// in steps that keep it sound.
    pub(crate) fn mirror(&self) -> MutexGuard<'_, Mirror> {
        self.mirror.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What to call when something changed; the first caller's choice holds.
    pub(crate) fn on_change(&self, wake: impl Fn() + Send + Sync + 'static) {
        // a second window does not exist, so a second choice is not an error
        drop(self.wake.set(Box::new(wake)));
    }

    /// Waits until `ready` or `patience` is over.
    pub(crate) fn wait(&self, patience: Duration, ready: impl Fn(&Mirror) -> bool) {
        let guard = self.mirror();
        drop(
            self.changed
                .wait_timeout_while(guard, patience, |m| !ready(m)),
        );
    }

    fn notify(&self) {
        self.changed.notify_all();
        if let Some(wake) = self.wake.get() {
            wake();
        }
    }

    fn finish(&self, end: End) {
        self.mirror().end.get_or_insert(end);
        self.notify();
    }
}

/// As what a viewer joins.
#[derive(Debug, Clone)]
pub(crate) struct Joining {
    /// Program and adapter, for people.
    pub(crate) name: String,
    /// Who sits before it.
    pub(crate) role: Role,
    /// Whether it sends wishes.
    pub(crate) control: bool,
    /// Poses a second that it can show.
    pub(crate) pose_hz: u16,
}

impl Joining {
    /// The first two messages of a connection.
    fn greeting(&self, resume: Option<Resume>) -> Vec<u8> {
        let name = self.name[..self.name.floor_char_boundary(NAME_BYTES)].to_owned();
        let hello = FromViewer::Hello {
            version: IPC_VERSION,
            name,
        };
        let mut capabilities = capability::ALL;
        if !self.control {
            capabilities &= !capability::CONTROL;
        }
        let join = FromViewer::Join(Join {
            role: self.role,
            capabilities,
            pose_hz: self.pose_hz,
            resume,
        });
        let mut bytes = Vec::new();
        for message in [hello, join] {
            // far below the bound
            encode_into(&message, &mut bytes).unwrap_or(());
        }
        bytes
    }
}

/// Where the writing thread writes: replaced when the connection is made again.
type OutSlot = Arc<Mutex<Option<Out>>>;

/// The running link. Dropping it does not end its threads; they end with the connection or the
/// process.
#[derive(Debug)]
pub(crate) struct Link {
    outgoing: SyncSender<FromViewer>,
    writer: Option<JoinHandle<()>>,
}

impl Link {
    /// Connects, joins and begins to fill `shared`'s mirror.
    pub(crate) fn start(
        place: &Place,
        joining: &Joining,
        shared: &Arc<Shared>,
    ) -> Result<Self, LinkError> {
        let (incoming, mut out) = place.connect()?;
        // a connection that breaks already is reported by the reader
        out.write_all(&joining.greeting(None)).unwrap_or(());
        let slot: OutSlot = Arc::new(Mutex::new(Some(out)));
        let (sender, receiver) = sync_channel(OUTGOING);
        let thread = |reason| LinkError::Thread {
            place: Box::new(place.clone()),
            reason,
        };
        let writing = Arc::clone(&slot);
        let writer = std::thread::Builder::new()
            .name("link-out".into())
            .spawn(move || write_all(&writing, &receiver))
            .map_err(thread)?;
        let reader = Reader {
            place: place.clone(),
            joining: joining.clone(),
            slot,
            outgoing: sender.clone(),
            shared: Arc::clone(shared),
        };
        std::thread::Builder::new()
            .name("link-in".into())
            .spawn(move || reader.run(incoming))
            .map_err(thread)?;
        Ok(Self {
            outgoing: sender,
            writer: Some(writer),
        })
    }

    /// Sends a person's wish; never waits. `false` where the link is stuck or gone.
    pub(crate) fn command(&self, command: Command) -> bool {
        self.outgoing.try_send(FromViewer::Command(command)).is_ok()
    }

    /// Waits, at most `patience`, until all that was handed over is written.
    pub(crate) fn flush(self, patience: Duration) {
        let Self { outgoing, writer } = self;
        drop(outgoing);
        let until = Instant::now() + patience;
        while writer.as_ref().is_some_and(|w| !w.is_finished()) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Writes messages until all senders are gone. What finds no connection is not sent.
fn write_all(slot: &OutSlot, messages: &Receiver<FromViewer>) {
    let mut bytes = Vec::new();
    while let Ok(message) = messages.recv() {
        bytes.clear();
        // our own messages are far below the bound; one that is not is left out
        if encode_into(&message, &mut bytes).is_err() {
            continue;
        }
        let mut out = slot.lock().unwrap_or_else(PoisonError::into_inner);
        // a broken connection is reported by the reader, which sees it too
        if out.as_mut().is_some_and(|o| o.write_all(&bytes).is_err()) {
            *out = None;
        }
    }
}
