//! Parameters as data.

use super::toml_feel::parse;
use super::{FeelArgs, in_force, load, to_toml};
use osteon_sim_core::feel::{FIELDS, Feel};
use proptest::prelude::*;
use std::path::Path;

const STANDARD: &str = include_str!("../../feel/standard.toml");

fn feel(bytes: &[u8]) -> Result<Feel, String> {
    parse(Path::new("my.toml"), bytes).map_err(|e| e.to_string())
}

fn refused(text: &[u8], words: &[&str]) {
    let line = feel(text).expect_err("a refusal");
    for word in [&["my.toml", "line "], words].concat() {
        assert!(line.contains(word), "'{line}' lacks '{word}'");
    }
    assert!(!line.contains('\n') && line.len() < 400, "{line}");
}

#[test]
fn the_shipped_file_is_the_defaults_and_explains_every_key() {
    assert_eq!(feel(STANDARD.as_bytes()), Ok(Feel::default()));
    // written anew with: cargo run -- haptics --print-feel > firmware-bridge/feel/standard.toml
    assert_eq!(STANDARD, to_toml(&Feel::default()));
    for field in FIELDS {
        let name = field.key.rsplit('.').next().unwrap_or_default();
        assert!(STANDARD.contains(&format!("\n{name} = ")), "{}", field.key);
        assert!(STANDARD.contains(field.source), "{}", field.key);
        let [lo, hi] = field.range;
        let range = format!("# {}, {lo} to {hi}; ", field.unit);
        assert!(STANDARD.contains(&range), "{range}");
    }
}

#[test]
fn a_file_changes_what_it_names_alone() {
    let text = "force_scale = 0.05\n[coupling]\nstiffness_n_per_mm = 0.4\n[cartilage]\nenergy_n_per_mm2 = 0x10\nvibration = 0\n";
    let changed = feel(text.as_bytes()).expect("a feel");
    let mut expected = Feel::default();
    for (key, value) in [
        ("force_scale", 0.05),
        ("coupling.stiffness_n_per_mm", 0.4),
        ("cartilage.energy_n_per_mm2", 16.0),
        ("cartilage.vibration", 0.0),
    ] {
        assert_eq!(expected.set(key, value), Some(Ok(())), "{key}");
    }
    assert_eq!(changed, expected);
    // what is printed is what was read, and what the report says
    assert_eq!(feel(to_toml(&changed).as_bytes()), Ok(changed));
    assert_eq!(in_force(&changed).len(), FIELDS.len());
    assert!((in_force(&changed)["coupling.stiffness_n_per_mm"] - 0.4).abs() < 1e-12);
    // inline tables and dotted keys are tables too; an empty file changes nothing
    let inline = b"coupling = { stiffness_n_per_mm = 0.4 }\ncartilage.energy_n_per_mm2 = 16\ncartilage.vibration = 0\nforce_scale = 5e-2";
    assert_eq!(feel(inline), Ok(expected));
    assert_eq!(feel(b""), Ok(Feel::default()));
    assert_eq!(load(&FeelArgs::default()).expect("a feel"), Feel::default());
}

#[test]
fn unknown_keys_are_refused_with_the_nearest_known_one() {
    for (text, words) in [
        (
            "\n[coupling]\nstifness = 0.5",
            ["line 3", "coupling.stifness", "coupling.stiffness_n_per_mm"],
        ),
        (
            "[law]\nstiffness_n_per_mm = 0.5",
            ["line 2", "nearest", "coupling.stiffness_n_per_mm"],
        ),
        ("forcescale = 1", ["line 1", "forcescale", "force_scale"]),
        (
            "[cartillage]\nvibration = 0",
            ["line 1", "no such parameter", "standard.toml"],
        ),
        ("tick_s = 0.001", ["line 1", "tick_s", "no such parameter"]),
        ("guard = 3", ["line 1", "is a table", "[guard]"]),
        ("[law.x]\ny = 1", ["line 1", "law.x", "nearest"]),
        ("[[law]]\nfeed_ratio = 1", ["line 1", "law", "is a table"]),
        ("'' = 1", ["line 1", "no such parameter", "nearest"]),
    ] {
        refused(text.as_bytes(), &words);
    }
    let long = format!("{} = 1", "x".repeat(5000));
    refused(long.as_bytes(), &["no such parameter"]);
}

