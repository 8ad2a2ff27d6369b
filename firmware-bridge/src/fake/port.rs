//! The simulated cable: a pseudo-terminal behind a stable name.

use anyhow::{Context as _, ensure};
use osteon_protocol::hfab::MAX_LINE;
use rustix::fs::{Mode, OFlags};
use rustix::pty::OpenptFlags;
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};
use std::ffi::OsStr;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};

/// The device's end of the cable. Never waits: what a host does not read is lost.
#[derive(Debug)]
pub struct Port {
    master: OwnedFd,
    // Kept open so that a host's leaving does not end the terminal (EIO, settings reset).
    slave: OwnedFd,
    slave_path: PathBuf,
    link: PathBuf,
    // rest of a frame, or of a longer line, that the cable took in part
    rest: [u8; MAX_LINE],
    rest_len: usize,
}

impl Port {
    /// Makes a raw pseudo-terminal and points the symbolic link `link` at its host end.
    pub fn open(link: &Path) -> anyhow::Result<Self> {
        let (master, slave, slave_path) = open_pair()
            .context("fake-omni: no pseudo-terminal; mount devpts and free some ptys")?;
        point(link, &slave_path)?;
        Ok(Self {
            master,
            slave,
            slave_path,
            link: link.to_path_buf(),
            rest: [0; MAX_LINE],
            rest_len: 0,
        })
    }

    /// Reads what has come, at most `buffer.len()` bytes; 0 where nothing has.
    pub fn read(&self, buffer: &mut [u8]) -> usize {
        rustix::io::read(&self.master, buffer).unwrap_or(0)
    }

    /// Sends one frame; false where the cable is full and the frame was dropped whole.
    pub fn write_frame(&mut self, frame: &[u8]) -> bool {
        // A frame cut in two would be a CRC error at the host: its rest goes first.
        if !self.send_rest() {
            return false;
        }
        let sent = rustix::io::write(&self.master, frame).unwrap_or(0);
        if sent == 0 {
            return false;
        }
        let left = frame.get(sent..).unwrap_or(&[]);
        self.rest[..left.len()].copy_from_slice(left);
        self.rest_len = left.len();
        true
    }

    fn send_rest(&mut self) -> bool {
        if self.rest_len > 0 {
            let sent = rustix::io::write(&self.master, &self.rest[..self.rest_len]).unwrap_or(0);
            self.rest.copy_within(sent..self.rest_len, 0);
            self.rest_len -= sent;
        }
        self.rest_len == 0
    }

    /// Takes a dead host's exclusive claim off the terminal. A host that is killed cannot do it, and
    /// with our own handle open the kernel does not.
    pub fn release_claim(&self) {
        // Refused only for a terminal that is gone; then the next write says so.
        let _refusal = ioctl_tiocnxcl(&self.slave);
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        // A later device may have taken the name over: then it is not ours to remove.
        if std::fs::read_link(&self.link).is_ok_and(|to| to == self.slave_path) {
            let _gone_already = std::fs::remove_file(&self.link);
        }
    }
}

fn open_pair() -> anyhow::Result<(OwnedFd, OwnedFd, PathBuf)> {
    let master =
        rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    rustix::pty::grantpt(&master)?;
    rustix::pty::unlockpt(&master)?;
    let name = rustix::pty::ptsname(&master, Vec::new())?;
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let slave = rustix::fs::open(name.as_c_str(), flags, Mode::empty())?;
    let mut settings = tcgetattr(&slave)?;
    settings.make_raw();
    tcsetattr(&slave, OptionalActions::Now, &settings)?;
    let status = rustix::fs::fcntl_getfl(&master)?;
    rustix::fs::fcntl_setfl(&master, status | OFlags::NONBLOCK)?;
    let path = PathBuf::from(OsStr::from_bytes(name.as_bytes()));
    Ok((master, slave, path))
}

/// Points `link` at `target` in one step, so that a reader never finds it missing.
fn point(link: &Path, target: &Path) -> anyhow::Result<()> {
    let name = link.display();
    if let Ok(found) = std::fs::symlink_metadata(link) {
        ensure!(
            found.file_type().is_symlink(),
            "link {name}: exists and is not a symbolic link; give another --link"
        );
    }
    let file_name = link
        .file_name()
        .with_context(|| format!("link {name}: no file name; give a path for --link"))?;
    let mut fresh = std::ffi::OsString::from(".");
    fresh.push(file_name);
    fresh.push(format!(".{}", std::process::id()));
    let fresh = link.with_file_name(fresh);
    // A left-over of a killed process with our number.
    let _none_there = std::fs::remove_file(&fresh);
    std::os::unix::fs::symlink(target, &fresh)
        .and_then(|()| std::fs::rename(&fresh, link))
        .with_context(|| format!("link {name}: cannot be made; give a writable --link"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read as _, Write as _};

    #[test]
    fn bytes_pass_unchanged_both_ways_and_a_stalled_host_costs_whole_frames() {
        let dir = tempfile::tempdir().unwrap();
        let link = dir.path().join("cable");
        let mut port = Port::open(&link).unwrap();
        let mut host = std::fs::File::options()
            .read(true)
            .write(true)
            .open(&link)
            .unwrap();
        // Every byte value: control characters must not be interpreted.
        let all: Vec<u8> = (0..=255).collect();
        host.write_all(&all).unwrap();
        let mut got = Vec::new();
        let mut buffer = [0; 64];
        for _ in 0..1000 {
            let n = port.read(&mut buffer);
            got.extend_from_slice(&buffer[..n]);
            if got.len() == all.len() {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        assert_eq!(got, all);
        assert_eq!(port.read(&mut buffer), 0);

        // Nobody reads: numbered frames are dropped whole, and what arrives is a prefix of numbers.
        let frame = |n: u32| -> Vec<u8> {
            let mut bytes = n.to_le_bytes().repeat(12);
            bytes.push(0xff);
            bytes
        };
        let mut sent = Vec::new();
        for n in 0..2000 {
            if port.write_frame(&frame(n)) {
                sent.extend(frame(n));
            }
        }
        assert!(sent.len() < 2000 * 49, "the cable never filled");
        let mut read = vec![0; sent.len()];
        let (now, later) = read.split_at_mut(4096);
        host.read_exact(now).unwrap();
        let mut rest_gone = false;
        for chunk in later.chunks_mut(512) {
            rest_gone |= port.send_rest();
            host.read_exact(chunk).unwrap();
        }
        assert!(rest_gone);
        assert_eq!(read, sent);
    }

    #[test]
    fn the_link_is_replaced_and_removed_but_nothing_else_is() {
        let dir = tempfile::tempdir().unwrap();
        let link = dir.path().join("cable");
        let first = Port::open(&link).unwrap();
        let second = Port::open(&link).unwrap();
        assert_eq!(std::fs::read_link(&link).unwrap(), second.slave_path);
        drop(first);
        assert!(link.exists(), "the first took the second's link along");
        drop(second);
        assert!(std::fs::symlink_metadata(&link).is_err());

        std::fs::write(&link, "precious").unwrap();
        let text = format!("{:#}", Port::open(&link).unwrap_err());
        assert!(text.contains("not a symbolic link"), "{text}");
        assert_eq!(std::fs::read_to_string(&link).unwrap(), "precious");
    }
}
