//! Sliding: cases 7 to 10.

use super::super::device::FINE;
use super::super::guided::Guided;
use super::super::ripple::{TILTS_DEG, VOXELS_MM, slide};
use super::super::setup::{Scene, Slab, Spec, ball, bone_of};
use super::{Case, Worst};
use glam::{DQuat, DVec3};
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::TickOutput;
use rayon::prelude::*;

/// Forces below this have no direction worth a word, N.
const FELT_N: f64 = 0.02;

/// A wedge with an edge along y, or a cube's corner, its edge or corner at the base's origin.
pub(in super::super) fn sharp(angle_deg: f64, corner: bool) -> Scene {
    let top = DVec3::new(12.01, 12.02, 12.03);
    let half = (0.5 * angle_deg).to_radians();
    let (c, s) = (half.cos(), half.sin());
    let axis = DVec3::ONE / 3f64.sqrt();
    let turn = DQuat::from_rotation_arc(axis, DVec3::Z);
    let bone = bone_of(DVec3::splat(24.0), DVec3::splat(0.5), 1.9, |p| {
        let p = p - top;
        if corner {
            let faces = [DVec3::X, DVec3::Y, DVec3::Z].map(|n| -(turn * n).dot(p));
            faces.into_iter().fold(f64::INFINITY, f64::min)
        } else {
            // a flank's outward normal is (±cos, 0, sin)
            -(p.x.abs() * c + p.z * s)
        }
    });
    Scene {
        bone,
        bone_from_base: Pose::new(DQuat::IDENTITY, top),
        tools: vec![ball(3.0)],
    }
}

/// Largest change of the force in a tick, N, and of its direction, degrees, on a way across at 20 mm/s.
pub(in super::super) fn crossed(scene: Scene, y_mm: f64, depth_mm: f64) -> (f64, f64) {
    let mut spec = Spec::at(scene);
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 8.0, false);
    guided.glide(DVec3::new(-6.0, y_mm, 3.0), 50.0);
    guided.glide(DVec3::new(-6.0, y_mm, -depth_mm), 20.0);
    let (mut last, mut step, mut turn) = (guided.force_n(), 0.0f64, 0.0f64);
    guided.glide_seen(DVec3::new(6.0, y_mm, -depth_mm), 20.0, |g| {
        let force = g.force_n();
        step = step.max((force - last).length());
        if force.length() > FELT_N && last.length() > FELT_N {
            turn = turn.max(force.angle_between(last).to_degrees());
        }
        last = force;
    });
    (step, turn)
}

/// Case 7.
pub(super) fn edges() -> Case {
    let [step, turn] = edges_at(&[0.1, 0.3, 1.0]);
    Case {
        id: 7,
        name: "Edges and corners",
        criterion: "a ball of 3 mm at 20 mm/s across edges of 90° and 30° and a cube's corner, the device 0.1 to 1 mm below: the \
                    force changes ≤ 0.3 N and turns ≤ 15° in a tick"
            .to_owned(),
        measured: format!("{}; {}", step.words("N"), turn.words("°")),
        pass: step.value <= 0.3 && turn.value <= 15.0,
    }
}

/// Largest step, N, and turn, degrees, of the force in a tick across the edges and corners of case 7, the
/// device at these depths, mm.
pub(in super::super) fn edges_at(depths_mm: &[f64]) -> [Worst; 2] {
    let mut all = Vec::new();
    for &depth in depths_mm {
        all.push(("edge of 90°", sharp(90.0, false), 0.0, depth));
        all.push(("edge of 30°", sharp(30.0, false), 0.0, depth));
        all.push(("corner", sharp(90.0, true), 0.0, depth));
        all.push(("beside the corner", sharp(90.0, true), 0.3, depth));
    }
    let found: Vec<_> = all
        .into_par_iter()
        .map(|(name, scene, y, depth)| (name, depth, crossed(scene, y, depth)))
        .collect();
    let (mut step, mut turn) = (Worst::default(), Worst::default());
    for (name, depth, (n, degrees)) in found {
        let place = || format!("{name}, {depth} mm deep");
        step.note(n, place);
        turn.note(degrees, place);
    }
    [step, turn]
}

/// Case 8.
pub(super) fn oblique() -> Case {
    let all: Vec<(f64, f64)> = VOXELS_MM
        .into_iter()
        .flat_map(|voxel| TILTS_DEG.map(|tilt| (voxel, tilt)))
        .collect();
    let rows: Vec<_> = all
        .into_par_iter()
        .map(|(voxel, tilt)| slide(voxel, tilt))
        .collect();
    let (mut normal, mut along) = (Worst::default(), Worst::default());
    for row in rows {
        let place = || format!("{} mm, {}°", row.voxel_mm, row.tilt_deg);
        normal.note(100.0 * row.ripple_rms, place);
        along.note(100.0 * row.tangential_rms, place);
    }
    Case {
        id: 8,
        name: "Oblique planes",
        criterion: "20 mm over planes at 7°, 20° and 35.26°, voxels of 1 and 0.5 mm: the normal force ripples ≤ 1 %, the \
                    tangential ≤ 0.5 % of it (RMS)"
            .to_owned(),
        measured: format!("normal {}; tangential {}", normal.words("%"), along.words("%")),
        pass: normal.value <= 1.0 && along.value <= 0.5,
    }
}

