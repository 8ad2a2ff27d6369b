//! Pictures of a result as SVG: sections through the plan's axis, the reamed face, curves over time.

use super::target::Target;
use glam::DVec3;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::metrics::trace::{SessionTrace, TraceTick};
use osteon_sim_core::planning::face::first_surface;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::sample::Sampler;
use std::fmt::Write as _;

/// Edge of a sample of a section, mm.
const SAMPLE_MM: f64 = 0.4;
/// Pixels of a millimetre.
const PER_MM: f64 = 8.0;
/// Bins of a curve over time.
const BINS: usize = 700;

/// A section's plane: which lateral axis of the plan's frame runs to the right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Plane {
    /// x: front and back.
    Transverse,
    /// y: above and below.
    Scapular,
}

impl Plane {
    fn point(self, across: f64, z: f64) -> DVec3 {
        match self {
            Self::Transverse => DVec3::new(across, 0.0, z),
            Self::Scapular => DVec3::new(0.0, across, z),
        }
    }

    fn across(self, p: DVec3) -> f64 {
        match self {
            Self::Transverse => p.x,
            Self::Scapular => p.y,
        }
    }

    fn names(self) -> [&'static str; 2] {
        match self {
            Self::Transverse => ["Section across the scapular plane", "x of the plan, mm"],
            Self::Scapular => ["Section in the scapular plane", "superior, mm"],
        }
    }
}

/// What a sample of a section is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Air,
    Left,
    AsPlanned,
    TooMuch,
    NotYet,
}

impl Kind {
    fn colour(self) -> &'static str {
        match self {
            Self::Air => "none",
            Self::Left => "#e8dcc0",
            Self::AsPlanned => "#d0d4d8",
            Self::TooMuch => "#d03020",
            Self::NotYet => "#3060c0",
        }
    }
}

/// A section with the planned axis (dashed) and, where there is one, the achieved one.
#[expect(clippy::too_many_lines, reason = "a drawing from top to bottom")]
pub(super) fn section(target: &Target, cut: &Cut, plane: Plane, achieved: Option<&Pose>) -> String {
    let (lo, hi) = ([-26.0, -32.0], [26.0, 14.0]);
    let bone = &*target.scene.bone;
    let (got, plan) = (Sampler::new(bone, cut), Sampler::new(bone, &target.planned));
    let kind = |across: f64, z: f64| {
        let p = target.bone_from_component.point(plane.point(across, z));
        let (got, plan) = (got.fields(p), plan.fields(p));
        match (got.solid > 0.0, got.cut > 0.0, plan.cut > 0.0) {
            (false, ..) => Kind::Air,
            (true, true, true) => Kind::Left,
            (true, false, false) => Kind::AsPlanned,
            (true, false, true) => Kind::TooMuch,
            (true, true, false) => Kind::NotYet,
        }
    };
    let (width, height) = ((hi[0] - lo[0]) * PER_MM, (hi[1] - lo[1]) * PER_MM);
    let x_of = |v: f64| (v - lo[0]) * PER_MM;
    let y_of = |v: f64| (hi[1] - v) * PER_MM;
    let [title, axis_name] = plane.names();
    let mut svg = open(width, height + 40.0, title);
    let mut z = hi[1];
    while z > lo[1] {
        runs(
            lo[0],
            hi[0],
            |across| kind(across, z),
            |from, to, kind| {
                if kind != Kind::Air {
                    let (x, y) = (x_of(from), y_of(z));
                    let (w, h) = ((to - from) * PER_MM + 0.3, SAMPLE_MM * PER_MM + 0.3);
                    _ = write!(
                        svg,
                        "<rect x='{x:.1}' y='{y:.1}' width='{w:.1}' height='{h:.1}' fill='{}'/>",
                        kind.colour()
                    );
                }
            },
        );
        z -= SAMPLE_MM;
    }
    outline(&mut svg, target, plane, &|a, z| (x_of(a), y_of(z)));
    let line = |svg: &mut String, pose: &Pose, style: &str| {
        let (a, b) = (pose.point(DVec3::Z * 13.0), pose.point(DVec3::Z * -28.0));
        let [x1, y1] = [x_of(plane.across(a)), y_of(a.z)];
        let [x2, y2] = [x_of(plane.across(b)), y_of(b.z)];
        _ = write!(
            svg,
            "<line x1='{x1:.1}' y1='{y1:.1}' x2='{x2:.1}' y2='{y2:.1}' {style}/>"
        );
    };
    line(
        &mut svg,
        &Pose::IDENTITY,
        "stroke='#205090' stroke-width='1.5' stroke-dasharray='6 4'",
    );
    if let Some(pose) = achieved {
        line(&mut svg, pose, "stroke='#c02010' stroke-width='1.5'");
    }
    _ = write!(
        svg,
        "<line x1='20' y1='{0:.1}' x2='{1:.1}' y2='{0:.1}' stroke='#333' stroke-width='2'/>",
        height + 12.0,
        20.0 + 10.0 * PER_MM
    );
    label(
        &mut svg,
        20.0,
        height + 30.0,
        &format!("10 mm · to the right: {axis_name} · up: out of the bone"),
    );
    svg + "</svg>"
}

