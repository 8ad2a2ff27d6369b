//! Frame times and counters of a viewer, for people and for `--report`.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::adapter::AdapterBrief;
use anyhow::Context as _;
use std::path::Path;
use std::time::Duration;

/// Most frame times kept: half an hour at 30 a second. Later ones replace the oldest.
const MOST_TIMES: usize = 1 << 16;

/// Durations of frames.
#[derive(Debug, Default)]
pub(crate) struct FrameTimes {
    millis: Vec<f32>,
    count: u64,
}

impl FrameTimes {
    /// Adds one frame.
    pub(crate) fn push(&mut self, time: Duration) {
        let millis = time.as_secs_f32() * 1e3;
        if self.millis.len() < MOST_TIMES {
            self.millis.push(millis);
        } else {
            self.millis[(self.count % MOST_TIMES as u64) as usize] = millis;
        }
        self.count += 1;
    }

    /// p50, p99, p99.9 and the maximum; `None` before the first frame.
    pub(crate) fn quantiles(&self) -> Option<Quantiles> {
        let mut sorted = self.millis.clone();
        sorted.sort_by(f32::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        // nearest rank: the value that a share q of all frames does not exceed
        let at = |q: f64| {
            let rank = (q * sorted.len() as f64).ceil() as usize;
            sorted[rank.saturating_sub(1).min(last)]
        };
        Some(Quantiles {
            p50: at(0.5),
            p99: at(0.99),
            p999: at(0.999),
            max: sorted[last],
        })
    }
}

/// Quantiles of frame times, ms.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub(crate) struct Quantiles {
    /// Median.
    pub(crate) p50: f32,
    /// 99 of 100 frames took no longer.
    pub(crate) p99: f32,
    /// 999 of 1000 frames took no longer.
    pub(crate) p999: f32,
    /// The longest.
    pub(crate) max: f32,
}

/// The file that `--report` writes.
#[derive(Debug, serde::Serialize)]
pub(crate) struct Report {
    /// `window` or `offscreen`.
    pub(crate) mode: &'static str,
    /// Who draws.
    #[serde(flatten)]
    pub(crate) adapter: AdapterBrief,
    /// Size of window or picture, pixels.
    pub(crate) size: [u32; 2],
    /// Resolution of the 3-D view as a share of it.
    pub(crate) render_scale: f64,
    /// How the bone was drawn at the end.
    pub(crate) renderer: &'static str,
    /// Bytes on the adapter for bone and picture.
    pub(crate) adapter_bytes: u64,
    /// Frames of the 3-D view.
    pub(crate) frames: u64,
    /// What `frame_ms` measures.
    pub(crate) frame_ms_of: &'static str,
    /// Times of frames; absent where none was drawn.
    pub(crate) frame_ms: Option<Quantiles>,
    /// Bricks taken over.
    pub(crate) updates: u64,
    /// Times that the viewer began with an empty mirror.
    pub(crate) resyncs: u64,
    /// Chunks of bone that arrived.
    pub(crate) chunks: usize,
    /// Priority of the process.
    pub(crate) priority: String,
    /// The core that is left to the servo loop.
    pub(crate) core_left_free: Option<usize>,
    /// How the session ended.
    pub(crate) end: String,
}

impl Report {
    /// Writes the file.
    pub(crate) fn write(&self, path: &Path) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(self)?;
        std::fs::write(path, text + "\n").with_context(|| {
            format!(
                "cannot write the report {}; choose another --report",
                path.display()
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_nearest_rank() {
        let mut times = FrameTimes::default();
        assert_eq!(times.quantiles(), None);
        for ms in (1..=1000).rev() {
            times.push(Duration::from_millis(ms));
        }
        let q = times.quantiles().unwrap();
        for (got, truth) in [
            (q.p50, 500.0),
            (q.p99, 990.0),
            (q.p999, 999.0),
            (q.max, 1000.0),
        ] {
            assert!((got - truth).abs() < 1e-9, "{got} {truth}");
        }
    }
}
