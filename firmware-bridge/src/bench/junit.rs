//! Results as `JUnit` XML, which every CI reads.

use std::fmt::Write as _;

/// One case.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct Case {
    /// Name.
    pub(super) name: String,
    /// Device time that it took, s.
    pub(super) seconds: f64,
    /// Why it failed, if it did.
    pub(super) failure: Option<String>,
}

/// The document.
pub(super) fn xml(suite: &str, cases: &[Case]) -> String {
    let failures = cases.iter().filter(|c| c.failure.is_some()).count();
    let seconds: f64 = cases.iter().map(|c| c.seconds).sum();
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n  <testsuite name=\"{}\" tests=\"{}\" \
         failures=\"{failures}\" errors=\"0\" time=\"{seconds:.3}\">\n",
        escaped(suite),
        cases.len()
    );
    for case in cases {
        let (name, time) = (escaped(&case.name), case.seconds);
        let end = match &case.failure {
            Some(why) => format!("><failure message=\"{}\"/></testcase>", escaped(why)),
            None => "/>".to_owned(),
        };
        // writing to a string cannot fail
        let _infallible = writeln!(
            text,
            "    <testcase classname=\"osteon.bench\" name=\"{name}\" time=\"{time:.3}\"{end}"
        );
    }
    text.push_str("  </testsuite>\n</testsuites>\n");
    text
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace(|c: char| c.is_control(), " ")
}
