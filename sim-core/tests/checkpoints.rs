//! Checkpoints of a cut: going back gives the bits of a cut that was never made.

mod common;

use common::motley::{motley, random_step, tools};
use common::random::Random;
use osteon_sim_core::bone::Bone;
use osteon_sim_core::carve::{CarveStep, carve};
use osteon_sim_core::cut::{Cut, MAX_CHECKPOINTS, journal_bricks};
use osteon_sim_core::tool::Tool;
use proptest::prelude::*;
use std::sync::LazyLock;

struct World {
    bone: Bone,
    tools: Vec<Tool>,
}

static WORLD: LazyLock<World> = LazyLock::new(|| {
    let mut random = Random(31);
    World {
        bone: motley(&mut random),
        tools: tools(&mut random),
    }
});

impl World {
    fn steps(&self, seed: u64, count: usize) -> Vec<CarveStep> {
        let mut random = Random(seed);
        let middle = self.bone.grid().centre(22, 20, 19);
        (0..count)
            .map(|_| random_step(&mut random, &self.tools, middle))
            .collect()
    }

    fn carve(&self, cut: &mut Cut, steps: &[CarveStep]) {
        for step in steps {
            let tool = &self.tools[usize::from(step.tool)];
            carve(&self.bone, cut, tool, step, &mut |_, _| {});
        }
    }

    /// The same values, sums and revision; the epochs may differ.
    fn assert_same(&self, cut: &Cut, plain: &Cut) {
        let mut plain = plain.clone();
        plain.set_epoch(cut.epoch());
        assert_eq!(cut.digest(&self.bone), plain.digest(&self.bone));
        assert_eq!(cut.totals(), plain.totals());
    }
}

#[derive(Debug, Clone)]
enum Deed {
    Carve(u64, usize),
    Checkpoint,
    Undo(i64),
    Reset,
}

