//! Defects of other programs, reproduced by their rule in a few lines each (none of their code was
//! used), so that ours can be measured beside them.
//!
//! * Removal of the first N voxels of a tick ([`capped`]): CHAI3D's drilling demo removes one a tick,
//!   `volumetric_drilling` (on AMBF) ten of a 6 mm burr. How fast bone goes depends on the loop's rate, and
//!   since the first are the first in memory, bone goes on one side first.
//! * Contact of points with voxels that are full or empty ([`tangent`]): VPS's tangent planes (`McNeely`,
//!   Puterbaugh and Troy 1999). The force jumps at the voxels' borders.
//! * A pure penalty ([`plate_crossed_n`]): no memory of the side, so a thin plate lets through.

pub mod capped;
pub mod tangent;

/// Push, N, at which a penalty contact of `stiffness_n_per_mm` lets a point through a plate: the device
/// is pushed harder and harder and rests where the spring to the *nearer* face bears it.
pub fn plate_crossed_n(stiffness_n_per_mm: f64, thickness_mm: f64) -> f64 {
    // rests at a depth where the spring's force is the push; beyond the middle it pulls on
    let penalty = |depth: f64| {
        if depth < 0.5 * thickness_mm {
            stiffness_n_per_mm * depth
        } else {
            stiffness_n_per_mm * (depth - thickness_mm).min(0.0)
        }
    };
    let (mut depth, mut push) = (0.0f64, 0.0);
    while depth < thickness_mm {
        push += 1e-4;
        // a quasi-static step: to where the push is borne
        while depth < thickness_mm && penalty(depth) < push {
            depth += 1e-4;
        }
    }
    push
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_penalty_lets_through_at_half_the_thickness() {
        for thickness in [0.47, 1.0, 2.0, 3.0] {
            let push = plate_crossed_n(0.5, thickness);
            assert!((push - 0.25 * thickness).abs() < 1e-3, "{thickness} {push}");
        }
    }
}
