//! Stock Omni and Touch through the vendor's own library (HDAPI of OpenHaptics), loaded at run time.
//!
//! The library owns the cable, the calibration and a 1 kHz thread; it tells poses and takes forces. So this
//! link is the one whose clock is the device's alone: the callback (`callback.rs`) hands each state to the
//! servo thread and shows the newest force in its next period, one millisecond later. A watchdog of
//! our own runs in the callback (hold 5 ms, zero at 20 ms); what the device does when the whole process
//! dies is the vendor's driver's, and closed.
//!
//! Not yet run on a real Omni or Touch: tests run it against a mock library of the same interface.
//! Unverified: that the library's z axis points along the stylus to its rear, as here.

mod callback;
pub(super) mod ffi;

use super::mailbox::{Inlet, mailbox};
use super::order::Order;
use super::{Clocks, DeviceInfo, DeviceLink, LinkError, LinkStats};
use crate::rt::now_ns;
use callback::{Callback, Shared, Watch};
use ffi::{ErrorInfo, Hd, Text, calibration, code};
use osteon_protocol::device::{CommandFrame, StateFrame};
use osteon_sim_core::arm::Arm;
use osteon_sim_core::servo::DeviceScale;
use std::ffi::CString;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Environment variable that names the library.
pub(crate) const LIBRARY_VARIABLE: &str = "OSTEON_LIBHD";
/// Names under which the system may know it.
const NAMES: [&str; 3] = ["libHD.so", "libHD.so.3.4", "libHD.so.3.0"];
/// Positions are told in micrometres.
const COUNTS_PER_MM: u32 = 1000;
const GIMBAL_COUNTS: u16 = 32_768;
/// Forces are told in millinewtons.
const NEWTON_PER_COUNT: f64 = 1e-3;
/// Longest wait for a calibration that needs no hand, and for the first state.
const CALIBRATE: Duration = Duration::from_secs(5);
/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(5);
/// Periods in which a zero force has certainly been set.
const SETTLED: u32 = 2;

/// A device behind the vendor's library.
#[derive(Debug)]
pub(super) struct HdLink {
    name: Arc<str>,
    info: DeviceInfo,
    hd: &'static Hd,
    device: u32,
    shared: Arc<Shared>,
    inlet: Option<Inlet>,
    scheduled: Option<std::ffi::c_ulong>,
    stats: LinkStats,
    order: Order,
    dropped_commands: u64,
}

/// What the counts of this link mean.
fn scale(max_force_n: f64) -> DeviceScale {
    #[expect(clippy::cast_possible_truncation, reason = "clamped into the range")]
    let most = (max_force_n.clamp(0.1, 30.0) / NEWTON_PER_COUNT) as i16;
    DeviceScale {
        arm: Arm::Cartesian,
        counts_per_rev: COUNTS_PER_MM,
        gimbal_counts_per_rev: GIMBAL_COUNTS,
        dac_max: most,
        nmm_per_count: NEWTON_PER_COUNT,
    }
}

/// Loads the library of this path, or the system's.
fn load(named: Option<&str>, name: &Arc<str>) -> Result<&'static Hd, LinkError> {
    let tries = named.map_or(NAMES.to_vec(), |path| vec![path]);
    let mut why = String::new();
    for path in tries {
        match ffi::load(path) {
            Ok(hd) => return Ok(hd),
            Err(e) if why.is_empty() => why = e,
            Err(_) => {}
        }
    }
    Err(LinkError::NoLibrary {
        link: Arc::clone(name),
        why,
    })
}

/// Whether the vendor's library can be loaded, and under which name; no device is started.
pub fn vendor_library() -> Result<String, String> {
    let library = std::env::var(LIBRARY_VARIABLE).ok();
    let loaded = load(library.as_deref(), &"openhaptics".into());
    loaded
        .map(|_| library.unwrap_or_else(|| NAMES[0].to_owned()))
        .map_err(|error| match error {
            LinkError::NoLibrary { why, .. } => why,
            other => other.to_string(),
        })
}

/// An error of the library in our words.
fn refusal(hd: &Hd, name: &Arc<str>, call: &'static str, error: ErrorInfo) -> LinkError {
    let remedy = match error.code {
        code::ALREADY_INITIATED => "another program uses the device; end it",
        code::COMM_ERROR | code::COMM_CONFIG => {
            "check cable and power, and the device's name in the vendor's configuration"
        }
        code::WARM_MOTORS => "let the motors cool down",
        _ => "run the vendor's own diagnostic program",
    };
    let what = hd.error_text(error.code);
    let what = format!(
        "{what} (inner code {}, device {})",
        error.internal, error.device
    );
    LinkError::Library {
        link: Arc::clone(name),
        call,
        what,
        code: error.code,
        remedy,
    }
}

impl HdLink {
    /// Loads the library and starts the device of this name, or the default one.
    pub(super) fn open(device: Option<&str>, name: Arc<str>) -> Result<Self, LinkError> {
        let library = std::env::var(LIBRARY_VARIABLE).ok();
        Self::through(library.as_deref(), device, name)
    }

