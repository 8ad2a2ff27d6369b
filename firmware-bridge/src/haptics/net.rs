//! Viewers on other machines, where the user asked for it: a listening port, a handshake of fixed
//! length, then records. Nothing that is not authentic reaches a decoder of ours.

use super::viewers::{Peer, Wire};
use anyhow::{Context as _, Result, bail};
use osteon_protocol::secure::{
    ANSWER_BYTES, Answered, CALL_BYTES, Identity, MAX_SEALED, Opener, PublicKey, Sealer, answer,
};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use crate::keys::Trusted;

/// Connections that may be in their handshake.
const CALLERS: usize = 16;
/// A handshake must be over within this time.
const PATIENCE: Duration = Duration::from_secs(2);

/// The port and those who are calling.
pub(crate) struct Net {
    listener: TcpListener,
    identity: Identity,
    trusted: Vec<Trusted>,
    callers: Vec<Caller>,
}

struct Caller {
    stream: TcpStream,
    since: Instant,
    call: [u8; CALL_BYTES],
    have: usize,
}

/// What came of one visit to the port.
pub(crate) enum News {
    /// Somebody who is trusted.
    Viewer(Box<dyn Wire>, Peer),
    /// Somebody who is not, or who is none of ours.
    Refused(String),
}

impl Net {
    /// Listens at `address` (HOST:PORT). Nobody gets in whose key is not in `trusted`.
    pub(crate) fn listen(address: &str, identity: Identity, trusted: Vec<Trusted>) -> Result<Self> {
        if trusted.is_empty() {
            bail!(
                "--listen {address}: nobody could connect; trust a viewer's key first with 'osteon key trust NAME KEY'"
            );
        }
        let all = address.to_socket_addrs().with_context(|| {
            format!("--listen {address}: not an address of this machine; give HOST:PORT, for example 0.0.0.0:4610")
        })?;
        let all: Vec<_> = all.collect();
        let listener = TcpListener::bind(&all[..]).with_context(|| {
            format!("--listen {address}: cannot listen; choose another port or address")
        })?;
        listener
            .set_nonblocking(true)
            .with_context(|| format!("--listen {address}"))?;
        Ok(Self {
            listener,
            identity,
            trusted,
            callers: Vec::new(),
        })
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> String {
        let address = self.listener.local_addr();
        address.map_or_else(|e| e.to_string(), |a| a.to_string())
    }

    /// Takes connections and goes on with handshakes; never waits.
    pub(crate) fn visit(&mut self, most: usize) -> Vec<News> {
        let mut news = Vec::new();
        for _ in 0..most {
            match self.listener.accept() {
                Ok((stream, _)) => news.extend(self.admit(stream)),
                Err(e) if e.kind() == ErrorKind::WouldBlock => break,
                Err(e) => {
                    news.push(News::Refused(format!("cannot be accepted ({e})")));
                    break;
                }
            }
        }
        for mut caller in std::mem::take(&mut self.callers) {
            match caller.listen() {
                Ok(false) if caller.since.elapsed() > PATIENCE => {
                    news.push(News::Refused(
                        "did not finish its handshake in 2 s".to_owned(),
                    ));
                }
                Ok(false) => self.callers.push(caller),
                Ok(true) => news.push(self.take(caller)),
                Err(why) => news.push(News::Refused(why)),
            }
        }
        news
    }

    /// A new caller; where too many call, the one that has been at it longest goes.
    fn admit(&mut self, stream: TcpStream) -> Option<News> {
        if stream.set_nonblocking(true).is_err() {
            return None;
        }
        // small messages both ways; where it is refused they are only slower
        stream.set_nodelay(true).unwrap_or(());
        let crowded = self.callers.len() >= CALLERS;
        if crowded {
            self.callers.remove(0);
        }
        self.callers.push(Caller {
            stream,
            since: Instant::now(),
            call: [0; CALL_BYTES],
            have: 0,
        });
        crowded.then(|| News::Refused("was too slow while many others called".to_owned()))
    }

    fn take(&self, caller: Caller) -> News {
        let Caller {
            mut stream, call, ..
        } = caller;
        let known = |key: PublicKey| self.trusted.iter().any(|t| t.key == key);
        match answer(&self.identity, &call, known) {
            Ok(Answered {
                answer,
                caller,
                sealer,
                opener,
            }) => {
                // a new connection's buffer is empty: all of it goes, or the other side is gone
                if !matches!(stream.write(&answer), Ok(ANSWER_BYTES)) {
                    return News::Refused("went away in its handshake".to_owned());
                }
                News::Viewer(
                    Box::new(SecureWire::new(stream, sealer, opener)),
                    Peer::Key(caller),
                )
            }
            Err(e) => News::Refused(format!("came with {e}")),
        }
    }
}

impl Caller {
    /// True once the call is whole. Not a byte more than a call is read.
    fn listen(&mut self) -> Result<bool, String> {
        match self.stream.read(&mut self.call[self.have..]) {
            Ok(0) => Err("hung up in its handshake".to_owned()),
            Ok(n) => {
                self.have += n;
                Ok(self.have == CALL_BYTES)
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                Ok(false)
            }
            Err(e) => Err(format!("broke off its handshake ({e})")),
        }
    }
}

/// A stream of records, as a stream of what is in them. Does not block.
struct SecureWire<S> {
    stream: S,
    sealer: Sealer,
    opener: Opener,
    // opened, not yet read
    plain: Vec<u8>,
    read: usize,
    // sealed, not yet written, and of how many bytes of the caller's it is made
    sealed: Vec<u8>,
    written: usize,
    of: usize,
}

impl<S> SecureWire<S> {
    fn new(stream: S, sealer: Sealer, opener: Opener) -> Self {
        Self {
            stream,
            sealer,
            opener,
            plain: Vec::new(),
            read: 0,
            sealed: Vec::with_capacity(MAX_SEALED),
            written: 0,
            of: 0,
        }
    }
}

fn broken(e: osteon_protocol::secure::SecureError) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, format!("sent {e}"))
}

impl<S: Read> Read for SecureWire<S> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while self.read == self.plain.len() {
            self.plain.clear();
            self.read = 0;
            if self.opener.next(&mut self.plain).map_err(broken)? {
                continue;
            }
            let mut buffer = [0; 4096];
            let most = buffer.len().min(self.opener.room());
            match self.stream.read(&mut buffer[..most])? {
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

/// A record that was made is written whole before its bytes count as written: the caller comes again
/// with the same bytes until then.
impl<S: Write> Write for SecureWire<S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.sealed.is_empty() {
            self.of = self.sealer.seal(bytes, &mut self.sealed).map_err(broken)?;
        }
        while self.written < self.sealed.len() {
            match self.stream.write(&self.sealed[self.written..])? {
                0 => return Ok(0),
                n => self.written += n,
            }
        }
        self.sealed.clear();
        self.written = 0;
        Ok(self.of)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}
