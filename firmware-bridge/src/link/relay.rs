//! A thread that reads the cable, so that the servo thread never does.
//!
//! ```text
//! cable ──▶ relay thread: wait, read, check ── ring of states ──▶ servo thread: newest wins
//! ```
//! A read of an empty terminal line waits for the kernel's worker that moves the bytes, which runs
//! at ordinary priority: on a busy machine nothing bounds that. Here only the relay waits.

use super::receiver::Receiver;
use super::{LinkError, LinkStats};
use crate::rt;
use osteon_protocol::device::StateFrame;
use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// States that may wait for the servo: a quarter of a second.
const RING: usize = 256;
/// The relay looks at least this often whether it shall end, ns.
const LOOK_NS: i64 = 50_000_000;
/// Just below the servo.
const PRIORITY: u8 = rt::SERVO_PRIORITY - 1;

/// One step of the relay, as the servo sees it.
type Item = Result<(StateFrame, LinkStats), LinkError>;

/// The servo's end of the relay.
#[derive(Debug)]
pub(super) struct Relay {
    items: Consumer<Item>,
    stats: LinkStats,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Starts the thread.
    pub(super) fn start(receiver: Receiver) -> Result<Self, LinkError> {
        let (sender, items) = RingBuffer::new(RING);
        let stop = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stop);
        let name = Arc::clone(receiver.name());
        let stats = receiver.stats();
        let thread = std::thread::Builder::new()
            .name("device-relay".to_owned())
            .spawn(move || run(receiver, sender, &flag))
            .map_err(|e| LinkError::Setup {
                link: name,
                why: e.to_string(),
            })?;
        Ok(Self {
            items,
            stats,
            stop,
            thread: Some(thread),
        })
    }

    /// The newest state since the last call. At most [`RING`] steps; no system call.
    pub(super) fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        let mut newest = None;
        for _ in 0..RING {
            match self.items.pop() {
                Ok(Ok((state, stats))) => {
                    newest = Some(state);
                    self.stats = stats;
                }
                Ok(Err(error)) => return Err(error),
                Err(_) => break,
            }
        }
        Ok(newest)
    }

    /// Counters as of the newest state.
    pub(super) fn stats(&self) -> LinkStats {
        self.stats
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // it ends within LOOK_NS; a panic in it has shown as silence already
            thread.join().unwrap_or(());
        }
    }
}

fn run(mut receiver: Receiver, mut sender: Producer<Item>, stop: &AtomicBool) {
    // refused rights are those that the servo thread is refused, too, and it says so
    let _right = rt::set_fifo(PRIORITY);
    while !stop.load(Ordering::Relaxed) {
        wait(&receiver);
        let item = match receiver.receive() {
            Ok(arrivals) => match arrivals.state {
                Some(state) => Ok((state, receiver.stats())),
                None => continue,
            },
            Err(error) => Err(error),
        };
        let over = item.is_err();
        // a full ring: the servo has stopped, or will find newer states next time
        let _full = sender.push(item);
        if over {
            return;
        }
    }
}

/// Until something has come, at most [`LOOK_NS`].
fn wait(receiver: &Receiver) {
    let mut look = [PollFd::new(receiver.port.io(), PollFlags::IN)];
    let limit = Timespec {
        tv_sec: 0,
        tv_nsec: LOOK_NS,
    };
    // the read that follows says what there is; an interrupted wait must not become a busy one
    if poll(&mut look, Some(&limit)).is_err() {
        std::thread::sleep(Duration::from_millis(1));
    }
}
