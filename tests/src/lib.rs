//! Helpers for the whole-system tests: real processes, real ports, a folder for each test.
#![expect(
    clippy::expect_used,
    clippy::panic,
    clippy::missing_panics_doc,
    reason = "a harness for tests: what goes wrong here is a failed test"
)]

pub mod baselines;
pub mod feel;
pub mod measure;
pub mod report;
pub mod scenes;
pub mod stroke;
pub mod truth;

use serde_json::Value;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The right to run a servo loop; given back when it is dropped.
#[derive(Debug)]
pub struct Turn {
    _here: MutexGuard<'static, ()>,
    _machine: File,
}

/// One servo loop at a time, on the whole machine: two cores have no room for two.
pub fn one_at_a_time() -> Turn {
    static TURN: Mutex<()> = Mutex::new(());
    let here = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let user = rustix::process::geteuid().as_raw();
    let path = std::env::temp_dir().join(format!("osteon-tests-{user}.lock"));
    let machine = File::create(path).expect("a lock file");
    machine.lock().expect("a lock");
    Turn {
        _here: here,
        _machine: machine,
    }
}

/// Where real data lie: `OSTEON_DATA`, else `../shared/data` beside the workspace.
pub fn data_folder() -> PathBuf {
    std::env::var_os("OSTEON_DATA")
        .map_or_else(|| workspace().join("../shared/data"), PathBuf::from)
}

/// Real data: `OSTEON_DATA`, else `../shared/data` beside the workspace. Where it is missing the
/// test says so aloud and is skipped.
pub fn data(test: &str) -> Option<PathBuf> {
    let dir = data_folder();
    let shoulders = dir.join("lidc0314_shoulders");
    if shoulders.is_dir() {
        return Some(shoulders);
    }
    skipped(&format!(
        "{test}: no real data at {}; set OSTEON_DATA",
        dir.display()
    ));
    None
}

/// Says aloud that something was not tested: past the test runner, which would swallow it.
pub fn skipped(what: &str) {
    writeln!(std::io::stderr(), "SKIPPED {what}").expect("standard error");
}

/// The workspace's root.
pub fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .to_owned()
}

/// A child process that is killed when the test is over.
#[derive(Debug)]
pub struct Running {
    child: Child,
    name: String,
}

impl Running {
    /// Starts `program` with `args`; output goes to `NAME.out` and `NAME.err` in `dir`.
    pub fn start(program: &str, args: &[&str], dir: &Path, name: &str) -> Self {
        let file =
            |ending: &str| File::create(dir.join(format!("{name}.{ending}"))).expect("a file");
        let child = Command::new(program)
            .args(args)
            .env("XDG_RUNTIME_DIR", dir)
            .env("LP_NUM_THREADS", "1")
            .env_remove("RUST_BACKTRACE")
            .stdin(Stdio::null())
            .stdout(file("out"))
            .stderr(file("err"))
            .spawn()
            .expect("started");
        Self {
            child,
            name: name.to_owned(),
        }
    }

    /// Process number.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal.
    pub fn signal(&self, signal: rustix::process::Signal) {
        let id = i32::try_from(self.child.id()).expect("a process number");
        let pid = rustix::process::Pid::from_raw(id).expect("a process number");
        rustix::process::kill_process(pid, signal).expect("a signal");
    }

    /// Waits for its end; fails the test after `limit`.
    pub fn wait(&mut self, limit: Duration) -> ExitStatus {
        let until = Instant::now() + limit;
        while Instant::now() < until {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("{} did not end within {limit:?}", self.name);
    }

    /// Whether it still runs.
    pub fn runs(&mut self) -> bool {
        self.child.try_wait().expect("a child").is_none()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // it may have ended already, which is what is wanted
        self.child.kill().unwrap_or(());
        drop(self.child.wait());
    }
}

/// The processes that a process has started and that still run.
pub fn children(id: u32) -> Vec<u32> {
    std::fs::read_to_string(format!("/proc/{id}/task/{id}/children"))
        .expect("children")
        .split_whitespace()
        .map(|child| child.parse().expect("a process number"))
        .collect()
}

/// Whether a process runs: it exists and is no zombie.
pub fn alive(id: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{id}/stat")).is_ok_and(|stat| {
        // the name is in parentheses and may hold anything
        stat.rsplit_once(") ")
            .is_some_and(|(_, rest)| !rest.starts_with(['Z', 'X']))
    })
}

