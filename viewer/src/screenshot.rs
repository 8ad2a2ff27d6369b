//! A picture of the whole window, for documentation.
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::cli::ViewArgs;
use crate::offscreen::write_png;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Asks for one picture of the window at a time after the bone is complete.
#[derive(Debug)]
pub(crate) struct Screenshot {
    path: Option<PathBuf>,
    after: Duration,
    // when the bone was first seen complete
    complete: Option<Instant>,
}

/// Saves a picture of the window in the working folder; says where.
pub(crate) fn save(ctx: &egui::Context) -> String {
    let since = std::time::UNIX_EPOCH.elapsed().unwrap_or_default();
    let path = PathBuf::from(format!("osteon-{}.png", since.as_millis()));
    let told = format!("picture of the window: {}", path.display());
    request(ctx, path);
    told
}

/// Asks for a picture of the window.
fn request(ctx: &egui::Context, path: PathBuf) {
    ctx.request_screenshot(move |image| {
        // a window is never above the adapter's texture edge
        let size = image.size.map(|n| n as u32);
        let pixels: Vec<u8> = image
            .pixels
            .iter()
            .flat_map(egui::Color32::to_array)
            .collect();
        match write_png(&path, size, &pixels) {
            Ok(()) => crate::say(&format!("picture of the window: {}", path.display())),
            Err(e) => crate::say(&format!("{e:#}")),
        }
    });
}

impl Screenshot {
    /// From the arguments, or the variable `OSTEON_SCREENSHOT`.
    pub(crate) fn new(args: &ViewArgs) -> Self {
        let variable = || std::env::var_os("OSTEON_SCREENSHOT").filter(|v| !v.is_empty());
        Self {
            path: args
                .window_screenshot
                .clone()
                .or_else(|| variable().map(PathBuf::from)),
            after: Duration::from_secs_f64(args.screenshot_after),
            complete: None,
        }
    }

    /// Called once a frame; `complete` = the bone is on the screen.
    pub(crate) fn step(&mut self, ctx: &egui::Context, complete: bool) {
        if self.path.is_none() || !complete {
            return;
        }
        let since = *self.complete.get_or_insert_with(Instant::now);
        let left = self.after.saturating_sub(since.elapsed());
        if !left.is_zero() {
            ctx.request_repaint_after(left);
            return;
        }
        if let Some(path) = self.path.take() {
            request(ctx, path);
        }
    }
}
