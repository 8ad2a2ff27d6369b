//! `cyclictest` of rt-tests: the measure that everybody knows, on the same machine in the same minute.

use super::Spread;
use super::load::{Alone, Load};
use anyhow::{Context as _, Result};
use osteon_firmware_bridge::rt::{SERVO_PRIORITY, servo_core};
use std::io::ErrorKind;
use std::process::Command;
use std::time::Duration;

/// Its histogram ends there, µs; later ones count by its maximum.
const LONGEST_US: u32 = 50_000;

/// Its wake-up latencies at this scheduler under this load; `None` where it is not installed.
pub(super) fn cyclictest(scheduler: &str, load: Load, seconds: f64) -> Result<Option<Spread>> {
    let alone = Alone::begin(load)?;
    // a viewer takes a while to have its bone
    if load == Load::Viewer {
        std::thread::sleep(Duration::from_secs(2));
    }
    let mut command = Command::new("cyclictest");
    command.args(["--quiet", "--interval=1000", "--threads=1"]);
    command.arg(format!("--duration={}", seconds.ceil()));
    command.arg(format!("--histogram={LONGEST_US}"));
    if scheduler == "fifo" {
        command
            .arg("--mlockall")
            .arg(format!("--priority={SERVO_PRIORITY}"));
        if let Some(core) = servo_core() {
            command.arg(format!("--affinity={core}"));
        }
    } else {
        command.arg("--policy=other");
    }
    let output = command.output();
    drop(alone);
    let output = match output {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        other => other.context("cyclictest")?,
    };
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    let spread = spread(&text);
    spread
        .with_context(|| {
            format!(
                "cyclictest says no histogram ({})",
                errors.trim().replace('\n', ", ")
            )
        })
        .map(Some)
}

/// Quantiles of a histogram as it prints it: `000012 000345`, then comments with the maximum.
fn spread(text: &str) -> Option<Spread> {
    let mut bins = Vec::new();
    let mut max = None;
    let mut over = 0;
    for line in text.lines() {
        if let Some(rest) = line.strip_prefix("# Max Latencies:") {
            max = rest.trim().parse::<f64>().ok();
        } else if let Some(rest) = line.strip_prefix("# Histogram Overflows:") {
            over = rest.trim().parse::<u64>().ok()?;
        } else if let Some((us, count)) = line.split_once(' ')
            && let (Ok(us), Ok(count)) = (us.parse::<u32>(), count.trim().parse::<u64>())
        {
            bins.push((us, count));
        }
    }
    let max = max?;
    let all = bins.iter().map(|(_, n)| n).sum::<u64>() + over;
    let quantile = |share: f64| {
        let mut before = 0;
        let found = bins.iter().find(|(_, count)| {
            before += count;
            before as f64 >= share * all as f64
        });
        found.map_or(max, |(us, _)| f64::from(*us))
    };
    (all > 0).then(|| Spread {
        p50: quantile(0.5),
        p99: quantile(0.99),
        p999: quantile(0.999),
        max,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_histogram_is_read() {
        let text = "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000003 000989\n000007 000009\n000040 000001\n\
            # Total: 000000999\n# Min Latencies: 00003\n# Avg Latencies: 00003\n# Max Latencies: 60123\n\
            # Histogram Overflows: 00001\n";
        let found = spread(text).expect("a histogram");
        let expected = Spread {
            p50: 3.0,
            p99: 7.0,
            p999: 40.0,
            max: 60_123.0,
        };
        assert_eq!(found, expected);
        assert_eq!(spread("no\n"), None);
    }
}
