//! The budget of a tick: what is over is carried over, and nothing of it is lost.

#![expect(clippy::print_stdout, reason = "a test that shows its figures")]

mod common;

use common::{Rig, slab};
use glam::DVec3;
use osteon_sim_core::carve::{CarveStep, Carving, Isa, Progress, Work, carve};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::servo::{Request, TICK_WORK, TickOutput};
use osteon_sim_core::tool::Tool;

const TOP: f64 = 6.1;
const REAMER: u8 = 1;
/// A chunk that is begun is finished: 1,092 units beyond the budget.
const OVERDRAFT: i64 = 1_100;

/// A reamer over soft bone of fine voxels: several steps a tick, each of many lines.
struct Scene {
    rig: Rig,
    tools: Vec<Tool>,
    hand: DVec3,
    // what an unhurried holder of the same steps has
    whole: Cut,
    carried: u32,
    outputs: Vec<TickOutput>,
}

impl Scene {
    fn new() -> Self {
        let bone = slab(DVec3::new(43.0, 43.0, 8.0), DVec3::splat(0.15), TOP, 0.1);
        let surface = DVec3::new(21.0, 21.0, TOP);
        let whole = Cut::new(&bone);
        let mut scene = Self {
            rig: Rig::new(bone, surface),
            tools: Tool::standard_set(),
            hand: surface + DVec3::Z * 10.0,
            whole,
            carried: 0,
            outputs: Vec::new(),
        };
        scene.tick(&[Request::SelectTool(REAMER), Request::Spindle(true)]);
        scene.spin_up();
        scene
    }

    fn spin_up(&mut self) {
        for _ in 0..400 {
            self.tick(&[]);
        }
    }

    fn tick(&mut self, requests: &[Request]) -> TickOutput {
        let output = self.rig.tick_at(self.hand, requests);
        self.note(&output);
        output
    }

    fn silent_tick(&mut self) -> TickOutput {
        self.rig.time_micros = self.rig.time_micros.wrapping_add(1000);
        let output = self.rig.servo.tick(None, &[]);
        self.note(&output);
        output
    }

    fn note(&mut self, output: &TickOutput) {
        assert!(
            i64::from(output.work) <= TICK_WORK + OVERDRAFT,
            "{}",
            output.work
        );
        if output.epoch != self.whole.epoch() {
            self.whole.reset(output.epoch);
        }
        let bone = self.rig.servo.bone();
        for step in &output.carved[..output.carved_len] {
            let tool = &self.tools[usize::from(step.tool)];
            carve(bone, &mut self.whole, tool, step, &mut |_, _| {});
        }
        self.carried += u32::from(self.rig.servo.carving());
        self.outputs.push(*output);
    }

    /// Moves the hand by `by` at 0.4 mm a tick.
    fn glide(&mut self, by: DVec3) {
        let ticks = (by.length() / 0.4).ceil();
        let mut n = 0.0;
        while n < ticks {
            self.hand += by / ticks;
            self.tick(&[]);
            n += 1.0;
        }
    }

    /// Pushes down until a step is carried over.
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
        assert!(!self.rig.servo.carving());
        let bone = self.rig.servo.bone();
        let cut = self.rig.servo.cut();
        assert_eq!(cut.digest(bone), self.whole.digest(bone));
        assert_eq!(cut.totals(), self.whole.totals());
        assert!(cut.digest(bone).changed_chunks > 0);
    }
}

#[test]
fn no_tick_spends_more_than_its_budget_and_the_rest_is_carved_later() {
    let mut scene = Scene::new();
    scene.glide(DVec3::Z * -16.0);
    for _ in 0..40 {
        scene.tick(&[]);
    }
    // what is not yet carved holds the tool and does not push it back
    let backwards = scene.outputs.windows(2).any(|pair| {
        let [before, after] = [&pair[0], &pair[1]].map(|o| o.bone_from_tool.translation.z);
        after > before + 1e-6
    });
    assert!(!backwards, "the tool came back out");
    let busiest = scene.outputs.iter().map(|o| o.work).max();
    let steps: usize = scene.outputs.iter().map(|o| o.carved_len).sum();
    println!(
        "{steps} steps, {} carried over, busiest {busiest:?}",
        scene.carried
    );
    assert!(scene.carried > 5, "{}", scene.carried);
    // a hand that rests: the servo itself comes to the end of it
    scene.glide(DVec3::Z * 19.0);
    assert!(!scene.rig.servo.carving());
    let steps: usize = scene.outputs.iter().map(|o| o.carved_len).sum();
    assert_eq!(scene.rig.servo.cut().revision(), steps as u64);
    scene.assert_whole();
}

