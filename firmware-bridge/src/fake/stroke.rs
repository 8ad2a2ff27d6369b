//! The stroke: what the simulated hand is told to do, as a JSON file.

use anyhow::{Context as _, bail, ensure};
use glam::DVec3;
use osteon_sim_core::omni;
use serde::{Deserialize, Serialize};
use std::io::Read as _;
use std::path::Path;

/// Most segments of a stroke.
pub const MAX_SEGMENTS: usize = 1000;
/// Largest stroke file, bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// Points at which a segment's straight line is checked against the arm's reach.
const LINE_CHECKS: u32 = 64;

/// One straight movement of the hand, and what it does on arrival.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// Name for messages and the ground truth.
    pub name: String,
    /// Where to bring the gimbal's centre, base frame, mm.
    pub goal_mm: [f64; 3],
    /// Direction of the stylus on arrival, from its tip to its rear end, base frame; any length > 0.
    pub axis: [f64; 3],
    /// Speed along the line, mm/s; in (0, 500].
    pub speed_mm_s: f64,
    /// Most force with which the hand pushes along the line, N; in (0, 20].
    pub max_push_n: f64,
    /// Stylus button (1 or 2) to press for 80 ms on arrival; then 120 ms pass.
    #[serde(default)]
    pub press: Option<u8>,
    /// Time to hold still after arrival and press, s; in [0, 600].
    #[serde(default)]
    pub dwell_s: f64,
    /// After this time on the way the hand goes on to the next segment, s; in (0, 600].
    pub timeout_s: f64,
}

/// Segments in order, from the dock.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// At most [`MAX_SEGMENTS`].
    pub segments: Vec<Segment>,
}

impl Segment {
    /// The goal, base frame, mm.
    pub fn goal(&self) -> DVec3 {
        DVec3::from_array(self.goal_mm)
    }

    fn validate(&self) -> anyhow::Result<()> {
        let axis = DVec3::from_array(self.axis);
        ensure!(self.goal().is_finite(), "goal_mm is not finite");
        ensure!(
            axis.is_finite() && axis.length() > 1e-9,
            "axis has no direction"
        );
        let within = |name: &str, value: f64, lo: f64, hi: f64| {
            ensure!(
                value >= lo && value <= hi,
                "{name} = {value} is outside {lo} to {hi}"
            );
            Ok(())
        };
        within("speed_mm_s", self.speed_mm_s, 1e-3, 500.0)?;
        within("max_push_n", self.max_push_n, 1e-3, 20.0)?;
        within("dwell_s", self.dwell_s, 0.0, 600.0)?;
        within("timeout_s", self.timeout_s, 1e-3, 600.0)?;
        if let Some(button) = self.press {
            ensure!(
                matches!(button, 1 | 2),
                "press = {button}: buttons are 1 and 2"
            );
        }
        Ok(())
    }
}

