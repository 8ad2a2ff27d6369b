//! Round trips, order, block sizes and bad files, against volumes that were planted.

use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Pseudo-random numbers (splitmix64), so that a failure can be repeated.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        usize::try_from(self.next() % n as u64).expect("small")
    }

    fn shuffle<T>(&mut self, values: &mut [T]) {
        for n in (1..values.len()).rev() {
            values.swap(n, self.below(n + 1));
        }
    }
}

const DIMS: [usize; 3] = [9, 7, 5];
const SPACING: [f64; 3] = [0.47, 0.47, 1.0];
const ORIGIN: [f64; 3] = [-3.29, 12.5, -100.0];

/// Lines of a planted volume, x fastest; about one voxel in three is left out, but none of the
/// corners, so that the box is known.
struct Planted {
    lines: Vec<String>,
    voxels: BTreeMap<usize, i16>,
}

fn planted(seed: u64) -> Planted {
    let mut random = Random(seed);
    let (mut lines, mut voxels) = (Vec::new(), BTreeMap::new());
    let [nx, ny, nz] = DIMS;
    for at in 0..nx * ny * nz {
        let c = [at % nx, at / nx % ny, at / (nx * ny)];
        let corner = (0..3).all(|a| c[a] == 0 || c[a] + 1 == DIMS[a]);
        let hu = i16::try_from(random.below(65_535)).map_or_else(|_| -5, |v| v - 20_000);
        if random.below(3) > 0 || corner {
            let p: [f64; 3] = core::array::from_fn(|a| ORIGIN[a] + c[a] as f64 * SPACING[a]);
            lines.push(format!("{:.3} {:.3} {:.3} {hu}", p[0], p[1], p[2]));
            voxels.insert(at, hu);
        }
    }
    Planted { lines, voxels }
}

fn read_with(text: &[u8], options: Options) -> Result<RectGrid, TextCtError> {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("ct.txt");
    std::fs::write(&path, text).expect("written");
    read(&path, options, &mut |_| ())
}

fn read_text(text: &str) -> Result<RectGrid, TextCtError> {
    read_with(text.as_bytes(), Options::default())
}

fn joined(lines: &[String]) -> String {
    lines.join("\n")
}

/// What the planted volume must come out as.
fn expected(planted: &Planted) -> RectGrid {
    let count: usize = DIMS.iter().product();
    RectGrid {
        grid: Grid::new(DIMS, DVec3::from_array(SPACING)).expect("a grid"),
        origin_mm: DVec3::from_array(ORIGIN),
        density_hu: (0..count)
            .map(|at| planted.voxels.get(&at).copied().unwrap_or(EMPTY_HU))
            .collect(),
        absent: count - planted.voxels.len(),
    }
}

