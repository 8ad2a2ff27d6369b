//! The phases of Table 2.2, timed on a text file of a stand-in.

use super::{Object, StandIn, cubes, listed, write_text};
use anyhow::{Context as _, Result, ensure};
use osteon_firmware_bridge::scene::dense::{Dense, distance, near_bone};
use osteon_firmware_bridge::scene::text_ct::{Options, TextCt};
use osteon_sim_core::grid::CHUNK_VOXELS;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::Tissue;
use rayon::prelude::*;
use std::path::Path;
use std::time::Instant;

/// Seconds from a text file to a bone. The file has just been written: it is read from the
/// system's cache, not from a disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phases {
    /// Bytes of the text file.
    pub text_bytes: u64,
    /// Its lines.
    pub lines: u64,
    /// First reading: every line checked, the lattice found.
    pub survey_s: f64,
    /// Second reading: densities into the rectangular grid.
    pub fill_s: f64,
    /// Rectangular grid to cubes; next to nothing where it has cubes already.
    pub cubes_s: f64,
    /// Distance to the bone's surface, which the thesis does not have.
    pub distance_s: f64,
    /// Cubes to chunks: classes, quantised distances, masks, empty chunks dropped.
    pub chunks_s: f64,
    /// Chunks kept.
    pub chunks: usize,
    /// Bytes of their voxels: density and distance at 2 B, class and label at 1 B.
    pub chunk_bytes: usize,
}

impl Phases {
    /// Rate of both readings together, millions of bytes of text a second.
    pub fn read_mb_per_s(&self) -> f64 {
        self.text_bytes as f64 / 1e6 / (self.survey_s + self.fill_s)
    }
}

/// Writes the text file of `object` into `folder`, builds its bone from it, and removes it.
pub fn phases(object: Object, seed: u64, folder: &Path) -> Result<Phases> {
    let path = folder.join(format!("{}.txt", object.name().replace(' ', "-")));
    let lines = write_text(&object.stand_in(seed), listed(object), &path)
        .with_context(|| path.display().to_string())?;
    let timed = from_text(&path, lines);
    let removed = std::fs::remove_file(&path).with_context(|| path.display().to_string());
    let phases = timed?;
    removed?;
    Ok(phases)
}

/// Runs `work`; its result and the seconds it took.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let begun = Instant::now();
    let result = work();
    (result, begun.elapsed().as_secs_f64())
}

fn from_text(path: &Path, lines: u64) -> Result<Phases> {
    let text = TextCt::open(path, Options::default())?;
    let (survey, survey_s) = timed(|| text.survey(&mut |_done| {}));
    let survey = survey?;
    let (rect, fill_s) = timed(|| text.fill(&survey, &mut |_done| {}));
    let rect = rect?;
    ensure!(survey.voxels() as u64 == lines, "lines were lost");
    let volume = StandIn {
        grid: rect.grid,
        density_hu: rect.density_hu,
    };
    let (volume, cubes_s) = timed(|| cubes(&volume));
    let volume = volume?;
    let grid = volume.grid;
    let (solid_mm, distance_s) = timed(|| {
        let phi: Vec<f32> = volume
            .density_hu
            .par_iter()
            .map(|&hu| f32::from(hu) - f32::from(super::ACTIVE_HU) + 0.5)
            .collect();
        distance(&grid, &phi)
    });
    let solid_mm = solid_mm?;
    let (bone, chunks_s) = timed(|| {
        let class = |&d: &f32| {
            if near_bone(&grid, d) {
                Tissue::Cancellous as u8
            } else {
                Tissue::Air as u8
            }
        };
        Dense {
            class: solid_mm.par_iter().map(class).collect(),
            label: vec![0; grid.len()],
            grid,
            lps_from_bone: Pose::IDENTITY,
            density_hu: volume.density_hu,
            solid_mm,
        }
        .into_bone()
    });
    let chunks = bone?.chunk_count();
    Ok(Phases {
        text_bytes: text.bytes(),
        lines,
        survey_s,
        fill_s,
        cubes_s,
        distance_s,
        chunks_s,
        chunks,
        chunk_bytes: chunks * CHUNK_VOXELS * 6,
    })
}
