//! Components from TOML; the built-in ones are `components/standard.toml`.

use super::ClinicError;
use osteon_sim_core::planning::component::{Component, Peg};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The built-in components' file.
pub const STANDARD: &str = include_str!("../../components/standard.toml");
/// Most components of a file, and most pegs of one.
const MOST: usize = 64;
/// Longest file, bytes.
const MAX_BYTES: u64 = 1 << 20;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    component: Vec<Data>,
}

/// A component as a file has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    /// Name for people.
    pub name: String,
    /// Identifier.
    pub id: String,
    /// Radius of the back, mm.
    pub backside_radius_mm: f64,
    /// Extent along x, mm.
    pub width_mm: f64,
    /// Extent along y, mm.
    pub height_mm: f64,
    /// Thickness in the middle, mm.
    pub thickness_mm: f64,
    /// Diameter of the reamer, mm.
    pub reamer_mm: f64,
    /// Pegs, the central one first.
    #[serde(default)]
    pub peg: Vec<PegData>,
}

/// A peg as a file has it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PegData {
    /// Place of its axis, mm.
    pub at_mm: [f64; 2],
    /// Diameter of its hole, mm.
    pub diameter_mm: f64,
    /// Depth of its hole below the back's middle, mm.
    pub length_mm: f64,
}

impl Data {
    /// The component, if its numbers can be.
    pub fn checked(&self) -> Result<Component, String> {
        let within = |field: &str, value: f64, least: f64, most: f64| {
            if (least..=most).contains(&value) {
                Ok(value)
            } else {
                Err(format!(
                    "component \"{}\": {field} = {value} mm (allowed: {least} to {most})",
                    self.id
                ))
            }
        };
        if self.id.is_empty() || self.peg.len() > MOST {
            return Err(format!(
                "component \"{}\": needs an id and at most {MOST} pegs",
                self.id
            ));
        }
        let width = within("width_mm", self.width_mm, 5.0, 60.0)?;
        let height = within("height_mm", self.height_mm, 5.0, 60.0)?;
        let reamer = within("reamer_mm", self.reamer_mm, 10.0, 60.0)?;
        let back = within(
            "backside_radius_mm",
            self.backside_radius_mm,
            0.5 * reamer + 1.0,
            500.0,
        )?;
        let pegs = self.peg.iter().map(|p| {
            Ok(Peg {
                at_mm: [
                    within("peg at_mm", p.at_mm[0], -0.5 * width, 0.5 * width)?,
                    within("peg at_mm", p.at_mm[1], -0.5 * height, 0.5 * height)?,
                ],
                diameter_mm: within("peg diameter_mm", p.diameter_mm, 1.0, 20.0)?,
                length_mm: within("peg length_mm", p.length_mm, 2.0, 40.0)?,
            })
        });
        Ok(Component {
            name: self.name.clone(),
            id: self.id.clone(),
            backside_radius_mm: back,
            width_mm: width,
            height_mm: height,
            thickness_mm: within("thickness_mm", self.thickness_mm, 0.5, 30.0)?,
            reamer_mm: reamer,
            pegs: pegs.collect::<Result<_, String>>()?,
        })
    }

    /// The data of a component.
    pub fn of(component: &Component) -> Self {
        let peg = |p: &Peg| PegData {
            at_mm: p.at_mm,
            diameter_mm: p.diameter_mm,
            length_mm: p.length_mm,
        };
        Self {
            name: component.name.clone(),
            id: component.id.clone(),
            backside_radius_mm: component.backside_radius_mm,
            width_mm: component.width_mm,
            height_mm: component.height_mm,
            thickness_mm: component.thickness_mm,
            reamer_mm: component.reamer_mm,
            peg: component.pegs.iter().map(peg).collect(),
        }
    }
}

/// The components of a text.
pub fn parse(text: &str) -> Result<Vec<Component>, String> {
    let table: Table = toml::from_str(text).map_err(|e| {
        let line = e
            .span()
            .map_or(1, |s| text[..s.start].lines().count().max(1));
        format!(
            "line {line}: {}; correct it",
            e.message().replace('\n', " ")
        )
    })?;
    if table.component.is_empty() || table.component.len() > MOST {
        return Err(format!(
            "{} components; give 1 to {MOST}",
            table.component.len()
        ));
    }
    table.component.iter().map(Data::checked).collect()
}

/// The components of a file, or the built-in ones.
pub fn load(path: Option<&Path>) -> Result<Vec<Component>, ClinicError> {
    let Some(path) = path else {
        return parse(STANDARD).map_err(ClinicError::Plan);
    };
    let refuse = |problem: String| ClinicError::File {
        path: path.to_path_buf(),
        problem,
    };
    let unread = |e: std::io::Error| refuse(format!("cannot be read ({e}); check the path"));
    if std::fs::metadata(path).map_err(unread)?.len() > MAX_BYTES {
        return Err(refuse(
            "is too long for components; give their TOML file".to_owned(),
        ));
    }
    let text = std::fs::read_to_string(path).map_err(unread)?;
    parse(&text).map_err(refuse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_components_are_read_and_come_back() {
        let all = load(None).expect("components");
        assert_eq!(all.len(), 3);
        for c in &all {
            assert_eq!(Data::of(c).checked().as_ref(), Ok(c));
        }
        assert_eq!(all[2].pegs.len(), 3);
    }

    #[test]
    fn what_cannot_be_is_refused_by_field() {
        let cases = [
            ("width_mm = 24", "width_mm = -24", "width_mm = -24"),
            ("length_mm = 18 ", "length_mm = 180 ", "peg length_mm = 180"),
            (
                "backside_radius_mm = 30",
                "backside_radius_mm = 3",
                "backside_radius_mm = 3",
            ),
            ("thickness_mm = 4", "thick = 4", "thick"),
            ("at_mm = [0, 0]", "at_mm = [30, 0]", "at_mm = 30"),
        ];
        for (from, to, expected) in cases {
            let text = STANDARD.replacen(from, to, 1);
            let error = parse(&text).expect_err(to);
            assert!(error.contains(expected) && !error.contains('\n'), "{error}");
        }
    }
}
