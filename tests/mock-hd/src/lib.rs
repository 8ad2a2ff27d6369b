//! A stand-in for the vendor's libHD: the functions that Osteon uses, over a simulated point mass.
//!
//! Loaded at run time in the place of the real one (`OSTEON_LIBHD=…/libmock_hd.so`), so that the way through
//! the vendor's library runs where there is none. Numbers and signatures are those of the published HDAPI;
//! nothing of the vendor's code is here, and nothing is proven about a real device.
//!
//! The device: 0.1 kg with 4 N·s/m at the gimbal's centre, a turning stylus, its scheduler a thread of 1 kHz.
//! It is in its inkwell and wants one update of its calibration. [`mockHdGet`] and [`mockHdSet`] let a test
//! look at the plant and plant a fault.
#![expect(unsafe_code, reason = "a library with a C interface")]
#![expect(
    clippy::struct_excessive_bools,
    reason = "independent facts of the interface"
)]
#![expect(
    missing_docs,
    reason = "the interface is the vendor's, and documented there"
)]
#![expect(
    clippy::missing_safety_doc,
    reason = "the interface's contracts are the vendor's"
)]

use std::ffi::{c_char, c_ulong, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const INVALID: u32 = 0xFFFF_FFFF;
const MASS_KG: f64 = 0.1;
const DAMPING: f64 = 4.0;
const STEP_S: f64 = 1e-4;

/// `HDErrorInfo`.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub struct ErrorInfo {
    code: u32,
    internal: i32,
    device: u32,
}

/// `HDSchedulerCallback`.
pub type Callback = extern "C" fn(*mut c_void) -> u32;

/// Places of [`mockHdGet`] and [`mockHdSet`].
pub mod place {
    /// Force in force now, N: x, y, z at 0, 1, 2.
    pub const FORCE: u32 = 0;
    /// 1 = in the inkwell.
    pub const INKWELL: u32 = 3;
    /// What `hdCheckCalibration` gives.
    pub const CALIBRATION: u32 = 4;
    /// Error code to raise once.
    pub const ERROR: u32 = 5;
    /// Pressed buttons.
    pub const BUTTONS: u32 = 6;
    /// Position, mm: x, y, z at 7, 8, 9.
    pub const POSITION: u32 = 7;
    /// Devices that are in use.
    pub const DEVICES: u32 = 10;
}

#[derive(Clone, Copy)]
struct Task {
    call: Callback,
    // the caller's data, as a number: only handed back
    data: usize,
    handle: c_ulong,
}

struct Device {
    position_mm: [f64; 3],
    velocity_mm_s: [f64; 3],
    wanted_n: [f64; 3],
    force_n: [f64; 3],
    forces_on: bool,
    in_frame: bool,
    used: bool,
    inkwell: bool,
    calibration: u32,
    error: u32,
    buttons: i32,
    turn: f64,
    task: Option<Task>,
    handles: c_ulong,
}

static DEVICE: Mutex<Device> = Mutex::new(Device {
    position_mm: [0.0, -60.0, -80.0],
    velocity_mm_s: [0.0; 3],
    wanted_n: [0.0; 3],
    force_n: [0.0; 3],
    forces_on: false,
    in_frame: false,
    used: false,
    inkwell: true,
    calibration: 0x5001,
    error: 0,
    buttons: 0,
    turn: 0.0,
    task: None,
    handles: 0,
});
static RUNS: AtomicBool = AtomicBool::new(false);
static SCHEDULER: Mutex<Option<JoinHandle<()>>> = Mutex::new(None);

