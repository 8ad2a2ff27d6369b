//! What else the machine does while a servo runs.

use super::{Folder, Helper, text, until};
use anyhow::Result;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// A load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Load {
    /// Nothing of ours.
    Idle,
    /// A busy loop on every core.
    Hogs,
    /// A viewer that draws the session's bone offscreen, in software where there is no graphics card.
    Viewer,
}

impl Load {
    pub(super) const ALL: [Self; 3] = [Self::Idle, Self::Hogs, Self::Viewer];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Hogs => "hogs",
            Self::Viewer => "viewer",
        }
    }
}

/// A load that runs until it is dropped.
pub(super) struct Loaded {
    stop: Arc<AtomicBool>,
    hogs: Vec<JoinHandle<()>>,
    viewer: Option<Helper>,
}

impl Loaded {
    /// Begins; a viewer joins the session at `socket`, its picture goes to `folder`.
    pub(super) fn begin(load: Load, socket: &str, folder: &Path) -> Result<Self> {
        let mut loaded = Self {
            stop: Arc::new(AtomicBool::new(false)),
            hogs: Vec::new(),
            viewer: None,
        };
        if load == Load::Hogs {
            let cores = std::thread::available_parallelism().map_or(1, usize::from);
            for _ in 0..cores {
                let stop = Arc::clone(&loaded.stop);
                let hog = std::thread::Builder::new().name("hog".to_owned());
                loaded.hogs.push(hog.spawn(move || {
                    while !stop.load(Ordering::Relaxed) {
                        core::hint::spin_loop();
                    }
                })?);
            }
        }
        if load == Load::Viewer {
            until("the session's socket", || Path::new(socket).exists())?;
            let picture = text(&folder.join("picture.png"));
            let args = ["view", "--offscreen", &picture, "--socket", socket];
            loaded.viewer = Some(Helper::start(&args)?);
        }
        Ok(loaded)
    }
}

impl Drop for Loaded {
    fn drop(&mut self) {
        drop(self.viewer.take());
        self.stop.store(true, Ordering::Relaxed);
        for hog in self.hogs.drain(..) {
            hog.join().unwrap_or(());
        }
    }
}

/// The load by itself, for a measurement that is no session: a viewer needs one to look at.
pub(super) struct Alone {
    _loaded: Loaded,
    _session: Option<Helper>,
    _folder: Folder,
}

impl Alone {
    pub(super) fn begin(load: Load) -> Result<Self> {
        let folder = Folder::new()?;
        let socket = text(&folder.0.join("s/haptics.sock"));
        let session = if load == Load::Viewer {
            let args = [
                "haptics",
                "--device",
                "sim",
                "--no-realtime",
                "--voxel-mm",
                "1.5",
                "--socket",
                &socket,
            ];
            Some(Helper::start(&args)?)
        } else {
            None
        };
        Ok(Self {
            _loaded: Loaded::begin(load, &socket, &folder.0)?,
            _session: session,
            _folder: folder,
        })
    }
}
