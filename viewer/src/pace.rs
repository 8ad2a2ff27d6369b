//! The internal scale: how many pixels the 3-D view is drawn with, so that input is answered in time.

/// Longest time that a frame of the 3-D view may take, ms; the window around it takes about as long as is
/// left of 100 ms where the CPU draws.
pub(crate) const FRAME_MS: f64 = 55.0;
/// Smallest scale that is chosen by itself.
const LEAST: f64 = 0.2;
/// Scales are multiples of this: the picture does not change its size with every frame.
const STEP: f64 = 0.05;
/// Share of the allowed time that a frame at the next larger scale may be expected to take.
const ROOM: f64 = 0.9;
/// Frames with room before the scale rises.
const PATIENCE: u32 = 4;

/// The scale, fixed or by itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    now: f64,
    by_itself: bool,
    calm: u32,
}

impl Scale {
    /// A scale that a person asked for stays; the others begin at `usual` and follow the frames.
    pub(crate) fn new(asked: Option<f64>, usual: f64) -> Self {
        Self {
            now: asked.unwrap_or(usual),
            by_itself: asked.is_none(),
            calm: 0,
        }
    }

    /// Pixels drawn for a pixel shown, along an edge.
    pub(crate) fn now(self) -> f64 {
        self.now
    }

    /// Takes note of a frame's time at the scale that holds. A frame that is too long lowers the scale at
    /// once, some with room raise it by a step.
    pub(crate) fn heard(&mut self, frame_ms: f64) {
        if !self.by_itself || !frame_ms.is_finite() {
            return;
        }
        let larger = frame_ms * ((self.now + STEP) / self.now).powi(2);
        if frame_ms > FRAME_MS {
            self.calm = 0;
            // the time goes with the pixels, but for a share that does not: never below a third at once
            let share = (FRAME_MS / frame_ms).sqrt().clamp(0.35, 0.95);
            self.now = ((self.now * share / STEP).floor() * STEP).max(LEAST);
        } else if larger < ROOM * FRAME_MS && self.now < 1.0 {
            self.calm += 1;
            if self.calm >= PATIENCE {
                self.calm = 0;
                self.now = (self.now + STEP).min(1.0);
            }
        } else {
            self.calm = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of a renderer that takes `fixed` and `full` times the square of the scale, ms.
    fn run(scale: &mut Scale, fixed: f64, full: f64, frames: usize) -> Vec<f64> {
        let each = (0..frames).map(|_| {
            let ms = fixed + full * scale.now().powi(2);
            scale.heard(ms);
            ms
        });
        each.collect()
    }

    #[test]
    fn a_slow_renderer_is_within_the_limit_after_three_frames_and_stays_there() {
        for (fixed, full) in [(5.0, 400.0), (20.0, 800.0), (1.0, 100.0), (0.0, 60.0)] {
            let mut scale = Scale::new(None, 1.0);
            let times = run(&mut scale, fixed, full, 200);
            assert!(
                times[3..].iter().all(|&ms| ms <= FRAME_MS),
                "{fixed} {full} {times:?}"
            );
            // it comes to rest
            let end = scale;
            run(&mut scale, fixed, full, 50);
            assert!((end.now() - scale.now()).abs() <= STEP + 1e-9);
        }
    }

    #[test]
    fn a_fast_renderer_comes_to_the_whole_resolution() {
        let mut scale = Scale::new(None, 0.5);
        run(&mut scale, 1.0, 10.0, 100);
        assert!((scale.now() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_a_person_asked_for_stays_and_nonsense_changes_nothing() {
        let mut asked = Scale::new(Some(0.8), 0.5);
        run(&mut asked, 500.0, 500.0, 20);
        assert!((asked.now() - 0.8).abs() < 1e-12);
        let mut scale = Scale::new(None, 0.5);
        scale.heard(f64::NAN);
        scale.heard(f64::INFINITY);
        assert!((scale.now() - 0.5).abs() < 1e-12);
        run(&mut scale, 1e6, 1e6, 50);
        assert!((scale.now() - LEAST).abs() < 1e-9);
    }
}
