//! `osteon doctor`: what this machine can do, one line a fact, with the remedy where it falls short.

use crate::haptics::socket::{private_dir, runtime_dir};
use crate::launcher::Screen;
use crate::rt::{self, RtReport};
use serde::Serialize;
use std::path::PathBuf;

/// Options of the doctor.
#[derive(Debug, Clone, clap::Args)]
pub struct DoctorArgs {
    /// Write the findings as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// One finding.
#[derive(Debug, Clone, Serialize)]
struct Finding {
    subject: &'static str,
    good: bool,
    detail: String,
}

/// Looks and says. A machine that falls short is no error: the exit code is 0.
pub fn run(args: &DoctorArgs, screen: impl FnOnce() -> Screen) -> anyhow::Result<()> {
    // the screen first: what asks for real-time rights must not pin the graphics threads
    let mut findings = screen_findings(&screen());
    findings.extend(realtime_findings());
    findings.push(ports());
    findings.push(sockets());
    for f in &findings {
        say(&format!(
            "{} {:<16} {}",
            if f.good { "ok  " } else { "NOTE" },
            f.subject,
            f.detail
        ));
    }
    if let Some(path) = &args.json {
        std::fs::write(path, serde_json::to_vec_pretty(&findings)?)
            .map_err(|e| anyhow::anyhow!("{}: cannot write ({e})", path.display()))?;
    }
    Ok(())
}

fn screen_findings(screen: &Screen) -> Vec<Finding> {
    vec![
        Finding {
            subject: "window",
            good: screen.no_window.is_none(),
            detail: screen
                .no_window
                .clone()
                .unwrap_or_else(|| "a display answers".to_owned()),
        },
        Finding {
            subject: "graphics",
            good: screen.adapter.is_some(),
            detail: screen.adapter.clone().unwrap_or_else(|| {
                "no adapter; install a driver (Debian/Ubuntu: apt install mesa-vulkan-drivers)"
                    .to_owned()
            }),
        },
    ]
}

/// Asks for the servo's rights in a thread of its own, which then ends.
fn realtime_findings() -> Vec<Finding> {
    let asked = std::thread::Builder::new()
        .name("doctor".to_owned())
        .spawn(|| RtReport::ask(rt::servo_core()).rights().to_vec());
    let rights = asked.ok().and_then(|t| t.join().ok()).unwrap_or_default();
    rights
        .iter()
        .map(|right| Finding {
            subject: "real time",
            good: right.granted(),
            detail: right.to_string(),
        })
        .collect()
}

fn ports() -> Finding {
    let ports = serialport::available_ports().unwrap_or_default();
    let names: Vec<String> = ports.into_iter().map(|p| p.port_name).collect();
    Finding {
        subject: "serial ports",
        good: !names.is_empty(),
        detail: if names.is_empty() {
            "none; 'osteon fake-omni' makes a simulated one".to_owned()
        } else {
            names.join(", ")
        },
    }
}

fn sockets() -> Finding {
    let dir = runtime_dir();
    let private = private_dir(&dir);
    Finding {
        subject: "viewer socket",
        good: private.is_ok(),
        detail: match private {
            Ok(()) => dir.display().to_string(),
            Err(e) => format!("{e:#}"),
        },
    }
}

#[expect(clippy::print_stdout, reason = "the findings are the program's output")]
fn say(text: &str) {
    println!("{text}");
}
