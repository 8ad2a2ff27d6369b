//! `osteon doctor`: what this machine can do, one line a fact, with the remedy where it falls short.

use crate::haptics::socket::{private_dir, runtime_dir};
use crate::launcher::Screen;
use crate::link::{hid_found, vendor_library};
use crate::rt::{self, RtReport};
use rustix::fs::Access;
use serde::Serialize;
use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// The rule file; what is plugged in is added to it.
const RULES: &str = include_str!("../udev/70-osteon.rules");
/// Where udev looks for rules.
const RULE_FOLDERS: [&str; 3] = [
    "/etc/udev/rules.d",
    "/run/udev/rules.d",
    "/usr/lib/udev/rules.d",
];
const RULES_REMEDY: &str = "osteon doctor --udev-rules | sudo tee /etc/udev/rules.d/70-osteon.rules, then sudo udevadm \
     control --reload; sudo udevadm trigger";
/// From this usage page on a HID device's reports are its maker's own.
const MAKERS_PAGE: u16 = 0xFF00;

/// Options of the doctor.
#[derive(Debug, Clone, clap::Args)]
pub struct DoctorArgs {
    /// Write the findings as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Print the udev rules for this machine, and nothing else
    #[arg(long)]
    pub udev_rules: bool,
}

/// One finding.
#[derive(Debug, Clone, Serialize)]
struct Finding {
    subject: &'static str,
    good: bool,
    detail: String,
    /// What to do about it, where it is not good.
    remedy: Option<String>,
}

impl Finding {
    fn good(subject: &'static str, detail: impl Into<String>) -> Self {
        Self {
            subject,
            good: true,
            detail: detail.into(),
            remedy: None,
        }
    }

    fn short(subject: &'static str, detail: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            subject,
            good: false,
            detail: detail.into(),
            remedy: Some(remedy.into()),
        }
    }
}

/// Looks and says. A machine that falls short is no error: the exit code is 0.
pub fn run(args: &DoctorArgs, screen: impl FnOnce() -> Screen) -> anyhow::Result<()> {
    if args.udev_rules {
        say(&rules());
        return Ok(());
    }
    // the screen first: what asks for real-time rights must not pin the graphics threads
    let mut findings = screen_findings(&screen());
    findings.extend(realtime_findings());
    findings.push(kernel());
    findings.push(throttle());
    findings.push(governor());
    findings.extend(ports());
    findings.extend(reports());
    findings.push(udev());
    findings.push(library());
    findings.push(sockets());
    for f in &findings {
        let mark = if f.good { "ok  " } else { "NOTE" };
        let remedy = f.remedy.as_ref().map(|r| format!("; {r}"));
        say(&format!(
            "{mark} {:<16} {}{}",
            f.subject,
            f.detail,
            remedy.unwrap_or_default()
        ));
    }
    if let Some(path) = &args.json {
        std::fs::write(path, serde_json::to_vec_pretty(&findings)?)
            .map_err(|e| anyhow::anyhow!("{}: cannot write ({e})", path.display()))?;
    }
    Ok(())
}

fn screen_findings(screen: &Screen) -> Vec<Finding> {
    let window = match &screen.no_window {
        None => Finding::good("display", "a display answers"),
        Some(why) => Finding::short(
            "display",
            why.clone(),
            "start it in a desktop session (DISPLAY or WAYLAND_DISPLAY), or use --headless",
        ),
    };
    let graphics = match &screen.adapter {
        Some(adapter) => Finding::good("graphics", adapter.clone()),
        None => Finding::short(
            "graphics",
            "no adapter",
            "install a driver (Debian/Ubuntu: apt install mesa-vulkan-drivers)",
        ),
    };
    vec![window, graphics]
}

/// Asks for the servo's rights in a thread of its own, which then ends.
fn realtime_findings() -> Vec<Finding> {
    let asked = std::thread::Builder::new()
        .name("doctor".to_owned())
        .spawn(|| RtReport::ask(rt::servo_core()).rights().to_vec());
    let rights = asked.ok().and_then(|t| t.join().ok()).unwrap_or_default();
    rights
        .iter()
        .map(|right| match &right.refused {
            None => Finding::good(right.subject, format!("{}: granted", right.name)),
            Some(why) => Finding::short(
                right.subject,
                format!("{}: REFUSED ({why})", right.name),
                right.remedy,
            ),
        })
        .collect()
}