/// The planned component's back and pegs.
fn outline(
    svg: &mut String,
    target: &Target,
    plane: Plane,
    place: &dyn Fn(f64, f64) -> (f64, f64),
) {
    let c = &target.component;
    let half = 0.5
        * if plane == Plane::Transverse {
            c.width_mm
        } else {
            c.height_mm
        };
    let mut path = String::new();
    for n in -20..=20 {
        let a = half * f64::from(n) / 20.0;
        let (x, y) = place(a, c.back_mm(a.abs()));
        _ = write!(path, "{}{x:.1} {y:.1}", if n == -20 { "M" } else { "L" });
    }
    for peg in &c.pegs {
        let (at, r) = (
            plane.across(DVec3::new(peg.at_mm[0], peg.at_mm[1], 0.0)),
            0.5 * peg.diameter_mm,
        );
        for (n, (a, z)) in [
            (at - r, 0.0),
            (at - r, -peg.length_mm),
            (at + r, -peg.length_mm),
            (at + r, 0.0),
        ]
        .into_iter()
        .enumerate()
        {
            let (x, y) = place(a, z);
            _ = write!(path, "{}{x:.1} {y:.1}", if n == 0 { "M" } else { "L" });
        }
    }
    _ = write!(
        svg,
        "<path d='{path}' fill='none' stroke='#205090' stroke-width='1.2'/>"
    );
}

/// Equal neighbours of a row as one run.
fn runs<T: Copy + PartialEq>(
    lo: f64,
    hi: f64,
    of: impl Fn(f64) -> T,
    mut draw: impl FnMut(f64, f64, T),
) {
    let (mut from, mut kind) = (lo, of(lo));
    let mut at = lo;
    while at < hi {
        let next = of(at);
        if next != kind {
            draw(from, at, kind);
            (from, kind) = (at, next);
        }
        at += SAMPLE_MM;
    }
    draw(from, hi, kind);
}

/// The carved surface over the planned back, seen from outside: blue stands out, red is too deep.
#[expect(clippy::too_many_lines, reason = "a drawing from top to bottom")]
pub(super) fn face_map(target: &Target, cut: &Cut) -> String {
    const HALF_MM: f64 = 20.0;
    const LOOK_MM: f64 = 4.0;
    let sampler = Sampler::new(&target.scene.bone, cut);
    let depth = |p: DVec3| f64::from(sampler.depth(p));
    let inward = target.bone_from_component.vector(-DVec3::Z);
    let c = &target.component;
    // steps of a quarter of a millimetre; None: no bone near
    let level = |x: f64, y: f64| {
        let back = c.back_mm(x.hypot(y));
        let from = target
            .bone_from_component
            .point(DVec3::new(x, y, back + LOOK_MM));
        let t = first_surface(&depth, from, inward, 2.0 * LOOK_MM)?;
        #[expect(clippy::cast_possible_truncation, reason = "within ± 16")]
        let level = ((t - LOOK_MM) / 0.25).round() as i32;
        (t > 0.0).then_some(level.clamp(-8, 8))
    };
    let size = 2.0 * HALF_MM * PER_MM;
    let mut svg = open(size, size + 40.0, "Carved surface over the planned back");
    let mut y = HALF_MM;
    while y > -HALF_MM {
        runs(
            -HALF_MM,
            HALF_MM,
            |x| level(x, y),
            |from, to, level| {
                if let Some(level) = level {
                    let (px, py) = ((from + HALF_MM) * PER_MM, (HALF_MM - y) * PER_MM);
                    let (w, h) = ((to - from) * PER_MM + 0.3, SAMPLE_MM * PER_MM + 0.3);
                    _ = write!(
                        svg,
                        "<rect x='{px:.1}' y='{py:.1}' width='{w:.1}' height='{h:.1}' fill='{}'/>",
                        diverging(level)
                    );
                }
            },
        );
        y -= SAMPLE_MM;
    }
    let (cx, rx, ry) = (
        HALF_MM * PER_MM,
        0.5 * c.width_mm * PER_MM,
        0.5 * c.height_mm * PER_MM,
    );
    _ = write!(
        svg,
        "<ellipse cx='{cx:.1}' cy='{cx:.1}' rx='{rx:.1}' ry='{ry:.1}' fill='none' stroke='#205090' stroke-width='1.5'/>"
    );
    for (n, level) in (-8..=8).step_by(4).enumerate() {
        let x = 10.0 + 62.0 * n as f64;
        _ = write!(
            svg,
            "<rect x='{x:.1}' y='{:.1}' width='14' height='14' fill='{}'/>",
            size + 8.0,
            diverging(level)
        );
        label(
            &mut svg,
            x + 17.0,
            size + 20.0,
            &format!("{:+.0} mm", f64::from(level) * 0.25),
        );
    }
    label(
        &mut svg,
        10.0,
        size + 36.0,
        "deeper than planned positive; superior up; outline: the component",
    );
    svg + "</svg>"
}

