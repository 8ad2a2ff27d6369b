//! Arithmetic of the motors' output, in DAC counts.

/// `torque · part / whole`, towards zero; `part <= whole < 2³²`.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "part / whole is at most one"
)]
pub(super) fn scale(torque: i16, part: u64, whole: u64) -> i16 {
    (i64::from(torque) * part as i64 / whole as i64) as i16
}

/// `wanted`, but at most `rise` further from zero than `now`; a change of sign starts from zero.
pub(super) fn slew(now: i16, wanted: i16, rise: i16) -> i16 {
    let base = if (now < 0) == (wanted < 0) {
        now.abs()
    } else {
        0
    };
    wanted.signum() * wanted.abs().min(base.saturating_add(rise))
}
