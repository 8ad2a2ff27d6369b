//! What the table's materials are to the law: a tissue class and a density, or none.

use super::Record;
use osteon_sim_core::tissue::Tissue;

/// A material that the law knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stuff {
    /// Class whose parameters it takes.
    pub tissue: Tissue,
    /// Apparent density, lowest and highest, g/cm³.
    pub density: [f64; 2],
    /// Where the density is from.
    pub source: &'static str,
}

/// Material of a row, or why the law does not apply to the row.
pub fn of_material(record: &Record) -> Result<Stuff, &'static str> {
    if !record.process.starts_with("drilling") {
        return Err(match record.process.split_whitespace().next() {
            Some("sawing") => {
                "not applicable: one tooth on a straight way, no tool that turns about its axis"
            }
            Some("reaming") => {
                "not applicable: neither tool, speed nor feed known; shows only that reaming a hip takes hundreds of newtons"
            }
            _ => "not applicable: no cutting; the limit of a device",
        });
    }
    let has = |word: &str| record.material.contains(word);
    if has("artificial") {
        return Err("not applicable: density and strength of the artificial bone are not given");
    }
    if has("marrow") {
        return Err("not applicable: marrow, not bone; no speed and no feed given");
    }
    if has("vertebra") {
        return Err(
            "not applicable: shell and spongy bone in unknown shares, so no density; no tool, speed and feed given",
        );
    }
    if has("cancellous") {
        return Ok(Stuff {
            tissue: Tissue::Cancellous,
            density: [0.45, 0.45],
            source: "density 0.45 g/cm3 assumed: this project's cancellous bone; no measurement of that bone",
        });
    }
    if has("human") {
        return Ok(Stuff {
            tissue: Tissue::Cortical,
            density: [1.9, 1.9],
            source: "density 1.9 g/cm3: human tibia, 1.91 by weighing (table 1 of doi:10.1098/rsif.2015.0070); no measurement of that bone",
        });
    }
    Ok(Stuff {
        tissue: Tissue::Cortical,
        density: [1.9, 2.0],
        source: if has("porcine") {
            "density 1.9 to 2.0 g/cm3 assumed, as of man and cattle; no figure for pigs was found"
        } else {
            "density 1.9 to 2.0 g/cm3: steer tibia, 1.995 by weighing (table 1 of doi:10.1098/rsif.2015.0070); no measurement of that bone"
        },
    })
}
