//! Meshes against plain loops over voxels, and against spheres.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::print_stderr,
    reason = "places in a lattice of a few chunks; a test that shows its figure"
)]

use super::bits::{Apron, EDGE, Occupied, read_chunk};
use super::faces::{DIRECTION_BIT, SIZE_BIT, faces, surface_voxels};
use super::greedy::{self, greedy};
use super::nets::{self, Around, Net, UNITS, net};
use crate::testing::bones::{ball, carve, scapula_like, surgery};
use glam::DVec3;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::CHUNK;
use std::collections::{BTreeMap, BTreeSet};

/// Bones with and without cuts, over several chunks.
fn scenes() -> Vec<(Bone, Cut)> {
    let (first, middle) = ball(75, DVec3::new(0.4, 0.6, 0.9), 14.0);
    let mut cut = Cut::new(&first);
    carve(&first, &mut cut, |p| {
        (p - middle - DVec3::X * 12.0).length() - 6.0
    });
    let (second, plan) = scapula_like(1.0);
    let mut reamed = Cut::new(&second);
    surgery(&second, &mut reamed, &plan);
    let (third, _) = ball(40, DVec3::splat(0.5), 30.0);
    let uncut = Cut::new(&third);
    vec![(first, cut), (second, reamed), (third, uncut)]
}

fn occupied(bone: &Bone, cut: &Cut) -> Occupied {
    let mut all = Occupied::new(bone.chunk_count());
    for chunk in 0..bone.chunk_count() {
        read_chunk(bone, cut, chunk, all.rows_mut(chunk));
    }
    all
}

/// Whether a voxel of the lattice is bone, by the definition.
fn is_bone(bone: &Bone, cut: &Cut, at: [i64; 3]) -> bool {
    let Some(at) = unsigned(at) else { return false };
    bone.locate(at).is_some_and(|(chunk, voxel)| {
        bone.chunk(chunk).solid[voxel].min(cut.value(chunk, voxel)) > 0
    })
}

fn unsigned(at: [i64; 3]) -> Option<[usize; 3]> {
    let [x, y, z] = at.map(usize::try_from);
    Some([x.ok()?, y.ok()?, z.ok()?])
}

fn origin(bone: &Bone, chunk: usize) -> [i64; 3] {
    bone.chunk_coord(chunk).map(|c| i64::from(c) * CHUNK as i64)
}

fn field(word: u32, bit: u32, bits: u32) -> i64 {
    i64::from(word >> bit & ((1 << bits) - 1))
}

/// Unit faces (voxel of the lattice, direction) of words, each with its number.
fn unit_faces(origin: [i64; 3], words: &[u32]) -> BTreeMap<([i64; 3], i64), u32> {
    let mut all = BTreeMap::new();
    for &w in words {
        let direction = field(w, DIRECTION_BIT, 3);
        let axis = usize::try_from(direction / 2).unwrap();
        let sizes = [field(w, SIZE_BIT, 5), field(w, SIZE_BIT + 5, 5)];
        for i in 0..=sizes[0] {
            for j in 0..=sizes[1] {
                let mut at = [0, 1, 2].map(|a| origin[a] + field(w, 5 * a as u32, 5));
                at[(axis + 1) % 3] += i;
                at[(axis + 2) % 3] += j;
                *all.entry((at, direction)).or_insert(0) += 1;
            }
        }
    }
    all
}

