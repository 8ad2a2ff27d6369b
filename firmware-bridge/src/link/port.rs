//! A serial port whose reads and writes never wait.

use super::LinkError;
use super::cable::{Cable, wait_readable};
use rustix::fs::{FlockOperation, Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::QueueSelector;
use serialport::{DataBits, ErrorKind, FlowControl, Parity, StopBits, TTYPort};
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::Duration;

/// Most ports listed in an error message.
const MOST_LISTED: usize = 8;

/// An exclusive serial port, 8N1, raw.
///
/// `serialport` sets the line up and holds it exclusively, but its reads and writes wait, and a
/// write to a device that no longer reads waits for ever. So all bytes go through a second
/// descriptor of the same line, which is non-blocking from its birth.
#[derive(Debug)]
pub(super) struct SerialPort {
    io: OwnedFd,
    _settings: TTYPort,
}

impl SerialPort {
    /// Opens the port at `path` with `baud` bits a second (on USB the figure means nothing); `link` is
    /// its name in error messages.
    pub(super) fn open(path: &str, baud: u32, link: &Arc<str>) -> Result<Self, LinkError> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let io = rustix::fs::open(path, flags, Mode::empty())
            .map_err(|errno| refusal(errno, path, link))?;
        if !rustix::termios::isatty(&io) {
            return Err(not_serial(link));
        }
        refuse_if_locked(&io, path, link)?;
        let settings = serialport::new(path, baud)
            .data_bits(DataBits::Eight)
            .parity(Parity::None)
            .stop_bits(StopBits::One)
            .flow_control(FlowControl::None);
        let settings = TTYPort::open(&settings).map_err(|error| match error.kind() {
            ErrorKind::NoDevice => LinkError::Busy {
                link: Arc::clone(link),
            },
            _ => LinkError::Setup {
                link: Arc::clone(link),
                why: error.to_string(),
            },
        })?;
        let port = Self {
            io,
            _settings: settings,
        };
        port.discard();
        Ok(port)
    }

    /// Throws away what is queued in both directions.
    fn discard(&self) {
        // A line that cannot be flushed starts with old bytes, which the framing survives.
        rustix::termios::tcflush(&self.io, QueueSelector::IOFlush).unwrap_or_default();
    }
}

impl Cable for SerialPort {
    fn read(&self, into: &mut [u8]) -> Result<usize, Errno> {
        match rustix::io::read(&self.io, into) {
            // A raw line gives at least one byte or says that it would wait: this is a hang-up.
            Ok(0) => Err(Errno::IO),
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(errno) => Err(errno),
        }
    }

    fn write(&self, bytes: &[u8]) -> Result<usize, Errno> {
        match rustix::io::write(&self.io, bytes) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(errno) => Err(errno),
        }
    }

    fn wait(&self, limit: Duration) {
        wait_readable(&self.io, limit);
    }
}

/// Asks for the lock that `serialport` will take, and gives it back. `serialport` itself, when it
/// finds the lock taken, first lifts the other program's exclusive mode.
fn refuse_if_locked(io: &OwnedFd, path: &str, link: &Arc<str>) -> Result<(), LinkError> {
    match rustix::fs::flock(io, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => rustix::fs::flock(io, FlockOperation::Unlock),
        Err(Errno::WOULDBLOCK) => {
            return Err(LinkError::Busy {
                link: Arc::clone(link),
            });
        }
        Err(errno) => Err(errno),
    }
    .map_err(|errno| refusal(errno, path, link))
}

fn refusal(errno: Errno, path: &str, link: &Arc<str>) -> LinkError {
    let link = Arc::clone(link);
    match errno {
        Errno::NOENT | Errno::NODEV | Errno::NXIO => LinkError::NoPort {
            link,
            available: available(),
        },
        Errno::BUSY => LinkError::Busy { link },
        Errno::ACCESS | Errno::PERM => LinkError::Denied {
            link,
            group: group_of(path),
        },
        Errno::ISDIR | Errno::NOTDIR => not_serial(&link),
        other => LinkError::Setup {
            link,
            why: other.to_string(),
        },
    }
}

/// Name of the group that owns a port or a socket, or its number; 'dialout' where it cannot be told.
pub(crate) fn group_of(path: &str) -> String {
    use std::os::unix::fs::MetadataExt as _;
    let Ok(found) = std::fs::metadata(path) else {
        return "dialout".to_owned();
    };
    let number = found.gid().to_string();
    let groups = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let line = groups.lines().map(|l| l.split(':').collect::<Vec<_>>());
    let named = line
        .into_iter()
        .find(|l| l.get(2) == Some(&number.as_str()))
        .and_then(|l| l.first().map(ToString::to_string));
    named.unwrap_or(number)
}

fn not_serial(link: &Arc<str>) -> LinkError {
    LinkError::NotSerial {
        link: Arc::clone(link),
        available: available(),
    }
}

/// The serial ports of this machine, for people.
pub(super) fn available() -> String {
    let ports = serialport::available_ports().unwrap_or_default();
    if ports.is_empty() {
        return "none".to_owned();
    }
    let mut names: Vec<_> = ports.into_iter().map(|port| port.port_name).collect();
    names.sort();
    let more = names.len().saturating_sub(MOST_LISTED);
    names.truncate(MOST_LISTED);
    let rest = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    format!("{}{rest}", names.join(", "))
}
