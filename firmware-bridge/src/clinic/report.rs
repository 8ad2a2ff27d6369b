//! `osteon report session`: one HTML file to look at, JSON to file, a table over many sessions.

use super::picture::{Plane, curve, escaped, face_map, section};
use super::recorded::replayed;
use super::score::{Bands, Filed, Judged, Verdict};
use super::session::{Played, play, stroke, tool_axis};
use super::target::Target;
use super::write_whole;
use crate::progress::Progress;
use crate::recording::Moved;
use anyhow::{Context as _, bail};
use osteon_sim_core::feel::Feel;
use osteon_sim_core::metrics::result::{Case, placed};
use osteon_sim_core::metrics::surface::{Achieved, carved_points};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Options of the report.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Writes DIR/session.json (every metric as name, value, unit, uncertainty, plan), DIR/session.html (one file, no
network) and DIR/cohort.csv (one row a session). Of several sessions each gets a folder of its own in DIR.

The score bands are a proposal and not validated; --bands takes your own.")]
pub struct SessionArgs {
    /// Session files, as 'osteon demo --scene DIR --record FILE' and 'osteon haptics' write them
    #[arg(value_name = "FILE", required_unless_present = "scripted")]
    pub files: Vec<PathBuf>,
    /// Scene to play with the scripted hand instead: a folder, or normal, eroded, soft
    #[arg(long, value_name = "SCENE", conflicts_with = "files")]
    pub scripted: Vec<PathBuf>,
    /// Folder for the report
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Score bands of your own (TOML)
    #[arg(long, value_name = "FILE")]
    pub bands: Option<PathBuf>,
    /// Where a recording's files are now.
    #[command(flatten)]
    pub moved: Moved,
}

/// Reports, telling on stderr where.
#[expect(clippy::print_stderr, reason = "what a command-line program says")]
pub fn run(args: &SessionArgs) -> anyhow::Result<()> {
    let bands = Bands::load(args.bands.as_deref())?;
    let sources: Vec<&PathBuf> = args.files.iter().chain(&args.scripted).collect();
    let stem = |path: &&PathBuf| {
        let stem = path.file_stem();
        stem.map_or_else(
            || "session".to_owned(),
            |n| n.to_string_lossy().into_owned(),
        )
    };
    let names: Vec<String> = sources.iter().map(stem).collect();
    for (n, name) in names.iter().enumerate() {
        if names[..n].contains(name) {
            bail!("two sessions are called {name}; rename one");
        }
    }
    let mut all = Vec::new();
    for (source, name) in sources.iter().zip(&names) {
        let (target, played) = if args.files.is_empty() {
            scripted(source)?
        } else {
            replayed(source, &args.moved)?
        };
        let judged = Judged::of(&target, &played, &bands, name);
        let dir = if sources.len() == 1 {
            args.out.clone()
        } else {
            args.out.join(name)
        };
        write(&dir, &target, &played, &judged)?;
        eprintln!("{}", dir.join("session.html").display());
        all.push(judged);
    }
    write_whole(&args.out.join("cohort.csv"), &cohort(&all))?;
    Ok(())
}

/// The scripted hand's session on a scene.
fn scripted(scene: &Path) -> anyhow::Result<(Target, Played)> {
    let mut bar = Progress::new("report");
    let target = Target::load(scene, &mut |stage, share| bar.show(stage, share));
    bar.finish();
    let target = target?;
    let hand = stroke(&target, &Pose::IDENTITY);
    let played = play(&target, &Tool::standard_set(), &Feel::default(), hand)?;
    Ok((target, played))
}

/// Writes one session's files.
pub fn write(dir: &Path, target: &Target, played: &Played, judged: &Judged) -> anyhow::Result<()> {
    std::fs::create_dir_all(dir).with_context(|| format!("{}: cannot be made", dir.display()))?;
    write_whole(&dir.join("session.json"), &judged.json()?)?;
    write_whole(&dir.join("session.html"), &html(target, played, judged))?;
    Ok(())
}

/// Plan frame from the achieved component's, for the pictures.
fn achieved_pose(target: &Target, played: &Played) -> Option<Pose> {
    let bone_from_plan = &target.bone_from_component;
    let points = carved_points(&target.scene.bone, &played.cut, &bone_from_plan.inverse());
    let found = Achieved::find(&points, &target.component);
    let case = Case {
        bone: &target.scene.bone,
        cut: &played.cut,
        planned: &target.planned,
        bone_from_plan,
        component: &target.component,
        native_mm: target.plan.depth_mm,
        scapula: Some(&target.scapula),
        protected: &[],
        tool_axis: tool_axis(&played.trace, bone_from_plan),
    };
    placed(&case, &found).map(|p| p.plan_from_component)
}

