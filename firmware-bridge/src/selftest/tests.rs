//! The procedure with a simulated arm, its hand and scripted answers, on the device's own clock.

use super::procedure::{Against, Plan, Step, Verdict, procedure};
use super::rig::{Look, Rig, counts};
use crate::fake::device::{Device, DeviceSetup};
use crate::fake::faults::Fault;
use crate::fake::hand::Hold;
use crate::fake::{Segment, Stroke};
use crate::link::DeviceInfo;
use glam::DVec3;
use osteon_protocol::device::{CommandFrame, DeviceMessage, DriveState, HostMessage, StateFrame};
use osteon_sim_core::servo::DeviceScale;

/// A simulated device, and an operator who answers at once.
struct Simulated {
    device: Device,
    scale: DeviceScale,
    state: StateFrame,
    seq: u16,
    told: Vec<String>,
    /// The sense of each encoder: −1 = wired the wrong way round.
    sense: [i32; 3],
    /// Torque shown for a torque commanded.
    gain: f64,
    answers: bool,
}

fn segment(goal_mm: [f64; 3], press: Option<u8>, dwell_s: f64) -> Segment {
    Segment {
        name: "hand".to_owned(),
        goal_mm,
        axis: [0.0, 0.2, 1.0],
        speed_mm_s: 200.0,
        max_push_n: 5.0,
        press,
        dwell_s,
        timeout_s: 5.0,
    }
}

/// What a careful operator does: out of the dock, right, up, towards, both buttons, the borders, back.
fn hand() -> Stroke {
    let mut segments = vec![
        segment([0.0, 0.0, -20.0], None, 1.5),
        segment([40.0, 0.0, -20.0], None, 1.5),
        segment([40.0, 40.0, -20.0], None, 1.5),
        segment([40.0, 40.0, 20.0], None, 1.5),
        segment([40.0, 30.0, 10.0], Some(1), 0.5),
        segment([40.0, 20.0, 0.0], Some(2), 0.5),
    ];
    let corners = [
        [-60.0, -40.0, -30.0],
        [60.0, -40.0, 30.0],
        [60.0, 50.0, 30.0],
        [-60.0, 50.0, -30.0],
    ];
    segments.extend(corners.map(|goal| segment(goal, None, 0.0)));
    segments.push(segment([0.0, 0.0, 0.0], None, 0.0));
    Stroke { segments }
}

impl Simulated {
    fn new() -> Self {
        let setup = DeviceSetup {
            hold: Hold::Grip,
            ..DeviceSetup::new(hand(), 3)
        };
        let mut device = Device::build(setup);
        let hello = device.firmware().config().hello;
        let mut state = device.tick();
        let mut go = |device: &mut Device, message: HostMessage| {
            device.simulate();
            let answer = device.receive(message);
            state = device.tick();
            answer
        };
        for _ in 0..1000 {
            go(
                &mut device,
                HostMessage::HelloRequest {
                    version: 1,
                    schema: osteon_protocol::device::DEVICE_SCHEMA,
                },
            );
        }
        go(&mut device, HostMessage::Home);
        if let Some(DeviceMessage::Challenge { nonce }) = go(&mut device, HostMessage::Arm) {
            go(&mut device, HostMessage::ArmConfirm { nonce });
        }
        assert_eq!(state.drive, DriveState::Armed);
        Self {
            device,
            scale: DeviceInfo::omni(&hello).scale,
            state,
            seq: 0,
            told: Vec::new(),
            sense: [1; 3],
            gain: 1.0,
            answers: true,
        }
    }

    fn steps(&mut self) -> Vec<Step> {
        let plan = Plan {
            against: Against::Spring(Hold::Grip.stiffness_n_per_mm()),
            most_n: 1.5,
            patience_ms: 20_000,
        };
        procedure(self, &plan)
    }

    fn seen(&self) -> StateFrame {
        let mut state = self.state;
        for (count, sense) in state.encoders.iter_mut().zip(self.sense) {
            *count *= sense;
        }
        state
    }
}

impl Rig for Simulated {
    fn beat(&mut self, force_n: DVec3) -> anyhow::Result<Look> {
        self.seq += 1;
        let torque = counts(&self.seen(), &self.scale, force_n * self.gain);
        self.device.simulate();
        self.device.receive(HostMessage::Command(CommandFrame {
            seq: self.seq,
            state_seq: self.state.seq,
            torque,
            enable: true,
        }));
        self.state = self.device.tick();
        Ok(Look::new(&self.seen(), &self.scale))
    }

    fn answer(&mut self) -> Option<String> {
        let last = self.told.last()?;
        (self.answers && last.contains("then press Enter")).then(String::new)
    }

    fn tell(&mut self, line: &str) {
        if line.contains("press the emergency stop") {
            self.device.inject(Fault::EStop, 1);
        }
        self.told.push(line.to_owned());
    }
}

fn verdict(steps: &[Step], name: &str) -> Verdict {
    let step = steps.iter().find(|s| s.name == name);
    step.unwrap_or_else(|| panic!("no {name} in {steps:#?}"))
        .verdict
}

#[test]
fn a_sound_device_passes_every_step() {
    let mut rig = Simulated::new();
    let steps = rig.steps();
    assert_eq!(steps.len(), 8);
    for step in &steps {
        assert_eq!(step.verdict, Verdict::Pass, "{step:?}");
    }
    let scale = steps[6].numbers["scale"];
    assert!((scale - 1.0).abs() < 0.1, "{scale}");
}

#[test]
fn a_planted_defect_fails_its_own_step_with_its_remedy() {
    let mut turned = Simulated::new();
    turned.sense = [-1, 1, 1];
    let steps = turned.steps();
    assert_eq!(verdict(&steps, "encoders: right"), Verdict::Fail);
    assert!(steps[1].seen.contains("other way"), "{:?}", steps[1]);
    assert_eq!(verdict(&steps, "encoders: up"), Verdict::Pass);

    let mut weak = Simulated::new();
    weak.gain = 0.6;
    let steps = weak.steps();
    assert_eq!(verdict(&steps, "force staircase"), Verdict::Fail);
    assert!(
        (steps[6].numbers["scale"] - 0.6).abs() < 0.1,
        "{:?}",
        steps[6]
    );
    assert_eq!(verdict(&steps, "emergency stop"), Verdict::Pass);
}

/// Nobody there: every step ends by itself, and nothing passes but the dock that the stylus never left.
#[test]
fn an_operator_who_does_nothing_ends_in_failures() {
    let mut rig = Simulated::new();
    rig.answers = false;
    rig.device = Device::build(DeviceSetup::new(Stroke::default(), 3));
    let plan = Plan {
        against: Against::Weight(100.0),
        most_n: 1.0,
        patience_ms: 300,
    };
    let steps = procedure(&mut rig, &plan);
    let passed: Vec<_> = steps
        .iter()
        .filter(|s| s.verdict == Verdict::Pass)
        .collect();
    assert!(
        passed.iter().all(|s| s.name == "emergency stop"),
        "{steps:#?}"
    );
}
