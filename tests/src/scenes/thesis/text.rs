//! Stand-ins as the thesis's text files.

use super::{ACTIVE_HU, LINE_BYTES, Object, StandIn};
use rayon::prelude::*;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;

/// Which voxels a file lists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Listed {
    /// The active ones, and the grid's first and last, so that the box is known.
    Active,
    /// All.
    All,
}

/// What the thesis's file of an object lists, by its size (see [`super`]).
pub fn listed(object: Object) -> Listed {
    if object == Object::TrabecularCore2 {
        Listed::All
    } else {
        Listed::Active
    }
}

/// Layers that are formatted at a time.
const LAYERS: usize = 16;

/// Writes `x y z density` a line, z slowest, [`LINE_BYTES`] bytes each; the count of lines.
pub fn write_text(volume: &StandIn, listed: Listed, path: &Path) -> io::Result<u64> {
    let grid = &volume.grid;
    let spelt = [0, 1, 2].map(|axis| -> Vec<String> {
        (0..grid.dims[axis])
            .map(|n| format!("{:10.6} ", n as f64 * grid.spacing_mm[axis]))
            .collect()
    });
    let wanted = |at: usize| {
        let corner = at == 0 || at + 1 == grid.len();
        listed == Listed::All || corner || volume.density_hu[at] >= ACTIVE_HU
    };
    let layer = |k: usize| -> io::Result<Vec<u8>> {
        let mut text = Vec::new();
        for (j, y) in spelt[1].iter().enumerate() {
            for (i, x) in spelt[0].iter().enumerate() {
                let at = grid.dense_index(i, j, k);
                if wanted(at) {
                    for word in [x, y, &spelt[2][k]] {
                        text.extend_from_slice(word.as_bytes());
                    }
                    writeln!(text, "{:5}", volume.density_hu[at])?;
                }
            }
        }
        Ok(text)
    };
    let mut file = File::create(path)?;
    let mut bytes = 0;
    for first in (0..grid.dims[2]).step_by(LAYERS) {
        let layers = first..(first + LAYERS).min(grid.dims[2]);
        let texts: Vec<io::Result<Vec<u8>>> = layers.into_par_iter().map(layer).collect();
        for text in texts {
            let text = text?;
            bytes += text.len() as u64;
            file.write_all(&text)?;
        }
    }
    Ok(bytes / LINE_BYTES)
}