/// Slides across x = 24 mm of the lattice or, all moved by `moved_voxels`, across no chunk's border.
fn across_a_border(moved_voxels: u32) -> (Vec<TickOutput>, f64) {
    let h = 0.25;
    let moved = f64::from(moved_voxels) * h;
    let face = DVec3::new(23.75 + moved, 6.02, 6.03);
    let bone = bone_of(DVec3::new(36.0, 12.0, 9.0), DVec3::splat(h), 1.9, |p| {
        face.z - p.z
    });
    let mut spec = Spec::at(Scene {
        bone,
        bone_from_base: Pose::new(DQuat::IDENTITY, face),
        tools: vec![ball(2.0)],
    });
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 6.0, false);
    guided.glide(DVec3::new(-1.25, 0.0, 1.0), 50.0);
    guided.glide(DVec3::new(-1.25, 0.0, -0.5), 20.0);
    let mut outputs = Vec::new();
    guided.glide_seen(DVec3::new(1.25, 0.0, -0.5), 10.0, |g| {
        outputs.push(g.output);
    });
    (outputs, moved)
}

/// Case 9.
pub(super) fn chunk_borders() -> Case {
    let (here, _) = across_a_border(0);
    let (there, moved) = across_a_border(16);
    let pairs = || here.iter().zip(&there);
    let differ = pairs().filter(|(a, b)| a.force_n != b.force_n || a.torque != b.torque);
    let differ = differ.count();
    let off = pairs().map(|(a, b)| {
        let shift = b.bone_from_tool.translation - a.bone_from_tool.translation;
        (shift - DVec3::X * moved).length()
    });
    let off = off.fold(0.0, f64::max);
    let span = pairs().map(|(a, _)| a.bone_from_tool.translation.x);
    let (lo, hi) = span.fold((f64::MAX, f64::MIN), |(lo, hi), x| (lo.min(x), hi.max(x)));
    Case {
        id: 9,
        name: "Chunk borders",
        criterion: "sliding across a chunk's border gives the same force, bit for bit, as without one. There is no lattice without \
                    chunks to compare with, so the whole scene is moved by 16 voxels, to where the same way crosses none (by an \
                    amount and in a range in which adding it rounds nothing)"
            .to_owned(),
        measured: format!(
            "x from {lo:.2} to {hi:.2} mm with a border at 24 mm; {differ} of {} ticks differ; places differ by {off:.1e} mm",
            here.len()
        ),
        pass: differ == 0 && off <= 0.0 && lo < 23.0 && hi > 24.5 && here.len() > 200,
    }
}

/// Contact made or lost per mm, and the least force along the normal, N.
fn grazed(tilt_deg: f64) -> (f64, f64) {
    let slab = Slab {
        extent_mm: DVec3::new(40.0, 20.0, 40.0),
        tilt_deg,
        ..Slab::default()
    };
    let mut spec = Spec::at(slab.scene(vec![ball(3.0)]));
    spec.scale = FINE;
    let mut guided = Guided::new(&spec, DVec3::Z * 8.0, false);
    guided.glide(DVec3::new(-10.0, 0.0, 1.0), 50.0);
    guided.glide(DVec3::new(-10.0, 0.0, -0.01), 5.0);
    let (mut made, mut least, mut touching) = (0u32, f64::MAX, true);
    guided.glide_seen(DVec3::new(10.0, 0.0, -0.01), 20.0, |g| {
        let now = g.force_n() != DVec3::ZERO;
        made += u32::from(now != touching);
        touching = now;
        least = least.min(g.force_n().z);
    });
    (f64::from(made) / 20.0, least)
}

/// Case 10.
pub(super) fn grazing() -> Case {
    let tilts = [0.0, 7.0, 20.0, 35.26];
    let rows: Vec<_> = tilts
        .into_par_iter()
        .map(|tilt| (tilt, grazed(tilt)))
        .collect();
    let (mut made, mut least) = (Worst::default(), f64::MAX);
    for (tilt, (per_mm, force)) in rows {
        made.note(per_mm, || format!("{tilt}°"));
        least = least.min(force);
    }
    Case {
        id: 10,
        name: "Grazing",
        criterion: "20 mm over a smooth plane at 0°, 7°, 20° and 35.26°, the device 0.01 mm below: the normal force is never \
                    negative; contact is made or lost ≤ 2 times a mm"
            .to_owned(),
        measured: format!("least force {least:.4} N; changes {}", made.words("per mm")),
        pass: least >= 0.0 && made.value <= 2.0,
    }
}
