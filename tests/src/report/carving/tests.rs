use super::*;
use serde_json::Value;

#[test]
fn a_quick_report_writes_rows_tables_plots_and_a_document() {
    let dir = tempfile::tempdir().expect("a folder");
    let args = CarvingArgs {
        // made by the report
        out: dir.path().join("a/b"),
        quick: true,
        only: vec![Part::Scaling, Part::Thesis, Part::Memory],
    };
    run(&args).expect("a report");
    let json: Value = serde_json::from_str(
        &std::fs::read_to_string(args.out.join("carving.json")).expect("carving.json"),
    )
    .expect("JSON");
    let rows = json["rows"].as_array().expect("rows");
    assert!(rows.len() > 20);
    let mut methods = std::collections::BTreeSet::new();
    for row in rows {
        assert!(row["p50_us"].as_f64().is_none_or(|us| us > 0.0));
        methods.insert(row["method"].as_str().expect("a method").to_owned());
        // unknown, not 0
        assert!(row["ratio_thesis_scalar"].is_null() || row["ratio_thesis_scalar"].is_number());
    }
    for method in [
        "osteon",
        "thesis-16",
        "thesis-32",
        "thesis-64",
        "thesis-32-simd",
        "reza",
        "zheng",
        "yau",
        "octree",
    ] {
        assert!(methods.contains(method), "{method} of {methods:?}");
    }
    assert_eq!(json["parts"].as_array().expect("parts").len(), 3);
    let document = std::fs::read_to_string(args.out.join("carving.md")).expect("a document");
    // whatever the document shows is there
    let mut shown = 0;
    for part in document.split("](").skip(1) {
        let file = part.split(')').next().expect("a link");
        assert!(args.out.join(file).is_file(), "{file}");
        shown += 1;
    }
    assert!(shown > 20, "{shown}");
    for word in ["Table 3.3", "figure-3.9.svg", "A quick run", "density"] {
        assert!(document.contains(word), "{word}");
    }
}
