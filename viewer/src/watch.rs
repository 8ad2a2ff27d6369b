//! A session without drawing: the mirror is kept and compared, for machines without an adapter.

use crate::cli::ViewArgs;
use crate::link::{Link, Shared};
use crate::mirror::End;
use serde_json::json;
use std::time::{Duration, Instant};

/// How long the last messages may take to leave.
const FAREWELL: Duration = Duration::from_millis(500);

/// Follows the session to its end.
pub(crate) fn run(args: &ViewArgs) -> anyhow::Result<()> {
    let shared = Shared::new();
    let joining = args.joining_unattended("osteon view, mirror only");
    let link = Link::start(&args.place(), &joining, &shared)?;
    let until = args
        .seconds
        .map(|s| Instant::now() + Duration::from_secs_f64(s));
    while shared.mirror().end.is_none() && until.is_none_or(|t| Instant::now() < t) {
        shared.wait(Duration::from_millis(100), |m| m.end.is_some());
    }
    link.flush(FAREWELL);
    let mirror = shared.mirror();
    if let Some(path) = &args.report {
        let report = json!({
            "mode": "mirror only",
            "name": "no adapter",
            "frames": 0,
            "updates": mirror.updates,
            "resyncs": mirror.resyncs,
        });
        std::fs::write(path, format!("{report:#}\n"))
            .map_err(|e| anyhow::anyhow!("{}: cannot write ({e})", path.display()))?;
    }
    match &mirror.end {
        Some(End::Failed(reason)) => anyhow::bail!("{reason}"),
        Some(End::Bye(_)) | None => Ok(()),
    }
}