#[test]
fn a_volume_comes_back_as_it_was_written_in_any_notation_and_order() {
    for seed in 0..20 {
        let mut planted = planted(seed);
        let expected = expected(&planted);
        let text = joined(&planted.lines);
        assert_eq!(read_text(&text).expect("sorted"), expected);
        let notations = [
            format!("# a comment\n\nx y z density\n{text}\n"),
            format!(
                "\u{feff}X,Y,Z,D\r\n{}\r\n",
                text.replace(' ', ", ").replace('\n', "\r\n")
            ),
            format!(
                "{}\n#end",
                text.replace(' ', "\t").replace('\n', "\n# between\n\n")
            ),
        ];
        for text in notations {
            assert_eq!(read_text(&text).expect("a notation"), expected);
        }
        Random(seed + 100).shuffle(&mut planted.lines);
        let shuffled = read_text(&joined(&planted.lines)).expect("shuffled");
        assert_eq!(shuffled, expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn where_the_blocks_are_cut_does_not_matter(block_bytes in 1_usize..300, seed in 0_u64..1000) {
        let mut planted = planted(seed);
        let options = Options { block_bytes, ..Options::default() };
        let text = format!("x y z d\r\n{}", planted.lines.join("\r\n"));
        prop_assert_eq!(
            read_with(text.as_bytes(), options).expect("a volume"),
            expected(&planted)
        );
        // a planted fault: its line, wherever the cuts are
        let bad = Random(seed).below(planted.lines.len());
        planted.lines[bad] = "0.1 0.2 bone 7".to_owned();
        let error = read_with(joined(&planted.lines).as_bytes(), options).expect_err("a fault");
        prop_assert!(error.to_string().contains(&format!("line {}: `bone`", bad + 1)), "{}", error);
    }
}

/// The one-line error of a text, which must hold all `words`.
fn refused(text: &str, words: &[&str]) {
    for block_bytes in [1 << 20, 64, 7] {
        let options = Options {
            block_bytes,
            ..Options::default()
        };
        let error = read_with(text.as_bytes(), options).expect_err("must be refused");
        let error = error.to_string();
        assert!(
            !error.contains('\n') && error.contains("ct.txt: "),
            "{error}"
        );
        for word in words {
            assert!(error.contains(word), "`{word}` in: {error}");
        }
    }
}

#[test]
fn every_bad_file_is_one_line_with_place_and_remedy() {
    let good = planted(7);
    let with = |at: usize, line: &str| {
        let mut lines = good.lines.clone();
        lines.insert(at, line.to_owned());
        joined(&lines)
    };
    refused("", &["holds no voxel; give lines of"]);
    refused("# nothing\nx y z d\n\n", &["holds no voxel"]);
    refused(
        &with(41, "1 2 3"),
        &["line 42: 3 numbers where 4", "give `x y z density`"],
    );
    refused(
        &with(0, "1,5 2,5 3,5 4"),
        &["line 1: 7 numbers", "decimal point"],
    );
    refused(
        &with(99, "1 2 3 dense"),
        &["line 100: `dense` is no number"],
    );
    refused(&with(5, "1 NaN 3 4"), &["line 6: y = NaN is no position"]);
    refused(&with(5, "1 2 inf 4"), &["line 6: z = inf"]);
    refused(
        &with(5, "4e12 2 3 4"),
        &["line 6: x = 4000000000000", "100000 mm"],
    );
    refused(
        &with(5, "1 2 3 40000"),
        &["line 6: density = 40000", "32767", "rescale"],
    );
    refused(
        &with(5, &"1 ".repeat(600)),
        &["line 6: longer than 1024 bytes"],
    );
    refused(
        &with(77, "90000 12.5 -100 7"),
        &["line 78", "voxels of 0.47 mm, at most 4096"],
    );
    refused(
        &with(33, "-1.100 12.500 -100.000 7"),
        &[
            "line 34: x = -1.1 lies 0.34 of a voxel off",
            "0.47 mm",
            "resample",
        ],
    );
    refused(
        "1 2 3 4\n2 2 4 5\n",
        &["every voxel has y = 2", "two planes"],
    );
    refused(
        "0 0 0 1\n40 40 40 1\n",
        &["x goes in steps of 40 mm", "millimetres"],
    );
    refused(
        "\u{1f}\u{8b}\u{8}\0\0\0\n\0\0",
        &["line 1: `", "is no number"],
    );
}

#[test]
fn of_lines_off_the_lattice_the_first_is_named() {
    let mut lines = planted(9).lines;
    for at in [150, 90, 20] {
        lines.insert(at, format!("0.000 13.200 {at} 7"));
    }
    refused(&joined(&lines), &["line 21: y = 13.2 lies 0.49"]);
}

#[test]
fn of_a_voxel_that_comes_twice_both_lines_are_named() {
    let good = planted(3);
    let mut lines = good.lines.clone();
    let again = lines[10].replace(' ', ",  ");
    lines.insert(150, again);
    // a later pair is not the one to be named
    lines.push(lines[20].clone());
    let text = format!("x y z d\n{}", joined(&lines));
    refused(
        &text,
        &[
            "line 152: the voxel at (",
            "is already on line 12; remove one",
        ],
    );
}

#[test]
fn points_that_are_no_grid_are_refused_while_they_come() {
    let mut random = Random(5);
    let mut text = String::new();
    for _ in 0..70_000 {
        let mut v = || random.below(1_000_000_000) as f64 * 1e-7;
        writeln!(text, "{:.7} {:.7} {:.7} 9", v(), v(), v()).expect("a string");
    }
    let error = read_text(&text).expect_err("scattered").to_string();
    assert!(
        error.contains("x has taken 65537 values by here"),
        "{error}"
    );
}

#[test]
fn a_grid_larger_than_memory_is_refused_with_its_size() {
    // a few lines say 4000 × 4000 × 4000: nothing of it may be allocated
    let mut text = String::new();
    for n in 0..4000 {
        writeln!(text, "{n} {n} {n} 500").expect("a string");
    }
    refused(
        &text,
        &[
            "a grid of [4000, 4000, 4000] has 64000000000 voxels",
            "crop",
        ],
    );
    let text = text.lines().take(900).collect::<Vec<_>>().join("\n");
    let options = Options {
        memory_bytes: Some(1_000_000_000),
        ..Options::default()
    };
    let error = read_with(text.as_bytes(), options)
        .expect_err("too large")
        .to_string();
    let words = [
        "[900, 900, 900] needs 11664 MB",
        "1000 MB are available",
        "close other programs",
    ];
    for word in words {
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn what_is_no_file_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let of = |name: &str| {
        read(&dir.path().join(name), Options::default(), &mut |_| ())
            .expect_err("no file")
            .to_string()
    };
    assert!(of("no.txt").contains("no.txt: cannot be read"));
    std::fs::create_dir(dir.path().join("folder.txt")).expect("a folder");
    assert!(of("folder.txt").contains("folder.txt: is no regular file"));
    // a pipe without a writer must not be waited for
    let pipe = dir.path().join("pipe.txt");
    let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
    rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, mode, 0)
        .expect("a pipe");
    assert!(of("pipe.txt").contains("pipe.txt: is no regular file"));
}

#[test]
fn a_file_that_changes_between_the_readings_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("ct.txt");
    let planted = planted(1);
    std::fs::write(&path, joined(&planted.lines)).expect("written");
    let text = TextCt::open(&path, Options::default()).expect("open");
    let survey = text.survey(&mut |_| ()).expect("a lattice");
    for other in [&planted.lines[1..], &["500 500 500 1".to_owned()]] {
        std::fs::write(&path, joined(other)).expect("written");
        let error = text.fill(&survey, &mut |_| ()).expect_err("changed");
        assert!(error.to_string().contains("changed while it was read"));
    }
}

#[test]
fn the_margin_is_empty_and_the_rest_stays_where_it_was() {
    let planted = planted(2);
    let rect = read_text(&joined(&planted.lines)).expect("a volume");
    let volume = rect.clone().into_volume(2);
    assert_eq!(volume.grid.dims, DIMS.map(|n| n + 4));
    let mut sum = 0;
    for (at, hu) in rect.density_hu.iter().enumerate() {
        let c = [at % 9, at / 9 % 7, at / 63];
        let padded = volume.grid.dense_index(c[0] + 2, c[1] + 2, c[2] + 2);
        assert_eq!(volume.values[padded].to_bits(), f32::from(*hu).to_bits());
        let p = volume
            .lps_from_bone
            .point(volume.grid.centre(c[0] + 2, c[1] + 2, c[2] + 2));
        let q = rect.origin_mm + rect.grid.centre(c[0], c[1], c[2]);
        assert!(p.distance(q) < 1e-9);
        sum += usize::from(*hu != EMPTY_HU);
    }
    assert_eq!(volume.values.iter().filter(|v| v.abs() > 0.5).count(), sum);
    assert_eq!(rect.clone().into_volume(0).grid, rect.grid);
}

#[test]
fn the_progress_ends_at_one_and_never_goes_back() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("ct.txt");
    std::fs::write(&path, joined(&planted(1).lines)).expect("written");
    let mut heard = Vec::new();
    let options = Options {
        block_bytes: 50,
        ..Options::default()
    };
    read(&path, options, &mut |done| heard.push(done)).expect("a volume");
    assert!(heard.is_sorted() && heard.len() > 4, "{heard:?}");
    assert!(heard.last().is_some_and(|&last| last > 0.999));
}
