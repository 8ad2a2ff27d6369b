//! Whatever viewers do, the force loop's torques and the bone are those of a session without any; and
//! fifty of them that come and go all have the bone in the end.
#![expect(
    clippy::expect_used,
    clippy::panic,
    reason = "what goes wrong here is a failed test"
)]

use osteon_firmware_bridge::haptics::isolation::{Played, play};
use osteon_tests::report::isolation::attach::{Attached, Kind, Where, attach};
use osteon_tests::report::isolation::mirror::Follower;
use osteon_tests::{Running, json, number, one_at_a_time, stroke, text, until};
use std::cell::RefCell;
use std::path::Path;
use std::time::{Duration, Instant};

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");

/// Every kind that keeps a bone of its own or none, at once.
const KINDS: [Kind; 6] = [
    Kind::Healthy,
    Kind::Stopped,
    Kind::Killed,
    Kind::Flooding,
    Kind::Garbage,
    Kind::Slow,
];

fn played(dir: &Path, kinds: &[Kind]) -> (Played, Vec<Attached>) {
    let at = Where {
        socket: dir.join("s/haptics.sock"),
        osteon: OSTEON.into(),
        folder: dir.to_owned(),
        inside: true,
    };
    let attached = RefCell::new(Vec::new());
    let ready = || {
        let all = kinds.iter().map(|k| attach(*k, &at).expect("a viewer"));
        attached.borrow_mut().extend(all);
    };
    let over = || attached.borrow().iter().for_each(Attached::calm);
    let played = play(4500, &at.socket, ready, over).expect("a session");
    (played, attached.into_inner())
}

#[test]
fn the_same_inputs_make_the_same_bits_whoever_watches() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let (alone, _) = played(dir.path(), &[]);
    assert!(alone.steps.len() > 100 && alone.digest.changed_chunks > 0);
    assert!(alone.torques.iter().any(|t| *t != [0; 3]));
    let (beside, attached) = played(dir.path(), &KINDS);
    assert!(beside.torques == alone.torques, "a torque differs");
    assert_eq!(beside.digest, alone.digest);
    assert_eq!(beside.mirror_digest, alone.digest);
    assert!(beside.peak_bytes > 0 && beside.peak_bytes <= beside.bound_bytes);
    assert_eq!(beside.answers, [alone.digest; 3]);
    let mut cuts = 0;
    for (viewer, kind) in attached.into_iter().zip(KINDS) {
        if let Some(cut) = viewer.join() {
            assert_eq!(beside.missing(cut), 0, "{}", kind.name());
            cuts += 1;
        }
    }
    assert_eq!(cuts, 3);
    // a control: a bone in which nothing was cut lacks every step
    let dir = tempfile::tempdir().expect("a folder");
    let (short, attached) = played(dir.path(), &[Kind::Healthy]);
    let cut = attached.into_iter().next().and_then(Attached::join);
    let mut cut = cut.expect("a cut");
    cut.reset(0);
    assert!(short.missing(cut) > short.steps.len() / 2);
}

/// Comes and goes until an instant; then stays to the end. Pseudo-random, by its number.
fn visitor(socket: &Path, number: u64, until: Instant) -> Option<[u64; 2]> {
    let mut state = number;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        state >> 33
    };
    let mut lives = 0;
    while Instant::now() < until {
        let life = Duration::from_millis(50 + random() % 4000);
        Follower::new(socket).live_until((Instant::now() + life).min(until));
        lives += 1;
        std::thread::sleep(Duration::from_millis(random() % 2000));
    }
    let digest = Follower::new(socket).digest_at_the_end()?;
    Some([digest.hash, lives])
}

fn fifty(seconds: u64) {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let (socket, report) = (dir.join("s/haptics.sock"), dir.join("report.json"));
    let device = format!("sim:{}", stroke::peck(dir).display());
    let length = seconds.to_string();
    let (socket_text, report_text) = (socket.display().to_string(), report.display().to_string());
    let args = [
        "haptics",
        "--device",
        &device,
        "--voxel-mm",
        "1",
        "--seconds",
        &length,
        "--socket",
        &socket_text,
        "--json",
        &report_text,
    ];
    let mut haptics = Running::start(OSTEON, &args, dir, "haptics");
    until("the servo", Duration::from_mins(1), || {
        text(dir, "haptics.out").contains("1 kHz")
    });
    let until = Instant::now() + Duration::from_secs(seconds.saturating_sub(5));
    let visitors: Vec<_> = (1..=50)
        .map(|number| {
            let socket = socket.clone();
            let thread = std::thread::Builder::new().name(format!("visitor {number}"));
            let visit = move || visitor(&socket, number, until);
            thread.spawn(visit).expect("a thread")
        })
        .collect();
    let found: Vec<_> = visitors
        .into_iter()
        .map(|v| v.join().expect("a visitor"))
        .collect();
    assert!(
        haptics.wait(Duration::from_mins(1)).success(),
        "{}",
        text(dir, "haptics.err")
    );
    let report = json(&report);
    let servo = report["digest"]["servo"]
        .as_str()
        .expect("a digest")
        .to_owned();
    for (n, visitor) in found.iter().enumerate() {
        let [hash, _] = visitor.unwrap_or_else(|| panic!("viewer {} was never asked", n + 1));
        assert_eq!(format!("{hash:016x}"), servo, "viewer {}", n + 1);
    }
    let lives: u64 = found.iter().flatten().map(|[_, lives]| lives).sum();
    assert!(lives >= 50, "{lives}");
    assert_eq!(number(&report, "/digest/strayed_viewers").to_bits(), 0);
    assert!(number(&report, "/digest/changed_chunks") > 0.0);
    assert!(number(&report, "/viewer/connected") > 100.0);
    assert!(number(&report, "/viewer/peak_bytes") <= number(&report, "/viewer/bound_bytes"));
}

#[test]
fn fifty_viewers_that_come_and_go_all_have_the_bone_in_the_end() {
    fifty(12);
}

#[test]
#[ignore = "ten minutes; run it with --ignored"]
fn fifty_viewers_for_ten_minutes() {
    fifty(600);
}