/// Runs a program to its end, at most `limit`.
pub fn run(program: &str, args: &[&str], dir: &Path, limit: Duration) -> Output {
    let mut running = Running::start(program, args, dir, "run");
    let status = running.wait(limit);
    Output {
        status,
        stdout: std::fs::read(dir.join("run.out")).expect("output"),
        stderr: std::fs::read(dir.join("run.err")).expect("errors"),
    }
}

/// Runs a program that must fail within 10 s, with exit code `code` and without a panic; its error
/// output.
pub fn failed(program: &str, dir: &Path, args: &[&str], code: i32) -> String {
    let output = run(program, args, dir, Duration::from_secs(10));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{args:?}:\n{errors}");
    assert!(!errors.contains("panicked"), "{args:?}:\n{errors}");
    errors
}

/// Runs a program that must fail with one line that holds all of `words`.
pub fn refused(program: &str, dir: &Path, args: &[&str], words: &[&str]) {
    let errors = failed(program, dir, args, 1);
    assert_eq!(errors.lines().count(), 1, "{args:?}:\n{errors}");
    for word in words {
        assert!(errors.contains(word), "{args:?}: no '{word}' in {errors}");
    }
}

/// Waits until `ready`; fails the test after `limit`.
pub fn until(what: &str, limit: Duration, mut ready: impl FnMut() -> bool) {
    let end = Instant::now() + limit;
    while !ready() {
        assert!(
            Instant::now() < end,
            "{what} did not happen within {limit:?}"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A simulated device at `DIR/omni`, its truth in `DIR/truth.csv`.
pub fn fake(program: &str, dir: &Path, stroke: Option<&Path>) -> Running {
    fake_with(program, dir, stroke, &[])
}

/// As [`fake`], with more options.
pub fn fake_with(program: &str, dir: &Path, stroke: Option<&Path>, more: &[&str]) -> Running {
    let (link, truth) = (dir.join("omni"), dir.join("truth.csv"));
    let mut args = vec![
        "fake-omni".to_owned(),
        "--link".to_owned(),
        link.display().to_string(),
        "--truth".to_owned(),
        truth.display().to_string(),
    ];
    if let Some(stroke) = stroke {
        args.extend(["--stroke".to_owned(), stroke.display().to_string()]);
    }
    args.extend(more.iter().map(ToString::to_string));
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let device = Running::start(program, &args, dir, "fake");
    until(
        "the simulated device's port",
        Duration::from_secs(10),
        || link.exists(),
    );
    device
}

/// A haptics process on the device of [`fake`], its socket at `DIR/s/haptics.sock`, its report in
/// `DIR/report.json`; returns when it serves viewers.
pub fn haptics(program: &str, dir: &Path, more: &[&str]) -> Running {
    let device = format!("open:{}", dir.join("omni").display());
    let socket = socket(dir).display().to_string();
    let json = dir.join("report.json").display().to_string();
    let mut args = vec![
        "haptics",
        "--device",
        &device,
        "--socket",
        &socket,
        "--json",
        &json,
        "--voxel-mm",
        "1",
    ];
    args.extend(more);
    let haptics = Running::start(program, &args, dir, "haptics");
    let out = dir.join("haptics.out");
    until("the servo", Duration::from_mins(1), || {
        std::fs::read_to_string(&out).is_ok_and(|text| text.contains("1 kHz"))
    });
    haptics
}

/// The socket that [`haptics`] opens.
pub fn socket(dir: &Path) -> PathBuf {
    dir.join("s/haptics.sock")
}

/// A file of a test's folder as text.
pub fn text(dir: &Path, name: &str) -> String {
    std::fs::read_to_string(dir.join(name)).expect("a text file")
}

/// A JSON file.
pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a report")).expect("JSON")
}

/// A number of a report by its JSON pointer.
pub fn number(report: &Value, pointer: &str) -> f64 {
    report
        .pointer(pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("no number at {pointer} in {report:#}"))
}
