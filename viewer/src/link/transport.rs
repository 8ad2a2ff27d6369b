//! Where a haptics process is, and how to reach it.

use super::LinkError;
use interprocess::local_socket::{GenericFilePath, Stream, ToFsName as _, traits::Stream as _};
use std::io::{ErrorKind, Read, Write};
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
}

impl core::fmt::Display for Place {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Socket(path) => write!(f, "{}", path.display()),
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
fn starting(error: &std::io::Error) -> bool {
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
