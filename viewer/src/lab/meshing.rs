//! How fast chunks become meshes, on one core.

use crate::meshing::bits::{Apron, Occupied, read_chunk};
use crate::meshing::faces::{faces, surface_voxels};
use crate::meshing::greedy::{self, greedy};
use crate::meshing::nets::{self, Around, Net, net};
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use std::time::{Duration, Instant};

/// One way to make meshes, over all chunks of a bone that hold any.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Rate {
    /// `bits`, `faces`, `greedy`, `splats` or `nets`.
    pub mesher: &'static str,
    /// Chunks with a mesh.
    pub chunks: usize,
    /// Chunks a millisecond, bits and apron included: the best of all rounds.
    pub chunks_per_ms: f64,
    /// The same without bits.
    pub without_bits_per_ms: f64,
    /// Faces, rectangles, voxels or triangles of all chunks.
    pub pieces: usize,
}

/// Time of one phase of meshing a chunk, µs a chunk: the best of all rounds.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Phases {
    /// One bit a voxel from the fields.
    pub bits_us: f64,
    /// Bits of the chunk and of one voxel around it.
    pub apron_us: f64,
    /// The mesh itself, by mesher in the order of [`rates`].
    pub mesh_us: Vec<(&'static str, f64)>,
}

/// Runs a job over chunks again and again; the shortest time of one round.
fn best(rounds: usize, mut job: impl FnMut()) -> Duration {
    let times = (0..rounds.max(1)).map(|_| {
        let begin = Instant::now();
        job();
        begin.elapsed()
    });
    times.min().unwrap_or_default()
}

/// What the meshers work with, and the times of what they have in common.
struct Work<'a> {
    bone: &'a Bone,
    cut: &'a Cut,
    all: Occupied,
    busy: Vec<usize>,
    rounds: usize,
    bits: Duration,
    aprons: Duration,
}

impl<'a> Work<'a> {
    fn new(bone: &'a Bone, cut: &'a Cut, rounds: usize) -> Self {
        let mut all = Occupied::new(bone.chunk_count());
        for chunk in 0..bone.chunk_count() {
            read_chunk(bone, cut, chunk, all.rows_mut(chunk));
        }
        let mut apron = Apron::new();
        // a chunk without a surface costs next to nothing: it does not count
        let busy: Vec<usize> = (0..bone.chunk_count())
            .filter(|&chunk| {
                all.apron(bone, chunk, &mut apron);
                let mut voxels = Vec::new();
                surface_voxels(&apron, &mut voxels);
                !voxels.is_empty()
            })
            .collect();
        let bits = best(rounds, || {
            for &chunk in &busy {
                read_chunk(bone, cut, chunk, all.rows_mut(chunk));
            }
        });
        let aprons = best(rounds, || {
            for &chunk in &busy {
                all.apron(bone, chunk, &mut apron);
                std::hint::black_box(&apron);
            }
        });
        Self {
            bone,
            cut,
            all,
            busy,
            rounds,
            bits,
            aprons,
        }
    }

    /// Time of all chunks with their aprons, and the pieces that came of it.
    fn time(&self, mesher: &str) -> (Duration, usize) {
        let mut apron = Apron::new();
        let (mut words, mut out) = (Vec::new(), Net::default());
        let (mut scratch, mut net_scratch) = (greedy::Scratch::new(), nets::Scratch::new());
        let mut pieces = 0;
        let time = best(self.rounds, || {
            pieces = 0;
            for &chunk in &self.busy {
                self.all.apron(self.bone, chunk, &mut apron);
                words.clear();
                match mesher {
                    "faces" => faces(&apron, &mut words),
                    "greedy" => greedy(&apron, &mut scratch, &mut words),
                    "splats" => surface_voxels(&apron, &mut words),
                    _ => {
                        let around = Around::new(self.bone, self.cut, chunk);
                        net(&apron, &around, &mut net_scratch, &mut out);
                    }
                }
                pieces += words.len() + out.indices.len() / 3;
                std::hint::black_box((&words, &out));
            }
        });
        (time, pieces)
    }
}

/// Measures all meshers on a bone and its cut, `rounds` times each, on this thread.
pub fn rates(bone: &Bone, cut: &Cut, rounds: usize) -> (Vec<Rate>, Phases) {
    let work = Work::new(bone, cut, rounds);
    let chunks = work.busy.len();
    let each = 1e6 / chunks.max(1) as f64;
    let solid = work.busy.iter().map(|&c| work.all.count(c) as usize).sum();
    let rate = |mesher, time: Duration, pieces| Rate {
        mesher,
        chunks,
        chunks_per_ms: per_ms(chunks, time + work.bits),
        without_bits_per_ms: per_ms(chunks, time),
        pieces,
    };
    let mut rates = vec![rate("bits", work.aprons, solid)];
    let mut phases = Phases {
        bits_us: work.bits.as_secs_f64() * each,
        apron_us: work.aprons.as_secs_f64() * each,
        mesh_us: Vec::new(),
    };
    for mesher in ["faces", "greedy", "splats", "nets"] {
        let (time, pieces) = work.time(mesher);
        rates.push(rate(mesher, time, pieces));
        let alone = time.saturating_sub(work.aprons).as_secs_f64() * each;
        phases.mesh_us.push((mesher, alone));
    }
    (rates, phases)
}

fn per_ms(chunks: usize, time: Duration) -> f64 {
    chunks as f64 / (time.as_secs_f64() * 1e3).max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::bones::{scapula_like, surgery};

    #[test]
    #[expect(clippy::print_stderr, reason = "a test that shows its figures")]
    fn every_mesher_is_measured_on_chunks_with_a_surface() {
        let fine = std::env::var_os("OSTEON_MESHING").is_some();
        let (bone, plan) = scapula_like(if fine { 0.47 } else { 1.0 });
        let mut cut = Cut::new(&bone);
        surgery(&bone, &mut cut, &plan);
        let (rates, phases) = rates(&bone, &cut, if fine { 50 } else { 1 });
        eprintln!("{rates:#?}\n{phases:#?}");
        let names: Vec<_> = rates.iter().map(|r| r.mesher).collect();
        assert_eq!(names, ["bits", "faces", "greedy", "splats", "nets"]);
        assert!(
            rates
                .iter()
                .all(|r| r.chunks > 0 && r.pieces > 0 && r.chunks_per_ms > 0.0)
        );
        assert!(rates[2].pieces < rates[1].pieces);
    }
}
