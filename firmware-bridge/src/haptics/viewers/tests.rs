//! Viewers over socket pairs, without a clock of the servo: what they are sent, what is kept of them.

mod rig;

use super::*;
use osteon_protocol::ipc::Role;
use rig::{Fake, Rig, join_as, pose, removal};
use std::io::Write as _;

#[test]
fn a_viewer_that_breaks_off_in_the_bone_gets_the_rest_of_it() {
    let mut rig = Rig::new();
    rig.cut(2, 5, 100);
    let mut fake = Fake::new(&mut rig, Role::Trainee);
    rig.visit();
    // hello, welcome, scene, reset, control, three pieces
    assert_eq!(fake.hear(8), 8);
    assert_eq!(fake.pieces, 3);
    rig.cut(7, 1, -4);
    fake.come_back(&mut rig);
    fake.settle(&mut rig);
    assert!(fake.welcome.expect("welcome").resumed);
    assert_eq!((fake.heard.scenes, fake.heard.pieces), (0, 5));
    fake.assert_same_as(&rig);
    assert_eq!(rig.viewers.counts.resumed, 1);
}

#[test]
fn after_a_break_only_what_was_missed_is_sent() {
    let mut rig = Rig::new();
    for brick in 0..64 {
        rig.cut(1, brick, 7);
    }
    let mut fake = Fake::settled(&mut rig, Role::Trainee);
    assert_eq!(fake.heard.bricks, 64);
    // two batches go out and are never read
    for brick in 0..2 {
        rig.cut(3, brick, 9);
        std::thread::sleep(Duration::from_millis(40));
        rig.visit();
    }
    rig.cut(4, 8, 9);
    fake.come_back(&mut rig);
    rig.cut(4, 9, 9);
    fake.settle(&mut rig);
    assert_eq!(fake.heard.bricks, 4, "two lost, two new");
    assert_eq!((fake.heard.scenes, fake.heard.pieces), (0, 0));
    fake.assert_same_as(&rig);
}

#[test]
fn a_reset_during_the_break_is_not_missed() {
    let mut rig = Rig::new();
    rig.cut(1, 3, 7);
    let mut fake = Fake::settled(&mut rig, Role::Trainee);
    // it goes out, and is lost with the connection
    rig.mirror.cut.reset(1);
    rig.viewers.reset(1);
    rig.visit();
    rig.cut(2, 3, 7);
    rig.visit();
    fake.come_back(&mut rig);
    fake.settle(&mut rig);
    assert_eq!(fake.cut.epoch(), 1);
    assert!(fake.welcome.expect("welcome").resumed);
    fake.assert_same_as(&rig);
}

#[test]
fn a_seat_of_another_session_or_a_guessed_one_is_not_resumed() {
    let mut rig = Rig::new();
    let fake = Fake::settled(&mut rig, Role::Trainee);
    let welcome = fake.welcome.expect("welcome");
    let resume = Resume {
        session: welcome.session,
        seat: welcome.seat,
        pieces: 8,
        batches: 0,
        epoch: 0,
    };
    for wrong in [
        Resume {
            session: resume.session ^ 1,
            ..resume
        },
        Resume {
            seat: resume.seat ^ 1,
            ..resume
        },
    ] {
        let join = join_as(Role::Trainee, capability::ALL, Some(wrong));
        let mut other = Fake::connect(&mut rig, join);
        other.settle(&mut rig);
        assert!(!other.welcome.expect("welcome").resumed);
        assert_eq!((other.heard.scenes, other.heard.pieces), (1, 8));
    }
    // more than it was ever sent: the cut begins anew, the bone is believed
    rig.cut(0, 0, 1);
    let join = join_as(
        Role::Trainee,
        capability::ALL,
        Some(Resume {
            batches: 99,
            ..resume
        }),
    );
    let mut liar = Fake::connect(&mut rig, join);
    liar.settle(&mut rig);
    liar.assert_same_as(&rig);
}

#[test]
fn one_is_in_control_and_hands_over() {
    let mut rig = Rig::new();
    let mut first = Fake::settled(&mut rig, Role::Trainee);
    let mut second = Fake::settled(&mut rig, Role::Trainee);
    let mut beamer = Fake::settled(&mut rig, Role::Projector);
    assert_eq!(second.holder(), Some(first.number()));
    assert_eq!(
        beamer.welcome.expect("welcome").granted & capability::CONTROL,
        0
    );
    // a wish of another is refused aloud; the clutch of the one in control is let go at the change
    second.wish(Command::Reset);
    assert_eq!(second.settle(&mut rig), []);
    assert!(
        second
            .denied
            .take()
            .is_some_and(|d| d.contains("viewer 1 is in control"))
    );
    first.wish(Command::Clutch(true));
    assert_eq!(first.settle(&mut rig), [Command::Clutch(true)]);
    second.wish(Command::AskControl);
    second.settle(&mut rig);
    first.settle(&mut rig);
    let asking = first.control.as_ref().and_then(|c| c.asking);
    assert_eq!(asking, Some(second.number()));
    first.wish(Command::HandOver(beamer.number()));
    first.settle(&mut rig);
    assert!(first.denied.take().is_some(), "not to a projector");
    first.wish(Command::HandOver(second.number()));
    first.settle(&mut rig);
    assert!(rig.viewers.let_go, "its clutch");
    second.wish(Command::Reset);
    assert_eq!(second.settle(&mut rig), [Command::Reset]);
    beamer.settle(&mut rig);
    assert_eq!(beamer.holder(), Some(second.number()));
    // it goes for good, and a trainer comes
    drop(second);
    rig.visit();
    let trainer = Fake::settled(&mut rig, Role::Trainer);
    assert_eq!(trainer.holder(), Some(trainer.number()));
    assert_eq!(rig.viewers.counts.denied, 2);
}

