//! Presses: cases 1 to 3.

use super::super::bench::Bench;
use super::super::hand::Hand;
use super::super::map;
use super::super::plant::PlantSpec;
use super::super::press::{SETTLED_MM, borne, pressed};
use super::super::setup::Spec;
use super::super::trace::{force_swing_n, swing_mm};
use super::{Case, Worst};
use rayon::prelude::*;
use serde::Serialize;

/// Hands and delays that a press is tried with.
pub(super) fn holds() -> Vec<(Hand, usize)> {
    let delays = |hand| (0..=2).map(move |delay| (hand, delay));
    Hand::ALL.into_iter().flat_map(delays).collect()
}

/// "grip, 2 ticks".
pub(super) fn hold_words((hand, delay): (Hand, usize)) -> String {
    format!("{}, {delay} ticks", hand.name)
}

/// Presses for ten seconds with every hand and delay.
fn all_pressed(spec: &Spec) -> Vec<((Hand, usize), Bench)> {
    let all = holds().into_par_iter();
    all.map(|hold| (hold, pressed(&spec.clone().with(hold.0, hold.1), 10.0)))
        .collect()
}

/// Energy of a press.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EnergyRow {
    /// Who holds the device.
    pub hand: &'static str,
    /// From a sample to its command in force.
    pub delay_ticks: usize,
    /// Energy that the motors took in 10 s from the touch on, mJ; negative: they gave some.
    pub absorbed_mj: f64,
    /// The least of that account, mJ.
    pub least_absorbed_mj: f64,
}

/// Energy of presses with every hand and delay.
pub fn energies(spec: &Spec) -> Vec<EnergyRow> {
    let row = |((hand, delay_ticks), bench): ((Hand, usize), Bench)| EnergyRow {
        hand: hand.name,
        delay_ticks,
        absorbed_mj: bench.plant.absorbed_mj,
        least_absorbed_mj: bench.trace.least_absorbed_mj(),
    };
    all_pressed(spec).into_iter().map(row).collect()
}

/// Case 1.
pub(super) fn still() -> Case {
    let (mut swing, mut force) = (Worst::default(), Worst::default());
    let mut all_borne = true;
    for (hold, bench) in all_pressed(&Spec::flat()) {
        all_borne &= borne(&bench);
        let last = bench.trace.last(1.0);
        swing.note(swing_mm(last), || hold_words(hold));
        force.note(force_swing_n(last), || hold_words(hold));
    }
    Case {
        id: 1,
        name: "Static press",
        criterion: "0.9 N on a flat, aligned wall, spindle off, three hands, 0 to 2 ticks of delay: in the last of \
                    10 s the place swings ≤ 0.11 mm and the force ≤ 0.05 N peak to peak"
            .to_owned(),
        measured: format!("{}; {}", swing.words("mm"), force.words("N")),
        pass: all_borne && swing.value <= SETTLED_MM && force.value <= 0.05,
    }
}

/// Case 2.
pub(super) fn bad_device() -> Case {
    let mut spec = Spec::flat();
    spec.plant = PlantSpec::BAD;
    let (mut swing, mut growth) = (Worst::default(), Worst::default());
    for (hold, bench) in all_pressed(&spec) {
        let end = bench.device.time_s();
        let late = swing_mm(bench.trace.last(2.0));
        let earlier = swing_mm(bench.trace.between(end - 6.0, end - 4.0));
        swing.note(late, || hold_words(hold));
        growth.note(late - earlier, || hold_words(hold));
    }
    Case {
        id: 2,
        name: "Static press, bad device",
        criterion: "as case 1 with 0.01 N s/m and 0.03 N of friction: swings ≤ 0.5 mm and does not grow over 10 s \
                    (last 2 s against those 4 s before, one step of the encoders allowed)"
            .to_owned(),
        measured: format!("{}; growth {}", swing.words("mm"), growth.words("mm")),
        pass: swing.value <= 0.5 && growth.value <= 0.056,
    }
}

/// Case 3.
pub(super) fn onset() -> Case {
    let mut all = Vec::new();
    for viscous in [0.1, 0.5, 1.0] {
        all.extend((0..=3).map(|delay| (viscous, delay)));
    }
    let offs: Vec<((f64, usize), f64)> = all
        .into_par_iter()
        .map(|(viscous, delay)| {
            let spec = map::linear(viscous, delay).guarded(false);
            let found = map::onset_n_per_m(&spec, Bench::new);
            let law = map::delay_law_n_per_m(viscous, delay);
            ((viscous, delay), (found / law - 1.0).abs())
        })
        .collect();
    let mut worst = Worst::default();
    for ((viscous, delay), off) in offs {
        worst.note(100.0 * off, || {
            format!("b = {viscous} N s/m, {delay} ticks")
        });
    }
    Case {
        id: 3,
        name: "Onset of the linear loop",
        criterion: "the servo without guards, no Coulomb friction, 0 to 3 ticks of delay: a small swing begins to grow within 15 % of \
             b/(T/2 + t_d)"
            .to_owned(),
        measured: worst.words("% off"),
        pass: worst.value <= 15.0,
    }
}
