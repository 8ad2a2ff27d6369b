//! One child process: started in a group of its own, so that a Ctrl-C reaches the launcher alone and
//! the launcher decides the order of ending.

use anyhow::Context as _;
use rustix::process::{Pid, Signal, kill_process};
use std::ffi::OsStr;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// A running child.
pub(crate) struct Process {
    child: Child,
}

impl Process {
    /// Starts the present program again with `args`. `stdout` is inherited unless it is taken.
    pub(crate) fn start<S: AsRef<OsStr>>(
        name: &'static str,
        args: &[S],
        stdout: Stdio,
    ) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("cannot find the program itself")?;
        let child = Command::new(program)
            .args(args)
            .stdin(Stdio::null())
            .stdout(stdout)
            .process_group(0)
            .spawn()
            .with_context(|| format!("{name}: cannot start"))?;
        Ok(Self { child })
    }

    /// Its standard output, where it was piped.
    pub(crate) fn take_stdout(&mut self) -> Option<std::process::ChildStdout> {
        self.child.stdout.take()
    }

    /// Sends a signal; a process that is gone already is no error.
    pub(crate) fn signal(&self, signal: Signal) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid {
            // the only failure is that it has ended, which the next wait sees
            kill_process(pid, signal).unwrap_or(());
        }
    }

    /// How it ended, if it has.
    pub(crate) fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Waits up to `limit` for its end, then kills it.
    pub(crate) fn wait(&mut self, limit: Duration) -> Option<ExitStatus> {
        let began = Instant::now();
        while began.elapsed() < limit {
            if let Some(status) = self.ended() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        self.signal(Signal::CONT);
        self.signal(Signal::KILL);
        self.child.wait().ok()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.ended().is_none() {
            self.signal(Signal::CONT);
            self.signal(Signal::TERM);
            self.wait(Duration::from_secs(2));
        }
    }
}