#[test]
fn bits_faces_and_merged_faces_are_those_of_a_plain_loop() {
    for (bone, cut) in scenes() {
        let all = occupied(&bone, &cut);
        let (mut apron, mut scratch) = (Apron::new(), greedy::Scratch::new());
        let mut merged_total = 0;
        let mut total = 0;
        for chunk in 0..bone.chunk_count() {
            all.apron(&bone, chunk, &mut apron);
            let o = origin(&bone, chunk);
            for n in 0..EDGE.pow(3) {
                let at = [n % EDGE, n / EDGE % EDGE, n / (EDGE * EDGE)];
                let voxel = [0, 1, 2].map(|a| o[a] + at[a] as i64 - 1);
                let bit = apron.rows[at[2] * EDGE + at[1]] >> at[0] & 1 == 1;
                assert_eq!(
                    bit,
                    is_bone(&bone, &cut, voxel),
                    "chunk {chunk} voxel {voxel:?}"
                );
            }
            let mut expected = BTreeSet::new();
            let mut with_a_face = BTreeSet::new();
            for n in 0..CHUNK.pow(3) {
                let v = [n % CHUNK, n / CHUNK % CHUNK, n / (CHUNK * CHUNK)];
                let v = [0, 1, 2].map(|a| o[a] + v[a] as i64);
                if !is_bone(&bone, &cut, v) {
                    continue;
                }
                for direction in 0..6 {
                    let mut beside = v;
                    beside[direction / 2] += 2 * (direction as i64 & 1) - 1;
                    if !is_bone(&bone, &cut, beside) {
                        expected.insert((v, direction as i64));
                        with_a_face.insert(v);
                    }
                }
            }
            let (mut plain, mut merged, mut voxels) = (Vec::new(), Vec::new(), Vec::new());
            faces(&apron, &mut plain);
            greedy(&apron, &mut scratch, &mut merged);
            surface_voxels(&apron, &mut voxels);
            for words in [&plain, &merged] {
                let got = unit_faces(o, words);
                assert!(got.values().all(|&n| n == 1), "a face came twice");
                assert!(got.keys().eq(expected.iter()), "chunk {chunk}");
            }
            let seen: BTreeSet<_> = voxels
                .iter()
                .map(|&w| [0, 1, 2].map(|a| o[a] + field(w, 5 * a as u32, 5)))
                .collect();
            assert_eq!((seen.len(), &seen), (voxels.len(), &with_a_face));
            total += plain.len();
            merged_total += merged.len();
        }
        assert!(
            total > 1000 && merged_total < total,
            "{merged_total} of {total}"
        );
    }
}

/// Corners and triangles of all chunks, voxel coordinates of the lattice.
fn triangles(bone: &Bone, cut: &Cut) -> Vec<[[i64; 3]; 3]> {
    let all = occupied(bone, cut);
    let (mut apron, mut scratch, mut out) = (Apron::new(), nets::Scratch::new(), Net::default());
    let mut found = Vec::new();
    for chunk in 0..bone.chunk_count() {
        all.apron(bone, chunk, &mut apron);
        net(
            &apron,
            &Around::new(bone, cut, chunk),
            &mut scratch,
            &mut out,
        );
        let o = origin(bone, chunk);
        let corner = |i: u16| {
            let v = out.vertices[usize::from(i)];
            [0, 1, 2].map(|a| i64::from(v[a]) + (o[a] - 1) * UNITS as i64)
        };
        let (whole, _) = out.indices.as_chunks::<3>();
        found.extend(whole.iter().map(|t| t.map(corner)));
    }
    found
}

#[test]
fn nets_are_closed_across_chunks_and_turn_outward() {
    for (bone, cut) in scenes().into_iter().take(2) {
        let all = triangles(&bone, &cut);
        let spacing = bone.grid().spacing_mm;
        let mut edges: BTreeMap<_, i32> = BTreeMap::new();
        let mut volume = 0.0;
        for t in &all {
            for n in 0..3 {
                let (a, b) = (t[n], t[(n + 1) % 3]);
                if a != b {
                    *edges.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
                }
            }
            let [a, b, c] =
                t.map(|v| DVec3::from_array(v.map(|u| u as f64 / f64::from(UNITS))) * spacing);
            volume += a.dot(b.cross(c)) / 6.0;
        }
        // the lattice ends in air: every edge is walked both ways
        assert!(edges.values().all(|&n| n == 0), "a net has a border");
        let left: i64 = (0..bone.chunk_count())
            .map(|c| cut.solid_units(&bone, c))
            .sum();
        let expected = Cut::mm3(bone.grid(), left);
        assert!(
            (volume / expected - 1.0).abs() < 0.01,
            "{volume} {expected}"
        );
    }
}

#[test]
fn the_vertices_of_a_balls_net_lie_on_the_ball() {
    let (bone, middle) = ball(75, DVec3::splat(0.5), 14.0);
    let cut = Cut::new(&bone);
    let mut worst = 0.0f64;
    for v in triangles(&bone, &cut).into_iter().flatten() {
        let p = DVec3::from_array(v.map(|u| u as f64 / f64::from(UNITS))) * 0.5;
        worst = worst.max(((p - middle).length() - 14.0).abs());
    }
    // a mean of points of a curved surface lies below it: at most a cell's diagonal² / 8 R
    assert!(worst < 0.75 / (8.0 * 14.0) + 0.002, "{worst}");
    eprintln!("net of a ball: farthest vertex {worst:.4} mm");
}
