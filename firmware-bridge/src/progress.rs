//! A progress bar on stderr for long work; silent where nobody watches.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// One bar for one piece of work.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// A bar named after the work; drawn only on a terminal.
    pub fn new(name: &'static str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(1000), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{prefix} [{bar:30}] {percent:>3} % {msg}")
        {
            bar.set_style(style);
        }
        bar.set_prefix(name);
        Self { bar }
    }

    /// Shows a stage's name and the share done, in [0, 1].
    pub fn show(&mut self, stage: &str, share: f32) {
        self.bar.set_message(stage.to_owned());
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "in 0..=1000"
        )]
        self.bar
            .set_position((share.clamp(0.0, 1.0) * 1000.0) as u64);
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
