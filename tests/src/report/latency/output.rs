//! The report's files.

use super::super::Machine;
use super::super::plot::{Plot, Point, Scale, Series};
use super::super::table::Table;
use super::{Row, Spread, WAYS};
use anyhow::{Context as _, Result};
use serde_json::json;
use std::path::Path;

const METHOD: &str = "\
## How it was measured

* Each row is a session of the product: `osteon haptics` on `osteon fake-omni` (or on the device of its own process), the phantom \
at 1.5 mm, the stylus in its dock. The figures are the session's own histograms: *wake* from a tick's deadline to its start, \
*round trip* from a command to its acknowledgement seen. The device acknowledges with its next state, so about 1 ms of it is the \
device's period.
* *fifo*: SCHED_FIFO 80, locked memory, a core of its own, shallow idle states. *other*: none of it (`--no-realtime`). The simulated \
device runs under SCHED_FIFO 81 in both.
* *hogs*: a busy loop on every core. *viewer*: `osteon view --offscreen`, drawn by the adapter of the machine (software where it has \
no graphics card).
* *cyclictest* ran before the sessions of its scheduler and load, in the same minute and under the same load, with the same priority \
and core: it is what the machine can do. The *ratio* is ours over its.
* On the device's clock *wake* is how late a state came after the one before it, beyond 1 ms, or the time-out for it.
* Nothing here is asserted by a test: a shared machine's figures belong to the machine.";

pub(super) fn write(out: &Path, machine: &Machine, seconds: f64, rows: &[Row]) -> Result<()> {
    let file = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
    };
    let (table, plots) = (table(rows), [wake(rows), roundtrip(rows)]);
    table.write(out)?;
    for plot in &plots {
        plot.write(out)?;
    }
    let document = json!({
        "report": "latency", "seconds": seconds, "machine": machine, "rows": rows
    });
    file("latency.json", &serde_json::to_string_pretty(&document)?)?;
    let without = if rows.iter().any(|r| r.cyclictest_us.is_none()) {
        "**cyclictest is not installed here** (Debian/Ubuntu: apt install rt-tests): no ratios.\n\n"
    } else {
        ""
    };
    let text = format!(
        "# How punctual the servo is\n\nMade with `osteon report latency --out DIR`, {seconds} s a session. All figures are in \
         [latency.json](latency.json).\n\nMachine: {}.\n\n{without}{METHOD}\n\n{}{}{}",
        machine.words(),
        table.markdown(),
        plots[0].markdown(),
        plots[1].markdown()
    );
    file("latency.md", &text)?;
    #[expect(clippy::print_stderr, reason = "what a command says at its end")]
    {
        eprintln!("latency report: {}", out.join("latency.md").display());
    }
    Ok(())
}

fn four(spread: &Spread) -> String {
    let parts = [spread.p50, spread.p99, spread.p999, spread.max];
    parts.map(|v| format!("{v:.0}")).join(" / ")
}

/// Ours over cyclictest's.
fn ratio(row: &Row, of: fn(&Spread) -> f64) -> Option<f64> {
    let beside = of(row.cyclictest_us.as_ref()?);
    (beside > 0.0).then(|| of(&row.wake_us) / beside)
}

fn table(rows: &[Row]) -> Table {
    let mut table = Table::new(
        "latency_rows",
        "Transport × scheduler × load",
        "p50 / p99 / p99.9 / max, µs.",
        &[
            "transport",
            "clock",
            "scheduler",
            "load",
            "wake",
            "cyclictest",
            "ratio p99",
            "ratio p99.9",
            "round trip",
            "tick",
            "ticks",
            "skipped",
            "missing states",
            "trips",
            "pictures",
        ],
    );
    for row in rows {
        let share = |of| ratio(row, of).map_or_else(|| "–".to_owned(), |r| format!("{r:.1}"));
        table.push([
            row.transport.to_owned(),
            row.clock.to_owned(),
            row.scheduler.to_owned(),
            row.load.to_owned(),
            four(&row.wake_us),
            row.cyclictest_us
                .as_ref()
                .map_or_else(|| "–".to_owned(), four),
            share(|s| s.p99),
            share(|s| s.p999),
            four(&row.roundtrip_us),
            four(&row.tick_us),
            row.ticks.to_string(),
            row.skipped_periods.to_string(),
            row.gaps.to_string(),
            row.trips.to_string(),
            row.frames_rendered.to_string(),
        ]);
    }
    table
}

fn plot(
    stem: &str,
    title: &str,
    note: &str,
    axes: [&str; 2],
    rows: &[Row],
    point: fn(&Row) -> Option<Point>,
) -> Plot {
    let mut plot = Plot::new(stem, title, note, axes).on([Scale::Log, Scale::Log]);
    for way in &WAYS {
        for scheduler in super::SCHEDULERS {
            let own =
                |r: &&Row| (r.transport, r.clock, r.scheduler) == (way.name, way.clock, scheduler);
            plot.series.push(Series {
                name: format!("{}, {}'s clock, {scheduler}", way.name, way.clock),
                points: rows.iter().filter(own).filter_map(point).collect(),
            });
        }
    }
    plot.series.retain(|s| !s.points.is_empty());
    plot
}

fn wake(rows: &[Row]) -> Plot {
    plot(
        "latency_wake",
        "Wake-up beside cyclictest",
        "A point for each load: p99.9 of the servo's wake-up over that of cyclictest in the same minute.",
        ["cyclictest p99.9, µs", "wake-up p99.9, µs"],
        rows,
        |row| {
            Some(Point::at(
                row.cyclictest_us?.p999.max(1.0),
                row.wake_us.p999.max(1.0),
            ))
        },
    )
}

fn roundtrip(rows: &[Row]) -> Plot {
    plot(
        "latency_roundtrip",
        "Round trip, median and tail",
        "A point for each load.",
        ["round trip p50, µs", "round trip p99.9, µs"],
        rows,
        |row| {
            Some(Point::at(
                row.roundtrip_us.p50.max(1.0),
                row.roundtrip_us.p999.max(1.0),
            ))
        },
    )
}