fn device() -> MutexGuard<'static, Device> {
    DEVICE.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Device {
    /// One period of the plant; a force counts from the end of its frame on.
    fn period(&mut self) {
        let off = !self.used || !self.forces_on;
        self.force_n = if off { [0.0; 3] } else { self.wanted_n };
        for _ in 0..10 {
            for n in 0..3 {
                let drag = DAMPING * self.velocity_mm_s[n] * 1e-3;
                let push = if self.inkwell {
                    0.0
                } else {
                    self.force_n[n] - drag
                };
                self.velocity_mm_s[n] += push / MASS_KG * STEP_S * 1e3;
                self.position_mm[n] += self.velocity_mm_s[n] * STEP_S;
            }
        }
        self.turn += 0.001;
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdInitDevice(_name: *const c_char) -> u32 {
    let mut d = device();
    if d.used {
        d.error = 0x301;
        return INVALID;
    }
    d.used = true;
    d.forces_on = false;
    1
}

#[unsafe(no_mangle)]
pub extern "C" fn hdDisableDevice(_device: u32) {
    let mut d = device();
    d.used = false;
    d.forces_on = false;
    d.wanted_n = [0.0; 3];
    d.force_n = [0.0; 3];
}

#[unsafe(no_mangle)]
pub extern "C" fn hdMakeCurrentDevice(_device: u32) {}

#[unsafe(no_mangle)]
pub extern "C" fn hdBeginFrame(_device: u32) {
    device().in_frame = true;
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEndFrame(_device: u32) {
    device().in_frame = false;
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetError() -> ErrorInfo {
    let code = std::mem::take(&mut device().error);
    ErrorInfo {
        code,
        internal: 0,
        device: 1,
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetErrorString(_code: u32) -> *const c_char {
    c"an error of the mock library".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn hdEnable(capability: u32) {
    let mut d = device();
    match capability {
        0x4000 => d.forces_on = true,
        0x4001..=0x4004 => {}
        _ => d.error = 0x100,
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetBooleanv(what: u32, into: *mut u8) {
    let mut d = device();
    if what == 0x2002 {
        // SAFETY: the caller gives room for one boolean
        unsafe { into.write(u8::from(!d.inkwell)) }
    } else {
        d.error = 0x100;
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetIntegerv(what: u32, into: *mut i32) {
    let mut d = device();
    let value = match what {
        0x2000 => d.buttons,
        0x2555 => 4,
        _ => {
            d.error = 0x100;
            return;
        }
    };
    // SAFETY: the caller gives room for one integer
    unsafe { into.write(value) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdGetDoublev(what: u32, into: *mut f64) {
    let mut d = device();
    match what {
        0x2603 => {
            // SAFETY: the caller gives room for one double
            unsafe { into.write(3.3) }
        }
        0x2052 => {
            if !d.in_frame {
                d.error = 0x402;
            }
            let (s, c) = d.turn.sin_cos();
            let [x, y, z] = d.position_mm;
            // a turn about y, column by column
            let matrix = [
                c, 0.0, -s, 0.0, 0.0, 1.0, 0.0, 0.0, s, 0.0, c, 0.0, x, y, z, 1.0,
            ];
            // SAFETY: the caller gives room for sixteen doubles
            unsafe { into.cast::<[f64; 16]>().write(matrix) }
        }
        _ => d.error = 0x100,
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdGetString(what: u32) -> *const c_char {
    match what {
        0x2501 => c"Mock Touch".as_ptr(),
        0x2502 => c"0.mock".as_ptr(),
        0x2504 => c"0000".as_ptr(),
        _ => std::ptr::null(),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hdSetDoublev(what: u32, from: *const f64) {
    let mut d = device();
    if what != 0x2700 || !d.in_frame {
        d.error = if what == 0x2700 { 0x402 } else { 0x100 };
        return;
    }
    // SAFETY: the caller gives three doubles
    d.wanted_n = unsafe { from.cast::<[f64; 3]>().read() };
}

#[unsafe(no_mangle)]
pub extern "C" fn hdCheckCalibration() -> u32 {
    device().calibration
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUpdateCalibration(style: u32) {
    let mut d = device();
    if style == 4 && d.inkwell {
        d.calibration = 0x5000;
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdScheduleAsynchronous(
    call: Callback,
    data: *mut c_void,
    _priority: u16,
) -> c_ulong {
    let mut d = device();
    d.handles += 1;
    let handle = d.handles;
    d.task = Some(Task {
        call,
        data: data as usize,
        handle,
    });
    handle
}

#[unsafe(no_mangle)]
pub extern "C" fn hdUnschedule(handle: c_ulong) {
    let mut d = device();
    if d.task.is_some_and(|t| t.handle == handle) {
        d.task = None;
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn hdStartScheduler() {
    if RUNS.swap(true, Ordering::SeqCst) {
        return;
    }
    let thread = std::thread::Builder::new()
        .name("mock-hd".to_owned())
        .spawn(|| {
            let mut next = Instant::now();
            while RUNS.load(Ordering::SeqCst) {
                next = (next + Duration::from_millis(1)).max(Instant::now());
                std::thread::sleep(next.saturating_duration_since(Instant::now()));
                // the lock is not held during the call, which comes back in here
                let task = device().task;
                if let Some(task) = task
                    && (task.call)(task.data as *mut c_void) == 0
                {
                    hdUnschedule(task.handle);
                }
                device().period();
            }
        });
    *SCHEDULER.lock().unwrap_or_else(PoisonError::into_inner) = thread.ok();
}

#[unsafe(no_mangle)]
pub extern "C" fn hdStopScheduler() {
    RUNS.store(false, Ordering::SeqCst);
    let thread = SCHEDULER
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .take();
    if let Some(thread) = thread {
        thread.join().unwrap_or(());
    }
}

/// Looks at the plant; see [`place`].
#[unsafe(no_mangle)]
pub extern "C" fn mockHdGet(at: u32) -> f64 {
    let d = device();
    match at {
        0..=2 => d.force_n[at as usize],
        place::INKWELL => f64::from(u8::from(d.inkwell)),
        place::CALIBRATION => f64::from(d.calibration),
        place::BUTTONS => f64::from(d.buttons),
        7..=9 => d.position_mm[at as usize - 7],
        place::DEVICES => f64::from(u8::from(d.used)),
        _ => f64::NAN,
    }
}

/// Plants a fault or moves the hand; see [`place`].
#[unsafe(no_mangle)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "small whole numbers of a test"
)]
pub extern "C" fn mockHdSet(at: u32, value: f64) {
    let mut d = device();
    match at {
        place::INKWELL => d.inkwell = value != 0.0,
        place::CALIBRATION => d.calibration = value as u32,
        place::ERROR => d.error = value as u32,
        place::BUTTONS => d.buttons = value as i32,
        7..=9 => d.position_mm[at as usize - 7] = value,
        _ => {}
    }
}
