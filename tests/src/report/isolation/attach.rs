//! Viewers that are attached to a session: good ones, and every kind of bad one.

use super::mirror::{Follower, hello};
use osteon_protocol::ipc::Command as Wish;
use osteon_protocol::ipc::FromViewer;
use osteon_protocol::ipc_frame::encode_into;
use osteon_sim_core::cut::Cut;
use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A kind of viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// None at all.
    Alone,
    /// One that does as it should.
    Healthy,
    /// One that is stopped (SIGSTOP) most of the time.
    Stopped,
    /// One that is killed and started again every second.
    Killed,
    /// One that sends wishes as fast as it can and reads nothing.
    Flooding,
    /// One that sends noise, and connects again when it is shown the door.
    Garbage,
    /// One that joins and reads one byte a second.
    Slow,
    /// One that draws on all cores.
    Rendering,
}

impl Kind {
    /// All of them, haptics alone first.
    pub const ALL: [Self; 8] = [
        Self::Alone,
        Self::Healthy,
        Self::Stopped,
        Self::Killed,
        Self::Flooding,
        Self::Garbage,
        Self::Slow,
        Self::Rendering,
    ];

    /// Its name in the report.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Alone => "alone",
            Self::Healthy => "healthy",
            Self::Stopped => "stopped",
            Self::Killed => "killed and restarted every second",
            Self::Flooding => "flooding",
            Self::Garbage => "sending garbage",
            Self::Slow => "reading one byte a second",
            Self::Rendering => "software-rendering on all cores",
        }
    }

    /// Whether such a viewer can say what bone it has.
    pub const fn answers(self) -> bool {
        matches!(
            self,
            Self::Healthy | Self::Stopped | Self::Killed | Self::Rendering
        )
    }
}

/// A viewer at work, until it is told to end.
#[derive(Debug)]
pub struct Attached {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<Option<Cut>>>,
}

impl Attached {
    /// Lets the viewer come to its senses and finish: one that was stopped goes on, one that was killed
    /// stays. To be called before the session ends.
    pub fn calm(&self) {
        self.end.store(true, Ordering::Relaxed);
    }

    /// Its final cut, where it kept one. To be called after the session's end.
    pub fn join(mut self) -> Option<Cut> {
        self.calm();
        self.thread.take().and_then(|t| t.join().ok().flatten())
    }
}

/// How a viewer is attached.
#[derive(Debug, Clone)]
pub struct Where {
    /// Socket of the session.
    pub socket: PathBuf,
    /// The program `osteon`.
    pub osteon: PathBuf,
    /// Folder for what it writes.
    pub folder: PathBuf,
    /// Good viewers keep a bone of their own in this process, so that it can be looked at. Else they are
    /// processes, as in a session.
    pub inside: bool,
}

/// Attaches a viewer of this kind.
pub fn attach(kind: Kind, at: &Where) -> anyhow::Result<Attached> {
    let end = Arc::new(AtomicBool::new(false));
    let (stop, at) = (Arc::clone(&end), at.clone());
    let thread = std::thread::Builder::new()
        .name("viewer".to_owned())
        .spawn(move || act(kind, &at, &stop))?;
    Ok(Attached {
        end,
        thread: Some(thread),
    })
}

fn act(kind: Kind, at: &Where, stop: &AtomicBool) -> Option<Cut> {
    match kind {
        Kind::Alone => None,
        Kind::Healthy if at.inside => Follower::new(&at.socket).run(|_| true),
        Kind::Stopped if at.inside => {
            // reads for half a second, then not at all until it is told to
            let began = Instant::now();
            let awake = |_: Duration| {
                began.elapsed() < Duration::from_millis(500) || stop.load(Ordering::Relaxed)
            };
            Follower::new(&at.socket).run(awake)
        }
        Kind::Killed if at.inside => {
            // each life is a second long; the last one lasts
            while !stop.load(Ordering::Relaxed) {
                let until = Instant::now() + Duration::from_secs(1);
                Follower::new(&at.socket).live_until(until);
            }
            Follower::new(&at.socket).run(|_| true)
        }
        Kind::Healthy => process(at, stop, &[], |_, _| {}),
        Kind::Stopped => process(at, stop, &[], |child, age| {
            let second = age.as_millis() % 1000;
            // awake for a tenth of each second, so that there is something to be stopped in
            signal(child, if second < 100 { "CONT" } else { "STOP" });
        }),
        Kind::Killed => {
            while !stop.load(Ordering::Relaxed) {
                let life = Instant::now() + Duration::from_secs(1);
                let over = || stop.load(Ordering::Relaxed) || Instant::now() >= life;
                one_process(at, &["--mirror-only"], &over, |_, _| {});
            }
            None
        }
        Kind::Rendering => {
            let picture = at.folder.join("picture.png").display().to_string();
            process(
                at,
                stop,
                &["--offscreen", &picture, "--size", "1280x720"],
                |_, _| {},
            )
        }
        Kind::Flooding => flood(at, stop),
        Kind::Garbage => garbage(at, stop),
        Kind::Slow => slow(at, stop),
    }
}

