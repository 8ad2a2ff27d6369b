//! Checkpoint and undo in the servo's step: within its budget, and the same bits as without.

#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

mod common;

use common::{Rig, slab};
use glam::DVec3;
use osteon_sim_core::carve::carve;
use osteon_sim_core::cut::Cut;
use osteon_sim_core::servo::{CutEvent, Request, TICK_WORK, TickOutput};
use osteon_sim_core::tool::Tool;

const TOP: f64 = 6.1;
const REAMER: u8 = 1;
/// A chunk that is begun is finished: 1,092 units beyond the budget, and 512 for what it saves.
const OVERDRAFT: i64 = 1_612;

/// A reamer over soft bone of fine voxels, and a holder of whole copies.
struct Scene {
    rig: Rig,
    tools: Vec<Tool>,
    hand: DVec3,
    plain: Cut,
    kept: Vec<Cut>,
    busiest: u32,
}

impl Scene {
    fn new() -> Self {
        let bone = slab(DVec3::new(43.0, 43.0, 8.0), DVec3::splat(0.15), TOP, 0.1);
        let surface = DVec3::new(21.0, 21.0, TOP);
        let mut scene = Self {
            plain: Cut::new(&bone),
            rig: Rig::new(bone, surface),
            tools: Tool::standard_set(),
            hand: surface + DVec3::Z * 10.0,
            kept: Vec::new(),
            busiest: 0,
        };
        scene.tick(&[Request::SelectTool(REAMER), Request::Spindle(true)]);
        for _ in 0..400 {
            scene.tick(&[]);
        }
        scene
    }

    fn tick(&mut self, requests: &[Request]) -> TickOutput {
        let output = self.rig.tick_at(self.hand, requests);
        self.note(&output);
        output
    }

    fn silent_tick(&mut self, requests: &[Request]) -> TickOutput {
        self.rig.time_micros = self.rig.time_micros.wrapping_add(1000);
        let output = self.rig.servo.tick(None, requests);
        self.note(&output);
        output
    }

    fn note(&mut self, output: &TickOutput) {
        let work = i64::from(output.work);
        assert!(work <= TICK_WORK + OVERDRAFT, "{work}");
        self.busiest = self.busiest.max(output.work);
        for event in output.events.iter() {
            match event {
                CutEvent::Reset { epoch } => {
                    self.plain.reset(epoch);
                    self.kept.clear();
                }
                CutEvent::Checkpoint { .. } => self.kept.push(self.plain.clone()),
                CutEvent::Undone { epoch, .. } => {
                    self.plain = self.kept.pop().expect("a checkpoint");
                    self.plain.set_epoch(epoch);
                }
            }
        }
        assert_eq!(usize::from(output.checkpoints), self.kept.len());
        let bone = self.rig.servo.bone();
        for step in &output.carved[..output.carved_len] {
            let tool = &self.tools[usize::from(step.tool)];
            carve(bone, &mut self.plain, tool, step, &mut |_, _| {});
        }
    }

    fn glide(&mut self, by: DVec3) {
        let ticks = (by.length() / 0.4).ceil();
        let mut n = 0.0;
        while n < ticks {
            self.hand += by / ticks;
            self.tick(&[]);
            n += 1.0;
        }
    }

    fn push_until_carving(&mut self) {
        for _ in 0..300 {
            if self.rig.servo.carving() {
                return;
            }
            self.hand.z -= 0.2;
            self.tick(&[]);
        }
        assert!(self.rig.servo.carving(), "nothing was carried over");
    }

    fn assert_whole(&mut self) {
        self.rig.servo.finish_carving();
        let bone = self.rig.servo.bone();
        let cut = self.rig.servo.cut();
        assert_eq!(cut.digest(bone), self.plain.digest(bone));
        assert_eq!(cut.totals(), self.plain.totals());
    }
}

