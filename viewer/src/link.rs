//! The connection to the haptics process: one thread reads, one writes, nobody else waits.

use crate::mirror::{Answer, End, Mirror};
use interprocess::local_socket::{GenericFilePath, Stream, ToFsName as _, traits::Stream as _};
use osteon_protocol::ipc::{Command, FromViewer, IPC_VERSION, ToViewer};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into};
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Messages that may wait to be written.
const OUTGOING: usize = 64;
/// Bytes read at once.
const READ_BYTES: usize = 64 * 1024;
/// How long a socket may be absent before that is an error: the haptics process may be starting.
const PATIENCE: Duration = Duration::from_secs(3);
/// Longest name that the hello carries, bytes.
const NAME_BYTES: usize = 200;
/// The haptics process has gone without a word.
const CLOSED: &str = "was closed without a farewell; look at the haptics process's last lines";

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
    /// A thread could not be started.
    #[error("the link to {path} cannot start a thread ({reason}); close other programs")]
    Thread {
        /// The socket.
        path: PathBuf,
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

/// The running link. Dropping it does not end its threads; they end with the connection or the
/// process.
#[derive(Debug)]
pub(crate) struct Link {
    outgoing: SyncSender<FromViewer>,
    writer: Option<JoinHandle<()>>,
}

impl Link {
    /// Connects, says hello and begins to fill `shared`'s mirror.
    pub(crate) fn start(path: &Path, name: &str, shared: &Arc<Shared>) -> Result<Self, LinkError> {
        let stream = Arc::new(connect(path)?);
        let out = Arc::clone(&stream);
        let (sender, receiver) = sync_channel(OUTGOING);
        let thread = |reason| LinkError::Thread {
            path: path.to_owned(),
            reason,
        };
        let writer = std::thread::Builder::new()
            .name("link-out".into())
            .spawn(move || write_all(&out, &receiver))
            .map_err(thread)?;
        let name = name[..name.floor_char_boundary(NAME_BYTES)].to_owned();
        let hello = FromViewer::Hello {
            version: IPC_VERSION,
            name,
        };
        // the channel is new and empty
        drop(sender.try_send(hello));
        let reader = Reader {
            path: path.to_owned(),
            stream,
            outgoing: sender.clone(),
            shared: Arc::clone(shared),
        };
        std::thread::Builder::new()
            .name("link-in".into())
            .spawn(move || reader.run())
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

fn connect(path: &Path) -> Result<Stream, LinkError> {
    let until = Instant::now() + PATIENCE;
    loop {
        let name = path.to_fs_name::<GenericFilePath>();
        let name = name.map_err(|reason| LinkError::Name {
            path: path.to_owned(),
            reason,
        })?;
        match Stream::connect(name) {
            Ok(stream) => return Ok(stream),
            Err(e) if starting(&e) && Instant::now() < until => {
                std::thread::sleep(Duration::from_millis(50));
            }
            Err(reason) => {
                return Err(LinkError::Connect {
                    path: path.to_owned(),
                    reason,
                });
            }
        }
    }
}

/// Whether an error may go away when the haptics process has come up.
fn starting(error: &std::io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::NotFound | ErrorKind::ConnectionRefused
    )
}

/// Writes messages until all senders are gone or the other side is.
fn write_all(mut out: &Stream, messages: &Receiver<FromViewer>) {
    let mut bytes = Vec::new();
    while let Ok(message) = messages.recv() {
        bytes.clear();
        // our own messages are far below the bound; one that is not is left out
        if encode_into(&message, &mut bytes).is_err() {
            continue;
        }
        // a broken connection is reported by the reader, which sees it too
        if out.write_all(&bytes).is_err() {
            return;
        }
    }
}

struct Reader {
    path: PathBuf,
    stream: Arc<Stream>,
    outgoing: SyncSender<FromViewer>,
    shared: Arc<Shared>,
}

impl Reader {
    fn run(self) {
        let end = self.read_until_end();
        self.shared.finish(end);
    }

    fn read_until_end(&self) -> End {
        let mut incoming = &*self.stream;
        let mut decoder = StreamDecoder::new();
        let mut bytes = vec![0; READ_BYTES];
        let mut greeted = false;
        loop {
            let count = match incoming.read(&mut bytes) {
                Ok(0) => return self.failed(CLOSED),
                Ok(count) => count,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                // a peer that dies with our words unread resets the connection
                Err(e) if e.kind() == ErrorKind::ConnectionReset => return self.failed(CLOSED),
                Err(e) => {
                    return self.failed(&format!(
                        "broke ({e}); look at the haptics process's last lines"
                    ));
                }
            };
            decoder.push(&bytes[..count]);
            loop {
                match decoder.next::<ToViewer>() {
                    Ok(None) => break,
                    Ok(Some(message)) => {
                        if let Some(end) = self.handle(message, &mut greeted) {
                            return end;
                        }
                    }
                    Err(e) => return self.failed(&format!("carries no osteon messages ({e}); give the socket of a haptics process of this version")),
                }
            }
            self.shared.notify();
        }
    }

    fn failed(&self, what: &str) -> End {
        End::Failed(format!("the connection {} {what}", self.path.display()))
    }

    fn handle(&self, message: ToViewer, greeted: &mut bool) -> Option<End> {
        match (&message, *greeted) {
            (ToViewer::Hello { version }, _) => {
                if *version != IPC_VERSION {
                    return Some(self.failed(&format!(
                        "speaks version {version} of the viewer link, this viewer {IPC_VERSION}; use two programs of the same release"
                    )));
                }
                *greeted = true;
            }
            (ToViewer::Refused { .. }, _) | (_, true) => {}
            (_, false) => {
                return Some(
                    self.failed("did not begin with a hello; give the socket of a haptics process"),
                );
            }
        }
        let taken = self.shared.mirror().take(message);
        match taken {
            Ok(Answer::None) => None,
            Ok(Answer::Digest(digest)) => {
                self.answer(digest);
                None
            }
            Ok(Answer::Bye(reason)) => Some(End::Bye(reason)),
            Ok(Answer::Refused(reason)) => Some(self.failed(&format!("was refused: {reason}"))),
            Err(e) => Some(self.failed(&format!("sent something unusable: {e}"))),
        }
    }

    fn answer(&self, digest: osteon_protocol::ipc::Digest) {
        let (updates, resyncs) = {
            let mirror = self.shared.mirror();
            (mirror.updates, mirror.resyncs)
        };
        let message = FromViewer::Digest {
            digest,
            frames_rendered: self.shared.frames.load(Ordering::Relaxed),
            updates,
            resyncs,
        };
        // fails only where the writer has ended, and then the reader ends as well
        drop(self.outgoing.send(message));
    }
}
