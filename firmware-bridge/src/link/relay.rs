//! A thread that reads the cable, so that the servo thread never does.
//!
//! ```text
//! cable ──▶ relay thread: wait, read, check ── mailbox ──▶ servo thread: newest wins
//! ```
//! A read of an empty terminal line waits for the kernel's worker that moves the bytes, which runs
//! at ordinary priority: on a busy machine nothing bounds that. Here only the relay waits.

use super::mailbox::{Inlet, Outlet, mailbox};
use super::{LinkError, LinkStats};
use crate::rt;
use osteon_protocol::device::StateFrame;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The relay looks at least this often whether it shall end.
const LOOK: Duration = Duration::from_millis(50);
/// Just below the servo.
const PRIORITY: u8 = rt::SERVO_PRIORITY - 1;

/// What makes states out of a cable's bytes.
pub(super) trait Source: Send + 'static {
    /// The link's name.
    fn name(&self) -> &Arc<str>;

    /// Until bytes are there, at most `limit`.
    fn wait(&self, limit: Duration);

    /// Takes what is there; the newest state in it.
    fn newest(&mut self) -> Result<Option<StateFrame>, LinkError>;

    /// Counters.
    fn stats(&self) -> LinkStats;
}

/// The servo's end of the relay.
#[derive(Debug)]
pub(super) struct Relay {
    inlet: Inlet,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Starts the thread.
    pub(super) fn start(source: impl Source) -> Result<Self, LinkError> {
        let refused = |link: &Arc<str>, why: String| LinkError::Setup {
            link: Arc::clone(link),
            why,
        };
        let name = Arc::clone(source.name());
        let (outlet, inlet) = mailbox().map_err(|e| refused(&name, e.to_string()))?;
        let stop = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("device-relay".to_owned())
            .spawn(move || run(source, outlet, &flag))
            .map_err(|e| refused(&name, e.to_string()))?;
        Ok(Self {
            inlet,
            stop,
            thread: Some(thread),
        })
    }

    /// The newest state since the last call.
    pub(super) fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        self.inlet.poll()
    }

    /// Until a state is there, at most until `deadline_ns`.
    pub(super) fn wait(&mut self, deadline_ns: u64) {
        self.inlet.wait(deadline_ns);
    }

    /// Counters as of the newest state.
    pub(super) fn stats(&self) -> LinkStats {
        self.inlet.stats()
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // it ends within LOOK; a panic in it has shown as silence already
            thread.join().unwrap_or(());
        }
    }
}

fn run(mut source: impl Source, mut outlet: Outlet, stop: &AtomicBool) {
    // refused rights are those that the servo thread is refused, too, and it says so
    let _right = rt::set_fifo(PRIORITY);
    while !stop.load(Ordering::Relaxed) {
        source.wait(LOOK);
        let item = match source.newest() {
            Ok(Some(state)) => Ok((state, source.stats())),
            Ok(None) => continue,
            Err(error) => Err(error),
        };
        let over = item.is_err();
        outlet.put(item);
        if over {
            return;
        }
    }
}
