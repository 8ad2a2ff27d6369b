//! The feel as a TOML file that explains itself.

use core::fmt::Write as _;
use osteon_sim_core::feel::{FIELDS, Feel};

const HEAD: &str = "\
# What the hand feels: every parameter of Osteon with its unit, its range and where the default comes from.
#
# 'osteon haptics --feel FILE' and 'osteon demo --feel FILE' take a file like this one; what it does not
# name keeps its default. 'osteon haptics --print-feel' prints this text, with --feel the values in force.
#
# Nothing here is validated against reaming: no measured force or torque of glenoid reaming was found in
# the open literature. The cutting law is calibrated to the low end of bone drilling.
";

/// What a table is about.
fn about(table: &str) -> &'static str {
    match table {
        "coupling" => "The spring between the hand and the tool.",
        "law" => "The cutting law, as far as all tissues share it.",
        "grip" => "When a cutting element holds bone and when it lets go.",
        "spindle" => "The spindle's motor.",
        "guard" => "What stands between the spring and the motors.",
        _ => "A material; yield and energy are at 1 g/cm3 and go with the square of the density.",
    }
}

/// A file for `--feel` with every parameter as it is in `feel`.
pub fn to_toml(feel: &Feel) -> String {
    let mut text = HEAD.to_owned();
    let mut table = "";
    for field in FIELDS {
        let (of, name) = field.key.split_once('.').unwrap_or(("", field.key));
        let [lo, hi] = field.range;
        // writing to a string cannot fail
        let written = if of == table {
            writeln!(text)
        } else {
            table = of;
            writeln!(text, "\n# {}\n[{of}]", about(of))
        };
        written.unwrap_or(());
        let (unit, source, value) = (field.unit, field.source, field.get(feel));
        writeln!(text, "# {unit}, {lo} to {hi}; {source}\n{name} = {value:?}").unwrap_or(());
    }
    text
}
