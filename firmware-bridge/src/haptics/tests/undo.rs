//! Checkpoint and undo through the ring, whole or lost.

use super::*;

impl Pair {
    /// Runs with a publisher that keeps up; the tool is in bone from tick 3000 to 5000.
    fn run_in_step(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.run(1);
            self.drain(usize::MAX);
        }
    }

    fn ask(&mut self, request: Request) {
        self.requests.push(request).expect("room");
        self.run(1);
    }

    fn carve_on(&mut self, ticks: u32) {
        let before = self.thread.servo.cut().revision();
        self.run(ticks);
        assert!(self.thread.servo.cut().revision() > before, "still cutting");
    }

    fn recover(&mut self) {
        for _ in 0..3000 {
            self.run(1);
            self.drain(usize::MAX);
            if !self.thread.resync.is_behind() && !self.thread.servo.cut().is_undoing() {
                return;
            }
        }
        panic!("never caught up with");
    }
}

#[test]
fn a_mirror_that_keeps_up_goes_back_by_itself() {
    let mut pair = Pair::new(4096);
    pair.run_in_step(3150);
    let bone = Arc::clone(pair.thread.servo.bone());
    let kept = pair.mirror.cut.digest(&bone);
    pair.ask(Request::Checkpoint);
    pair.carve_on(200);
    pair.ask(Request::Checkpoint);
    pair.carve_on(200);
    pair.drain(usize::MAX);
    let mut restored = 0;
    pair.ask(Request::Undo);
    pair.ask(Request::Undo);
    while let Ok(record) = pair.records.pop() {
        pair.mirror.apply(&record, &mut |_, _| restored += 1);
    }
    assert!(restored > 0);
    assert_eq!(pair.thread.resync.overflows(), 0);
    assert!(!pair.thread.resync.is_behind(), "no brick is copied");
    assert_eq!(pair.mirror.cut.epoch(), 2);
    let now = pair.mirror.cut.digest(&bone);
    assert_eq!(now.changed_chunks, kept.changed_chunks);
    pair.assert_equal();
    pair.recover();
    pair.run(600);
    pair.drain(usize::MAX);
    pair.assert_equal();
}

#[test]
fn what_was_lost_after_a_checkpoint_does_not_matter_to_it() {
    let mut pair = Pair::new(1500);
    pair.run_in_step(3150);
    pair.ask(Request::Checkpoint);
    // the publisher sleeps until the ring is full, and has room for the undo alone
    pair.run(900);
    assert!(pair.thread.resync.is_behind());
    pair.drain(4);
    pair.ask(Request::Undo);
    assert!(!pair.thread.resync.is_behind(), "what was owed is gone");
    pair.drain(usize::MAX);
    assert_eq!(pair.mirror.cut.epoch(), 1);
    pair.recover();
    pair.run(500);
    pair.drain(usize::MAX);
    pair.assert_equal();
}

#[test]
fn an_undo_that_finds_the_ring_full_is_not_lost() {
    let mut pair = Pair::new(1500);
    pair.run_in_step(3150);
    pair.ask(Request::Checkpoint);
    pair.run(900);
    pair.ask(Request::Undo);
    assert!(pair.thread.resync.is_behind());
    assert_eq!(pair.mirror.cut.epoch(), 0);
    pair.recover();
    assert_eq!(pair.mirror.cut.epoch(), 1);
    pair.run(600);
    pair.drain(usize::MAX);
    pair.assert_equal();
}

#[test]
fn a_checkpoint_that_the_mirror_has_not_is_gone_back_to_brick_by_brick() {
    let mut pair = Pair::new(2048);
    pair.run(3000);
    assert!(pair.thread.resync.is_behind());
    // the mirror lacks a part of what is remembered
    pair.ask(Request::Checkpoint);
    for _ in 0..90 {
        pair.drain(usize::MAX);
        pair.run(5);
    }
    pair.drain(usize::MAX);
    assert!(!pair.thread.resync.is_behind());
    pair.ask(Request::Checkpoint);
    pair.carve_on(100);
    pair.drain(usize::MAX);
    pair.ask(Request::Undo);
    assert!(!pair.thread.resync.is_behind(), "this one it has");
    pair.ask(Request::Undo);
    assert!(pair.thread.resync.is_behind(), "this one it has not");
    pair.recover();
    assert_eq!(pair.mirror.cut.epoch(), 2);
    pair.run(300);
    pair.drain(usize::MAX);
    pair.assert_equal();
}

#[test]
fn an_undo_drops_the_pending_step_in_the_mirror_too() {
    let mut pair = Pair::over_budget(8192);
    pair.run(400);
    pair.ask(Request::Checkpoint);
    pair.run_until_carving();
    pair.drain(usize::MAX);
    pair.ask(Request::Undo);
    pair.recover();
    pair.run_until_carving();
    pair.drain(usize::MAX);
    assert_eq!(pair.thread.resync.overflows(), 0);
    pair.thread.servo.finish_carving();
    pair.assert_equal();
    // a servo that stops while it goes back
    pair.run(300);
    pair.ask(Request::Checkpoint);
    pair.run(1000);
    pair.ask(Request::Undo);
    pair.drain(usize::MAX);
    pair.thread.servo.finish_carving();
    pair.assert_equal();
}
