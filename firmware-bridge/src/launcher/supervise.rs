//! The session's processes: start in order, watch, disturb where asked, end in order.

use super::child::Process;
use super::disturb::Act;
use super::plan::Plan;
use super::report;
use super::{DemoArgs, Screen};
use crate::clinic::task::Mode;
use crate::haptics::socket::{private_dir, runtime_dir};
use crate::scene::SceneArgs;
use crate::stop;
use anyhow::{Context as _, anyhow, bail};
use rustix::process::Signal;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Wait for the simulated device's port.
const DEVICE_TIMEOUT: Duration = Duration::from_secs(10);
/// Wait for the haptics process' socket: a large CT takes its time.
const SOCKET_TIMEOUT: Duration = Duration::from_mins(5);
/// Wait for a process that was asked to end.
const END_TIMEOUT: Duration = Duration::from_secs(20);
/// Viewers started again after they died unasked.
const MAX_RESTARTS: u32 = 3;

/// The session's folder and the files in it.
pub(crate) struct Files {
    pub dir: PathBuf,
    keep: bool,
}

impl Files {
    fn new(args: &DemoArgs) -> anyhow::Result<Self> {
        let (dir, keep) = if let Some(dir) = &args.keep_files {
            (dir.clone(), true)
        } else {
            private_dir(&runtime_dir())?;
            let name = format!("session-{}", std::process::id());
            (runtime_dir().join(name), false)
        };
        private_dir(&dir)?;
        Ok(Self { dir, keep })
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        if !self.keep {
            // best effort: the folder lies in the runtime directory and holds nothing of value
            std::fs::remove_dir_all(&self.dir).unwrap_or(());
        }
    }
}

/// How the viewer is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ViewerMode {
    Window,
    Offscreen,
    MirrorOnly,
}

pub(crate) fn run(args: &DemoArgs, screen: &Screen) -> anyhow::Result<()> {
    let stop = stop::on_signals()?;
    let mode = viewer_mode(args, screen);
    let files = Files::new(args)?;
    let plan = Plan::new(args)?;
    let stroke_file = files.path("stroke.json");
    std::fs::write(&stroke_file, serde_json::to_vec_pretty(&plan.stroke)?)
        .with_context(|| format!("{}: cannot write", stroke_file.display()))?;
    if let Some(picture) = &args.screenshot {
        check_writable(picture)?;
    }
    let mut session = Session::start(args, &files, mode, &stop)?;
    let haptics = session.watch(args, &files, &stop)?;
    let viewer = session.end(haptics);
    report::write(args, &files, &plan, viewer.as_ref())?;
    if !haptics.success() {
        bail!("the haptics process ended with {haptics}; its reason is above");
    }
    if let Some(status) = viewer.filter(|status| !status.success()) {
        bail!("the viewer ended with {status}; its reason is above");
    }
    Ok(())
}

/// A picture that cannot be written is told before the session, not after it.
fn check_writable(path: &Path) -> anyhow::Result<()> {
    let folder = match path.parent() {
        Some(dir) if !dir.as_os_str().is_empty() => dir,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        bail!(
            "--screenshot {}: the folder does not exist; make it or give another path",
            path.display()
        );
    }
    Ok(())
}

fn viewer_mode(args: &DemoArgs, screen: &Screen) -> ViewerMode {
    if screen.adapter.is_none() {
        report::say(
            "demo: no graphics adapter answers, so nothing can be drawn (Debian/Ubuntu: apt install mesa-vulkan-drivers); the same session runs headless, the viewer process keeps its copy of the bone without drawing",
        );
        if args.screenshot.is_some() {
            report::say("demo: no picture will be written");
        }
        return ViewerMode::MirrorOnly;
    }
    if args.headless {
        return ViewerMode::Offscreen;
    }
    match &screen.no_window {
        None => ViewerMode::Window,
        Some(why) => {
            report::say(&format!(
                "demo: no window can be opened ({why}); the same session runs headless"
            ));
            ViewerMode::Offscreen
        }
    }
}

