//! Reads a cable.

use super::cable::Cable;
use super::inbox::{Arrivals, Inbox};
use super::relay::Source;
use super::{LinkError, LinkStats};
use osteon_protocol::device::StateFrame;
use std::sync::Arc;
use std::time::Duration;

/// Most bytes that one poll takes from the cable: 83 state frames.
const POLL_BYTES: usize = 4096;

/// Reads one cable. Neither waits of itself nor allocates.
#[derive(Debug)]
pub(super) struct Receiver {
    name: Arc<str>,
    cable: Arc<dyn Cable>,
    input: [u8; POLL_BYTES],
    inbox: Inbox,
}

impl Receiver {
    pub(super) fn new(name: Arc<str>, cable: Arc<dyn Cable>) -> Self {
        Self {
            name,
            cable,
            input: [0; POLL_BYTES],
            inbox: Inbox::default(),
        }
    }

    /// The first bytes of the last [`Self::receive`].
    pub(super) fn input(&self, count: usize) -> &[u8] {
        &self.input[..count.min(POLL_BYTES)]
    }

    /// Counts anew.
    pub(super) fn reset(&mut self) {
        self.inbox.reset();
    }

    /// Takes at most [`POLL_BYTES`] bytes from the cable and sorts what they hold.
    pub(super) fn receive(&mut self) -> Result<Arrivals, LinkError> {
        let link = || Arc::clone(&self.name);
        let bytes = self
            .cable
            .read(&mut self.input)
            .map_err(|errno| LinkError::Gone {
                link: link(),
                errno,
            })?;
        let arrivals = self.inbox.take(&self.input[..bytes]);
        if self.inbox.restarted() {
            return Err(LinkError::Restarted { link: link() });
        }
        Ok(arrivals)
    }
}

impl Source for Receiver {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn wait(&self, limit: Duration) {
        self.cable.wait(limit);
    }

    fn newest(&mut self) -> Result<Option<StateFrame>, LinkError> {
        Ok(self.receive()?.state)
    }

    fn stats(&self) -> LinkStats {
        self.inbox.stats
    }
}