    /// As [`Self::open`], through the library at this path.
    pub(super) fn through(
        library: Option<&str>,
        device: Option<&str>,
        name: Arc<str>,
    ) -> Result<Self, LinkError> {
        let hd = load(library, &name)?;
        let text = device.map(CString::new).transpose();
        let text = text.map_err(|e| LinkError::Setup {
            link: Arc::clone(&name),
            why: e.to_string(),
        })?;
        let device = hd.init_device(text.as_ref());
        let error = hd.error();
        if device == ffi::INVALID || error.code != 0 {
            return Err(match error.code {
                code::ALREADY_INITIATED => LinkError::Busy { link: name },
                _ => refusal(hd, &name, "hdInitDevice", error),
            });
        }
        hd.make_current(device);
        let info = DeviceInfo {
            model: hd.text(Text::Model),
            serial: hd.text(Text::Serial),
            firmware: format!("driver {}", hd.text(Text::Driver)),
            scale: scale(hd.max_force_n()),
            period_micros: 1000,
        };
        Ok(Self {
            name,
            info,
            hd,
            device,
            shared: Arc::new(Shared::default()),
            inlet: None,
            scheduled: None,
            stats: LinkStats::default(),
            order: Order::default(),
            dropped_commands: 0,
        })
    }

    fn setup(&self, why: String) -> LinkError {
        LinkError::Setup {
            link: Arc::clone(&self.name),
            why,
        }
    }

    /// Starts the library's thread.
    fn schedule(&mut self) -> Result<(), LinkError> {
        let (outlet, inlet) = mailbox().map_err(|e| self.setup(e.to_string()))?;
        let work = Callback {
            name: Arc::clone(&self.name),
            hd: self.hd,
            device: self.device,
            shared: Arc::clone(&self.shared),
            outlet,
            watch: Watch::default(),
            seq: 0,
            bad: 0,
            faults: 0,
            stats: LinkStats::default(),
        };
        self.scheduled = Some(self.hd.schedule(Box::new(work)));
        self.hd.start_scheduler();
        let error = self.hd.error();
        if error.code != 0 {
            return Err(refusal(self.hd, &self.name, "hdStartScheduler", error));
        }
        self.inlet = Some(inlet);
        Ok(())
    }

    /// Calibrates as the device wants it: by itself, or in the inkwell; what needs a hand is refused with
    /// what the hand should do.
    fn calibrate(&mut self) -> Result<(), LinkError> {
        let style = self.hd.calibration_style();
        let began = Instant::now();
        let mut status = self.hd.check_calibration();
        while status != calibration::OK && began.elapsed() < CALIBRATE {
            if status == calibration::NEEDS_UPDATE {
                let best = [
                    calibration::INKWELL,
                    calibration::AUTO,
                    calibration::ENCODER_RESET,
                ];
                let best = best.into_iter().find(|bit| style & bit != 0);
                self.hd.update_calibration(best.unwrap_or(style));
            }
            if status == calibration::NEEDS_MANUAL_INPUT && style & calibration::INKWELL == 0 {
                break;
            }
            std::thread::sleep(LOOK);
            status = self.hd.check_calibration();
        }
        if status == calibration::OK {
            return Ok(());
        }
        let remedy = if style & calibration::INKWELL != 0 {
            "put the stylus into its inkwell and start again"
        } else {
            "hold the arm in its reset pose, as the vendor's guide shows it, and start again"
        };
        Err(LinkError::Uncalibrated {
            link: Arc::clone(&self.name),
            remedy: remedy.to_owned(),
        })
    }

    /// Until the callback has run some more periods, at most 20 ms.
    fn settle(&self) {
        let before = self.shared.periods.load(Ordering::Acquire);
        for _ in 0..20 {
            let now = self.shared.periods.load(Ordering::Acquire);
            if now.wrapping_sub(before) >= SETTLED {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl DeviceLink for HdLink {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn prepare(&mut self) -> Result<(), LinkError> {
        self.schedule()?;
        self.calibrate()?;
        self.hd.enable_forces();
        let error = self.hd.error();
        if error.code != 0 {
            return Err(refusal(
                self.hd,
                &self.name,
                "hdEnable(force output)",
                error,
            ));
        }
        self.wait(now_ns() + 1_000_000_000);
        match self.poll()? {
            Some(_) => Ok(()),
            None => Err(LinkError::Silent {
                link: Arc::clone(&self.name),
                seconds: 1,
            }),
        }
    }

    fn start(&mut self) -> Result<(), LinkError> {
        Ok(())
    }

    fn wait(&mut self, deadline_ns: u64) {
        if let Some(inlet) = &mut self.inlet {
            inlet.wait(deadline_ns);
        }
    }

    fn poll(&mut self) -> Result<Option<StateFrame>, LinkError> {
        let Some(inlet) = &mut self.inlet else {
            return Ok(None);
        };
        let newest = inlet.poll()?;
        self.stats = inlet.stats();
        Ok(newest)
    }

    fn send(&mut self, command: &CommandFrame) -> Result<(), LinkError> {
        let most = self.info.scale.dac_max;
        let force = command.torque.map(|t| t.clamp(-most, most));
        let force = if command.enable { force } else { [0; 3] };
        if !self.order.admits(*command) {
            self.dropped_commands += 1;
            return Ok(());
        }
        self.shared.store(command.seq, force);
        self.shared.live.store(command.enable, Ordering::Release);
        Ok(())
    }

    fn disarm(&mut self) {
        self.shared.live.store(false, Ordering::Release);
        self.settle();
    }

    fn stats(&self) -> LinkStats {
        LinkStats {
            dropped_commands: self.dropped_commands,
            ..self.stats
        }
    }

    fn describe(&self) -> String {
        self.name.to_string()
    }

    fn clock(&self) -> Clocks {
        Clocks::DeviceOnly
    }
}

impl Drop for HdLink {
    fn drop(&mut self) {
        if let Some(handle) = self.scheduled.take() {
            self.disarm();
            self.hd.stop_scheduler();
            self.hd.unschedule(handle);
        }
        self.hd.disable_device(self.device);
    }
}
