use super::{RenderingArgs, run};
use osteon_viewer::RendererKind as Kind;
use osteon_viewer::lab::Adapter;

#[test]
fn a_quick_report_has_a_row_for_every_method_and_writes_all_its_files() {
    if let Err(e) = Adapter::open() {
        return crate::skipped(&format!("the report of drawing: {e:#}"));
    }
    let dir = tempfile::tempdir().unwrap();
    let args = RenderingArgs {
        out: dir.path().join("r"),
        quick: true,
    };
    run(&args).unwrap();
    let report = crate::json(&args.out.join("rendering.json"));
    let rows = report["rows"].as_array().unwrap();
    for kind in Kind::ALL {
        let row = rows
            .iter()
            .find(|r| r["method"] == kind.name() && !r["carving_ratio"].is_null())
            .unwrap();
        for key in [
            "frame_ms_p50",
            "frame_ms_p99",
            "carving_ratio",
            "bytes",
            "active_chunks",
        ] {
            assert!(row[key].as_f64().unwrap() > 0.0, "{} {key}", kind.name());
        }
        for key in ["adapter", "width", "height", "scale"] {
            assert!(!row[key].is_null(), "{key}");
        }
        for key in ["silhouette_px", "depth_rms_mm", "normal_rms_deg"] {
            assert_eq!(
                row[key].is_null(),
                kind == Kind::Section,
                "{} {key}",
                kind.name()
            );
        }
        assert!(args.out.join(format!("{}.png", kind.name())).is_file());
    }
    // the smooth methods are truer than the cubes: the measure sees it
    let depth = |method: &str| {
        let row = rows
            .iter()
            .find(|r| r["method"] == method && !r["depth_rms_mm"].is_null());
        row.unwrap()["depth_rms_mm"].as_f64().unwrap()
    };
    assert!(depth("iso") < 0.5 * depth("cubes"));
    let text = std::fs::read_to_string(args.out.join("rendering.md")).unwrap();
    for part in [
        "figure 3.15",
        "table 3.7",
        "table 3.8",
        "chunk kernel",
        "figures 3.13",
    ] {
        assert!(text.contains(part), "{part}");
    }
}
