//! What a real-time thread asks of the system, and the clock it lives by.
//!
//! Each right is granted or refused on its own, and a refusal is said aloud with its remedy: a
//! session on a machine without rights still runs, but nobody is told that it runs in real time.

use rustix::mm::MlockAllFlags;
use rustix::process::{Resource, Signal};
use rustix::thread::{CapabilitySet, ClockId, CpuSet};
use std::fmt;
use std::fs::File;
use std::io::{self, Write as _};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
};

/// `SCHED_FIFO` priority of the servo thread, in 1..=99. Below the kernel's own watchdogs and
/// above its threaded interrupts.
pub const SERVO_PRIORITY: u8 = 80;

const MEMORY_REMEDY: &str = "add '@realtime - memlock unlimited' to /etc/security/limits.d/osteon.conf, \
     join that group and log in again";
const FIFO_REMEDY: &str = "add '@realtime - rtprio 95' to /etc/security/limits.d/osteon.conf, \
     join that group and log in again";
const CORE_REMEDY: &str = "start the program with at least two cores (taskset, cgroup cpuset)";
const LATENCY_REMEDY: &str =
    "install the udev rules ('osteon doctor --udev-rules') and join the group realtime";

/// One thing asked of the system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Right {
    /// What kind of right it is: a word or two.
    pub subject: &'static str,
    /// What was asked for, for people.
    pub name: String,
    /// Why it was refused; `None` = granted.
    pub refused: Option<String>,
    /// What to do about a refusal.
    pub remedy: &'static str,
}

impl Right {
    fn new(
        (subject, name): (&'static str, String),
        outcome: Result<(), String>,
        remedy: &'static str,
    ) -> Self {
        Self {
            subject,
            name,
            refused: outcome.err(),
            remedy,
        }
    }

    /// Whether the system granted it.
    pub fn granted(&self) -> bool {
        self.refused.is_none()
    }
}

impl fmt::Display for Right {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.refused {
            None => write!(f, "{}: granted", self.name),
            Some(why) => write!(f, "{}: REFUSED ({why}); {}", self.name, self.remedy),
        }
    }
}

/// What the system granted to the calling thread. The wake-up latency is held low for as long as
/// this value lives.
#[derive(Debug)]
pub struct RtReport {
    rights: Vec<Right>,
    // The kernel keeps the request while the file is open.
    _latency: Option<File>,
}

impl RtReport {
    /// Asks for everything the servo thread wants; call it in that thread, before its first tick.
    /// `core` is where to pin it ([`servo_core`]).
    pub fn ask(core: Option<usize>) -> Self {
        let (latency_right, latency) = hold_wake_latency();
        Self {
            rights: vec![
                lock_memory(),
                set_fifo(SERVO_PRIORITY),
                pin(core),
                latency_right,
            ],
            _latency: latency,
        }
    }

    /// All that was asked for, in the order it was asked.
    pub fn rights(&self) -> &[Right] {
        &self.rights
    }

    /// Whether nothing was refused.
    pub fn all_granted(&self) -> bool {
        self.rights.iter().all(Right::granted)
    }

    /// One warning for each refusal.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        let refused = self.rights.iter().filter(|right| !right.granted());
        refused.map(|right| format!("not real time: {right}"))
    }
}

impl fmt::Display for RtReport {
    /// One line a right.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, right) in self.rights.iter().enumerate() {
            let line_break = if n == 0 { "" } else { "\n" };
            write!(f, "{line_break}{right}")?;
        }
        Ok(())
    }
}

/// Keeps all memory of the process, present and future, out of swap and faulted in.
pub fn lock_memory() -> Right {
    let name = "locked memory".to_owned();
    Right::new(("locked memory", name), try_lock_memory(), MEMORY_REMEDY)
}

fn try_lock_memory() -> Result<(), String> {
    let limit = rustix::process::getrlimit(Resource::Memlock).current;
    let capabilities = rustix::thread::capabilities(None);
    let exempt = capabilities.is_ok_and(|c| c.effective.contains(CapabilitySet::IPC_LOCK));
    if let (Some(bytes), false) = (limit, exempt) {
        // Under a limit the lock may succeed now and a later allocation abort the process.
        return Err(format!("memlock limit of {} KiB", bytes / 1024));
    }
    let all = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE;
    rustix::mm::mlockall(all).map_err(|e| e.to_string())
}

/// Puts the calling thread under `SCHED_FIFO` at `priority` in 1..=99.
pub fn set_fifo(priority: u8) -> Right {
    let name = format!("SCHED_FIFO priority {priority}");
    Right::new(("scheduler", name), try_set_fifo(priority), FIFO_REMEDY)
}

fn try_set_fifo(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority)?;
    thread_priority::set_thread_priority_and_policy(
        thread_priority::thread_native_id(),
        ThreadPriority::Crossplatform(value),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|error| match error {
        thread_priority::Error::OS(code) => io::Error::from_raw_os_error(code).to_string(),
        other => other.to_string(),
    })
}

/// The core for the servo thread: the last one that the calling thread may use, away from the
/// first, where interrupts tend to go. `None` where there is only one.
pub fn servo_core() -> Option<usize> {
    let allowed = rustix::thread::sched_getaffinity(None).ok()?;
    let last = (0..CpuSet::MAX_CPU).rev().find(|&n| allowed.is_set(n))?;
    (allowed.count() > 1).then_some(last)
}

