//! The reading thread: takes messages over into the mirror, answers digests, makes a broken
//! connection again.

use super::transport::{In, Place};
use super::{Joining, OutSlot, Shared};
use crate::mirror::{Answer, End};
use osteon_protocol::ipc::{Digest, FromViewer, IPC_VERSION, ToViewer};
use osteon_protocol::ipc_frame::StreamDecoder;
use std::io::ErrorKind;
use std::sync::atomic::Ordering;
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, PoisonError};

/// Bytes read at once.
const READ_BYTES: usize = 64 * 1024;
/// The haptics process has gone without a word.
const CLOSED: &str = "was closed without a farewell; look at the haptics process's last lines";

pub(super) struct Reader {
    pub(super) place: Place,
    pub(super) joining: Joining,
    pub(super) slot: OutSlot,
    pub(super) outgoing: SyncSender<FromViewer>,
    pub(super) shared: Arc<Shared>,
}

/// How one connection ended.
enum Over {
    /// For good.
    End(End),
    /// It broke; the words say how.
    Broken(String),
}

impl Reader {
    pub(super) fn run(self, mut incoming: In) {
        let end = loop {
            match self.read_until_over(&mut incoming) {
                Over::End(end) => break end,
                Over::Broken(what) => match self.again() {
                    Some(new) => incoming = new,
                    None => break self.failed(&what),
                },
            }
        };
        self.shared.finish(end);
    }

    /// A new connection to the same seat, where the last one had one.
    fn again(&self) -> Option<In> {
        let resume = {
            let mut mirror = self.shared.mirror();
            let resume = mirror.resume()?;
            mirror.broken = true;
            resume
        };
        self.shared.notify();
        let (incoming, mut out) = self.place.connect().ok()?;
        out.write_all(&self.joining.greeting(Some(resume))).ok()?;
        *self.slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(out);
        Some(incoming)
    }

    fn read_until_over(&self, incoming: &mut In) -> Over {
        let mut decoder = StreamDecoder::new();
        let mut bytes = vec![0; READ_BYTES];
        let mut greeted = false;
        loop {
            let count = match incoming.read(&mut bytes) {
                Ok(0) => return Over::Broken(CLOSED.to_owned()),
                Ok(count) => count,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                // a peer that dies with our words unread resets the connection
                Err(e) if e.kind() == ErrorKind::ConnectionReset => {
                    return Over::Broken(CLOSED.to_owned());
                }
                Err(e) => {
                    return Over::Broken(format!(
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
                            return Over::End(end);
                        }
                    }
                    Err(e) => {
                        return Over::End(self.failed(&format!(
                            "carries no osteon messages ({e}); give the socket of a haptics process of this version"
                        )));
                    }
                }
            }
            self.shared.notify();
        }
    }

    fn failed(&self, what: &str) -> End {
        End::Failed(format!("the connection {} {what}", self.place))
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

    fn answer(&self, digest: Digest) {
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
