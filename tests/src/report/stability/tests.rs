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
