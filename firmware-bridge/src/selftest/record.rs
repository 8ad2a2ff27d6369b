//! The written record of a self-test.

use super::procedure::{Step, Verdict};
use crate::link::DeviceInfo;
use anyhow::Context as _;
use serde::Serialize;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// What is written.
#[derive(Debug, Serialize)]
pub(super) struct Record {
    /// Seconds since 1970, UTC.
    pub(super) unix_time: u64,
    pub(super) date: String,
    pub(super) program: &'static str,
    pub(super) device: String,
    pub(super) model: String,
    pub(super) serial: String,
    pub(super) firmware: String,
    pub(super) operator: String,
    /// Every step passed.
    pub(super) passed: bool,
    pub(super) steps: Vec<Step>,
}

impl Record {
    pub(super) fn new(device: &str, info: &DeviceInfo, operator: &str, steps: Vec<Step>) -> Self {
        let unix_time = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .map_or(0, |d| d.as_secs());
        Self {
            unix_time,
            date: date(unix_time),
            program: concat!("osteon ", env!("CARGO_PKG_VERSION")),
            device: device.to_owned(),
            model: info.model.clone(),
            serial: info.serial.clone(),
            firmware: info.firmware.clone(),
            operator: operator.to_owned(),
            passed: steps.iter().all(|s| s.verdict == Verdict::Pass),
            steps,
        }
    }

    fn count(&self, verdict: Verdict) -> usize {
        self.steps.iter().filter(|s| s.verdict == verdict).count()
    }

    /// Names of the steps that failed.
    pub(super) fn failed(&self) -> Vec<&'static str> {
        let failed = self.steps.iter().filter(|s| s.verdict == Verdict::Fail);
        failed.map(|s| s.name).collect()
    }

    pub(super) fn verdict(&self) -> String {
        format!(
            "selftest of {}: {} passed, {} failed, {} left out{}",
            self.device,
            self.count(Verdict::Pass),
            self.count(Verdict::Fail),
            self.count(Verdict::Skipped),
            if self.passed {
                ""
            } else {
                ": the device is not commissioned"
            }
        )
    }

    /// Writes selftest.json and selftest.md.
    pub(super) fn write(&self, out: &Path) -> anyhow::Result<()> {
        let file = |name: &str, text: &str| {
            let path = out.join(name);
            std::fs::write(&path, text).with_context(|| format!("{}: cannot write", path.display()))
        };
        file("selftest.json", &serde_json::to_string_pretty(self)?)?;
        file("selftest.md", &self.markdown())
    }

    fn markdown(&self) -> String {
        let clean = |text: &str| text.replace(['|', '\n', '\r'], " ");
        let rows: Vec<String> = self
            .steps
            .iter()
            .map(|s| format!("| {} | {:?} | {} |", s.name, s.verdict, clean(&s.seen)))
            .collect();
        format!(
            "# Self-test of a haptic device\n\n| | |\n|---|---|\n| date | {} |\n| device | {} |\n| model | {} |\n| serial | {} |\n\
             | firmware | {} |\n| operator | {} |\n| program | {} |\n| verdict | {} |\n\n| step | result | seen |\n|---|---|---|\n{}\n\n\
             The wrist's encoders are looked at by the angle that the stylus turned in the workspace step alone. A passed \
             self-test is no calibration.\n",
            self.date,
            clean(&self.device),
            clean(&self.model),
            clean(&self.serial),
            clean(&self.firmware),
            clean(&self.operator),
            self.program,
            self.verdict(),
            rows.join("\n")
        )
    }
}

/// `2026-03-01 12:00 UTC`. Days to date: the civil calendar of 400 years (Howard Hinnant's `civil_from_days`).
fn date(unix_time: u64) -> String {
    let (days, seconds) = (unix_time / 86_400, unix_time % 86_400);
    let z = days + 719_468;
    let (era, day_of_era) = (z / 146_097, z % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 {
        shifted + 3
    } else {
        shifted - 9
    };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (hour, minute) = (seconds / 3600, seconds / 60 % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // by `date -u -d @N`
        assert_eq!(date(0), "1970-01-01 00:00 UTC");
        assert_eq!(date(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(date(1_798_761_599), "2026-12-31 23:59 UTC");
    }
}
