//! A simulated device in this process: the same bytes, by a socket of packets to a thread of its own.

use super::cable::{Cable, PairCable};
use super::{LinkError, OpenLink};
use crate::fake::Stroke;
use crate::fake::run::InProcess;
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The cable to a device thread, which ends with it.
#[derive(Debug)]
struct SimCable {
    cable: PairCable,
    stop: Arc<AtomicBool>,
    device: Option<JoinHandle<()>>,
}

impl Cable for SimCable {
    fn read(&self, into: &mut [u8]) -> Result<usize, Errno> {
        self.cable.read(into)
    }

    fn write(&self, bytes: &[u8]) -> Result<usize, Errno> {
        self.cable.write(bytes)
    }

    fn wait(&self, limit: Duration) {
        self.cable.wait(limit);
    }
}

impl Drop for SimCable {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(device) = self.device.take() {
            device.join().unwrap_or(());
        }
    }
}

/// Starts a simulated device whose hand follows `stroke` (in its dock without one).
pub(super) fn open_sim(stroke: Option<&Path>, name: Arc<str>) -> Result<OpenLink, LinkError> {
    let setup = |why: String| LinkError::Setup {
        link: Arc::clone(&name),
        why,
    };
    let stroke = match stroke {
        Some(path) => Stroke::load(path).map_err(|e| setup(format!("{e:#}")))?,
        None => Stroke::default(),
    };
    let device = InProcess {
        stroke,
        seed: 1,
        truth: None,
    };
    start(device, name)
}

/// Starts `device` and shakes hands with it.
pub(super) fn start(device: InProcess, name: Arc<str>) -> Result<OpenLink, LinkError> {
    let setup = |why: String| LinkError::Setup {
        link: Arc::clone(&name),
        why,
    };
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let (here, there) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)
        .map_err(|e| setup(e.to_string()))?;
    let stop = Arc::new(AtomicBool::new(false));
    let thread = device
        .start(there, Arc::clone(&stop))
        .map_err(|e| setup(format!("{e:#}")))?;
    let cable = SimCable {
        cable: PairCable::new(here),
        stop,
        device: Some(thread),
    };
    OpenLink::over(Arc::new(cable), name)
}
