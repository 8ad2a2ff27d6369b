//! The solver against random problems and against what is known of them.
#![expect(clippy::print_stdout, reason = "a test that shows its figures")]

use super::super::{Resistance, Term};
use super::*;
use crate::contact::RIGID_N_PER_MM3;
use glam::DVec3;

/// A seeded generator (`SplitMix64`).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.next()
    }

    fn log(&mut self, lo: f64, hi: f64) -> f64 {
        lo * (hi / lo).powf(self.next())
    }

    fn vector(&mut self, size: f64) -> DVec3 {
        let mut part = || self.within(-size, size);
        DVec3::new(part(), part(), part())
    }

    fn unit(&mut self) -> DVec3 {
        loop {
            let v = self.vector(1.0);
            if v.length() > 0.1 && v.length() < 1.0 {
                return v / v.length();
            }
        }
    }
}

fn law(yield_n: f64, viscous: f64) -> Resistance {
    Resistance {
        yield_n_per_mm2: yield_n,
        viscous_n_s_per_mm3: viscous,
        energy_n_per_mm2: 40.0,
        edge_nmm_per_mm2: 0.0,
        vibration: 0.0,
    }
}

/// A tool of up to 60 elements in a mixture of bone: cutting, rigid, wedged, near and far, of every
/// hardness that the ranges of the parameters allow.
fn problem(random: &mut Random) -> (Terms, Coupling) {
    let mut terms = Terms::new();
    let count = 1.0 + random.next() * random.next() * 60.0;
    let around = random.unit();
    let scatter = random.log(0.05, 3.0);
    let hard = random.log(1e-5, 0.5);
    let thick = random.log(1e-6, 1.0);
    let kind = random.next();
    let rigid_share = if kind < 0.5 {
        0.0
    } else if kind < 0.75 {
        0.3
    } else {
        1.0
    };
    let mut n = 0.0;
    while n < count {
        n += 1.0;
        let normal = (around + random.vector(scatter)).try_normalize();
        let normal = normal.unwrap_or(around);
        let arm = random.vector(20.0);
        let area = random.within(0.05, 5.0);
        let rigid = random.next() < rigid_share;
        let gap = if random.next() < 0.6 {
            0.0
        } else {
            random.within(0.0, 0.3)
        };
        let depth = random.within(-0.2, 0.05);
        terms.push(&Term {
            normal,
            lever: arm.cross(normal) / 30.0,
            offset: if rigid { depth } else { -gap },
            cut: (!rigid).then(|| (area, law(hard * random.next(), thick * random.next()))),
            rigid: if rigid { area * RIGID_N_PER_MM3 } else { 0.0 },
        });
    }
    terms.set_time(1e-3);
    let far = random.log(1e-3, 40.0);
    let error = Motion {
        shift: random.unit() * far,
        turn: random.unit() * random.log(1e-3, 15.0),
    };
    let limit = random.log(0.05, 3.3);
    let coupling = Coupling::new(error, random.within(0.05, 0.7), limit, 0.5);
    (terms, coupling)
}

/// Energy of terms and coupling after a motion, N·mm.
fn energy(terms: &mut Terms, coupling: &Coupling, motion: &Motion) -> f64 {
    terms.place(motion);
    coupling.energy(motion) + terms.energy_here()
}

#[test]
fn a_hundred_thousand_random_problems_are_solved_and_none_gives_work() {
    let mut random = Random(4);
    let (mut worst, mut most, mut sum) = (0.0f64, 0, 0u64);
    let count = 120_000;
    let mut negative = 0;
    for _ in 0..count {
        let (mut terms, coupling) = problem(&mut random);
        let solution = minimum(&mut terms, &coupling, &Motion::ZERO);
        worst = worst.max(solution.residual_n);
        most = most.max(solution.iterations);
        sum += u64::from(solution.iterations);
        // what the hand puts into cutting elements
        terms.place(&solution.motion);
        negative += u32::from(terms.deed().hand_mj < 0.0);
        // the energy at the minimum is not above that of rest, nor of a nudge in any direction
        let mut total = |m: &Motion| energy(&mut terms, &coupling, m);
        let here = total(&solution.motion);
        assert!(here <= total(&Motion::ZERO) + 1e-12);
        let nudge = Motion {
            shift: random.vector(1e-3),
            turn: random.vector(1e-3),
        };
        assert!(here <= total(&(solution.motion + nudge)) + 1e-7);
    }
    let mean = sum as f64 / f64::from(count);
    println!(
        "{count} problems: residual ≤ {worst:.1e} N, {mean:.2} iterations in the mean, {most} at most"
    );
    assert!(worst <= 1e-4, "{worst}");
    assert_eq!(negative, 0);
}

#[test]
fn a_guess_changes_the_way_and_not_the_end() {
    let mut random = Random(5);
    for _ in 0..5000 {
        let (mut terms, coupling) = problem(&mut random);
        let plain = minimum(&mut terms, &coupling, &Motion::ZERO);
        let guess = Motion {
            shift: random.vector(0.3),
            turn: random.vector(0.3),
        };
        let guessed = minimum(&mut terms, &coupling, &guess);
        let mut total = |m: &Motion| energy(&mut terms, &coupling, m);
        assert!((total(&plain.motion) - total(&guessed.motion)).abs() < 1e-6);
        let wrong = Motion {
            shift: DVec3::NAN,
            turn: DVec3::ZERO,
        };
        assert_eq!(minimum(&mut terms, &coupling, &wrong), plain);
    }
}

#[test]
fn a_single_face_is_a_bingham_medium() {
    // pull F on area 1: v = (F − Y)/c, and nothing below Y
    for (pull, expected) in [(0.05, 0.0), (0.2, (0.2 - 0.1) / 50.0)] {
        let mut terms = Terms::new();
        terms.push(&Term {
            normal: DVec3::NEG_Z,
            lever: DVec3::ZERO,
            offset: 0.0,
            cut: Some((1.0, law(0.1, 0.05))),
            rigid: 0.0,
        });
        terms.set_time(1e-3);
        let error = Motion {
            shift: DVec3::NEG_Z * pull / 0.5,
            turn: DVec3::ZERO,
        };
        let coupling = Coupling::new(error, 0.5, 3.3, 0.5);
        let solution = minimum(&mut terms, &coupling, &Motion::ZERO);
        // the spring gives way by K δ
        let exact = expected * 50.0 / 50.5;
        assert!(
            (-solution.motion.shift.z - exact).abs() < 2e-6,
            "{solution:?}"
        );
    }
}
