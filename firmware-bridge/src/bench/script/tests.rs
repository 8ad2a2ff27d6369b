use super::*;

fn bench(text: &str) -> (anyhow::Result<()>, String, serde_json::Value) {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    std::fs::write(at("s.toml"), text).unwrap();
    let outcome = run(&BenchArgs {
        script: at("s.toml"),
        junit: Some(at("out.xml")),
        json: Some(at("out.json")),
    });
    let xml = std::fs::read_to_string(at("out.xml")).unwrap_or_default();
    let json = std::fs::read(at("out.json")).unwrap_or_default();
    (
        outcome,
        xml,
        serde_json::from_slice(&json).unwrap_or_default(),
    )
}

#[test]
fn a_script_says_what_held_and_what_did_not() {
    let (outcome, xml, json) = bench(
        "[[session]]\nname = \"stop <1> & go\"\nfault = \"stop-sending:to-device\"\nexpect = \"stops\"\n\
         [[session]]\nname = \"hoped\"\nfault = \"e-stop\"\nexpect = \"goes-on\"\n",
    );
    let said = outcome.unwrap_err().to_string();
    assert!(said.contains("1 of 2 sessions failed"), "{said}");
    assert!(xml.contains("tests=\"2\" failures=\"1\""), "{xml}");
    assert!(
        xml.contains("name=\"stop &lt;1&gt; &amp; go\" time="),
        "{xml}"
    );
    assert_eq!(xml.matches("<failure").count(), 1);
    assert!(json[0]["failure"].is_null() && json[1]["failure"].is_string());
}

#[test]
fn the_shipped_scripts_are_read() {
    for name in ["smoke", "cable"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("bench/{name}.toml"));
        assert_eq!(load(&path).unwrap().len(), 4, "{name}");
    }
}

#[test]
fn each_wrong_part_of_a_script_is_named_in_one_line_and_nothing_is_written() {
    let one = "[[session]]\nname = \"a\"\n";
    for (text, word) in [
        (String::new(), "session"),
        ("session = 3".to_owned(), "line 1"),
        (format!("{one}\nseeds = \"x\""), "line 4"),
        (format!("{one}seeds = 0"), "seeds = 0"),
        (format!("{one}fault = \"rain\""), "'rain'"),
        (format!("{one}fault = \"e-stop:to-host\""), "give device"),
        (format!("{one}fault = \"seq-wrap\""), "cannot be scripted"),
        (format!("{one}expect = \"luck\""), "luck"),
        (format!("{one}colour = 1"), "colour"),
    ] {
        let (outcome, xml, _) = bench(&text);
        let said = format!("{:#}", outcome.unwrap_err());
        assert!(
            said.contains(word) && !said.contains('\n'),
            "{text}: {said}"
        );
        assert!(said.contains("s.toml"), "{said}");
        assert_eq!(xml, "");
    }
}
