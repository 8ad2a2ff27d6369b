//! The densities of a text CT in their grid (the thesis's Alg. 2.4), from all cores at once.

use super::blocks::Text;
use super::line::Entry;
use super::survey::Survey;
use super::{EMPTY_HU, Problem, RectGrid};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicI16, Ordering};

/// A voxel that no line has named; no density of a file has this value.
const VACANT: i16 = i16::MIN;

#[derive(Default)]
struct Block {
    voxels: usize,
    // voxels that were there already, and positions that the first reading did not have
    twice: usize,
    elsewhere: usize,
}

/// The second reading.
pub(super) fn fill(
    text: &Text,
    survey: &Survey,
    progress: &mut dyn FnMut(f32),
) -> Result<RectGrid, Problem> {
    let count = survey.grid().len();
    // each voxel is written once, so the order of threads does not matter
    let cells: Vec<AtomicI16> = (0..count).map(|_| AtomicI16::new(VACANT)).collect();
    let visit = |block: &mut Block, _line: u32, entry: &Entry| {
        block.voxels += 1;
        match survey.voxel(entry.at) {
            Some(at) => {
                let before = cells[at].swap(entry.density_hu, Ordering::Relaxed);
                block.twice += usize::from(before != VACANT);
            }
            None => block.elsewhere += 1,
        }
    };
    let (mut voxels, mut twice, mut elsewhere) = (0, 0, 0);
    let merge = |_first: u64, block: Block| {
        voxels += block.voxels;
        twice += block.twice;
        elsewhere += block.elsewhere;
        Ok(())
    };
    text.scan(visit, merge, progress)?;
    if elsewhere > 0 || voxels != survey.voxels() {
        return Err(Problem::Changed);
    }
    if twice > 0 {
        return Err(first_duplicate(text, survey));
    }
    let density_hu = cells
        .into_par_iter()
        .map(|cell| match cell.into_inner() {
            VACANT => EMPTY_HU,
            density => density,
        })
        .collect();
    Ok(RectGrid {
        grid: *survey.grid(),
        origin_mm: survey.origin_mm(),
        density_hu,
        absent: count - voxels,
    })
}

/// Names the first line whose voxel an earlier line has, and that one.
fn first_duplicate(text: &Text, survey: &Survey) -> Problem {
    type Places = Vec<(DVec3, u32)>;
    let visit = |places: &mut Places, line: u32, entry: &Entry| places.push((entry.at, line));
    let mut seen = vec![0_u64; survey.grid().len().div_ceil(64)];
    let look = |first: u64, places: Places| {
        for (at, line) in places {
            let Some(voxel) = survey.voxel(at) else {
                return Err(Problem::Changed);
            };
            let (word, bit) = (&mut seen[voxel / 64], 1 << (voxel % 64));
            if *word & bit != 0 {
                let line = first + u64::from(line);
                let [x, y, z] = at.to_array();
                return Err(Problem::Duplicate {
                    line,
                    first: 0,
                    x,
                    y,
                    z,
                });
            }
            *word |= bit;
        }
        Ok(())
    };
    let found = text.scan(visit, look, &mut |_done| {});
    let Err(Problem::Duplicate { line, x, y, z, .. }) = found else {
        return found.err().unwrap_or(Problem::Changed);
    };
    let voxel = survey.voxel(DVec3::new(x, y, z));
    let mut earlier = None;
    let same = |places: &mut Vec<u32>, line: u32, entry: &Entry| {
        if survey.voxel(entry.at) == voxel {
            places.push(line);
        }
    };
    let keep_first = |first: u64, places: Vec<u32>| {
        if earlier.is_none() {
            earlier = places.first().map(|&line| first + u64::from(line));
        }
        Ok(())
    };
    match text.scan(same, keep_first, &mut |_done| {}) {
        Ok(()) => Problem::Duplicate {
            line,
            first: earlier.unwrap_or(line),
            x,
            y,
            z,
        },
        Err(problem) => problem,
    }
}
