//! The STL reader.

use super::{ascii, ball, binary};
use crate::tools::on_all_cores;
use crate::tools::stl::{StlError, parse, read};
use osteon_sim_core::tool::mesh::Mesh;
use osteon_sim_core::tool::sdf_grid::{SdfGrid, one_by_one};
use proptest::prelude::*;
use std::fs::File;
use std::io::Write as _;
use std::time::{Duration, Instant};

fn refused(bytes: &[u8], words: &[&str]) {
    let error = parse(bytes, bytes.len() as u64).expect_err("a refusal");
    let line = error.to_string();
    for word in words {
        assert!(line.contains(word), "'{line}' lacks '{word}'");
    }
    assert!(!line.contains('\n'), "{line}");
}

#[test]
fn binary_and_ascii_give_the_same_triangles() {
    let truth = ball(3.0);
    for title in ["made by hand", "solid but binary"] {
        let bytes = binary(title, &truth);
        let soup = parse(bytes.as_slice(), bytes.len() as u64).expect("read");
        assert_eq!(soup.triangles, truth, "{title}");
        // a stray byte or two at the end
        let more = [bytes.as_slice(), b"\n\0"].concat();
        let soup = parse(more.as_slice(), more.len() as u64).expect("read");
        assert_eq!((soup.triangles.len(), soup.trailing), (truth.len(), 2));
    }
    let text = ascii(&truth);
    let one_line_a_facet = text
        .replace("\n  ", " ")
        .replace("\n endfacet", " endfacet");
    let dos = text.to_uppercase().replace('\n', "\r\n");
    for text in [text, one_line_a_facet, dos] {
        let soup = parse(text.as_bytes(), text.len() as u64).expect("read");
        assert_eq!(soup.triangles, truth);
    }
}

#[test]
fn spoilt_files_are_refused_with_place_and_remedy() {
    let good = binary("solid", &ball(3.0));
    let text = ascii(&ball(3.0));
    refused(b"", &["no triangle"]);
    refused(b"\x00\x01 nothing", &["no STL", "10 bytes"]);
    refused(&[0; 84], &["no triangle"]);
    refused(b"solid x\nendsolid x\n", &["no triangle"]);
    refused(&good[..5000], &["truncated", "2048", "98", "again"]);
    refused(&good[..100], &["truncated", "2048", "holds 0"]);
    let mut few = good.clone();
    few[80..84].copy_from_slice(&7u32.to_le_bytes());
    refused(&few, &["7 triangles", "2048"]);
    few[80..84].copy_from_slice(&0u32.to_le_bytes());
    refused(&few, &["0 triangles", "2048"]);
    few[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    refused(&few, &["4294967295 triangles", "2000000", "decimate"]);
    refused(&text.as_bytes()[..9999], &["truncated", "line"]);
    refused(text.replace("endsolid", "").as_bytes(), &["truncated"]);
    let words = [
        ("vertex", "vertices", "out of place"),
        ("vertex", "vertex north", "three numbers"),
        ("endloop", "vertex 1 2 3\nendloop", "more than three"),
        ("endfacet", "", "out of place"),
        ("endloop", "\u{1b}[2J", "\\u{1b}"),
    ];
    for (from, to, said) in words {
        refused(text.replacen(from, to, 1).as_bytes(), &["line", said]);
    }
    let long = text.replacen("vertex", &" ".repeat(5000), 1);
    refused(long.as_bytes(), &["line 4", "longer than 4096"]);
}

#[test]
fn a_file_of_ten_million_triangles_is_refused_before_it_is_read() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("huge.stl");
    let mut file = File::create(&path).expect("a file");
    let mut head = [0u8; 84];
    head[80..].copy_from_slice(&10_000_000u32.to_le_bytes());
    file.write_all(&head).expect("written");
    // a hole in the file: no block on the disk
    file.set_len(84 + 50 * 10_000_000).expect("long");
    let began = Instant::now();
    let error = read(&path).expect_err("a refusal");
    assert!(matches!(error, StlError::TooMany(10_000_000)), "{error}");
    assert!(began.elapsed() < Duration::from_millis(200));
    // the same as text: refused by its size
    let mut text = File::create(&path).expect("a file");
    text.write_all(ascii(&ball(1.0)).as_bytes())
        .expect("written");
    text.set_len(3_000_000_000).expect("long");
    let error = read(&path).expect_err("a refusal");
    assert!(matches!(error, StlError::TooLong(3_000_000_000)), "{error}");
    assert!(began.elapsed() < Duration::from_millis(400));
}

#[test]
fn what_is_no_file_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    assert!(matches!(read(dir.path()), Err(StlError::NoFile)));
    assert!(matches!(read("/dev/zero".as_ref()), Err(StlError::NoFile)));
    let missing = read(&dir.path().join("none.stl")).expect_err("a refusal");
    assert!(missing.to_string().contains("check the path"), "{missing}");
}

#[test]
fn any_number_of_threads_gives_the_same_grid() {
    let mut open = ball(3.0);
    open.truncate(1900);
    let mesh = Mesh::new(open).expect("a mesh");
    let truth = SdfGrid::new(&mesh, Some(0.4), &one_by_one).expect("a grid");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let grid = pool
            .expect("threads")
            .install(|| SdfGrid::new(&mesh, Some(0.4), &on_all_cores));
        assert_eq!(grid.expect("a grid"), truth);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000), solid in any::<bool>()) {
        let bytes = if solid { [b"solid", bytes.as_slice()].concat() } else { bytes };
        let soup = parse(bytes.as_slice(), bytes.len() as u64);
        prop_assert!(soup.is_err() || bytes.len() >= 84);
    }

    #[test]
    fn spoilt_bytes_never_panic(
        spots in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        as_text in any::<bool>(),
    ) {
        let triangles = &ball(3.0)[..40];
        let mut bytes = if as_text { ascii(triangles).into_bytes() } else { binary("x", triangles) };
        for (at, value) in spots {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        for length in [bytes.len(), cut.index(bytes.len())] {
            if let Ok(soup) = parse(&bytes[..length], length as u64) {
                // a few triangles of whatever numbers: made a mesh or refused
                let mesh = Mesh::new(soup.triangles);
                prop_assert!(mesh.is_err() || mesh.is_ok_and(|m| m.findings().triangles >= 4));
            }
        }
    }
}