fn deeds() -> impl Strategy<Value = Vec<Deed>> {
    let deed = prop_oneof![
        6 => (any::<u64>(), 1..4_usize).prop_map(|(seed, n)| Deed::Carve(seed, n)),
        3 => Just(Deed::Checkpoint),
        3 => (1..400_i64).prop_map(Deed::Undo),
        1 => Just(Deed::Reset),
    ];
    prop::collection::vec(deed, 1..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Against a holder that keeps whole copies and has no journal.
    #[test]
    fn any_deeds_end_as_if_what_was_undone_had_never_been_cut(deeds in deeds()) {
        let world = &*WORLD;
        let bone = &world.bone;
        // room for every checkpoint, whatever is cut
        let room = MAX_CHECKPOINTS * journal_bricks(bone);
        let mut cut = Cut::with_journal(bone, room);
        let mut follower = Cut::with_journal(bone, room);
        let mut plain = Cut::new(bone);
        let mut kept: Vec<(u32, Cut)> = Vec::new();
        for deed in deeds {
            let epoch = cut.epoch() + 1;
            match deed {
                Deed::Carve(seed, count) => {
                    let steps = world.steps(seed, count);
                    for cut in [&mut cut, &mut follower, &mut plain] {
                        world.carve(cut, &steps);
                    }
                }
                Deed::Checkpoint => {
                    let id = cut.checkpoint().expect("a journal");
                    prop_assert!(follower.checkpoint_as(id));
                    kept.push((id, plain.clone()));
                    if kept.len() > MAX_CHECKPOINTS {
                        kept.remove(0);
                    }
                }
                Deed::Undo(budget) => {
                    let Some((id, copy)) = kept.pop() else {
                        prop_assert_eq!(cut.undo(epoch), None);
                        continue;
                    };
                    plain = copy;
                    prop_assert_eq!(cut.undo(epoch), Some(id));
                    prop_assert_eq!(cut.totals(), plain.totals());
                    while cut.is_undoing() {
                        let mut left = budget;
                        cut.go_on_undoing(&mut left, &mut |_, _| {});
                        prop_assert!(left > -8, "{} is overdrawn", left);
                    }
                    let gone = follower.undo_to(id, epoch, &mut |_, _| {});
                    prop_assert!(gone);
                }
                Deed::Reset => {
                    kept.clear();
                    cut.reset(epoch);
                    follower.reset(epoch);
                    plain.reset(epoch);
                }
            }
            prop_assert_eq!(cut.checkpoints(), kept.len());
            prop_assert_eq!(cut.digest(bone), follower.digest(bone));
            world.assert_same(&cut, &plain);
        }
        // nothing is known wrongly of what is at its lowest: the same steps go on to the same bits
        let steps = world.steps(1, 6);
        world.carve(&mut cut, &steps);
        world.carve(&mut plain, &steps);
        world.assert_same(&cut, &plain);
    }
}

#[test]
fn what_an_undo_restores_is_what_it_says() {
    let world = &*WORLD;
    let bone = &world.bone;
    let mut cut = Cut::with_journal(bone, journal_bricks(bone));
    world.carve(&mut cut, &world.steps(2, 5));
    let before = cut.clone();
    let id = cut.checkpoint().expect("a journal");
    world.carve(&mut cut, &world.steps(3, 5));
    let after = cut.clone();
    let mut said = vec![0u64; bone.chunk_count()];
    assert!(cut.undo_to(id, 1, &mut |chunk, brick| said[chunk] |= 1 << brick));
    let mut differ = 0;
    for (chunk, said) in said.iter().enumerate() {
        for brick in 0..64 {
            let same = before.values_of(chunk, brick) == after.values_of(chunk, brick);
            assert!(same || said >> brick & 1 == 1, "{chunk} {brick}");
            differ += u32::from(!same);
        }
    }
    assert!(differ > 10, "{differ}");
    assert!(!cut.undo_to(id, 2, &mut |_, _| {}), "it is used up");
    world.assert_same(&cut, &before);
}

#[test]
fn a_journal_that_is_full_gives_up_the_oldest_checkpoint() {
    let world = &*WORLD;
    let bone = &world.bone;
    let mut cut = Cut::with_journal(bone, 40);
    let mut copies = Vec::new();
    for n in 0..6 {
        copies.push(cut.clone());
        cut.checkpoint().expect("a journal");
        world.carve(&mut cut, &world.steps(n, 2));
    }
    let kept = cut.checkpoints();
    assert!((1..6).contains(&kept), "{kept}");
    for copy in copies.iter().rev().take(kept) {
        cut.undo(cut.epoch() + 1).expect("a checkpoint");
        cut.go_on_undoing(&mut 1_000_000, &mut |_, _| {});
        world.assert_same(&cut, copy);
    }
    assert_eq!(cut.undo(100), None);
    // more than all of it for one checkpoint: that goes as well, and the cut goes on
    let mut small = Cut::with_journal(bone, 3);
    let mut plain = Cut::new(bone);
    small.checkpoint().expect("a journal");
    for cut in [&mut small, &mut plain] {
        world.carve(cut, &world.steps(9, 6));
    }
    assert_eq!((small.checkpoints(), small.undo(1)), (0, None));
    world.assert_same(&small, &plain);
    assert_eq!(Cut::new(bone).checkpoint(), None, "there is no journal");
}

#[test]
fn numbers_that_were_left_out_mean_the_same_state() {
    let world = &*WORLD;
    let bone = &world.bone;
    let mut cut = Cut::with_journal(bone, journal_bricks(bone));
    let mut copies = Vec::new();
    for id in [3, 4, 7, 40] {
        copies.push(cut.clone());
        assert!(cut.checkpoint_as(id));
        world.carve(&mut cut, &world.steps(u64::from(id), 2));
    }
    // 40 is too far from 7 for what lies between
    assert_eq!(cut.checkpoints(), 1);
    assert!(!cut.undo_to(7, 1, &mut |_, _| {}));
    assert!(cut.undo_to(40, 1, &mut |_, _| {}));
    world.assert_same(&cut, &copies[3]);
    assert!(!cut.checkpoint_as(39), "numbers run on");
}
