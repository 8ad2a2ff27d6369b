//! The vendor's library libHD, loaded at run time: its functions as Rust sees them, nothing more.
//!
//! The one file of this crate with `unsafe`. Types, numbers and names are those of the HDAPI as published
//! with OpenHaptics (`HD/hd.h`, `hdDevice.h`, `hdScheduler.h`, `hdDefines.h`); the headers are not copied.
#![expect(unsafe_code, reason = "calls into a library that is written in C")]

use libloading::Library;
use libloading::os::unix::{Library as UnixLibrary, RTLD_GLOBAL, RTLD_LAZY};
use std::ffi::{CStr, CString, c_char, c_ulong, c_void};
use std::sync::{Mutex, PoisonError};

/// What `hdInitDevice` gives for no device.
pub(super) const INVALID: u32 = 0xFFFF_FFFF;
/// The scheduler's highest priority.
const MOST_PRIORITY: u16 = 65_535;
/// `hdCheckCalibration`: calibrated; needs an update; needs a hand.
pub(super) mod calibration {
    pub(crate) const OK: u32 = 0x5000;
    pub(crate) const NEEDS_UPDATE: u32 = 0x5001;
    pub(crate) const NEEDS_MANUAL_INPUT: u32 = 0x5002;
    /// Bits of the style: by hand at a reset pose, by itself, in the inkwell.
    pub(crate) const ENCODER_RESET: i32 = 1;
    pub(crate) const AUTO: i32 = 2;
    pub(crate) const INKWELL: i32 = 4;
}
/// Error codes that have a meaning of their own here.
pub(super) mod code {
    pub(crate) const WARM_MOTORS: u32 = 0x200;
    pub(crate) const MAX_FORCE: u32 = 0x201;
    pub(crate) const MAX_IMPULSE: u32 = 0x202;
    pub(crate) const MAX_VELOCITY: u32 = 0x203;
    pub(crate) const FORCE_ERROR: u32 = 0x204;
    pub(crate) const DEVICE_FAULT: u32 = 0x300;
    pub(crate) const ALREADY_INITIATED: u32 = 0x301;
    pub(crate) const COMM_ERROR: u32 = 0x302;
    pub(crate) const COMM_CONFIG: u32 = 0x303;
    pub(crate) const TIMER: u32 = 0x304;
}
const FORCE_OUTPUT: u32 = 0x4000;
const MAX_FORCE_CLAMPING: u32 = 0x4001;
const CURRENT_BUTTONS: u32 = 0x2000;
const INKWELL_SWITCH: u32 = 0x2002;
const CURRENT_TRANSFORM: u32 = 0x2052;
const CALIBRATION_STYLE: u32 = 0x2555;
const NOMINAL_MAX_FORCE: u32 = 0x2603;
const CURRENT_FORCE: u32 = 0x2700;

/// A text about the device.
#[derive(Debug, Clone, Copy)]
pub(super) enum Text {
    Model = 0x2501,
    Driver = 0x2502,
    Serial = 0x2504,
}

/// The error record, which the library returns by value.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub(super) struct ErrorInfo {
    pub(super) code: u32,
    pub(super) internal: i32,
    pub(super) device: u32,
}

/// A function that the scheduler calls; returns 0 = done, 1 = call again.
pub(super) type Tick = extern "C" fn(*mut c_void) -> u32;

macro_rules! library {
    ($($field:ident = $symbol:literal: fn($($arg:ty),*) $(-> $back:ty)?;)*) => {
        /// The functions, found by name.
        #[derive(Debug)]
        pub(super) struct Hd {
            $($field: unsafe extern "C" fn($($arg),*) $(-> $back)?,)*
        }

        impl Hd {
            fn resolve(library: &Library) -> Result<Self, String> {
                Ok(Self {
                    $($field: {
                        // SAFETY: the name belongs to a function of exactly this signature by the
                        // library's published interface
                        let found = unsafe { library.get($symbol.as_bytes()) };
                        *found.map_err(|e| e.to_string())?
                    },)*
                })
            }
        }
    };
}