/// One process until it is told to end, or the session is over.
fn process(
    at: &Where,
    stop: &AtomicBool,
    args: &[&str],
    each: impl FnMut(&Child, Duration),
) -> Option<Cut> {
    let usual: &[&str] = &["--mirror-only"];
    let args = if args.is_empty() { usual } else { args };
    // inside, the session's own end is waited for: it asks for the digest
    let over = || !at.inside && stop.load(Ordering::Relaxed);
    one_process(at, args, &over, each);
    None
}

fn one_process(
    at: &Where,
    args: &[&str],
    over: &dyn Fn() -> bool,
    mut each: impl FnMut(&Child, Duration),
) {
    let child = Command::new(&at.osteon)
        .arg("view")
        .args(args)
        .arg("--socket")
        .arg(&at.socket)
        .env("LP_NUM_THREADS", "16")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let Ok(mut child) = child else {
        return;
    };
    let began = Instant::now();
    while !over() && matches!(child.try_wait(), Ok(None)) {
        each(&child, began.elapsed());
        std::thread::sleep(Duration::from_millis(20));
    }
    // it may have ended by itself
    child.kill().unwrap_or(());
    drop(child.wait());
}

fn signal(child: &Child, name: &str) {
    let id = i32::try_from(child.id()).ok();
    if let Some(pid) = id.and_then(rustix::process::Pid::from_raw) {
        let signal = if name == "STOP" {
            rustix::process::Signal::STOP
        } else {
            rustix::process::Signal::CONT
        };
        // one that has just ended cannot be stopped
        rustix::process::kill_process(pid, signal).unwrap_or(());
    }
}

fn flood(at: &Where, stop: &AtomicBool) -> Option<Cut> {
    let mut wishes = Vec::new();
    for on in [true, false] {
        encode_into(&FromViewer::Command(Wish::Spindle(on)), &mut wishes).ok()?;
        encode_into(&FromViewer::Command(Wish::Pause(on)), &mut wishes).ok()?;
        encode_into(&FromViewer::Command(Wish::Reset), &mut wishes).ok()?;
    }
    while !stop.load(Ordering::Relaxed) {
        let Some(mut stream) = connect(&at.socket) else {
            continue;
        };
        // never in control: somebody's wishes are a session's business, a flood's are not
        if stream.write_all(&hello("flood", false)).is_err() {
            continue;
        }
        while !stop.load(Ordering::Relaxed) {
            match stream.write(&wishes) {
                Ok(n) if n == wishes.len() => {}
                // the rest of a message would be garbage
                Ok(n) => {
                    if stream.write_all(&wishes[n..]).is_err() {
                        break;
                    }
                }
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {}
                Err(_) => break,
            }
        }
    }
    None
}

fn garbage(at: &Where, stop: &AtomicBool) -> Option<Cut> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut polite = false;
    while !stop.load(Ordering::Relaxed) {
        let Some(mut stream) = connect(&at.socket) else {
            continue;
        };
        let mut noise = [0; 4096];
        for byte in &mut noise {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            *byte = state.to_le_bytes()[7];
        }
        // what a good viewer says first, so that the noise comes to a seat every other time
        polite = !polite;
        if polite && stream.write_all(&hello("garbage", false)).is_err() {
            continue;
        }
        while !stop.load(Ordering::Relaxed) && stream.write(&noise).is_ok() {}
    }
    None
}

fn slow(at: &Where, stop: &AtomicBool) -> Option<Cut> {
    let mut stream = connect(&at.socket)?;
    stream.write_all(&hello("slow", false)).ok()?;
    let mut byte = [0];
    let mut next = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        if Instant::now() >= next {
            next += Duration::from_secs(1);
            // an end of the session ends it as well, at the next look at `stop`
            drop(stream.read(&mut byte));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    None
}

fn connect(socket: &Path) -> Option<UnixStream> {
    let Ok(stream) = UnixStream::connect(socket) else {
        std::thread::sleep(Duration::from_millis(10));
        return None;
    };
    let limit = Some(Duration::from_millis(200));
    stream.set_write_timeout(limit).ok()?;
    stream.set_read_timeout(limit).ok()?;
    Some(stream)
}