const STYLE: &str = "body{font-family:sans-serif;max-width:1000px;margin:2em auto;color:#222}\
table{border-collapse:collapse;width:100%}td,th{border-bottom:1px solid #ddd;padding:3px 8px;text-align:left;font-size:14px}\
td.n{text-align:right;white-space:nowrap}.good{background:#d8eed8}.acceptable{background:#f6ecc8}.poor{background:#f4d0cc}\
.warn{background:#fff3d0;border:1px solid #d8b040;padding:8px}.pics{display:flex;flex-wrap:wrap;gap:12px}\
.key span{display:inline-block;width:12px;height:12px;margin:0 4px 0 12px}svg{max-width:100%;height:auto}";

/// The page.
pub fn html(target: &Target, played: &Played, judged: &Judged) -> String {
    let pose = achieved_pose(target, played);
    let plan_from_bone = target.bone_from_component.inverse();
    let mut page = format!(
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>Session {0}</title><style>{STYLE}</style><h1>Session {0}</h1>\
         <p>Scene: {1}. Component: {2}. Cut: {3}.</p>\
         <p class='warn'>A training simulator, not a medical device. Score bands: {4}. {5}</p>",
        escaped(&judged.session),
        escaped(&judged.scene),
        escaped(&target.component.name),
        judged.cut,
        escaped(&judged.bands),
        if judged.bands_validated {
            "Marked as validated by their author."
        } else {
            "They are <b>not validated</b>."
        },
    );
    page.push_str("<h2>Planned and achieved</h2><p class='key'>Dashed blue: planned axis; blue outline: planned component; red line: achieved axis.");
    for (colour, what) in [
        ("#e8dcc0", "bone left"),
        ("#d0d4d8", "removed as planned"),
        ("#d03020", "removed beyond the plan"),
        ("#3060c0", "left where the plan removes"),
    ] {
        _ = write!(page, "<span style='background:{colour}'></span>{what}");
    }
    page.push_str("</p><div class='pics'>");
    for plane in [Plane::Transverse, Plane::Scapular] {
        page.push_str(&section(target, &played.cut, plane, pose.as_ref()));
    }
    page.push_str(&face_map(target, &played.cut));
    page.push_str("</div><h2>Course</h2>");
    page.push_str(&curve(
        &played.trace,
        ("Force at a real tool", "N"),
        &judged.events,
        |t| t.physical_n,
        f64::max,
    ));
    page.push_str(&curve(
        &played.trace,
        ("Tip over the planned back", "mm"),
        &judged.events,
        |t| plan_from_bone.point(t.tip()).z.clamp(-30.0, 20.0),
        f64::min,
    ));
    page.push_str(
        "<h2>Metrics</h2><table><tr><th>metric<th>value<th>plan<th>unit<th>what it is</tr>",
    );
    for m in &judged.metrics {
        page.push_str(&row(m));
    }
    page.push_str("</table><p>± is the half width within which voxels and fits may have moved a value; without it a value is counted or recorded.</p></html>\n");
    page
}

fn row(m: &Filed) -> String {
    let class = match m.verdict {
        Some(Verdict::Good) => " class='good'",
        Some(Verdict::Acceptable) => " class='acceptable'",
        Some(Verdict::Poor) => " class='poor'",
        None => "",
    };
    let number = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| format!("{v:.2}"));
    let spread = m
        .uncertainty
        .map_or_else(String::new, |u| format!(" ± {u:.2}"));
    format!(
        "<tr{class}><td>{}<td class='n'>{}{}<td class='n'>{}<td>{}<td>{}</tr>",
        m.name.replace('_', " "),
        number(m.value),
        if m.value.is_some() {
            spread
        } else {
            String::new()
        },
        number(m.plan),
        m.unit,
        escaped(m.note)
    )
}

/// One row a session, one column a metric with its unit in the name; empty where it cannot be said.
pub fn cohort(all: &[Judged]) -> String {
    let mut columns: Vec<(&str, &str)> = Vec::new();
    for m in all.iter().flat_map(|j| &j.metrics) {
        if !columns.iter().any(|c| c.0 == m.name) {
            columns.push((m.name, m.unit));
        }
    }
    let unit = |u: &str| match u {
        "" => String::new(),
        "°" => "_deg".to_owned(),
        "%" => "_pct".to_owned(),
        "mm³" => "_mm3".to_owned(),
        "N·s" => "_ns".to_owned(),
        other => format!("_{}", other.to_lowercase()),
    };
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let mut csv = "session,scene,component".to_owned();
    for (name, u) in &columns {
        _ = write!(csv, ",{name}{}", unit(u));
    }
    csv.push('\n');
    for j in all {
        _ = write!(
            csv,
            "{},{},{}",
            quoted(&j.session),
            quoted(&j.scene),
            quoted(&j.component)
        );
        for (name, _) in &columns {
            match j.value(name) {
                Some(v) => _ = write!(csv, ",{v}"),
                None => csv.push(','),
            }
        }
        csv.push('\n');
    }
    csv
}
