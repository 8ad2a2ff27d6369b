//! One line of a text CT.

use glam::DVec3;

/// Farthest position along an axis, mm.
pub(super) const MAX_MM: f64 = 1e5;
/// Longest line, bytes.
pub(super) const MAX_LINE: usize = 1024;
/// Least and largest density; one value of `i16` is left over for "no voxel here".
pub(super) const DENSITIES: (i16, i16) = (-i16::MAX, i16::MAX);
/// Names of the axes.
pub(super) const AXES: [char; 3] = ['x', 'y', 'z'];

/// A voxel as its line says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Entry {
    /// Position, mm.
    pub(super) at: DVec3,
    /// Density, rounded to a whole CT number.
    pub(super) density_hu: i16,
}

/// What is wrong with a line: what was found and the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A field that is no number.
    #[error("`{text}` is no number; give `x y z density`")]
    NoNumber {
        /// The rest of the line from that field on, shortened.
        text: String,
    },
    /// Fewer or more fields than four.
    #[error(
        "{found} numbers where 4 are expected; give `x y z density` with a decimal point, not a comma"
    )]
    Fields {
        /// Fields found.
        found: usize,
    },
    /// A position that is no number or outside any scanner.
    #[error(
        "{axis} = {value} is no position in a scanner (at most {MAX_MM} mm); correct the line or give millimetres"
    )]
    Position {
        /// The axis.
        axis: char,
        /// The value.
        value: f64,
    },
    /// A density outside the 16-bit numbers.
    #[error(
        "density = {value} is no CT number ({} to {} are possible); correct the line or rescale the file",
        DENSITIES.0, DENSITIES.1
    )]
    Density {
        /// The value.
        value: f64,
    },
    /// A line without an end.
    #[error("longer than {MAX_LINE} bytes; give one voxel a line")]
    TooLong,
}

/// Reads a line, without its line feed. `None` for an empty line or a comment.
pub(super) fn parse(line: &[u8]) -> Result<Option<Entry>, Fault> {
    let line = line.trim_ascii();
    if line.is_empty() || line[0] == b'#' {
        return Ok(None);
    }
    let mut rest = line;
    let mut values = [0.0; 4];
    for (n, value) in values.iter_mut().enumerate() {
        if rest.is_empty() {
            return Err(Fault::Fields { found: n });
        }
        let (number, length) = number(rest)?;
        *value = number;
        rest = after_separator(&rest[length..]);
    }
    if !rest.is_empty() {
        return Err(surplus(rest));
    }
    entry(values).map(Some)
}

/// The number at the front, and its length.
fn number(text: &[u8]) -> Result<(f64, usize), Fault> {
    let refuse = || Fault::NoNumber {
        text: excerpt(text),
    };
    match fast_float2::parse_partial::<f64, _>(text) {
        Ok((value, length)) if text.get(length).is_none_or(|&b| separates(b)) => {
            Ok((value, length))
        }
        _ => Err(refuse()),
    }
}

fn separates(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b',' | b';')
}

/// The text after blanks with at most one comma or semicolon among them.
fn after_separator(text: &[u8]) -> &[u8] {
    let blank = |text: &[u8]| {
        text.iter()
            .take_while(|&&b| b == b' ' || b == b'\t')
            .count()
    };
    let rest = &text[blank(text)..];
    match rest {
        [b',' | b';', rest @ ..] => &rest[blank(rest)..],
        _ => rest,
    }
}

/// More than four fields; counted as far as they are numbers.
fn surplus(mut rest: &[u8]) -> Fault {
    let mut found = 4;
    while !rest.is_empty() {
        match number(rest) {
            Ok((_, length)) => rest = after_separator(&rest[length..]),
            Err(fault) => return fault,
        }
        found += 1;
    }
    Fault::Fields { found }
}

fn entry([x, y, z, density]: [f64; 4]) -> Result<Entry, Fault> {
    for (axis, value) in AXES.into_iter().zip([x, y, z]) {
        // a NaN is not in the range either
        if !(-MAX_MM..=MAX_MM).contains(&value) {
            return Err(Fault::Position { axis, value });
        }
    }
    let rounded = density.round();
    if !(f64::from(DENSITIES.0)..=f64::from(DENSITIES.1)).contains(&rounded) {
        return Err(Fault::Density { value: density });
    }
    #[expect(clippy::cast_possible_truncation, reason = "its range was checked")]
    let density_hu = rounded as i16;
    Ok(Entry {
        at: DVec3::new(x, y, z),
        density_hu,
    })
}

/// A few characters to recognise a place by, safe to print.
fn excerpt(text: &[u8]) -> String {
    const LENGTH: usize = 24;
    let end = text.iter().position(|&b| separates(b));
    let field = &text[..end.filter(|&e| e > 0).unwrap_or(text.len())];
    field[..field.len().min(LENGTH)].escape_ascii().to_string()
}

/// Whether a first line is a header: its first field does not begin like a number.
pub(super) fn is_header(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    let quoted = line.strip_prefix(b"\"").unwrap_or(line);
    quoted.first().is_some_and(u8::is_ascii_alphabetic) && number(line).is_err()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Result<Option<Entry>, Fault> {
        parse(line.as_bytes())
    }

    #[test]
    fn all_notations_of_a_voxel_are_one() {
        let expected = Entry {
            at: DVec3::new(-1.5, 0.25, 300.0),
            density_hu: 1234,
        };
        for line in [
            "-1.5 0.25 300 1234",
            "  -1.5\t0.25   3e2 1.234E3  ",
            "-1.5,0.25,300,1234\r",
            "-1.5 , 0.25 ;300.000, 1233.7",
            "-1.5;.25;+300.;1234.0",
        ] {
            assert_eq!(read(line), Ok(Some(expected)), "{line}");
        }
        for line in ["", "  \t\r", "# x y z", "   # 1 2 3 4"] {
            assert_eq!(read(line), Ok(None), "{line}");
        }
    }

    #[test]
    fn what_is_no_voxel_is_named() {
        let text = |line: &str| read(line).expect_err(line).to_string();
        assert!(text("1 2 3").starts_with("3 numbers where 4"));
        assert!(text("1 2 3 4 5").starts_with("5 numbers where 4"));
        assert!(text("1,5 2,5 3,5 4").starts_with("7 numbers where 4"));
        assert!(text("1 2 bone 4").starts_with("`bone` is no number"));
        assert!(text("1 2.5mm 3 4").starts_with("`2.5mm` is no number"));
        assert!(text("1,,2,3,4").starts_with("`,2,3,4` is no number"));
        assert!(text("1 2 3 4 # five").starts_with("`#` is no number"));
        assert!(text("1 nan 3 4").starts_with("y = NaN is no position"));
        assert!(text("1 2 -inf 4").starts_with("z = -inf is no position"));
        assert!(text("1e300 2 3 4").starts_with("x = 1"));
        assert!(text("1 2 3 NaN").starts_with("density = NaN"));
        assert!(text("1 2 3 32768").starts_with("density = 32768"));
        assert!(text("1 2 3 -32767.6").starts_with("density = -32767.6"));
        assert!(!text("\u{1b}[31m 2 3 4").contains('\u{1b}'));
    }

    #[test]
    fn headers_are_told_from_voxels() {
        for line in ["x y z density", "\"X\",\"Y\"", "Position Density\r"] {
            assert!(is_header(line.as_bytes()), "{line}");
        }
        for line in ["1 2 3 4", "", "nan 1 2 3", "inf 1 2 3", "-x 1 2 3"] {
            assert!(!is_header(line.as_bytes()), "{line}");
        }
    }
}
