//! Manners of a process that shares its machine with a real-time loop.

/// Name of the variable that bounds lavapipe's raster threads.
const RASTER_THREADS: &str = "LP_NUM_THREADS";
/// Name of the variable with the user's runtime directory.
const RUNTIME_DIR: &str = "XDG_RUNTIME_DIR";

/// Has the system end this process when the one that started it ends (Linux; elsewhere nothing).
pub(crate) fn die_with_parent() {
    #[cfg(target_os = "linux")]
    {
        let signal = rustix::process::Signal::TERM;
        if let Err(e) = rustix::process::set_parent_process_death_signal(Some(signal)) {
            crate::say(&format!(
                "cannot follow the launcher's end ({e}); close this viewer by hand"
            ));
        }
        // the parent may have ended before the request: then init is the parent
        if rustix::process::getppid().is_none_or(|p| p.as_raw_nonzero().get() == 1) {
            crate::say("the launcher has ended; so does this viewer");
            std::process::exit(0);
        }
    }
}

/// Starts this program again with the environment that graphics libraries want, where it is not
/// set: one raster thread (lavapipe reads the number once, and would else take all cores from the
/// servo loop), and a runtime directory (libwayland complains aloud where there is none). Returns
/// only where nothing is missing, or where the start fails.
pub(crate) fn prepare_environment() {
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::process::CommandExt as _;
        let unset = |name: &str| std::env::var_os(name).is_none_or(|v| v.is_empty());
        if !unset(RASTER_THREADS) && !unset(RUNTIME_DIR) {
            return;
        }
        let failure = match std::env::current_exe() {
            Ok(program) => {
                let mut again = std::process::Command::new(program);
                again.args(std::env::args_os().skip(1));
                if unset(RASTER_THREADS) {
                    again.env(RASTER_THREADS, "1");
                }
                if unset(RUNTIME_DIR) {
                    let own = format!("osteon-{}", user());
                    again.env(RUNTIME_DIR, std::env::temp_dir().join(own));
                }
                again.exec()
            }
            Err(e) => e,
        };
        crate::say(&format!(
            "cannot bound the raster threads ({failure}); set {RASTER_THREADS}=1 where no graphics card is used"
        ));
    }
}

/// Number of the user, for paths of one's own; 0 where the system has none.
pub(crate) fn user() -> u32 {
    #[cfg(unix)]
    {
        rustix::process::geteuid().as_raw()
    }
    #[cfg(not(unix))]
    {
        0
    }
}

/// Lowers this process's priority, so that a software renderer never displaces the servo loop.
/// Returns what was done, for people.
pub(crate) fn lower_priority() -> String {
    #[cfg(unix)]
    {
        match rustix::process::nice(10) {
            Ok(level) => format!("nice {level}"),
            Err(e) => format!("normal priority ({e})"),
        }
    }
    #[cfg(not(unix))]
    {
        "normal priority".to_owned()
    }
}

/// Keeps this thread, and all that it starts, off core `core`; by default off the last allowed
/// one, where the servo loop goes. Does nothing where only one core is allowed. Returns the core
/// that is left free.
pub(crate) fn avoid_core(core: Option<usize>) -> Option<usize> {
    #[cfg(target_os = "linux")]
    {
        use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
        let mut allowed = sched_getaffinity(None).ok()?;
        let last = (0..CpuSet::MAX_CPU).rev().find(|&c| allowed.is_set(c))?;
        let core = core.unwrap_or(last);
        if core >= CpuSet::MAX_CPU || !allowed.is_set(core) || allowed.count() < 2 {
            return None;
        }
        allowed.unset(core);
        sched_setaffinity(None, &allowed).ok()?;
        Some(core)
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = core;
        None
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use rustix::thread::sched_getaffinity;

    #[test]
    fn a_thread_leaves_the_core_that_it_was_told_to_leave() {
        let child = std::thread::Builder::new().spawn(|| {
            let before = sched_getaffinity(None).unwrap();
            let left = avoid_core(None);
            let after = sched_getaffinity(None).unwrap();
            (
                before.count(),
                left.map(|c| (before.is_set(c), after.is_set(c))),
                after.count(),
            )
        });
        let (before, core, after) = child.unwrap().join().unwrap();
        if before < 2 {
            assert_eq!((core, after), (None, before));
        } else {
            assert_eq!((core, after), (Some((true, false)), before - 1));
        }
    }

    #[test]
    fn a_core_that_does_not_exist_is_no_harm() {
        assert_eq!(avoid_core(Some(usize::MAX)), None);
    }
}
