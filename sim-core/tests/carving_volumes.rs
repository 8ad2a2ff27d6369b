//! The closed forms of removed volume, at 0.5 mm, in planes and balls of bone at random attitudes.

#![expect(
    clippy::print_stdout,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::expect_used,
    reason = "a test that shows its figures; radii are f32"
)]

mod common;

use common::bone_of;
use common::random::{Random, tool_of};
use glam::{DQuat, DVec3};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tool::Tool;
use osteon_sim_core::tool::revolved::{Face, Form, Part, Revolved};
use std::f64::consts::PI;
use std::sync::Arc;

const H: f64 = 0.5;
const R: f64 = 6.0;

/// A bone and the frame in which a form is written: its origin in the middle, z out of the bone.
struct Scene {
    bone: Arc<Bone>,
    frame: Pose,
}

/// A cube of `edge` mm at attitude `n`; `sd` (positive inside bone) is of the frame.
fn scene(n: u64, edge: f64, sd: impl Fn(DVec3) -> f64) -> Scene {
    let mut random = Random(100 + n);
    let middle = DVec3::splat(0.5 * edge) + random.vector(0.5 * H);
    let frame = Pose::new(random.rotation(), middle);
    let count = (edge / H) as usize + 1;
    let to_frame = frame.inverse();
    let bone = bone_of([count; 3], DVec3::splat(H), 1.0, |p| sd(to_frame.point(p)));
    Scene { bone, frame }
}

impl Scene {
    /// Sweeps a tool along `path`, its start included, in `steps` steps; volume so far.
    fn sweep(&self, cut: &mut Cut, tool: &Tool, steps: u32, path: impl Fn(f64) -> Pose) -> f64 {
        let at = |n: u32| self.frame.then(&path(f64::from(n) / f64::from(steps)));
        for n in 0..=steps {
            let step = CarveStep {
                tool: 2,
                before: at(n.saturating_sub(1)),
                after: at(n),
            };
            carve(&self.bone, cut, tool, &step, &mut |_, _| {});
        }
        Cut::mm3(self.bone.grid(), cut.totals().units())
    }
}

fn shifted(p: DVec3) -> Pose {
    Pose::new(DQuat::IDENTITY, p)
}

fn ball() -> Tool {
    tool_of(Revolved::ball(R as f32))
}

/// A flat-ended cylinder from `low` to `high`.
fn cylinder(radius: f32, low: f32, high: f32) -> Tool {
    let plane = |height_mm, up| Form::Plane { height_mm, up };
    let faces = [Form::cylinder(radius), plane(low, false), plane(high, true)];
    let face = |form| Face {
        form,
        cutting: true,
    };
    let faces = faces.into_iter().map(face).collect();
    tool_of(Revolved::new(vec![Part { faces }]).expect("closed"))
}

/// What the sharp edges that a cut leaves on the bone may lose in the account, h² a millimetre.
const EDGE: f64 = 0.1;

/// Volume that `mm` of sharp edges may lose.
fn edges(mm: f64) -> f64 {
    EDGE * H * H * mm
}

/// What the account counts too much on a cut's faces (`bone::Occupancy`): κh²/24 by its ramp, and what
/// the carved face is grown by. Areas: of balls of radius `r`, of walls that a ball of that radius
/// draws, and of cylinders.
fn counted_more(r: f64, [ball, drawn, cylinder]: [f64; 3]) -> f64 {
    let ramp = |kappa: f64| H * H * kappa / 24.0;
    let grown = |kappa: f64| H * H * kappa / 12.0;
    ball * (ramp(2.0 / r) + grown(2.0 / r))
        + drawn * (ramp(1.0 / r) + grown(2.0 / r))
        + cylinder * (ramp(1.0 / r) + grown(1.0 / r))
}

/// Mean and worst relative error over six attitudes, printed, less what is counted too much; within 1 and
/// 2 thousandths beyond a volume that edges may cost.
fn check(name: &str, (truth, more, blunt): (f64, f64, f64), measure: impl Fn(u64) -> f64) {
    println!("{name}: counted {:.2e} too much by its rule", more / truth);
    let errors: Vec<f64> = (0..6).map(|n| (measure(n) - more) / truth - 1.0).collect();
    let average = errors.iter().sum::<f64>() / 6.0;
    let largest = errors.iter().fold(0.0f64, |m, e| m.max(e.abs()));
    let edge = blunt / truth;
    println!("{name}: {truth:.2} mm3, mean {average:+.2e}, worst {largest:.2e} (edges {edge:.2e})");
    assert!(average.abs() <= 1e-3 + edge, "{name}: mean {average}");
    assert!(largest <= 2e-3 + edge, "{name}: worst {largest}");
}

fn cap(radius: f64, depth: f64) -> f64 {
    PI * depth * depth * (radius - depth / 3.0)
}

fn full(_: DVec3) -> f64 {
    9.0
}

fn half_space(p: DVec3) -> f64 {
    -p.z
}

