//! The simulated device's end of its cable: a pseudo-terminal, or packets on a socket.

use super::port::Port;
use anyhow::Context as _;
use osteon_protocol::frame::{REPORT_BYTES, report};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, accept_with, bind, listen, socket_with,
};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

/// A cable. Never waits: what a host does not read is lost.
#[derive(Debug)]
pub enum Cable {
    /// A serial line.
    Pty(Port),
    /// Reports of 64 bytes.
    Packets(Packets),
}

impl Cable {
    /// A pty behind the symbolic link `link`, or for `packet:PATH` a socket.
    pub fn open(link: &Path) -> anyhow::Result<Self> {
        match link.to_str().and_then(|l| l.strip_prefix("packet:")) {
            Some(path) => Packets::listen(path.into()).map(Self::Packets),
            None => Port::open(link).map(Self::Pty),
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
        }
    }

    /// Sends one frame; false where the cable is full and the frame was dropped whole.
    pub fn write_frame(&mut self, frame: &[u8]) -> bool {
        match self {
            Self::Pty(port) => port.write_frame(frame),
            Self::Packets(packets) => packets.write_frame(frame),
        }
    }

    /// Lets go of a host that is dead, if the cable does not notice by itself.
    pub fn release_claim(&self) {
        if let Self::Pty(port) = self {
            port.release_claim();
        }
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
