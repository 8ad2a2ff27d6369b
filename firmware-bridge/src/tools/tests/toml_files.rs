//! Tools as data.

use super::{ascii, ball, binary};
use crate::tools::toml_tool::parse;
use crate::tools::{Detail, LoadedTools, ToolArgs, load};
use glam::Vec3;
use osteon_sim_core::tool::revolved::Revolved;
use osteon_sim_core::tool::{MAX_ELEMENTS, Tool};
use proptest::prelude::*;
use std::path::Path;

const STANDARD: &str = include_str!("../../../tools/standard.toml");
const EXAMPLES: &str = include_str!("../../../tools/examples.toml");

fn tools(text: &str) -> Result<LoadedTools, String> {
    parse(Path::new("my.toml"), text, Detail::Full).map_err(|e| e.to_string())
}

fn refused(text: &str, words: &[&str]) {
    let line = tools(text).expect_err("a refusal");
    for word in [&["my.toml"], words].concat() {
        assert!(line.contains(word), "'{line}' lacks '{word}'");
    }
    assert!(!line.contains('\n'), "{line}");
}

#[test]
fn the_standard_set_as_data_is_the_built_in_one() {
    let loaded = tools(STANDARD).expect("tools");
    // assert_eq would print two thousand elements
    assert!(loaded.tools == Tool::standard_set());
    assert!(loaded.notes.is_empty());
    let none = load(&ToolArgs::default(), Detail::Full).expect("tools");
    assert!(none.tools == loaded.tools);
}

#[test]
fn the_examples_are_what_they_say() {
    let loaded = tools(EXAMPLES).expect("tools");
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let size = |t: &Tool| {
        let b = t.shape.bounds();
        [2.0 * b.hi.x, b.lo.z, b.hi.z].map(|v| (v * 1e3).round() / 1e3)
    };
    let sizes: Vec<_> = loaded
        .tools
        .iter()
        .map(|t| (t.id.as_str(), size(t)))
        .collect();
    let truth = [
        ("pilot_reamer", [36.0, 0.0, 20.0]),
        ("thesis_reamer", [36.0, 0.0, 20.5]),
        ("round_burr", [6.0, 0.0, 45.0]),
        ("bull_nose", [8.0, 0.0, 45.0]),
    ];
    assert_eq!(sizes, truth);
    // exposed cutting faces: dome of 30 between the pilot (3.5) and 18; half a ball; a ball less the
    // cap that the shank covers; a quarter torus, the disc in it and 8.5 mm of side
    let (pi, sagitta) = (std::f32::consts::PI, |big: f32, r: f32| {
        big - (big * big - r * r).sqrt()
    });
    let areas = [
        2.0 * pi * 30.0 * (sagitta(30.0, 18.0) - sagitta(30.0, 3.5)),
        2.0 * pi * 18.0 * 18.0,
        2.0 * pi * 3.0 * (6.0 - sagitta(3.0, 1.2)),
        pi * pi * 2.5 * 1.5 + 2.0 * pi * 1.5 * 1.5 + pi * 2.5 * 2.5 + 2.0 * pi * 4.0 * 8.5,
    ];
    for (tool, truth) in loaded.tools.iter().zip(areas) {
        assert!(tool.elements.len() <= MAX_ELEMENTS);
        let cutting = tool.elements.iter().filter(|e| e.cutting);
        let area: f32 = cutting.map(|e| e.area_mm2).sum();
        assert!(
            (area / truth - 1.0).abs() < 2e-3,
            "{} {area} {truth}",
            tool.id
        );
        for e in &tool.elements {
            let d = tool.shape.signed_distance(e.position);
            assert!(
                d.abs() < 0.051 && e.cutting == (d > -0.04),
                "{} {e:?} {d}",
                tool.id
            );
            assert!(tool.shape.signed_distance(e.position + e.normal * 0.06) > 0.0);
        }
    }
}

/// A tool whose part is `part`.
fn with(part: &str) -> String {
    format!("[[tool]]\nname = 'X'\nid = 'x'\nrpm = 100\nlips = 2\n[[tool.part]]\n{part}")
}

