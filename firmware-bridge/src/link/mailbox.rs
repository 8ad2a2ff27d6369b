//! From the thread that hears the device to the servo thread: the newest state wins, a bell wakes.

use super::{LinkError, LinkStats};
use crate::rt::now_ns;
use osteon_protocol::device::StateFrame;
use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{EventfdFlags, eventfd};
use rustix::io::Errno;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::Duration;

/// States that may wait for the servo: a quarter of a second.
const RING: usize = 256;

/// A state with the counters as of it, or the end of the link.
pub(super) type Item = Result<(StateFrame, LinkStats), LinkError>;

/// The hearing thread's end.
#[derive(Debug)]
pub(super) struct Outlet {
    ring: Producer<Item>,
    bell: Arc<OwnedFd>,
}

/// The servo's end.
#[derive(Debug)]
pub(super) struct Inlet {
    ring: Consumer<Item>,
    bell: Arc<OwnedFd>,
    stats: LinkStats,
}

/// Both ends.
pub(super) fn mailbox() -> Result<(Outlet, Inlet), Errno> {
    let bell = Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?);
    let (sender, receiver) = RingBuffer::new(RING);
    let outlet = Outlet {
        ring: sender,
        bell: Arc::clone(&bell),
    };
    let inlet = Inlet {
        ring: receiver,
        bell,
        stats: LinkStats::default(),
    };
    Ok((outlet, inlet))
}

impl Outlet {
    /// Hands one item over. A full ring loses it: the servo has stopped, or will find newer ones.
    pub(super) fn put(&mut self, item: Item) {
        let _full = self.ring.push(item);
        // a bell that has rung 2^64 times too often rings already
        let _rung = rustix::io::write(&*self.bell, &1_u64.to_ne_bytes());
    }
}

impl Inlet {
    /// The newest state since the last call. At most [`RING`] steps; no system call.
    pub(super) fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        let mut newest = None;
        for _ in 0..RING {
            match self.ring.pop() {
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

    /// Until an item is there, at most until `deadline_ns`.
    pub(super) fn wait(&mut self, deadline_ns: u64) {
        let mut count = [0; 8];
        while self.ring.is_empty() {
            let left = deadline_ns.saturating_sub(now_ns());
            if left == 0 {
                return;
            }
            super::cable::wait_readable(&*self.bell, Duration::from_nanos(left));
            // rings of states that were taken long ago are forgotten here
            let _silent = rustix::io::read(&*self.bell, &mut count);
        }
    }

    /// Counters as of the newest state.
    pub(super) fn stats(&self) -> LinkStats {
        self.stats
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_wakes_and_old_rings_do_not() {
        let (mut outlet, mut inlet) = mailbox().unwrap();
        let gone = || LinkError::Restarted { link: "x".into() };
        outlet.put(Err(gone()));
        inlet.wait(now_ns() + 1_000_000_000);
        assert_eq!(inlet.poll(), Err(gone()));
        // the bell still rings of it
        let began = now_ns();
        inlet.wait(began + 20_000_000);
        assert!(now_ns() >= began + 20_000_000, "an old ring ended the wait");
        let item = Err(gone());
        let sender = std::thread::Builder::new()
            .spawn(move || {
                std::thread::sleep(Duration::from_millis(20));
                outlet.put(item);
            })
            .unwrap();
        inlet.wait(now_ns() + 5_000_000_000);
        assert_eq!(inlet.poll(), Err(gone()));
        sender.join().unwrap();
    }
}
