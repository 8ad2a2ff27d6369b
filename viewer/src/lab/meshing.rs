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

/// Measures all meshers on a bone and its cut, `rounds` times each, on this thread.
pub fn rates(bone: &Bone, cut: &Cut, rounds: usize) -> (Vec<Rate>, Phases) {
    let mut all = Occupied::new(bone.chunk_count());
    let every = 0..bone.chunk_count();
    for chunk in every.clone() {
        read_chunk(bone, cut, chunk, all.rows_mut(chunk));
    }
    let mut apron = Apron::new();
    // a chunk without a surface costs next to nothing: it does not count
    let busy: Vec<usize> = every
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
    let mut words = Vec::new();
    let mut scratch = greedy::Scratch::new();
    let mut net_scratch = nets::Scratch::new();
    let mut out = Net::default();
    let mut rates = vec![Rate {
        mesher: "bits",
        chunks: busy.len(),
        chunks_per_ms: per_ms(busy.len(), bits + aprons),
        without_bits_per_ms: per_ms(busy.len(), aprons),
        pieces: busy.iter().map(|&c| all.count(c) as usize).sum(),
    }];
    let each = 1e6 / busy.len().max(1) as f64;
    let mut phases = Phases {
        bits_us: bits.as_secs_f64() * each,
        apron_us: aprons.as_secs_f64() * each,
        mesh_us: Vec::new(),
    };
    for mesher in ["faces", "greedy", "splats", "nets"] {
        let mut pieces = 0;
        let time = best(rounds, || {
            pieces = 0;
            for &chunk in &busy {
                all.apron(bone, chunk, &mut apron);
                words.clear();
                match mesher {
                    "faces" => faces(&apron, &mut words),
                    "greedy" => greedy(&apron, &mut scratch, &mut words),
                    "splats" => surface_voxels(&apron, &mut words),
                    _ => {
                        let around = Around::new(bone, cut, chunk);
                        net(&apron, &around, &mut net_scratch, &mut out);
                    }
                }
                pieces += if mesher == "nets" {
                    out.indices.len() / 3
                } else {
                    words.len()
                };
                std::hint::black_box((&words, &out));
            }
        });
        rates.push(Rate {
            mesher,
            chunks: busy.len(),
            chunks_per_ms: per_ms(busy.len(), time + bits),
            without_bits_per_ms: per_ms(busy.len(), time),
            pieces,
        });
        let alone = time.saturating_sub(aprons).as_secs_f64() * each;
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