#[test]
fn spoilt_tools_are_refused_with_place_and_remedy() {
    let good = with("ball = { radius_mm = 3, centre_mm = 3 }");
    assert_eq!(tools(&good).expect("a tool").tools.len(), 1);
    refused("", &["0 tools", "1 to 8"]);
    let nine: Vec<String> = (0..9)
        .map(|n| good.replace("'x'", &format!("'x{n}'")))
        .collect();
    refused(&nine.join("\n"), &["9 tools", "1 to 8"]);
    refused(&format!("{good}\n{good}"), &["tool x", "id", "two tools"]);
    refused("[[tool", &["line 1", "examples.toml"]);
    refused(&good.replace("rpm", "speed"), &["line 4", "speed"]);
    refused(&good.replace("lips = 2\n", ""), &["line 1", "lips"]);
    refused(&good.replace("lips = 2", "lips = -2"), &["line 5", "-2"]);
    refused(&good.replace("'x'", "'X Y'"), &["tool X Y", "id", "a to z"]);
    refused(&good.replace("'X'", "' '"), &["tool x", "name"]);
    for rpm in ["0", "nan", "inf", "-5", "1e9"] {
        let spoilt = good.replace("100", rpm);
        refused(&spoilt, &["tool x", "rpm", "1 to 200000"]);
    }
}

#[test]
fn spoilt_parts_are_refused_with_place_and_remedy() {
    let good = with("ball = { radius_mm = 3, centre_mm = 3 }");
    let parts = [
        ("", "part 1", "1 to 6 faces"),
        ("to_mm = 4", "part 1", "from_mm"),
        (
            "ball = { radius_mm = nan, centre_mm = 3 }",
            "ball.radius_mm",
            "give 0.1 to",
        ),
        (
            "ball = { radius_mm = 0, centre_mm = 3 }",
            "ball.radius_mm",
            "give 0.1 to",
        ),
        ("ball = { radius_mm = 3 }", "line 7", "centre_mm"),
        (
            "ball = { radius_mm = 3, centre_mm = 3, colour = 1 }",
            "line 7",
            "colour",
        ),
        (
            "cone = { apex_mm = 0, half_angle_deg = 90 }",
            "cone.half_angle_deg",
            "2 to 88",
        ),
        (
            "cylinder = { radius_mm = 3 }\nfrom_mm = 5\nto_mm = 2",
            "part 1",
            "enclose nothing",
        ),
        (
            "cylinder = { radius_mm = 3 }\nfrom_mm = 0\nto_mm = 300",
            "part",
            "200",
        ),
        (
            "ball = { radius_mm = 3, centre_mm = 3 }\ncutting = ['bal']",
            "cutting",
            "it has: ball",
        ),
    ];
    for (part, place, remedy) in parts {
        refused(&with(part), &[place, remedy]);
    }
    let five = "[[tool.part]]\nball = { radius_mm = 3, centre_mm = 3 }\n".repeat(4);
    refused(&format!("{good}\n{five}"), &["5 parts", "1 to 4"]);
    let both = format!("{good}\n[tool.mesh]\nfile = 'a.stl'");
    refused(&both, &["tool x", "either"]);
    refused(
        "[[tool]]\nname='X'\nid='x'\nrpm=9\nlips=2",
        &["tool x", "either"],
    );
    let off = tools(&with("ball = { radius_mm = 3, centre_mm = 0 }")).expect("a tool");
    assert!(
        off.notes[0].contains("lowest point is at z = -3.00"),
        "{:?}",
        off.notes
    );
}

/// A file of one tool made of `mesh`, in a folder with `bytes` as `a.stl`.
fn meshed(mesh: &str, bytes: &[u8]) -> Result<LoadedTools, String> {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("a.stl"), bytes).expect("written");
    let path = dir.path().join("my.toml");
    let text = format!(
        "[[tool]]\nname='X'\nid='x'\nrpm=9\nlips=2\n[tool.mesh]\nfile='a.stl'\nspacing_mm=0.4\n{mesh}"
    );
    std::fs::write(&path, text).expect("written");
    let args = ToolArgs { tools: Some(path) };
    load(&args, Detail::Full).map_err(|e| e.to_string())
}

