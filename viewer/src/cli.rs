//! Arguments of `osteon view`.

use crate::link::{Joining, Place, Remote};
use crate::render::method::Kind;
use osteon_protocol::ipc::Role;
use std::path::{Path, PathBuf};

/// Shows a session of the haptics process, in a window or in a picture.
#[derive(Debug, Clone, clap::Args)]
pub struct ViewArgs {
    /// Socket of the haptics process.
    #[arg(long, value_name = "PATH", default_value_os_t = default_socket())]
    pub socket: PathBuf,
    /// Show a session of another machine, started there with --listen (encrypted; 'osteon key' makes the keys)
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "socket")]
    pub connect: Option<String>,
    /// Whose machine that is: a name from 'osteon key trust' [default: the only one there is]
    #[arg(long, value_name = "NAME", requires = "connect")]
    pub peer: Option<String>,
    /// Folder of the keys [default: osteon in the user's configuration folder]
    #[arg(long, value_name = "DIR", requires = "connect")]
    pub keys: Option<PathBuf>,
    /// The other machine, with keys: filled in by the program from the three above.
    #[arg(skip)]
    pub remote: Option<Remote>,
    /// Who sits before this viewer: trainee (works with the stylus), trainer (may take control from a
    /// trainee), projector (shows, never in control).
    #[arg(long, value_name = "ROLE", default_value = "trainee", value_parser = parse_role)]
    pub role: Role,
    /// Open no window; write the last state of the session to this PNG.
    #[arg(long, value_name = "OUT.png")]
    pub offscreen: Option<PathBuf>,
    /// Open no window and draw nothing: keep a copy of the bone and compare it (needs no adapter).
    #[arg(long, conflicts_with = "offscreen")]
    pub mirror_only: bool,
    /// Size of the window or picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Resolution of the 3-D view as a share of the window's, 0.1 to 2 [default: 1, or 0.5 where
    /// the CPU draws].
    #[arg(long, value_name = "F", value_parser = parse_scale)]
    pub scale: Option<f64>,
    /// How the bone is drawn; key V changes it [default: as the last time, at first iso].
    #[arg(long, value_enum)]
    pub renderer: Option<Kind>,
    /// End after this many seconds.
    #[arg(long, value_name = "N", value_parser = parse_seconds)]
    pub seconds: Option<f64>,
    /// Core to stay off [default: the last one, where the servo loop runs].
    #[arg(long, value_name = "N")]
    pub avoid_core: Option<usize>,
    /// Write adapter, frame times and counters to this file at the end.
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    /// End when the process that started this one ends.
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
    /// Save a picture of the whole window (also: the variable `OSTEON_SCREENSHOT`).
    #[arg(long, hide = true, value_name = "OUT.png")]
    pub window_screenshot: Option<PathBuf>,
    /// When to save it, seconds after the bone is complete.
    #[arg(long, hide = true, value_name = "S", default_value_t = 5.0, value_parser = parse_seconds)]
    pub screenshot_after: f64,
}

impl ViewArgs {
    /// Where the haptics process is.
    pub(crate) fn place(&self) -> Place {
        match &self.remote {
            Some(remote) => Place::Net(remote.clone()),
            None => Place::Socket(self.socket.clone()),
        }
    }

    /// As what a viewer without a window joins: nobody sits before it.
    pub(crate) fn joining_unattended(&self, name: &str) -> Joining {
        Joining {
            name: name.to_owned(),
            role: self.role,
            control: false,
            pose_hz: 30,
        }
    }
}

fn parse_role(text: &str) -> Result<Role, String> {
    let all = [Role::Trainee, Role::Trainer, Role::Projector];
    let role = all.into_iter().find(|r| r.name() == text);
    role.ok_or_else(|| "a role is trainee, trainer or projector".to_owned())
}

fn default_socket() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR");
    osteon_protocol::ipc::default_socket(
        runtime.as_deref().map(Path::new),
        &std::env::temp_dir(),
        crate::system::user(),
    )
}

/// Longest edge of a window or picture, pixels.
const MOST_PIXELS: u32 = 8192;

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let edge = |s: &str| {
        s.parse::<u32>()
            .ok()
            .filter(|n| (16..=MOST_PIXELS).contains(n))
    };
    text.split_once('x')
        .and_then(|(w, h)| Some([edge(w)?, edge(h)?]))
        .ok_or_else(|| {
            format!("a size is WIDTHxHEIGHT, each 16 to {MOST_PIXELS} pixels, for example 1280x720")
        })
}

fn parse_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse::<f64>().ok().filter(|s| (0.1..=2.0).contains(s));
    scale.ok_or_else(|| "a scale is a number from 0.1 to 2".to_owned())
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|s| (0.0..=1e6).contains(s));
    seconds.ok_or_else(|| "a number of seconds from 0 to 1000000".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_scales_are_bounded() {
        assert_eq!(parse_size("1280x720"), Ok([1280, 720]));
        for bad in [
            "",
            "x",
            "12x",
            "1280",
            "0x0",
            "99999x10",
            "-5x20",
            "1280x720x3",
        ] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
        for bad in ["nan", "inf", "0", "3", "-1", "half"] {
            assert!(parse_scale(bad).is_err(), "{bad}");
        }
        assert!(parse_seconds("nan").is_err() && parse_seconds("-1").is_err());
    }
}