struct Session {
    // dropped in this order: haptics, viewer, device
    haptics: Process,
    viewer: Option<Process>,
    viewer_status: Option<ExitStatus>,
    device: Process,
    viewer_args: Vec<String>,
    mode: ViewerMode,
    restarts: u32,
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

impl Session {
    fn start(
        args: &DemoArgs,
        files: &Files,
        mode: ViewerMode,
        stop: &AtomicBool,
    ) -> anyhow::Result<Self> {
        let device = start_device(files)?;
        let mut haptics = Process::start("haptics", &haptics_args(args, files), Stdio::inherit())?;
        await_socket(&mut haptics, &files.path("haptics.sock"), stop)?;
        let viewer_args = viewer_args(args, files, mode);
        let viewer = Process::start("viewer", &viewer_args, Stdio::inherit())?;
        Ok(Self {
            device,
            haptics,
            viewer: Some(viewer),
            viewer_status: None,
            viewer_args,
            mode,
            restarts: 0,
        })
    }

    /// Until the haptics process has ended; its exit status.
    fn watch(
        &mut self,
        args: &DemoArgs,
        files: &Files,
        stop: &AtomicBool,
    ) -> anyhow::Result<ExitStatus> {
        let began = Instant::now();
        let mut acts = args
            .disturb_viewer
            .clone()
            .unwrap_or_default()
            .acts
            .into_iter()
            .peekable();
        let mut asked = None;
        loop {
            if let Some(status) = self.haptics.ended() {
                return Ok(status);
            }
            if stop.load(Ordering::Relaxed) && asked.is_none() {
                asked = Some(Instant::now());
                self.haptics.signal(Signal::TERM);
            }
            if asked.is_some_and(|at| at.elapsed() > END_TIMEOUT) {
                bail!("the haptics process does not end; it is killed");
            }
            while let Some((_, act)) = acts.next_if(|(at, _)| began.elapsed() >= *at) {
                self.disturb(act)?;
            }
            if self.look_after_viewer(files, asked.is_some())? && asked.is_none() {
                asked = Some(Instant::now());
                self.haptics.signal(Signal::TERM);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn disturb(&mut self, act: Act) -> anyhow::Result<()> {
        let Some(viewer) = &mut self.viewer else {
            return Ok(());
        };
        match act {
            Act::Stop => viewer.signal(Signal::STOP),
            Act::Continue => viewer.signal(Signal::CONT),
            Act::Kill => {
                viewer.signal(Signal::KILL);
                viewer.wait(END_TIMEOUT);
                self.viewer = Some(Process::start(
                    "viewer",
                    &self.viewer_args,
                    Stdio::inherit(),
                )?);
            }
        }
        Ok(())
    }

    /// Starts a viewer again that died; true where the window was closed by its user.
    fn look_after_viewer(&mut self, files: &Files, ending: bool) -> anyhow::Result<bool> {
        let Some(status) = self.viewer.as_mut().and_then(Process::ended) else {
            return Ok(false);
        };
        self.viewer_status = Some(status);
        if ending || !files.path("haptics.sock").exists() {
            return Ok(false);
        }
        if status.success() {
            self.viewer = None;
            return Ok(self.mode == ViewerMode::Window);
        }
        self.viewer = None;
        if self.restarts == MAX_RESTARTS {
            report::say("demo: the viewer keeps failing; the session goes on without one");
            self.restarts += 1;
        } else if self.restarts < MAX_RESTARTS {
            self.restarts += 1;
            report::say(&format!(
                "demo: the viewer ended with {status}; starting another"
            ));
            let args = &self.viewer_args;
            self.viewer = Some(Process::start("viewer", args, Stdio::inherit())?);
        }
        Ok(false)
    }

    /// Ends viewer and device; the viewer's status.
    fn end(mut self, _haptics: ExitStatus) -> Option<ExitStatus> {
        let viewer = self
            .viewer
            .as_mut()
            .and_then(|v| v.wait(END_TIMEOUT))
            .or(self.viewer_status);
        self.device.signal(Signal::TERM);
        self.device.wait(END_TIMEOUT);
        viewer
    }
}

fn start_device(files: &Files) -> anyhow::Result<Process> {
    let args = [
        "fake-omni".to_owned(),
        "--link".to_owned(),
        text(&files.path("omni")),
        "--stroke".to_owned(),
        text(&files.path("stroke.json")),
        "--truth".to_owned(),
        text(&files.path("truth.csv")),
        "--die-with-parent".to_owned(),
    ];
    let mut device = Process::start("simulated device", &args, Stdio::piped())?;
    let stdout = device
        .take_stdout()
        .ok_or_else(|| anyhow!("simulated device: no output to read"))?;
    let (ready_in, ready_out) = std::sync::mpsc::sync_channel(1);
    std::thread::Builder::new()
        .name("device-output".to_owned())
        .spawn(move || {
            let mut lines = BufReader::new(stdout).lines();
            let first = lines.next().and_then(Result::ok).unwrap_or_default();
            // the launcher may have given up waiting: then nobody reads this
            ready_in.send(first).unwrap_or(());
            // keeps the pipe open and empty
            for _ in lines {}
        })
        .context("cannot start a thread")?;
    let line = ready_out.recv_timeout(DEVICE_TIMEOUT).unwrap_or_default();
    if !line.contains("ready") {
        bail!("the simulated device did not start; its reason is above");
    }
    Ok(device)
}

fn haptics_args(args: &DemoArgs, files: &Files) -> Vec<String> {
    let mut list = vec![
        "haptics".to_owned(),
        "--device".to_owned(),
        format!("open:{}", files.path("omni").display()),
        "--socket".to_owned(),
        text(&files.path("haptics.sock")),
        "--json".to_owned(),
        text(&files.path("haptics.json")),
        "--pose-log".to_owned(),
        text(&files.path("poses.csv")),
        "--seconds".to_owned(),
        args.seconds().to_string(),
        "--die-with-parent".to_owned(),
        // the demonstration's own device does not come back
        "--reconnect-for".to_owned(),
        "0".to_owned(),
    ];
    list.extend(scene_args(&args.scene));
    if args.task != Mode::Free {
        let mode = if args.task == Mode::Exam {
            "exam"
        } else {
            "guided"
        };
        list.extend(["--task".to_owned(), mode.to_owned()]);
    }
    if let Some(path) = &args.tools.tools {
        list.extend(["--tools".to_owned(), text(path)]);
    }
    if let Some(path) = &args.feel.feel {
        list.extend(["--feel".to_owned(), text(path)]);
    }
    if let Some(path) = &args.record {
        list.extend(["--record".to_owned(), text(path)]);
    }
    list
}

/// The scene's options as the haptics process takes them.
fn scene_args(scene: &SceneArgs) -> Vec<String> {
    let mut list = match &scene.scene {
        Some(dir) => vec!["--scene".to_owned(), text(dir)],
        None => vec![
            format!("--threshold={}", scene.threshold),
            format!("--seed={}", scene.seed),
        ],
    };
    let files = [
        ("--bone", &scene.bone),
        ("--labels", &scene.labels),
        ("--pose", &scene.pose),
    ];
    for (option, path) in files {
        if let Some(path) = path {
            list.extend([option.to_owned(), text(path)]);
        }
    }
    if !scene.keep.is_empty() {
        let labels: Vec<String> = scene.keep.iter().map(u8::to_string).collect();
        list.push(format!("--keep={}", labels.join(",")));
    }
    if let Some(h) = scene.voxel_mm {
        list.push(format!("--voxel-mm={h}"));
    }
    list
}

fn viewer_args(args: &DemoArgs, files: &Files, mode: ViewerMode) -> Vec<String> {
    let mut list = vec![
        "view".to_owned(),
        "--socket".to_owned(),
        text(&files.path("haptics.sock")),
        "--report".to_owned(),
        text(&files.path("viewer.json")),
        "--size".to_owned(),
        args.size.clone(),
        "--die-with-parent".to_owned(),
    ];
    let picture = args
        .screenshot
        .clone()
        .unwrap_or_else(|| files.path("last.png"));
    match mode {
        ViewerMode::Offscreen => list.extend(["--offscreen".to_owned(), text(&picture)]),
        ViewerMode::MirrorOnly => list.push("--mirror-only".to_owned()),
        ViewerMode::Window => {
            if let Some(picture) = &args.screenshot {
                // near the end, while everything still runs
                let after = (args.seconds() - 2.0).max(0.5);
                list.extend(["--window-screenshot".to_owned(), text(picture)]);
                list.extend(["--screenshot-after".to_owned(), after.to_string()]);
            }
        }
    }
    list
}

fn await_socket(haptics: &mut Process, socket: &Path, stop: &AtomicBool) -> anyhow::Result<()> {
    let began = Instant::now();
    while !socket.exists() {
        if let Some(status) = haptics.ended() {
            bail!("the haptics process ended with {status}; its reason is above");
        }
        if stop.load(Ordering::Relaxed) {
            bail!("asked to end before the session began");
        }
        if began.elapsed() > SOCKET_TIMEOUT {
            bail!("the haptics process did not open its socket within 5 minutes");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    Ok(())
}