#[test]
fn a_mesh_is_placed_and_scaled_as_told() {
    // a ball of 3 mm in inches, its tip at (1, 2, 3) mm, the shank along −y
    let bytes = binary(
        "",
        &ball(3.0)
            .into_iter()
            .map(|t| t.map(|v| Vec3::new(v.x + 1.0, 2.0 - v.z, v.y + 3.0) / 25.4))
            .collect::<Vec<_>>(),
    );
    let placed = "scale = 25.4\napex_mm = [1, 2, 3]\naxis = [0, -1, 0]\ncutting_below_mm = 2";
    let loaded = meshed(placed, &bytes).expect("a tool");
    let burr = Revolved::ball(3.0);
    let tool = &loaded.tools[0];
    for (i, j, k) in (0..8).flat_map(|i| (0..8).flat_map(move |j| (0..8).map(move |k| (i, j, k)))) {
        let p = Vec3::new(i as f32, j as f32, k as f32) * 1.1 - Vec3::new(4.0, 4.0, 1.0);
        let (got, truth) = (
            tool.shape.signed_distance(p),
            burr.signed_distance(p - Vec3::Z * 3.0),
        );
        assert!(
            truth.abs() > 2.0 || (got - truth).abs() < 0.06,
            "{p} {got} {truth}"
        );
    }
    assert!(
        tool.elements
            .iter()
            .all(|e| e.cutting == (e.position.z < 2.0))
    );
    let [note] = loaded.notes.as_slice() else {
        panic!("one note: {:?}", loaded.notes);
    };
    assert!(
        note.contains("a.stl: 2048 triangles on a grid of"),
        "{note}"
    );
}

#[test]
fn mended_meshes_are_told_of_and_hopeless_ones_refused() {
    let whole = ball(3.0);
    let mut spoilt: Vec<_> = whole[..1990].iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    spoilt.extend([spoilt[0], [Vec3::ONE; 3]]);
    let notes = meshed("", ascii(&spoilt).as_bytes())
        .expect("a tool")
        .notes
        .join("\n");
    for word in [
        "1 triangles without area",
        "1 triangles that were there twice",
        "inwards",
        "open: ",
    ] {
        assert!(notes.contains(word), "{notes}");
    }
    let refusal = |mesh: &str, bytes: &[u8], words: &[&str]| {
        let line = meshed(mesh, bytes).expect_err("a refusal");
        for word in words {
            assert!(line.contains(word), "'{line}' lacks '{word}'");
        }
    };
    let mut bad = whole.clone();
    bad[6][1].x = f32::NAN;
    refusal(
        "",
        &binary("", &bad),
        &["a.stl", "triangle 7", "repair", "tool x"],
    );
    bad[6][1].x = f32::MAX;
    refusal(
        "scale = 1000000",
        &binary("", &bad),
        &["a.stl", "mm large", "scale"],
    );
    refusal("", &binary("", &whole[..1]), &["1 triangles", "at least 4"]);
    refusal("scale = 0.01", &binary("", &whole), &["mm small", "25.4"]);
    refusal(
        "apex_mm = [900, 0, 0]",
        &binary("", &whole),
        &["apex_mm", "at most 500"],
    );
    refusal(
        "axis = [0, 0, 0]",
        &binary("", &whole),
        &["axis", "direction"],
    );
    refusal(
        "scale = nan",
        &binary("", &whole),
        &["scale", "out of range"],
    );
    refusal(
        "",
        &binary("", &whole)[..999],
        &["a.stl", "truncated", "tool x"],
    );
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) })]

    #[test]
    fn random_text_never_panics(text in "\\PC{0,300}") {
        prop_assert!(tools(&text).is_err());
    }

    #[test]
    fn spoilt_examples_never_panic(
        spots in prop::collection::vec((any::<prop::sample::Index>(), "[ -~\n]"), 1..4),
        line in any::<prop::sample::Index>(),
    ) {
        // without the lesson, whose letters change nothing
        let mut rows: Vec<&str> = EXAMPLES.lines().filter(|l| !l.starts_with('#')).collect();
        rows.remove(line.index(rows.len()));
        let mut text = rows.join("\n").replace('Ø', "D");
        for (at, letter) in spots {
            let at = at.index(text.len());
            text.replace_range(at..=at, &letter);
        }
        if let Ok(loaded) = tools(&text) {
            for tool in loaded.tools {
                prop_assert!(tool.elements.len() <= MAX_ELEMENTS);
                prop_assert!(tool.shape.outline().iter().flatten().all(|v| v.is_finite()));
            }
        }
    }
}