/// Whether the kernel can be interrupted everywhere.
fn kernel() -> Finding {
    let uname = rustix::system::uname();
    let (release, version) = (
        uname.release().to_string_lossy().into_owned(),
        uname.version().to_string_lossy().into_owned(),
    );
    let preempt = version
        .split_whitespace()
        .find(|w| w.starts_with("PREEMPT"));
    let detail = format!("{release}, {}", preempt.unwrap_or("no preemption named"));
    if preempt == Some("PREEMPT_RT") {
        Finding::good("kernel", detail)
    } else {
        Finding::short(
            "kernel",
            detail,
            "for bounded delays a PREEMPT_RT kernel (Debian: apt install linux-image-rt-amd64); 'osteon report \
             latency' measures this one",
        )
    }
}

/// Real-time threads may be stopped for a share of each second.
fn throttle() -> Finding {
    let number = |name: &str| -> Option<i64> {
        let text = read_to_string(format!("/proc/sys/kernel/{name}")).ok()?;
        text.trim().parse().ok()
    };
    let subject = "rt throttling";
    match (number("sched_rt_runtime_us"), number("sched_rt_period_us")) {
        (Some(-1), _) => Finding::short(
            subject,
            "off: a real-time thread that never ends can take a core for ever",
            "sudo sysctl kernel.sched_rt_runtime_us=950000",
        ),
        (Some(runtime), Some(period)) if runtime * 10 >= period * 5 => Finding::good(
            subject,
            format!("real-time threads may use {runtime} of {period} µs"),
        ),
        (Some(runtime), Some(period)) => Finding::short(
            subject,
            format!("real-time threads may use {runtime} of {period} µs only"),
            "sudo sysctl kernel.sched_rt_runtime_us=950000",
        ),
        _ => Finding::good(subject, "this system does not say"),
    }
}

/// Clock rates that follow the load make the first ticks after a pause late.
fn governor() -> Finding {
    let path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
    match read_to_string(path).map(|g| g.trim().to_owned()) {
        Ok(governor) if governor != "performance" => Finding::short(
            "cpu governor",
            governor,
            "sudo cpupower frequency-set -g performance",
        ),
        Ok(governor) => Finding::good("cpu governor", governor),
        Err(_) => Finding::good("cpu governor", "none: the clock rate is not the system's"),
    }
}

fn may_use(node: &str) -> bool {
    rustix::fs::access(node, Access::READ_OK | Access::WRITE_OK).is_ok()
}

/// A line for each serial port: whether it may be opened, and how long its adapter gathers bytes.
fn ports() -> Vec<Finding> {
    let ports = serialport::available_ports().unwrap_or_default();
    let fake = crate::fake::run::default_link();
    let mut names: Vec<String> = ports.into_iter().map(|p| p.port_name).collect();
    names.extend(fake.exists().then(|| fake.display().to_string()));
    if names.is_empty() {
        return vec![Finding::short(
            "serial ports",
            "none",
            "plug a controller in; 'osteon fake-omni' makes a simulated one",
        )];
    }
    names.iter().map(|name| serial(name)).collect()
}

fn serial(name: &str) -> Finding {
    let subject = "serial port";
    if !may_use(name) {
        let group = crate::link::group_of(name);
        return Finding::short(
            subject,
            format!("{name}: no permission"),
            format!("sudo usermod -aG {group} $USER, then log in again"),
        );
    }
    let file = Path::new(name).file_name().unwrap_or_default();
    let timer = Path::new("/sys/bus/usb-serial/devices")
        .join(file)
        .join("latency_timer");
    let gathers = read_to_string(timer)
        .ok()
        .and_then(|t| t.trim().parse::<u32>().ok());
    match gathers {
        Some(ms) if ms > 1 => Finding::short(
            subject,
            format!("{name}: its adapter gathers bytes for {ms} ms"),
            RULES_REMEDY,
        ),
        _ => Finding::good(subject, format!("{name}: may be opened")),
    }
}