impl Stroke {
    /// Reads and checks a stroke file.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        let name = path.display();
        let file = std::fs::File::open(path)
            .with_context(|| format!("stroke {name}: cannot be opened; check --stroke"))?;
        let mut text = String::new();
        file.take(MAX_FILE_BYTES + 1)
            .read_to_string(&mut text)
            .with_context(|| format!("stroke {name}: is not text; give a JSON file"))?;
        ensure!(
            text.len() as u64 <= MAX_FILE_BYTES,
            "stroke {name}: larger than 1 MiB; give a JSON file of segments"
        );
        let stroke: Self = serde_json::from_str(&text)
            .with_context(|| format!("stroke {name}: not a stroke; correct the field named"))?;
        stroke
            .validate()
            .with_context(|| format!("stroke {name}"))?;
        Ok(stroke)
    }

    /// Checks numbers and reach of every segment, including the straight line to it.
    pub fn validate(&self) -> anyhow::Result<()> {
        ensure!(
            self.segments.len() <= MAX_SEGMENTS,
            "{} segments; at most {MAX_SEGMENTS}",
            self.segments.len()
        );
        let mut from = omni::forward(omni::DOCK);
        for (index, segment) in self.segments.iter().enumerate() {
            let named = || format!("segment {index} '{}'", segment.name);
            segment.validate().with_context(named)?;
            for n in 1..=LINE_CHECKS {
                let point = from.lerp(segment.goal(), f64::from(n) / f64::from(LINE_CHECKS));
                if omni::inverse(point).is_none() {
                    bail!(
                        "{}: {point:.1} mm (base frame) is out of the arm's reach; move the goal \
                         or add a segment around",
                        named()
                    );
                }
            }
            from = segment.goal();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment() -> Segment {
        Segment {
            name: "approach".to_owned(),
            goal_mm: [0.0, -60.0, -60.0],
            axis: [0.0, 0.0, 1.0],
            speed_mm_s: 20.0,
            max_push_n: 2.0,
            press: Some(1),
            dwell_s: 0.1,
            timeout_s: 5.0,
        }
    }

    fn complaint(change: impl FnOnce(&mut Segment)) -> String {
        let mut bad = segment();
        bad.name = "bad one".to_owned();
        change(&mut bad);
        let stroke = Stroke {
            segments: vec![segment(), bad],
        };
        format!("{:#}", stroke.validate().unwrap_err())
    }

    #[test]
    fn a_good_stroke_survives_its_file() {
        let stroke = Stroke {
            segments: vec![segment()],
        };
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), serde_json::to_string(&stroke).unwrap()).unwrap();
        assert_eq!(Stroke::load(file.path()).unwrap(), stroke);
    }

    #[test]
    fn each_bad_number_is_named_with_its_segment() {
        let cases = [
            (complaint(|s| s.goal_mm[1] = f64::NAN), "goal_mm"),
            (
                complaint(|s| s.goal_mm[2] = 500.0),
                "out of the arm's reach",
            ),
            (complaint(|s| s.axis = [0.0; 3]), "axis"),
            (complaint(|s| s.speed_mm_s = -1.0), "speed_mm_s"),
            (complaint(|s| s.max_push_n = f64::INFINITY), "max_push_n"),
            (complaint(|s| s.press = Some(3)), "press = 3"),
            (complaint(|s| s.dwell_s = f64::NAN), "dwell_s"),
            (complaint(|s| s.timeout_s = 0.0), "timeout_s"),
        ];
        for (text, field) in cases {
            assert!(
                text.contains("segment 1 'bad one'") && text.contains(field),
                "{text}"
            );
        }
    }

    #[test]
    fn a_line_through_the_unreachable_is_refused_although_its_ends_are_not() {
        // From far left to far right behind the workspace: the middle is too near the waist.
        let mut left = segment();
        left.goal_mm = [-105.0, 20.0, -90.0];
        let mut right = segment();
        right.goal_mm = [105.0, 20.0, -90.0];
        assert!(omni::inverse(left.goal()).is_some());
        assert!(omni::inverse(right.goal()).is_some());
        let mut stroke = Stroke {
            segments: vec![left, right],
        };
        let text = format!("{:#}", stroke.validate().unwrap_err());
        assert!(text.contains("out of the arm's reach"), "{text}");
        stroke.segments.clear();
        stroke.validate().unwrap();
    }

    #[test]
    fn a_broken_file_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for (content, hint) in [
            ("{\"segments\": [{\"name\": 3}]}", "line 1"),
            ("{\"segments\": [], \"extra\": 1}", "extra"),
            ("", "not a stroke"),
        ] {
            std::fs::write(file.path(), content).unwrap();
            let text = format!("{:#}", Stroke::load(file.path()).unwrap_err());
            assert!(text.contains(hint), "{text}");
            assert!(text.contains(&file.path().display().to_string()), "{text}");
            assert!(!text.contains('\n'), "{text}");
        }
        assert!(Stroke::load(Path::new("/nonexistent/stroke.json")).is_err());
    }
}