#[test]
fn bone_that_is_not_yet_carved_holds_the_tool() {
    let mut scene = Scene::new();
    scene.glide(DVec3::Z * -11.0);
    scene.push_until_carving();
    let before = scene.outputs.last().expect("a tick").bone_from_tool;
    // without samples nothing goes on
    let silent = scene.silent_tick();
    assert_eq!((silent.work, silent.carved_len), (0, 0));
    assert_eq!(silent.bone_from_tool, before);
    assert!(scene.rig.servo.carving());
    // a pause keeps the step and finishes it
    let paused = scene.tick(&[Request::Pause(true)]);
    assert!(paused.work > 0 && paused.carved_len == 0);
    assert!(!scene.rig.servo.carving());
    scene.assert_whole();
}

#[test]
fn the_carried_step_survives_silence_and_tool_changes_and_ends_with_a_reset() {
    let mut scene = Scene::new();
    scene.glide(DVec3::Z * -11.0);
    scene.push_until_carving();
    for _ in 0..30 {
        scene.silent_tick();
    }
    assert!(scene.rig.servo.carving());
    // the step that is left is the reamer's, the tool in hand the drill
    let changed = scene.tick(&[Request::SelectTool(0)]);
    assert!(changed.work > 0 && changed.tool == 0);
    assert!(!scene.rig.servo.carving());
    scene.glide(DVec3::Z * 12.0);
    scene.tick(&[Request::SelectTool(REAMER)]);
    scene.spin_up();
    scene.glide(DVec3::new(2.0, 1.0, -13.0));
    scene.push_until_carving();
    let reset = scene.tick(&[Request::Reset]);
    assert_eq!((reset.epoch, reset.work, reset.carved_len), (1, 0, 0));
    assert!(!scene.rig.servo.carving());
    assert_eq!(scene.rig.servo.cut().revision(), 0);
    scene.glide(DVec3::Z * 13.0);
    scene.glide(DVec3::new(1.0, -3.0, -13.0));
    scene.push_until_carving();
    assert!(scene.rig.servo.cut().revision() < scene.whole.revision());
    scene.assert_whole();
}

#[test]
fn the_work_does_not_depend_on_the_vector_unit() {
    // else a replay on another machine would cut the steps elsewhere
    let bone = slab(DVec3::new(43.0, 43.0, 8.0), DVec3::splat(0.3), TOP, 0.1);
    for tool in Tool::standard_set() {
        let at =
            |z: f64| Pose::from_origin_and_z(DVec3::new(21.0, 21.3, z), DVec3::new(0.1, 0.2, 1.0));
        let spent = Isa::ALL.map(|isa| {
            let mut cut = Cut::new(&bone);
            let carving = Carving {
                isa,
                ..Carving::best()
            };
            [4.0, 3.2, 3.15, 3.0, 1.0].map(|z| {
                let step = CarveStep {
                    tool: 0,
                    before: at(z + 0.2),
                    after: at(z),
                };
                let mut budget = i64::MAX;
                let mut work = Work {
                    bone: &bone,
                    cut: &mut cut,
                    changed: &mut |_, _| {},
                };
                let progress = &mut Progress::default();
                assert!(carving.carve_some(&mut work, &tool, &step, (progress, &mut budget)));
                i64::MAX - budget
            })
        });
        // a unit that this processor lacks runs the portable code
        assert!(
            spent.iter().all(|s| *s == spent[0]),
            "{} {spent:?}",
            tool.id
        );
    }
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let run = || {
        let mut scene = Scene::new();
        scene.glide(DVec3::new(1.0, 0.5, -12.0));
        scene.push_until_carving();
        scene.silent_tick();
        scene.tick(&[]);
        let bone = scene.rig.servo.bone();
        (scene.rig.servo.cut().digest(bone), scene.outputs)
    };
    assert_eq!(run(), run());
}
