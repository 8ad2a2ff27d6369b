//! The simulated device's end of its cable: a pseudo-terminal, or packets on a socket.

use super::port::Port;
use anyhow::Context as _;
use osteon_protocol::frame::{REPORT_BYTES, report};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, listen, socket_with,
};
use rustix::termios::OptionalActions;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

/// A cable. Never waits: what a host does not read is lost.
#[derive(Debug)]
pub enum Cable {
    /// A serial line.
    Pty(Port),
    /// Reports of 64 bytes.
    Packets(Packets),
    /// A kernel device that is there already: the other end of a USB gadget.
    Gadget(Gadget),
}

impl Cable {
    /// A pty behind the symbolic link `link`; for `packet:PATH` a socket, for `tty:PATH` and `hidg:PATH` the
    /// kernel's own device of a USB gadget.
    pub fn open(link: &Path) -> anyhow::Result<Self> {
        let kind = link.to_str().and_then(|l| l.split_once(':'));
        match kind {
            Some(("packet", path)) => Packets::listen(path.into()).map(Self::Packets),
            Some(("tty", path)) => Gadget::open(path, false).map(Self::Gadget),
            Some(("hidg", path)) => Gadget::open(path, true).map(Self::Gadget),
            _ => Port::open(link).map(Self::Pty),
        }
    }

    /// Packets on a socket that is connected already.
    pub fn connected(socket: OwnedFd) -> Self {
        Self::Packets(Packets {
            listener: None,
            host: Some(socket),
        })
    }

    /// Reads what has come, at most `buffer.len()` bytes; 0 where nothing has.
    pub fn read(&mut self, buffer: &mut [u8]) -> usize {
        match self {
            Self::Pty(port) => port.read(buffer),
            Self::Packets(packets) => packets.read(buffer),
            Self::Gadget(gadget) => gadget.read(buffer),
        }
    }

    /// Sends one frame; false where the cable is full and the frame was dropped whole.
    pub fn write_frame(&mut self, frame: &[u8]) -> bool {
        match self {
            Self::Pty(port) => port.write_frame(frame),
            Self::Packets(packets) => packets.write_frame(frame),
            Self::Gadget(gadget) => gadget.write_frame(frame),
        }
    }

    /// Lets go of a host that is dead, if the cable does not notice by itself.
    pub fn release_claim(&self) {
        if let Self::Pty(port) = self {
            port.release_claim();
        }
    }
}

/// The device's end of a USB gadget of this kernel, serial or HID.
#[derive(Debug)]
pub struct Gadget {
    file: OwnedFd,
    reports: bool,
    // rest of a frame that a serial one took in part; reports go whole
    rest: Vec<u8>,
}

impl Gadget {
    fn open(path: &str, reports: bool) -> anyhow::Result<Self> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = rustix::fs::open(path, flags, Mode::empty())
            .with_context(|| format!("gadget {path}: cannot be opened; is the gadget bound?"))?;
        if !reports {
            let mut settings = rustix::termios::tcgetattr(&file)
                .with_context(|| format!("gadget {path}: not a serial one; give hidg:{path}"))?;
            settings.make_raw();
            rustix::termios::tcsetattr(&file, OptionalActions::Now, &settings)?;
        }
        Ok(Self {
            file,
            reports,
            rest: Vec::new(),
        })
    }

    fn read(&self, buffer: &mut [u8]) -> usize {
        rustix::io::read(&self.file, buffer).unwrap_or(0)
    }

    fn write_frame(&mut self, frame: &[u8]) -> bool {
        if self.reports {
            return report(frame)
                .is_some_and(|report| rustix::io::write(&self.file, &report).is_ok());
        }
        if !self.rest.is_empty() {
            let sent = rustix::io::write(&self.file, &self.rest).unwrap_or(0);
            self.rest.drain(..sent);
        }
        if !self.rest.is_empty() {
            return false;
        }
        let sent = rustix::io::write(&self.file, frame).unwrap_or(0);
        if sent > 0 {
            self.rest.extend_from_slice(&frame[sent..]);
        }
        sent > 0
    }
}

/// A socket that keeps packets apart, with one host at a time.
#[derive(Debug)]
pub struct Packets {
    listener: Option<(OwnedFd, PathBuf)>,
    host: Option<OwnedFd>,
}

impl Packets {
    fn listen(path: PathBuf) -> anyhow::Result<Self> {
        let name = path.display();
        // what an earlier device left behind; a socket that is in use answers
        if std::os::unix::net::UnixStream::connect(&path)
            .is_err_and(|e| e.kind() == std::io::ErrorKind::ConnectionRefused)
        {
            std::fs::remove_file(&path)
                .with_context(|| format!("link {name}: cannot be replaced"))?;
        }
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        let made = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).and_then(
            |socket| {
                bind(&socket, &SocketAddrUnix::new(&path)?)?;
                listen(&socket, 4)?;
                Ok(socket)
            },
        );
        let socket =
            made.with_context(|| format!("link {name}: no socket; give another --link"))?;
        Ok(Self {
            listener: Some((socket, path)),
            host: None,
        })
    }

    /// Takes the first host that comes; hangs up on others while it stays.
    fn welcome(&mut self) {
        let Some((listener, _)) = &self.listener else {
            return;
        };
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        while let Ok(guest) = accept_with(listener, flags) {
            if self.host.is_none() {
                self.host = Some(guest);
            }
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> usize {
        self.welcome();
        let mut count = 0;
        while let (Some(host), Some(room)) =
            (&self.host, buffer.get_mut(count..count + REPORT_BYTES))
        {
            match rustix::io::read(host, room) {
                Ok(bytes) if bytes > 0 => count += bytes,
                Err(Errno::AGAIN | Errno::INTR) => break,
                // the host has gone
                _ => self.host = None,
            }
        }
        count
    }

    fn write_frame(&self, frame: &[u8]) -> bool {
        let report = report(frame);
        match (&self.host, report) {
            (Some(host), Some(report)) => rustix::io::write(host, &report).is_ok(),
            _ => false,
        }
    }
}

impl Drop for Packets {
    fn drop(&mut self) {
        if let Some((_, path)) = &self.listener {
            let _gone_already = std::fs::remove_file(path);
        }
    }
}