library! {
    init_device = "hdInitDevice": fn(*const c_char) -> u32;
    disable_device = "hdDisableDevice": fn(u32);
    make_current = "hdMakeCurrentDevice": fn(u32);
    begin_frame = "hdBeginFrame": fn(u32);
    end_frame = "hdEndFrame": fn(u32);
    get_error = "hdGetError": fn() -> ErrorInfo;
    error_string = "hdGetErrorString": fn(u32) -> *const c_char;
    enable = "hdEnable": fn(u32);
    get_booleanv = "hdGetBooleanv": fn(u32, *mut u8);
    get_integerv = "hdGetIntegerv": fn(u32, *mut i32);
    get_doublev = "hdGetDoublev": fn(u32, *mut f64);
    get_string = "hdGetString": fn(u32) -> *const c_char;
    set_doublev = "hdSetDoublev": fn(u32, *const f64);
    check_calibration = "hdCheckCalibration": fn() -> u32;
    update_calibration = "hdUpdateCalibration": fn(u32);
    start_scheduler = "hdStartScheduler": fn();
    stop_scheduler = "hdStopScheduler": fn();
    schedule = "hdScheduleAsynchronous": fn(Tick, *mut c_void, u16) -> c_ulong;
    unschedule = "hdUnschedule": fn(c_ulong);
}

/// The library stays loaded: its driver does not survive being loaded twice in one process.
static LOADED: Mutex<Option<&'static Hd>> = Mutex::new(None);

/// Loads the library at `path` once; later calls give the same one.
pub(super) fn load(path: &str) -> Result<&'static Hd, String> {
    let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(hd) = *loaded {
        return Ok(hd);
    }
    // SAFETY: loading runs the library's start-up code, which the user has chosen by installing it or by
    // naming it; global and lazy, as its own parts look for each other
    let opened = unsafe { UnixLibrary::open(Some(path), RTLD_GLOBAL | RTLD_LAZY) };
    let library: &'static Library = Box::leak(Box::new(opened.map_err(|e| e.to_string())?.into()));
    let hd: &'static Hd = Box::leak(Box::new(Hd::resolve(library)?));
    *loaded = Some(hd);
    Ok(hd)
}

impl Hd {
    /// Starts a device; `None` = the default one. [`INVALID`] where it fails.
    pub(super) fn init_device(&self, name: Option<&CString>) -> u32 {
        let name = name.map_or(std::ptr::null(), |n| n.as_ptr());
        // SAFETY: null or a text with its end, alive during the call
        unsafe { (self.init_device)(name) }
    }

    pub(super) fn disable_device(&self, device: u32) {
        // SAFETY: takes a number and checks it
        unsafe { (self.disable_device)(device) }
    }

    pub(super) fn make_current(&self, device: u32) {
        // SAFETY: takes a number and checks it
        unsafe { (self.make_current)(device) }
    }

    pub(super) fn begin_frame(&self, device: u32) {
        // SAFETY: takes a number and checks it
        unsafe { (self.begin_frame)(device) }
    }

    pub(super) fn end_frame(&self, device: u32) {
        // SAFETY: takes a number and checks it
        unsafe { (self.end_frame)(device) }
    }

    /// The oldest error that was not read yet; code 0 = none.
    pub(super) fn error(&self) -> ErrorInfo {
        // SAFETY: no arguments; returns a record of three numbers
        unsafe { (self.get_error)() }
    }

    /// What the library says of an error.
    pub(super) fn error_text(&self, code: u32) -> String {
        // SAFETY: takes a number; the text is checked below
        text(unsafe { (self.error_string)(code) })
    }

    /// Turns forces on, clamped at what the device bears.
    pub(super) fn enable_forces(&self) {
        for capability in [FORCE_OUTPUT, MAX_FORCE_CLAMPING] {
            // SAFETY: takes a number and checks it
            unsafe { (self.enable)(capability) }
        }
    }

    /// Buttons that are pressed, one bit each.
    pub(super) fn buttons(&self) -> i32 {
        self.integer(CURRENT_BUTTONS)
    }

    /// Bits of the calibration style.
    pub(super) fn calibration_style(&self) -> i32 {
        self.integer(CALIBRATION_STYLE)
    }

    fn integer(&self, what: u32) -> i32 {
        let mut value = 0;
        // SAFETY: both parameters that are asked for here are one integer
        unsafe { (self.get_integerv)(what, &raw mut value) };
        value
    }

    /// Whether the stylus is in its inkwell: the switch reads 1 outside of it.
    pub(super) fn in_inkwell(&self) -> bool {
        let mut out = 1;
        // SAFETY: this parameter is one boolean of one byte
        unsafe { (self.get_booleanv)(INKWELL_SWITCH, &raw mut out) };
        out == 0
    }

