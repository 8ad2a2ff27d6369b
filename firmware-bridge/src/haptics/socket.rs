//! The viewers' socket: in a directory that only the user can enter, and only for the user's own
//! processes.

use anyhow::{Context as _, bail};
use interprocess::local_socket::traits::StreamCommon as _;
use interprocess::local_socket::{
    GenericFilePath, Listener, ListenerNonblockingMode, ListenerOptions, Stream, ToFsName as _,
};
use rustix::process::geteuid;
use std::fs::{self, DirBuilder};
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

/// The user's private directory for sockets and links ([`osteon_protocol::ipc::private_dir`]).
pub fn runtime_dir() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR");
    osteon_protocol::ipc::private_dir(
        runtime.as_deref().map(Path::new),
        &std::env::temp_dir(),
        geteuid().as_raw(),
    )
}

/// Makes `dir` with access for the user alone; refuses one that exists and belongs to, or opens to,
/// somebody else.
pub fn private_dir(dir: &Path) -> anyhow::Result<()> {
    if !dir.exists() {
        return DirBuilder::new()
            .mode(0o700)
            .recursive(true)
            .create(dir)
            .with_context(|| format!("socket directory {}: cannot make it", dir.display()));
    }
    let meta = fs::symlink_metadata(dir)
        .with_context(|| format!("socket directory {}: cannot look at it", dir.display()))?;
    if !meta.is_dir() || meta.uid() != geteuid().as_raw() || meta.mode() & 0o077 != 0 {
        bail!(
            "socket directory {}: must be a directory of yours that nobody else can enter; 'chmod 700' it or give --socket elsewhere",
            dir.display()
        );
    }
    Ok(())
}

/// Opens the socket at `path`, whose directory is made private. A socket that a live process holds
/// is left alone.
pub(crate) fn listen(path: &Path) -> anyhow::Result<Listener> {
    use interprocess::local_socket::traits::Stream as _;
    let dir = match path.parent() {
        Some(dir) if !dir.as_os_str().is_empty() => dir,
        _ => Path::new("."),
    };
    private_dir(dir)?;
    let name = || {
        path.to_fs_name::<GenericFilePath>()
            .with_context(|| format!("socket {}: not a usable path", path.display()))
    };
    if let Ok(meta) = fs::symlink_metadata(path) {
        if !meta.file_type().is_socket() {
            bail!(
                "socket {}: a file of that name exists and is no socket; give another --socket",
                path.display()
            );
        }
        if Stream::connect(name()?).is_ok() {
            bail!(
                "socket {}: another haptics process is listening there; end it or give --socket",
                path.display()
            );
        }
        fs::remove_file(path)
            .with_context(|| format!("socket {}: cannot remove the old one", path.display()))?;
    }
    ListenerOptions::new()
        .name(name()?)
        .nonblocking(ListenerNonblockingMode::Accept)
        .create_sync()
        .with_context(|| format!("socket {}: cannot listen", path.display()))
}

/// The next waiting connection of the user's own, if any; a stranger's is refused with a reason.
pub(crate) fn accept(listener: &Listener) -> Option<anyhow::Result<Stream>> {
    use interprocess::local_socket::traits::Listener as _;
    match listener.accept() {
        Ok(stream) => Some(own(stream)),
        Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => None,
        Err(e) => Some(Err(e.into())),
    }
}

fn own(stream: Stream) -> anyhow::Result<Stream> {
    use interprocess::local_socket::traits::Stream as _;
    stream
        .set_nonblocking(true)
        .context("viewer connection: cannot make it non-blocking")?;
    let credentials = stream
        .peer_creds()
        .context("viewer connection: cannot see whose it is")?;
    match credentials.euid() {
        Some(uid) if uid == geteuid().as_raw() => Ok(stream),
        Some(uid) => bail!("viewer connection of user {uid} refused: not yours"),
        None => bail!("viewer connection refused: the system does not say whose it is"),
    }
}
