use super::*;

#[test]
fn a_part_writes_its_sections_and_no_other() {
    let dir = tempfile::tempdir().expect("a folder");
    let args = StabilityArgs {
        out: dir.path().join("new"),
        soak: false,
        only: vec![Part::Peers],
    };
    run(&args).expect("a report");
    let text = std::fs::read_to_string(args.out.join("stability.json")).expect("a file");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert!(json.pointer("/peers/rate/0/removed_mm3").is_some());
    assert!(json.get("stiffness").is_none() && json.get("cases").is_none());
    for name in [
        "stability.md",
        "peers_rate_plot.svg",
        "peers_rate.csv",
        "peers_side.csv",
    ] {
        assert!(args.out.join(name).is_file(), "{name}");
    }
}

#[test]
fn published_forces_are_in_the_report_or_their_absence_is() {
    let dir = tempfile::tempdir().expect("a folder");
    let args = StabilityArgs {
        out: dir.path().to_owned(),
        soak: false,
        only: vec![Part::Forces],
    };
    run(&args).expect("a report");
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).expect("a file");
    let json: serde_json::Value = serde_json::from_str(&read("stability.json")).expect("JSON");
    let there = crate::feel::force_table::table_file().is_file();
    assert_eq!(json.get("force_table").is_some(), there);
    assert_eq!(read("stability.md").contains("Not measured"), !there);
    if there {
        let rows = json["force_table"].as_array().expect("rows");
        assert!(rows.iter().any(|r| r["law"]["force_n"].is_array()));
        assert!(
            rows.iter()
                .all(|r| r["why"].as_str().is_some_and(|w| !w.is_empty()))
        );
        assert!(dir.path().join("force_table_thrust.svg").is_file());
    }
}