#[test]
fn forms_1_3_8_9_ball_capsule_two_balls_and_an_arm_in_solid_bone() {
    let whole = 4.0 / 3.0 * PI * R.powi(3);
    let once = |s: &Scene, at: DVec3, cut: &mut Cut| s.sweep(cut, &ball(), 1, |_| shifted(at));
    let round = 4.0 * PI * R * R;
    let more = counted_more(R, [round, 0.0, 0.0]);
    check("1 ball", (whole, more, 0.0), |n| {
        let s = scene(n, 18.0, full);
        once(&s, DVec3::ZERO, &mut Cut::new(&s.bone))
    });
    let length = 14.0;
    let capsule = whole + PI * R * R * length;
    let more = counted_more(R, [round, 2.0 * PI * R * length, 0.0]);
    check("3 capsule", (capsule, more, 0.0), |n| {
        let s = scene(n, 32.0, full);
        let path = |t: f64| shifted(DVec3::X * length * (t - 0.5));
        s.sweep(&mut Cut::new(&s.bone), &ball(), 5, path)
    });
    let w = 5.0;
    let two = 2.0 * whole - PI * (4.0 * R + w) * (2.0 * R - w).powi(2) / 12.0;
    let left = 2.0 * (round - 2.0 * PI * R * (R - 0.5 * w));
    let more = counted_more(R, [left, 0.0, 0.0]);
    check("8 two balls", (two, more, 0.0), |n| {
        let s = scene(n, 24.0, full);
        let mut cut = Cut::new(&s.bone);
        once(&s, DVec3::X * -0.5 * w, &mut cut);
        once(&s, DVec3::X * 0.5 * w, &mut cut)
    });
    let (arm, turn) = (9.0, 1.5f64);
    let pappus = whole + arm * turn * PI * R * R;
    let more = counted_more(R, [round, 2.0 * PI * R * arm * turn, 0.0]);
    check("9 arm", (pappus, more, 0.0), |n| {
        let s = scene(n, 32.0, full);
        let place = |t: f64| {
            let q = DQuat::from_rotation_z(turn * (t - 0.5));
            Pose::new(q, q * (DVec3::X * arm) - DVec3::X * 0.8 * arm)
        };
        s.sweep(&mut Cut::new(&s.bone), &ball(), 40, place)
    });
}

#[test]
fn forms_2_and_4_plunge_and_groove_of_a_ball() {
    let depth = 2.0;
    let rim = 2.0 * PI * (2.0 * R * depth - depth * depth).sqrt();
    let face = 2.0 * PI * R * depth;
    let more = counted_more(R, [face, 0.0, 0.0]);
    check("2 plunge", (cap(R, depth), more, edges(rim)), |n| {
        let s = scene(n, 24.0, half_space);
        let path = |t: f64| shifted(DVec3::Z * (R - depth * t));
        s.sweep(&mut Cut::new(&s.bone), &ball(), 2, path)
    });
    let length = 12.0;
    let across =
        R * R * ((R - depth) / R).acos() - (R - depth) * (2.0 * R * depth - depth * depth).sqrt();
    let groove = cap(R, depth) + length * across;
    let wall = 2.0 * R * ((R - depth) / R).acos() * length;
    let more = counted_more(R, [face, wall, 0.0]);
    check("4 groove", (groove, more, edges(rim + 2.0 * length)), |n| {
        let s = scene(n, 38.0, half_space);
        let path = |t: f64| shifted(DVec3::new(length * (t - 0.5), 0.0, R - depth));
        s.sweep(&mut Cut::new(&s.bone), &ball(), 5, path)
    });
}

#[test]
fn forms_5_and_6_flat_and_domed_ends() {
    let (r, depth, length) = (5.0, 3.0, 8.0);
    let tool = cylinder(r as f32, 0.0, 20.0);
    let more = counted_more(r, [0.0, 0.0, 2.0 * PI * r * depth]);
    let truth = PI * r * r * depth;
    check("5 plunge", (truth, more, edges(2.0 * PI * r)), |n| {
        let s = scene(n, 24.0, half_space);
        let path = |t: f64| shifted(DVec3::Z * -depth * t);
        s.sweep(&mut Cut::new(&s.bone), &tool, 4, path)
    });
    let slot = (2.0 * r * length + PI * r * r) * depth;
    // its flat walls are grown like the cylinder that draws them
    let more = more + 2.0 * length * depth * H * H / (12.0 * r);
    let edge = edges(2.0 * (PI * r + length));
    check("5 slot", (slot, more, edge), |n| {
        let s = scene(n, 34.0, half_space);
        let path = |t: f64| shifted(DVec3::new(length * (t - 0.5), 0.0, -depth));
        s.sweep(&mut Cut::new(&s.bone), &tool, 6, path)
    });
    let (sphere, body) = (10.0f64, 8.0f64);
    let rim = sphere - (sphere * sphere - body * body).sqrt();
    let reamer = tool_of(Revolved::dome([body as f32, sphere as f32, 16.0]));
    for depth in [2.0, 6.0] {
        let truth = if depth <= rim {
            cap(sphere, depth)
        } else {
            cap(sphere, rim) + PI * body * body * (depth - rim)
        };
        let more = counted_more(sphere, [2.0 * PI * sphere * depth.min(rim), 0.0, 0.0])
            + counted_more(body, [0.0, 0.0, 2.0 * PI * body * (depth - rim).max(0.0)]);
        check("6 dome", (truth, more, edges(2.0 * PI * body)), |n| {
            let s = scene(n, 30.0, half_space);
            let path = |t: f64| shifted(DVec3::Z * -depth * t);
            s.sweep(&mut Cut::new(&s.bone), &reamer, 4, path)
        });
    }
}