    /// `base_from_stylus` as a column-major 4 × 4 matrix, mm.
    pub(super) fn transform(&self) -> [f64; 16] {
        let mut values = [0.0; 16];
        // SAFETY: this parameter is sixteen doubles
        unsafe { (self.get_doublev)(CURRENT_TRANSFORM, values.as_mut_ptr()) };
        values
    }

    /// Largest force of the device, N.
    pub(super) fn max_force_n(&self) -> f64 {
        let mut value = 0.0;
        // SAFETY: this parameter is one double
        unsafe { (self.get_doublev)(NOMINAL_MAX_FORCE, &raw mut value) };
        value
    }

    /// Sets the force of this frame, N, base frame.
    pub(super) fn set_force(&self, force_n: [f64; 3]) {
        // SAFETY: this parameter is three doubles
        unsafe { (self.set_doublev)(CURRENT_FORCE, force_n.as_ptr()) }
    }

    pub(super) fn text(&self, what: Text) -> String {
        // SAFETY: takes a number; the text is checked below
        text(unsafe { (self.get_string)(what as u32) })
    }

    pub(super) fn check_calibration(&self) -> u32 {
        // SAFETY: no arguments
        unsafe { (self.check_calibration)() }
    }

    pub(super) fn update_calibration(&self, style: i32) {
        // SAFETY: takes a number and checks it
        unsafe { (self.update_calibration)(style.cast_unsigned()) }
    }

    pub(super) fn start_scheduler(&self) {
        // SAFETY: no arguments
        unsafe { (self.start_scheduler)() }
    }

    pub(super) fn stop_scheduler(&self) {
        // SAFETY: no arguments
        unsafe { (self.stop_scheduler)() }
    }

    /// Has `tick` called with `work` in each period, in the library's thread, until it returns 0 or is
    /// unscheduled. `work` is given away for the rest of the process, as the library promises no moment
    /// from which on it does not call any more.
    pub(super) fn schedule<W: Work>(&self, work: Box<W>) -> c_ulong {
        let data = Box::leak(work);
        // SAFETY: `call` takes what is given here, which lives for ever and is used by this thread alone
        unsafe { (self.schedule)(call::<W>, std::ptr::from_mut(data).cast(), MOST_PRIORITY) }
    }

    pub(super) fn unschedule(&self, handle: c_ulong) {
        // SAFETY: takes a number and checks it
        unsafe { (self.unschedule)(handle) }
    }
}

/// What the scheduler runs.
pub(super) trait Work: Send + 'static {
    /// One period; false = do not call again. Must not panic out of it: it catches by itself.
    fn tick(&mut self) -> bool;
}

extern "C" fn call<W: Work>(data: *mut c_void) -> u32 {
    // SAFETY: [`Hd::schedule`] gave a pointer to a `W` that lives for ever; the scheduler has one thread
    let work = unsafe { &mut *data.cast::<W>() };
    u32::from(work.tick())
}

/// A text of the library; it keeps its texts.
fn text(from: *const c_char) -> String {
    if from.is_null() {
        return String::new();
    }
    // SAFETY: not null, and a text with its end by the library's interface
    let text = unsafe { CStr::from_ptr(from) };
    text.to_string_lossy().into_owned()
}

/// What the mock library shows of its plant, for tests; the real library has none of it.
#[cfg(test)]
pub(crate) mod mock {
    use super::UnixLibrary;

    /// The mock library's file beside this test program.
    pub(crate) fn path() -> String {
        let here = std::env::current_exe().unwrap();
        let file = here.with_file_name("libmock_hd.so");
        assert!(file.exists(), "{}: not built", file.display());
        file.display().to_string()
    }

    fn library() -> UnixLibrary {
        // SAFETY: a library of this workspace without start-up code
        unsafe { UnixLibrary::new(path()).unwrap() }
    }

    /// Reads a place of the plant.
    pub(crate) fn get(at: u32) -> f64 {
        let library = library();
        // SAFETY: the mock's function has this signature
        let get = unsafe {
            library
                .get::<extern "C" fn(u32) -> f64>(b"mockHdGet")
                .unwrap()
        };
        get(at)
    }

    /// Sets a place of the plant.
    pub(crate) fn set(at: u32, value: f64) {
        let library = library();
        // SAFETY: the mock's function has this signature
        let set = unsafe {
            library
                .get::<extern "C" fn(u32, f64)>(b"mockHdSet")
                .unwrap()
        };
        set(at, value);
    }
}
