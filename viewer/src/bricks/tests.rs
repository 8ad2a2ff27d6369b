//! The brick map against plain loops over the lattice.

use super::*;
use crate::testing::bones::{ball, carve};
use glam::DVec3;

/// The value of a half float, by the definition of IEEE 754.
fn widened(half: u16) -> f64 {
    let sign = if half & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, mantissa) = (i32::from(half >> 10 & 31), f64::from(half & 0x3ff));
    assert!(exponent < 31);
    if exponent == 0 {
        sign * mantissa * 2f64.powi(-24)
    } else {
        sign * (1.0 + mantissa / 1024.0) * 2f64.powi(exponent - 15)
    }
}

#[test]
fn halves_are_within_half_a_unit_in_the_last_place() {
    for units in -i16::MAX..=i16::MAX {
        let exact = f64::from(units) / f64::from(i16::MAX);
        let got = widened(half(units));
        let tolerance = (exact.abs() / 2048.0).max(6.2e-5);
        assert!(
            (got - exact).abs() <= tolerance * 1.0001,
            "{units}: {got} {exact}"
        );
    }
    assert!((widened(half(i16::MAX)) - 1.0).abs() < 1e-12);
}

#[test]
fn a_tile_shows_the_lattice_around_its_brick() {
    let (bone, middle) = ball(70, DVec3::new(0.6, 0.5, 0.7), 14.0);
    let mut cut = Cut::new(&bone);
    carve(&bone, &mut cut, |p| {
        (p - middle - DVec3::X * 12.0).length() - 6.0
    });
    let map = BrickMap::new(&bone).unwrap();
    let mut tile = vec![[0; 2]; TILE_TEXELS];
    for slot in (0..map.slots()).step_by(7) {
        map.gather_field(&bone, &cut, slot, &mut tile);
        let (chunk, brick) = map.bricks[slot];
        let lo = lattice_brick(&bone, chunk as usize, usize::from(brick));
        for (t, texel) in tile.iter().enumerate() {
            let inner = [t % TILE, t / TILE % TILE, t / (TILE * TILE)];
            #[expect(clippy::cast_possible_wrap, reason = "below 4096")]
            let voxel: [isize; 3] =
                core::array::from_fn(|a| (lo[a] * BRICK + inner[a]) as isize - 1);
            let at = voxel.map(usize::try_from);
            let place = if let [Ok(i), Ok(j), Ok(k)] = at {
                bone.locate([i, j, k])
            } else {
                None
            };
            let expected = place.map_or([-i16::MAX, UNCUT], |(c, v)| {
                [bone.chunk(c).solid[v], cut.value(c, v)]
            });
            assert_eq!(*texel, expected.map(half), "slot {slot} voxel {voxel:?}");
        }
    }
}

#[test]
fn emptiness_is_the_distance_to_the_nearest_slot() {
    let (bone, _) = ball(100, DVec3::splat(0.5), 20.0);
    let map = BrickMap::new(&bone).unwrap();
    let [nx, ny, nz] = map.dims;
    let cell = |at: usize| [at % nx, at / nx % ny, at / (nx * ny)];
    let full: Vec<_> = (0..nx * ny * nz)
        .filter(|&at| map.index[at] & EMPTY == 0)
        .map(cell)
        .collect();
    let mut empty = 0;
    for at in 0..nx * ny * nz {
        if map.index[at] & EMPTY != 0 {
            let c = cell(at);
            let far = full
                .iter()
                .map(|f| (0..3).map(|a| f[a].abs_diff(c[a])).max().unwrap());
            assert_eq!(map.index[at] & !EMPTY, far.min().unwrap() as u32, "{c:?}");
            empty += 1;
        }
    }
    assert!(empty > 0 && full.len() == map.slots());
}

#[test]
fn a_changed_corner_marks_all_eight_tiles_that_show_it_and_an_inner_voxel_one() {
    let (bone, _) = ball(64, DVec3::ONE, 28.0);
    let map = BrickMap::new(&bone).unwrap();
    let count = |voxel: [usize; 3]| {
        let mut dirty = Dirty::all(&map);
        while dirty.pop().is_some() {}
        let mut values = [UNCUT; BRICK_VOXELS];
        values[offset_in_brick(voxel)] = 5;
        assert!(dirty.mark_change(&map, [3, 3, 3], None, &values));
        assert!(
            dirty.mark_change(&map, [3, 3, 3], None, &values),
            "marks once, changes twice"
        );
        dirty.len()
    };
    assert_eq!(count([0, 0, 0]), 8);
    assert_eq!(count([7, 7, 7]), 8);
    assert_eq!(count([7, 0, 0]), 8);
    assert_eq!(count([4, 4, 3]), 1);
    assert_eq!(count([0, 4, 3]), 2);
}
