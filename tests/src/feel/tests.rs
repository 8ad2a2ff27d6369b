use super::*;

#[test]
fn scratch() {
    for j in [1.0, -1.0, 10.0, -10.0, 1000.0] {
        println!("{:?}", cases::gaps::glitch_row(j));
    }
    for (id, f) in CASES {
        let t = std::time::Instant::now();
        let c = f();
        println!(
            "{id} {} {}: {} {:?}",
            if c.pass { "PASS" } else { "FAIL" },
            c.name,
            c.measured,
            t.elapsed()
        );
    }
}