#[test]
fn an_undo_goes_back_over_several_ticks_and_the_next_cut_has_the_same_bits() {
    let mut scene = Scene::new();
    scene.glide(DVec3::Z * -11.0);
    scene.glide(DVec3::Z * 11.0);
    let before = scene.rig.servo.cut().digest(scene.rig.servo.bone());
    let kept = scene.tick(&[Request::Checkpoint]);
    assert_eq!(kept.checkpoints, 1);
    scene.glide(DVec3::new(3.0, 1.0, -14.0));
    for _ in 0..60 {
        scene.tick(&[]);
    }
    let deep = scene.tick(&[]);
    let undone = scene.tick(&[Request::Undo]);
    assert!(undone.removed_by_class.iter().sum::<i64>() < deep.removed_by_class.iter().sum());
    assert!(
        scene.rig.servo.cut().is_undoing(),
        "more than a tick's work"
    );
    // nothing is felt or cut meanwhile, with samples or without
    let mut ticks = 1;
    while scene.rig.servo.cut().is_undoing() {
        let output = if ticks % 2 == 0 {
            scene.tick(&[])
        } else {
            scene.silent_tick(&[])
        };
        assert!(output.work > 0 && output.carved_len == 0);
        assert_eq!(output.physical_force_n, DVec3::ZERO);
        ticks += 1;
    }
    assert!(ticks < 20, "{ticks}");
    // the hand is inside bone that has come back: no force until it is free
    assert!(scene.tick(&[]).embedded);
    let after = scene.rig.servo.cut().digest(scene.rig.servo.bone());
    assert_eq!((after.hash == before.hash, after.epoch), (false, 1));
    assert_eq!(after.revision, before.revision);
    scene.assert_whole();
    scene.glide(DVec3::Z * 14.0);
    scene.glide(DVec3::new(-1.0, 2.0, -14.0));
    scene.assert_whole();
    assert_eq!(scene.tick(&[Request::Undo]).epoch, 1, "it was used up");
    assert!(i64::from(scene.busiest) > TICK_WORK / 2);
}

#[test]
fn a_checkpoint_waits_for_the_pending_step_and_an_undo_drops_it() {
    let mut scene = Scene::new();
    scene.glide(DVec3::Z * -11.0);
    scene.push_until_carving();
    // without a sample the step stays pending, and so does the wish
    assert_eq!(scene.silent_tick(&[Request::Checkpoint]).checkpoints, 0);
    assert!(scene.rig.servo.carving());
    // an undo of what was not yet remembered
    assert_eq!(scene.silent_tick(&[Request::Undo]).epoch, 0);
    scene.silent_tick(&[Request::Checkpoint]);
    let mut ticks = 0;
    while scene.tick(&[]).checkpoints == 0 {
        ticks += 1;
        assert!(ticks < 20, "no checkpoint");
    }
    scene.glide(DVec3::Z * 12.0);
    scene.glide(DVec3::new(4.0, 2.0, -12.0));
    scene.push_until_carving();
    let undone = scene.tick(&[Request::Undo, Request::Checkpoint, Request::Undo]);
    assert!(!scene.rig.servo.carving(), "the step belongs to the past");
    assert_eq!((undone.epoch, undone.checkpoints), (1, 0));
    scene.assert_whole();
    // a reset in the middle of going back
    scene.tick(&[Request::Checkpoint]);
    scene.glide(DVec3::Z * 12.0);
    scene.glide(DVec3::new(-6.0, 2.0, -12.0));
    for _ in 0..60 {
        scene.tick(&[]);
    }
    let reset = scene.tick(&[Request::Undo, Request::Reset]);
    assert!(!scene.rig.servo.cut().is_undoing());
    assert_eq!((reset.epoch, reset.checkpoints), (3, 0));
    scene.glide(DVec3::Z * 13.0);
    scene.glide(DVec3::Z * -12.0);
    scene.assert_whole();
}

#[test]
fn undo_after_undo_reaches_the_first_checkpoint() {
    let mut scene = Scene::new();
    scene.tick(&[Request::Checkpoint]);
    for way in [DVec3::X, DVec3::Y, -DVec3::X] {
        scene.glide(DVec3::Z * -10.5 + way);
        scene.glide(DVec3::Z * 10.5 + way);
        scene.tick(&[Request::Checkpoint]);
    }
    let output = scene.tick(&[Request::Undo, Request::Undo, Request::Undo, Request::Undo]);
    assert_eq!((output.epoch, output.checkpoints), (4, 0));
    scene.assert_whole();
    let digest = scene.rig.servo.cut().digest(scene.rig.servo.bone());
    assert_eq!((digest.revision, digest.changed_chunks), (0, 0));
}