#[test]
fn form_7_a_ball_into_a_ball_and_into_a_socket() {
    let (b, d) = (10.0, 13.0);
    let foot = (d * d + R * R - b * b) / (2.0 * d);
    let rim = 2.0 * PI * (R * R - foot * foot).sqrt();
    let top = (R + b - d).powi(2);
    let lens =
        PI * top * (d * d + 2.0 * d * b - 3.0 * b * b + 2.0 * d * R - 3.0 * R * R + 6.0 * R * b)
            / (12.0 * d);
    let at = |s: &Scene| s.sweep(&mut Cut::new(&s.bone), &ball(), 1, |_| shifted(DVec3::ZERO));
    // the middle of the other ball lies below
    // the bone's own face is not grown; counting it is off by its ramp alone
    let own = 2.0 * PI * b * (b - (d - foot)) * H * H * (2.0 / b) / 24.0;
    let inner = 2.0 * PI * R * (R - foot);
    let more = counted_more(R, [inner, 0.0, 0.0]) + own;
    check("7 convex", (lens, more, edges(rim)), |n| {
        at(&scene(n, 24.0, |p| b - (p + DVec3::Z * d).length()))
    });
    let socket = 4.0 / 3.0 * PI * R.powi(3) - lens;
    // its edge is acute: it loses more
    let more = counted_more(R, [4.0 * PI * R * R - inner, 0.0, 0.0]) - own;
    check("7 socket", (socket, more, edges(2.5 * rim)), |n| {
        at(&scene(n, 24.0, |p| (p + DVec3::Z * d).length() - b))
    });
}

/// Volume that a cylinder (radius, length) sweeps as it is tilted by `th` about its middle.
fn tilted(r: f64, length: f64, th: f64) -> f64 {
    let a = 0.5 * length;
    let count = 1500u32;
    let mut sum = 0.0;
    for i in 0..count {
        // y = r sin u, so that w = r cos u and no root is steep at an end
        let u = PI * ((f64::from(i) + 0.5) / f64::from(count) - 0.5);
        let w = r * u.cos();
        let far = a.hypot(w);
        for j in 0..count {
            let rho = far * (f64::from(j) + 0.5) / f64::from(count);
            let w1 = (w / rho).min(1.0).asin();
            let covered = if rho <= w {
                2.0 * PI
            } else if rho <= a {
                4.0 * w1 + 2.0 * th
            } else {
                let w0 = (a / rho).acos();
                2.0 * (2.0 * (w1 - w0) + 2.0 * th).min(2.0 * w1 + th)
            };
            let weight = far / f64::from(count) * PI / f64::from(count) * r * u.cos();
            sum += weight * rho * covered.min(2.0 * PI);
        }
    }
    sum
}

#[test]
fn form_10_a_cylinder_that_is_tilted() {
    let (r, length, th) = (3.0, 20.0, 0.6);
    let truth = tilted(r, length, th);
    println!("10: {truth:.2} mm3");
    let tool = cylinder(3.0, -10.0, 10.0);
    // the ends are drawn by a rim alone, which is read blunted: 0.12 h on the way of both rims
    let drawn = 2.0 * (2.0 * r) * (0.5 * length * th);
    // half a cylinder's side to either hand of the axis is left; the rest is drawn over
    let more = counted_more(r, [0.0, 0.0, 2.0 * PI * r * length]);
    check("10 tilt", (truth, more, 0.12 * H * drawn), |n| {
        let s = scene(n, 32.0, full);
        let path = |t: f64| Pose::new(DQuat::from_rotation_x(th * (t - 0.5)), DVec3::ZERO);
        s.sweep(&mut Cut::new(&s.bone), &tool, 6, path)
    });
}

#[test]
fn form_11_again_removes_nothing() {
    let s = scene(0, 24.0, half_space);
    let mut cut = Cut::new(&s.bone);
    let path = |t: f64| shifted(DVec3::Z * (R - 2.0 * t));
    let first = s.sweep(&mut cut, &ball(), 4, path);
    let digest = cut.digest(&s.bone).hash;
    let units = cut.totals().units();
    let revision = cut.revision();
    for _ in 0..3 {
        s.sweep(&mut cut, &ball(), 4, path);
    }
    assert!(first > 0.0);
    assert_eq!(cut.totals().units() - units, 0);
    cut.set_revision(revision);
    assert_eq!(cut.digest(&s.bone).hash, digest);
}