/// A line for each HID device whose reports are its maker's own.
fn reports() -> Vec<Finding> {
    let own = hid_found()
        .into_iter()
        .filter(|d| d.usage_page >= MAKERS_PAGE);
    own.map(|device| {
        let (vendor, product) = device.ids;
        let name = format!(
            "{vendor:04x}:{product:04x} {} ({})",
            device.name, device.node
        );
        if device.may_open {
            Finding::good("hid device", format!("{name}: may be opened"))
        } else {
            Finding::short("hid device", format!("{name}: no permission"), RULES_REMEDY)
        }
    })
    .collect()
}

/// Whether the rules are installed, and as this release has them.
fn udev() -> Finding {
    let subject = "udev rules";
    let installed = RULE_FOLDERS
        .iter()
        .map(|folder| Path::new(folder).join("70-osteon.rules"))
        .find(|path| path.exists());
    let Some(path) = installed else {
        return Finding::short(subject, "not installed", RULES_REMEDY);
    };
    let known = read_to_string(&path).unwrap_or_default();
    let is_known = |line: &str| known.lines().any(|l| l == line);
    let name = path.display();
    if rules().lines().all(is_known) {
        Finding::good(subject, name.to_string())
    } else {
        let detail = format!("{name}: not those of this release and these devices");
        Finding::short(subject, detail, RULES_REMEDY)
    }
}

/// The rules with a line for each HID device that is plugged in and not covered by them.
fn rules() -> String {
    let mut text = RULES.trim_end().to_owned();
    for device in hid_found().iter().filter(|d| d.usage_page >= MAKERS_PAGE) {
        let (vendor, product) = device.ids;
        let vendor = format!("ATTRS{{idVendor}}==\"{vendor:04x}\"");
        if !text.contains(&vendor) {
            let name = device.name.replace(char::is_control, " ");
            let rule = format!(
                "SUBSYSTEM==\"hidraw\", {vendor}, ATTRS{{idProduct}}==\"{product:04x}\", MODE=\"0660\", \
                 TAG+=\"uaccess\""
            );
            text = [text.as_str(), "", &format!("# {name}"), &rule].join("\n");
        }
    }
    text
}

fn library() -> Finding {
    match vendor_library() {
        Ok(path) => Finding::good("vendor library", path),
        Err(why) => Finding::short(
            "vendor library",
            why,
            "only a stock Omni or Touch needs it: install OpenHaptics and the device's driver from 3D Systems",
        ),
    }
}

fn sockets() -> Finding {
    let dir = runtime_dir();
    match private_dir(&dir) {
        Ok(()) => Finding::good("viewer socket", dir.display().to_string()),
        Err(e) => Finding::short(
            "viewer socket",
            format!("{e:#}"),
            "set XDG_RUNTIME_DIR to a folder of your own",
        ),
    }
}

#[expect(clippy::print_stdout, reason = "the findings are the program's output")]
fn say(text: &str) {
    println!("{text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_falls_short_has_a_remedy() {
        let screen = Screen {
            no_window: Some("no display".to_owned()),
            adapter: None,
        };
        let mut all = screen_findings(&screen);
        all.extend(realtime_findings());
        all.extend(ports());
        all.extend(reports());
        all.push(udev());
        all.extend([kernel(), throttle(), governor(), library(), sockets()]);
        for finding in &all {
            assert_eq!(finding.good, finding.remedy.is_none(), "{finding:?}");
            assert!(!finding.detail.contains('\n'), "{finding:?}");
        }
        let subjects = ["scheduler", "locked memory", "own core", "wake-up latency"];
        for subject in subjects {
            assert!(all.iter().any(|f| f.subject == subject), "{subject}");
        }
        assert_eq!(all.iter().filter(|f| !f.good).take(2).count(), 2);
    }

    #[test]
    fn every_line_of_the_rules_is_a_rule_or_a_comment() {
        for line in RULES
            .lines()
            .filter(|l| !l.is_empty() && !l.starts_with('#'))
        {
            for part in line.split(", ") {
                let operators = ["==\"", "+=\"", "=\""];
                assert!(
                    operators.iter().any(|o| part.contains(o)) && part.ends_with('"'),
                    "{part}"
                );
            }
        }
        assert!(rules().starts_with(RULES.trim_end()));
    }
}