#[test]
fn values_that_cannot_be_are_refused() {
    for (text, words) in [
        (
            "[coupling]\nstiffness_n_per_mm = 5",
            [
                "line 2",
                "coupling.stiffness_n_per_mm = 5 N/mm",
                "0.05 to 0.7",
            ],
        ),
        (
            "[law]\nfeed_ratio = -0.1",
            ["line 2", "-0.1", "outside 0 to 5"],
        ),
        ("force_scale = nan", ["force_scale", "NaN", "0.001 to 1"]),
        ("force_scale = inf", ["force_scale", "inf", "0.001 to 1"]),
        ("force_scale = 1e999", ["line 1", "force_scale", "0.001"]),
        (
            "force_scale = 99999999999999999999999",
            ["line 1", "force_scale", ""],
        ),
        (
            "force_scale = '0.03'",
            ["force_scale", "string", "give a number"],
        ),
        (
            "force_scale = true",
            ["force_scale", "boolean", "give a number"],
        ),
        ("force_scale = [1]", ["force_scale", "array", "a number"]),
        ("force_scale = {}", ["force_scale", "table", "a number"]),
        (
            "force_scale = 2020-01-01",
            ["force_scale", "datetime", "number"],
        ),
    ] {
        refused(text.as_bytes(), &words);
    }
}

#[test]
fn files_that_are_no_parameters_are_refused() {
    for (bytes, words) in [
        (&b"force_scale 3"[..], ["line 1", "standard.toml"]),
        (b"\n\nforce_scale = 1 1", ["line 3", "standard.toml"]),
        (
            b"force_scale = 0.1\nforce_scale = 0.1",
            ["line 2", "duplicate"],
        ),
        (b"[law]\n[law]", ["line 2", "duplicate"]),
        (
            b"'law.feed_ratio' = 1\n[law]\nfeed_ratio = 2",
            ["law.feed_ratio", "given twice"],
        ),
        (b"\n\xff\xfe = 1", ["line 2", "UTF-8"]),
    ] {
        refused(bytes, &words);
    }
    let dir = tempfile::tempdir().expect("a folder");
    let complaint = |path: &Path| {
        let args = FeelArgs {
            feel: Some(path.to_owned()),
            print_feel: false,
        };
        load(&args).expect_err("a refusal").to_string()
    };
    let large = dir.path().join("large.toml");
    std::fs::write(&large, "# ".repeat(40_000)).expect("written");
    assert!(complaint(&large).contains("64 KiB"));
    assert!(complaint(dir.path()).contains("no regular file"));
    assert!(complaint(&dir.path().join("none.toml")).contains("--feel"));
    // as deep as a small file can nest
    let deep = format!("law = {}", "[".repeat(30_000));
    assert!(feel(deep.as_bytes()).is_err());
    let deep = format!("law = {}", "{a=".repeat(20_000));
    assert!(feel(deep.as_bytes()).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        // either answer is one
        drop(feel(&bytes));
    }

    #[test]
    fn the_shipped_file_with_random_damage_never_panics_and_stays_in_range(
        at in 0..STANDARD.len(),
        damage in prop::collection::vec(any::<u8>(), 1..12),
    ) {
        let mut bytes = STANDARD.as_bytes().to_vec();
        let end = (at + damage.len()).min(bytes.len());
        bytes.splice(at..end, damage);
        match feel(&bytes) {
            Ok(feel) => prop_assert_eq!(feel.check(), Ok(())),
            Err(line) => prop_assert!(line.contains("line ") && !line.contains('\n'), "{}", line),
        }
    }
}
