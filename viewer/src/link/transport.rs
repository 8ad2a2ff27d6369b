//! Where a haptics process is, and how to reach it.

use super::LinkError;
use interprocess::local_socket::{GenericFilePath, Stream, ToFsName as _, traits::Stream as _};
use osteon_protocol::secure::{
    ANSWER_BYTES, Call, Identity, MAX_SEALED, Opener, PublicKey, Sealer,
};
use std::io::{Error, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a socket may be absent before that is an error: the haptics process may be starting.
const PATIENCE: Duration = Duration::from_secs(3);

/// What is read from.
pub(crate) type In = Box<dyn Read + Send>;
/// What is written to.
pub(crate) type Out = Box<dyn Write + Send>;

/// Where a haptics process listens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Place {
    /// On a socket of this machine.
    Socket(PathBuf),
    /// On another machine.
    Net(Remote),
}

/// A haptics process on another machine, and who we are to it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remote {
    /// HOST:PORT.
    pub address: String,
    /// This viewer's own key.
    pub own: Identity,
    /// The haptics process's key.
    pub theirs: PublicKey,
}

impl core::fmt::Display for Place {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Socket(path) => write!(f, "{}", path.display()),
            Self::Net(remote) => f.write_str(&remote.address),
        }
    }
}

impl Place {
    /// Connects, patiently where nobody listens yet.
    pub(crate) fn connect(&self) -> Result<(In, Out), LinkError> {
        match self {
            Self::Socket(path) => {
                let stream = Arc::new(socket(path)?);
                Ok((Box::new(Half(Arc::clone(&stream))), Box::new(Half(stream))))
            }
            Self::Net(remote) => remote.connect(),
        }
    }
}

fn socket(path: &Path) -> Result<Stream, LinkError> {
    let until = Instant::now() + PATIENCE;
    loop {
        let name = path.to_fs_name::<GenericFilePath>();
        let name = name.map_err(|reason| LinkError::Name {
            path: path.to_owned(),
            reason,
        })?;
        match Stream::connect(name) {
            Ok(stream) => return Ok(stream),
            Err(e) if starting(&e) && Instant::now() < until => {
                std::thread::sleep(Duration::from_millis(50));
            }
            Err(reason) => {
                return Err(LinkError::Connect {
                    path: path.to_owned(),
                    reason,
                });
            }
        }
    }
}

/// Whether an error may go away when the haptics process has come up.
fn starting(error: &Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::NotFound | ErrorKind::ConnectionRefused
    )
}

/// One direction of a socket.
struct Half(Arc<Stream>);

impl Read for Half {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        (&*self.0).read(bytes)
    }
}

impl Write for Half {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        (&*self.0).write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        (&*self.0).flush()
    }
}

impl Remote {
    fn connect(&self) -> Result<(In, Out), LinkError> {
        let failed = |reason| LinkError::Remote {
            address: self.address.clone(),
            reason,
        };
        let stream = self.open().map_err(failed)?;
        let (sealer, opener) = self.greet(&stream).map_err(failed)?;
        let back = stream.try_clone().map_err(failed)?;
        Ok((
            Box::new(Opening {
                stream: back,
                opener,
                plain: Vec::new(),
                read: 0,
            }),
            Box::new(Sealing {
                stream,
                sealer,
                sealed: Vec::new(),
            }),
        ))
    }

    fn open(&self) -> Result<TcpStream, Error> {
        let until = Instant::now() + PATIENCE;
        loop {
            let mut failure = Error::new(ErrorKind::NotFound, "no such host");
            for address in self.address.to_socket_addrs()? {
                match TcpStream::connect_timeout(&address, PATIENCE) {
                    Ok(stream) => return Ok(stream),
                    Err(e) => failure = e,
                }
            }
            if !starting(&failure) || Instant::now() >= until {
                return Err(failure);
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The handshake; afterwards the other side is who it should be, and so are we to it.
    fn greet(&self, mut stream: &TcpStream) -> Result<(Sealer, Opener), Error> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        let refused = |e| Error::new(ErrorKind::PermissionDenied, e);
        let (call, bytes) = Call::begin(&self.own, self.theirs).map_err(refused)?;
        stream.write_all(&bytes)?;
        let mut answer = [0; ANSWER_BYTES];
        stream.read_exact(&mut answer).map_err(|e| {
            let why = "it does not answer: this viewer's key may not be trusted there";
            Error::new(e.kind(), why)
        })?;
        let halves = call.end(&answer).map_err(refused)?;
        stream.set_read_timeout(None)?;
        Ok(halves)
    }
}

/// What comes in, opened record by record.
struct Opening {
    stream: TcpStream,
    opener: Opener,
    // opened, not yet read
    plain: Vec<u8>,
    read: usize,
}

impl Read for Opening {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        while self.read == self.plain.len() {
            self.plain.clear();
            self.read = 0;
            if self.opener.next(&mut self.plain).map_err(Error::other)? {
                continue;
            }
            let mut buffer = vec![0; MAX_SEALED];
            let room = self.opener.room();
            match self.stream.read(&mut buffer[..room])? {
                0 => return Ok(0),
                n => self.opener.push(&buffer[..n]),
            }
        }
        let count = out.len().min(self.plain.len() - self.read);
        out[..count].copy_from_slice(&self.plain[self.read..self.read + count]);
        self.read += count;
        Ok(count)
    }
}

/// What goes out, a record for each write.
struct Sealing {
    stream: TcpStream,
    sealer: Sealer,
    sealed: Vec<u8>,
}

impl Write for Sealing {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if bytes.is_empty() {
            return Ok(0);
        }
        self.sealed.clear();
        let count = self.sealer.seal(bytes, &mut self.sealed);
        let count = count.map_err(Error::other)?;
        self.stream.write_all(&self.sealed)?;
        Ok(count)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.stream.flush()
    }
}
