//! The link to a device that speaks Osteon's open protocol, whatever the cable.

use super::cable::Cable;
use super::inbox::Arrivals;
use super::order::Order;
use super::port::SerialPort;
use super::receiver::Receiver;
use super::relay::{Relay, Source as _};
use super::{DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use osteon_protocol::device::{CommandFrame, DeviceHello, DriveState, HostMessage, StateFrame};
use osteon_protocol::frame::{self, MAX_FRAME};
use rustix::io::Errno;
use std::sync::Arc;
use std::time::Duration;

/// Tries to send the disarm message on a full cable, 1 ms apart.
const DISARM_TRIES: u32 = 20;

/// A device that speaks the open protocol.
///
/// `OpenLink::over` and [`OpenLink::prepare`] may wait (each wait has an end); `poll` and `send`
/// neither wait nor allocate. Dropping an armed link sends the disarm message.
#[derive(Debug)]
pub struct OpenLink {
    pub(super) name: Arc<str>,
    pub(super) info: DeviceInfo,
    port: Arc<dyn Cable>,
    // reads the cable for whoever calls (the handshake, and tests), until the relay has it
    receiver: Option<Box<Receiver>>,
    relay: Option<Relay>,
    outbox: Outbox,
    dropped_commands: u64,
    order: Order,
    pub(super) armed: bool,
}

/// Bit rate of a serial line unless another is asked for; on USB it means nothing.
pub const BAUD: u32 = 115_200;

impl OpenLink {
    /// Opens the serial port at `path`, 115,200 bit/s where it is a real one, and shakes hands.
    pub fn open(path: &str) -> Result<Self, LinkError> {
        Self::serial(path, BAUD, format!("open:{path}").into())
    }

    /// Opens a serial port and shakes hands.
    pub(super) fn serial(path: &str, baud: u32, name: Arc<str>) -> Result<Self, LinkError> {
        let port = SerialPort::open(path, baud, &name)?;
        Self::over(Arc::new(port), name)
    }

    /// Shakes hands over a cable: the device must answer, in this version. Takes at most 2 s.
    pub(super) fn over(port: Arc<dyn Cable>, name: Arc<str>) -> Result<Self, LinkError> {
        let receiver = Receiver::new(Arc::clone(&name), Arc::clone(&port));
        let mut link = Self {
            name,
            info: DeviceInfo::omni(&NO_HELLO),
            port,
            receiver: Some(Box::new(receiver)),
            relay: None,
            outbox: Outbox::default(),
            dropped_commands: 0,
            order: Order::default(),
            armed: false,
        };
        link.shake_hands()?;
        Ok(link)
    }

    /// Takes what has come, before the relay runs.
    pub(super) fn receive(&mut self) -> Result<Arrivals, LinkError> {
        match &mut self.receiver {
            Some(receiver) => receiver.receive(),
            None => Ok(Arrivals::default()),
        }
    }

    /// Sends one message, or drops it when the cable is full: then `false`.
    pub(super) fn transmit(&mut self, message: HostMessage) -> Result<bool, LinkError> {
        let sent = self.outbox.flush(&*self.port).and_then(|clear| {
            if clear {
                self.outbox.write(message, &*self.port)
            } else {
                Ok(false)
            }
        });
        match sent {
            Ok(sent) => Ok(sent),
            Err(OutboxError::Errno(errno)) => Err(self.gone(errno)),
            Err(OutboxError::Frame(error)) => Err(LinkError::Frame {
                link: Arc::clone(&self.name),
                error,
            }),
        }
    }

    /// The first bytes of the last [`Self::receive`].
    pub(super) fn input(&self, count: usize) -> &[u8] {
        self.receiver.as_ref().map_or(&[], |r| r.input(count))
    }

    /// Forgets the counts of the handshake: a session begins with clean ones, in the middle of a
    /// stream whose first piece may have been half a frame.
    pub(super) fn reset_stats(&mut self) {
        self.dropped_commands = 0;
        if let Some(receiver) = &mut self.receiver {
            receiver.reset();
        }
    }

    fn gone(&self, errno: Errno) -> LinkError {
        LinkError::Gone {
            link: Arc::clone(&self.name),
            errno,
        }
    }
}

impl DeviceLink for OpenLink {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn prepare(&mut self) -> Result<(), LinkError> {
        self.home_and_arm()
    }

    fn look(&mut self) -> Result<String, LinkError> {
        self.look_at_drive()
    }

    /// Reading an empty terminal line can wait for the kernel's own worker, which runs at ordinary
    /// priority; the servo thread must not.
    fn start(&mut self) -> Result<(), LinkError> {
        if let Some(receiver) = self.receiver.take() {
            self.relay = Some(Relay::start(*receiver)?);
        }
        Ok(())
    }

    fn wait(&mut self, deadline_ns: u64) {
        if let Some(relay) = &mut self.relay {
            relay.wait(deadline_ns);
        } else {
            let left = deadline_ns.saturating_sub(now_ns());
            self.port.wait(Duration::from_nanos(left));
        }
    }

    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        match &mut self.relay {
            Some(relay) => relay.poll(),
            None => Ok(self.receive()?.state),
        }
    }

    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        self.armed = true;
        let sent = self.order.admits(*command) && self.transmit(HostMessage::Command(*command))?;
        if !sent {
            self.dropped_commands += 1;
        }
        Ok(())
    }

    fn disarm(&mut self) {
        self.armed = false;
        for _ in 0..DISARM_TRIES {
            // A cable that is gone needs no message: the device's watchdog sees the silence.
            match self.transmit(HostMessage::Disarm) {
                Ok(false) => std::thread::sleep(Duration::from_millis(1)),
                Ok(true) | Err(_) => return,
            }
        }
    }

    fn stats(&self) -> LinkStats {
        let direct = self.receiver.as_ref().map(|r| r.stats());
        let received = self.relay.as_ref().map(Relay::stats).or(direct);
        LinkStats {
            dropped_commands: self.dropped_commands,
            ..received.unwrap_or_default()
        }
    }

    fn describe(&self) -> String {
        self.name.to_string()
    }
}

