//! What a force staircase says of the force's scale.

/// A stair: the commanded force, upwards, N, and where the stylus stood, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stair {
    pub(super) force_n: f64,
    pub(super) height_mm: f64,
}

/// The stylus has been lifted when it is so far above its first place, mm.
const LIFTED_MM: f64 = 2.0;

/// Force shown over force commanded, against a spring of `stiffness` N/mm: the slope of height over force, by
/// least squares over the way up and the way down. Friction shifts the two ways apart by the same height and
/// keeps the slope of each; the first stair of each way, where it is still being overcome, is left out. `None`
/// where the stylus did not follow.
pub(super) fn spring_scale(stairs: &[Stair], stiffness: f64) -> Option<f64> {
    let top = stairs.iter().map(|s| s.force_n).fold(0.0, f64::max);
    let turn = stairs.iter().position(|s| s.force_n >= top)?;
    // friction of the arm is overcome after a third of the way
    let beyond = |way: &[Stair], from: usize| slope(way.get(from..)?);
    let up = beyond(stairs.get(..=turn)?, turn / 3)?;
    let down = beyond(stairs.get(turn..)?, turn / 3)?;
    let mean = f64::midpoint(up, down);
    (mean > 0.0).then_some(mean * stiffness)
}

/// Slope of height over force, mm/N.
fn slope(stairs: &[Stair]) -> Option<f64> {
    let n = stairs.len() as f64;
    let mean = |f: fn(&Stair) -> f64| stairs.iter().map(f).sum::<f64>() / n;
    let (force, height) = (mean(|s| s.force_n), mean(|s| s.height_mm));
    let over = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        let parts = stairs
            .iter()
            .map(|s| f(s.force_n - force, s.height_mm - height));
        parts.sum()
    };
    let variance = over(&|f, _| f * f);
    (variance > 1e-9).then(|| over(&|f, h| f * h) / variance)
}

/// Force shown over force commanded, against a weight of `weight_n`: the mean of the commands at which it lifts
/// and at which it sinks again, as friction adds to the one and takes from the other. `None` where it never
/// lifts.
pub(super) fn weight_scale(stairs: &[Stair], weight_n: f64) -> Option<f64> {
    let first = stairs.first()?.height_mm;
    let is_up = |s: &Stair| s.height_mm > first + LIFTED_MM;
    let lifts = stairs.iter().position(is_up)?;
    let sinks = lifts + stairs[lifts..].iter().position(|s| !is_up(s))?;
    // between two stairs
    let at = |n: usize| f64::midpoint(stairs[n].force_n, stairs[n.saturating_sub(1)].force_n);
    let command = f64::midpoint(at(lifts), at(sinks));
    (command > 0.0).then_some(weight_n / command)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn way() -> impl Iterator<Item = f64> {
        (0..=15).chain((0..15).rev()).map(|n| f64::from(n) * 0.1)
    }

    #[test]
    fn a_planted_scale_and_friction_are_told_apart() {
        // forces are 0.8 of what is commanded, 0.2 N of friction, a spring of 0.4 N/mm
        let mut height = 0.0;
        let stairs: Vec<Stair> = way()
            .map(|force_n| {
                let (low, high) = ((0.8 * force_n - 0.2) / 0.4, (0.8 * force_n + 0.2) / 0.4);
                height = f64::clamp(height, low, high);
                Stair {
                    force_n,
                    height_mm: height,
                }
            })
            .collect();
        let scale = spring_scale(&stairs, 0.4).expect("it moved");
        assert!((scale - 0.8).abs() < 0.01, "{scale}");
        assert_eq!(spring_scale(&[], 0.4), None);
        let stuck: Vec<Stair> = way()
            .map(|force_n| Stair {
                force_n,
                height_mm: 3.0,
            })
            .collect();
        assert_eq!(spring_scale(&stuck, 0.4), None);
        assert_eq!(weight_scale(&stuck, 0.98), None);
    }

    #[test]
    fn a_weight_is_lifted_above_and_sinks_below_its_own_force() {
        // 100 g, forces 1.1 of what is commanded, 0.15 N of friction
        let mut up = false;
        let stairs: Vec<Stair> = way()
            .map(|force_n| {
                let shown = 1.1 * force_n - 0.981;
                up = if up { shown > -0.15 } else { shown > 0.15 };
                Stair {
                    force_n,
                    height_mm: if up { 30.0 } else { 0.0 },
                }
            })
            .collect();
        let scale = weight_scale(&stairs, 0.981).expect("it was lifted");
        assert!((scale - 1.1).abs() < 0.08, "{scale}");
    }
}