#[test]
fn a_viewer_gets_what_it_asked_for() {
    let mut rig = Rig::new();
    let asked = capability::DIGEST | 1 << 31;
    let mut plain = Fake::connect(&mut rig, join_as(Role::Trainer, asked, None));
    let mut full = Fake::new(&mut rig, Role::Trainer);
    plain.settle(&mut rig);
    full.settle(&mut rig);
    assert_eq!(plain.welcome.expect("welcome").granted, capability::DIGEST);
    assert_eq!(full.holder(), Some(full.number()), "the other may not");
    rig.pose = Some(pose());
    for revision in 1..=1000 {
        rig.viewers.removal(&removal(revision));
    }
    std::thread::sleep(Duration::from_millis(5));
    plain.settle(&mut rig);
    full.settle(&mut rig);
    assert!(plain.heard.removals.is_empty() && plain.heard.poses > 0);
    // thinned, and the last one has the whole sum
    assert!(full.heard.removals.len() <= 32);
    assert_eq!(full.heard.removals.last(), Some(&removal(1000)));
    // a viewer that does not answer digests is not waited for
    let deaf = join_as(Role::Trainer, capability::HEALTH, None);
    let mut deaf = Fake::connect(&mut rig, deaf);
    deaf.settle(&mut rig);
    for _ in 0..4 {
        let digest = rig.digest();
        rig.ask(Some(digest));
        plain.hear(usize::MAX);
        full.hear(usize::MAX);
    }
    assert!(rig.viewers.all_answered());
    assert_eq!(rig.viewers.reports().count(), 2);
}

#[test]
fn a_crowd_at_the_door_is_bounded_and_a_good_viewer_gets_in() {
    let mut rig = Rig::new();
    let mut crowd = Vec::new();
    for n in 0..400 {
        let mut stranger = rig.door();
        if n % 3 == 0 {
            stranger.write_all(&[0x5a; 900]).expect("sent");
        }
        crowd.push(stranger);
        assert!(rig.viewers.waiting.len() <= WAITING_ROOM);
    }
    let mut good = Fake::settled(&mut rig, Role::Trainee);
    assert_eq!(good.pieces, 8);
    good.assert_same_as(&rig);
    assert!(rig.viewers.counts.refused >= 384);
    assert!(rig.viewers.held() <= Viewers::most_held(8, 1));
}

#[test]
fn viewers_that_never_read_cost_a_bounded_memory() {
    let mut rig = Rig::new();
    let mut idle: Vec<Fake> = (0..MAX_VIEWERS)
        .map(|_| {
            let fake = Fake::new(&mut rig, Role::Trainee);
            rig.visit();
            fake
        })
        .collect();
    rig.pose = Some(pose());
    for (round, value) in (0..300_u64).zip((0..97).cycle()) {
        let at = usize::try_from(round).expect("a number");
        rig.cut(at % 8, at % 64, value);
        rig.viewers.removal(&removal(round));
        rig.visit();
    }
    assert!(rig.viewers.held() <= Viewers::most_held(8, MAX_VIEWERS));
    let mut more = Fake::new(&mut rig, Role::Trainee);
    rig.visit();
    more.hear(usize::MAX);
    assert!(
        more.denied
            .is_some_and(|d| d.contains("64 viewers are connected"))
    );
    // each of them still comes to the same bone
    idle[17].settle(&mut rig);
    idle[17].assert_same_as(&rig);
}

#[test]
fn an_old_viewer_is_refused_by_name() {
    let mut rig = Rig::new();
    let mut old = Fake::new(&mut rig, Role::Trainee);
    old.stream = rig.door();
    // version 3 had the same hello and no second message
    let name = "old".to_owned();
    old.say(&FromViewer::Hello { version: 3, name });
    rig.visit();
    old.hear(usize::MAX);
    let reason = old.denied.expect("refused");
    assert!(
        reason.contains("version 3") && reason.contains("update the older"),
        "{reason}"
    );
}
