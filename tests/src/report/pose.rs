//! `osteon report pose`: what the host knows of the stylus, against the plant's truth.

use super::plot::{Plot, Point, Series};
use super::table::Table;
use anyhow::{Context as _, Result};
use osteon_firmware_bridge::bench::pose::{PoseErrors, Spread, TIP_MM, measure};
use std::path::PathBuf;

/// Where to write it.
#[derive(Debug, Clone, clap::Args)]
pub struct PoseArgs {
    /// Folder for pose.json, pose.md, tables and the plot; made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Measures and writes.
pub fn run(args: &PoseArgs) -> Result<()> {
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("making the folder {}", args.out.display()))?;
    let errors = measure();
    let (still, moving, plot) = (still(&errors), moving(&errors), plot(&errors));
    still.write(&args.out)?;
    moving.write(&args.out)?;
    plot.write(&args.out)?;
    let write = |name: &str, text: &str| {
        let path = args.out.join(name);
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
    };
    write("pose.json", &serde_json::to_string_pretty(&errors)?)?;
    let text = format!(
        "# Where the stylus is, and where the host takes it to be\n\nMade with `osteon report pose --out DIR`. \
         Encoders of 15,000 counts a revolution floor; the host takes the middle of a count. All figures are in \
         [pose.json](pose.json).\n\n{}{}{}",
        still.markdown(),
        moving.markdown(),
        plot.markdown()
    );
    write("pose.md", &text)?;
    #[expect(clippy::print_stderr, reason = "what a command says at its end")]
    {
        eprintln!("pose report: {}", args.out.join("pose.md").display());
    }
    Ok(())
}

fn cells(spread: &Spread) -> [String; 3] {
    [spread.rms, spread.p99, spread.max].map(|v| format!("{v:.4}"))
}

fn still(errors: &PoseErrors) -> Table {
    let note = format!(
        "*Tip*: {TIP_MM} mm before the gimbal's centre, from the wrist's sensors alone. Potentiometers: ±5 % of \
         linearity, the low 5 of 16 bits noise, 40 devices; taken for linear as the host takes a stock Omni's, or \
         with a table of 17 points for each track of each device."
    );
    let mut table = Table::new(
        "pose_still",
        "At rest",
        &note,
        &["what", "RMS, mm", "p99, mm", "max, mm"],
    );
    for (name, spread) in [
        ("gimbal's centre", &errors.static_mm),
        ("tip, 14-bit encoders in the wrist", &errors.tip_encoders_mm),
        ("tip, potentiometers taken for linear", &errors.tip_pots_mm),
        (
            "tip, potentiometers with a table",
            &errors.tip_pots_calibrated_mm,
        ),
    ] {
        table.push([name.to_owned()].into_iter().chain(cells(spread)));
    }
    table
}

fn moving(errors: &PoseErrors) -> Table {
    let mut table = Table::new(
        "pose_moving",
        "In motion",
        "Along x through the workspace. *Place*: as used, half a millisecond after it was sampled, against the \
         truth at that moment. *Velocity*: behind the host's filter of 50 Hz, steady motion. *Lag*: of the filtered \
         velocity on a sine of 5 Hz.",
        &[
            "speed, m/s",
            "place RMS, mm",
            "p99, mm",
            "max, mm",
            "velocity RMS, m/s",
            "max, m/s",
            "lag, ms",
        ],
    );
    for m in &errors.moving {
        let place = cells(&m.place_mm);
        let rest = [m.velocity_m_s.rms, m.velocity_m_s.max].map(|v| format!("{v:.4}"));
        table.push(
            [format!("{}", m.speed_m_s)]
                .into_iter()
                .chain(place)
                .chain(rest)
                .chain([format!("{:.2}", m.velocity_lag_ms)]),
        );
    }
    table
}

fn plot(errors: &PoseErrors) -> Plot {
    let mut plot = Plot::new(
        "pose_speed",
        "Error of the place against speed",
        "The floor is the counts, the slope the age of a sample.",
        ["speed, m/s", "error of the place, mm"],
    );
    for (name, of) in [
        ("RMS", (|s: &Spread| s.rms) as fn(&Spread) -> f64),
        ("max", |s| s.max),
    ] {
        let point = |m: &osteon_firmware_bridge::bench::pose::Moving| {
            Point::at(m.speed_m_s, of(&m.place_mm))
        };
        plot.series.push(Series {
            name: name.to_owned(),
            points: errors.moving.iter().map(point).collect(),
        });
    }
    plot
}
