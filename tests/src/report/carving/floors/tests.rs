use super::*;

fn row(scene: &str, method: &str, p50_us: f64) -> Row {
    Row {
        scene: scene.to_owned(),
        voxel_mm: 0.47,
        method: method.to_owned(),
        isa: "portable".to_owned(),
        events: 1,
        events_total: 1,
        contact_events: 1,
        p50_us: Some(p50_us),
        p99_us: None,
        max_us: None,
        mean_us: None,
        surface_rms_um: None,
        surface_max_um: None,
        volume_rel_err: None,
        missed_frac: None,
        excess_frac: None,
        ratio_thesis_scalar: None,
        ratio_thesis_simd: None,
        bytes: 0,
        surface_mean_um: None,
        surface_points: 0,
        surface_lost: 0,
        crease_rms_um: None,
        crease_max_um: None,
        raw_p50_us: None,
        raw_p99_us: None,
        raw_max_us: None,
    }
}

#[test]
fn verdicts_come_from_the_rows_alone() {
    let none = verdicts(&[]);
    assert!(none.iter().all(|v| v.met.is_none() && v.measured.is_none()));
    assert!(shortfall(&none).contains("not measured"));
    let rows = [
        row("reamer-press-0.47", "osteon", 6.0),
        row("reamer-press-0.47", "thesis-32", 1.0),
        row("reamer-press-0.235", "osteon", 37.8),
        row("plate-4", "osteon", 10.0),
        row("plate-1000", "osteon", 12.0),
    ];
    let all = verdicts(&rows);
    assert_eq!((all[0].met, all[0].measured), (Some(true), Some(6.0)));
    assert_eq!(all[1].met, Some(false));
    assert_eq!(all.last().expect("plates").measured, Some(1.2));
    assert!(shortfall(&all).contains("37.8 where 36.0 was asked for (1.05 × off)"));
    assert_eq!(table(&all).rows.len(), all.len());
}

#[test]
fn a_row_has_the_fields_that_were_asked_for() {
    let json = serde_json::to_value(row("s", "osteon", 1.0)).expect("JSON");
    for field in [
        "scene",
        "voxel_mm",
        "method",
        "isa",
        "events",
        "p50_us",
        "p99_us",
        "max_us",
        "mean_us",
        "surface_rms_um",
        "surface_max_um",
        "volume_rel_err",
        "missed_frac",
        "excess_frac",
        "ratio_thesis_scalar",
        "ratio_thesis_simd",
        "bytes",
    ] {
        assert!(json.get(field).is_some(), "{field}");
    }
    assert!(json["max_us"].is_null());
}
