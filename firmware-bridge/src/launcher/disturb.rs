//! A script that disturbs the viewer, to show that nothing it does reaches the haptics.

use std::time::Duration;

/// What is done to the viewer process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Act {
    /// SIGSTOP.
    Stop,
    /// SIGCONT.
    Continue,
    /// SIGKILL; the launcher starts another.
    Kill,
}

/// Acts in the order of their time since the viewer's first start.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Disturbance {
    pub(crate) acts: Vec<(Duration, Act)>,
}

/// Reads `stop@5:5,kill@12`: stop at 5 s for 5 s, kill at 12 s.
pub(crate) fn parse(text: &str) -> Result<Disturbance, String> {
    let mut acts = Vec::new();
    for part in text.split(',') {
        let wrong = || format!("'{part}': write stop@SECOND:SECONDS or kill@SECOND");
        let (what, when) = part.split_once('@').ok_or_else(wrong)?;
        let seconds = |s: &str| {
            s.parse::<f64>()
                .ok()
                .filter(|v| (0.0..86_400.0).contains(v))
                .map(Duration::from_secs_f64)
                .ok_or_else(wrong)
        };
        match what {
            "stop" => {
                let (at, length) = when.split_once(':').ok_or_else(wrong)?;
                let at = seconds(at)?;
                acts.push((at, Act::Stop));
                acts.push((at + seconds(length)?, Act::Continue));
            }
            "kill" => acts.push((seconds(when)?, Act::Kill)),
            _ => return Err(wrong()),
        }
    }
    acts.sort_by_key(|(at, _)| *at);
    Ok(Disturbance { acts })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acts_come_in_order_of_time() {
        let script = parse("kill@12,stop@5:5").expect("valid");
        let at = |s| Duration::from_secs(s);
        assert_eq!(
            script.acts,
            [
                (at(5), Act::Stop),
                (at(10), Act::Continue),
                (at(12), Act::Kill)
            ]
        );
    }

    #[test]
    fn nonsense_is_named() {
        for text in [
            "", "stop", "stop@5", "kill@x", "burn@3", "kill@-1", "kill@NaN",
        ] {
            let error = parse(text).expect_err(text);
            assert!(error.contains("kill@SECOND"), "{error}");
        }
    }
}