impl Drop for OpenLink {
    fn drop(&mut self) {
        if self.armed {
            self.disarm();
        }
    }
}

/// Placeholder until the device has introduced itself; never seen outside this module.
const NO_HELLO: DeviceHello = DeviceHello {
    version: 0,
    schema: 0,
    model: 0,
    serial: 0,
    counts_per_rev: 0,
    gimbal_counts_per_rev: 0,
    dac_max: 0,
    micro_nm_per_count: 0,
    period_micros: 0,
};

/// The frame on its way out. A frame that was begun is finished before another one starts, or the
/// device would see a torn one.
#[derive(Debug)]
struct Outbox {
    frame: [u8; MAX_FRAME],
    // bytes of `frame` still to be written: begin..end
    begin: usize,
    end: usize,
}

impl Default for Outbox {
    fn default() -> Self {
        Self {
            frame: [0; MAX_FRAME],
            begin: 0,
            end: 0,
        }
    }
}

enum OutboxError {
    Errno(Errno),
    Frame(frame::FrameError),
}

impl Outbox {
    /// Writes the rest of a frame that was begun; true = nothing is left.
    fn flush(&mut self, port: &dyn Cable) -> Result<bool, OutboxError> {
        if self.begin < self.end {
            let rest = &self.frame[self.begin..self.end];
            self.begin += port.write(rest).map_err(OutboxError::Errno)?;
        }
        Ok(self.begin == self.end)
    }

    /// Writes a message onto a clear cable; false = not a byte of it went out.
    fn write(&mut self, message: HostMessage, port: &dyn Cable) -> Result<bool, OutboxError> {
        let length = frame::encode(&message, &mut self.frame)
            .map_err(OutboxError::Frame)?
            .len();
        let count = port
            .write(&self.frame[..length])
            .map_err(OutboxError::Errno)?;
        (self.begin, self.end) = if count == 0 { (0, 0) } else { (count, length) };
        Ok(count > 0)
    }
}

/// Name of a drive state for people.
pub(super) fn drive_name(drive: DriveState) -> &'static str {
    match drive {
        DriveState::Boot => "booting",
        DriveState::Unhomed => "unhomed",
        DriveState::Homed => "homed",
        DriveState::Armed => "armed",
        DriveState::Active => "active",
        DriveState::Hold => "in hold",
        DriveState::Tripped => "tripped",
        DriveState::Fault => "in fault",
    }
}
