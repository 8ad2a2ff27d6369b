//! A press against the face: the manoeuvre that the stability limits are measured with.

use super::bench::Bench;
use super::setup::Spec;
use super::trace::swing_mm;
use glam::DVec3;

/// Steady push, N.
pub const PUSH_N: f64 = 0.9;
/// Speed at which the face is met, mm/s.
pub const ENTRY_MM_S: f64 = 100.0;
/// A press that swings less than twice the encoders' step has settled, mm.
pub const SETTLED_MM: f64 = 0.11;
/// The face bears the push up to this, N: Coulomb friction and the servo's damping.
const BORNE_N: f64 = 0.15;
/// Height above the face at which the hand takes over, mm.
const HANDOVER_MM: f64 = 0.02;

/// Brings a bench that has run in down to the face at `entry_mm_s` and leaves the device to its hand.
pub fn meet(bench: &mut Bench, entry_mm_s: f64) {
    bench.glide(DVec3::Z * HANDOVER_MM, entry_mm_s);
    bench.trace.clear();
    bench.plant.velocity_mm_s = DVec3::Z * -entry_mm_s;
}

/// Lets the hand push with `push_n` when it has come to rest on a face of stiffness
/// `stiffness_n_per_mm`: its spring's target goes there at `speed_mm_s`, or the push is constant where
/// there is no spring.
pub fn push(bench: &mut Bench, push_n: f64, stiffness_n_per_mm: f64, speed_mm_s: f64) {
    let spring = bench.hand.stiffness_n_per_m * 1e-3;
    if spring > 0.0 {
        let depth = push_n / stiffness_n_per_mm + push_n / spring;
        bench.goal = Some((DVec3::Z * -depth, speed_mm_s));
    } else {
        bench.pull.push_n = DVec3::Z * -push_n;
    }
}

/// A press of [`PUSH_N`] that met the face at [`ENTRY_MM_S`], `seconds` after it did.
pub fn pressed(spec: &Spec, seconds: f64) -> Bench {
    after(spec, Bench::new(spec), seconds)
}

/// The same against the linear wall.
pub fn pressed_wall(spec: &Spec, seconds: f64) -> Bench {
    after(spec, Bench::with_wall(spec), seconds)
}

fn after(spec: &Spec, mut bench: Bench, seconds: f64) -> Bench {
    bench.run_in();
    meet(&mut bench, ENTRY_MM_S);
    let stiffness = spec.feel.coupling.stiffness_n_per_mm;
    push(&mut bench, PUSH_N, stiffness, ENTRY_MM_S);
    bench.run(seconds);
    bench
}

/// Whether the face bore the push in the last second: a press that fell through is still, too.
pub fn borne(bench: &Bench) -> bool {
    let last = bench.trace.last(1.0);
    let force: f64 = last.iter().map(|r| r.force_n.z).sum();
    let mean = force / last.len().max(1) as f64;
    bench.plant.stops == 0 && (mean - PUSH_N).abs() <= BORNE_N
}

/// Whether the last second of a press is still, and the push borne.
pub fn settled(bench: &Bench) -> bool {
    borne(bench) && swing_mm(bench.trace.last(1.0)) <= SETTLED_MM
}
