//! What each term of the cutting law and of the contact is for: one figure with it and without it.

use super::super::cases::cutting::joint;
use super::super::cases::sliding::{crossed, sharp};
use super::super::device::FINE;
use super::super::feed::{Faced, Law, seated_with};
use super::super::guided::Guided;
use super::super::setup::Spec;
use super::super::tilt::tilted_with;
use glam::DVec3;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::tissue::TISSUES;
use rayon::prelude::*;
use serde::Serialize;

/// Density of the bone for feeds, g/cm³.
const DENSITY: f64 = 0.45;
/// Push for feeds, N at a real tool.
const PUSH_N: f64 = 30.0;

/// A term and what it does to a figure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TermRow {
    /// What is left out.
    pub term: &'static str,
    /// How it was left out.
    pub how: &'static str,
    /// What is measured.
    pub figure: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// With the term.
    pub with: f64,
    /// Without it.
    pub without: f64,
}

/// Term, how it is left out, figure, unit; what measures it with the term or without.
type Term = ([&'static str; 4], fn(bool) -> f64);

const TERMS: &[Term] = &[
    (
        [
            "yield",
            "p1 = 0",
            "creep of the engaged reamer in hard bone at 80 % of its yield",
            "mm/s",
        ],
        |with| {
            let change = |feel: &mut Feel| {
                for material in &mut feel.materials {
                    material.yield_n_per_mm2 = 0.0;
                }
            };
            creep_mm_s(&feel(with, change))
        },
    ),
    (
        [
            "viscous term",
            "feed ratio 0",
            "feed of the engaged drill at 30 N",
            "mm/s",
        ],
        |with| feed_mm_s(&feel(with, |f| f.law.feed_ratio = 0.0), &Faced::drill()),
    ),
    (
        [
            "density squared",
            "all bone 0.45 g/cm3",
            "speed of the drill in cancellous bone over that in the plate",
            "1",
        ],
        |with| layers(&feel(with, one_density)).0,
    ),
    (
        [
            "tissue class",
            "one material",
            "vibration per force in the plate over that in cancellous bone",
            "1",
        ],
        |with| {
            let change = |feel: &mut Feel| feel.materials = [feel.materials[0]; TISSUES];
            layers(&feel(with, change)).1
        },
    ),
    (
        [
            "1/r",
            "every element at the rim's radius",
            "feed of the engaged drill over the closed form with 1/r",
            "1",
        ],
        |with| {
            let feel = feel(with, |feel| feel.law.min_radius = 1.0);
            feed_over_law(&feel, &Faced::drill())
        },
    ),
    (
        [
            "1/speed",
            "energy in proportion to the speed",
            "feed at twice the speed over that at the drill's own",
            "1",
        ],
        speed_doubled,
    ),
    (
        [
            "smooth faces",
            "the whole surface cuts",
            "way sideways of the drill in its hole, 1 N for 1 s or 4 mm",
            "mm",
        ],
        sideways_mm,
    ),
    (
        [
            "rotation in the solve",
            "a hundredfold turning radius: the turn is the hand's",
            "turn of a standing reamer in its socket when the hand turns by 10 degrees",
            "deg",
        ],
        |with| {
            tilted_with(
                &feel(with, |f| f.coupling.turning_radius_mm *= 100.0),
                false,
            )
            .turned_deg
        },
    ),
    (
        [
            "tolerance of the contact set",
            "take hold at 0 mm",
            "ripple of the engaged ball's feed (RMS of its way a tick)",
            "%",
        ],
        |with| ripple_percent(&feel(with, |f| f.grip.take_mm = 0.0)),
    ),
    (
        [
            "hysteresis of the contact set",
            "let go where it takes hold",
            "ripple of the engaged ball's feed (RMS of its way a tick)",
            "%",
        ],
        |with| ripple_percent(&feel(with, |f| f.grip.release = 1.0)),
    ),
    (
        [
            "density ahead of the surface",
            "read at the element",
            "way of the reamer into untouched bone in 0.5 s at 80 % of its yield",
            "mm",
        ],
        |with| first_bite_mm(&feel(with, |f| f.law.look_ahead_voxels = 0.0)),
    ),
    (
        [
            "facets of the elements",
            "points alone",
            "largest step of the force over an edge of 30 degrees, 1 mm deep",
            "N",
        ],
        |with| {
            let mut scene = sharp(30.0, false);
            if !with {
                scene.tools[0].facets.clear();
            }
            crossed(scene, 0.0, 1.0).0
        },
    ),
];

/// Every term with its figure.
pub fn rows() -> Vec<TermRow> {
    let row = |(words, measure): &Term| {
        let [term, how, figure, unit] = *words;
        TermRow {
            term,
            how,
            figure,
            unit,
            with: measure(true),
            without: measure(false),
        }
    };
    TERMS.par_iter().map(row).collect()
}

fn feel(with: bool, change: impl Fn(&mut Feel)) -> Feel {
    let mut feel = Feel::default();
    if !with {
        change(&mut feel);
    }
    feel
}

fn one_density(feel: &mut Feel) {
    feel.law.density_per_hu = 0.0;
    feel.law.density_at_zero_hu = DENSITY;
}

fn stylus_n(feel: &Feel) -> f64 {
    PUSH_N * feel.force_scale
}

/// Creep under 80 % of the yield by the default law, after a bite.
fn creep_mm_s(feel: &Feel) -> f64 {
    let faced = Faced::reamer();
    let (mut guided, _) = seated_with(feel, &faced, 1.9, true);
    let bites = Law::of(&Feel::default(), 1.9).yield_n(&faced) * feel.force_scale;
    guided.push_up_to(1.5 * bites, 0.1);
    guided.push_for(1.5 * bites, 0.2);
    guided.push_for(0.8 * bites, 0.2);
    let from = guided.proxy_mm();
    guided.push_for(0.8 * bites, 0.5);
    (guided.proxy_mm() - from).length() / 0.5
}

/// Steady feed under [`PUSH_N`], in at most 0.3 s and 4 mm.
fn feed_mm_s(feel: &Feel, faced: &Faced) -> f64 {
    let (mut guided, spec) = seated_with(feel, faced, DENSITY, true);
    let push = stylus_n(feel);
    guided.push_up_to(push, 0.02);
    let (from, mut ticks) = (guided.proxy_mm(), 0.0);
    while ticks < 300.0 && (guided.proxy_mm() - from).length() < 4.0 {
        guided.push(push);
        ticks += 1.0;
    }
    (guided.proxy_mm() - from).length() / (ticks * spec.feel.tick_s)
}

fn feed_over_law(feel: &Feel, faced: &Faced) -> f64 {
    let (mut guided, _) = seated_with(feel, faced, DENSITY, true);
    let push = stylus_n(feel);
    guided.push_up_to(push, 0.1);
    guided.push_for(push, 0.1);
    let from = guided.proxy_mm();
    guided.push_for(push, 0.2);
    let measured = (guided.proxy_mm() - from).length() / 0.2;
    let law = Law::of(&Feel::default(), DENSITY);
    let omega = guided.output.spindle_rad_s;
    measured / law.feed_mm_s(faced, PUSH_N, omega)
}

fn speed_doubled(with: bool) -> f64 {
    let mut fast = Faced::drill();
    fast.tool.rpm *= 2.0;
    let twice = feel(with, |feel| {
        for material in &mut feel.materials {
            material.energy_n_per_mm2 *= 2.0;
        }
    });
    feed_mm_s(&twice, &fast) / feed_mm_s(&Feel::default(), &Faced::drill())
}

/// Speed in cancellous bone over that in the plate, and vibration per force in the plate over that in
/// cancellous bone: the drill at 0.6 N.
fn layers(feel: &Feel) -> (f64, f64) {
    let mut spec = Spec::at(joint());
    spec.scale = FINE;
    spec.feel = *feel;
    let mut guided = Guided::new(&spec, DVec3::Z * 10.0, true);
    guided.glide(DVec3::ZERO, 20.0);
    guided.push_up_to(0.6, 0.1);
    // ticks, and mean square of the vibration, where the whole tip is in plate or in cancellous bone
    let mut seen = [(0.0f64, 0.0f64, 0.0f64); 2];
    let mut ticks = 0;
    while guided.proxy_mm().z > -8.5 && ticks < 20_000 {
        let before = guided.proxy_mm().z;
        guided.push(0.6);
        ticks += 1;
        let z = guided.proxy_mm().z;
        let layer = match z {
            z if z < -6.5 => 1,
            z if z < -2.3 && z > -2.9 => 0,
            _ => continue,
        };
        let (n, way, square) = &mut seen[layer];
        *n += 1.0;
        *way += before - z;
        *square += guided.output.vibration_n.length_squared();
    }
    let [plate, cancellous] = seen.map(|(n, way, square)| (way / n, (square / n).sqrt()));
    (cancellous.0 / plate.0, plate.1 / cancellous.1)
}

/// Way sideways of the drill, its whole length in a hole, spindle on.
fn sideways_mm(with: bool) -> f64 {
    let mut faced = Faced::drill();
    faced.depth_mm = 8.0;
    if !with {
        let mut elements = faced.tool.elements.clone();
        for e in &mut elements {
            e.cutting = true;
        }
        faced.tool = faced.tool.clone().with_elements(elements);
    }
    let (mut guided, spec) = seated_with(&Feel::default(), &faced, DENSITY, true);
    let from = guided.proxy_mm();
    let lead = 1.0 / spec.feel.coupling.stiffness_n_per_mm;
    for _ in 0..1000 {
        if (guided.proxy_mm() - from).length() > 4.0 {
            break; // through the wall
        }
        let at = guided.proxy_mm().with_z(guided.place_mm.z) + DVec3::X * lead;
        guided.tick_at(at.with_y(0.0));
    }
    (guided.proxy_mm() - from).with_z(0.0).length()
}

/// RMS of the ball's way a tick over its mean, less the mean, in a steady feed.
fn ripple_percent(feel: &Feel) -> f64 {
    let (mut guided, _) = seated_with(feel, &Faced::ball(), DENSITY, true);
    let push = stylus_n(feel);
    guided.push_up_to(push, 0.1);
    guided.push_for(push, 0.1);
    let mut ways = Vec::new();
    for _ in 0..200 {
        let before = guided.proxy_mm().z;
        guided.push(push);
        ways.push(before - guided.proxy_mm().z);
    }
    let mean = ways.iter().sum::<f64>() / ways.len() as f64;
    let square = ways.iter().map(|w| (w - mean).powi(2)).sum::<f64>() / ways.len() as f64;
    100.0 * square.sqrt() / mean
}

/// Way into bone that nothing has cut yet.
fn first_bite_mm(feel: &Feel) -> f64 {
    let faced = Faced::reamer();
    let (mut guided, _) = seated_with(feel, &faced, 1.9, true);
    let bites = Law::of(feel, 1.9).yield_n(&faced) * feel.force_scale;
    guided.push_up_to(0.8 * bites, 0.1);
    let from = guided.proxy_mm();
    guided.push_for(0.8 * bites, 0.5);
    (guided.proxy_mm() - from).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each term changes its figure. Tolerance and hysteresis of the contact set need not: they are there
    /// for stored distances that round, which a feed in uniform bone may not meet.
    #[test]
    fn every_term_of_the_law_is_for_something() {
        let mut idle = Vec::new();
        for row in rows() {
            let TermRow { with, without, .. } = row;
            assert!(with.is_finite() && without.is_finite(), "{row:?}");
            let apart = (with - without).abs() / with.abs().max(without.abs()).max(1e-9);
            if apart <= 0.05 && !row.term.ends_with("of the contact set") {
                idle.push(row);
            }
        }
        assert!(idle.is_empty(), "{idle:#?}");
    }
}