/// Colour of a step from −8 to 8: blue, white, red.
fn diverging(level: i32) -> String {
    let t = f64::from(level) / 8.0;
    let fade = |away: f64| (235.0 * (1.0 - away.clamp(0.0, 1.0))).round();
    if t >= 0.0 {
        format!("rgb(235,{0},{0})", fade(t))
    } else {
        format!("rgb({0},{0},235)", fade(-t))
    }
}

/// A curve over time with its events.
#[expect(clippy::too_many_lines, reason = "a drawing from top to bottom")]
pub(super) fn curve(
    trace: &SessionTrace,
    (title, unit): (&str, &str),
    events: &[(f64, String)],
    value: impl Fn(&TraceTick) -> f64,
    worse: impl Fn(f64, f64) -> f64,
) -> String {
    const SIZE: [f64; 2] = [900.0, 260.0];
    const LEFT: f64 = 60.0;
    const BOTTOM: f64 = 40.0;
    let end = trace
        .ticks
        .last()
        .map_or(1.0, |t| trace.seconds(t.tick))
        .max(1e-3);
    let mut bins: Vec<Option<f64>> = vec![None; BINS];
    for tick in &trace.ticks {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a few hundred bins"
        )]
        let at = ((trace.seconds(tick.tick) / end * BINS as f64) as usize).min(BINS - 1);
        let v = value(tick);
        bins[at] = Some(bins[at].map_or(v, |old| worse(old, v)));
    }
    let shown = bins.iter().flatten().copied();
    let (lo, hi) = shown.fold((0.0_f64, 0.0_f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
    let span = (hi - lo).max(1e-6);
    let x_of = |s: f64| LEFT + s / end * (SIZE[0] - LEFT - 10.0);
    let y_of = |v: f64| 24.0 + (hi - v) / span * (SIZE[1] - BOTTOM - 24.0);
    let mut svg = open(SIZE[0], SIZE[1], title);
    for n in 0..=4 {
        let v = lo + span * f64::from(n) / 4.0;
        _ = write!(
            svg,
            "<line x1='{LEFT}' y1='{0:.1}' x2='{1}' y2='{0:.1}' stroke='#ddd'/>",
            y_of(v),
            SIZE[0] - 10.0
        );
        label(&mut svg, 4.0, y_of(v) + 4.0, &format!("{v:.1} {unit}"));
    }
    for n in 0..=6 {
        let s = end * f64::from(n) / 6.0;
        label(
            &mut svg,
            x_of(s) - 12.0,
            SIZE[1] - 22.0,
            &format!("{s:.1} s"),
        );
    }
    let mut path = String::new();
    for (n, v) in bins
        .iter()
        .enumerate()
        .filter_map(|(n, v)| Some((n, (*v)?)))
    {
        let x = x_of(end * (n as f64 + 0.5) / BINS as f64);
        _ = write!(
            path,
            "{}{x:.1} {:.1}",
            if path.is_empty() { "M" } else { "L" },
            y_of(v)
        );
    }
    _ = write!(
        svg,
        "<path d='{path}' fill='none' stroke='#205090' stroke-width='1.3'/>"
    );
    for (n, (s, what)) in events.iter().enumerate() {
        let x = x_of(*s);
        _ = write!(
            svg,
            "<line x1='{x:.1}' y1='24' x2='{x:.1}' y2='{:.1}' stroke='#c02010' stroke-dasharray='3 3'/>",
            SIZE[1] - BOTTOM
        );
        let y = 34.0 + 13.0 * (n % 4) as f64;
        if x > 0.75 * SIZE[0] {
            let text = escaped(what);
            _ = write!(
                svg,
                "<text x='{:.1}' y='{y:.1}' fill='#333' text-anchor='end'>{text}</text>",
                x - 3.0
            );
        } else {
            label(&mut svg, x + 3.0, y, what);
        }
    }
    svg + "</svg>"
}

fn open(width: f64, height: f64, title: &str) -> String {
    format!(
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width:.0} {height:.0}' width='{width:.0}' height='{height:.0}' font-family='sans-serif' font-size='12'><title>{}</title><rect width='100%' height='100%' fill='white'/>",
        escaped(title)
    )
}

fn label(svg: &mut String, x: f64, y: f64, text: &str) {
    _ = write!(
        svg,
        "<text x='{x:.1}' y='{y:.1}' fill='#333'>{}</text>",
        escaped(text)
    );
}

/// Text that is safe in HTML and SVG.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('\'', "&#39;")
        .replace('"', "&quot;")
}
