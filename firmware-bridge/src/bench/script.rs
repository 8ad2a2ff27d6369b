//! `osteon bench SCRIPT`: sessions from a TOML file, in lockstep.

use super::junit::{Case, xml};
use super::trial::{Outcome, Work, stroke, until_firm, watch};
use super::world::{Lab, World};
use crate::fake::Stroke;
use crate::fake::device::DeviceSetup;
use crate::fake::faults::{Planned, Where};
use crate::fake::hand::Hold;
use anyhow::{Context as _, bail, ensure};
use serde::Deserialize;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest script, bytes.
const MAX_BYTES: u64 = 1 << 20;

/// Options of the bench.
#[derive(Debug, Clone, clap::Args)]
pub struct BenchArgs {
    /// Script: TOML with `[[session]]` of `name`, `work` ("press" or "cut"), `hold` ("none", "light",
    /// "grip"), `seeds`, `fault` ("NAME" or "NAME:DIRECTION"), and what is `expect`ed ("goes-on", "stops",
    /// "stands"); see firmware-bridge/bench/
    pub script: PathBuf,
    /// Write the results here as XML of the `JUnit` kind
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Write the results here as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Script {
    session: Vec<Session>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Expected {
    /// The drive stays active.
    GoesOn,
    /// Zero torque by 20 ms, and then the session goes on.
    Stops,
    /// Zero torque by 20 ms, and the session stands in a named fault.
    Stands,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum WorkName {
    Press,
    Cut,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Session {
    name: String,
    #[serde(default = "press")]
    work: WorkName,
    #[serde(default)]
    hold: Hold,
    #[serde(default = "one")]
    seeds: u64,
    fault: Option<String>,
    #[serde(default = "goes_on")]
    expect: Expected,
}

fn press() -> WorkName {
    WorkName::Press
}

fn one() -> u64 {
    1
}

fn goes_on() -> Expected {
    Expected::GoesOn
}

fn load(path: &Path) -> anyhow::Result<Vec<(Session, Option<Planned>)>> {
    let name = path.display();
    let size = std::fs::metadata(path)
        .with_context(|| format!("script {name}: cannot be read; give a TOML file"))?
        .len();
    ensure!(size <= MAX_BYTES, "script {name}: larger than 1 MiB");
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("script {name}: is not text; give a TOML file"))?;
    let script: Script = toml::from_str(&text).map_err(|e| {
        let line = e
            .span()
            .map_or(1, |s| text[..s.start].lines().count().max(1));
        let said = e.message().lines().collect::<Vec<_>>().join(" ");
        anyhow::anyhow!("script {name}, line {line}: {said}; correct the field")
    })?;
    ensure!(!script.session.is_empty(), "script {name}: no [[session]]");
    let checked = script.session.into_iter().map(|session| {
        ensure!(
            (1..=1000).contains(&session.seeds),
            "script {name}, session '{}': seeds = {} is outside 1 to 1000",
            session.name,
            session.seeds
        );
        let fault = session.fault.as_deref().map(str::parse::<Planned>);
        let fault = fault.transpose().map_err(|e| {
            anyhow::anyhow!("script {name}, session '{}': {e}", session.name)
        })?;
        if let Some(f) = fault
            && f.entry().place == Where::Setup
        {
            bail!(
                "script {name}, session '{}': {} holds from the device's start and cannot be scripted; \
                 'osteon report faults' plays it",
                session.name,
                f.fault
            );
        }
        Ok((session, fault))
    });
    checked.collect()
}

fn play(lab: &Arc<Lab>, session: &Session, fault: Option<Planned>) -> anyhow::Result<Case> {
    let work = match session.work {
        WorkName::Press => Work::Press,
        WorkName::Cut => Work::Cut,
    };
    let (mut failure, mut seconds) = (None, 0.0);
    for seed in 0..session.seeds {
        let stroke: Stroke = stroke(work);
        let setup = DeviceSetup {
            hold: session.hold,
            ..DeviceSetup::new(stroke, seed + 1)
        };
        let mut world = World::new(lab, setup, 0, 0);
        until_firm(&mut world).with_context(|| format!("session '{}'", session.name))?;
        let planned = match fault {
            Some(planned) => {
                world.inject(planned, seed);
                planned
            }
            // nothing is lost by a gap that is not injected
            None => "gap-4".parse().map_err(|e: String| anyhow::anyhow!(e))?,
        };
        seconds += world.now_ns() as f64 * 1e-9;
        let outcome = watch(world, planned);
        seconds += 1.0;
        if let Some(why) = unmet(&outcome, session.expect) {
            failure = Some(format!("seed {seed}: {why}"));
            break;
        }
    }
    Ok(Case {
        name: session.name.clone(),
        seconds,
        failure,
    })
}

fn unmet(outcome: &Outcome, expected: Expected) -> Option<String> {
    let in_time = outcome
        .zero_ms
        .is_some_and(|ms| ms <= super::trial::ZERO_BY_MS);
    let met = match expected {
        Expected::GoesOn => outcome.went_on && !outcome.stopped,
        Expected::Stops => outcome.went_on && in_time && outcome.stayed_zero,
        Expected::Stands => outcome.named.is_some() && in_time && outcome.stayed_zero,
    };
    let safe = outcome.wrongly_applied == 0 && outcome.slew_share <= 1.0 + 1e-9;
    (!(met && safe)).then(|| format!("expected {expected:?}, saw {outcome:?}"))
}

/// Plays the script; an error where a session does not do what is expected.
pub fn run(args: &BenchArgs) -> anyhow::Result<()> {
    let sessions = load(&args.script)?;
    let lab = Lab::new()?;
    let mut out = std::io::stdout();
    let mut cases = Vec::new();
    for (session, fault) in &sessions {
        let case = play(&lab, session, *fault)?;
        let verdict = case.failure.as_deref().unwrap_or("ok");
        writeln!(
            out,
            "{:40} {:7.1} s of device time  {verdict}",
            case.name, case.seconds
        )?;
        cases.push(case);
    }
    let write = |path: &Path, text: String| {
        std::fs::write(path, text).with_context(|| format!("{}: cannot write", path.display()))
    };
    if let Some(path) = &args.junit {
        write(path, xml(&args.script.display().to_string(), &cases))?;
    }
    if let Some(path) = &args.json {
        write(path, serde_json::to_string_pretty(&cases)?)?;
    }
    let failed = cases.iter().filter(|c| c.failure.is_some()).count();
    ensure!(
        failed == 0,
        "bench: {failed} of {} sessions failed",
        cases.len()
    );
    Ok(())
}

#[cfg(test)]
mod tests;
