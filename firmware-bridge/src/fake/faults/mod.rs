//! Faults on purpose: of the cable in each direction, of the device's sensors, of the device as a whole.
//!
//! * [`catalogue`]: every fault by name, its directions, and whether a session must survive it.
//! * [`lane`]: one direction of the cable, which loses, breaks, delays and repeats frames.
//! * [`sensors`]: what the device reads wrongly.
//!
//! The same faults run in lockstep ([`crate::bench`]) and in real time (`osteon fake-omni --fault`).

pub mod catalogue;
pub mod lane;
pub mod sensors;

pub use catalogue::{CATALOGUE, Direction, Entry, Fault, Where};
pub use lane::Lane;

use std::fmt;
use std::str::FromStr;

/// One fault of a session: what, when, in which direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planned {
    /// What.
    pub fault: Fault,
    /// In which direction.
    pub direction: Direction,
    /// When it begins, s: after the drive has become active in lockstep, after the start of the device in
    /// real time.
    pub at_s: f64,
}

/// Time of a fault whose time is not given, s.
pub const DEFAULT_AT_S: f64 = 3.0;

impl Planned {
    /// What the catalogue says of it.
    pub fn entry(self) -> &'static Entry {
        self.fault.entry()
    }
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}:{}", self.fault, self.at_s, self.direction)
    }
}

/// `NAME[@SECONDS][:DIRECTION]`; without a direction the first that the fault has.
impl FromStr for Planned {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (rest, direction) = match text.split_once(':') {
            Some((rest, direction)) => (rest, Some(direction.parse::<Direction>()?)),
            None => (text, None),
        };
        let (name, at_s) = match rest.split_once('@') {
            Some((name, at)) => match at.parse::<f64>() {
                Ok(at) if (0.0..=1e5).contains(&at) => (name, at),
                _ => {
                    return Err(format!(
                        "'{at}' is no time; give seconds, as drop-frame@2.5"
                    ));
                }
            },
            None => (rest, DEFAULT_AT_S),
        };
        let fault: Fault = name.parse()?;
        let known = fault.entry().directions;
        let direction = direction.unwrap_or(known[0]);
        if !known.contains(&direction) {
            let names: Vec<String> = known.iter().map(ToString::to_string).collect();
            return Err(format!(
                "{fault} has no direction '{direction}'; give {}",
                names.join(" or ")
            ));
        }
        Ok(Self {
            fault,
            direction,
            at_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_read_from_its_own_text() {
        for entry in CATALOGUE {
            for &direction in entry.directions {
                let planned = Planned {
                    fault: entry.fault,
                    direction,
                    at_s: 2.5,
                };
                assert_eq!(planned.to_string().parse(), Ok(planned));
            }
            let short: Planned = entry.name.parse().expect("a name");
            assert_eq!(
                (short.direction, short.at_s),
                (entry.directions[0], DEFAULT_AT_S)
            );
        }
    }

    #[test]
    fn each_wrong_part_is_named() {
        for (text, word) in [
            ("drop-fram", "drop-frame"),
            ("drop-frame@x", "'x'"),
            ("drop-frame@-1", "'-1'"),
            ("drop-frame@1:up", "'up'"),
            ("e-stop:to-host", "give device"),
        ] {
            let said = text.parse::<Planned>().expect_err("refused");
            assert!(said.contains(word), "{text}: {said}");
        }
    }
}