/// Pins the calling thread to one core; `None` counts as a refusal, for want of a second core.
pub fn pin(core: Option<usize>) -> Right {
    let name = core.map_or("own core".to_owned(), |n| format!("own core ({n})"));
    let outcome = match core {
        None => Err("only one core".to_owned()),
        Some(n) if n >= CpuSet::MAX_CPU => Err("no such core".to_owned()),
        Some(n) => {
            let mut set = CpuSet::new();
            set.set(n);
            rustix::thread::sched_setaffinity(None, &set).map_err(|e| e.to_string())
        }
    };
    Right::new(("own core", name), outcome, CORE_REMEDY)
}

fn hold_wake_latency() -> (Right, Option<File>) {
    let opened = File::options()
        .write(true)
        .open("/dev/cpu_dma_latency")
        .and_then(|mut file| file.write_all(&0_i32.to_ne_bytes()).map(|()| file));
    let (outcome, file) = match opened {
        Ok(file) => (Ok(()), Some(file)),
        Err(error) => (Err(error.to_string()), None),
    };
    let name = "shallow idle states (/dev/cpu_dma_latency)".to_owned();
    let right = Right::new(("wake-up latency", name), outcome, LATENCY_REMEDY);
    (right, file)
}

/// `CLOCK_MONOTONIC`, ns.
pub fn now_ns() -> u64 {
    let now = rustix::time::clock_gettime(ClockId::Monotonic);
    // The monotonic clock starts at boot and is never negative.
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}

/// Sleeps until [`now_ns`] reaches `deadline_ns`; returns at once when it has. A signal does not
/// cut it short.
pub fn sleep_until(deadline_ns: u64) {
    let until = rustix::time::Timespec {
        tv_sec: i64::try_from(deadline_ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(deadline_ns % 1_000_000_000).unwrap_or(0),
    };
    while let Err(rustix::io::Errno::INTR) =
        rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, &until)
    {}
}

/// Asks the kernel to send SIGTERM to this process when its parent ends, so that a killed launcher
/// leaves nothing behind. The kernel means the parent's *thread*: start children from one that
/// lives as long as they do.
pub fn die_with_parent() -> io::Result<()> {
    rustix::process::set_parent_process_death_signal(Some(Signal::TERM))?;
    Ok(())
}

/// Steps back (nice +10): for the calling thread and those it starts later. For everything that
/// must not compete with the servo thread.
pub fn lower_priority() -> io::Result<()> {
    rustix::process::setpriority_process(None, 10)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    // Each test changes only its own thread (the test runner gives it one).

    fn stat_field(field: usize) -> i64 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        // Fields are counted from 1 and the second may hold spaces: count from its bracket.
        let (_, rest) = stat.rsplit_once(") ").unwrap();
        let value = rest.split(' ').nth(field - 3).unwrap();
        value.parse().unwrap()
    }

    #[test]
    fn the_kernel_confirms_what_fifo_reports() {
        let right = set_fifo(SERVO_PRIORITY);
        // proc(5): field 40 = rt_priority, 41 = policy, 1 = SCHED_FIFO.
        let kernel = (stat_field(40), stat_field(41));
        assert_eq!(right.granted(), kernel == (80, 1), "{right}, {kernel:?}");
        let above = set_fifo(100);
        assert!(!above.granted(), "priority 100 does not exist: {above}");
    }

    #[test]
    fn the_kernel_confirms_the_pinned_core() {
        let Some(core) = servo_core() else {
            assert!(!pin(None).granted());
            return;
        };
        assert!(pin(Some(core)).granted());
        let allowed = rustix::thread::sched_getaffinity(None).unwrap();
        assert_eq!(allowed.count(), 1);
        assert!(allowed.is_set(core));
        assert_eq!(servo_core(), None, "one core is left to this thread");
        assert!(!pin(Some(usize::MAX)).granted());
    }

    #[test]
    fn the_kernel_confirms_the_lower_priority() {
        lower_priority().unwrap();
        // proc(5): field 19 = nice.
        assert_eq!(stat_field(19), 10);
    }

    #[test]
    fn the_kernel_confirms_locked_memory() {
        let right = lock_memory();
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find(|l| l.starts_with("VmLck:")).unwrap();
        let locked: u64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
        assert_eq!(right.granted(), locked > 0, "{right}, {line}");
        rustix::mm::munlockall().unwrap();
    }

    #[test]
    fn the_kernel_confirms_the_parents_death_signal() {
        die_with_parent().unwrap();
        let signal = rustix::process::parent_process_death_signal().unwrap();
        assert_eq!(signal, Some(Signal::TERM));
    }

    #[test]
    fn a_sleep_ends_at_its_deadline_and_not_before() {
        let began = Instant::now();
        let deadline = now_ns() + 3_000_000;
        sleep_until(deadline);
        assert!(now_ns() >= deadline);
        assert!(began.elapsed() >= Duration::from_millis(3));
        let before = now_ns();
        sleep_until(before - 1);
        sleep_until(0);
        assert!(now_ns() - before < 1_000_000_000, "a past deadline waits");
    }

    #[test]
    fn a_refusal_names_its_reason_and_its_remedy() {
        let report = RtReport {
            rights: vec![
                Right::new(("a", "one".into()), Ok(()), ""),
                Right::new(("b", "two".into()), Err("no".into()), "do this"),
            ],
            _latency: None,
        };
        assert!(!report.all_granted());
        assert_eq!(
            report.to_string(),
            "one: granted\ntwo: REFUSED (no); do this"
        );
        let warnings: Vec<_> = report.warnings().collect();
        assert_eq!(warnings, ["not real time: two: REFUSED (no); do this"]);
    }
}
