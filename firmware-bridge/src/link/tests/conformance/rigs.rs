//! A device of each kind, with what its plant shows.

use crate::fake::Stroke;
use crate::fake::hand::Hold;
use crate::fake::run::{FakeArgs, InProcess, serve};
use crate::link::hd::HdLink;
use crate::link::hd::ffi::mock;
use crate::link::{DeviceLink, LinkError, OpenLink, open, sim};
use crate::rt;
use std::cell::RefCell;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom, sink};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A device, and a way to look at its plant.
pub(super) trait Rig {
    /// What `--device` says.
    fn name(&self) -> String;
    fn open(&self) -> Result<Box<dyn DeviceLink>, LinkError>;
    /// A command well within the device's limits.
    fn command(&self) -> [i16; 3];
    /// What the plant then shows.
    fn expected(&self) -> [f64; 3];
    /// What the plant shows now.
    fn torque(&self) -> [f64; 3];
    /// Now, for [`Self::since`].
    fn mark(&self) -> u64 {
        0
    }
    /// All that the plant has shown since, as far as it is recorded.
    fn since(&self, _mark: u64) -> Vec<[f64; 3]> {
        vec![self.torque()]
    }
    /// Brings the arm to where a session may begin.
    fn home(&mut self) {}
    fn unplug(&mut self);
    fn plug_in(&mut self);
    /// What a pulled plug must be called.
    fn is_the_error(&self, error: &LinkError) {
        assert!(matches!(error, LinkError::Gone { .. }), "{error}");
    }
}

/// What `fake-omni` serves, in a thread.
pub(super) struct Fake {
    folder: TempDir,
    kind: &'static str,
    link: &'static str,
    model: i32,
    running: RefCell<Option<Running>>,
}

struct Running {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Running {
    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap();
    }
}

impl Fake {
    pub(super) fn open() -> Self {
        Self::new("open:", "", 0)
    }

    pub(super) fn packet() -> Self {
        Self::new("packet:", "packet:", 0)
    }

    pub(super) fn hfab(model: i32) -> Self {
        Self::new(
            "hfab:",
            ["hfab2:", "hfab3:"][usize::from(model == 3)],
            model,
        )
    }

    fn new(kind: &'static str, link: &'static str, model: i32) -> Self {
        let fake = Self {
            folder: tempfile::tempdir().unwrap(),
            kind,
            link,
            model,
            running: RefCell::new(None),
        };
        fake.restart(&[]);
        fake
    }

    /// The plug will be pulled 2 s from now: a session has begun by then.
    pub(super) fn unplugged_later(self) -> Self {
        self.restart(&["unplug@2"]);
        self
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("device")
    }

    fn truth(&self) -> PathBuf {
        self.folder.path().join("truth.csv")
    }

    /// Switches the device off and on, with these faults ahead.
    pub(super) fn restart(&self, faults: &[&str]) {
        if let Some(running) = self.running.take() {
            running.end();
        }
        let args = FakeArgs {
            link: Some(format!("{}{}", self.link, self.path().display()).into()),
            stroke: None,
            truth: Some(self.truth()),
            seconds: None,
            fault: faults.iter().map(|f| f.parse().unwrap()).collect(),
            hold: Hold::default(),
            seed: 7,
            die_with_parent: false,
        };
        let stop = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&stop);
        let thread = std::thread::Builder::new()
            .name("fake device".into())
            .spawn(move || {
                // as the process has it; without the right the test is only slower
                let _right = rt::set_fifo(rt::SERVO_PRIORITY + 1);
                serve(&args, &flag, &mut sink()).unwrap();
            })
            .unwrap();
        self.running.replace(Some(Running { stop, thread }));
        let began = Instant::now();
        while !self.path().exists() || last(&self.truth()).is_none() {
            assert!(began.elapsed().as_secs() < 10, "no device");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Opens it as another kind.
    pub(super) fn open_as(&self, kind: &str) -> Result<Box<dyn DeviceLink>, LinkError> {
        let spec = format!("{kind}{}", self.path().display());
        open(&spec.parse().unwrap())
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        if let Some(running) = self.running.take() {
            running.end();
        }
    }
}

/// Torques of the whole lines of a truth file from byte `from` on, N·mm.
fn torques(path: &Path, from: u64) -> Vec<[f64; 3]> {
    let Ok(mut file) = File::open(path) else {
        return Vec::new();
    };
    let mut text = String::new();
    file.seek(SeekFrom::Start(from)).unwrap();
    file.read_to_string(&mut text).unwrap();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |n: usize| fields.get(n)?.parse::<f64>().ok();
        // the last field is there: the line is whole
        fields.get(13)?;
        Some([number(7)?, number(8)?, number(9)?])
    };
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    whole.lines().filter_map(row).collect()
}

fn length(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |m| m.len())
}

/// Torques of the last line.
fn last(path: &Path) -> Option<[f64; 3]> {
    torques(path, length(path).saturating_sub(500)).pop()
}

