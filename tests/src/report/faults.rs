//! `osteon report faults`: every fault of cable and device, in lockstep, and what the plant shows.

use super::plot::{Plot, Point, Scale, Series};
use super::table::Table;
use anyhow::{Context as _, Result};
use osteon_firmware_bridge::bench::trial::{MOST_JOULES, ZERO_BY_MS, ZERO_NMM};
use osteon_firmware_bridge::bench::{Row, all_rows};
use osteon_firmware_bridge::fake::faults::CATALOGUE;
use osteon_firmware_bridge::progress::Progress;
use serde_json::json;
use std::path::PathBuf;

/// Where to write it.
#[derive(Debug, Clone, clap::Args)]
pub struct FaultsArgs {
    /// Folder for faults.json, faults.md, the table and the plot; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Sessions of each fault and direction
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
}

/// Plays and writes; an error where a fault does not do what is asked.
pub fn run(args: &FaultsArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    let mut progress = Progress::new("faults report");
    let rows = all_rows(args.seeds, &mut |what, share| progress.show(what, share))?;
    progress.finish();
    let write = |name: &str, text: &str| {
        let path = args.out.join(name);
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
    };
    let table = table(&rows);
    table.write(&args.out)?;
    let plot = plot(&rows);
    plot.write(&args.out)?;
    let failed: Vec<&Row> = rows.iter().filter(|r| !r.pass).collect();
    let document = json!({
        "report": "faults", "clock": "lockstep", "zero_nmm": ZERO_NMM, "zero_by_ms": ZERO_BY_MS,
        "most_joules": MOST_JOULES, "rows": rows
    });
    write("faults.json", &serde_json::to_string_pretty(&document)?)?;
    let text = format!(
        "# Faults on purpose\n\nMade with `osteon report faults --out DIR`: {} of {} rows pass. All figures are in \
         [faults.json](faults.json).\n\n{METHOD}\n\n{}{}",
        rows.len() - failed.len(),
        rows.len(),
        table.markdown(),
        plot.markdown()
    );
    write("faults.md", &text)?;
    #[expect(clippy::print_stderr, reason = "what a command says at its end")]
    {
        eprintln!("faults report: {}", args.out.join("faults.md").display());
    }
    anyhow::ensure!(
        failed.is_empty(),
        "faults report: {} rows do not pass, the first is {} {}",
        failed.len(),
        failed[0].fault,
        failed[0].direction
    );
    Ok(())
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "faults",
        "Every fault in each direction",
        "*Benign*: the session must not stop. *Zero*: longest time from the first frame that the fault met to zero \
         torque at the plant. *Work*: most that the motors did on the arm. *Slew*: largest share of the drive's slew \
         limit that a torque's rise used.",
        &[
            "fault",
            "direction",
            "what",
            "benign",
            "seeds",
            "zero, ms",
            "work, mJ",
            "slew",
            "went on",
            "stands in",
            "pass",
        ],
    );
    for row in rows {
        let about = CATALOGUE.iter().find(|e| e.name == row.fault);
        table.push([
            row.fault.to_owned(),
            row.direction.clone(),
            about.map_or("", |e| e.about).to_owned(),
            if row.benign { "yes" } else { "no" }.to_owned(),
            row.seeds.to_string(),
            row.zero_torque_ms_max
                .map_or_else(|| "–".to_owned(), |ms| format!("{ms:.1}")),
            format!("{:.2}", row.joules_max * 1e3),
            format!("{:.2}", row.slew_share_max),
            row.went_on.to_string(),
            row.named.clone(),
            if row.pass { "yes" } else { "**no**" }.to_owned(),
        ]);
    }
    table
}

fn plot(rows: &[Row]) -> Plot {
    let mut plot = Plot::new(
        "faults_zero",
        "Time to zero torque and work of the motors",
        "A point for each fault that must stop the motors, in its direction.",
        ["zero torque after, ms", "work of the motors on the arm, mJ"],
    );
    plot.scales = [Scale::Linear; 2];
    for direction in ["to-host", "to-device", "device"] {
        let points = rows
            .iter()
            .filter(|r| r.direction == direction)
            .filter_map(|r| Some(Point::at(r.zero_torque_ms_max?, r.joules_max * 1e3)))
            .collect();
        plot.series.push(Series {
            name: direction.to_owned(),
            points,
        });
    }
    plot
}

const METHOD: &str = "\
## How it was measured

* **Lockstep.** The bytes go through the real codec and sorting of frames, the real firmware (`protocol/src/firmware`), the real \
beat of the servo thread; the plant's clock is the only one, so every run gives the same figures. A frame takes 0.2 ms each way.
* **Sessions.** A hand presses a standing tool onto the phantom, or drills; it is a firm grip, two fingers, or nobody (a thread \
draws the bare stylus); seeds go round all six. The seed also chooses the moment, the bits, bytes and joints that are broken.
* **Zero** is below 0.5 N·mm at every joint, motors' lag included, for 5 ms at least, and must last until the fault is over.
* **Applied wrongly**: every command that the drive takes over is compared with what a host has sent under that number; none may \
differ, none may be older than the one before.
* These are times on a virtual clock: they prove the logic and its limits, not the punctuality of a computer.";

#[cfg(test)]
mod tests {
    use super::*;

    /// The bench's document has the table itself, every fault in each of its directions.
    #[test]
    fn the_bench_document_has_every_row() {
        let path = crate::workspace().join("BENCH.md");
        let text = std::fs::read_to_string(path).expect("BENCH.md");
        for entry in CATALOGUE {
            for direction in entry.directions {
                let row = format!("| {} | {direction} |", entry.name);
                let found = text.lines().filter(|l| l.starts_with(&row)).count();
                assert_eq!(found, 1, "{row}");
            }
        }
        let rows = text.lines().filter(|l| l.starts_with("| ")).count();
        let all: usize = CATALOGUE.iter().map(|e| e.directions.len()).sum();
        assert!(rows > all);
    }
}