impl Rig for Fake {
    fn name(&self) -> String {
        format!("{}{}", self.kind, self.path().display())
    }

    fn open(&self) -> Result<Box<dyn DeviceLink>, LinkError> {
        self.open_as(self.kind)
    }

    fn command(&self) -> [i16; 3] {
        match self.model {
            0 => [300, -400, 500],
            _ => [40, -30, 20],
        }
    }

    fn expected(&self) -> [f64; 3] {
        match self.model {
            // 0.215 N·mm a count
            0 => [64.5, -86.0, 107.5],
            // 23.4 N·mm/A through 117/13, −77/10, −77/10
            2 => [0.040 * 23.4 * 9.0, 0.030 * 23.4 * 7.7, -0.020 * 23.4 * 7.7],
            // 25.9 N·mm/A through −16, 12, −12
            _ => [
                -0.040 * 25.9 * 16.0,
                -0.030 * 25.9 * 12.0,
                -0.020 * 25.9 * 12.0,
            ],
        }
    }

    fn torque(&self) -> [f64; 3] {
        last(&self.truth()).unwrap_or([f64::NAN; 3])
    }

    fn home(&mut self) {
        if self.model != 0 {
            self.restart(&[]);
        }
    }

    fn mark(&self) -> u64 {
        length(&self.truth())
    }

    fn since(&self, mark: u64) -> Vec<[f64; 3]> {
        torques(&self.truth(), mark)
    }

    // by plan: see `unplugged_later`
    fn unplug(&mut self) {}

    fn plug_in(&mut self) {
        let began = Instant::now();
        while !self.path().exists() {
            assert!(began.elapsed().as_secs() < 10, "the plug is out");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// The simulated device of this process.
#[derive(Default)]
pub(super) struct Sim {
    folder: RefCell<Option<TempDir>>,
}

impl Sim {
    fn path(&self) -> PathBuf {
        let folder = self.folder.borrow();
        let folder = folder.as_ref().map(|f| f.path().to_owned());
        folder.unwrap_or_default().join("truth.csv")
    }
}

impl Rig for Sim {
    fn name(&self) -> String {
        "sim".to_owned()
    }

    fn open(&self) -> Result<Box<dyn DeviceLink>, LinkError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        let device = InProcess {
            stroke: Stroke::default(),
            seed: 3,
            truth: Some(path.clone()),
        };
        let link: OpenLink = sim::start(device, "sim".into())?;
        self.folder.replace(Some(folder));
        Ok(Box::new(link))
    }

    fn command(&self) -> [i16; 3] {
        [300, -400, 500]
    }

    fn expected(&self) -> [f64; 3] {
        [64.5, -86.0, 107.5]
    }

    fn torque(&self) -> [f64; 3] {
        last(&self.path()).unwrap_or([f64::NAN; 3])
    }

    fn mark(&self) -> u64 {
        length(&self.path())
    }

    fn since(&self, mark: u64) -> Vec<[f64; 3]> {
        torques(&self.path(), mark)
    }

    fn unplug(&mut self) {}

    fn plug_in(&mut self) {}
}

/// The vendor's library, played by the mock.
pub(super) struct Mock;

/// Places of the mock's plant; see `tests/mock-hd`.
const INKWELL: u32 = 3;
const CALIBRATION: u32 = 4;
const ERROR: u32 = 5;
const DEVICES: u32 = 10;

impl Mock {
    pub(super) fn new() -> Self {
        // as after switching it on: in the inkwell, calibration out of date
        mock::set(INKWELL, 1.0);
        mock::set(CALIBRATION, f64::from(0x5001));
        mock::set(ERROR, 0.0);
        Self
    }

    /// Calibration waits for somebody who puts the stylus into its inkwell.
    pub(super) fn needs_a_hand() {
        mock::set(INKWELL, 0.0);
        mock::set(CALIBRATION, f64::from(0x5002));
    }
}

impl Rig for Mock {
    fn name(&self) -> String {
        "openhaptics".to_owned()
    }

    fn open(&self) -> Result<Box<dyn DeviceLink>, LinkError> {
        let link = HdLink::through(Some(&mock::path()), None, "openhaptics".into())?;
        assert!(mock::get(DEVICES) > 0.5);
        Ok(Box::new(link))
    }

    fn command(&self) -> [i16; 3] {
        [500, -700, 900]
    }

    fn expected(&self) -> [f64; 3] {
        [0.5, -0.7, 0.9]
    }

    fn torque(&self) -> [f64; 3] {
        [0, 1, 2].map(mock::get)
    }

    fn unplug(&mut self) {
        // HD_COMM_ERROR
        mock::set(ERROR, f64::from(0x302));
    }

    fn plug_in(&mut self) {}

    fn is_the_error(&self, error: &LinkError) {
        let said = matches!(error, LinkError::Library { code: 0x302, .. });
        assert!(said && error.to_string().contains("cable"), "{error}");
    }
}
